"""Text from files and devices steers no terminal: not on a page, not on a command's output."""
from __future__ import annotations

import contextlib
import os
import pty
import subprocess
import sys
from dataclasses import replace

import pytest

from drivers.plain_text import plain

STEERING = ("\x1b]0;taken\x07", "\x1b[2J", "\x9b2J", "\x1b[6n", "\x7f", "a\rb", "\u202egnp.exe", "\u2066x")


@pytest.mark.parametrize("text", STEERING)
def test_what_steers_is_left_out(text: str) -> None:
    assert plain(text).isprintable() and plain(f"job {text}").startswith("job ")


def test_plain_text_stays() -> None:
    for text in ("", "Weizen Süd 12 %", "作业 1", "two\nlines\tof text", "10 m² ≤ 5 °"):
        assert plain(text) is text or plain(text) == text


def drawn(app) -> str:
    """Every character of the screen as it would go to the terminal."""
    return "".join(segment.text for strip in app.screen._compositor.render_strips() for segment in strip)


@pytest.mark.parametrize("key", ["f1", "f2", "f4", "f10"])
async def test_no_page_lets_a_text_steer(app, source, key):
    bad = "".join(STEERING)
    frame = source.newest
    devices = tuple(replace(device, last_raw=bad, last_error=bad, protocol=bad) for device in frame.devices)
    source.newest = replace(frame, job=bad, machine=bad, crop=bad, log_path=f"/tmp/{bad}.csv", devices=devices)
    async with app.run_test(size=(120, 40)) as pilot:
        app.notice(bad)
        await pilot.press(key)
        await pilot.pause(0.3)
        text = drawn(app)
    assert "gnp.exe" in text or "taken" in text, "the texts are on this page"
    assert [char for char in text if not char.isprintable() and char != "\n"] == []


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_no_command_lets_a_text_steer():
    """On a terminal; a pipe gets every byte, so that a file of odd text can be had back."""
    for terminal in (True, False):
        master, slave = pty.openpty() if terminal else os.pipe()
        said = "import sys, typer; from console.cli.plain_output import take_terminals; take_terminals();" \
               "typer.echo('map \\x1b]0;taken\\x07 of \\x9b2J'); typer.echo('bad \\x1b[2J', err=True);" \
               "sys.stderr.write('\\r\\x1b[K 12 %')"
        subprocess.run([sys.executable, "-c", said], stdout=slave, stderr=slave, check=True)
        os.close(slave)
        heard = b""
        with contextlib.suppress(OSError):                 # Linux: the end of a pseudo-terminal
            while got := os.read(master, 1000):
                heard += got
        os.close(master)
        heard = heard.replace(b"\x1b[31m", b"").replace(b"\x1b[0m", b"")      # our own colour of what went wrong
        assert (heard.count(b"\x1b") == 1) == terminal and b"]0;taken" in heard and b"12 %" in heard
