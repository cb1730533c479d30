"""The console frozen, killed, its terminal closed; the worker killed: `python -m benchmarks console_deaths [--long]`

The real program runs in a pseudo-terminal of its own, with folders of its own, on the simulated machine at work. A
second client without the token looks on and keeps the time. POSIX only.
"""
from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import re
import select
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from verdict import exit_code

from console.frame import Frame
from console.link import Link, WorkerGone
from console.running import Where, WorkerFailed, find_running
from drivers.files.read_log import read_log

SIZE = (120, 40)
TAKES_ITS_TERMINAL = ("import fcntl, os, signal, sys, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
                      "signal.signal(signal.SIGHUP, signal.SIG_DFL); "          # nohup hands on that it is ignored
                      "os.execv(sys.argv[1], sys.argv[1:])")
_SEQUENCE = re.compile(r"\x1b\[([0-9;?=<>]*)([ -/]*[@-~])|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\)|\x1b[P_^][^\x1b]*\x1b\\"
                       r"|\x1b[()][0-9A-Za-z]|\x1b[0-9=>A-Z\\a-z]|([^\x1b]+)", re.DOTALL)


class Screen:
    """As much of a terminal as this console needs: text at places."""

    def __init__(self, columns: int, rows: int) -> None:
        self._columns, self._rows = columns, rows
        self._cells = [[" "] * columns for _ in range(rows)]
        self._row = self._column = 0
        self._rest = ""

    def feed(self, text: str) -> None:
        text = self._rest + text
        cut = text.rfind("\x1b")
        self._rest = ""
        if cut >= 0 and _SEQUENCE.match(text, cut) is None:
            text, self._rest = text[:cut], text[cut:]
        for numbers, command, plain in _SEQUENCE.findall(text):
            if plain:
                self._write(plain)
            elif command == "H":
                row, _, column = numbers.partition(";")
                self._row, self._column = int(row or 1) - 1, int(column or 1) - 1
            elif command == "J" and numbers in ("2", "3"):
                self._cells = [[" "] * self._columns for _ in range(self._rows)]
            elif command in "ABCD" and command:
                count = int(numbers or 1)
                self._row += {"A": -count, "B": count}.get(command, 0)
                self._column += {"C": count, "D": -count}.get(command, 0)

    def text(self) -> str:
        return "\n".join("".join(row).rstrip() for row in self._cells)

    def _write(self, text: str) -> None:
        for letter in text:
            if letter == "\r":
                self._column = 0
            elif letter == "\n":
                self._row += 1
            elif letter >= " ":
                if 0 <= self._row < self._rows and 0 <= self._column < self._columns:
                    self._cells[self._row][self._column] = letter
                self._column += 1


class Terminal:
    """A program in a pseudo-terminal; its screen is read all the time."""

    def __init__(self, command: list[str], environment: dict[str, str]) -> None:
        import fcntl
        import pty
        import termios
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", SIZE[1], SIZE[0], 0, 0))
        self.screen = Screen(*SIZE)
        self.process = subprocess.Popen([sys.executable, "-c", TAKES_ITS_TERMINAL, *command], stdin=slave, stdout=slave,
                                        stderr=slave, env=environment, close_fds=True)
        os.close(slave)
        self._open = True
        self._bytes = 0
        self._lock = threading.Lock()
        threading.Thread(target=self._read, daemon=True).start()

    def type(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def shows(self, words: str) -> bool:
        with self._lock:
            return words in self.screen.text()

    def text(self) -> str:
        with self._lock:
            return self.screen.text()

    def did(self) -> tuple[int, ...]:
        """What the program has done so far: bytes written, and where the system tells it ticks of the processor."""
        try:
            stat = Path(f"/proc/{self.process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            return (self._bytes,)
        return self._bytes, int(stat[11]) + int(stat[12])           # utime and stime, man 5 proc

    def hang_up(self) -> None:
        """What closing the window does."""
        self._open = False
        os.close(self._master)

    def end(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()
        self.process.wait()
        if self._open:
            self.hang_up()

    def _read(self) -> None:
        decoder = __import__("codecs").getincrementaldecoder("utf-8")("replace")
        while self._open:
            try:
                if select.select([self._master], [], [], 0.1)[0]:
                    data = os.read(self._master, 65536)
                    self._bytes += len(data)
                    with self._lock:
                        self.screen.feed(decoder.decode(data))
            except (OSError, ValueError):
                return


class Watcher:
    """A client that only looks, in a thread of its own: frames with the moment at which they came."""

    def __init__(self, where: Where) -> None:
        self.frames: list[tuple[float, Frame]] = []
        self.gone_at_s: float | None = None
        self._link = Link(where.looking_only())
        self._stop = False
        threading.Thread(target=lambda: asyncio.run(self._run()), daemon=True).start()

    def since(self, at_s: float, true: Callable[[Frame], bool]) -> float | None:
        """Seconds from `at_s` to the first frame after it for which it is so."""
        return next((came_s - at_s for came_s, frame in list(self.frames) if came_s >= at_s and true(frame)), None)

    def close(self) -> None:
        self._stop = True

    async def _run(self) -> None:
        task = asyncio.create_task(self._link.run())
        seen = -1
        while not task.done() and not self._stop:
            frame = self._link.newest
            if frame is not None and frame.seq != seen:
                seen = frame.seq
                self.frames.append((self._link.newest_at_s or time.monotonic(), frame))
            await asyncio.sleep(0.005)
        task.cancel()
        with contextlib.suppress(WorkerGone, asyncio.CancelledError):
            await task
        self.gone_at_s = time.monotonic()


class Console:
    """The real program with everything of its own under `folder`."""

    def __init__(self, folder: Path, begin_m: float = 30.0) -> None:
        self.folder = folder
        names = {"HOME": "home", "XDG_RUNTIME_DIR": "run", "XDG_DATA_HOME": "data", "XDG_STATE_HOME": "state",
                 "XDG_CACHE_HOME": "cache", "XDG_CONFIG_HOME": "config"}
        for name in names.values():
            (folder / name).mkdir(mode=0o700, exist_ok=True)
        kept = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "TEXTUAL_THEME", "TEXTUAL", "LANG")}
        self.environment = kept | {k: str(folder / v) for k, v in names.items()} | {
            "TERM": "xterm-256color", "LC_ALL": "C.UTF-8", "LANGUAGE": "en"}
        self.run_file = folder / "run" / "topdress" / "worker.json"
        self.job = folder / "job.yaml"
        shipped = Path(__file__).parents[1] / "configs" / "jobs" / "demo.yaml"
        job = yaml.safe_load(shipped.read_text(encoding="utf-8"))
        job["simulated"]["begin_m"] = begin_m                       # in the field: material flows at once
        self.job.write_text(yaml.safe_dump(job), encoding="utf-8")
        self.terminal = self.open()

    def open(self) -> Terminal:
        program = Path(sys.executable).parent / "topdress"
        return Terminal([str(program), "run", "--config", str(self.job)], self.environment)

    def where(self) -> Where:
        found: list[Where] = []

        def there() -> bool:
            with contextlib.suppress(WorkerFailed):
                where = find_running(self.run_file)
                found.extend([where] if where else [])
            return bool(found)

        wait(there, 20.0, "a worker that listens", self.terminal)
        return found[0]

    def end_worker(self) -> None:
        with contextlib.suppress(WorkerFailed, ProcessLookupError):
            where = find_running(self.run_file)
            if where:
                os.kill(where.pid, signal.SIGTERM)
                wait(lambda: not self.run_file.exists(), 10.0, "the worker's end")


PATIENCE = 10                   # times what a quiet machine needs: others may use it, and a start is no measurement


def wait(true: Callable[[], bool], most_s: float, what: str, terminal: Terminal | None = None) -> float:
    """Seconds until it is so. Raises TimeoutError, with the screen, where it is not so in time.

    most_s: on a machine that has nothing else to do. A program that is still at it, by what it writes and how long it
    has had the processor, has PATIENCE times as long; one that has ended has no time left.
    """
    started_s = quiet_s = time.monotonic()
    did = terminal.did() if terminal else ()
    while not true():
        now_s = time.monotonic()
        ended = terminal is not None and terminal.process.poll() is not None and not true()
        if terminal is not None and terminal.did() != did:
            quiet_s, did = now_s, terminal.did()
        idle = terminal is not None and now_s - quiet_s > most_s
        if ended or idle or now_s - started_s > PATIENCE * most_s:
            raise TimeoutError(f"{what}: {'it ended' if ended else f'not after {now_s - started_s:.0f} s'}"
                               + (f"\n{terminal.text()}" if terminal else ""))
        time.sleep(0.01)
    return time.monotonic() - started_s


class Death(NamedTuple):
    what: str
    happened: str
    after_s: float | None           # to held, or to word of it
    log: str
    ok: bool


def at_work(console: Console) -> tuple[Where, Watcher]:
    where = console.where()
    watcher = Watcher(where)
    wait(lambda: bool(watcher.frames), 10.0, "frames", console.terminal)
    for key, state in (("r", "ready"), ("s", "working")):
        wait(lambda: console.terminal.shows("NDVI 0."), 20.0, "the Run screen", console.terminal)
        console.terminal.type(key)
        wait(lambda state=state: watcher.frames[-1][1].row.state == state, 10.0, state,      # type: ignore[misc]
             console.terminal)
    wait(lambda: (watcher.frames[-1][1].row.shaft_rpm or 0.0) > 60.0, 15.0, "flow", console.terminal)
    return where, watcher


def log_says(where: Where) -> tuple[str, list[Any]]:
    rows = list(read_log(Path(where.log_path)).rows())
    gap_s = max(later.time_s - earlier.time_s for earlier, later in pairwise(rows))
    return f"{len(rows)} rows, last state {rows[-1].state}, longest gap {1000 * gap_s:.0f} ms", rows


def console_dies(folder: Path, how: str, long: bool = False) -> Death:
    """`how`: SIGSTOP, SIGKILL, or hang-up."""
    console = Console(folder)
    try:
        where, watcher = at_work(console)
        died_s = time.monotonic()
        if how == "hang-up":
            console.terminal.hang_up()
            wait(lambda: console.terminal.process.poll() is not None, 5.0, "the console's end")
        else:
            os.kill(console.terminal.process.pid, getattr(signal, how))
        wait(lambda: watcher.since(died_s, lambda f: f.row.state == "held") is not None, 6.0, "held")
        held_s = watcher.since(died_s, lambda f: f.row.state == "held")
        zero_s = watcher.since(died_s, lambda f: f.row.shaft_rpm_cmd == 0.0)
        stands_s = wait(lambda: (watcher.frames[-1][1].row.shaft_rpm or 0.0) < 1.0, 4.0, "a shaft that stands")
        time.sleep(0.7)                                             # rows reach the disk every half second
        log, rows = log_says(where)
        happened = f"held, shaft commanded to 0 after {zero_s:.2f} s, stands {stands_s:.1f} s later; "
        if long:
            gone = wait(lambda: watcher.gone_at_s is not None, 75.0, "the worker's end")
            log, rows = log_says(where)
            happened += f"worker off and gone {gone + stands_s:.0f} s later"
            return Death(f"console {how}, nobody comes back", happened, held_s, log,
                         rows[-1].state == "off" and rows[-1].shaft_rpm_cmd == 0.0)
        if how == "SIGSTOP":
            os.kill(console.terminal.process.pid, signal.SIGCONT)
        else:
            console.terminal.end()
            console.terminal = console.open()
        back_s = wait(lambda: console.terminal.shows("HELD"), 10.0, "held on screen",
                      console.terminal)
        console.terminal.type("a")
        wait(lambda: not watcher.frames[-1][1].alarms, 5.0, "acknowledged", console.terminal)
        console.terminal.type("s")
        wait(lambda: watcher.frames[-1][1].row.state == "working", 5.0, "working again", console.terminal)
        verb = "thawed" if how == "SIGSTOP" else "a new one attaches"
        return Death(f"console {how}", f"{happened}{verb}, shows it after {back_s:.1f} s; acknowledged, works again",
                     held_s, log, held_s is not None and 1.4 < held_s < 2.6 and rows[-1].state == "held")
    finally:
        console.terminal.end()
        console.end_worker()


def worker_dies(folder: Path) -> Death:
    console = Console(folder)
    try:
        where, watcher = at_work(console)
        time.sleep(1.0)
        died_s = time.monotonic()
        os.kill(where.pid, signal.SIGKILL)
        said_s = wait(lambda: console.terminal.shows("gone"), 5.0, "word of it on the screen", console.terminal)
        wait(lambda: watcher.gone_at_s is not None, 5.0, "the link's end")
        assert watcher.gone_at_s is not None
        log, rows = log_says(where)
        last = watcher.frames[-1][1].row
        missing_s = last.time_s - rows[-1].time_s
        alive = console.terminal.process.poll() is None
        return Death("worker SIGKILL", f"link closed after {watcher.gone_at_s - died_s:.2f} s, the console says so; "
                     "the board stops by itself after 1 s (loss table); the last "
                     f"{max(0.0, missing_s):.2f} s are not in the log",
                     said_s, log, said_s < 1.5 and missing_s < 1.1 and alive)
    finally:
        console.terminal.end()
        console.end_worker()


def run() -> int:
    parser = argparse.ArgumentParser(description="Deaths of console and worker.")
    parser.add_argument("--long", action="store_true", help="also wait for the worker's own end after 60 s")
    given = parser.parse_args()
    cases: list[tuple[Callable[..., Death], tuple[Any, ...]]] = [
        (console_dies, ("SIGSTOP",)), (console_dies, ("SIGKILL",)), (console_dies, ("hang-up",)), (worker_dies, ())]
    if given.long:
        cases.append((console_dies, ("SIGKILL", True)))
    found = []
    for case, arguments in cases:
        with tempfile.TemporaryDirectory() as folder:
            d = case(Path(folder), *arguments)
        found.append(d)
        print(f"{d.what:36}{d.after_s or float('nan'):6.2f} s  {'ok' if d.ok else 'SHORT':6}{d.happened}\n"
              f"{'':44}      log: {d.log}", flush=True)
    return exit_code({f"{d.what}: as it should be": d.ok for d in found})


if __name__ == "__main__":
    sys.exit(run())
