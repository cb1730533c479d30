"""A file of another day, laid on the map under the work: what was applied there, or what was
harvested."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, log10
from typing import NamedTuple

from topdress.console.app.coverage_raster import Worked
from topdress.console.app.layers import RATES, LayerScale, MapLayer
from topdress.console.scale import round_calm_ends

# of a harvest's range: its scale ends at a round tenth
_PARTS = 10


class Harvest(NamedTuple):
    """What a file of no rates tells in their place, in its own unit; `Worked` holds it where it
    holds NDVI."""

    label: str
    unit: str


@dataclass(frozen=True, eq=False, slots=True)
class LaidFile:
    """has: what the map's colours can show of it. apart_m: from the job's field or the machine;
    0: there."""

    name: str
    worked: Worked
    has: frozenset[MapLayer]
    harvest: Harvest | None = None
    apart_m: float = 0.0

    @property
    def rate_ends(self) -> tuple[float, float] | None:
        return self.worked.rate_ends if self.has & RATES else None

    def scale(self, shown: LayerScale) -> LayerScale | None:
        """The scale that it is drawn by where the map is coloured by `shown`; None: it does not
        tell that."""
        if self.harvest is not None:
            low, high = self.worked.ndvi_ends or (0.0, 1.0)
            step = 10.0 ** floor(log10(max(high - low, abs(high), 1e-3) / _PARTS))
            low, high = round_calm_ends((low, high), step, 2 * step)
            return LayerScale(
                MapLayer.NDVI, low, high, 1.0, max(0, -floor(log10(step))), self.harvest.unit
            )
        return shown if shown.layer in self.has else None


class LaidView(NamedTuple):
    """A laid file as a map draws it."""

    worked: Worked
    scale: LayerScale
