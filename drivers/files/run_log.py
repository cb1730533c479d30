"""How are run logs (docs/format-run-log.md) written? Live work uses a thread of its own, simulation
writes directly.

A log never contains a partial row in its middle: bytes that the disk did not accept are kept and
tried again.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Self

from topdress.control.log_row import LogRow
from topdress.drivers.files.atomic_files import (
    CutShortError,
    NewFile,
    create_new_file,
    find_sidecar,
    sync_to_disk,
    write_atomically,
)
from topdress.drivers.files.log_text import RowText, find_log_columns, format_header
from topdress.drivers.files.run_meta import RunMeta, format_meta_yaml

# Longest time until rows reach the operating system, s. A kill of the worker loses the rows of this
# time.
FLUSH_PERIOD_S = 0.1
# Usual time until rows reach the disk itself, s.
SYNC_PERIOD_S = 1.0
# Rows wait in memory while a disk is slow; a longer wait is reported, s.
SLOW_DISK_S = 20.0
# Largest number of waiting rows: an hour at 20 Hz. Later rows are dropped and counted.
MAX_WAITING_ROWS = 72_000
# Number of bytes that a simulation collects before it writes.
_BLOCK_BYTES = 1 << 20

FileCreator = Callable[[Path, bool], NewFile]


def begin_log(
    path: Path,
    meta: RunMeta,
    overwrite: bool = False,
    create: FileCreator = create_new_file,
    kept: bool = True,
) -> NewFile:
    """Creates a log with its sidecar and its header.

    An existing log or sidecar is not changed; the new log gets NAME-2, NAME-3, ..., unless
    `overwrite`.

    Parameters
    ----------
    path : requested path of the log.
    meta : the sidecar's contents.
    overwrite : whether an existing log is replaced.
    create : creates the file; tests replace it.
    kept : whether the function returns only when the log is on the disk, which may take a second.

    Returns
    -------
    the open file.

    Raises
    ------
    OSError : the files cannot be created.
    """
    file = create(path, overwrite)
    try:
        # The sidecar comes before the header, so that no log is without one.
        write_atomically(find_sidecar(file.path), format_meta_yaml(meta), kept)
        _write_all_bytes(file, bytearray(_encode_header(meta)))
        if kept:
            file.sync()
    except BaseException:
        file.close()
        # A failed start must not leave an empty log behind.
        for path in (file.path, find_sidecar(file.path)):
            path.unlink(missing_ok=True)
        raise
    return file


class PlainLogWriter:
    """Writes a log in the caller's thread, for simulation and conversion. The writer is a context
    manager."""

    def __init__(self, path: Path, meta: RunMeta, overwrite: bool = False) -> None:
        """Creates the log. Raises OSError."""
        self._text = RowText(find_log_columns(meta.machine))
        self._waiting = bytearray()
        self._file = begin_log(Path(path), meta, overwrite)

    @property
    def path(self) -> Path:
        """Path of the log."""
        return self._file.path

    def append(self, row: LogRow) -> None:
        """Appends a row. Raises OSError."""
        self._waiting += self._text.line(row).encode(errors="replace")
        # Few large writes are faster than many small writes.
        if len(self._waiting) >= _BLOCK_BYTES:
            _write_all_bytes(self._file, self._waiting)

    def close(self) -> None:
        """Writes the remaining rows and closes the log. Raises OSError."""
        try:
            _write_all_bytes(self._file, self._waiting)
            self._file.sync()
        finally:
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def write_whole_log(
    path: Path, meta: RunMeta, rows: Iterable[LogRow], overwrite: bool = False
) -> Path:
    """Writes a whole log at once; returns its path. Raises OSError."""
    with PlainLogWriter(path, meta, overwrite) as writer:
        for row in rows:
            writer.append(row)
    return writer.path


class RunLogWriter:
    """Writes the log of a live run. `append` only queues a row; a thread formats, writes and syncs.

    A full disk, a removed card or a read-only folder never raises: `ok` and `trouble` show the
    fault, the rows wait, and are written as soon as possible.
    """

    def __init__(
        self,
        path: Path,
        meta: RunMeta,
        *,
        overwrite: bool = False,
        clock: Callable[[], float] = time.monotonic,
        create: FileCreator = create_new_file,
        flush_s: float = FLUSH_PERIOD_S,
        sync_s: float = SYNC_PERIOD_S,
        max_waiting_rows: int = MAX_WAITING_ROWS,
        threaded: bool = True,
    ) -> None:
        """Creates the files in the caller's thread, before the loop starts. The other thread syncs
        them first, so that a slow disk delays no start. Never raises OSError. Without a thread
        (`threaded` False, for simulated time) the caller calls `write_round`.

        `after_writing` may be set later. The log's thread calls it after each round of writing,
        with True for the last round; it must not raise.
        """
        self.after_writing: Callable[[bool], None] | None = None
        # The previous log, from which another program removed rows; None before such a removal.
        self.cut_short: Path | None = None
        self._wanted = Path(path)
        self._meta, self._overwrite, self._create = meta, overwrite, create
        self._clock, self._flush_s, self._sync_s, self._max_waiting = (
            clock,
            flush_s,
            sync_s,
            max_waiting_rows,
        )
        self._rows: SimpleQueue[LogRow] = SimpleQueue()
        self._text = RowText(find_log_columns(meta.machine))
        self._header = _encode_header(meta)
        # Formatted rows, written by the thread only.
        self._formatted = bytearray()
        self._formatted_rows = 0
        # Bytes that were written but may not be on the disk yet.
        self._unsynced = bytearray()
        self._synced_bytes = len(self._header)
        self._file: NewFile | None = None
        self._trouble = ""
        self._lost = 0
        self._good_at_s = self._synced_at_s = clock()
        self._closing = threading.Event()
        self._started_kept = False
        # The files exist before the loop starts, so that the first row finds them.
        self._open(kept=False)
        # A daemon thread cannot keep a crashed worker alive.
        self._thread = threading.Thread(target=self._run_writing, name="run-log", daemon=True)
        self._threaded = threaded
        if threaded:
            self._thread.start()

    @property
    def path(self) -> Path:
        """Path of the log, which differs from the requested path if that name existed."""
        return self._wanted if self._file is None else self._file.path

    @property
    def ok(self) -> bool:
        """Whether all rows reach the disk."""
        return not self.trouble

    @property
    def trouble(self) -> str:
        """Description of the present fault in a line; empty while rows reach the disk."""
        if self._trouble:
            return self._trouble
        # A hanging disk raises no error, so only the elapsed time reveals it.
        waited_s = self._clock() - self._good_at_s
        if waited_s > SLOW_DISK_S and not self._closing.is_set():
            return f"{self.path}: the disk has not answered for {waited_s:.0f} s"
        return ""

    def append(self, row: LogRow) -> None:
        """Queues a row. Never blocks, never raises, never accesses the disk."""
        # Rows are dropped at the limit, because a full memory would stop the machine.
        if self._closing.is_set() or self._rows.qsize() + self._formatted_rows >= self._max_waiting:
            self._lost += 1
        else:
            self._rows.put(row)

    def close(self, timeout_s: float = 5.0) -> bool:
        """Writes the waiting rows and ends the thread; returns whether every row is on the disk.
        Gives up after `timeout_s`."""
        self._closing.set()
        if self._threaded:
            self._thread.join(timeout_s)
        else:
            self.write_round(True)
        return (
            not self._thread.is_alive()
            and self._file is not None
            and not self._trouble
            and self._lost == 0
        )

    def _run_writing(self) -> None:
        closing = False
        while not closing:
            # The wait ends at once when the log is closed.
            closing = self._closing.wait(self._flush_s)
            self.write_round(closing)

    def write_round(self, closing: bool) -> None:
        """Writes the waiting rows, and calls `after_writing`; the last round closes the file."""
        self._format_waiting_rows()
        self._write_waiting_rows(closing)
        if self.after_writing is not None:
            # Other files of the job are written in the same thread, so that they share its disk.
            self.after_writing(closing)
        if closing and self._file is not None:
            self._file.close()

    def _format_waiting_rows(self) -> None:
        while True:
            try:
                row = self._rows.get_nowait()
            except Empty:
                return
            try:
                self._formatted += self._text.line(row).encode(errors="replace")
                self._formatted_rows += 1
            # One impossible row must not stop the log of all others.
            except (TypeError, ValueError) as error:
                self._lost += 1
                self._trouble = f"{self.path}: a row at {row.time_s} s cannot be written: {error}"

    def _write_waiting_rows(self, closing: bool) -> None:
        if self._file is None:
            self._open(kept=True)
        if self._file is None:
            return
        now_s = self._clock()
        try:
            if not self._started_kept:
                # If another program removed the sidecar, the log continues without it.
                with contextlib.suppress(FileNotFoundError):
                    sync_to_disk(find_sidecar(self._file.path))
                self._file.sync()
                self._started_kept = True
            # The file may have been deleted, or its disk replaced by another.
            if self._trouble and not self._file.is_in_place:
                self._file = self._reopen_file(self._file)
            try:
                self._write_formatted(self._file)
            # Another program has shortened the file, so a new one begins with the lost rows.
            except CutShortError as error:
                self._file = self._begin_new_file(self._file, error.left)
                self._write_formatted(self._file)
            self._formatted_rows = 0
            if closing or now_s - self._synced_at_s >= self._sync_s:
                self._file.sync()
                self._synced_at_s = now_s
                # These rows are certainly on the disk and need no further copy.
                self._synced_bytes += len(self._unsynced)
                self._unsynced.clear()
                self._trouble = ""
        except OSError as error:
            self._trouble = _describe_error(self.path, error)
        self._good_at_s = self._clock()

    def _write_formatted(self, file: NewFile) -> None:
        waiting = bytes(self._formatted)
        try:
            _write_all_bytes(file, self._formatted)
        # The finally block also counts the bytes of a partial write.
        finally:
            self._unsynced += waiting[: len(waiting) - len(self._formatted)]

    def _begin_new_file(self, before: NewFile, left: int) -> NewFile:
        """Returns a new log with the removed rows, as far as they are still in memory, and all
        later rows. Raises OSError."""
        file = begin_log(before.path, self._meta, False, self._create)
        # Only whole rows that are still in the file are skipped.
        whole = self._unsynced.rfind(b"\n", 0, max(0, left - self._synced_bytes)) + 1
        self._formatted[:0] = self._unsynced[whole:]
        self._unsynced.clear()
        self._synced_bytes, self.cut_short = len(self._header), before.path
        with contextlib.suppress(OSError):
            before.close()
        return file

    def _reopen_file(self, before: NewFile) -> NewFile:
        """Returns the log's file again, after it was deleted, or its folder or disk was removed and
        returned. Raises OSError.

        An existing file is continued after the last row that was certainly on the disk. Without a
        file, earlier rows are written again, as far as they can still be read.
        """
        path = before.path
        if not path.parent.is_dir():
            raise OSError("its folder is gone")
        if path.exists() and _has_own_header(path, self._header):
            # Rows after the last sync may be lost, so they are written again.
            file = NewFile(path, go_on_at=self._synced_bytes)
            self._formatted[:0] = self._unsynced
        else:
            # A deleted file can often still be read through its open handle.
            text = _read_deleted(before, self._header) or self._header + self._unsynced
            file = begin_log(path, self._meta, not path.exists(), self._create)
            self._formatted[:0] = text[len(self._header) :]
            self._synced_bytes = len(self._header)
        self._unsynced.clear()
        with contextlib.suppress(OSError):
            before.close()
        return file

    def _open(self, kept: bool) -> None:
        try:
            self._file = begin_log(self._wanted, self._meta, self._overwrite, self._create, kept)
            self._started_kept, self._trouble = kept, ""
        except OSError as error:
            self._trouble = _describe_error(self._wanted, error)
            self._good_at_s = self._clock()


def _encode_header(meta: RunMeta) -> bytes:
    return format_header(find_log_columns(meta.machine)).encode()


def _has_own_header(path: Path, header: bytes) -> bool:
    with open(path, "rb") as file:
        return file.read(len(header)) == header


def _read_deleted(file: NewFile, header: bytes) -> bytes:
    # The handle may be invalid after its disk was removed.
    try:
        text = file.all()
    except OSError:
        return b""
    return text[: text.rfind(b"\n") + 1] if text.startswith(header) else b""


def _write_all_bytes(file: NewFile, data: bytearray) -> None:
    """Writes bytes and removes them from `data`; after an OSError the unwritten bytes remain in
    `data`."""
    while data:
        taken = file.write(data)
        # A disk that accepts nothing would otherwise cause an endless loop.
        if taken <= 0:
            raise OSError("the file takes no more")
        del data[:taken]


def _describe_error(path: Path, error: OSError) -> str:
    return f"{path}: log not written: {error.strerror or error}"
