"""Which lines of a log can be read, where some lines are damaged because the log is still being
written?
"""

from __future__ import annotations

from collections.abc import Callable

from topdress.drivers.files.columns import Columns
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.limits import BeyondLimits

# Share of damaged lines above which the file is no log of this kind.
MAX_DAMAGED_LINE_SHARE = 0.5
# Largest number of readings; each damaged line costs two readings for each halving.
MAX_READINGS = 100


class LenientLineReader:
    """Reads lines without the damaged lines.

    `found` is the result of `read` for the good lines; None if too many lines are damaged. `head`
    holds the lines before the rows, which are always kept. Raises every error of `read` except
    TableError and BeyondLimits.
    """

    def __init__(
        self, lines: list[bytes], head: int, read: Callable[[list[bytes]], Columns]
    ) -> None:
        self.found: Columns | None = None
        self.damaged = 0
        self._read, self._head, self._tried = read, lines[:head], 0
        rows = lines[head:]
        self.found = self._read_whole(rows)
        if self.found is None and len(rows) > 1:
            good = self._find_good_lines(rows)
            self.damaged = len(rows) - len(good)
            if good and self.damaged <= MAX_DAMAGED_LINE_SHARE * len(rows):
                self.found = self._read_whole(good)
        elif self.found is None:
            self.damaged = len(rows)

    def _read_whole(self, rows: list[bytes]) -> Columns | None:
        self._tried += 1
        try:
            return self._read([*self._head, *rows])
        except (TableError, BeyondLimits):
            return None

    def _find_good_lines(self, rows: list[bytes]) -> list[bytes]:
        """Returns the lines that can be read; damaged lines are searched by halving."""
        if self._tried > MAX_READINGS:
            return []
        if len(rows) == 1:
            return rows if self._read_whole(rows) is not None else []
        half = len(rows) // 2
        good = []
        for part in (rows[:half], rows[half:]):
            good += part if self._read_whole(part) is not None else self._find_good_lines(part)
        return good
