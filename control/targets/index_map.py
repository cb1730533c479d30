"""Which canopy index does a drone's or satellite's map show at a place? It replaces silent
canopy heads.

A camera from above and a head over the rows do not read the same number from the same canopy.
While the heads work, the difference is learnt; where they fall silent the map continues at their
level, so that the rate does not jump."""

from __future__ import annotations

import numpy as np
from topdress.control.geodesy import Place, TangentPlane, offset_place

from .rate_map import RateMap

# Places across the width: as many as a common boom has heads.
PLACES_ACROSS = 6
# Samples over which the difference is averaged: 50 s at 2 Hz are some 60 m, ten times the
# correlation length of a canopy.
LEARNING_SAMPLES = 100
# Greatest difference of the index: a larger one comes from another day, place or index and is cut.
MAX_OFFSET = 0.2


class IndexMap:
    """Holds the map on `plane`. `head_offset` is the learnt difference, heads minus map; 0 before
    the first sample."""

    def __init__(self, values: RateMap, plane: TangentPlane, width_m: float) -> None:
        """Starts without a learnt difference. values: the index in place of rates; width_m: it
        is averaged over this width."""
        self.plane = plane
        self.head_offset = 0.0
        self._values = values
        self._aside = (np.arange(PLACES_ACROSS) + 0.5) / PLACES_ACROSS * width_m - 0.5 * width_m
        self._learned = 0

    def find_index(self, place: Place, heading_deg: float) -> float | None:
        """Returns the map's mean index over the width at a place of the plane; None where the
        map has none."""
        found = self._values.find_rates(
            [offset_place(place, heading_deg, 0.0, float(aside)) for aside in self._aside]
        )
        known = found[np.isfinite(found)]
        return float(known.mean()) if len(known) else None

    def adjust_to_heads(self, index: float) -> float:
        """Returns the index as the heads would read it."""
        return index + self.head_offset

    def learn_offset(self, heads: float, index: float) -> None:
        """Learns the difference from a place that both have read: the mean of the newest
        samples, of all while they are few."""
        self._learned = min(LEARNING_SAMPLES, self._learned + 1)
        off = self.head_offset + (heads - index - self.head_offset) / self._learned
        self.head_offset = max(-MAX_OFFSET, min(MAX_OFFSET, off))
