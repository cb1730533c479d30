"""Consoles in terminals of their own, driven by keys: what tests and benchmarks of the real
program share. POSIX only.

A program runs in a pseudo-terminal that is read all the time, with folders of its own;
`Watcher` looks on and keeps the time; `Tap` stands between worker and board.
"""

from __future__ import annotations

import asyncio
import os
import re
import select
import selectors
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import yaml
from topdress.console.frame import Frame
from topdress.console.link import Link, WorkerGone
from topdress.console.running import WorkerAddress, WorkerFailed, find_running_worker

SIZE = (120, 40)
TAKES_ITS_TERMINAL = (
    "import fcntl, os, signal, sys, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
    # nohup hands on that it is ignored
    "signal.signal(signal.SIGHUP, signal.SIG_DFL); "
    "os.execv(sys.argv[1], sys.argv[1:])"
)
_SEQUENCE = re.compile(
    r"\x1b\[([0-9;?=<>]*)([ -/]*[@-~])|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\)|\x1b[P_^][^\x1b]*\x1b\\"
    r"|\x1b[()][0-9A-Za-z]|\x1b[0-9=>A-Z\\a-z]|([^\x1b]+)",
    re.DOTALL,
)


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
        self.process = subprocess.Popen(
            [sys.executable, "-c", TAKES_ITS_TERMINAL, *command],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env=environment,
            close_fds=True,
        )
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
        """What the program has done so far: bytes written, and where the system tells it ticks
        of the processor."""
        try:
            stat = (
                Path(f"/proc/{self.process.pid}/stat")
                .read_text(encoding="utf-8")
                .rpartition(")")[2]
                .split()
            )
        except OSError:
            return (self._bytes,)
        return self._bytes, int(stat[11]) + int(stat[12])  # utime and stime, man 5 proc

    def hang_up(self) -> None:
        """What closing the window does."""
        self._open = False
        os.close(self._master)

    def end(self) -> None:
        with suppress(ProcessLookupError):
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
    """A client that only looks, in a thread of its own: frames with the moment at which they
    came."""

    def __init__(self, where: WorkerAddress) -> None:
        self.frames: list[tuple[float, Frame]] = []
        self.gone_at_s: float | None = None
        self._link = Link(where.drop_token())
        self._stop = False
        threading.Thread(target=lambda: asyncio.run(self._run()), daemon=True).start()

    def since(self, at_s: float, true: Callable[[Frame], bool]) -> float | None:
        """Seconds from `at_s` to the first frame after it for which it is so."""
        return next(
            (
                came_s - at_s
                for came_s, frame in list(self.frames)
                if came_s >= at_s and true(frame)
            ),
            None,
        )

    def close(self) -> None:
        self._stop = True

    async def _run(self) -> None:
        task = asyncio.create_task(self._link.run_connection())
        seen = -1
        while not task.done() and not self._stop:
            frame = self._link.current_frame
            if frame is not None and frame.seq != seen:
                seen = frame.seq
                self.frames.append((self._link.newest_at_s or time.monotonic(), frame))
            await asyncio.sleep(0.005)
        task.cancel()
        with suppress(WorkerGone, asyncio.CancelledError):
            await task
        self.gone_at_s = time.monotonic()


class Console:
    """The real program with everything of its own under `folder`; `more`: further words of
    `topdress run`."""

    def __init__(self, folder: Path, *more: str, begin_m: float = 30.0) -> None:
        self.folder, self._more = folder, more
        names = {
            "HOME": "home",
            "XDG_RUNTIME_DIR": "run",
            "XDG_DATA_HOME": "data",
            "XDG_STATE_HOME": "state",
            "XDG_CACHE_HOME": "cache",
            "XDG_CONFIG_HOME": "config",
        }
        for name in names.values():
            (folder / name).mkdir(mode=0o700, exist_ok=True)
        kept = {
            k: v
            for k, v in os.environ.items()
            if k not in ("NO_COLOR", "TEXTUAL_THEME", "TEXTUAL", "LANG")
        }
        self.environment = (
            kept
            | {k: str(folder / v) for k, v in names.items()}
            | {"TERM": "xterm-256color", "LC_ALL": "C.UTF-8", "LANGUAGE": "en"}
        )
        self.run_file = folder / "run" / "topdress" / "worker.json"
        self.job = folder / "job.yaml"
        shipped = Path(__file__).parents[1] / "configs" / "jobs" / "demo.yaml"
        job = yaml.safe_load(shipped.read_text(encoding="utf-8"))
        job["simulated"]["begin_m"] = begin_m  # in the field: material flows at once
        self.job.write_text(yaml.safe_dump(job), encoding="utf-8")
        self.terminal = self.open()

    def open(self) -> Terminal:
        program = Path(sys.executable).parent / "topdress"
        return Terminal(
            [str(program), "run", "--config", str(self.job), *self._more], self.environment
        )

    def where(self) -> WorkerAddress:
        found: list[WorkerAddress] = []

        def there() -> bool:
            with suppress(WorkerFailed):
                where = find_running_worker(self.run_file)
                found.extend([where] if where else [])
            return bool(found)

        wait(there, 20.0, "a worker that listens", self.terminal)
        return found[0]

    def end_worker(self) -> None:
        with suppress(WorkerFailed, ProcessLookupError):
            where = find_running_worker(self.run_file)
            if where:
                os.kill(where.pid, signal.SIGTERM)
                wait(lambda: not self.run_file.exists(), 10.0, "the worker's end")


@contextmanager
def console(*more: str) -> Iterator[Console]:
    """A console that shows numbers, in a folder that goes with it."""
    with tempfile.TemporaryDirectory() as folder:
        one = Console(Path(folder), *more)
        try:
            wait(lambda: one.terminal.shows("NDVI 0."), 60.0, "numbers", one.terminal)
            yield one
        finally:
            one.terminal.end()
            one.end_worker()


# times what a quiet machine needs: others may use it, and a start is no measurement
PATIENCE = 10


def wait(
    true: Callable[[], bool],
    most_s: float,
    what: str,
    terminal: Terminal | None = None,
    every_s: float = 0.01,
) -> float:
    """Seconds until it is so. Raises TimeoutError, with the screen, where it is not so in time.

    most_s: on a machine that has nothing else to do. A program that is still at it, by what it
    writes and how long it has had the processor, has PATIENCE times as long; one that has ended
    has no time left.
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
            raise TimeoutError(
                f"{what}: {'it ended' if ended else f'not after {now_s - started_s:.0f} s'}"
                + (f"\n{terminal.text()}" if terminal else "")
            )
        time.sleep(every_s)
    return time.monotonic() - started_s


def took(terminal: Terminal, key: str, seen: Callable[[str], bool], most_s: float = 10.0) -> float:
    """Seconds from the key until the screen is so."""
    terminal.type(key)
    return wait(lambda: seen(terminal.text()), most_s, f"what {key!r} shows", terminal, 0.002)


def state(word: str) -> Callable[[str], bool]:
    return lambda text: word in text.splitlines()[0]


def to_work(terminal: Terminal, most_s: float = 180.0) -> None:
    """Until the screen says that the machine works. Alarms are acknowledged on the way."""
    until_s = time.monotonic() + most_s
    while not state("WORKING")(terminal.text()):
        if time.monotonic() > until_s:
            raise TimeoutError(f"the machine does not come to work:\n{terminal.text()}")
        first = terminal.text().splitlines()[0]
        key = (
            "r"
            if "OFF" in first or "FAULT" in first
            else "s"
            if "READY" in first or "HELD" in first
            else ""
        )
        if key == "s" and not terminal.shows("no alarms"):
            terminal.type("a")
            with suppress(TimeoutError):
                wait(lambda: terminal.shows("no alarms"), 0.3, "no alarms")
        with suppress(TimeoutError):
            took(terminal, key, lambda text, first=first: text.splitlines()[0] != first, 1.5)  # type: ignore[misc]


class Tap(threading.Thread):
    """Between worker and board, byte for byte; `stopped_s`: when the newest drive frame that
    forbids the drives came after one that allowed them."""

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
            with (
                suppress(OSError),
                near,
                socket.create_connection(self._board) as far,
                selectors.DefaultSelector() as chooser,
            ):
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
            if fields[0] not in (b"$T1", b"$T2", b"$T3"):
                continue
            turning = fields[4] == b"1" and float(fields[2]) > 0.0
            if self.turning and not turning:
                self.stopped_s = now_s
            self.turning = turning


@contextmanager
def machine() -> Iterator[dict[str, str]]:
    """The served machine; gives the address of each device."""
    words = (
        "-c",
        "from topdress.console.cli import main; main()",
        "serve-machine",
        "--port",
        "0",
        "--seed",
        "3",
    )
    child = subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True)
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
