"""Resamples readings onto an even time grid: bridges, holds or removes gaps, and selects the
examined rows of a long log.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.signals import SIGNALS

Array = npt.NDArray[np.float64]

# Number of rows of a long log that are examined one by one.
WINDOW_ROWS = 20_000
# Number of equal windows of these rows: they show a drive's answer as well as a million rows do.
WINDOW_COUNT = 5
# Longest log that is examined in full: a longer log saves four fifths of the work by windows.
MAX_ROWS = 5 * WINDOW_ROWS
# Between the windows, one of this many rows is kept: every two seconds at 10 Hz.
ROW_STRIDE = 20
# Smoothing time of a slow sensor, s.
SMOOTH_S = 1.5
# Time over which a running mean smooths each measured input of a stage, s. Commands, readings of
# the drives and the heading are used as read; columns that are not declared are smoothed like the
# supply.
INPUT_SMOOTHING_S = {
    name: one.smoothed_s for name, one in SIGNALS.items() if one.smoothed_s is not None
}
# Longest bridged gap in steps; at 10 Hz, the time for which a log holds a drive's reading.
MAX_BRIDGED_STEPS = 5.0
# Maximum deviation of rows from an even grid, in steps, for the rows to be used without
# interpolation.
MAX_STEP_ERROR = 0.2


class Grid(NamedTuple):
    """Mapping from a log's rows to an even grid: short gaps are bridged by straight lines, in data
    and prediction alike.

    Long gaps are left out, because a line across the gap would stretch the noise of the two
    readings at its ends.
    """

    # Time axis of the valid rows, s; the windows of a long log follow each other without a gap.
    clock_s: Array
    rows: npt.NDArray[np.int64]
    even_clock_s: Array
    # Time in the log, s.
    even_s: Array
    step_s: float
    # Whether every row is valid and evenly spaced.
    as_is: bool

    def interpolate(self, series: Array) -> Array:
        """Interpolate series over the log's rows (..., rows) to the grid (..., m)."""
        if self.as_is:
            return series[..., self.rows]
        if series.ndim == 1:
            return np.interp(self.even_clock_s, self.clock_s, series[self.rows])
        return np.array(
            [np.interp(self.even_clock_s, self.clock_s, one[self.rows]) for one in series]
        )


def join_clock(time: Array, step_s: float, seam_s: float = 0.0) -> Array:
    """Return the time axis of readings at `time` (m,) without long gaps. A gap shrinks to a step,
    or to `seam_s` where that is longer."""
    spans = np.diff(time)
    spans = np.where(spans > MAX_BRIDGED_STEPS * step_s, np.clip(seam_s, step_s, spans), spans)
    return np.asarray(time[0] + np.concatenate(([0.0], np.cumsum(spans))))


def make_grid(
    time: Array,
    known: npt.NDArray[np.bool_],
    step_s: float,
    clock: Array | None = None,
    seam_s: float = 0.0,
) -> Grid:
    rows = np.flatnonzero(known)
    inner = (time if clock is None else clock)[rows]
    inner = join_clock(inner, step_s, seam_s)
    count = max(2, int(np.floor((inner[-1] - inner[0]) / step_s + 1e-6)) + 1)
    even = inner[0] + step_s * np.arange(count)
    as_is = count == len(rows) and bool(np.allclose(inner, even, atol=MAX_STEP_ERROR * step_s))
    # An even log keeps the times of its rows: a rounding error would move an onset by a row.
    there = time[rows] if as_is else np.interp(even, inner, time[rows])
    return Grid(inner, rows, even, there, step_s, as_is)


def hold_last_value(series: Array) -> Array:
    """Replace missing values with the last valid value, or before the first valid value with that
    value."""
    known = np.isfinite(series)
    if not known.any():
        return series
    at = np.maximum.accumulate(np.where(known, np.arange(len(series)), -1))
    return np.asarray(series[np.where(at < 0, np.argmax(known), at)])


def bridge_gaps(time: Array, series: Array, instead: Array, longest_s: float = np.inf) -> Array:
    """Bridge the gaps of a series by straight lines. `instead` fills longer gaps, and the whole
    series where nothing is valid."""
    known = np.isfinite(series)
    if not known.any():
        return instead
    bridged = np.interp(time, time[known], series[known])
    held = np.maximum.accumulate(np.where(known, np.arange(len(series)), -1))
    ahead = (
        len(series)
        - 1
        - np.maximum.accumulate(np.where(known[::-1], np.arange(len(series)), -1))[::-1]
    )
    last, following = time[np.maximum(held, 0)], time[np.minimum(ahead, len(series) - 1)]
    gap_s = np.where((held < 0) | (ahead >= len(series)), np.inf, following - last)
    return np.where(~known & (gap_s > longest_s) & np.isfinite(instead), instead, bridged)


def smooth_input(name: str, series: Array, step_s: float) -> Array:
    """Return an input of a stage, smoothed as `INPUT_SMOOTHING_S` says."""
    return smooth_series(series, step_s, INPUT_SMOOTHING_S.get(name, SMOOTH_S))


def smooth_series(series: Array, step_s: float, span_s: float = SMOOTH_S) -> Array:
    """Return the running mean of a series over `span_s`."""
    half = int(round(0.5 * span_s / step_s))
    if half < 1:
        return series
    padded = np.concatenate((np.full(half, series[0]), series, np.full(half, series[-1])))
    total = np.concatenate(([0.0], np.cumsum(padded)))
    width = 2 * half + 1
    return np.asarray((total[width:] - total[:-width]) / width)


def select_windows(time: Array, step_s: float) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """Return the rows of a log that are examined one by one, their time axis without the gaps, and
    the time since their window began, s.

    Twenty thousand rows determine a drive's answer as well as a million rows.
    """
    rows = choose_row_windows(len(time))
    if len(rows) == len(time):
        return rows, time, time - time[0]
    spans = np.diff(time[rows], prepend=time[rows[0]])
    seam = np.diff(rows, prepend=rows[0]) > 1
    clock = time[rows[0]] + np.cumsum(np.where(seam, step_s, spans))
    started = np.maximum.accumulate(np.where(seam, clock, clock[0]))
    return rows, clock, clock - started


def choose_row_windows(count: int) -> npt.NDArray[np.int64]:
    """Return which of `count` rows are examined one by one: all, or WINDOW_COUNT equal windows of
    WINDOW_ROWS in total."""
    if count <= MAX_ROWS:
        return np.arange(count)
    each = WINDOW_ROWS // WINDOW_COUNT
    starts = np.linspace(0, count - each, WINDOW_COUNT).astype(np.int64)
    return (starts[:, None] + np.arange(each)).ravel()


def select_known_rows(count: int) -> npt.NDArray[np.int64]:
    """Return the rows at which the recorded variables are kept: all, or the examined rows and every
    ROW_STRIDE-th of the others."""
    rows = choose_row_windows(count)
    return rows if len(rows) == count else np.union1d(rows, np.arange(0, count, ROW_STRIDE))
