"""`topdress live` reads a working machine: on stdout, on its socket, by a broker; the page says
every field."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from topdress.console.cli.live import (
    PUBLISHED_FIELDS,
    _parse_broker_url,
    _serve_socket,
    calc_max_readers,
)
from topdress.console.cli.plain_errors import CommandError
from topdress.console.running import WorkerAddress
from topdress.control.log_row import LogRow
from topdress.control.orders import Do, Order

PAGE = Path(__file__).parents[2] / "docs" / "live-data.md"
MOSQUITTO = shutil.which("mosquitto", path=f"{os.environ.get('PATH')}:/usr/sbin")


@pytest.fixture
def live(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """`topdress live` for the worker of this test's folder."""
    started: list[subprocess.Popen[str]] = []
    (tmp_path / "topdress").symlink_to(tmp_path / "run", target_is_directory=True)

    def start(*words: str) -> subprocess.Popen[str]:
        program = (
            sys.executable,
            "-P",
            "-c",
            "from topdress.console.cli import main; main()",
            "live",
            *words,
        )
        started.append(
            subprocess.Popen(
                program,
                env=os.environ | {"XDG_RUNTIME_DIR": str(tmp_path)},
                text=True,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
        )
        return started[-1]

    yield start
    for one in started:
        one.kill()
        one.communicate()


@pytest.fixture
def working(running: Callable[..., WorkerAddress], attach: Callable[..., Any]) -> Callable[[], Any]:
    async def at_work() -> Any:
        link = await attach(running(name="worker"))
        for do in (Do.READY, Do.START):
            assert (await link.send_order(Order(do))).accepted
        return link

    return at_work


def free_port() -> int:
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as one:
        return int(one.getsockname()[1])


async def test_stdout_and_socket_say_the_row_and_nothing_is_heard(
    working: Callable[[], Any], live: Callable[..., Any]
) -> None:
    link = await working()
    told = live("--port", "0")
    port = int((await asyncio.to_thread(told.stderr.readline)).rpartition(":")[2])
    line = json.loads(await asyncio.to_thread(told.stdout.readline))
    assert (
        set(line) == {"format", *LogRow._fields, *PUBLISHED_FIELDS}
        and line["format"] == "topdress-live/1"
    )
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(json.dumps({"id": 1, "do": "stop", "value": None}).encode() + b"\n")
    lines = [json.loads(await asyncio.wait_for(reader.readline(), 10.0)) for _ in range(8)]
    times = [one["time_s"] for one in lines]
    assert times == sorted(set(times)) and {one["state"] for one in lines} == {"working"}
    assert link.current_frame.row.state == "working" and not link.current_frame.attached[1].orders
    writer.close()


async def test_a_stdout_that_nobody_reads_starves_no_socket_and_ctrl_c_ends_it(
    working: Callable[[], Any], live: Callable[..., Any]
) -> None:
    await working()
    told = live("--port", "0")
    fill_size = 1031  # F_SETPIPE_SZ: a page of 4 KB, which two lines fill
    fcntl.fcntl(told.stdout.fileno(), fill_size, 4096)
    port = int((await asyncio.to_thread(told.stderr.readline)).rpartition(":")[2])
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    for _ in range(12):
        await asyncio.wait_for(reader.readline(), 10.0)
    began_s = time.monotonic()
    told.send_signal(signal.SIGINT)
    assert await asyncio.to_thread(told.wait, 10.0) == 130
    assert time.monotonic() - began_s < 2.0
    writer.close()


@pytest.mark.exam
async def test_a_reader_that_goes_away_ends_it_without_a_word(
    working: Callable[[], Any], live: Callable[..., Any]
) -> None:
    """`topdress live | head -1`."""
    await working()
    told = live()
    assert await asyncio.to_thread(told.stdout.readline)
    told.stdout.close()
    assert await asyncio.to_thread(told.wait, 10.0) == 0
    assert told.stderr.read() == ""


def test_without_its_broker_it_ends_as_it_does_with_one(live: Callable[..., Any]) -> None:
    told = live("--quiet", "--mqtt", f"mqtt://127.0.0.1:{free_port()}/x")
    assert "not reached; it is tried again" in told.stderr.readline()
    told.send_signal(signal.SIGINT)
    assert told.wait(10.0) == 130 and told.stderr.read() == "cancelled\n"


async def test_more_readers_than_there_is_room_for_are_turned_away_with_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("topdress.console.cli.live.calc_max_readers", lambda: 2)
    tell = await _serve_socket(0)
    port = int(capsys.readouterr().err.rpartition(":")[2])
    ends = [await asyncio.open_connection("127.0.0.1", port) for _ in range(5)]
    late = [await asyncio.wait_for(one.read(), 10.0) for one, _ in ends[2:]]
    assert late == [b"", b"", b""]
    tell(b"line\n")
    heard = [await asyncio.wait_for(one.readline(), 10.0) for one, _ in ends[:2]]
    assert heard == [b"line\n", b"line\n"], "those before go on"
    loop = asyncio.get_running_loop()
    loop.call_exception_handler({"exception": OSError(errno.EMFILE, "Too many open files")})
    assert capsys.readouterr().err == "socket       2 programs read already: no more are let in\n"
    for _, writer in ends:
        writer.close()


def test_readers_leave_files_for_the_machine() -> None:
    resource = pytest.importorskip("resource")
    files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    assert 1 <= calc_max_readers() <= max(1, files - 80)


@pytest.mark.skipif(MOSQUITTO is None, reason="no mosquitto here")
async def test_a_broker_reads_a_working_machine(
    working: Callable[[], Any], live: Callable[..., Any]
) -> None:
    from paho.mqtt.client import Client, MQTTMessage
    from paho.mqtt.enums import CallbackAPIVersion

    await working()
    port, heard = free_port(), dict[str, list[str]]()
    broker = subprocess.Popen([str(MOSQUITTO), "-p", str(port)], stderr=subprocess.DEVNULL)
    reader = Client(CallbackAPIVersion.VERSION2)

    def take(_client: Client, _given: Any, message: MQTTMessage) -> None:
        heard.setdefault(message.topic, []).append(message.payload.decode())

    try:
        told = live("--quiet", "--mqtt", f"mqtt://127.0.0.1:{port}/farm/one", "--every", "0.5")
        reader.on_message = take
        for _ in range(50):
            with contextlib.suppress(OSError):
                reader.connect("127.0.0.1", port)
                break
            await asyncio.sleep(0.1)
        reader.subscribe("farm/#")
        reader.loop_start()
        until_s = time.monotonic() + 20.0
        while len(heard.get("farm/one/frame", ())) < 5 and time.monotonic() < until_s:
            await asyncio.sleep(0.1)
        lines = [json.loads(one) for one in heard["farm/one/frame"]]
        assert heard["farm/one/online"] == ["1"] and {one["state"] for one in lines} == {"working"}
        assert min(b["time_s"] - a["time_s"] for a, b in pairwise(lines)) > 0.4
        told.kill()  # the broker says what it cannot say any more
        while heard["farm/one/online"] != ["1", "0"] and time.monotonic() < until_s + 10.0:
            await asyncio.sleep(0.1)
        assert heard["farm/one/online"] == ["1", "0"]
    finally:
        reader.loop_stop()
        broker.kill()
        broker.wait()


def test_the_page_says_every_field_and_the_example_is_taken() -> None:
    page = PAGE.read_text(encoding="utf-8")
    rows = [row.split("|")[1] for row in page.splitlines() if row.startswith("| `")]
    assert [name for row in rows for name in re.findall(r"`(\w+)`", row)] == list(PUBLISHED_FIELDS)
    url = re.findall(r"mqtt://\S+", page)[0]
    assert (
        _parse_broker_url(url).username,
        _parse_broker_url(url).hostname,
        _parse_broker_url(url).path,
    ) == (
        "cab",
        "barn.local",
        "/farm/spreader",
    )


@pytest.mark.parametrize(
    "url",
    [
        "http://a/b",
        "mqtt://",
        "mqtt://a:x/b",
        "mqtt://u:secret@a/b",
        "mqtt://a/b/#",
        "mqtt://a/+",
        "mqtt://a:0/b",
    ],
)
def test_a_url_that_is_none_is_refused_without_its_password(url: str) -> None:
    with pytest.raises(CommandError, match="allowed is mqtt://USER@HOST:PORT/TOPIC") as refused:
        _parse_broker_url(url)
    assert "secret" not in str(refused.value)
