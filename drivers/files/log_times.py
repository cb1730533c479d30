"""The times of a log: seconds since its beginning, strictly increasing; what was otherwise is put right and said."""
from __future__ import annotations

import datetime as dt
import difflib
from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.files.findings import Finding, many
from drivers.files.table import Columns
from drivers.plain_text import OneLine

Times = NDArray[np.float64]

_EPOCH_S = 1e6               # a log does not last eleven days: larger times count from some epoch
_EPOCH_MS = 1e11             # and these are milliseconds
_EXCEL_DAYS = (30_000.0, 80_000.0)      # since 1899-12-30: 1982 to 2119
_EXCEL_EPOCH = 25_569.0      # 1970-01-01
_EXCEL_STEP = 0.005          # days: no log has a row only every seven minutes
_DAY_S = 86_400.0
_UNEVEN = 0.5                # a step further than this share from the median step is a gap or a short step
_MIXED_SHARE = 0.05          # more uneven steps than this are a mixed sample time, not gaps
_MOST = 0.5                  # where more rows than this share would go, the log is refused


class UnusableLog(OneLine):
    """One line, without the file's name."""


def with_good_times(columns: Columns, names: Collection[str]) -> tuple[Columns, list[Finding]]:
    """The columns with a `time_s` from 0 or a little later, strictly increasing; rows left out where need be.

    `names`: all columns of the file. Raises UnusableLog.
    """
    findings: list[Finding] = []
    time_s = _time_column(columns, names, findings)
    if time_s.size == 0:
        return {**columns, "time_s": time_s}, findings
    keep = np.isfinite(time_s)
    if not keep.any():
        raise UnusableLog("column time_s: no number in it: allowed seconds since the log began")
    if not keep.all():
        lost = int(np.sum(~keep))
        findings.append(Finding("no_time", f"{many(lost)} without a time left out", "time_s", lost))
    time_s = _from_zero(time_s, keep, columns, findings)
    time_s = _spread(time_s, keep, findings)
    keep = _increasing(time_s, keep, findings)
    if not keep.all():
        columns = {name: array[keep] for name, array in columns.items()}
        time_s = time_s[keep]
    findings += _steps(time_s)
    return {**columns, "time_s": time_s}, findings


def _time_column(columns: Columns, names: Collection[str], findings: list[Finding]) -> Times:
    if "time_s" in columns:
        return _dates_or_seconds(columns["time_s"], findings)
    if "utc" in columns:
        from_utc = _seconds(columns["utc"])
        if np.isfinite(from_utc).any() or from_utc.size == 0:
            findings.append(Finding("time_from_utc", "no column time_s: computed from utc", "time_s"))
            return from_utc - np.nanmin(from_utc) if from_utc.size else from_utc
    close = difflib.get_close_matches("time_s", [name.lower() for name in names], n=1, cutoff=0.5)
    hint = f" (is it {close[0]}?)" if close else ""
    listed = ", ".join(list(names)[:8]) + (", ..." if len(names) > 8 else "")
    raise UnusableLog("no column time_s (seconds since the log began) and no usable utc; "
                      f"columns found: {listed}{hint}")


def _dates_or_seconds(values: NDArray[Any], findings: list[Finding]) -> Times:
    """Seconds of a column of numbers, of days as spreadsheets count them, or of dates; NaN where it holds none."""
    if values.dtype == object:
        numbers = np.array([_float(text) for text in values.tolist()])
        if np.isfinite(numbers).sum() <= _MOST * max(1, np.sum(values != "")):
            dates = _seconds(values)
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
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    steps = steps[steps > 0.0]
    if known.size > 1 and _EXCEL_DAYS[0] < known[0] < _EXCEL_DAYS[1] and steps.size and np.median(steps) < _EXCEL_STEP:
        findings.append(Finding("excel_days", "times are days as spreadsheets count them: taken as seconds since the "
                                "first row", "time_s"))
        return np.asarray(np.round((values - known[0]) * _DAY_S, 4), dtype=np.float64)
    return np.asarray(values, dtype=np.float64)


def _float(text: Any) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _seconds(utc: NDArray[Any]) -> Times:
    """Seconds since 1970 of ISO 8601 texts, of any zone that they name (else UTC), or of days as spreadsheets count
    them; NaN where there is none."""
    return np.array([_second(str(text).strip()) for text in utc.tolist()])


def _second(text: str) -> float:
    try:
        moment = dt.datetime.fromisoformat(text)
    except ValueError:
        days = _float(text)
        return (days - _EXCEL_EPOCH) * _DAY_S if _EXCEL_DAYS[0] < days < _EXCEL_DAYS[1] else float("nan")
    return (moment if moment.tzinfo else moment.replace(tzinfo=dt.UTC)).timestamp()


def _from_zero(time_s: Times, keep: NDArray[np.bool_], columns: Columns, findings: list[Finding]) -> Times:
    first = float(time_s[keep][0])
    if abs(first) > _EPOCH_MS:
        findings.append(Finding("milliseconds", "times are milliseconds since an epoch: taken as seconds since the "
                                "first row", "time_s"))
        return (time_s - first) / 1000.0
    if abs(first) > _EPOCH_S:
        findings.append(Finding("epoch", "times count from an epoch: taken as seconds since the first row", "time_s"))
        time_s = time_s - first
    known = time_s[keep]
    if "utc" in columns and known.size > 2 and np.median(np.diff(known)) >= 5.0:
        utc_s = _seconds(columns["utc"][keep])
        both = np.isfinite(utc_s)
        if both.any() and 900.0 < np.ptp(known[both]) / max(float(np.ptp(utc_s[both])), 1e-3) < 1100.0:
            findings.append(Finding("milliseconds", "times are milliseconds (as utc shows): taken as seconds",
                                    "time_s"))
            return time_s / 1000.0
    return time_s


def _spread(time_s: Times, keep: NDArray[np.bool_], findings: list[Finding]) -> Times:
    """Rows that share one coarse time, e.g. whole seconds at 10 Hz, spread evenly over it."""
    known = time_s[keep]
    starts = np.flatnonzero(np.diff(known, prepend=np.nan) != 0)
    sizes = np.diff(starts, append=known.size)
    if known.size < 4 or np.median(sizes) < 2 or np.any(np.diff(known) < 0) or starts.size < 2:
        return time_s
    step_s = float(np.median(np.diff(known[starts])))
    spread = known + step_s * (np.arange(known.size) - np.repeat(starts, sizes)) / np.repeat(sizes, sizes)
    findings.append(Finding("coarse_times", f"about {int(np.median(sizes))} rows share each time: spread evenly over "
                            f"{step_s:g} s", "time_s", int(known.size)))
    out = time_s.copy()
    out[keep] = spread
    return out


def _increasing(time_s: Times, keep: NDArray[np.bool_], findings: list[Finding]) -> NDArray[np.bool_]:
    filled = np.where(keep, time_s, -np.inf)
    newest_before = np.concatenate(([-np.inf], np.maximum.accumulate(filled)[:-1]))
    again = keep & (time_s == newest_before)
    back = keep & (time_s < newest_before)
    repeated, backwards = int(again.sum()), int(back.sum())
    if repeated + backwards > _MOST * int(keep.sum()):
        raise UnusableLog(f"column time_s: {repeated + backwards} of {time_s.size} rows are not later than the rows "
                          "before them: allowed times that increase (sort the log by time_s)")
    if repeated:
        findings.append(Finding("repeated_time", f"{many(repeated)} left out: the time of a row before, first at "
                                f"{time_s[again][0]:.3f} s", "time_s", repeated))
    if backwards:
        findings.append(Finding("backward_time", f"{many(backwards)} left out: earlier than a row before, first at "
                                f"{time_s[back][0]:.3f} s", "time_s", backwards))
    kept: NDArray[np.bool_] = keep & ~again & ~back
    return kept


def _steps(time_s: Times) -> list[Finding]:
    steps_s = np.diff(time_s)
    if steps_s.size < 2:
        return []
    step_s = float(np.median(steps_s))
    uneven = np.abs(steps_s - step_s) > _UNEVEN * step_s
    count = int(uneven.sum())
    if count > max(_MIXED_SHARE * steps_s.size, 1):
        low, high = np.quantile(steps_s, (0.05, 0.95))
        return [Finding("mixed_steps", f"mixed sample time: mostly {step_s:.3g} s, from {low:.3g} to {high:.3g} s",
                        "time_s", count)]
    gaps = steps_s[steps_s > (1.0 + _UNEVEN) * step_s]
    if not gaps.size:
        return []
    at_s = float(time_s[int(np.argmax(steps_s))])
    return [Finding("skipped_times", f"{many(int(gaps.size), 'gap')} in the times, the longest {gaps.max():.3g} s "
                    f"after {at_s:.3f} s (sample time {step_s:.3g} s)", "time_s", int(gaps.size))]
