"""Text from files and devices steers no terminal: not on a page, not on a command's output."""

from __future__ import annotations

import asyncio
import contextlib
import os
import pty
import subprocess
import sys
import time
from dataclasses import replace

import pytest
from topdress.console.app.terminal import MAX_STALL_S, TerminalPulse
from topdress.console.link import Link
from topdress.console.running import WorkerAddress
from topdress.drivers.plain_text import remove_control_characters

STEERING = (
    "\x1b]0;taken\x07",
    "\x1b[2J",
    "\x9b2J",
    "\x1b[6n",
    "\x7f",
    "a\rb",
    "\u202egnp.exe",
    "\u2066x",
)


@pytest.mark.parametrize("text", STEERING)
def test_what_steers_is_left_out(text: str) -> None:
    assert remove_control_characters(text).isprintable() and remove_control_characters(
        f"job {text}"
    ).startswith("job ")


def test_plain_text_stays() -> None:
    for text in ("", "Weizen Süd 12 %", "作业 1", "two\nlines\tof text", "10 m² ≤ 5 °"):
        assert remove_control_characters(text) is text or remove_control_characters(text) == text


def drawn(app) -> str:
    """Every character of the screen as it would go to the terminal."""
    return "".join(
        segment.text for strip in app.screen._compositor.render_strips() for segment in strip
    )


@pytest.mark.usefixtures("drawn_at_once")
@pytest.mark.parametrize("key", ["f1", "f2", "f4", "f10"])
async def test_no_page_lets_a_text_steer(app, source, key):
    bad = "".join(STEERING)
    frame = source.current_frame
    devices = tuple(
        replace(device, last_raw=bad, last_error=bad, protocol=bad) for device in frame.devices
    )
    source.current_frame = replace(
        frame, job=bad, machine=bad, crop=bad, log_path=f"/tmp/{bad}.csv", devices=devices
    )
    async with app.run_test(size=(120, 40)) as pilot:
        app.show_notice(bad)
        await pilot.press(key)
        await pilot.pause(0.3)
        text = drawn(app)
    assert "gnp.exe" in text or "taken" in text, "the texts are on this page"
    assert [char for char in text if not char.isprintable() and char != "\n"] == []


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_no_command_lets_a_text_steer():
    """On a terminal, and through a pipe to the one behind (`record x.csv | cat`)."""
    for terminal in (True, False):
        master, slave = pty.openpty() if terminal else os.pipe()
        said = (
            "import sys, typer; from topdress.console.cli.plain_output import replace_streams; "
            "replace_streams();"
            "typer.echo('map \\x1b]0;taken\\x07 of \\x9b2J'); typer.echo('bad \\x1b[2J', err=True);"
            "sys.stderr.write('\\r\\x1b[K 12 %')"
        )
        subprocess.run([sys.executable, "-c", said], stdout=slave, stderr=slave, check=True)
        os.close(slave)
        heard = b""
        with contextlib.suppress(OSError):  # Linux: the end of a pseudo-terminal
            while got := os.read(master, 1000):
                heard += got
        os.close(master)
        # our own colour of what went wrong
        heard = heard.replace(b"\x1b[31m", b"").replace(b"\x1b[0m", b"")
        assert heard.count(b"\x1b") == terminal, "but for our own line of progress"
        assert b"\x9b" not in heard and b"\x07" not in heard
        assert b"]0;taken" in heard and b"12 %" in heard


# --- A terminal that stands: the console on it says no more that it lives
# --------------------------------------------

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")


@pytest.fixture
def terminal():
    """Both ends of one whose program may be stopped: (what it reads, what is drawn on)."""
    import pty

    near, far = pty.openpty()
    os.set_blocking(far, False)
    yield near, far
    os.close(near)
    os.close(far)


def fill(far):
    """The kernel moves what is written on to the reader's end a moment later: filled once it has
    refused twice in a row."""
    for _ in range(2):
        with pytest.raises(BlockingIOError):
            while True:
                os.write(far, b"x" * 1000)
        time.sleep(0.05)


def test_one_that_stands_is_noticed_and_one_that_goes_on_too(terminal):
    near, far = terminal
    now_s = [0.0]
    takes = TerminalPulse(far, lambda: now_s[0])
    for now_s[0] in (0.1, 10.0):
        assert takes()
    fill(far)
    now_s[0] += MAX_STALL_S
    assert takes(), "so long any terminal may draw"
    now_s[0] += 0.1
    assert not takes()
    now_s[0] += 100.0
    assert not takes()
    while not takes():
        os.read(near, 65536)
    fill(far)
    assert takes(), "it took something just now"


def test_where_there_is_none_nothing_stands():
    now_s = [0.0]
    takes = TerminalPulse(None, lambda: now_s[0])
    now_s[0] = 1000.0
    assert takes()


def test_a_console_that_is_not_seen_says_nothing():
    said = []
    link = Link(WorkerAddress(1, "token", 1))
    link._write_message = lambda _number, message: said.append(message)

    async def words(shows, count):
        link.shows = lambda: shows
        link._send_keep_alive()
        await asyncio.sleep(0.35)
        link._next_word.cancel()
        assert (len(said) >= count) if shows else not said

    asyncio.run(words(False, 0))
    asyncio.run(words(True, 2))
