"""How long the console is silent while it draws: `python -m benchmarks sign_of_life [--rounds 1]`

The real console in a pseudo-terminal, at work on the simulated machine, turning to every page and opening every dialog.
Between console and worker stands this program, passes every byte on and notes when the console says that it lives. The
worker holds the machine after 2 s without that word. On a busy computer the clock says more about the others than about
the console, so what is printed is the processor's time that the console's event loop took between two words: a computer
that is so many times slower is silent so many times longer, and a word apart. Linux only.
"""
from __future__ import annotations

import argparse
import json
import os
import selectors
import signal
import socket
import statistics
import sys
import tempfile
import threading
import time
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

from console_deaths import Console, Terminal, wait
from verdict import exit_code

from console.running import Where, start_worker
from console.worker.system import write_private
from drivers.files.lock import take_lock

AFTER_S = 1.5               # looked on after each key
LIMIT_S = 2.0
PROMISED_SLOWER = 8         # on a computer so much slower than this one the machine is still never held
F1, F2, F3, F4, F5, F6 = "\x1bOP", "\x1bOQ", "\x1bOR", "\x1bOS", "\x1b[15~", "\x1b[17~"
F7, F8, F9, F10, F11, ESCAPE = "\x1b[18~", "\x1b[19~", "\x1b[20~", "\x1b[21~", "\x1b[23~", "\x1b"
KEYS = (("help", F1), ("manual rate", "m"), ("strategy", "t"), ("target from", "o"), ("allowed", "h"), ("alarms", "!"),
        ("all actions", "\x10"))
PAGES = (("map", F3), ("trends", F4), ("devices", F5), ("calibrate", F6), ("replay", F7), ("diagnosis", F9),
         ("job", F10), ("settings", F11), ("run", F2))


class Between(threading.Thread):
    """Passes on what console and worker say; `said`: when the console said that it lives, and its processor's time."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self._port = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.said: list[tuple[float, float]] = []
        self.pid = 0
        self.held = False               # since it was last looked

    def run(self) -> None:
        while True:
            threading.Thread(target=self._pass_on, args=(self._listener.accept()[0],), daemon=True).start()

    def _pass_on(self, near: socket.socket) -> None:
        with suppress(OSError), near, socket.create_connection(("127.0.0.1", self._port)) as far, \
                selectors.DefaultSelector() as chooser:
            chooser.register(near, selectors.EVENT_READ, far)
            chooser.register(far, selectors.EVENT_READ, near)
            while True:
                for key, _ in chooser.select():
                    assert isinstance(key.fileobj, socket.socket)
                    data = key.fileobj.recv(65536)
                    if not data:
                        return
                    if key.fileobj is near and b'"alive"' in data:
                        self.said.append((time.monotonic(), worked_s(self.pid) if self.pid else 0.0))
                    self.held = self.held or b'"state":"held"' in data
                    key.data.sendall(data)

    def most(self, from_s: float, until_s: float) -> tuple[float, float]:
        """The longest silence that any of this time saw, and the most that the console worked between two words, s."""
        said = list(self.said)
        first = max((k for k, (at_s, _) in enumerate(said) if at_s <= from_s), default=0)
        part = [one for one in said[first:] if one[0] <= until_s]
        pairs = [pair for pair in pairwise(part) if pair[0][1] > 0.0]
        return (max((later[0] - earlier[0] for earlier, later in pairs), default=until_s - from_s),
                max((later[1] - earlier[1] for earlier, later in pairs), default=0.0))


def worked_s(pid: int) -> float:
    """Processor's time of a process's first thread."""
    return float(Path(f"/proc/{pid}/task/{pid}/schedstat").read_text().split()[0]) / 1e9


class ConsoleOnWorker(Console):
    """The console attaches to the worker through `Between`."""

    def open(self) -> Terminal:
        self.worker = start_worker(["--config", str(self.job), "--log", str(self.folder / "run.csv")],
                                   self.folder / "trouble", run_file=self.folder / "own.json", timeout_s=60.0)
        self.between = Between(self.worker.port)
        self.between.start()
        self.run_file.parent.mkdir(mode=0o700)
        self._lock = take_lock(self.run_file.with_suffix(".lock"))
        write_private(self.run_file, json.dumps({
            "port": self.between.port, "token": self.worker.token, "pid": self.worker.pid,
            "log_path": self.worker.log_path}).encode())
        return super().open()

    def where(self) -> Where:
        return self.worker

    def end_worker(self) -> None:
        with suppress(ProcessLookupError):
            os.kill(self.worker.pid, signal.SIGTERM)
            wait(lambda: not (self.folder / "own.json").exists(), 20.0, "the worker's end")


def working(terminal: Terminal) -> None:
    terminal.type(F2)
    time.sleep(1.0)
    until_s = time.monotonic() + 120.0
    while "WORKING" not in (first := terminal.text().splitlines()[0]):
        if time.monotonic() > until_s:
            raise TimeoutError(terminal.text())
        if not terminal.shows("no alarms"):
            terminal.type("a")
            time.sleep(0.5)
        terminal.type("r" if "OFF" in first or "FAULT" in first else "s" if "READY" in first or "HELD" in first else "")
        time.sleep(1.0)


def looked(console: ConsoleOnWorker, rounds: int) -> tuple[dict[str, tuple[float, float]], int]:
    """Of each thing done the longest silence and the most work between two words; how often the machine was held."""
    terminal, found, held = console.terminal, dict[str, tuple[float, float]](), 0
    for _round in range(rounds):
        for name, keys in (*((name, (key, ESCAPE)) for name, key in KEYS), *((name, (key,)) for name, key in PAGES)):
            if console.between.held:
                held += 1
                working(terminal)
                console.between.held = False
            started_s = time.monotonic()
            for key in keys:
                terminal.type(key)
                time.sleep(AFTER_S)
            silent_s, work_s = console.between.most(started_s, time.monotonic())
            before = found.get(name, (0.0, 0.0))
            found[name] = max(before[0], silent_s), max(before[1], work_s)
    return found, held + console.between.held


def run() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=1)
    given = parser.parse_args()
    print(f"load average at the start: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as folder:
        console = ConsoleOnWorker(Path(folder))
        try:
            wait(lambda: console.terminal.shows("NDVI 0."), 90.0, "numbers", console.terminal)
            console.between.pid = console.terminal.process.pid
            found, held = looked(console, given.rounds)
            usual = statistics.median(later[0] - earlier[0] for earlier, later in pairwise(console.between.said))
        finally:
            console.terminal.end()
            console.end_worker()
    print("| | work between two words | silent here | on a computer 4 times slower | 8 times |\n|---|---|---|---|---|")
    for name, (silent_s, work_s) in found.items():
        slower = " | ".join(f"{usual + times * work_s:.2f} s" for times in (4.0, 8.0))
        print(f"| {name} | {1000 * work_s:.0f} ms | {silent_s:.2f} s | {slower} |")
    print(f"a word every {usual:.2f} s; held {held} times; load average at the end: {os.getloadavg()[0]:.1f}")
    worst_s = max(work_s for _silent_s, work_s in found.values())
    return exit_code({
        f"a computer {PROMISED_SLOWER} times slower is silent for {usual + PROMISED_SLOWER * worst_s:.2f} s at most: "
        f"below {LIMIT_S:g} s": usual + PROMISED_SLOWER * worst_s < LIMIT_S})


if __name__ == "__main__":
    sys.exit(run())
