"""When was each row recorded? Seconds since the beginning, strictly increasing; what was wrong
is repaired and reported.

Where times run backwards, either the rows were reordered or the clock was set back. Reordered
rows fill each other's gaps once they are sorted, while stretches of a clock that was set back
overlap. Reordered rows are sorted. Of overlapping stretches the fewest rows are left out that
make the rest increase: all but a longest increasing subsequence [1]_.

.. [1] Schensted, Longest increasing and decreasing subsequences, Canadian Journal of
Mathematics 13, 1961."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.control.recordings.finding import Finding, many

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]

# Rows closer than this have the same time, s: the finest clocks count whole microseconds.
SAME_TIME_S = 5e-7
# Times larger than this count from an epoch, s: a log does not last eleven days.
EPOCH_S = 1e6
# Times larger than this count milliseconds from an epoch.
EPOCH_MS = 1e11
DAY_S = 86_400.0
# Days since 1899-12-30, as spreadsheets count: 1982 to 2119.
SPREADSHEET_DAYS = (30_000, 80_000)
# 1970-01-01 in days of a spreadsheet.
SPREADSHEET_EPOCH_DAYS = 25_569
# Few loggers are as slow as this step, s.
LONG_STEP_S = 60.0
# Digits of a second in days of a spreadsheet that were printed with nine digits after the point.
SPREADSHEET_DIGITS = 4
# Least median step of times that may be milliseconds, where utc proves it.
MAX_MILLISECOND_STEP = 5.0
# Ratio of the spans of time_s and utc that proves milliseconds.
MILLISECOND_RATIO = (900.0, 1100.0)
# A step that differs from the median by more than this share is another sample time.
MIXED_STEP = 0.25
# The sample time is mixed where this share of the rows has another one.
MIXED_ROWS_SHARE = 0.2
# A step longer than this many medians has missing rows.
GAP_STEPS = 1.5
# Where more than this share of the rows would be left out, the times are unusable.
MAX_LEFT_OUT_SHARE = 0.5


class RecordingTimes(NamedTuple):
    """Holds the repaired times (m,) of the rows `rows` (m,) of the recording. `spread`: rows
    that shared a coarse time were spread over it."""

    time_s: Floats
    rows: Rows | slice
    findings: tuple[Finding, ...]
    spread: bool = False


def mend_times(
    time_s: Floats, utc_s: Callable[[], Floats] | None = None, begins: Rows | None = None
) -> RecordingTimes:
    """Returns times as seconds from 0 or a little later, strictly increasing.

    Parameters
    ----------
    time_s : (n,) times; NaN where there is none.
    utc_s : returns seconds since 1970 (n,) where the recording has them in another column;
        called where they may decide on the unit.
    begins : (b,) rows with which each of several joined files begins.

    Raises
    ------
    ValueError : in one line, where no rows, or less than half of them, can be used."""
    findings: list[Finding] = []
    with_time = np.isfinite(time_s)
    if not with_time.any():
        raise ValueError("column time_s: no number in it: allowed seconds since the log began")
    if not with_time.all():
        lost = int(np.sum(~with_time))
        findings.append(Finding("no_time", f"{many(lost)} without a time left out", "time_s", lost))
    rows = np.flatnonzero(with_time)
    all_there = len(rows) == len(time_s)
    seconds = convert_to_seconds(
        time_s if all_there else time_s[rows],
        None if utc_s is None else lambda: utc_s()[rows],
        findings,
    )
    spread = _spread_coarse_times(seconds, findings)
    were_coarse, seconds = spread is not seconds, spread
    kept = find_increasing_rows(seconds, findings)
    if len(kept) < len(seconds) or np.any(np.diff(kept) < 0):
        seconds, rows, as_they_are = seconds[kept], rows[kept], False
    else:
        as_they_are = all_there
    starts = np.isin(rows, [] if begins is None else begins)
    return RecordingTimes(
        seconds,
        slice(None) if as_they_are else rows,
        (*findings, *report_steps(seconds, starts)),
        were_coarse,
    )


def convert_to_seconds(
    times: Floats, utc_s: Callable[[], Floats] | None, findings: list[Finding]
) -> Floats:
    """Converts times (n,) in days of a spreadsheet, of an epoch, or in milliseconds to seconds."""
    first = float(times[0])
    forward = np.diff(times)
    forward = forward[forward > 0.0]
    if (
        SPREADSHEET_DAYS[0] < first < SPREADSHEET_DAYS[1]
        and forward.size
        and np.median(forward) < LONG_STEP_S / DAY_S
    ):
        findings.append(
            Finding(
                "excel_days",
                "times are days as spreadsheets count them: taken as seconds since the first row",
                "time_s",
            )
        )
        return np.asarray(np.round((times - first) * DAY_S, SPREADSHEET_DIGITS))
    if abs(first) > EPOCH_MS:
        findings.append(
            Finding(
                "milliseconds",
                "times are milliseconds since an epoch: taken as seconds since the first row",
                "time_s",
            )
        )
        return (times - first) / 1000.0
    if abs(first) > EPOCH_S:
        findings.append(
            Finding(
                "epoch", "times count from an epoch: taken as seconds since the first row", "time_s"
            )
        )
        times = times - first
    if utc_s is not None and times.size > 2 and np.median(np.diff(times)) >= MAX_MILLISECOND_STEP:
        seconds = utc_s()
        both = np.isfinite(seconds)
        if (
            both.any()
            and MILLISECOND_RATIO[0]
            < np.ptp(times[both]) / max(float(np.ptp(seconds[both])), 1e-3)
            < MILLISECOND_RATIO[1]
        ):
            findings.append(
                Finding(
                    "milliseconds",
                    "times are milliseconds (as utc shows): taken as seconds",
                    "time_s",
                )
            )
            return times / 1000.0
    return times


def _spread_coarse_times(times: Floats, findings: list[Finding]) -> Floats:
    """Spreads rows that share one coarse time, e.g. whole seconds at 10 Hz, evenly over it."""
    starts = np.flatnonzero(np.diff(times, prepend=np.nan) != 0)
    sizes = np.diff(starts, append=times.size)
    if times.size < 4 or np.median(sizes) < 2 or np.any(np.diff(times) < 0) or starts.size < 2:
        return times
    step_s = float(np.median(np.diff(times[starts])))
    findings.append(
        Finding(
            "coarse_times",
            f"about {int(np.median(sizes))} rows share each time: spread evenly over {step_s:g} s",
            "time_s",
            int(times.size),
        )
    )
    return np.asarray(
        times
        + step_s * (np.arange(times.size) - np.repeat(starts, sizes)) / np.repeat(sizes, sizes)
    )


def find_increasing_rows(times: Floats, findings: list[Finding]) -> Rows:
    """Returns the rows (m,) of times (n,) in an order in which each is later than the one
    before.

    Of rows that share a time the first is kept. Raises ValueError where most rows would be left
    out."""
    every = np.arange(len(times))
    if np.all(np.diff(times) > SAME_TIME_S):
        return every
    order = every
    if np.any(np.diff(times) < 0.0):
        order = np.asarray(_find_longest_increasing(times))
        if _are_rows_reordered(times, order):
            order = np.argsort(times, kind="stable")
            moved = int(np.sum(order != every))
            findings.append(
                Finding(
                    "row_order",
                    f"rows do not stand in order of time ({moved} of {len(times)}): taken "
                    "in order of time",
                    "time_s",
                    moved,
                )
            )
    kept = order[np.concatenate(([True], np.diff(times[order]) > SAME_TIME_S))]
    left_out = np.setdiff1d(every, kept)
    if len(left_out) > MAX_LEFT_OUT_SHARE * len(times):
        raise ValueError(
            f"column time_s: {len(left_out)} of {len(times)} rows are not later than the "
            "rows before "
            "them: allowed times that increase (sort the log by time_s)"
        )
    _report_left_out(times, kept, left_out, findings)
    return kept


def _report_left_out(times: Floats, kept: Rows, left_out: Rows, findings: list[Finding]) -> None:
    """Reports why each row was left out."""
    at = np.searchsorted(times[kept], times[left_out])
    off = np.minimum(
        np.abs(times[kept][np.minimum(at, len(kept) - 1)] - times[left_out]),
        np.abs(times[kept][np.maximum(at - 1, 0)] - times[left_out]),
    )
    again = off <= SAME_TIME_S
    # Index of the last kept row before each row that was left out.
    before = np.searchsorted(kept, left_out) - 1
    earlier = ~again & (before >= 0) & (times[left_out] < times[kept[np.maximum(before, 0)]])
    for which, id_, what in (
        (again, "repeated_time", "the time of a row before"),
        (earlier, "backward_time", "earlier than a row before"),
        (~again & ~earlier, "forward_time", "later than a row after"),
    ):
        if which.any():
            count = int(which.sum())
            findings.append(
                Finding(
                    id_,
                    f"{many(count)} left out: {what}, first at {times[left_out][which][0]:.3f} s",
                    "time_s",
                    count,
                )
            )


def _are_rows_reordered(times: Floats, rising: Rows) -> bool:
    """Returns whether rows that do not rise with the others were only reordered: once sorted,
    they lie within the span of the others or are most of the rows, and their steps are usual."""
    others = np.setdiff1d(np.arange(len(times)), rising)
    in_order = np.sort(times)
    step = float(np.median(np.diff(in_order)))
    if step <= SAME_TIME_S:
        return False
    inside = (times[others] > times[rising[0]]) & (times[others] < times[rising[-1]])
    if not inside.all() and len(others) <= MAX_LEFT_OUT_SHARE * len(times):
        return False
    at = np.searchsorted(in_order, times[others])
    padded = np.concatenate(([-np.inf], in_order, [np.inf]))
    near = np.minimum(padded[at + 1] - padded[at], padded[at + 2] - padded[at + 1])
    return bool(np.mean(near < (1.0 - MIXED_STEP) * step) <= MIXED_ROWS_SHARE)


def _find_longest_increasing(times: Floats) -> list[int]:
    """Returns the rows of a longest subsequence of strictly increasing times, by patience
    sorting (n log n). It runs from the last row to the first, so that of equally long ones the
    earliest rows are taken."""
    written = times.tolist()
    tops: list[float] = []
    # Rows on the tops of the piles, and for each row the one that follows it.
    rows: list[int] = []
    after = [-1] * len(written)
    for row in range(len(written) - 1, -1, -1):
        at = bisect_left(tops, -written[row])
        after[row] = rows[at - 1] if at else -1
        if at == len(tops):
            tops.append(-written[row])
            rows.append(row)
        else:
            tops[at], rows[at] = -written[row], row
    found, row = [], rows[-1]
    while row >= 0:
        found.append(row)
        row = after[row]
    return found


def report_steps(time_s: Floats, begins: NDArray[np.bool_]) -> list[Finding]:
    """Reports missing rows and mixed sample times. begins (n,): rows with which another file
    begins; no rows are missing before them."""
    between = begins[1:]
    before_s, spans = time_s[:-1][~between], np.diff(time_s)[~between]
    if spans.size < 2:
        return []
    step = float(np.median(spans))
    findings = _report_joined_files(np.diff(time_s)[between], step)
    if np.mean(np.abs(spans / step - 1.0) > MIXED_STEP) > MIXED_ROWS_SHARE:
        low, high = np.quantile(spans, (0.05, 0.95))
        return [
            *findings,
            Finding(
                "mixed_steps",
                f"mixed sample time: mostly {step:.3g} s, from {low:.3g} to {high:.3g} s",
                "time_s",
                int(np.sum(np.abs(spans / step - 1.0) > MIXED_STEP)),
            ),
        ]
    gaps = spans > GAP_STEPS * step
    if not gaps.any():
        return findings
    missing = int(np.round(spans / step - 1.0)[gaps].sum())
    at_s, share = float(before_s[int(np.argmax(spans))]), 100.0 * missing / (len(time_s) + missing)
    count = int(gaps.sum())
    return [
        *findings,
        Finding(
            "skipped_times",
            f"{many(count, 'gap')} in the times, the longest {spans.max():.3g} s "
            f"after {at_s:.3f} s (sample time {step:.3g} s): about {many(missing, 'row')} missing "
            f"({share:.1f} %)",
            "time_s",
            count,
        ),
    ]


def _report_joined_files(between_s: Floats, step_s: float) -> list[Finding]:
    """Reports that a log consists of several files. between_s (files - 1,): from the last row of
    a file to the first of the next."""
    apart_s = between_s[between_s > GAP_STEPS * step_s]
    if not apart_s.size:
        return []
    low, high = float(apart_s.min()), float(apart_s.max())
    apart = f"{high:.3g} s" if low > 0.95 * high else f"{low:.3g} to {high:.3g} s"
    return [
        Finding(
            "joined",
            f"{len(between_s) + 1} files in one log, {apart} from one to the next: no rows are "
            "missing there",
            "time_s",
        )
    ]
