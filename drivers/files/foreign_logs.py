"""How are foreign logs corrected, whose names, times and values differ from
docs/format-run-log.md?
"""

from __future__ import annotations

import datetime as dt
import difflib
from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import COLUMNS, SPEED_COLUMNS
from topdress.control.recordings.column_repair import mend_recording, mend_values
from topdress.control.recordings.finding import Finding, many
from topdress.control.recordings.row_times import DAY_S, SPREADSHEET_DAYS, SPREADSHEET_EPOCH_DAYS
from topdress.control.recordings.speed_unit import KMH_PER_MPS
from topdress.control.signals import SIGNALS
from topdress.drivers.files.columns import Columns
from topdress.drivers.files.header_names import RenamedHeader
from topdress.drivers.files.header_names import rename_header as renamed
from topdress.drivers.files.imports.column_vocabulary import COLUMN_OF_WHOLE_NAME, DATE_NAMES
from topdress.drivers.files.imports.import_errors import TableError

SecondsArray = NDArray[np.float64]
# Share of numbers in a time column above which the other cells are not dates.
_MAX_NUMBER_CELL_SHARE = 0.5
# Name of a column with a speed in km/h.
_KMH_COLUMN = "speed_kmh"


class _Loss(NamedTuple):
    """Names a result, and whether a log that lacks one of its columns lacks the result; otherwise
    one of the columns is enough."""

    result: str
    all_needed: bool = True


# The keys are those of `Signal.losses`; the order is that of the messages.
LOSSES = {
    "place": _Loss("no map and no place; map and point mode cannot be replayed"),
    "rates": _Loss("no rates and no lag distance", False),
    "speed": _Loss("the speed stage cannot be diagnosed"),
    "canopy": _Loss("canopy mode cannot be replayed and the heads cannot be diagnosed", False),
    "target": _Loss("no rate error"),
    "shaft": _Loss("the shaft stage cannot be diagnosed"),
    "gate": _Loss("the gate stage cannot be diagnosed"),
    "flow": _Loss("the flow and scale stages cannot be diagnosed"),
    "supply": _Loss("effects of the supply voltage cannot be found"),
    "slope": _Loss("effects of slopes cannot be found"),
    "state": _Loss("working and not working rows cannot be told apart"),
}


def rename_log_header(names: tuple[str, ...]) -> RenamedHeader:
    """Returns the header with the published names, where a column has another well-known name,
    different case or a unit. Of several time columns one becomes `time_s`, seconds before dates."""
    plain = [name.strip().lower() for name in names]
    # A column of seconds is preferred to a column of dates, because it needs no parsing.
    times = (
        {}
        if {"time_s", "t_s"} & set(plain)
        else {
            name: "time_s"
            for name in (next((name for name in DATE_NAMES if name in plain), ""),)
            if name
        }
    )
    if times and {"time", "t", "seconds", "elapsed_s"} & set(plain):
        times = {}
    return renamed(names, COLUMNS, COLUMN_OF_WHOLE_NAME | times)


def find_needed_columns(names: tuple[str, ...], wanted: Collection[str]) -> set[str]:
    """Returns the columns that must be read so that the requested columns are the same as after
    reading all."""
    # These columns are evidence for the unit of the time, so they are always read.
    evidence = {"time_s", "lat_deg", "lon_deg", _KMH_COLUMN, *SPEED_COLUMNS}
    return {*wanted, *evidence} if "time_s" in names else {*wanted, *evidence, "utc"}


def examine_columns(
    path: Path, columns: Columns, names: Collection[str]
) -> tuple[Columns, list[Finding]]:
    """Returns corrected columns, and findings.

    Parameters
    ----------
    path : the log, for messages.
    columns : the columns as read.
    names : all columns of the file, of which `columns` may be a part.

    Raises
    ------
    TableError : the log has no usable times.
    """
    columns, from_kmh = _add_speed_from_kmh(columns)
    findings: list[Finding] = []
    # Time comes first, because all further corrections depend on it.
    columns = {**columns, "time_s": find_time_column(path, columns, names, findings)}
    utc = columns.get("utc")
    try:
        if columns["time_s"].size:
            columns, odd = mend_recording(
                columns, None if utc is None else lambda: parse_utc_seconds(utc)
            )
            findings += odd
        else:
            columns = mend_values(columns, findings)
    except ValueError as error:
        raise TableError(path, str(error)) from None
    return columns, [*from_kmh, *findings, *_report_missing(columns, names)]


def _add_speed_from_kmh(columns: Columns) -> tuple[Columns, list[Finding]]:
    speed_kmh = columns.get(_KMH_COLUMN)
    # A measured speed in m/s is never replaced.
    if speed_kmh is None or "speed_mps" in columns or speed_kmh.dtype == object:
        return columns, []
    found = Finding("speed_from_kmh", f"speed_mps computed from column {_KMH_COLUMN}", "speed_mps")
    return {**columns, "speed_mps": speed_kmh / KMH_PER_MPS}, [found]


def _report_missing(columns: Columns, names: Collection[str]) -> list[Finding]:
    known = {
        name
        for name in {*names, *columns}
        if name not in columns or not _is_empty_column(columns, name)
    }
    findings = []
    for key, loss in LOSSES.items():
        needed = [name for name, one in SIGNALS.items() if key in one.losses]
        absent = [name for name in needed if name not in known]
        # Columns that may replace each other are missing only if all are missing.
        if absent and (loss.all_needed or len(absent) == len(needed)):
            text = (
                f"no {' and no '.join(absent) if loss.all_needed else ' or '.join(absent)}: "
                f"{loss.result}"
            )
            findings.append(Finding("missing", text, absent[0]))
    return findings


def _is_empty_column(columns: Columns, name: str) -> bool:
    array = columns[name]
    return not np.any(array != "") if array.dtype == object else bool(np.all(np.isnan(array)))


def find_time_column(
    path: Path, columns: Columns, names: Collection[str], findings: list[Finding]
) -> SecondsArray:
    """Returns a log's `time_s` as numbers (n,), NaN where unknown; they may be unordered, or not in
    seconds.

    Parameters
    ----------
    path : the log, for messages.
    columns : the columns as read.
    names : all columns of the file.
    findings : list to which the corrections are appended.

    Raises
    ------
    TableError : the log has no time column.
    """
    if "time_s" in columns:
        return _convert_dates(columns["time_s"], findings)
    if "utc" in columns:
        # UTC replaces missing seconds, because every receiver provides it.
        from_utc = parse_utc_seconds(columns["utc"])
        if np.isfinite(from_utc).any() or from_utc.size == 0:
            findings.append(
                Finding("time_from_utc", "no column time_s: computed from utc", "time_s")
            )
            # The smallest time is the begin, because rows may be out of order.
            return from_utc - np.nanmin(from_utc) if from_utc.size else from_utc
    # A misspelt name is the most frequent reason for a missing time.
    close = difflib.get_close_matches("time_s", [name.lower() for name in names], n=1, cutoff=0.5)
    hint = f" (is it {close[0]}?)" if close else ""
    listed = ", ".join(list(names)[:8]) + (", ..." if len(names) > 8 else "")
    raise TableError(
        path,
        "no column time_s (seconds since the log began) and no usable utc; "
        f"columns found: {listed}{hint}",
    )


def _convert_dates(values: NDArray[Any], findings: list[Finding]) -> SecondsArray:
    """Returns numbers (n,), or seconds of dates; NaN where a cell holds neither."""
    if values.dtype == object:
        numbers = np.array([_parse_float(text) for text in values.tolist()])
        # Numbers decide if they are the majority, since a log may contain single broken cells.
        if np.isfinite(numbers).sum() <= _MAX_NUMBER_CELL_SHARE * max(1, np.sum(values != "")):
            dates = parse_utc_seconds(values)
            known = np.isfinite(dates)
            if not known.any():
                return dates
            findings.append(
                Finding("dates", "times are dates: taken as seconds since the first row", "time_s")
            )
            # The first date is the zero of the log's time.
            return np.asarray(dates - dates[known][0], dtype=np.float64)
        bad = int((np.isnan(numbers) & (values != "")).sum())
        if bad:
            example = str(values[np.isnan(numbers) & (values != "")][0])[:20]
            findings.append(
                Finding(
                    "not_a_number",
                    f"column time_s: {many(bad, 'cell')} such as {example!r} emptied: not a number",
                    "time_s",
                    bad,
                )
            )
        values = numbers
    return np.asarray(values, dtype=np.float64)


def _parse_float(text: Any) -> float:
    """Returns the number in a text; NaN without a number."""
    try:
        return float(text)
    except ValueError:
        return float("nan")


def parse_utc_seconds(utc: NDArray[Any]) -> SecondsArray:
    """Returns seconds since 1970 (n,) of ISO 8601 texts in the zone that they name (else UTC), or
    of spreadsheet day numbers; NaN for other texts."""
    return np.array([_parse_utc_second(str(text).strip()) for text in utc.tolist()])


def _parse_utc_second(text: str) -> float:
    try:
        moment = dt.datetime.fromisoformat(text)
    except ValueError:
        days = _parse_float(text)
        # Other numbers of days are too early or too late for a machine's log.
        inside = SPREADSHEET_DAYS[0] < days < SPREADSHEET_DAYS[1]
        return (days - SPREADSHEET_EPOCH_DAYS) * DAY_S if inside else float("nan")
    # A time without a zone counts as UTC, so that the result does not depend on the computer.
    return (moment if moment.tzinfo else moment.replace(tzinfo=dt.UTC)).timestamp()
