"""Stores the history that plots and map show, with memory bounded for a day of any length."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import NamedTuple

from topdress.console.app.coverage_raster import OutletSpot, WorkedGround, make_spot
from topdress.console.app.panel_views import find_applied_kg_ha
from topdress.console.app.trend_series import LogSeries, SeriesPyramid
from topdress.console.frame import Frame

# Time span of the trend on the Run page, s.
TREND_SPAN_S = 120.0
# More points than a wide terminal has columns, for a trend of two minutes at the worker's rate.
MAX_TREND_POINTS = 2_000
# Frames entered per call: the screen must respond while a long log is read.
MAX_FRAMES_PER_CALL = 10_000


class TrendPoint(NamedTuple):
    """Holds target and applied rate at one time, kg/ha; None means unknown."""

    time_s: float
    target_kg_ha: float | None
    applied_kg_ha: float | None


def make_point(frame: Frame) -> TrendPoint:
    """Return the trend point of a frame."""
    return TrendPoint(frame.row.time_s, frame.row.target_rate_kg_ha, find_applied_kg_ha(frame.row))


class LiveHistory:
    """Grows frame by frame while the machine runs. A log that begins anew (time decreases) clears
    it."""

    def __init__(self) -> None:
        self.points: deque[TrendPoint] = deque(maxlen=MAX_TREND_POINTS)
        self.worked = WorkedGround()
        self.series = SeriesPyramid()

    def add_frame(self, frame: Frame) -> None:
        """Add a frame."""
        if self.points and frame.row.time_s < self.points[-1].time_s:
            self.points.clear()
            self.worked.clear_ground()
            self.series.clear_levels()
        if not self.points or frame.row.time_s > self.points[-1].time_s:
            self.points.append(make_point(frame))
            self.series.add_frame(frame)
        spot = make_spot(frame)
        if spot is not None:
            self.worked.add_spots((spot,))

    def add_earlier_ground(self, places: Iterable[tuple[float, float, float, float]]) -> None:
        """Add ground that was worked before the first frame.

        Parameters
        ----------
        places
            East m, north m, heading degrees and applied kg/ha, in driving order.
        """
        unknown = float("nan")
        self.worked.add_earlier_spots([OutletSpot(*place, unknown, unknown) for place in places])

    def list_recent_points(self, span_s: float = TREND_SPAN_S) -> tuple[TrendPoint, ...]:
        """Return the points of the last `span_s` seconds."""
        if not self.points:
            return ()
        first_s = self.points[-1].time_s - span_s
        return tuple(point for point in self.points if point.time_s >= first_s)


class LogHistory:
    """Holds the history of a log: worked ground up to any frame, and the series of all frames."""

    def __init__(self, frames: Sequence[Frame]) -> None:
        self.frames = frames
        self.series = LogSeries(frames)
        self.worked = WorkedGround()
        self._entered = 0

    def enter_up_to(self, last: int, most: int = MAX_FRAMES_PER_CALL) -> bool:
        """Enter frames up to `last` (included) into `worked`, in parts so that the screen responds.

        Parameters
        ----------
        last
            Index of the last frame to enter. A smaller index than before clears the ground and
            starts anew.
        most
            Number of frames per call.

        Returns
        -------
        bool
            True when all frames are entered.
        """
        if last + 1 < self._entered:
            self.worked.clear_ground()
            self._entered = 0
        end = min(last + 1, self._entered + most)
        spots = (make_spot(frame) for frame in islice(self.frames, self._entered, end))
        self.worked.add_spots([spot for spot in spots if spot is not None])
        self._entered = end
        return end == last + 1


def sample_points(frames: Sequence[Frame], first: int, last: int) -> tuple[TrendPoint, ...]:
    """Return points of frames `first` to `last` (both included), thinned to `MAX_TREND_POINTS`."""
    step = max(1, (last - first + 1) // MAX_TREND_POINTS)
    return tuple(make_point(frame) for frame in islice(frames, first, last + 1, step))
