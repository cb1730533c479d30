"""What the trend and the map remember: one small point a frame, bounded in number."""
from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import islice
from math import hypot
from typing import NamedTuple

from console.frame import Frame

TREND_SPAN_S = 120.0
TREND_POINTS = 2_000
TRACK_POINTS = 6_000
TRACK_STEP_M = 0.8


class Point(NamedTuple):
    """target, applied: kg/ha, None = not known."""

    time_s: float
    target_kg_ha: float | None
    applied_kg_ha: float | None


class Spot(NamedTuple):
    """One place of the outlets, m east and north of the field's origin."""

    east_m: float
    north_m: float
    applied_kg_ha: float | None


def point_of(frame: Frame) -> Point:
    return Point(frame.row.time_s, frame.row.target_rate_kg_ha, frame.row.applied_rate_kg_ha)


def spot_of(frame: Frame) -> Spot | None:
    if frame.place_m is None:
        return None
    return Spot(frame.place_m[0], frame.place_m[1], frame.row.applied_rate_kg_ha)


class History:
    """Grown frame by frame, live. A log that begins anew (time runs back) empties it."""

    def __init__(self) -> None:
        self.points: deque[Point] = deque(maxlen=TREND_POINTS)
        self.track: deque[Spot] = deque(maxlen=TRACK_POINTS)

    def add(self, frame: Frame) -> None:
        if self.points and frame.row.time_s < self.points[-1].time_s:
            self.points.clear()
            self.track.clear()
        if not self.points or frame.row.time_s > self.points[-1].time_s:
            self.points.append(point_of(frame))
        spot = spot_of(frame)
        if spot is not None and self._is_new_place(spot):
            self.track.append(spot)

    def recent(self, span_s: float = TREND_SPAN_S) -> tuple[Point, ...]:
        if not self.points:
            return ()
        first_s = self.points[-1].time_s - span_s
        return tuple(point for point in self.points if point.time_s >= first_s)

    def _is_new_place(self, spot: Spot) -> bool:
        if not self.track:
            return True
        last = self.track[-1]
        return hypot(spot.east_m - last.east_m, spot.north_m - last.north_m) >= TRACK_STEP_M


def points_of(frames: Sequence[Frame], first: int, last: int) -> tuple[Point, ...]:
    """Points of frames first ... last (both in), thinned to what a trend can show."""
    step = max(1, (last - first + 1) // TREND_POINTS)
    return tuple(point_of(frame) for frame in islice(frames, first, last + 1, step))


def spots_of(frames: Sequence[Frame], last: int) -> tuple[Spot, ...]:
    """Places of frames 0 ... last, thinned to what a map can show."""
    step = max(1, (last + 1) // TRACK_POINTS)
    spots = (spot_of(frames[index]) for index in range(0, last + 1, step))
    return tuple(spot for spot in spots if spot is not None)
