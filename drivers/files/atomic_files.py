"""How are files written completely or not at all? They are written under a temporary name in the
same folder and then renamed. An existing name is never overwritten by a new log.
"""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from pathlib import Path


def write_atomically(path: Path, content: str | bytes, kept: bool = True) -> None:
    """Replaces a file in one step: after a power loss either the old or the new file exists.

    Parameters
    ----------
    path : the file.
    content : bytes, or text that is written as UTF-8.
    kept : whether the function returns only when the disk has the file; otherwise `sync_to_disk`
    must follow.

    Raises
    ------
    OSError : the folder cannot be written; the old file is then unchanged.
    """
    data = content.encode() if isinstance(content, str) else content
    # The temporary file is in the same folder, because a rename between disks is not atomic.
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            # Python's buffer must be empty before the system writes its own to the disk.
            file.flush()
            if kept:
                os.fsync(file.fileno())
        # mkstemp creates files that only their owner can read.
        os.chmod(name, 0o666 & ~_FILE_UMASK)
        os.replace(name, path)
    # A cancelled write must leave no temporary file behind.
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise
    # The rename itself is durable only after the folder is written.
    if kept:
        _sync_folder(path.parent)


def sync_to_disk(path: Path) -> None:
    """Returns when a written file, and its name, would survive a power loss. Raises OSError."""
    with open(path, "r+b") as file:
        os.fsync(file.fileno())
    _sync_folder(path.parent)


# Number of bytes that are searched for the last whole line: twice the longest row.
MAX_LINE_BYTES = 65_536


class CutShortError(OSError):
    """Reports that another program removed bytes that were written. `left` is the number of
    remaining bytes."""

    def __init__(self, left: int) -> None:
        super().__init__("the file was cut short by another program")
        self.left = left


class NewFile:
    """Appends bytes to a file of its own without a buffer, as a log writer needs it, and reports
    when the disk has them."""

    def __init__(self, path: Path, overwrite: bool = False, go_on_at: int | None = None) -> None:
        """Creates `path`, or continues the existing file.

        Parameters
        ----------
        overwrite : whether an existing file may be replaced.
        go_on_at : number of bytes of the existing file after which writing continues, or after the
        last whole line before.

        Raises
        ------
        FileExistsError : the file exists and `overwrite` is False.
        OSError : the file cannot be created.
        """
        self.path = path
        self._file = io.FileIO(path, ("w+" if overwrite else "x+") if go_on_at is None else "r+")
        if go_on_at is not None:
            # The file may be shorter than recorded after a power loss.
            end = min(go_on_at, os.fstat(self._file.fileno()).st_size)
            begin = self._file.seek(max(0, end - MAX_LINE_BYTES))
            # The last line may be incomplete, so writing continues after the last whole line.
            self._file.truncate(begin + (self._file.read(end - begin) or b"").rfind(b"\n") + 1)
            self._file.seek(0, os.SEEK_END)

    def write(self, data: bytearray) -> int:
        """Returns the number of bytes written, perhaps fewer than given. Raises CutShortError where
        they would follow a hole, OSError."""
        left = os.fstat(self._file.fileno()).st_size
        # Writing after a removed part would leave zero bytes in the middle of the log.
        if left < self._file.tell():
            raise CutShortError(left)
        return self._file.write(data) or 0

    def sync(self) -> None:
        """Returns when everything written would survive a power loss. Raises OSError, also where
        the file was deleted."""
        os.fsync(self._file.fileno())
        # A deleted file still accepts bytes, which nobody could read.
        if not self.is_in_place:
            raise OSError("the file was deleted, or is no longer where it was started")

    @property
    def is_in_place(self) -> bool:
        """Returns whether the file at `path` is still this file: not deleted, not moved, and not on
        a disk that was removed and returned."""
        try:
            # Device and inode identify the file, even if another file has taken its name.
            return os.path.samestat(os.fstat(self._file.fileno()), os.stat(self.path))
        except OSError:
            return False

    def all(self) -> bytes:
        """Returns everything written, also of a file that was deleted meanwhile. Raises OSError."""
        self._file.seek(0)
        return self._file.readall()

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


def create_new_file(path: Path, overwrite: bool = False) -> NewFile:
    """Creates a file at `path`, or at NAME-2, NAME-3, ... where that name or its sidecar NAME.yaml
    exists; with `overwrite` at `path` itself. Missing folders are created. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if overwrite:
        return NewFile(path, overwrite=True)
    number = 1
    while True:
        place = path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")
        number += 1
        # A sidecar without its log reserves the name, because it would describe a new log wrongly.
        if find_sidecar(place).exists():
            continue
        try:
            return NewFile(place)
        # Another process may have created the file between the test and the creation.
        except FileExistsError:
            continue


def find_sidecar(log: Path) -> Path:
    """Returns the path of a run log's description: NAME.yaml next to NAME.csv."""
    return log.with_suffix(".yaml")


def _read_umask() -> int:
    """Returns the process's umask. The umask can only be read by setting it, for all threads; a
    file that another thread creates at that moment is private."""
    umask = os.umask(0o077)
    os.umask(umask)
    return umask


# The umask is read at import, before threads exist.
_FILE_UMASK = _read_umask()


def _sync_folder(folder: Path) -> None:
    """Makes a rename durable; systems that cannot open a folder make it durable by themselves."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    # Network disks refuse to sync a folder.
    except OSError:
        pass
    finally:
        os.close(handle)


def find_free_path(folder: Path, stem: str, *endings: str) -> Path:
    """Returns a path with the first ending, whose name is free with every ending."""
    name, number = stem, 2
    while any((folder / f"{name}{ending}").exists() for ending in endings):
        name, number = f"{stem}-{number}", number + 1
    return folder / f"{name}{endings[0]}"
