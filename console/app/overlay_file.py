"""Holds a file of another day that is overlaid on the map below the work: applied rates or
harvest.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, log10
from typing import NamedTuple

from topdress.console.app.coverage_raster import WorkedGround
from topdress.console.app.map_layers import RATE_LAYERS, LayerScale, MapLayer
from topdress.console.colour_scale import round_calm_ends

# The harvest's scale ends at a round tenth of its range.
_HARVEST_SCALE_PARTS = 10


class HarvestColumn(NamedTuple):
    """Describes the harvest in a file without rates, in the file's own unit; `WorkedGround` stores
    it in the plane of NDVI."""

    label: str
    unit: str


@dataclass(frozen=True, eq=False, slots=True)
class OverlayFile:
    """Holds an overlaid file.

    Attributes
    ----------
    has
        Layers that the map's colours can show.
    apart_m
        Distance from the job's field or the machine, m; 0 where they overlap.
    """

    name: str
    worked: WorkedGround
    has: frozenset[MapLayer]
    harvest: HarvestColumn | None = None
    apart_m: float = 0.0

    @property
    def rate_ends(self) -> tuple[float, float] | None:
        """Lowest and highest rate, kg/ha; None for a harvest."""
        return self.worked.rate_ends if self.has & RATE_LAYERS else None

    def find_scale(self, shown: LayerScale) -> LayerScale | None:
        """Return the colour scale for drawing the file while the map shows another scale; None if
        the file lacks the quantity."""
        if self.harvest is not None:
            low, high = self.worked.ndvi_ends or (0.0, 1.0)
            # The lower limit of 1e-3 keeps the logarithm finite for a constant harvest.
            step = 10.0 ** floor(log10(max(high - low, abs(high), 1e-3) / _HARVEST_SCALE_PARTS))
            low, high = round_calm_ends((low, high), step, 2 * step)
            return LayerScale(
                MapLayer.NDVI, low, high, 1.0, max(0, -floor(log10(step))), self.harvest.unit
            )
        return shown if shown.layer in self.has else None


class OverlayView(NamedTuple):
    """Holds an overlaid file with the scale by which the map draws it."""

    worked: WorkedGround
    scale: LayerScale
