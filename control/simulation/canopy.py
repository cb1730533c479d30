"""A seeded NDVI field with a chosen mean, CV and correlation length (decision paper: plots of 0.467-0.546, 8-11 %)."""
from __future__ import annotations

from math import exp, log

import numpy as np

from control.field.job import Canopy
from control.machine.elements import Array

CELL_M = 0.4
MOST_CELLS = 4_000_000          # 0.8 km by 0.8 km, 32 MB, four times that to make; beyond the same canopy comes again
# Both indices saturate with leaf area, NDVI much sooner (form after Baret and Guyot 1991, Remote Sens. Environ.
# 35:161-173; the figures are typical of wheat, nobody's in particular).
SOIL_NDVI, DENSE_NDVI, NDVI_PER_LEAF = 0.15, 0.95, 0.70
SOIL_NDRE, DENSE_NDRE, NDRE_PER_LEAF = 0.08, 0.60, 0.25


def ndre_of(ndvi: float) -> float:
    """NDRE of the canopy that has this NDVI."""
    bare = (DENSE_NDVI - min(ndvi, DENSE_NDVI - 0.005)) / (DENSE_NDVI - SOIL_NDVI)
    leaf_area = max(0.0, -log(bare) / NDVI_PER_LEAF)
    return SOIL_NDRE + (DENSE_NDRE - SOIL_NDRE) * (1.0 - exp(-NDRE_PER_LEAF * leaf_area))


class CanopyField:
    """NDVI on a grid of CELL_M, bilinear in between; it repeats beyond its edges.

    A Gaussian random field with exponential covariance exp(-d / correlation_m), made in the frequency domain.
    """

    def __init__(self, canopy: Canopy, east_m: tuple[float, float], north_m: tuple[float, float], seed: int) -> None:
        self._east0, self._north0 = east_m[0], north_m[0]
        columns, rows = _grid(east_m[1] - east_m[0], north_m[1] - north_m[0])
        rng = np.random.default_rng(seed)
        x = CELL_M * np.minimum(np.arange(columns), columns - np.arange(columns))
        y = CELL_M * np.minimum(np.arange(rows), rows - np.arange(rows))
        covariance = np.exp(-np.hypot(x[None, :], y[:, None]) / canopy.correlation_m)
        spectrum = np.sqrt(np.maximum(0.0, np.fft.rfft2(covariance).real))
        white = np.fft.rfft2(rng.standard_normal((rows, columns)))
        field = np.fft.irfft2(spectrum * white, s=(rows, columns))
        field = (field - field.mean()) / field.std()
        ndvi = canopy.mean_ndvi * (1.0 + canopy.cv_percent / 100.0 * field)
        self.ndvi: Array = np.clip(ndvi, 0.02, 0.98)
        self._rows, self._columns = rows, columns

    def at(self, east_m: float, north_m: float) -> float:
        """NDVI at a place on the field's plane."""
        x = (east_m - self._east0) / CELL_M
        y = (north_m - self._north0) / CELL_M
        i, j = int(x // 1.0), int(y // 1.0)
        u, v = x - i, y - j
        i0, i1 = i % self._columns, (i + 1) % self._columns
        j0, j1 = j % self._rows, (j + 1) % self._rows
        g = self.ndvi
        return float((1 - v) * ((1 - u) * g[j0, i0] + u * g[j0, i1]) + v * ((1 - u) * g[j1, i0] + u * g[j1, i1]))


def _grid(wide_m: float, long_m: float) -> tuple[int, int]:
    """Columns and rows: all of the ground, the longer side cut where that would be more than `MOST_CELLS`."""
    columns, rows = (max(8, int(np.ceil(m / CELL_M))) for m in (wide_m, long_m))
    if columns * rows <= MOST_CELLS:
        return columns, rows
    side = int(MOST_CELLS ** 0.5)
    if min(columns, rows) >= side:
        return side, side
    return (columns, MOST_CELLS // columns) if columns < rows else (MOST_CELLS // rows, rows)
