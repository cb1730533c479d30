"""Which NDVI does the simulated canopy have? A seeded field with a chosen mean, CV and
correlation length (decision paper: plots of 0.467-0.546, 8-11 %)."""

from __future__ import annotations

from functools import lru_cache
from math import cos, exp, log, radians, sin

import numpy as np
from topdress.control.field.job import Canopy
from topdress.control.machine.model_elements import Array

# Cell size of the canopy, m.
CANOPY_CELL_M = 0.4
# Greatest number of cells: 0.8 km by 0.8 km, 32 MB, four times that to make; beyond it the canopy
# repeats.
MAX_CANOPY_CELLS = 4_000_000
# Both indices saturate with leaf area, NDVI much sooner (form after Baret and Guyot 1991,
# Remote Sens. Environ. 35:161-173; the figures are typical of wheat, nobody's in particular).
SOIL_NDVI, DENSE_NDVI, NDVI_PER_LEAF = 0.15, 0.95, 0.70
SOIL_NDRE, DENSE_NDRE, NDRE_PER_LEAF = 0.08, 0.60, 0.25


def convert_to_ndre(ndvi: float) -> float:
    """Returns the NDRE of the canopy that has this NDVI."""
    bare = (DENSE_NDVI - min(ndvi, DENSE_NDVI - 0.005)) / (DENSE_NDVI - SOIL_NDVI)
    leaf_area = max(0.0, -log(bare) / NDVI_PER_LEAF)
    return SOIL_NDRE + (DENSE_NDRE - SOIL_NDRE) * (1.0 - exp(-NDRE_PER_LEAF * leaf_area))


class CanopyField:
    """Holds NDVI on a grid of CELL_M, bilinear in between; it repeats beyond its edges.

    A Gaussian random field with exponential covariance exp(-d / correlation_m), made in the
    frequency domain."""

    def __init__(
        self, canopy: Canopy, east_m: tuple[float, float], north_m: tuple[float, float], seed: int
    ) -> None:
        self._east0, self._north0 = east_m[0], north_m[0]
        columns, rows = _choose_grid(east_m[1] - east_m[0], north_m[1] - north_m[0])
        rng = np.random.default_rng(seed)
        x = CANOPY_CELL_M * np.minimum(np.arange(columns), columns - np.arange(columns))
        y = CANOPY_CELL_M * np.minimum(np.arange(rows), rows - np.arange(rows))
        covariance = np.exp(-np.hypot(x[None, :], y[:, None]) / canopy.correlation_m)
        spectrum = np.sqrt(np.maximum(0.0, np.fft.rfft2(covariance).real))
        white = np.fft.rfft2(rng.standard_normal((rows, columns)))
        field = np.fft.irfft2(spectrum * white, s=(rows, columns))
        field = (field - field.mean()) / field.std()
        ndvi = canopy.mean_ndvi * (1.0 + canopy.cv_percent / 100.0 * field)
        self.ndvi: Array = np.clip(ndvi, 0.02, 0.98)
        # The array is read-only, because several machines may share it.
        self.ndvi.flags.writeable = False
        self._rows, self._columns = rows, columns
        # Row by row; a memoryview reads single cells faster than the array.
        self._cells = memoryview(self.ndvi.ravel())

    def find_ndvi(self, east_m: float, north_m: float) -> float:
        """Returns the NDVI at a place of the field's plane."""
        x = (east_m - self._east0) / CANOPY_CELL_M
        y = (north_m - self._north0) / CANOPY_CELL_M
        i, j = int(x // 1.0), int(y // 1.0)
        u, v = x - i, y - j
        columns, g = self._columns, self._cells
        i0, i1 = i % columns, (i + 1) % columns
        j0, j1 = j % self._rows * columns, (j + 1) % self._rows * columns
        here: float = (1 - v) * ((1 - u) * g[j0 + i0] + u * g[j0 + i1]) + v * (
            (1 - u) * g[j1 + i0] + u * g[j1 + i1]
        )
        return here

    def find_many_ndvi(self, east_m: Array, north_m: Array) -> Array:
        """Returns the values of `find_ndvi` for places (n,), (n,) -> (n,), to the last bit."""
        x, y = (east_m - self._east0) / CANOPY_CELL_M, (north_m - self._north0) / CANOPY_CELL_M
        i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        u, v, g = x - i, y - j, self.ndvi
        i0, i1, j0, j1 = (
            i % self._columns,
            (i + 1) % self._columns,
            j % self._rows,
            (j + 1) % self._rows,
        )
        here: Array = (1 - v) * ((1 - u) * g[j0, i0] + u * g[j0, i1]) + v * (
            (1 - u) * g[j1, i0] + u * g[j1, i1]
        )
        return here


@lru_cache(maxsize=1)
def make_canopy_field(
    canopy: Canopy, east_m: tuple[float, float], north_m: tuple[float, float], seed: int
) -> CanopyField:
    """Returns a `CanopyField`, the same one where the same field is used again: making it takes
    as long as 30 s of simulation."""
    return CanopyField(canopy, east_m, north_m, seed)


class HeadRow:
    """Reads a canopy with a row of heads across the working width: NDVI or NDRE, `index`.

    Places are those of the row's middle on the field's plane."""

    def __init__(self, field: CanopyField, heads: int, width_m: float, index: str) -> None:
        self._field, self._by_ndre = field, index != "ndvi"
        self._asides = [(head - 0.5 * (heads - 1)) * (width_m / heads) for head in range(heads)]

    def read_heads(self, east_m: float, north_m: float, heading_deg: float) -> list[float]:
        angle = radians(heading_deg)
        right, back = cos(angle), sin(angle)
        ndvi = [
            self._field.find_ndvi(east_m + aside * right, north_m - aside * back)
            for aside in self._asides
        ]
        return [convert_to_ndre(one) for one in ndvi] if self._by_ndre else ndvi

    def calc_means(self, east_m: Array, north_m: Array, heading_deg: Array) -> Array:
        """Returns the mean of `read_heads` for a whole run, (n,) each -> (n,)."""
        headings, which = np.unique(heading_deg, return_inverse=True)
        right, back = (
            np.array([of(radians(heading)) for heading in headings.tolist()])[which]
            for of in (cos, sin)
        )
        total = np.zeros(len(east_m))
        for aside in self._asides:
            ndvi = self._field.find_many_ndvi(east_m + aside * right, north_m - aside * back)
            total += [convert_to_ndre(one) for one in ndvi.tolist()] if self._by_ndre else ndvi
        return total / len(self._asides)


def _choose_grid(wide_m: float, long_m: float) -> tuple[int, int]:
    """Returns columns and rows for all of the ground; the longer side is cut where there would
    be more than `MAX_CANOPY_CELLS`."""
    columns, rows = (max(8, int(np.ceil(m / CANOPY_CELL_M))) for m in (wide_m, long_m))
    if columns * rows <= MAX_CANOPY_CELLS:
        return columns, rows
    side = int(MAX_CANOPY_CELLS**0.5)
    if min(columns, rows) >= side:
        return side, side
    return (
        (columns, MAX_CANOPY_CELLS // columns)
        if columns < rows
        else (MAX_CANOPY_CELLS // rows, rows)
    )
