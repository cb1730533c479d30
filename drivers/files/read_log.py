"""How are run logs read? Topdress's own logs are read up to their last whole row; in foreign logs
every oddity is corrected or reported.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import ALL_COLUMNS, COLUMNS, TEXT_COLUMNS, WHOLE_COLUMNS, LogRow
from topdress.control.recordings.finding import Finding
from topdress.drivers.files.atomic_files import find_sidecar
from topdress.drivers.files.columns import Columns
from topdress.drivers.files.foreign_logs import (
    examine_columns,
    find_needed_columns,
    rename_log_header,
)
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.log_store import is_log_store, read_log_store, read_store_meta
from topdress.drivers.files.log_text import find_log_columns, format_header
from topdress.drivers.files.run_meta import RunMeta, parse_meta_yaml
from topdress.drivers.files.table import convert_cells as columns_of_cells
from topdress.drivers.files.table import read_table

# Interval between rows above which the times may be milliseconds, s. Another column shows this, so
# all columns are read then.
SLOW_STEP_S = 2.0
# Columns of numbers; times are not listed, because they may be dates.
_NUMBER_COLUMNS = frozenset(COLUMNS) - TEXT_COLUMNS - {"time_s"}


@dataclass(frozen=True, slots=True, eq=False)
class RunLog:
    """Holds a log in memory.

    `columns` holds the columns of the file, known columns under their published names, unknown
    columns unchanged. They are arrays of length n, float64 (NaN: unknown) or object (texts, "":
    unknown). `time_s` always exists and is strictly increasing. `meta` is None for a log without a
    sidecar. `findings` lists every oddity with its correction.
    """

    path: Path
    columns: Columns
    meta: RunMeta | None
    findings: tuple[Finding, ...]

    def __len__(self) -> int:
        """Returns the number of rows."""
        return len(self.columns["time_s"])

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Times of the rows (n,), s."""
        return self.columns["time_s"]

    @property
    def duration_s(self) -> float:
        """Time from the first to the last row, s."""
        # An empty log has no duration.
        return float(self.time_s[-1] - self.time_s[0]) if len(self) else 0.0

    @property
    def step_s(self) -> float:
        """Median time between rows, s; NaN for fewer than two rows."""
        return float(np.median(np.diff(self.time_s))) if len(self) > 1 else float("nan")

    def has(self, column: str) -> bool:
        """Returns whether this column exists and has a known value."""
        array = self.columns.get(column)
        if array is None:
            return False
        return (
            # Texts are empty where they are unknown, numbers are NaN.
            bool(np.any(array != ""))
            if array.dtype == object
            else not bool(np.all(np.isnan(array)))
        )

    def numbers(self, column: str) -> NDArray[np.float64]:
        """Returns numbers (n,), all NaN for a missing column. Raises KeyError for a column of
        texts."""
        array = self.columns.get(column)
        # A missing column behaves as a column without values, so that callers need no test.
        if array is None:
            return np.full(len(self), np.nan)
        if array.dtype == object:
            raise KeyError(f"column {column} holds texts")
        return array

    def texts(self, column: str) -> NDArray[Any]:
        """Returns texts (n,), all empty for a missing column."""
        array = self.columns.get(column)
        return np.full(len(self), "", object) if array is None else array.astype(object)

    def rows(self) -> Iterator[LogRow]:
        """Returns the rows as the control loop wrote them."""
        if not len(self):
            return iter(())
        # Missing columns are endless iterators of None, so the lengths may differ.
        return map(LogRow._make, zip(*(self._cells(name) for name in ALL_COLUMNS), strict=False))

    def _cells(self, name: str) -> Any:
        array = self.columns.get(name)
        if array is None:
            return repeat(None)
        if name in TEXT_COLUMNS:
            return [text or None for text in array.tolist()]
        if name in WHOLE_COLUMNS:
            return [None if value != value else int(value) for value in array.tolist()]
        return [None if value != value else value for value in array.tolist()]


def read_log(
    path: str | Path,
    only: Collection[str] | None = None,
    without: Collection[str] = (),
    data: bytes | None = None,
) -> RunLog:
    """Returns a run log of any program, cut anywhere by a power loss; or of its store
    (`log_store`).

    Parameters
    ----------
    path : the log.
    only : names of the requested columns (None: all); `time_s` is always read.
    without : names of columns that are not read, because a million unused texts need 0.2 GB.
    data : header and lines of a text, which replace the whole file but not its sidecar.

    Returns
    -------
    the log with its findings.

    Raises
    ------
    TableError : the log cannot be used.
    """
    path = Path(path)
    # The first reading is fast; a slow interval may mean milliseconds, which other columns show.
    if without:
        log = _read_log_columns(path, only, without)
        if not log.step_s >= SLOW_STEP_S:
            return log
    return _read_log_columns(path, only, (), data)


def _read_log_columns(
    path: Path,
    only: Collection[str] | None,
    without: Collection[str] = (),
    data: bytes | None = None,
) -> RunLog:
    # Lines without a file have no store and no sidecar.
    if data is None and is_log_store(path):
        return RunLog(path, *read_log_store(path, only))
    meta, meta_findings = _read_sidecar(path) if data is None else (None, ())
    # A log of a worker that was killed at its start is empty but valid.
    if data is None and _is_cut_in_header(path, meta):
        found = Finding("cut_header", "the log was cut off before its first row")
        columns = {
            name: np.array([], object if name in TEXT_COLUMNS else np.float64)
            for name in _find_own_columns(meta)
            if only is None or name in only or name == "time_s"
        }
        return RunLog(path, columns, meta, (*meta_findings, found))
    table = read_table(
        path,
        _NUMBER_COLUMNS,
        TEXT_COLUMNS,
        rename=rename_log_header,
        own_header=_find_own_columns(meta),
        data=data,
        choose=None
        # Reading fewer columns saves most of the time of a large log.
        if only is None and not without
        else lambda names: find_needed_columns(
            names, [name for name in names if name not in without] if only is None else only
        ),
    )
    columns, findings = examine_columns(path, table.columns, table.names)
    # Columns that only served as evidence are removed.
    if only is not None:
        columns = {
            name: array for name, array in columns.items() if name in only or name == "time_s"
        }
    return RunLog(path, columns, meta, (*meta_findings, *table.findings, *findings))


def build_log(path: Path, given: Columns, meta: RunMeta) -> RunLog:
    """Returns a table with a run log's columns as the log that would be read from it, examined in
    the same way. Raises TableError for a table without rows."""
    columns, findings = examine_columns(
        path,
        columns_of_cells(dict(given), _NUMBER_COLUMNS | {"time_s"}, TEXT_COLUMNS),
        tuple(given),
    )
    log = RunLog(path, columns, meta, tuple(findings))
    # A table without rows is no log, although its header may be right.
    if not len(log):
        raise TableError(path, "no whole row below the header")
    return log


def read_nonempty_log(path: str | Path, without: Collection[str] = ()) -> RunLog:
    """Returns a run log with rows; `without` is as in `read_log`. Raises TableError also for a log
    without a whole row."""
    log = read_log(path, without=without)
    if len(log) == 0:
        raise TableError(log.path, "no whole row below the header")
    return log


def read_log_meta(path: Path) -> RunMeta | None:
    """Returns a run log's sidecar without reading its rows; None without a usable sidecar."""
    if not is_log_store(path):
        return _read_sidecar(path)[0]
    try:
        return read_store_meta(path)[0]
    # A damaged store is reported when its rows are read.
    except (TableError, OSError):
        return None


def _is_cut_in_header(path: Path, meta: RunMeta | None) -> bool:
    """Returns whether the file is only a beginning of topdress's header line. An empty file counts
    only next to a sidecar of topdress."""
    header = format_header(_find_own_columns(meta)).encode()
    try:
        with path.open("rb") as file:
            # A power loss may leave zero bytes after the last written byte.
            start = file.read(len(header) + 1).rstrip(b"\0")
    except OSError:
        return False
    return (
        header.startswith(start)
        and not start.endswith(b"\n")
        and (start != b"" or meta is not None)
    )


def _find_own_columns(meta: RunMeta | None) -> tuple[str, ...]:
    """Returns the columns that this program writes for the machine of the sidecar."""
    return find_log_columns(None if meta is None else meta.machine)


def _read_sidecar(path: Path) -> tuple[RunMeta | None, tuple[Finding, ...]]:
    place = find_sidecar(path)
    try:
        return parse_meta_yaml(place.read_text(encoding="utf-8")), ()
    except FileNotFoundError:
        return None, ()
    # A broken sidecar must not prevent the reading of measured rows.
    except (OSError, ValueError) as error:
        return None, (Finding("sidecar", f"{place.name} next to the log was not used: {error}"),)
