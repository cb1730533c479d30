"""How does a single process hold a lock? The system releases the lock when the process ends, in
whatever way.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from pathlib import Path

if sys.platform == "win32":
    import msvcrt

    def _take(handle: int) -> None:
        """Locks an open file on Windows. Raises OSError if another process holds the lock."""
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _take(handle: int) -> None:
        """Locks an open file on POSIX systems. Raises OSError if another process holds the lock."""
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def take_lock(path: Path, take: Callable[[int], None] = _take) -> io.FileIO | None:
    """Locks a file.

    The file is created where needed and never removed, because another process may be about to lock
    it. If a third program removes it, the locked file is no longer the file of that name;
    `is_same_file` shows this.

    Parameters
    ----------
    path : the file.
    take : locks an open handle or raises OSError.

    Returns
    -------
    the open file that holds the lock until it is closed; None if another process holds the lock.

    Raises
    ------
    OSError : the folder does not exist, or its disk does not support locks.
    """
    while True:
        lock = _open_and_lock(path, take)
        if lock is None or is_same_file(lock, path):
            return lock
        # The file was removed between its opening and its locking.
        lock.close()


def is_same_file(lock: io.FileIO, path: Path) -> bool:
    """Returns whether the lock is on the file that has this name now."""
    ours = os.fstat(lock.fileno())
    try:
        there = os.stat(path)
    except FileNotFoundError:
        return False
    return (ours.st_dev, ours.st_ino) == (there.st_dev, there.st_ino)


def _open_and_lock(path: Path, take: Callable[[int], None]) -> io.FileIO | None:
    """Returns the locked file; None if another process holds the lock."""
    file = io.FileIO(os.open(path, os.O_RDWR | os.O_CREAT, 0o600), "r+")
    try:
        take(file.fileno())
    # POSIX and Windows raise these errors for a lock of another process.
    except (BlockingIOError, PermissionError):
        file.close()
        return None
    except OSError:
        file.close()
        raise
    return file
