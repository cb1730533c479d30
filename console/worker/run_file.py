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
from topdress.console.worker.system import make_private_folder, write_private_file
from topdress.console.worker_handshake import is_still_running
from topdress.drivers import day_clock
from topdress.drivers.files.lock import is_same_file, take_lock

RETRY_S = 0.02
REWRITE_S = 0.2
# a worker whose look at the lock met somebody else's has looked once more
SETTLED_S = 2.0 * REWRITE_S
# on a busy computer a worker takes as long to lock a file made anew: ten of its looks
YOUNG_S = 2.0


class WorkerRight:
    """Holds the right to be the worker of a run file: its lock, on whatever file has the lock's
    name."""

    def __init__(
        self, path: Path, lock: io.FileIO, new: bool, sleep: Callable[[float], None]
    ) -> None:
        self.path = path
        self._lock, self._new, self._sleep = lock, new, sleep
        self._taken_s = time.monotonic()
        self._refused = False

    def renew_lock(self) -> None:
        """Lock the file anew where it was removed; the lock on the old one is kept until then.
        Raises OSError."""
        if is_same_file(self._lock, self.path.with_suffix(".lock")):
            return
        make_private_folder(self.path.parent)
        lock = take_lock(self.path.with_suffix(".lock"))
        # else somebody looks just now whether a worker runs: tried again
        if lock is not None:
            self._lock.close()
            self._lock = lock

    def confirm_right(self) -> None:
        """Make sure, before this worker says where it listens, that no other says so of itself.

        A new lock file may have replaced one that was removed under a running worker, which says
        again within `REWRITE_S` where it listens: that time is waited for. Raises BlockingIOError
        in one line, OSError.
        """
        if self._new:
            self._sleep(max(0.0, self._taken_s + SETTLED_S - time.monotonic()))
        # until it is known that the run file is nobody else's
        self._refused = True
        _refuse_second_worker(self.path)
        self._refused = False

    def give_back_right(self) -> None:
        """Remove the run file, unless it is another worker's, and release the lock."""
        if not self._refused:
            _remove_run_file(self.path)
        self.release_lock()

    def release_lock(self) -> None:
        """Release the lock alone: the run file is another worker's."""
        self._lock.close()


@contextlib.contextmanager
def hold_right(
    path: Path,
    epoch_s: Callable[[], float] = day_clock.read_epoch_s,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[WorkerRight]:
    """Hold the right to be the worker of this run file until the end of the block; a file left by a
    worker that died is removed.

    Raises BlockingIOError in one line where another worker has that right, OSError.
    """
    make_private_folder(path.parent)
    missing = not path.with_suffix(".lock").exists()
    lock = _wait_for_lock(path)
    right = WorkerRight(path, lock, missing or _is_lock_young(lock, epoch_s()), sleep)
    try:
        _refuse_second_worker(path)
    except BlockingIOError:
        right.release_lock()
        raise
    try:
        path.unlink(missing_ok=True)
        yield right
    finally:
        right.give_back_right()


class RunFileWriter(threading.Thread):
    """Writes where this process listens, and keeps it written: a file that somebody removed or
    damaged is written again within `REWRITE_S`, by a thread of its own, and the lock's file is
    looked after."""

    def __init__(self, right: WorkerRight, port: int, token: str, log_path: str) -> None:
        super().__init__(name="run file", daemon=True)
        started = day_clock.read_utc_now().isoformat(timespec="milliseconds").replace("+00:00", "Z")
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

    def write_run_file(self) -> None:
        """Write the file for its owner only. Raises OSError."""
        write_private_file(self._path, self._said)

    def run(self) -> None:
        while not self._closing.wait(REWRITE_S):
            with contextlib.suppress(OSError):
                self._right.renew_lock()
            with contextlib.suppress(OSError):
                if not self._is_file_intact():
                    make_private_folder(self._path.parent)
                    self.write_run_file()

    def stop_writing(self) -> None:
        """End the thread."""
        self._closing.set()
        if self.is_alive():
            self.join(LOCK_S)

    def _is_file_intact(self) -> bool:
        try:
            with open(self._path, "rb") as file:
                return file.read(len(self._said) + 1) == self._said
        except FileNotFoundError:
            return False


def _wait_for_lock(path: Path) -> io.FileIO:
    """The lock, once it is free. A console that checks whether a worker runs has it for a moment, a
    worker that ends a little longer."""
    until_s = time.monotonic() + LOCK_S
    while (lock := take_lock(path.with_suffix(".lock"))) is None:
        if time.monotonic() > until_s:
            raise BlockingIOError(
                f"a machine runs already on this computer{_describe_holder(path)}"
            )
        time.sleep(RETRY_S)
    return lock


def _is_lock_young(lock: io.FileIO, now_s: float) -> bool:
    """Whether a worker under which the lock's file was removed may not have locked this one yet: a
    console that looked makes it anew. A file of the future, by the computer's clock, is young."""
    return now_s - os.fstat(lock.fileno()).st_ctime < YOUNG_S


def _refuse_second_worker(path: Path) -> None:
    """Raises BlockingIOError where the worker that the run file names still listens, whatever
    became of its lock."""
    if is_still_running(path):
        raise BlockingIOError(f"a machine runs already on this computer{_describe_holder(path)}")


def _describe_holder(path: Path) -> str:
    try:
        return f" (program {json.loads(path.read_bytes())['pid']})"
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def _remove_run_file(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()
