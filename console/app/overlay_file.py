"""A file of another day, laid on the map under the work: what was applied there, or what was
harvested."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, log10
from typing import NamedTuple

from topdress.console.app.coverage_raster import WorkedGround
from topdress.console.app.layers import RATE_LAYERS, LayerScale, MapLayer
from topdress.console.scale import round_calm_ends

# of a harvest's range: its scale ends at a round tenth
_SCALE_PARTS = 10


class HarvestColumn(NamedTuple):
    """Describes the harvest that a file without rates has, in its own unit; `WorkedGround` holds it
    in the place of NDVI."""

    label: str
    unit: str


@dataclass(frozen=True, eq=False, slots=True)
class LaidFile:
    """Holds a laid file. has: layers that the map's colours can show. apart_m: from the job's field
    or the machine; 0: there."""

    name: str
    worked: WorkedGround
    has: frozenset[MapLayer]
    harvest: HarvestColumn | None = None
    apart_m: float = 0.0

    @property
    def rate_ends(self) -> tuple[float, float] | None:
        """Lowest and highest rate."""
        return self.worked.rate_ends if self.has & RATE_LAYERS else None

    def find_scale(self, shown: LayerScale) -> LayerScale | None:
        """The scale by which it is drawn where the map is coloured by `shown`; None: the file has
        no such numbers."""
        if self.harvest is not None:
            low, high = self.worked.ndvi_ends or (0.0, 1.0)
            step = 10.0 ** floor(log10(max(high - low, abs(high), 1e-3) / _SCALE_PARTS))
            low, high = round_calm_ends((low, high), step, 2 * step)
            return LayerScale(
                MapLayer.NDVI, low, high, 1.0, max(0, -floor(log10(step))), self.harvest.unit
            )
        return shown if shown.layer in self.has else None


class LaidView(NamedTuple):
    """Holds a laid file as a map draws it."""

    worked: WorkedGround
    scale: LayerScale
