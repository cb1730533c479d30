"""Where along the working line is the field? Outside its edge the target is nothing."""

from __future__ import annotations

from typing import Protocol

from topdress.control.field.boundary import Boundary
from topdress.control.orders import TargetSource

from .target_profile import Target, TargetChange, TargetProfile

OUTSIDE_TARGET = Target(0.0, TargetSource.NONE)
# The edge is looked for this far ahead, m.
LOOK_AHEAD_M = 40.0
# Crossings closer to each other than this, m, are the same one.
SAME_CROSSING_M = 2.0


class BoundaryAhead:
    """Holds the places straight ahead along the track where the field begins and ends; updated
    once a tick."""

    def __init__(self, edge: Boundary) -> None:
        self.edge = edge
        self._inside_here = False
        self.places_m: list[float] = []

    def look_ahead(
        self, track_m: float, east_m: float, north_m: float, heading_deg: float, fired_to_m: float
    ) -> None:
        """Looks from the outlet straight ahead. A crossing up to `fired_to_m`, where changes
        have been made, keeps its place: otherwise a jitter of the heading would repeat the
        change."""
        crossed = self.edge.find_crossings_m(east_m, north_m, heading_deg)
        # An odd number of crossings ahead means that the outlet is inside.
        self._inside_here = len(crossed) % 2 == 1
        seen = [track_m + d for d in crossed if d <= LOOK_AHEAD_M]
        made = [place for place in self.places_m if place <= fired_to_m]
        self.places_m = [
            next((old for old in made if abs(old - place) < SAME_CROSSING_M), place)
            for place in seen
        ]

    def forget_place(self) -> None:
        """Forgets the crossings, because no place is known: nothing ahead counts as inside."""
        self._inside_here = False
        self.places_m = []

    def is_inside(self, place_m: float) -> bool:
        """Returns whether a place of the track is inside the field."""
        crossed = [place for place in self.places_m if place <= place_m]
        return self._inside_here != (len(crossed) % 2 == 1)


class InsideTest(Protocol):
    """Tells inside from outside along the way ahead."""

    # Places of the track where inside changes to outside or back, m.
    places_m: list[float]

    def is_inside(self, place_m: float) -> bool: ...


class BoundedProfile:
    """Gives another target outside the edge than the inner profile; nothing, unless stated
    otherwise."""

    def __init__(
        self, inner: TargetProfile, fence: InsideTest, outside: Target = OUTSIDE_TARGET
    ) -> None:
        self._inner = inner
        self._fence = fence
        self._outside = outside

    def find_target(self, place_m: float) -> Target:
        return self._inner.find_target(place_m) if self._fence.is_inside(place_m) else self._outside

    def find_next_change(
        self, after_m: float, before_m: float, holding: Target
    ) -> TargetChange | None:
        begin = after_m
        for end in [*[p for p in self._fence.places_m if after_m < p <= before_m], before_m]:
            if not self._fence.is_inside(begin):
                if holding != self._outside:
                    return TargetChange(begin, self._outside)
            else:
                change = self._inner.find_next_change(begin, end, holding)
                if change is not None and (change.place_m < end or end == before_m):
                    return change
            begin = end
        return None
