"""Rasterises ground that another machine or program has covered, on the field's plane."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from topdress.control.field.coverage import MAX_RASTER_CELLS, Raster
from topdress.control.geodesy import Place, TangentPlane

# Cell size, m: the same as of the loop's own coverage.
CELL_M = 0.2


class DoneGround(NamedTuple):
    """Ground that others have covered. `area_ha`: area with each position counted once."""

    plane: TangentPlane
    raster: Raster
    area_ha: float

    @property
    def middle_m(self) -> Place:
        rows, columns = self.raster.done.shape
        return (
            self.raster.west_m + 0.5 * columns * self.raster.cell_m,
            self.raster.south_m + 0.5 * rows * self.raster.cell_m,
        )


def rasterise_ground(
    shapes: npt.NDArray[np.object_], plane: TangentPlane, cell_m: float = CELL_M
) -> DoneGround:
    """Rasterise polygons (n,) on the plane, m, which may overlap: a cell is done when its middle is
    in any polygon.

    Raises ValueError for no ground, or too much ground for one raster.
    """
    whole = shapely.union_all(shapely.make_valid(shapes))
    if not whole.area > 0.0:
        raise ValueError("no ground is marked as done")
    west, south, east, north = (math.floor(edge / cell_m) for edge in whole.bounds)
    rows, columns = north - south + 1, east - west + 1
    if rows * columns > MAX_RASTER_CELLS:
        raise ValueError(
            f"done ground of {columns * cell_m:.0f} x {rows * cell_m:.0f} m: allowed are "
            f"{MAX_RASTER_CELLS * cell_m * cell_m / 1e6:.0f} km2 for one field"
        )
    done = np.zeros((rows, columns), dtype=np.bool_)
    begin, end = _list_ring_sides(whole)
    for row, (at, crossed) in enumerate(
        _find_crossings(begin, end, (south + np.arange(rows) + 0.5) * cell_m)
    ):
        if crossed:
            edges = np.sort(at)
            first = np.ceil(edges[0::2] / cell_m - 0.5).astype(np.int64) - west
            last = np.floor(edges[1::2] / cell_m - 0.5).astype(np.int64) - west
            steps = np.zeros(columns + 1, dtype=np.int32)
            some = last >= first
            np.add.at(steps, first[some], 1)
            np.add.at(steps, last[some] + 1, -1)
            done[row] = np.cumsum(steps[:-1]) > 0
    return DoneGround(
        plane, Raster(west * cell_m, south * cell_m, cell_m, done), float(whole.area) / 10_000.0
    )


def _list_ring_sides(whole: Any) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return start and end (n, 2) of every side of every ring, including holes."""
    rings = [
        shapely.get_coordinates(ring)
        for part in shapely.get_parts(whole)
        if part.geom_type == "Polygon"
        for ring in (part.exterior, *part.interiors)
    ]
    return (
        np.concatenate([ring[:-1] for ring in rings]),
        np.concatenate([ring[1:] for ring in rings]),
    )


def _find_crossings(
    begin: npt.NDArray[np.float64], end: npt.NDArray[np.float64], north_m: npt.NDArray[np.float64]
) -> list[tuple[npt.NDArray[np.float64], bool]]:
    """Return the east coordinates at which sides cross each of these lines (rows,), an even
    number, and whether any side does."""
    low, high = np.minimum(begin[:, 1], end[:, 1]), np.maximum(begin[:, 1], end[:, 1])
    first, last = np.searchsorted(north_m, low, "right"), np.searchsorted(north_m, high, "right")
    counts = last - first
    side = np.repeat(np.arange(len(low)), counts)
    row = (
        np.arange(len(side))
        - np.repeat(np.cumsum(counts) - counts, counts)
        + np.repeat(first, counts)
    )
    share = (north_m[row] - begin[side, 1]) / (end[side, 1] - begin[side, 1])
    at = begin[side, 0] + share * (end[side, 0] - begin[side, 0])
    order = np.argsort(row, kind="stable")
    pieces = np.split(at[order], np.cumsum(np.bincount(row, minlength=len(north_m)))[:-1])
    return [(piece, len(piece) > 0) for piece in pieces]
