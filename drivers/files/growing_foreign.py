"""A log of another program that still grows: only its new lines are brought in, by what the whole of it said.

What the columns mean is asked of the whole file when it is opened, and again whenever it has doubled, so that all looks
together read each line a few times. Between, the new lines are brought in behind the file's own first lines up to its
first row, with the same import file: the times of both begin at that row.
"""
from __future__ import annotations

from pathlib import Path

from drivers.files.any_log import imported_columns, raw_and_mapping
from drivers.files.good_lines import GoodLines
from drivers.files.imports.mapping import ImportFile
from drivers.files.imports.trouble import TableError
from drivers.files.table import Columns

FIRST_LINES = 100               # these must say what the columns mean, before others are taken for damaged
GROWN = 2.0                     # times as large as when it was read as a whole
ONE_BYTE = ("utf-8", "ascii", "latin", "iso-8859", "iso8859", "cp125", "windows-125", "gbk", "gb2312", "gb18030")


class ForeignText:
    """`read` gives the rows of the new lines, or of the whole file where they cannot be known without it."""

    def __init__(self, path: Path) -> None:
        self.path, self.damaged = path, 0
        self._head = b""                        # lines up to the first row
        self._offset = 0                        # of the first byte that was not read
        self._whole_size = 0
        self._mapping: ImportFile | None = None

    def read(self, size: int) -> Columns | None:
        """None: no whole new line, or too few to say what they mean.

        Raises TableError (what is not known of the columns too), OSError.
        """
        if self._mapping is None or size >= GROWN * self._whole_size:
            return self._whole()
        return self._new()

    def _whole(self) -> Columns | None:
        data = self.path.read_bytes()
        data = data[:data.rfind(b"\n") + 1] or data
        self._whole_size = max(len(data), 1)
        if self._mapping is not None:
            try:
                return self._ask(data)
            except TableError:               # it was known before: a damaged line hides it
                return self._new()
        try:
            return self._ask(data)
        except TableError:                   # open questions stay; a damaged line may be left out
            lines = data.splitlines(keepends=True)
            if len(lines) <= FIRST_LINES:       # nothing but a header, or too few rows to tell: it still grows
                return None
            self._ask(b"".join(lines[:FIRST_LINES]))
            good = GoodLines(lines, FIRST_LINES, lambda some: self._ask(b"".join(some)))
            if good.found is None:
                raise
            self.damaged += good.damaged
            return good.found

    def _ask(self, data: bytes) -> Columns:
        raw, mapping, _ = raw_and_mapping(self.path, data)
        columns = imported_columns(self.path, raw, mapping)
        lines = data.splitlines(keepends=True)
        follows = raw.source.kind == "text" and (raw.source.encoding or "").lower().startswith(ONE_BYTE)
        if follows and mapping.time.counts != "rows":
            self._head, self._offset = b"".join(lines[:raw.first_row]), len(data)
            self._mapping = mapping.model_copy(update={"source": raw.source})
        return columns

    def _new(self) -> Columns | None:
        with self.path.open("rb") as file:
            file.seek(self._offset)
            data = file.read()
        new = data[:data.rfind(b"\n") + 1]
        if not new:
            return None
        good = GoodLines(new.splitlines(keepends=True), 0, self._rows)
        self._offset += len(new)
        self.damaged += good.damaged
        return good.found

    def _rows(self, lines: list[bytes]) -> Columns:
        from drivers.files.imports.read import read_raw
        assert self._mapping is not None
        raw = read_raw(self.path, self._mapping.source, self._head + b"".join(lines))
        return imported_columns(self.path, raw, self._mapping)
