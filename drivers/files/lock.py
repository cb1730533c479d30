"""How does a single process hold a lock that the system returns when the process ends, however
it ends?"""

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
    """Takes the lock of a file.

    The file is made where needed and never removed: another process may be about to lock it. If
    somebody else removes it, the locked file is no longer the file of that name: `stands` shows it.

    Parameters
    ----------
    path : the file.
    take : locks an open handle or raises OSError.

    Returns
    -------
    the open file that holds the lock until it is closed; None where somebody else holds it.

    Raises
    ------
    OSError : the folder is not there, or its disk knows no locks.
    """
    while True:
        lock = _open_and_lock(path, take)
        if lock is None or is_same_file(lock, path):
            return lock
        lock.close()  # removed between its opening and its locking


def is_same_file(lock: io.FileIO, path: Path) -> bool:
    """Tells whether the lock is on the file that has this name now."""
    ours = os.fstat(lock.fileno())
    try:
        there = os.stat(path)
    except FileNotFoundError:
        return False
    return (ours.st_dev, ours.st_ino) == (there.st_dev, there.st_ino)


# Returns the locked file; None where somebody else holds the lock.
def _open_and_lock(path: Path, take: Callable[[int], None]) -> io.FileIO | None:
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
