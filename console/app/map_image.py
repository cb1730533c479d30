"""The map as numbers: which palette entry every pixel has. Pure; a widget turns it into segments."""
from __future__ import annotations

from collections.abc import Iterable
from math import atan2, degrees, hypot
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from console.app.braille import BITS
from console.app.camera import Pixels
from console.app.field_picture import FieldPicture, Ring
from console.app.laid import LaidView
from console.app.layers import RATES, LayerScale, MapLayer
from console.app.scale import STEPS
from console.app.view import RATE_FLOOR_KG_HA
from console.app.worked import KINDS, NOTHING_KG_HA, Window, Worked

Image = npt.NDArray[np.uint8]           # (rows, columns), from the north-west
Values = npt.NDArray[np.float32]
_BITS = np.array(BITS, dtype=np.uint8)

EMPTY, PASSAGE = 0, 1
DONE = 2                                # DONE + step: worked ground
PLAN = DONE + STEPS                     # PLAN + step: planned ground
LAID = PLAN + STEPS                     # LAID + step: ground of a laid file
GLOW = LAID + STEPS                     # GLOW + step: worked ground of the pass behind the machine
ENTRIES = GLOW + STEPS
STRAIGHT_DEG, STRAIGHT_M = 10.0, 8.0    # a pass: so long, and so straight


class GroundPixels(NamedTuple):
    """Means over each pixel, NaN where nothing is known; passed: whether the outlets' middle went there."""

    applied_kg_ha: Values
    target_kg_ha: Values
    ndvi: Values
    passed: npt.NDArray[np.bool_]

    def layer(self, layer: MapLayer) -> Values:
        if layer is MapLayer.ERROR:
            floor = np.maximum(self.target_kg_ha, np.float32(RATE_FLOOR_KG_HA))
            return np.asarray((self.applied_kg_ha - self.target_kg_ha) / floor, dtype=np.float32)
        return {MapLayer.APPLIED: self.applied_kg_ha, MapLayer.TARGET: self.target_kg_ha,
                MapLayer.NDVI: self.ndvi}[layer]


def ground(worked: Worked, pixels: Pixels) -> GroundPixels:
    """What was entered, as it lies under the pixels."""
    planes = _under(worked, pixels)
    with np.errstate(invalid="ignore", divide="ignore"):
        applied, target, ndvi = planes[:KINDS] / planes[KINDS:2 * KINDS]
    return GroundPixels(applied, target, ndvi, planes[2 * KINDS] > 0.0)


def image(worked: Worked, picture: FieldPicture | None, scale: LayerScale, pixels: Pixels, plan: bool = True,
          laid: LaidView | None = None) -> Image:
    """The palette entries of all pixels. plan: planned rates lie under the worked ground (rate layers only).

    A laid file lies over the plan and under the worked ground.
    """
    seen = np.full((pixels.rows, pixels.columns), EMPTY, dtype=np.uint8)
    if picture is not None and picture.planned is not None and plan and scale.layer in RATES:
        _colour(seen, picture.planned.seen(pixels), scale, PLAN)
    if laid is not None:
        values = ground(laid.worked, pixels).layer(laid.scale.layer)
        _colour(seen, np.where(_nothing(values, laid.scale), np.float32(np.nan), values), laid.scale, LAID)
    here = ground(worked, pixels)
    seen[here.passed] = PASSAGE
    values = here.layer(scale.layer)
    nothing = _nothing(values, scale)
    seen[nothing] = PASSAGE
    _colour(seen, np.where(nothing, np.float32(np.nan), values), scale, DONE)
    return seen


def glow(seen: Image, worked: Worked, pixels: Pixels) -> None:
    """The worked ground that the trail covers, in its own entries."""
    cell_m = max(pixels.metres, worked.cells_m[0])
    east, north = (np.floor(middles / cell_m).astype(np.int64) for middles in pixels.middles())
    west, south = int(east[0]), int(north[-1])
    covered = np.zeros((int(north[0]) - south + 1, int(east[-1]) - west + 1), dtype=np.bool_)
    column, row = (np.floor(worked.trail_places() / cell_m).astype(np.int64) - (west, south)).T
    inside = (column >= 0) & (column < covered.shape[1]) & (row >= 0) & (row < covered.shape[0])
    covered[row[inside], column[inside]] = True
    seen[covered[np.ix_(north - south, east - west)] & (seen >= DONE) & (seen < PLAN)] += GLOW - DONE


def next_passes(worked: Worked, pixels: Pixels) -> tuple[Ring, ...]:
    """Where the machine drives straight: the line of each pass next to its own that nothing was spread on yet."""
    if not worked.trail:
        return ()
    here = worked.trail[-1]
    begin = next((one for one in reversed(worked.trail) if hypot(
        here.east_m - one.east_m, here.north_m - one.north_m) >= STRAIGHT_M), None)
    if begin is None:
        return ()
    east, north = here.east_m - begin.east_m, here.north_m - begin.north_m
    turned_deg = degrees(atan2(east, north)) - here.heading_deg
    if not abs((turned_deg + 180.0) % 360.0 - 180.0) <= STRAIGHT_DEG:
        return ()
    long_m = hypot(east, north)
    east, north = east / long_m, north / long_m
    far_m, half_m = (pixels.columns + pixels.rows) * pixels.metres, 0.5 * worked.cells_m[0]
    found = []
    for aside_m in (-worked.width_m, worked.width_m):
        middle = begin.east_m + aside_m * north, begin.north_m - aside_m * east
        spread = ground(worked, Pixels(1, 1, 2.0 * half_m, middle[0] - half_m, middle[1] + half_m)).applied_kg_ha
        if not np.isfinite(spread).any():
            found.append(tuple((middle[0] + way_m * east, middle[1] + way_m * north) for way_m in (-far_m, far_m)))
    return tuple(found)


def line_dots(lines: Iterable[Ring], pixels: Pixels) -> Image:
    """Lines from corner to corner, as the bits of braille: of each cell of the terminal, two pixels high. A dot is half
    a pixel."""
    dots = np.zeros((pixels.rows // 2, pixels.columns), dtype=np.uint8)
    for line in lines:
        places = np.array(line, dtype=np.float64)
        column = 2.0 * (places[:, 0] - pixels.west_m) / pixels.metres
        row = 2.0 * (pixels.north_m - places[:, 1]) / pixels.metres
        for begin, end in _visible(column, row, pixels):
            c0, c1, r0, r1 = column[begin], column[end], row[begin], row[end]
            share = np.linspace(0.0, 1.0, int(min(20_000.0, max(abs(c1 - c0), abs(r1 - r0)))) + 2)
            c = np.floor(c0 + share * (c1 - c0)).astype(np.int64)
            r = np.floor(r0 + share * (r1 - r0)).astype(np.int64)
            inside = (c >= 0) & (c < 2 * pixels.columns) & (r >= 0) & (r < 4 * len(dots))
            c, r = c[inside], r[inside]
            np.bitwise_or.at(dots, (r // 4, c // 2), _BITS[r % 4, c % 2])
    return dots


def _nothing(values: Values, scale: LayerScale) -> npt.NDArray[np.bool_]:
    """Where rates are those of a passage without application."""
    return np.asarray(values < NOTHING_KG_HA) & (scale.layer in RATES)


def _colour(seen: Image, values: Values, scale: LayerScale, first: int) -> None:
    known = np.isfinite(values)
    share = np.clip((values[known] - scale.low) / (scale.high - scale.low), 0.0, 1.0)
    seen[known] = first + np.rint(share * (STEPS - 1)).astype(np.uint8)


def _under(worked: Worked, pixels: Pixels) -> Window:
    """Planes summed over every pixel (planes, rows from the north, columns)."""
    cell = worked.cell_for(pixels.metres)
    south = pixels.north_m - pixels.rows * pixels.metres
    columns = _PixelAxis.of(pixels.west_m, pixels.metres, pixels.columns, cell)
    rows = _PixelAxis.of(south, pixels.metres, pixels.rows, cell)
    planes = worked.window(cell, columns.first, rows.first, columns.cells, rows.cells)
    return columns.gathered(rows.gathered(planes, 1), 2)[:, ::-1, :]


class _PixelAxis(NamedTuple):
    """The cells (first, how many) under a row of pixels; starts: the first cell of each pixel, or, where pixels are
    smaller than cells, the one cell that a pixel lies in."""

    first: int
    cells: int
    starts: npt.NDArray[np.int64]
    summed: bool

    @classmethod
    def of(cls, begin_m: float, metres: float, pixels: int, cell_m: float) -> _PixelAxis:
        if metres < cell_m:
            cells = np.floor((begin_m + (np.arange(pixels) + 0.5) * metres) / cell_m).astype(np.int64)
            return cls(int(cells[0]), int(cells[-1] - cells[0]) + 1, cells - cells[0], False)
        starts = np.ceil((begin_m + np.arange(pixels + 1) * metres) / cell_m - 0.5 - 1e-6).astype(np.int64)
        return cls(int(starts[0]), int(starts[-1] - starts[0]), starts[:-1] - starts[0], True)

    def gathered(self, planes: Window, axis: int) -> Window:
        if self.summed:
            return np.asarray(np.add.reduceat(planes, self.starts, axis=axis), dtype=np.float32)
        return np.take(planes, self.starts, axis=axis)


def _visible(column: npt.NDArray[np.float64], row: npt.NDArray[np.float64], pixels: Pixels
             ) -> Iterable[tuple[int, int]]:
    """Edges whose box touches the picture, as pairs of corners."""
    low_c, high_c = np.minimum(column[:-1], column[1:]), np.maximum(column[:-1], column[1:])
    low_r, high_r = np.minimum(row[:-1], row[1:]), np.maximum(row[:-1], row[1:])
    near = np.flatnonzero((high_c >= 0) & (low_c < 2 * pixels.columns) & (high_r >= 0) & (low_r < 2 * pixels.rows))
    return ((int(k), int(k) + 1) for k in near)
