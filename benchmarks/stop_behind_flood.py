"""STOP while strangers flood the worker: `python -m benchmarks stop_behind_flood [--strangers 0,1,8,32] [--times 20]`

The real console in a pseudo-terminal, the real worker, `topdress serve-machine` behind TCP. Between worker and board
stands this program: it passes every byte on and notes when a drive frame comes that forbids the drives. Each stranger
is a process of its own: it connects to the worker's port without a key, sends refusable lines as fast as they are
taken, and connects again at once when it is put out. From key to drive frame: from writing X to the terminal until that
frame. `busy` rows have as many processes that only burn the processor and touch no port: what the computer alone costs.
POSIX only.
"""
from __future__ import annotations

import argparse
import os
import selectors
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import yaml
from console_deaths import Console, Terminal, wait
from verdict import exit_code

SERVE = [sys.executable, "-c", "from console.cli import main; main()", "serve-machine", "--port", "0", "--seed", "3"]
MOST_S = 30.0               # a STOP that took longer is counted as that long
MEDIAN_S, WORST_S = 0.25, 1.0       # promised with strangers, over what as many busy programs cost
STRANGER = textwrap.dedent("""
    import socket, sys, time
    port, kind = int(sys.argv[1]), sys.argv[2]
    line = {"words": b"x\\n", "orders": b'{"id":1,"token":"0","do":"start"}\\n',
            "looks": b'{"id":1,"token":null,"ask":"look"}\\n'}[kind]
    lines = line * (60000 // len(line))
    while True:
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=2.0) as one:
                while True:
                    one.settimeout(2.0)
                    one.sendall(lines)
                    one.setblocking(False)
                    try:
                        while one.recv(1 << 16):
                            pass
                    except BlockingIOError:
                        pass
        except OSError:
            pass
""")
BUSY = "while True: pass"
KINDS = ("words", "orders", "looks")


class Tap(threading.Thread):
    """Between worker and board, byte for byte; `stopped_s`: when the newest drive frame that forbids the drives came
    after one that allowed them."""

    def __init__(self, board_url: str) -> None:
        super().__init__(daemon=True)
        host, _, port = board_url.removeprefix("socket://").rpartition(":")
        self._board = (host, int(port))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
        self.turning = False
        self.stopped_s = 0.0
        self._rest = b""

    def run(self) -> None:
        while True:
            near, _ = self._listener.accept()
            with suppress(OSError), near, socket.create_connection(self._board) as far, \
                    selectors.DefaultSelector() as chooser:
                chooser.register(near, selectors.EVENT_READ, far)
                chooser.register(far, selectors.EVENT_READ, near)
                self._pass_on(chooser, near)

    def _pass_on(self, chooser: selectors.BaseSelector, near: socket.socket) -> None:
        while True:
            for key, _ in chooser.select():
                assert isinstance(key.fileobj, socket.socket)
                data = key.fileobj.recv(65536)
                if not data:
                    return
                if key.fileobj is near:
                    self._look(data)
                key.data.sendall(data)

    def _look(self, data: bytes) -> None:
        now_s = time.monotonic()
        *lines, self._rest = (self._rest + data).split(b"\r\n")
        for line in lines:
            fields = line.split(b"*")[0].split(b",")
            if fields[0] not in (b"$T1", b"$T2"):
                continue
            turning = fields[4] == b"1" and float(fields[2]) > 0.0
            if self.turning and not turning:
                self.stopped_s = now_s
            self.turning = turning


@contextmanager
def machine() -> Iterator[dict[str, str]]:
    """The served machine; gives the address of each device."""
    child = subprocess.Popen(SERVE, stdout=subprocess.PIPE, text=True)
    urls: dict[str, str] = {}
    assert child.stdout is not None
    try:
        for line in child.stdout:
            if line.startswith("serving"):
                break
            device, _, url = line.split()
            urls[device] = url
        yield urls
    finally:
        child.terminate()
        child.wait()


class TappedConsole(Console):
    """The console on a cab whose board is behind the tap."""

    def __init__(self, folder: Path, urls: dict[str, str], board: str) -> None:
        self._cab = folder / "cab.yaml"
        self._cab.write_text(yaml.safe_dump({
            "format": "topdress-cab/1", "virtual": True, "gnss": {"port": urls["gnss"]},
            "heads": {"ports": [urls[f"head_{n}"] for n in range(1, 7)]}, "board": {"port": board}}))
        super().__init__(folder)

    def open(self) -> Terminal:
        program = Path(sys.executable).parent / "topdress"
        return Terminal([str(program), "run", "--config", str(self.job), "--config", str(self._cab)], self.environment)


@contextmanager
def crowd(count: int, port: int, busy: bool) -> Iterator[None]:
    """As many strangers, each a process of its own, of all kinds in turn."""
    children = [subprocess.Popen([sys.executable, "-c", BUSY] if busy else
                                 [sys.executable, "-c", STRANGER, str(port), KINDS[k % len(KINDS)]])
                for k in range(count)]
    try:
        time.sleep(1.0 + 0.1 * count if count else 0.0)
        yield
    finally:
        for child in children:
            child.send_signal(signal.SIGKILL)
        for child in children:
            child.wait()


class Row(NamedTuple):
    count: int
    busy: bool
    seconds: list[float]
    load: float
    held: int           # how often the machine was not at work any more when the key came


def stops(console: TappedConsole, tap: Tap, times: int) -> tuple[list[float], int]:
    """Seconds from each key to the drive frame; how often the machine had been held before."""
    found: list[float] = []
    held = 0
    while len(found) < times:
        work(console, tap)
        time.sleep(0.37 + 0.037 * (len(found) % 7))          # not in step with the ticks
        if not tap.turning:
            held += 1
            if held > times:
                break
            continue
        pressed_s = time.monotonic()
        console.terminal.type("x")
        with suppress(TimeoutError):
            wait(lambda: not tap.turning, MOST_S, "a frame that forbids the drives")
        found.append(min(MOST_S, time.monotonic() if tap.turning else tap.stopped_s - pressed_s))
    return found, held


def work(console: TappedConsole, tap: Tap) -> None:
    """Until the drives turn. Alarms are acknowledged on the way."""
    terminal, until_s = console.terminal, time.monotonic() + 180.0
    while not tap.turning:
        if time.monotonic() > until_s:
            raise TimeoutError(f"the machine does not come to work:\n{terminal.text()}")
        key = _next_key(terminal)
        if key == "s" and not terminal.shows("no alarms"):
            terminal.type("a")
            with suppress(TimeoutError):
                wait(lambda: terminal.shows("no alarms"), 0.3, "no alarms")
        terminal.type(key)
        with suppress(TimeoutError):
            wait(lambda key=key: tap.turning or _next_key(terminal) != key, 1.5, "turning")  # type: ignore[misc]


def _next_key(terminal: Terminal) -> str:
    """What is pressed to come to work from the state that the screen shows; "" where there is nothing to press."""
    first = terminal.text().splitlines()[0]
    return "r" if "OFF" in first or "FAULT" in first else "s" if "READY" in first or "HELD" in first else ""


def line_of(row: Row) -> str:
    seconds = sorted(row.seconds)
    who = f"{row.count} {'busy' if row.busy else 'strangers'}"
    if not seconds:
        return f"| {who} | - | - | 0 | {row.held} | {row.load:.0f} |"
    return (f"| {who} | {1000 * statistics.median(seconds):.0f} ms | {1000 * seconds[-1]:.0f} ms | {len(seconds)} | "
            f"{row.held} | {row.load:.0f} |")


def run() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--strangers", default="0,1,8,32")
    parser.add_argument("--busy", default="8,32")
    parser.add_argument("--times", type=int, default=20)
    given = parser.parse_args()
    cases = [(int(n), False) for n in given.strangers.split(",") if n] + [
        (int(n), True) for n in given.busy.split(",") if n]
    print(f"load average at the start: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; key X to drive frame")
    print("| with | median | worst | times | held before | load |\n|---|---|---|---|---|---|", flush=True)
    rows = []
    with machine() as urls, tempfile.TemporaryDirectory() as folder:
        tap = Tap(urls["board"])
        tap.start()
        console = TappedConsole(Path(folder), urls, tap.url)
        try:
            port = console.where().port
            wait(lambda: console.terminal.shows("NDVI 0."), 60.0, "numbers", console.terminal)
            for count, busy in cases:
                with crowd(count, port, busy):
                    seconds, held = stops(console, tap, given.times)
                    rows.append(Row(count, busy, seconds, os.getloadavg()[0], held))
                print(line_of(rows[-1]), flush=True)
        finally:
            console.terminal.end()
            console.end_worker()
    costs = {row.count: max(row.seconds) for row in rows if row.busy and row.seconds}
    return exit_code({
        f"{row.count} strangers: median at most {MEDIAN_S} s, worst at most {WORST_S} s, or what as many busy programs "
        f"cost, never held": bool(row.seconds) and statistics.median(row.seconds) <= MEDIAN_S
        and max(row.seconds) <= max(WORST_S, costs.get(row.count, 0.0)) and row.held == 0
        for row in rows if not row.busy})


if __name__ == "__main__":
    sys.exit(run())
