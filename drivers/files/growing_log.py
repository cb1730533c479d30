"""A log that another program is still writing: what came since the last look.

Of a run log of ours only the new lines are read, whole ones only. A log of another program is brought in anew whenever
it has grown, and what is later than the last row counts as new.
"""
from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from drivers.files.any_log import is_foreign, open_log
from drivers.files.log_store import is_store
from drivers.files.read_log import LogError, read_log
from drivers.files.table import Columns, TableError

MOST_BYTES = 64 << 20           # of new lines that are read at a time


class GrowingLog:
    """Rows as they come. A file that is not there yet, or has no whole row, has none."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._begin()

    def _begin(self) -> None:
        self.last_s = -np.inf
        self._offset = 0                # of the first byte that was not read
        self._header = b""
        self._size = -1
        self._foreign: bool | None = None

    def more(self) -> Columns | None:
        """The rows since the last call, columns as of `RunLog`; None: there are none.

        Raises LogError, ImportTrouble (open questions) and OSError for a file that is there and cannot be read.
        """
        try:
            size = self.path.stat().st_size
        except FileNotFoundError:
            return None
        if size < self._offset:         # another file stands there now
            self._begin()
        if size == self._size:
            return None
        if self._foreign is None:
            try:
                self._foreign = is_foreign(self.path)
            except TableError:
                return None             # no header yet
        if self._foreign or is_store(self.path):
            columns: Columns | None = open_log(self.path).columns
            self._size = size
        else:
            columns = self._lines()
            if self._offset == size:
                self._size = size
        return self._newer(columns)

    def _lines(self) -> Columns | None:
        with self.path.open("rb") as file:
            file.seek(self._offset)
            data = file.read(MOST_BYTES)
        whole = data[:data.rfind(b"\n") + 1]
        if not whole:
            return None
        if not self._header:
            self._header = whole[:whole.find(b"\n") + 1]
            text = whole
        else:
            text = self._header + whole
        self._offset += len(whole)
        if text.count(b"\n") < 2:
            return None
        with tempfile.TemporaryDirectory(prefix="topdress-") as folder:
            piece = Path(folder) / "new.csv"
            piece.write_bytes(text)
            try:
                return read_log(piece).columns
            except LogError as error:
                raise LogError(str(error).replace(str(piece), str(self.path))) from None

    def _newer(self, columns: Columns | None) -> Columns | None:
        if columns is None or not len(columns["time_s"]):
            return None
        new = columns["time_s"] > self.last_s
        if not new.any():
            return None
        self.last_s = float(columns["time_s"][-1])
        return columns if new.all() else {name: array[new] for name, array in columns.items()}
