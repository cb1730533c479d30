"""Calculates the palette entry of every map pixel, and the two entries that each terminal cell
shows. Pure; `MapInk` converts entries to colours.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import atan2, degrees, hypot
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.console.app.braille import CELL_DOT_BITS
from topdress.console.app.coverage_raster import (
    CELL_KIND_COUNT,
    MIN_APPLIED_KG_HA,
    Window,
    WorkedGround,
)
from topdress.console.app.field_picture import FieldPicture, Ring
from topdress.console.app.map_camera import PixelGrid
from topdress.console.app.map_layers import LAYER_KINDS, RATE_LAYERS, LayerScale, MapLayer
from topdress.console.app.overlay_file import OverlayView
from topdress.console.app.panel_views import MIN_ERROR_REFERENCE_KG_HA
from topdress.console.colour_scale import COLOUR_STEPS

# Palette entries; shape (rows, columns) from the north-west.
Image = npt.NDArray[np.uint8]
# Contents of terminal cells; shape (rows, columns).
Codes = npt.NDArray[np.int32]
Values = npt.NDArray[np.float32]
# Bits of braille dots as an array, for lines over the map.
_BITS = np.array(CELL_DOT_BITS, dtype=np.uint8)

# Palette entries: empty ground, ground passed without application, then a block of colour steps for
# each kind of ground.
EMPTY_ENTRY, PASSAGE_ENTRY = 0, 1
# Palette index of the first colour of worked ground.
DONE_ENTRY = 2
# Palette index of the first colour of planned ground.
PLAN_ENTRY = DONE_ENTRY + COLOUR_STEPS
# Palette index of the first colour of ground from an overlaid file.
OVERLAY_ENTRY = PLAN_ENTRY + COLOUR_STEPS
# Palette index of the first colour of worked ground on the trail behind the machine.
TRAIL_ENTRY = OVERLAY_ENTRY + COLOUR_STEPS
ENTRY_COUNT = TRAIL_ENTRY + COLOUR_STEPS
# Largest side of a cell, as a share of the pixel: below 1, every pixel contains the centre of a
# cell.
MAX_CELL_PIXEL_SHARE = 0.75
# A pass counts as straight if its last 8 m deviate by at most 10 degrees from the heading.
MAX_PASS_TURN_DEG, MIN_STRAIGHT_PASS_M = 10.0, 8.0


class GroundPixels(NamedTuple):
    """Samples the worked ground at pixels."""

    worked: WorkedGround
    pixels: PixelGrid

    def calc_means(self, layer: MapLayer) -> Values:
        """Return the mean of a layer over each pixel; NaN where unknown."""
        return self.calc_means_and_passage(layer)[0]

    def calc_means_and_passage(self, layer: MapLayer) -> tuple[Values, npt.NDArray[np.bool_]]:
        """Return the mean of a layer over each pixel, and whether the middle of the outlets passed
        the pixel."""
        kinds = LAYER_KINDS[layer]
        planes = self.sum_planes(
            *kinds, *(CELL_KIND_COUNT + kind for kind in kinds), 2 * CELL_KIND_COUNT
        )
        # Pixels without entries divide 0 by 0 and become NaN, which means unknown.
        with np.errstate(invalid="ignore", divide="ignore"):
            means = planes[: len(kinds)] / planes[len(kinds) : -1]
        if layer is MapLayer.ERROR:
            # The floor prevents a huge relative error where the target is almost zero.
            means = (means[:1] - means[1:]) / np.maximum(
                means[1:], np.float32(MIN_ERROR_REFERENCE_KG_HA)
            )
        return means[0], planes[-1] > 0.0

    def sum_planes(self, *which: int) -> Window:
        """Return planes summed over every pixel; shape (planes, rows from the north, columns)."""
        pixels, worked = self.pixels, self.worked
        seen = np.zeros((len(which), pixels.rows, pixels.columns), dtype=np.float32)
        if worked.box is None:
            return seen
        cell = worked.choose_cell_m(MAX_CELL_PIXEL_SHARE * pixels.metres)
        # Only the part of the picture that overlaps the worked ground is read: a far zoom costs no
        # more than the field.
        (west, south, east, north), far_m = worked.box, worked.half_width_m + cell
        left, top = pixels.find_pixel(west - far_m, north + far_m)
        right, bottom = pixels.find_pixel(east + far_m, south - far_m)
        left, right = max(0, left), min(pixels.columns, right + 1)
        top, bottom = max(0, top), min(pixels.rows, bottom + 1)
        if left < right and top < bottom:
            columns = _PixelAxis.make_axis(
                pixels.west_m + left * pixels.pixel_width_m,
                pixels.pixel_width_m,
                right - left,
                cell,
            )
            rows = _PixelAxis.make_axis(
                pixels.north_m - bottom * pixels.metres, pixels.metres, bottom - top, cell
            )
            planes = worked.sum_window(
                cell, columns.first, rows.first, columns.cells, rows.cells, which
            )
            seen[:, top:bottom, left:right] = columns.resample_planes(
                rows.resample_planes(planes, 1),
                2,
                # Cells count rows from the south, pixels from the north.
            )[:, ::-1, :]
        return seen


def make_image(
    worked: WorkedGround,
    picture: FieldPicture | None,
    scale: LayerScale,
    pixels: PixelGrid,
    plan: bool = True,
    laid: OverlayView | None = None,
) -> Image:
    """Return the palette entries of all pixels.

    Parameters
    ----------
    worked
        Ground worked so far.
    picture
        Static parts of the map, or None.
    scale
        Colour scale of the layer.
    pixels
        Grid of the picture.
    plan
        True: planned rates lie below the worked ground (rate layers only).
    laid
        Overlaid file, drawn above the plan and below the worked ground.
    """
    seen = np.full((pixels.rows, pixels.columns), EMPTY_ENTRY, dtype=np.uint8)
    if picture is not None and picture.planned is not None and plan and scale.layer in RATE_LAYERS:
        _colour_pixels(seen, picture.planned.sample_pixels(pixels), scale, PLAN_ENTRY)
    if laid is not None:
        values = GroundPixels(laid.worked, pixels).calc_means(laid.scale.layer)
        _colour_pixels(
            seen,
            np.where(_is_passage_only(values, laid.scale), np.float32(np.nan), values),
            laid.scale,
            OVERLAY_ENTRY,
        )
    # Worked ground comes last, because it covers plan and overlay.
    values, passed = GroundPixels(worked, pixels).calc_means_and_passage(scale.layer)
    seen[passed] = PASSAGE_ENTRY
    nothing = _is_passage_only(values, scale)
    seen[nothing] = PASSAGE_ENTRY
    _colour_pixels(seen, np.where(nothing, np.float32(np.nan), values), scale, DONE_ENTRY)
    return seen


def mark_trail(seen: Image, worked: WorkedGround, pixels: PixelGrid) -> None:
    """Draw the worked ground of the trail in the entries of the trail."""
    # Cells larger than a pixel are compared as cells, so that the trail has the shape of the ground
    # below.
    cells_m = np.maximum((pixels.pixel_width_m, pixels.metres), worked.cells_m[0])
    east, north = (
        np.floor(middles / cell_m).astype(np.int64)
        for middles, cell_m in zip(pixels.list_middles(), cells_m, strict=True)
    )
    trail = np.floor(worked.list_trail_places() / cells_m).astype(np.int64)
    trail = trail[((trail >= (east[0], north[-1])) & (trail <= (east[-1], north[0]))).all(axis=1)]
    if not len(trail):
        return
    (west, south), (east_end, north_end) = trail.min(axis=0), trail.max(axis=0)
    covered = np.zeros((north_end - south + 1, east_end - west + 1), dtype=np.bool_)
    covered[trail[:, 1] - south, trail[:, 0] - west] = True
    columns = slice(*np.searchsorted(east, (west, east_end + 1)))
    rows = slice(*np.searchsorted(-north, (-north_end, 1 - south)))
    near = seen[rows, columns]
    near[
        covered[np.ix_(north[rows] - south, east[columns] - west)]
        # Only worked pixels change: planned and empty ground next to the trail keeps its colour.
        & (near >= DONE_ENTRY)
        & (near < PLAN_ENTRY)
    ] += TRAIL_ENTRY - DONE_ENTRY


def find_next_passes(worked: WorkedGround, pixels: PixelGrid) -> tuple[Ring, ...]:
    """Return the lines of the neighbouring passes on which nothing was spread, while the machine
    drives straight."""
    if not worked.trail:
        return ()
    here = worked.trail[-1]
    begin = next(
        (
            one
            for one in reversed(worked.trail)
            if hypot(here.east_m - one.east_m, here.north_m - one.north_m) >= MIN_STRAIGHT_PASS_M
        ),
        None,
    )
    if begin is None:
        return ()
    east, north = here.east_m - begin.east_m, here.north_m - begin.north_m
    # The direction over the last metres must agree with the heading: on a headland no neighbouring
    # pass exists.
    turned_deg = degrees(atan2(east, north)) - here.heading_deg
    if not abs((turned_deg + 180.0) % 360.0 - 180.0) <= MAX_PASS_TURN_DEG:
        return ()
    long_m = hypot(east, north)
    east, north = east / long_m, north / long_m
    far_m, half_m = (pixels.columns + pixels.rows) * pixels.metres, 0.5 * worked.cells_m[0]
    found = []
    # One working width to the left and to the right.
    for aside_m in (-worked.width_m, worked.width_m):
        middle = begin.east_m + aside_m * north, begin.north_m - aside_m * east
        spread = GroundPixels(
            worked, PixelGrid(1, 1, 2.0 * half_m, middle[0] - half_m, middle[1] + half_m)
        ).calc_means(MapLayer.APPLIED)
        if not np.isfinite(spread).any():
            found.append(
                tuple(
                    (middle[0] + way_m * east, middle[1] + way_m * north)
                    for way_m in (-far_m, far_m)
                )
            )
    return tuple(found)


def rasterise_lines(lines: Iterable[Ring], pixels: PixelGrid) -> Image:
    """Return polylines as braille bits of terminal cells, which are two pixels high; a dot is half
    a pixel."""
    dots = np.zeros((pixels.rows // 2, pixels.columns), dtype=np.uint8)
    for line in lines:
        places = np.array(line, dtype=np.float64)
        column = 2.0 * (places[:, 0] - pixels.west_m) / pixels.metres
        row = 2.0 * (pixels.north_m - places[:, 1]) / pixels.metres
        for begin, end in _find_visible_edges(column, row, pixels):
            c0, c1, r0, r1 = column[begin], column[end], row[begin], row[end]
            # The limit of 20,000 samples bounds the cost of an edge that is far longer than the
            # picture.
            share = np.linspace(0.0, 1.0, int(min(20_000.0, max(abs(c1 - c0), abs(r1 - r0)))) + 2)
            c = np.floor(c0 + share * (c1 - c0)).astype(np.int64)
            r = np.floor(r0 + share * (r1 - r0)).astype(np.int64)
            inside = (c >= 0) & (c < 2 * pixels.columns) & (r >= 0) & (r < 4 * len(dots))
            c, r = c[inside], r[inside]
            np.bitwise_or.at(dots, (r // 4, c // 2), _BITS[r % 4, c % 2])
    return dots


# Bits of a palette entry within a cell code.
ENTRY_BITS = 8  # of an entry in a code


class TwoColourCells(NamedTuple):
    """Holds terminal cells of 2 x 2 pixels.

    Attributes
    ----------
    codes
        Bits of the pixels with the higher entry (bit 0 is the north-western pixel) x 2^16, plus the
        higher entry x 2^8, plus the lower entry.
    behind
        Entry of the ground behind a line.
    """

    codes: Codes
    behind: Image


def choose_two_colours(seen: Image) -> TwoColourCells:
    """Reduce every cell to two colours by splitting its four entries at the largest gap."""
    quarters = seen[0::2, 0::2], seen[0::2, 1::2], seen[1::2, 0::2], seen[1::2, 1::2]
    # A sorting network of five comparisons sorts the four entries of all cells at once.
    (low, high), (other_low, other_high) = (
        (np.minimum(a, b), np.maximum(a, b)) for a, b in (quarters[:2], quarters[2:])
    )
    inner, other_inner = np.maximum(low, other_low), np.minimum(high, other_high)
    first, second = np.minimum(low, other_low), np.minimum(inner, other_inner)
    third, fourth = np.maximum(inner, other_inner), np.maximum(high, other_high)
    gap = np.maximum(np.maximum(second - first, third - second), fourth - third)
    one_below, one_above = second - first == gap, fourth - third == gap
    # Highest entry of the lower group.
    below = np.where(one_below, first, np.where(one_above, third, second))
    codes = np.zeros(first.shape, dtype=np.int32)
    for k, quarter in enumerate(quarters):
        codes |= (quarter > below).astype(np.int32) << (2 * ENTRY_BITS + k)
    upper = np.where(one_below & (gap > 0), third, fourth).astype(np.int32)
    lower = np.where(one_above & ~one_below, second, first)
    return TwoColourCells(codes | upper << ENTRY_BITS | lower, third)


def _is_passage_only(values: Values, scale: LayerScale) -> npt.NDArray[np.bool_]:
    """Return where the values are rates of a passage without application."""
    return np.asarray(values < MIN_APPLIED_KG_HA) & (scale.layer in RATE_LAYERS)


def _colour_pixels(seen: Image, values: Values, scale: LayerScale, first: int) -> None:
    """Write the palette entries of known values into the image."""
    known = np.isfinite(values)
    share = np.clip((values[known] - scale.low) / (scale.high - scale.low), 0.0, 1.0)
    seen[known] = first + np.rint(share * (COLOUR_STEPS - 1)).astype(np.uint8)


class _PixelAxis(NamedTuple):
    """Maps pixels along one axis to cells.

    Attributes
    ----------
    first, cells
        First cell below the pixels, and number of cells.
    starts
        First cell of each pixel; for pixels smaller than a cell, the cell that contains the pixel.
    summed
        True if a pixel sums several cells.
    """

    first: int
    cells: int
    starts: npt.NDArray[np.int64]
    summed: bool

    @classmethod
    def make_axis(cls, begin_m: float, metres: float, pixels: int, cell_m: float) -> _PixelAxis:
        """Return the axis of a number of pixels that begin at `begin_m`."""
        if metres < cell_m:
            cells = np.floor((begin_m + (np.arange(pixels) + 0.5) * metres) / cell_m).astype(
                np.int64
            )
            return cls(int(cells[0]), int(cells[-1] - cells[0]) + 1, cells - cells[0], False)
        # The tolerance of 1e-6 cells assigns a cell exactly on the border to one pixel only.
        starts = np.ceil((begin_m + np.arange(pixels + 1) * metres) / cell_m - 0.5 - 1e-6).astype(
            np.int64
        )
        return cls(int(starts[0]), int(starts[-1] - starts[0]), starts[:-1] - starts[0], True)

    def resample_planes(self, planes: Window, axis: int) -> Window:
        """Return planes resampled to pixels along an axis."""
        # Pixels and cells coincide, so no copy is needed.
        if self.cells == len(self.starts):
            return planes
        if self.summed:
            return np.asarray(np.add.reduceat(planes, self.starts, axis=axis), dtype=np.float32)
        return np.take(planes, self.starts, axis=axis)


def _find_visible_edges(
    column: npt.NDArray[np.float64], row: npt.NDArray[np.float64], pixels: PixelGrid
) -> Iterable[tuple[int, int]]:
    """Return the edges whose bounding box touches the picture, as pairs of corner indices."""
    low_c, high_c = np.minimum(column[:-1], column[1:]), np.maximum(column[:-1], column[1:])
    low_r, high_r = np.minimum(row[:-1], row[1:]), np.maximum(row[:-1], row[1:])
    near = np.flatnonzero(
        (high_c >= 0) & (low_c < 2 * pixels.columns) & (high_r >= 0) & (low_r < 2 * pixels.rows)
    )
    return ((int(k), int(k) + 1) for k in near)
