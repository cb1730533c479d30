"""Which content does a file have: a log, a bench table, a map or a field? Every command decides by
this module.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Literal

from topdress.control.calibration.bench_table import KNOWN_COLUMNS, recognise_kind
from topdress.control.log_row import COLUMNS, SPEED_COLUMNS
from topdress.drivers.files.file_sniffer import FOREIGN_SUFFIXES, has_worked_points, sniff_file_kind
from topdress.drivers.files.foreign_logs import rename_log_header
from topdress.drivers.files.formats.registry import find_format
from topdress.drivers.files.header_names import rename_header as renamed
from topdress.drivers.files.imports.column_vocabulary import (
    COMMAND_WORDS,
    fold_column_name,
    has_any_word,
    has_places_without_time,
    has_time_column,
)
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.limits import check_file
from topdress.drivers.files.log_store import STORE_SUFFIXES as PARQUET
from topdress.drivers.files.log_store import is_log_store
from topdress.drivers.files.table import NoHeaderError, read_header

# Share of known columns; a log with a smaller share is foreign, and the import reads it better.
MIN_KNOWN_COLUMN_SHARE = 0.5
# Columns that occur in a log but not in a bench table.
_LOG_COLUMNS = frozenset(
    {"shaft_rpm_cmd", "opening_mm_cmd", "target_rate_kg_ha", "lat_deg", *SPEED_COLUMNS}
)

ContentKind = Literal["log", "table", "map", "field", ""]


class FileContent:
    """Answers questions about a file. Nothing is read in advance, and each answer is
    computed once."""

    def __init__(self, path: Path) -> None:
        self.path, self._suffix = path, path.suffix.lower()

    @property
    def is_table(self) -> bool:
        """Returns whether the file has rows and columns, whatever its suffix: a text or a
        workbook."""
        return not (self.path.is_dir() or self._suffix in FOREIGN_SUFFIXES or self._has_area_suffix)

    @property
    def _has_area_suffix(self) -> bool:
        found = find_format(self.path, "read_map")
        return found is not None and found.read_table is None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of a table's columns, unchanged; none where the first line holds only numbers.
        Raises TableError."""
        try:
            return read_header(self.path)
        except NoHeaderError:
            return ()

    @property
    def bench(self) -> str | None:
        """The kind of bench table that the columns determine; None for none or several. Raises
        TableError."""
        return recognise_kind(renamed(self.names, KNOWN_COLUMNS, {}).names)

    @property
    def foreign(self) -> bool:
        """Returns whether the import reads this file instead of `read_log`. A topdress log is never
        guessed. Raises TableError, OSError."""
        if is_log_store(self.path):
            return False
        # The import requests the names of the columns.
        if not self.is_table or not self.names:
            return True
        plain, ours = _normalise_names(self.names), rename_log_header(self.names).names
        known = sum(name in COLUMNS for name in ours)
        if "time_s" in plain:
            # A foreign log may have `commanded_rpm` next to its readings.
            return known == 1 and any(
                has_any_word(fold_column_name(name), COMMAND_WORDS)
                for name in plain
                if not name.startswith("x_")
            )
        return not (
            {"time_s", "utc"} & set(ours)
            and known >= MIN_KNOWN_COLUMN_SHARE * len(ours)
            and known > 1
        )

    @cached_property
    def content_kind(self) -> ContentKind:
        """Returns the content of the file; empty for a table whose columns do not show it. A file
        of areas is a map, even if its outlines are used as a field. Raises BeyondLimits, OSError.
        """
        check_file(self.path)
        if self.is_table:
            return self._find_by_columns()
        if self._suffix in PARQUET:
            return "log"
        if self._has_area_suffix:
            return "map"
        if sniff_file_kind(self.path).id == "aog":
            return "field"
        return "log" if has_worked_points(self.path) and not self._has_map_points() else "map"

    def _find_by_columns(self) -> ContentKind:
        from topdress.drivers.files.prescriptions.csv_zones import has_polygon_text
        from topdress.drivers.files.prescriptions.grid_from_points import find_metre_columns

        if has_polygon_text(self.path):
            return "map"
        try:
            if is_run_log_header(self.names):
                return "log"
            if self.bench is not None:
                return "table"
        except TableError:
            # The reader reports the damage.
            # The reader reports the damage.
            return ""
        if has_time_column(self.names):
            return "log"
        # Kriging programs separate columns by spaces.
        parted = self.names[0].split() if len(self.names) == 1 else self.names
        has_places = has_places_without_time(self.names) or find_metre_columns(parted) is not None
        return "map" if has_places else ""

    def _has_map_points(self) -> bool:
        from topdress.drivers.files.imports.table_reader import read_raw_table

        try:
            return has_places_without_time(read_raw_table(self.path).names)
        except TableError:
            return False


def is_run_log_header(names: tuple[str, ...]) -> bool:
    """Returns whether a header belongs to a log instead of a bench table: it has the time of each
    row."""
    ours = set(rename_log_header(names).names)
    if "time_s" in _normalise_names(names):
        return True
    return bool({"time_s", "utc"} & ours) and (
        recognise_kind(ours) is None or bool(_LOG_COLUMNS & ours)
    )


def _normalise_names(names: tuple[str, ...]) -> list[str]:
    return [name.strip().lower() for name in names]
