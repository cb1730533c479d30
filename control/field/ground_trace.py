"""Traces the outlets over the ground, also without a known position: while GNSS is silent, work
continues by the wheel. When the position returns, the path between becomes done ground.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf, nan

from topdress.control.field.coverage import Coverage
from topdress.control.geodesy import (
    Place,
    calc_plane_distance_m,
    calc_turn_deg,
    find_unit_vector,
    offset_place,
)

Flowing = bool | Sequence[bool]
# Position, heading in degrees, and the material that landed up to this position.
PassedPlace = tuple[Place, float, Flowing]

# Maximum length of a path without a position, m: 80 s at 1.25 m/s.
MAX_UNLOCATED_PATH_M = 100.0
# Length of the recorded pieces of such a path, m: at least a cell of the coverage.
PIECE_LENGTH_M = 0.25
# Distance between recorded positions along the path, m: below the maximum step of
# `DoneGroundAhead`.
STEP_LENGTH_M = 1.0
# Slip of a trusted wheel as a share of the path, up to which wheel and positions agree.
TRUSTED_WHEEL_SLIP_SHARE = 0.1
# Standard deviation of a plain receiver's position, m.
PLACE_SD_M = 2.0
# Lateral deviation of an assumed straight path, as a share of its length, without a measured
# course.
LATERAL_SD_OF_PATH = 0.05
# Tangent of 30 degrees: a path that turns by more between two positions is unknown.
MAX_TURN_TANGENT = 0.58


class UnlocatedPath:
    """A path from the last known position, with the material that landed along it."""

    def __init__(self, place: Place, heading_deg: float) -> None:
        self.way_m = 0.0
        self.has_landed = False
        self._place, self._heading_deg = place, heading_deg
        # Path length up to which, and whether, material landed, by strip where the coverage has
        # several.
        self._pieces: list[tuple[float, Flowing]] = []

    def extend_way(self, way_m: float, flowing: Flowing) -> None:
        """Extend the path by the distance that the outlets have moved, m."""
        self.way_m += way_m
        self.has_landed |= _is_any_flowing(flowing)
        begin_m = self._pieces[-2][0] if len(self._pieces) > 1 else 0.0
        if self._pieces and (
            self._pieces[-1][1] == flowing or self._pieces[-1][0] - begin_m < PIECE_LENGTH_M
        ):
            flowing = _combine_flowing(self._pieces.pop()[1], flowing)
        self._pieces.append((self.way_m, flowing))

    def connect_to(self, place: Place, heading_deg: float) -> list[PassedPlace] | None:
        """Return the path to the returned position as a smooth curve between both courses; None
        where the wheel's distance disagrees, or the path turns too much."""
        for course in (self._heading_deg, heading_deg):
            ahead_m, aside_m = _resolve_components(self._place, place, course)
            if ahead_m <= 0.0 or abs(aside_m) > PLACE_SD_M + MAX_TURN_TANGENT * ahead_m:
                return None
        if (
            abs(calc_plane_distance_m(self._place, place) - self.way_m)
            > PLACE_SD_M + TRUSTED_WHEEL_SLIP_SHARE * self.way_m
        ):
            return None
        curve = _Curve(
            self._place, find_unit_vector(self._heading_deg), place, find_unit_vector(heading_deg)
        )
        turn = calc_turn_deg(self._heading_deg, heading_deg)
        shares = [(way_m / self.way_m, flowing) for way_m, flowing in self._iterate_steps(inf)]
        return [
            (curve.interpolate_place(share), self._heading_deg + share * turn, flowing)
            for share, flowing in shares
        ]

    def extend_straight(self, width_m: float) -> list[PassedPlace]:
        """Return the path as a straight line, as far as outlets of this width would be within
        half their width of the true path."""
        return [
            (offset_place(self._place, self._heading_deg, way_m), self._heading_deg, flowing)
            for way_m, flowing in self._iterate_steps(0.5 * width_m / LATERAL_SD_OF_PATH)
        ]

    def _iterate_steps(self, most_m: float) -> Iterator[tuple[float, Flowing]]:
        """Yield the ends of the steps, m, and the material that landed in each."""
        at_m = 0.0
        for end_m, flowing in self._pieces:
            while at_m < min(end_m, most_m):
                at_m = min(end_m, most_m, at_m + STEP_LENGTH_M)
                yield at_m, flowing


class GroundTrace:
    """Updates a coverage with the outlets' positions, one call a tick."""

    def __init__(self, coverage: Coverage) -> None:
        self.coverage = coverage
        # Last known position and heading.
        self._last: tuple[Place, float] | None = None
        self._unplaced: UnlocatedPath | None = None

    def pass_over(
        self, place: Place | None, heading_deg: float | None, flowing: Flowing, way_m: float
    ) -> tuple[float, bool] | None:
        """Record the outlets' position.

        Parameters
        ----------
        place, heading_deg: None where the position, m, or the course is unknown. flowing: whether
        material lands, by strip where the coverage has several. way_m: distance since the last
        call, by the speed, m; negative for reversing.

        Returns
        -------
        When the position is known again: the distance without a position on which material landed,
        m, and whether that ground is done now; else None.
        """
        if place is None or heading_deg is None:
            self._extend_unplaced(way_m, flowing)
            return None
        found = self._close_way(place, heading_deg, flowing, way_m)
        self.coverage.extend_to(place, heading_deg, flowing)
        self._last = place, heading_deg
        return found

    def reckon_open_way(self) -> list[PassedPlace]:
        """Return the open path without a position as a straight line; empty where there is none."""
        if self._unplaced is None or not self._unplaced.has_landed or self._last is None:
            return []
        begin = (*self._last, self.coverage.no_flow)
        return [begin, *self._unplaced.extend_straight(self.coverage.width_m)]

    def _extend_unplaced(self, way_m: float, flowing: Flowing) -> None:
        if self._unplaced is None and self._last is not None:
            self._unplaced = UnlocatedPath(*self._last)
        if self._unplaced is None:
            return
        if way_m < 0.0 or self._unplaced.way_m + way_m > MAX_UNLOCATED_PATH_M:
            self._unplaced = self._last = None
            self._end_stretch()
            return
        self._unplaced.extend_way(way_m, flowing)

    def _close_way(
        self, place: Place, heading_deg: float, flowing: Flowing, way_m: float
    ) -> tuple[float, bool] | None:
        unplaced, self._unplaced = self._unplaced, None
        if unplaced is None:
            return None
        unplaced.extend_way(max(0.0, way_m), flowing)
        passed = unplaced.connect_to(place, heading_deg)
        for one in passed or ():
            self.coverage.extend_to(*one)
        if passed is None:
            self._end_stretch()
        return (unplaced.way_m, passed is not None) if unplaced.has_landed else None

    def _end_stretch(self) -> None:
        self.coverage.extend_to((nan, nan), 0.0, self.coverage.no_flow)


class _Curve:
    """A cubic Hermite curve from one position to another, along both courses."""

    def __init__(self, begin: Place, begins: Place, end: Place, ends: Place) -> None:
        length_m = calc_plane_distance_m(begin, end)
        self._begin, self._end = begin, end
        self._out, self._in = (
            (length_m * course[0], length_m * course[1]) for course in (begins, ends)
        )

    def interpolate_place(self, share: float) -> Place:
        """Return the position at a share of the curve, 0 to 1."""
        s, rest = share, 1.0 - share
        weights = (
            rest * rest * (1.0 + 2.0 * s),
            s * rest * rest,
            s * s * (3.0 - 2.0 * s),
            -s * s * rest,
        )
        parts = (self._begin, self._out, self._end, self._in)
        east, north = (
            sum(w * part[k] for w, part in zip(weights, parts, strict=True)) for k in (0, 1)
        )
        return east, north


def _resolve_components(begin: Place, end: Place, heading_deg: float) -> Place:
    """Return the components of the vector between two positions ahead and to the right of a
    heading, m."""
    east, north = find_unit_vector(heading_deg)
    to_east, to_north = end[0] - begin[0], end[1] - begin[1]
    return to_east * east + to_north * north, to_east * north - to_north * east


def _is_any_flowing(flowing: Flowing) -> bool:
    return flowing if isinstance(flowing, bool) else any(flowing)


def _combine_flowing(one: Flowing, other: Flowing) -> Flowing:
    if isinstance(one, bool) or isinstance(other, bool):
        return _is_any_flowing(one) or _is_any_flowing(other)
    return tuple([a or b for a, b in zip(one, other, strict=True)])
