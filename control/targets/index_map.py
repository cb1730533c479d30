"""The canopy's index by places, as a drone or a satellite saw it: stands in where the canopy
heads say nothing.

A camera from above and a head over the rows do not read the same number off the same canopy.
While the heads speak, the difference is learned; where they fall silent the map goes on at
their level, so that the rate does not jump.
"""

from __future__ import annotations

import numpy as np
from topdress.control.geodesy import Place, TangentPlane, offset

from .rate_map import RateMap

# places across the width, as many as a common boom has heads
ACROSS = 6
# samples, 50 s at 2 Hz: some 60 m, ten times the length over which a canopy is alike
LEARNS_OVER = 100
# index: larger differences are another day, another place or another index, and are not taken
MOST_OFF = 0.2


class IndexMap:
    """`plane`: on which the map lies. `off`: heads less map, learned; 0 before the heads have
    said anything."""

    def __init__(self, values: RateMap, plane: TangentPlane, width_m: float) -> None:
        """values: the index in the place of rates. width_m: over which it is meant."""
        self.plane = plane
        self.off = 0.0
        self._values = values
        self._aside = (np.arange(ACROSS) + 0.5) / ACROSS * width_m - 0.5 * width_m
        self._learned = 0

    def at(self, place: Place, heading_deg: float) -> float | None:
        """The mean over the width at a place of the plane, as the map has it; None where it has
        nothing."""
        found = self._values.rates_at(
            [offset(place, heading_deg, 0.0, float(aside)) for aside in self._aside]
        )
        known = found[np.isfinite(found)]
        return float(known.mean()) if len(known) else None

    def levelled(self, index: float) -> float:
        """As the heads would read it."""
        return index + self.off

    def learn(self, heads: float, index: float) -> None:
        """Both have read one place: the mean of the newest samples, of all as long as they are
        few."""
        self._learned = min(LEARNS_OVER, self._learned + 1)
        off = self.off + (heads - index - self.off) / self._learned
        self.off = max(-MOST_OFF, min(MOST_OFF, off))
