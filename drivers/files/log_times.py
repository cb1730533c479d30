"""The column of a log that tells its times, as numbers: seconds, dates in texts, or computed from `utc`."""
from __future__ import annotations

import datetime as dt
import difflib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from control.recordings.finding import Finding, many
from control.recordings.times import DAY_S, SPREADSHEET_DAYS, SPREADSHEET_EPOCH_DAYS
from drivers.files.imports.trouble import TableError
from drivers.files.table import Columns

Times = NDArray[np.float64]

_MOST = 0.5                  # of the cells: where more are numbers, the others are no dates


def time_column(path: Path, columns: Columns, names: Collection[str], findings: list[Finding]) -> Times:
    """A log's `time_s` as numbers, NaN where there is none; in order, or in seconds, it need not be.

    `names`: all columns of the file. `findings` grows by what was done. Raises TableError.
    """
    if "time_s" in columns:
        return _dates_or_seconds(columns["time_s"], findings)
    if "utc" in columns:
        from_utc = seconds_of(columns["utc"])
        if np.isfinite(from_utc).any() or from_utc.size == 0:
            findings.append(Finding("time_from_utc", "no column time_s: computed from utc", "time_s"))
            return from_utc - np.nanmin(from_utc) if from_utc.size else from_utc
    close = difflib.get_close_matches("time_s", [name.lower() for name in names], n=1, cutoff=0.5)
    hint = f" (is it {close[0]}?)" if close else ""
    listed = ", ".join(list(names)[:8]) + (", ..." if len(names) > 8 else "")
    raise TableError(path, "no column time_s (seconds since the log began) and no usable utc; "
                     f"columns found: {listed}{hint}")


def _dates_or_seconds(values: NDArray[Any], findings: list[Finding]) -> Times:
    """A column of numbers, or the seconds of one of dates; NaN where it holds none."""
    if values.dtype == object:
        numbers = np.array([_float(text) for text in values.tolist()])
        if np.isfinite(numbers).sum() <= _MOST * max(1, np.sum(values != "")):
            dates = seconds_of(values)
            known = np.isfinite(dates)
            if not known.any():
                return dates
            findings.append(Finding("dates", "times are dates: taken as seconds since the first row", "time_s"))
            return np.asarray(dates - dates[known][0], dtype=np.float64)
        bad = int((np.isnan(numbers) & (values != "")).sum())
        if bad:
            example = str(values[np.isnan(numbers) & (values != "")][0])[:20]
            findings.append(Finding("not_a_number", f"column time_s: {many(bad, 'cell')} such as {example!r} emptied: "
                                    "not a number", "time_s", bad))
        values = numbers
    return np.asarray(values, dtype=np.float64)


def _float(text: Any) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def seconds_of(utc: NDArray[Any]) -> Times:
    """Seconds since 1970 of ISO 8601 texts, of any zone that they name (else UTC), or of days as spreadsheets count
    them; NaN where there is none."""
    return np.array([_second(str(text).strip()) for text in utc.tolist()])


def _second(text: str) -> float:
    try:
        moment = dt.datetime.fromisoformat(text)
    except ValueError:
        days = _float(text)
        inside = SPREADSHEET_DAYS[0] < days < SPREADSHEET_DAYS[1]
        return (days - SPREADSHEET_EPOCH_DAYS) * DAY_S if inside else float("nan")
    return (moment if moment.tzinfo else moment.replace(tzinfo=dt.UTC)).timestamp()
