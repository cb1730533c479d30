"""Defines the static parts of a map: the field's outline and the planned rates from the job's
files.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from topdress.console.app.coverage_raster import GroundBox
from topdress.console.app.map_camera import PixelGrid

Rates = npt.NDArray[np.float32]
Ring = tuple[tuple[float, float], ...]
M2_PER_HA = 10_000.0


@dataclass(frozen=True, eq=False, slots=True)
class PlannedRates:
    """Holds planned rates, kg/ha, as `rate_kg_ha[row, column]`. Row 0 is in the south, column 0 in
    the west; NaN means that nothing is planned."""

    west_m: float
    south_m: float
    cell_m: float
    rate_kg_ha: Rates

    @property
    def box(self) -> GroundBox:
        """Bounding box of the raster."""
        rows, columns = self.rate_kg_ha.shape
        return GroundBox(
            self.west_m,
            self.south_m,
            self.west_m + columns * self.cell_m,
            self.south_m + rows * self.cell_m,
        )

    def find_rate(self, east_m: float, north_m: float) -> float | None:
        """Return the planned rate at a position, kg/ha; None where nothing is planned."""
        column, row = (
            int((east_m - self.west_m) // self.cell_m),
            int((north_m - self.south_m) // self.cell_m),
        )
        rows, columns = self.rate_kg_ha.shape
        if not (0 <= column < columns and 0 <= row < rows):
            return None
        rate = float(self.rate_kg_ha[row, column])
        # Only NaN differs from itself.
        return None if rate != rate else rate

    def sample_pixels(self, pixels: PixelGrid) -> Rates:
        """Return the rates at the centres of pixels, kg/ha; shape (rows from the north,
        columns)."""
        rows, columns = self.rate_kg_ha.shape
        east, north = pixels.list_middles()
        column = np.floor((east - self.west_m) / self.cell_m).astype(np.int64)
        row = np.floor((north - self.south_m) / self.cell_m).astype(np.int64)
        # Clipped indices keep the lookup inside the raster; pixels outside become NaN in the next
        # step.
        seen = self.rate_kg_ha[np.ix_(np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1))]
        seen[(row < 0) | (row >= rows), :] = np.nan
        seen[:, (column < 0) | (column >= columns)] = np.nan
        return seen

    @property
    def rate_ends(self) -> tuple[float, float] | None:
        """Lowest and highest planned rate, kg/ha."""
        known = self.rate_kg_ha[np.isfinite(self.rate_kg_ha)]
        return (float(known.min()), float(known.max())) if known.size else None

    @property
    def rated_ha(self) -> float:
        """Area of the ground that has a rate above 0, ha."""
        return float(np.count_nonzero(self.rate_kg_ha > 0.0)) * self.cell_m**2 / M2_PER_HA

    @property
    def planned_mass_kg(self) -> float:
        """Mass of the whole plan, kg."""
        return float(np.nansum(self.rate_kg_ha, dtype=np.float64)) * self.cell_m**2 / M2_PER_HA


@dataclass(frozen=True, eq=False, slots=True)
class FieldPicture:
    """Holds the parts of a map that do not change during a job.

    Attributes
    ----------
    title
        Name of the field.
    rings_m
        Outlines and holes; east and north of each corner, m.
    width_m
        Working width of the outlets, m.
    sections
        Right ends of the sections with valves, as shares of the width; empty means one undivided
        width.
    """

    title: str = ""
    rings_m: tuple[Ring, ...] = ()
    area_ha: float | None = None
    width_m: float = 2.4
    planned: PlannedRates | None = None
    sections: tuple[float, ...] = ()

    @property
    def work_ha(self) -> float | None:
        """Area to be worked, ha: the ground of the plan that has a rate, else the whole field."""
        if self.planned is None or self.area_ha is None:
            return self.area_ha
        return min(self.area_ha, self.planned.rated_ha)

    @property
    def box(self) -> GroundBox | None:
        """Bounding box of the outline, else of the plan."""
        places = [place for ring in self.rings_m for place in ring]
        if not places:
            return None if self.planned is None else self.planned.box
        easts, norths = zip(*places, strict=True)
        return GroundBox(min(easts), min(norths), max(easts), max(norths))
