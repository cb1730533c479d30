"""Writes the run file, which tells where a worker listens and contains its token, readable by its
own user only; `console.link` reads it.

The file is information. The lock next to it (`NAME.lock`) ensures that one worker runs at a time;
the system releases the lock when the process ends in any way. If somebody removes the lock's file,
the running worker creates and locks it again. A starting worker asks the port of the run file
before it trusts the lock.
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

from topdress.console.worker.limits import LOCK_TIMEOUT_S
from topdress.console.worker.real_time import make_private_folder, write_private_file
from topdress.console.worker_handshake import is_still_running
from topdress.drivers import day_clock
from topdress.drivers.files.process_lock import is_same_file, take_lock

# Period of attempts to take the lock, s.
LOCK_RETRY_PERIOD_S = 0.02
# Period at which the running worker checks both files, s.
REWRITE_PERIOD_S = 0.2
# Time after which a worker whose check collided with another check has checked again, s.
LOCK_SETTLING_S = 2.0 * REWRITE_PERIOD_S
# On a busy computer a worker needs up to this time, s, to lock a file that was created again: ten
# checks.
YOUNG_LOCK_AGE_S = 2.0


class WorkerLock:
    """Holds the right to be the worker of a run file: a lock on whatever file has the lock's
    name."""

    def __init__(
        self, path: Path, lock: io.FileIO, new: bool, sleep: Callable[[float], None]
    ) -> None:
        self.path = path
        self._lock, self._new, self._sleep = lock, new, sleep
        self._taken_s = time.monotonic()
        self._refused = False

    def renew_lock(self) -> None:
        """Lock the file again if it was removed; the lock on the old file is kept until then.
        Raises OSError."""
        if is_same_file(self._lock, self.path.with_suffix(".lock")):
            return
        make_private_folder(self.path.parent)
        lock = take_lock(self.path.with_suffix(".lock"))
        # Otherwise somebody is checking at this moment whether a worker runs; the next call tries
        # again.
        if lock is not None:
            self._lock.close()
            self._lock = lock

    def confirm_right(self) -> None:
        """Confirm, before this worker publishes its address, that no other worker has published
        one.

        A new lock file may replace one that was removed under a running worker. That worker writes
        its run file again within `REWRITE_PERIOD_S`, so this function waits for that time. Raises
        BlockingIOError in one line, or OSError.
        """
        if self._new:
            self._sleep(max(0.0, self._taken_s + LOCK_SETTLING_S - time.monotonic()))
        # True until it is known that the run file belongs to no other worker.
        self._refused = True
        _refuse_second_worker(self.path)
        self._refused = False

    def give_back_right(self) -> None:
        """Remove the run file, unless it belongs to another worker, and release the lock."""
        if not self._refused:
            _remove_run_file(self.path)
        self.release_lock()

    def release_lock(self) -> None:
        """Release the lock only, because the run file belongs to another worker."""
        self._lock.close()


@contextlib.contextmanager
def hold_right(
    path: Path,
    epoch_s: Callable[[], float] = day_clock.read_epoch_s,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[WorkerLock]:
    """Hold the right to be the worker of this run file until the end of the block. The file of a
    worker that died is removed.

    Parameters
    ----------
    path
        Path of the run file.
    epoch_s
        Returns the computer's time, s since 1970.
    sleep
        Waits a number of seconds.

    Raises
    ------
    BlockingIOError
        Another worker has the right; one line.
    OSError
        The files cannot be written.
    """
    make_private_folder(path.parent)
    missing = not path.with_suffix(".lock").exists()
    lock = _wait_for_lock(path)
    right = WorkerLock(path, lock, missing or _is_lock_young(lock, epoch_s()), sleep)
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
    """Writes the run file and keeps it intact: a file that somebody removed or damaged is written
    again within `REWRITE_PERIOD_S` by a thread, which also maintains the lock's file."""

    def __init__(self, right: WorkerLock, port: int, token: str, log_path: str) -> None:
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
        """Maintain both files until the end; the thread runs this method."""
        while not self._closing.wait(REWRITE_PERIOD_S):
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
            self.join(LOCK_TIMEOUT_S)

    def _is_file_intact(self) -> bool:
        """Return whether the file still has the content of this worker."""
        try:
            with open(self._path, "rb") as file:
                # One byte more than expected reveals a longer file.
                return file.read(len(self._said) + 1) == self._said
        except FileNotFoundError:
            return False


def _wait_for_lock(path: Path) -> io.FileIO:
    """Return the lock once it is free. A console that checks for a worker holds it for a moment, a
    worker that ends somewhat longer."""
    until_s = time.monotonic() + LOCK_TIMEOUT_S
    while (lock := take_lock(path.with_suffix(".lock"))) is None:
        if time.monotonic() > until_s:
            raise BlockingIOError(
                f"a machine runs already on this computer{_describe_holder(path)}"
            )
        time.sleep(LOCK_RETRY_PERIOD_S)
    return lock


def _is_lock_young(lock: io.FileIO, now_s: float) -> bool:
    """Return whether a worker whose lock file was removed may not have locked this file yet,
    because a console's check has created it again. A file from the future, by the computer's clock,
    counts as young."""
    return now_s - os.fstat(lock.fileno()).st_ctime < YOUNG_LOCK_AGE_S


def _refuse_second_worker(path: Path) -> None:
    """Raise BlockingIOError if the worker of the run file still listens, whatever the state of its
    lock."""
    if is_still_running(path):
        raise BlockingIOError(f"a machine runs already on this computer{_describe_holder(path)}")


def _describe_holder(path: Path) -> str:
    """Return the process id of the worker in words, or ""."""
    try:
        return f" (program {json.loads(path.read_bytes())['pid']})"
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def _remove_run_file(path: Path) -> None:
    """Remove the run file; a failure is ignored, because the next worker replaces the file."""
    with contextlib.suppress(OSError):
        path.unlink()
