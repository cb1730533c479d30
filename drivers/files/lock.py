"""A lock that one process holds: the system gives it back when that process ends, however it
ends."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from pathlib import Path

if sys.platform == "win32":
    import msvcrt

    def _take(handle: int) -> None:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _take(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def take_lock(path: Path, take: Callable[[int], None] = _take) -> io.FileIO | None:
    """The open file that holds the lock until it is closed; None where somebody else holds it.

    The file is made where needed and never removed: another process may be about to lock it.
    Where somebody else removes it, what is locked then is not the file of that name any more:
    `stands` says so. Raises OSError where the folder is not there or its disk knows no locks.
    """
    while True:
        lock = _taken(path, take)
        if lock is None or stands(lock, path):
            return lock
        lock.close()  # removed between its opening and its locking


def stands(lock: io.FileIO, path: Path) -> bool:
    """Whether the lock is on the file that has this name now."""
    ours = os.fstat(lock.fileno())
    try:
        there = os.stat(path)
    except FileNotFoundError:
        return False
    return (ours.st_dev, ours.st_ino) == (there.st_dev, there.st_ino)


def _taken(path: Path, take: Callable[[int], None]) -> io.FileIO | None:
    file = io.FileIO(os.open(path, os.O_RDWR | os.O_CREAT, 0o600), "r+")
    try:
        take(file.fileno())
    except (BlockingIOError, PermissionError):  # POSIX, Windows: held
        file.close()
        return None
    except OSError:
        file.close()
        raise
    return file
