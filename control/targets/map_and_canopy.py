"""Map and sensor together: the map's rate is the base, the heads' rate is followed within limits around it.

The map knows what the place can yield, the heads what the crop lacks today (map overlay, Auernhammer 2001, Comput.
Electron. Agric. 30:31-43). Where the map has a rate and the heads have decided, the heads' rate holds, at most so far
from the map's. Without a reading the map alone holds; outside the map, and where it says zero, the heads change
nothing.
Each keeps its own lead: the map is seen as far as it reaches, the heads' decisions as far as they look ahead.
"""
from __future__ import annotations

from typing import NamedTuple

from control.orders import TargetSource

from .profile import Profile, Target, TargetChange


class Around(NamedTuple):
    """How far the heads may move from the map's rate: kg/ha where given, else a share of it."""

    percent: float = 20.0
    kg_ha: float | None = None

    def held(self, base_kg_ha: float, wanted_kg_ha: float) -> float:
        most = self.kg_ha if self.kg_ha is not None else base_kg_ha * self.percent / 100.0
        return max(0.0, min(base_kg_ha + most, max(base_kg_ha - most, wanted_kg_ha)))


class MapAndCanopy:
    """A profile made of two. `base`: the map; `canopy`: decisions of the heads, fallback where there are none."""

    def __init__(self, base: Profile, canopy: Profile, around: Around) -> None:
        self._base, self._canopy, self._around = base, canopy, around

    def at(self, place_m: float) -> Target:
        base = self._base.at(place_m)
        if base.source is not TargetSource.MAP or base.rate_kg_ha <= 0.0:
            return base
        seen = self._canopy.at(place_m)
        if seen.source is not TargetSource.CANOPY:
            return base
        return Target(self._around.held(base.rate_kg_ha, seen.rate_kg_ha), TargetSource.MAP_AND_CANOPY)

    def next_change(self, after_m: float, before_m: float, holding: Target) -> TargetChange | None:
        """The first place at which either of the two changes and what they come to differs from what is held."""
        place: float | None = after_m
        while place is not None and place <= before_m:
            target = self.at(place)
            if target != holding:
                return TargetChange(place, target)
            place = self._next_edge(place, before_m)
        return None

    def _next_edge(self, after_m: float, before_m: float) -> float | None:
        changes = [one.next_change(after_m, before_m, one.at(after_m)) for one in (self._base, self._canopy)]
        places = [change.place_m for change in changes if change is not None and change.place_m > after_m]
        return min(places, default=None)
