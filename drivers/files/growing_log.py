"""Which rows have been added since the last reading to a log that another program is still writing?

Only new, whole lines are read, of topdress's run logs and of foreign texts (`ForeignTextReader`).
Other files are imported anew whenever they have grown, and rows later than the last row are new. A
damaged line is omitted and counted. If another log replaces the file, it is read from its
beginning; its times show the replacement.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from topdress.drivers.files.any_log import convert_log_columns, open_any_log, read_with_mapping
from topdress.drivers.files.columns import Columns
from topdress.drivers.files.file_content import FileContent
from topdress.drivers.files.file_sniffer import FOREIGN_SUFFIXES
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.imports.mapping import ImportFile
from topdress.drivers.files.lenient_line_reader import LenientLineReader
from topdress.drivers.files.log_store import is_log_store
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.sheet_text import WORKBOOK_SUFFIXES

# Number of first lines that must show the meaning of the columns, before other lines count as
# damaged. The meaning is derived from the whole file when it is opened, and again whenever it has
# doubled, so that all readings together read each line a few times. Between, the new lines are
# imported after the file's first lines up to its first row, with the same import file, because the
# times of both begin at that row.
MIN_FIRST_LINES = 100
# Growth since the last reading of the whole file, after which the whole file is read again.
REREAD_GROWTH_FACTOR = 2.0
# Encodings in which a line end is a single byte.
ONE_BYTE_ENCODINGS = (
    "utf-8",
    "ascii",
    "latin",
    "iso-8859",
    "iso8859",
    "cp125",
    "windows-125",
    "gbk",
    "gb2312",
    "gb18030",
)


class ForeignTextReader:
    """Reads another program's text. `read` returns the rows of the new lines, or of the whole file
    where they need it."""

    def __init__(self, path: Path) -> None:
        self.path, self.damaged = path, 0
        # The lines up to the first row.
        self._head = b""
        # Position of the first byte that was not read.
        self._offset = 0
        self._whole_size = 0
        self._mapping: ImportFile | None = None

    def read(self, size: int) -> Columns | None:
        """Returns new rows; None without a whole new line, or with too few lines to show their
        meaning. Raises TableError (with open questions), OSError."""
        if self._mapping is None or size >= REREAD_GROWTH_FACTOR * self._whole_size:
            return self._read_whole()
        return self._read_new_lines()

    def _read_whole(self) -> Columns | None:
        data = self.path.read_bytes()
        # The last line may still be incomplete.
        data = data[: data.rfind(b"\n") + 1] or data
        self._whole_size = max(len(data), 1)
        if self._mapping is not None:
            try:
                return self._read_and_map(data)
            # The meaning was known before, so a damaged line hides it.
            except TableError:
                return self._read_new_lines()
        try:
            return self._read_and_map(data)
        # Open questions remain; a damaged line may be omitted.
        except TableError:
            lines = data.splitlines(keepends=True)
            # A file with only a header, or with too few rows for a decision, is still growing.
            if len(lines) <= MIN_FIRST_LINES:
                return None
            self._read_and_map(b"".join(lines[:MIN_FIRST_LINES]))
            good = LenientLineReader(
                lines, MIN_FIRST_LINES, lambda some: self._read_and_map(b"".join(some))
            )
            if good.found is None:
                raise
            self.damaged += good.damaged
            return good.found

    def _read_and_map(self, data: bytes) -> Columns:
        raw, mapping, _ = read_with_mapping(self.path, data)
        columns = convert_log_columns(self.path, raw, mapping)
        lines = data.splitlines(keepends=True)
        follows = raw.source.kind == "text" and (raw.source.encoding or "").lower().startswith(
            ONE_BYTE_ENCODINGS
        )
        if follows and mapping.time.counts != "rows":
            self._head, self._offset = b"".join(lines[: raw.first_row]), len(data)
            self._mapping = mapping.model_copy(update={"source": raw.source})
        return columns

    def _read_new_lines(self) -> Columns | None:
        with self.path.open("rb") as file:
            file.seek(self._offset)
            data = file.read()
        new = data[: data.rfind(b"\n") + 1]
        if not new:
            return None
        good = LenientLineReader(new.splitlines(keepends=True), 0, self._convert_lines)
        self._offset += len(new)
        self.damaged += good.damaged
        return good.found

    def _convert_lines(self, lines: list[bytes]) -> Columns:
        from topdress.drivers.files.imports.table_reader import read_raw_table

        assert self._mapping is not None
        raw = read_raw_table(self.path, self._mapping.source, self._head + b"".join(lines))
        return convert_log_columns(self.path, raw, self._mapping)


# Number of bytes of new lines that are read at a time.
MAX_NEW_BYTES = 64 << 20


class GrowingLog:
    """Reads the rows of a growing file. A missing file, or a file without a whole row, has none.

    `behind` tells whether the file had more bytes than are read at a time. `damaged` is the number
    of omitted lines.
    """

    def __init__(self, path: Path, most_bytes: int = MAX_NEW_BYTES) -> None:
        self.path, self._most_bytes = path, most_bytes
        self.damaged = 0
        self._start_over()

    def _start_over(self) -> None:
        self.last_s = -np.inf
        self.behind = False
        # Position of the first byte that was not read.
        self._offset = 0
        self._header = b""
        # Size and identity of the file at the last reading.
        self._size, self._place = -1, (0, 0)
        self._foreign: bool | None = None
        self._text = ForeignTextReader(self.path)

    def read_new_rows(self) -> Columns | None:
        """Returns the rows since the last call with the columns of `RunLog`; None without new rows.

        Raises
        ------
        TableError : the file cannot be read (with open questions).
        OSError : the file cannot be opened.
        """
        try:
            now = self.path.stat()
        except FileNotFoundError:
            return None
        place = (now.st_dev, now.st_ino)
        # Another file has replaced the file.
        if now.st_size < self._offset or (self._offset and place != self._place):
            self._start_over()
        if now.st_size == self._size and place == self._place:
            return None
        columns = self._read_changes(now.st_size)
        self._place = place
        return self._select_newer(columns)

    def _read_changes(self, size: int) -> Columns | None:
        if self._foreign is None:
            try:
                self._foreign = FileContent(self.path).foreign
            except TableError:
                # The header is still incomplete.
                return None
        columns: Columns | None
        if (
            self._foreign
            and not self.path.is_dir()
            and self.path.suffix.lower() not in {*FOREIGN_SUFFIXES, *WORKBOOK_SUFFIXES}
        ):
            # Another log has replaced the file.
            if size < self._size:
                self._text = ForeignTextReader(self.path)
            before = self._text.damaged
            columns, self._size = self._text.read(size), size
            self.damaged += self._text.damaged - before
        elif self._foreign or is_log_store(self.path):
            columns, self._size = open_any_log(self.path).columns, size
        else:
            columns = self._read_own_lines()
            if self._offset == size:
                self._size = size
        return columns

    def _read_own_lines(self) -> Columns | None:
        with self.path.open("rb") as file:
            file.seek(self._offset)
            data = file.read(self._most_bytes)
        self.behind = len(data) == self._most_bytes
        whole = data[: data.rfind(b"\n") + 1]
        if not whole:
            return None
        header = self._header or whole[: whole.find(b"\n") + 1]
        lines = (self._header + whole).splitlines(keepends=True)
        columns = self._read_good_lines(lines) if len(lines) > 1 else None
        self._header, self._offset = header, self._offset + len(whole)
        return columns

    def _read_good_lines(self, lines: list[bytes]) -> Columns | None:
        """Returns the rows without damaged lines. Raises the reader's error where no line belongs
        to a log."""
        good = LenientLineReader(lines, 1, lambda some: self._parse_lines(b"".join(some)))
        if good.found is None and self._offset == 0:
            return self._parse_lines(b"".join(lines))
        self.damaged += good.damaged
        return good.found

    def _parse_lines(self, text: bytes) -> Columns:
        return read_log(self.path, data=text).columns

    def _select_newer(self, columns: Columns | None) -> Columns | None:
        if columns is None or not len(columns["time_s"]):
            return None
        # A file that ends before the rows read so far is another log.
        if columns["time_s"][-1] < self.last_s:
            self.last_s = -np.inf
        new = columns["time_s"] > self.last_s
        if not new.any():
            return None
        self.last_s = float(columns["time_s"][-1])
        return columns if new.all() else {name: array[new] for name, array in columns.items()}
