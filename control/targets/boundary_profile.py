"""The field's edge seen along the working line: outside it the target is nothing."""

from __future__ import annotations

from typing import Protocol

from topdress.control.field.boundary import Boundary
from topdress.control.orders import TargetSource

from .profile import Profile, Target, TargetChange

OUTSIDE = Target(0.0, TargetSource.NONE)
LOOK_M = 40.0
SAME_M = 2.0  # crossings seen this near to each other are one


class Fence:
    """Where along the track, straight ahead, the field begins and ends; looked at once a tick."""

    def __init__(self, edge: Boundary) -> None:
        self.edge = edge
        self._inside_here = False
        self.places_m: list[float] = []

    def look(
        self, track_m: float, east_m: float, north_m: float, heading_deg: float, fired_to_m: float
    ) -> None:
        """Look from the outlet straight ahead. A crossing up to `fired_to_m`, where changes
        have been made, stays where it was seen then: a jitter of the heading must not make it
        once more."""
        crossed = self.edge.crossings_m(east_m, north_m, heading_deg)
        # whoever leaves once more than he enters is inside
        self._inside_here = len(crossed) % 2 == 1
        seen = [track_m + d for d in crossed if d <= LOOK_M]
        made = [place for place in self.places_m if place <= fired_to_m]
        self.places_m = [
            next((old for old in made if abs(old - place) < SAME_M), place) for place in seen
        ]

    def lost(self) -> None:
        """No place known: nothing ahead counts as inside."""
        self._inside_here = False
        self.places_m = []

    def inside(self, place_m: float) -> bool:
        crossed = [place for place in self.places_m if place <= place_m]
        return self._inside_here != (len(crossed) % 2 == 1)


class Inside(Protocol):
    """What tells inside from outside along the way ahead."""

    places_m: list[float]  # where one becomes the other

    def inside(self, place_m: float) -> bool: ...


class Fenced:
    """A profile that is another target outside the fence; nothing, unless stated otherwise."""

    def __init__(self, inner: Profile, fence: Inside, outside: Target = OUTSIDE) -> None:
        self._inner = inner
        self._fence = fence
        self._outside = outside

    def at(self, place_m: float) -> Target:
        return self._inner.at(place_m) if self._fence.inside(place_m) else self._outside

    def next_change(self, after_m: float, before_m: float, holding: Target) -> TargetChange | None:
        begin = after_m
        for end in [*[p for p in self._fence.places_m if after_m < p <= before_m], before_m]:
            if not self._fence.inside(begin):
                if holding != self._outside:
                    return TargetChange(begin, self._outside)
            else:
                change = self._inner.next_change(begin, end, holding)
                if change is not None and (change.place_m < end or end == before_m):
                    return change
            begin = end
        return None
