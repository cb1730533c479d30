"""What can a disk do? A call fails or writes a part, the disk is full, read-only or hangs, another
program cuts the log, and a power cut loses what was not synced."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import random
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from topdress.drivers.files import atomic_files


class PowerCut(BaseException):
    """Ends the worker without any of its own cleanup."""


class FaultyDisk:
    """Counts every call of the log and of the snapshots, and lets some of them fail.

    `clock` returns the computer's UTC as seconds since 1970, which files get as their time.
    """

    def __init__(self, folder: Path, seed: int, clock: Any) -> None:
        self._folder = folder
        self._random = random.Random(seed)
        self._clock = clock
        self.calls = 0
        # Errors of the calls by their number, and an error of every call.
        self.fails_at: dict[int, int] = {}
        self.tears_at: set[int] = set()
        self.cuts_at = 0
        self.broken_errno = 0
        self._names = 0
        # Path of each file, and its bytes that a power cut keeps, by device and inode.
        self._files: dict[tuple[int, int], tuple[str, int]] = {}
        self.is_struck = False

    @contextlib.contextmanager
    def installed(self) -> Iterator[None]:
        """Replaces the system's calls in `drivers.files.atomic_files` by those of this disk."""
        before = atomic_files.os, atomic_files.io, atomic_files.tempfile
        system = SimpleNamespace(**{name: getattr(os, name) for name in dir(os)})
        system.fsync, system.replace = self._sync, self._replace
        atomic_files.os = system  # type: ignore[assignment]
        disk = self

        class File(io.FileIO):
            def __init__(self, path: Path, mode: str) -> None:
                disk.call("open")
                super().__init__(path, mode)
                disk._note_file(self.fileno(), str(path), 0)

            def write(self, data: Any) -> int:
                part = disk.call("write")
                if part:
                    data = bytes(data)[: max(1, len(data) // 3)]
                return super().write(data)

        atomic_files.io = SimpleNamespace(FileIO=File, SEEK_END=io.SEEK_END)  # type: ignore[assignment]
        io_tempfile = SimpleNamespace(mkstemp=self._make_temporary)
        atomic_files.tempfile = io_tempfile  # type: ignore[assignment]
        try:
            yield
        finally:
            atomic_files.os, atomic_files.io, atomic_files.tempfile = before

    def call(self, _kind: str) -> bool:
        """Counts a call: raises the error of its number; returns whether it writes a part only."""
        self.calls += 1
        if self.calls == self.cuts_at:
            raise PowerCut
        number = self.broken_errno or self.fails_at.pop(self.calls, 0)
        if number:
            self.is_struck = True
            raise OSError(number, os.strerror(number))
        if self.calls in self.tears_at:
            self.is_struck = True
            return True
        return False

    def fail_later(self, kind: str, calls: int) -> None:
        """Lets the call after `calls` others fail, or write a part."""
        if kind == "fails":
            self.fails_at[self.calls + calls] = errno.EIO
        else:
            self.tears_at.add(self.calls + calls)

    def lose_unsynced(self) -> None:
        """Does what a power cut does: bytes after the last sync are lost, perhaps all of them."""
        for name, synced in sorted(self._files.values()):
            path = Path(name)
            if path.is_file() and (size := path.stat().st_size) > synced:
                changed_s = path.stat().st_mtime
                os.truncate(path, self._random.randrange(synced, size + 1))
                os.utime(path, (changed_s, changed_s))
        self._files.clear()
        self.cuts_at = 0

    def _make_temporary(self, prefix: str, suffix: str, dir: Path) -> tuple[int, str]:
        self.call("open")
        self._names += 1
        name = str(Path(dir) / f"{prefix}{self._names}{suffix}")
        handle = os.open(name, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o600)
        self._note_file(handle, name, 0)
        return handle, name

    def _note_file(self, handle: int, name: str, synced: int) -> None:
        state = os.fstat(handle)
        self._files[state.st_dev, state.st_ino] = name, synced

    def _sync(self, handle: int) -> None:
        self.call("sync")
        state = os.fstat(handle)
        known = self._files.get((state.st_dev, state.st_ino))
        if known is not None:
            self._note_file(handle, known[0], state.st_size)

    def _replace(self, source: str, target: Path) -> None:
        self.call("replace")
        os.replace(source, target)
        state = os.stat(target)
        known = self._files.get((state.st_dev, state.st_ino))
        # The file that had this name is gone.
        self._files = {key: one for key, one in self._files.items() if one[0] != str(target)}
        if known is not None:
            self._files[state.st_dev, state.st_ino] = str(target), known[1]
        now_s = self._clock()
        with contextlib.suppress(OSError, OverflowError):
            os.utime(target, (now_s, now_s))
