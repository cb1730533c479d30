"""The run file says where a worker listens and what opens it, for its own user only; `console.link` reads it.

It is information. That one worker runs at a time is kept by the lock beside it (`NAME.lock`), which the system gives
back when the process ends, however it ends.
"""
from __future__ import annotations

import contextlib
import io
import json
import os
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from console.worker.limits import LOCK_S
from console.worker.system import private_folder, write_private
from drivers.files.lock import take_lock

AGAIN_S = 0.02
MENDED_S = 0.2


@contextlib.contextmanager
def held(path: Path) -> Iterator[None]:
    """The right to be the worker of this run file, until the end of the block; a file left by one that died is removed.

    Raises BlockingIOError in one line where another worker has that right, OSError.
    """
    private_folder(path.parent)
    lock = _lock(path)
    try:
        path.unlink(missing_ok=True)
        yield
    finally:
        _remove(path)
        lock.close()


class RunFile(threading.Thread):
    """Says where this process listens, while the lock is `held`, and goes on saying it: a file that somebody removed or
    damaged is written again within `MENDED_S`, by a thread of its own."""

    def __init__(self, path: Path, port: int, token: str, log_path: str) -> None:
        super().__init__(name="run file", daemon=True)
        started = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        say = {"port": port, "token": token, "pid": os.getpid(), "parent": os.getppid(), "started": started,
               "log_path": log_path}
        self._path, self._said = path, json.dumps(say).encode() + b"\n"
        self._closing = threading.Event()

    def write(self) -> None:
        """Raises OSError."""
        write_private(self._path, self._said)

    def run(self) -> None:
        while not self._closing.wait(MENDED_S):
            with contextlib.suppress(OSError):
                if not self._stands():
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
    """A console that looks whether a worker runs has the lock for a moment, one that ends a little longer."""
    until_s = time.monotonic() + LOCK_S
    while (lock := take_lock(path.with_suffix(".lock"))) is None:
        if time.monotonic() > until_s:
            raise BlockingIOError(f"a control worker runs already{_holder(path)}")
        time.sleep(AGAIN_S)
    return lock


def _holder(path: Path) -> str:
    try:
        return f" (process {json.loads(path.read_bytes())['pid']})"
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()
