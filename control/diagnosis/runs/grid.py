"""Readings on an even time grid: gaps bridged, held or left out, and what is looked at of a
long log."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

WINDOW_ROWS = 20_000  # are looked at one by one, in ...
# ... even stretches: a drive's answer is as well known from them as from a million ...
WINDOWS = 5
# ... where that saves four fifths of the work or more
MAX_ROWS = 5 * WINDOW_ROWS
# one of so many is kept between the windows: at 10 Hz, every two seconds
EVERY_ROW = 20
# of slowly varying sensors that serve as inputs: shorter than a change of slope or supply
SMOOTH_S = 1.5
# a longer gap is left out: at 10 Hz, what a log holds a drive's reading for
MAX_BRIDGED_STEPS = 5.0
# of a step that rows may stand off an even grid, and be taken as they are
EVEN_STEPS = 0.2


class Grid(NamedTuple):
    """From a log's rows to an even grid: short gaps are bridged by straight lines, in data and
    prediction alike.

    Long ones are left out: a line over them would make a long stretch of the noise of the two
    readings at its ends.
    """

    # of the known rows; a long log's windows follow each other without a gap
    clock_s: Array
    rows: npt.NDArray[np.int64]
    even_clock_s: Array
    even_s: Array  # time in the log
    step_s: float
    as_is: bool  # every row is known and evenly spaced

    def of(self, series: Array) -> Array:
        """Series over the log's rows (..., rows) on the grid (..., m)."""
        if self.as_is:
            return series[..., self.rows]
        if series.ndim == 1:
            return np.interp(self.even_clock_s, self.clock_s, series[self.rows])
        return np.array(
            [np.interp(self.even_clock_s, self.clock_s, one[self.rows]) for one in series]
        )


def join_clock(time: Array, step_s: float, seam_s: float = 0.0) -> Array:
    """The clock of readings at `time` (m,), long gaps left out but for a step, or `seam_s`
    where that is longer."""
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
    as_is = count == len(rows) and bool(np.allclose(inner, even, atol=EVEN_STEPS * step_s))
    there = np.interp(even, inner, time[rows])
    return Grid(inner, rows, even, there, step_s, as_is)


def hold_last_value(series: Array) -> Array:
    """Last known value; before the first, that one."""
    known = np.isfinite(series)
    if not known.any():
        return series
    at = np.maximum.accumulate(np.where(known, np.arange(len(series)), -1))
    return np.asarray(series[np.where(at < 0, np.argmax(known), at)])


def bridge_gaps(time: Array, series: Array, instead: Array, longest_s: float = np.inf) -> Array:
    """A series with its gaps bridged by straight lines; `instead` in the longer ones, or where
    nothing is known."""
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


def smooth_series(series: Array, step_s: float) -> Array:
    half = int(round(0.5 * SMOOTH_S / step_s))
    if half < 1:
        return series
    padded = np.concatenate((np.full(half, series[0]), series, np.full(half, series[-1])))
    total = np.concatenate(([0.0], np.cumsum(padded)))
    width = 2 * half + 1
    return np.asarray((total[width:] - total[:-width]) / width)


def select_windows(time: Array, step_s: float) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """Rows of a log that are looked at row by row, their clock without the gaps, and the time
    since their window began.

    A drive's answer to its command is as well known after twenty thousand rows as after a
    million.
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
    """Which of `count` rows are looked at one by one: all, or WINDOWS even stretches of
    WINDOW_ROWS in all."""
    if count <= MAX_ROWS:
        return np.arange(count)
    each = WINDOW_ROWS // WINDOWS
    starts = np.linspace(0, count - each, WINDOWS).astype(np.int64)
    return (starts[:, None] + np.arange(each)).ravel()


def select_known_rows(count: int) -> npt.NDArray[np.int64]:
    """Rows at which the recorded variables are kept: all, or those looked at and every
    EVERY_ROW-th of the others."""
    rows = choose_row_windows(count)
    return rows if len(rows) == count else np.union1d(rows, np.arange(0, count, EVERY_ROW))
