"""Calculates lowest, highest and mean values of a channel over time spans: live in a pyramid of
bounded size, or from a whole log.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from topdress.console.app.trend_channels import CHANNEL_INDEX, CHANNELS, find_value, list_values
from topdress.console.frame import Frame

Floats = npt.NDArray[np.float64]

# Widths of a bucket, s, from level to level; each level reaches about four times as far back.
BUCKET_WIDTHS_S = (0.2, 1.0, 4.0, 16.0, 64.0)
# Buckets that each level keeps: 7 min, 34 min, 2.3 h, 9 h, 36 h.
BUCKETS_PER_LEVEL = 2_048


class TrendStretch(NamedTuple):
    """Holds buckets in order of time.

    Attributes
    ----------
    time_s
        Time of a bucket's first row, s.
    low, high, mean
        Values; NaN where nothing was known.
    counts
        Number of known values.
    """

    time_s: Floats
    low: Floats
    high: Floats
    mean: Floats
    counts: Floats


class StretchSummary(NamedTuple):
    """Holds lowest, mean and highest value of a span; NaN where nothing was known."""

    low: float
    mean: float
    high: float


class TrendSeries(Protocol):
    """Provides the data of a trend. Times are s of the run."""

    @property
    def start_s(self) -> float | None:
        """Earliest stored time; None before the first row."""

    @property
    def end_s(self) -> float | None: ...

    def find_stretch(self, channel: str, from_s: float, to_s: float, buckets: int) -> TrendStretch:
        """Return a channel between two times in about `buckets` pieces or more, as far as it is
        stored."""


def summarise_stretch(stretch: TrendStretch) -> StretchSummary:
    """Return lowest, mean and highest value of a stretch. The mean weights all rows equally, not
    the buckets."""
    known = stretch.counts > 0
    if not known.any():
        return StretchSummary(np.nan, np.nan, np.nan)
    weight = stretch.counts[known]
    return StretchSummary(
        float(stretch.low[known].min()),
        float((stretch.mean[known] * weight).sum() / weight.sum()),
        float(stretch.high[known].max()),
    )


class _ChannelRow(NamedTuple):
    """Holds a row of all channels, calculated once for all levels: (value, negated value), and
    (value or 0, 1 where known)."""

    extremes: Floats
    totals: Floats


class _BucketLevel:
    """Holds buckets of one width for all channels; the oldest half is dropped when twice `kept`
    buckets exist.

    `extremes[bucket]` has lowest value and lowest negated value; `totals[bucket]` has sum and
    count.
    """

    def __init__(self, width_s: float, kept: int) -> None:
        self.width_s, self.kept = width_s, kept
        # No bucket has the number -1, so the first row begins one.
        self.size, self.number = 0, -1
        # Twice the kept buckets: moving memory once per `kept` buckets is cheaper than a ring whose
        # reads need two parts.
        self.time_s: Floats = np.zeros(2 * kept)
        self.extremes: Floats = np.zeros((2 * kept, 2, len(CHANNELS)))
        self.totals: Floats = np.zeros((2 * kept, 2, len(CHANNELS)))

    def add_row(self, time_s: float, row: _ChannelRow) -> None:
        """Add a row to its bucket."""
        # The tolerance assigns a row exactly on the border to the later bucket despite rounding.
        number = int(time_s / self.width_s + 1e-6)
        if number != self.number or self.size == 0:
            self._begin_bucket(number, time_s)
            self.extremes[self.size - 1], self.totals[self.size - 1] = row
            return
        extremes, totals = self.extremes[self.size - 1], self.totals[self.size - 1]
        # `fmin` ignores NaN, unlike `minimum`; a negated value makes the same call yield the
        # maximum.
        np.fmin(extremes, row.extremes, out=extremes)
        np.add(totals, row.totals, out=totals)

    def _begin_bucket(self, number: int, time_s: float) -> None:
        """Begin a bucket; a full level first drops its older half."""
        if self.size == 2 * self.kept:
            for array in (self.time_s, self.extremes, self.totals):
                array[: self.kept] = array[self.kept :]
            self.size = self.kept
        self.time_s[self.size], self.number = time_s, number
        self.size += 1

    @property
    def first_time_s(self) -> float:
        """Time of the oldest bucket, s."""
        return float(self.time_s[0])

    def find_stretch(self, column: int, from_s: float, to_s: float) -> TrendStretch:
        """Return a channel's buckets between two times."""
        times = self.time_s[: self.size]
        # A bucket that began before the span may reach into it.
        begin = max(0, int(np.searchsorted(times, from_s - self.width_s, side="right")))
        end = int(np.searchsorted(times, to_s, side="right"))
        # Copies, because the live arrays change with the next row.
        total, count = self.totals[begin:end, :, column].T.copy()
        low, high = self.extremes[begin:end, :, column].T.copy()
        with np.errstate(invalid="ignore", divide="ignore"):
            return TrendStretch(times[begin:end].copy(), low, -high, total / count, count)


class SeriesPyramid:
    """Grows row by row as a `TrendSeries`. Each level has wider buckets and reaches further back;
    its memory is constant."""

    def __init__(
        self, widths_s: Sequence[float] = BUCKET_WIDTHS_S, kept: int = BUCKETS_PER_LEVEL
    ) -> None:
        self.widths_s, self.kept = tuple(widths_s), kept
        self.clear_levels()

    def clear_levels(self) -> None:
        """Remove all rows."""
        self._levels = [_BucketLevel(width, self.kept) for width in self.widths_s]
        self._started_s: float | None = None
        self._end_s: float | None = None

    @property
    def start_s(self) -> float | None:
        """Earliest stored time of the coarsest level, s; None before the first row."""
        return (
            None if self._started_s is None else max(self._started_s, self._levels[-1].first_time_s)
        )

    @property
    def end_s(self) -> float | None:
        return self._end_s

    @property
    def memory_bytes(self) -> int:
        """Memory of all levels, bytes."""
        return sum(
            array.nbytes
            for level in self._levels
            for array in (level.time_s, level.extremes, level.totals)
        )

    def add_frame(self, frame: Frame) -> None:
        """Add a row; rows arrive in order of time."""
        values = np.array(list_values(frame.row))
        # Unknown values are NaN and count as absent.
        known = np.isfinite(values)
        time_s = frame.row.time_s
        row = _ChannelRow(
            np.array((values, -values)), np.array((np.where(known, values, 0.0), known))
        )
        for level in self._levels:
            level.add_row(time_s, row)
        self._end_s = time_s
        if self._started_s is None:
            self._started_s = time_s

    def find_stretch(self, channel: str, from_s: float, to_s: float, buckets: int) -> TrendStretch:
        """Return a stretch from the coarsest level that has enough buckets and reaches far enough
        back; else from the finest level that reaches far enough."""
        # A span from before the run is shown from the start of the run.
        started = self._started_s or 0.0
        reach = [
            level for level in self._levels if level.first_time_s <= max(from_s, started)
        ] or self._levels[-1:]
        fine = [level for level in reach if level.width_s * buckets <= to_s - from_s]
        return (fine[-1] if fine else reach[0]).find_stretch(CHANNEL_INDEX[channel], from_s, to_s)


class LogSeries:
    """Provides the series of all frames of a log; a channel's values are extracted on first use."""

    def __init__(self, frames: Sequence[Frame]) -> None:
        self._frames = frames
        self._times: Floats = np.array([frame.row.time_s for frame in frames])
        self._values: dict[str, Floats] = {}

    @property
    def start_s(self) -> float | None:
        return float(self._times[0]) if len(self._times) else None

    @property
    def end_s(self) -> float | None:
        return float(self._times[-1]) if len(self._times) else None

    def find_stretch(self, channel: str, from_s: float, to_s: float, buckets: int) -> TrendStretch:
        """Return a stretch of the log in buckets of equal width."""
        # Only plotted channels are extracted: a log has many.
        values = self._values.get(channel)
        if values is None:
            values = self._values[channel] = np.array(
                [find_value(frame.row, channel) for frame in self._frames]
            )
        begin, end = (
            np.searchsorted(self._times, from_s, side="left"),
            np.searchsorted(self._times, to_s, side="right"),
        )
        return _gather_buckets(
            self._times[begin:end], values[begin:end], from_s, (to_s - from_s) / max(1, buckets)
        )


def _gather_buckets(times: Floats, values: Floats, from_s: float, width_s: float) -> TrendStretch:
    """Collect rows in buckets of one width; empty buckets are omitted."""
    if not len(times):
        return TrendStretch(*(np.zeros(0),) * 5)
    number = np.floor((times - from_s) / max(width_s, 1e-9) + 1e-6)
    # A bucket begins where the number changes.
    begins = np.flatnonzero(np.diff(number, prepend=number[0] - 1.0))
    known = np.isfinite(values)
    count = np.add.reduceat(known.astype(np.float64), begins)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.add.reduceat(np.where(known, values, 0.0), begins) / count
    return TrendStretch(
        times[begins],
        np.fmin.reduceat(values, begins),
        np.fmax.reduceat(values, begins),
        mean,
        count,
    )
