"""Files that are either whole or not there: write beside the place, then rename; never take a name that is taken."""
from __future__ import annotations

import contextlib
import io
import os
import tempfile
from pathlib import Path
from typing import Protocol


def write_atomically(path: Path, content: str | bytes) -> None:
    """Replaces `path` by `content` (text as UTF-8) in one step: after a power loss the old or the new file is there.

    Raises OSError where the folder cannot be written; the old file is then untouched.
    """
    data = content.encode() if isinstance(content, str) else content
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        _allow_what_the_umask_allows(name)
        os.replace(name, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise
    _sync_folder(path.parent)


class LogFile(Protocol):
    """What a log writer needs of a file: appending bytes, and knowing that they are kept."""

    path: Path

    def write(self, data: bytearray) -> int:
        """Bytes taken, perhaps fewer than given. Raises OSError."""

    def sync(self) -> None:
        """Returns when everything written survives a power loss. Raises OSError, also where the file was deleted."""

    def close(self) -> None: ...


class NewFile:
    """A file of its own, unbuffered: `LogFile` on a disk."""

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        """Creates `path`. Raises FileExistsError where it is there already (unless `overwrite`), else OSError."""
        self.path = path
        self._file = io.FileIO(path, "w" if overwrite else "x")

    def write(self, data: bytearray) -> int:
        return self._file.write(data) or 0

    def sync(self) -> None:
        os.fsync(self._file.fileno())
        if os.fstat(self._file.fileno()).st_nlink == 0:
            raise OSError("the file was deleted while it was being written")

    def close(self) -> None:
        self._file.close()


def create(path: Path, overwrite: bool = False) -> NewFile:
    """A new file at `path`, or at NAME-2, NAME-3, ... where that name or its sidecar NAME.yaml is taken.

    With `overwrite` the file itself. Missing folders are made. Raises OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if overwrite:
        return NewFile(path, overwrite=True)
    number = 1
    while True:
        place = path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")
        number += 1
        if sidecar(place).exists():
            continue
        try:
            return NewFile(place)
        except FileExistsError:
            continue


def sidecar(log: Path) -> Path:
    """Where the description of a run log stands: NAME.yaml beside NAME.csv."""
    return log.with_suffix(".yaml")


def _allow_what_the_umask_allows(name: str) -> None:
    umask = os.umask(0)
    os.umask(umask)
    os.chmod(name, 0o666 & ~umask)


def _sync_folder(folder: Path) -> None:
    """Makes a rename durable; systems that cannot open a folder do so by themselves."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:
        pass
    finally:
        os.close(handle)
