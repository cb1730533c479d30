"""Parallel passes over a field, in the order they are driven, and rounds of the headland."""
from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

from shapely.geometry import LineString

from control.field.boundary import Boundary
from control.geodesy import Place, apart_m, direction


class Pass(NamedTuple):
    """A straight piece of work, as it is driven. Swaths are numbered from 0 at the left of the heading asked for."""

    swath: int
    start: Place
    end: Place
    heading_deg: float         # of driving: as asked for, or the opposite

    @property
    def length_m(self) -> float:
        return apart_m(self.start, self.end)


def skip_for(turn_radius_m: float, width_m: float) -> int:
    """Swaths to move on at each turn so that one half circle does: 2 r over the width, at least 1."""
    return max(1, math.ceil(2.0 * turn_radius_m / width_m - 1e-9))


def plan_passes(boundary: Boundary, width_m: float, heading_deg: float, headland_m: float = 0.0, skip: int = 1,
                shortest_m: float = 1.0) -> tuple[Pass, ...]:
    """Passes over the field less its headland, driven to and fro, m on the field's plane.

    The first swath lies along the left end of the field as seen along the heading; the last one is drawn in to stay
    inside the field and overlaps its neighbour. Where a field is concave or has a hole, a swath falls into several
    passes. A pass ends where the middle of the machine meets the edge; pieces below `shortest_m` are left out.
    With `skip` = k every k-th swath is driven first, then those between (wide turns, see `skip_for`).
    Raises ValueError for a width that is not above 0 or a skip below 1. Empty where the headland leaves nothing.
    """
    if not width_m > 0.0:
        raise ValueError(f"width {width_m:g} m: allowed is above 0")
    if skip < 1:
        raise ValueError(f"skip {skip}: allowed is 1 or more")
    work = boundary.inset(headland_m)
    if work.is_empty:
        return ()
    right = direction(heading_deg + 90.0)
    across = [east * right[0] + north * right[1] for ring in work.rings for east, north in ring]
    middles = swath_middles_m(min(across), max(across), width_m)
    passes: list[Pass] = []
    order = [k for first in range(min(skip, len(middles))) for k in range(first, len(middles), skip)]
    for turn, swath in enumerate(order):
        pieces = _pieces(work, middles[swath], heading_deg, shortest_m)
        if turn % 2:
            back = (heading_deg + 180.0) % 360.0
            passes.extend(Pass(swath, end, start, back) for start, end in reversed(pieces))
        else:
            passes.extend(Pass(swath, start, end, heading_deg % 360.0) for start, end in pieces)
    return tuple(passes)


def swath_middles_m(left_m: float, right_m: float, width_m: float) -> list[float]:
    """Middles of the swaths that cover a span from its left end on; the last is drawn in to end with the span.

    A span narrower than the machine gets one swath, in its middle.
    """
    span = right_m - left_m
    if span <= width_m:
        return [0.5 * (left_m + right_m)]
    count = math.ceil(span / width_m - 1e-9)
    return [min(left_m + (k + 0.5) * width_m, right_m - 0.5 * width_m) for k in range(count)]


def headland_rounds(boundary: Boundary, width_m: float, headland_m: float) -> tuple[tuple[Place, ...], ...]:
    """Closed lines round the field and its holes for the middle of the machine, from the edge inwards.

    As many rounds as cover the headland; the last one may reach beyond it into the passes.
    Raises ValueError for a width that is not above 0.
    """
    if not width_m > 0.0:
        raise ValueError(f"width {width_m:g} m: allowed is above 0")
    rounds = math.ceil(headland_m / width_m - 1e-9)
    return tuple((*ring, ring[0]) for k in range(rounds) for ring in boundary.inset((k + 0.5) * width_m).rings)


def idle_m(passes: tuple[Pass, ...]) -> float:
    """Straight-line distance from each pass's end to the next one's start, summed, m: what turning costs at least."""
    return sum(apart_m(one.end, other.start) for one, other in pairwise(passes))


def _pieces(work: Boundary, middle_m: float, heading_deg: float, shortest_m: float) -> list[tuple[Place, Place]]:
    ahead, right = direction(heading_deg), direction(heading_deg + 90.0)
    reach = 1.0 + max(math.hypot(east, north) for ring in work.rings for east, north in ring)
    ends = [(middle_m * right[0] + far * ahead[0], middle_m * right[1] + far * ahead[1]) for far in (-reach, reach)]
    cut = work.shape.intersection(LineString(ends))
    found: list[tuple[Place, Place]] = []
    for piece in getattr(cut, "geoms", [cut]):
        if not isinstance(piece, LineString) or piece.is_empty or piece.length < shortest_m:
            continue
        one, other = (tuple(map(float, piece.coords[k])) for k in (0, -1))
        pair = ((one[0], one[1]), (other[0], other[1]))
        found.append(pair if _along(pair[0], ahead) < _along(pair[1], ahead) else (pair[1], pair[0]))
    return sorted(found, key=lambda pair: _along(pair[0], ahead))


def _along(place: Place, ahead: Place) -> float:
    return place[0] * ahead[0] + place[1] * ahead[1]
