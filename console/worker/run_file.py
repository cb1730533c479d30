"""The run file says where a worker listens and what opens it, for its own user only;
`console.link` reads it.

It is information. That one worker runs at a time is kept by the lock next to it (`NAME.lock`),
which the system gives back when the process ends, however it ends. Somebody may remove the
lock's file: then the worker that runs makes and locks it anew, and one that starts asks the
port of the run file before it believes the lock.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from topdress.console.worker.limits import LOCK_S
from topdress.console.worker.system import private_folder, write_private
from topdress.console.worker_handshake import is_still_running
from topdress.drivers import day_clock
from topdress.drivers.files.lock import stands, take_lock

AGAIN_S = 0.02
MENDED_S = 0.2
# a worker whose look at the lock met somebody else's has looked once more
SETTLED_S = 2.0 * MENDED_S
# on a busy computer a worker takes as long to lock a file made anew: ten of its looks
YOUNG_S = 2.0


class Right:
    """The right to be the worker of a run file: its lock, on whatever file has the lock's name."""

    def __init__(
        self, path: Path, lock: io.FileIO, new: bool, sleep: Callable[[float], None]
    ) -> None:
        self.path = path
        self._lock, self._new, self._sleep = lock, new, sleep
        self._taken_s = time.monotonic()
        self._refused = False

    def keep(self) -> None:
        """Lock the file anew where it was removed; the lock on the old one is kept until then.
        Raises OSError."""
        if stands(self._lock, self.path.with_suffix(".lock")):
            return
        private_folder(self.path.parent)
        lock = take_lock(self.path.with_suffix(".lock"))
        # else somebody looks just now whether a worker runs: tried again
        if lock is not None:
            self._lock.close()
            self._lock = lock

    def confirm(self) -> None:
        """Before this worker says where it listens: no other says so of itself. A lock's file
        that is new may have been removed under a worker, which says again within `MENDED_S`
        where it listens: it is waited for.

        Raises BlockingIOError in one line, OSError.
        """
        if self._new:
            self._sleep(max(0.0, self._taken_s + SETTLED_S - time.monotonic()))
        # until it is known that the run file is nobody else's
        self._refused = True
        _refuse_second(self.path)
        self._refused = False

    def give_back(self) -> None:
        if not self._refused:
            _remove(self.path)
        self.let_go()

    def let_go(self) -> None:
        """The lock alone: the run file is another worker's."""
        self._lock.close()


@contextlib.contextmanager
def held(
    path: Path,
    epoch_s: Callable[[], float] = day_clock.epoch_s,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[Right]:
    """The right to be the worker of this run file, until the end of the block; a file left by
    one that died is removed.

    Raises BlockingIOError in one line where another worker has that right, OSError.
    """
    private_folder(path.parent)
    missing = not path.with_suffix(".lock").exists()
    lock = _lock(path)
    right = Right(path, lock, missing or _young(lock, epoch_s()), sleep)
    try:
        _refuse_second(path)
    except BlockingIOError:
        right.let_go()
        raise
    try:
        path.unlink(missing_ok=True)
        yield right
    finally:
        right.give_back()


class RunFile(threading.Thread):
    """Says where this process listens, while the lock is `held`, and goes on saying it: a file
    that somebody removed or damaged is written again within `MENDED_S`, by a thread of its own,
    and the lock's file is looked after."""

    def __init__(self, right: Right, port: int, token: str, log_path: str) -> None:
        super().__init__(name="run file", daemon=True)
        started = day_clock.utc_now().isoformat(timespec="milliseconds").replace("+00:00", "Z")
        say = {
            "port": port,
            "token": token,
            "pid": os.getpid(),
            "parent": os.getppid(),
            "started": started,
            "log_path": log_path,
        }
        self._right = right
        self._path, self._said = right.path, json.dumps(say).encode() + b"\n"
        self._closing = threading.Event()

    def write(self) -> None:
        """Raises OSError."""
        write_private(self._path, self._said)

    def run(self) -> None:
        while not self._closing.wait(MENDED_S):
            with contextlib.suppress(OSError):
                self._right.keep()
            with contextlib.suppress(OSError):
                if not self._stands():
                    private_folder(self._path.parent)
                    self.write()

    def close(self) -> None:
        self._closing.set()
        if self.is_alive():
            self.join(LOCK_S)

    def _stands(self) -> bool:
        try:
            with open(self._path, "rb") as file:
                return file.read(len(self._said) + 1) == self._said
        except FileNotFoundError:
            return False


def _lock(path: Path) -> io.FileIO:
    """A console that looks whether a worker runs has the lock for a moment, one that ends a
    little longer."""
    until_s = time.monotonic() + LOCK_S
    while (lock := take_lock(path.with_suffix(".lock"))) is None:
        if time.monotonic() > until_s:
            raise BlockingIOError(f"a machine runs already on this computer{_holder(path)}")
        time.sleep(AGAIN_S)
    return lock


def _young(lock: io.FileIO, now_s: float) -> bool:
    """Whether a worker under which the lock's file was removed may not have locked this one
    yet: a console that looked makes it anew. A file of the future, as the computer's clock has
    it, is young."""
    return now_s - os.fstat(lock.fileno()).st_ctime < YOUNG_S


def _refuse_second(path: Path) -> None:
    """Raises BlockingIOError where the worker that the run file names still listens, whatever
    became of its lock."""
    if is_still_running(path):
        raise BlockingIOError(f"a machine runs already on this computer{_holder(path)}")


def _holder(path: Path) -> str:
    try:
        return f" (program {json.loads(path.read_bytes())['pid']})"
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()
