"""One drawing for every map: what a page, a preview or a list shows of it are cells of the
terminal, 2 x 2 pixels each in two colours, with lines over them as braille, half a pixel thin."""

from __future__ import annotations

from functools import lru_cache
from math import cos, radians, sin
from typing import NamedTuple

import numpy as np
from rich.color import Color
from textual.widget import Widget
from topdress.console.app.braille import BLANK_CODE
from topdress.console.app.camera import MapCamera, PixelGrid, fit_box
from topdress.console.app.coverage_raster import WorkedGround
from topdress.console.app.field_picture import FieldPicture, Ring
from topdress.console.app.layers import LayerScale, MapLayer, find_colour_scale
from topdress.console.app.map_image import (
    DONE_ENTRY,
    EMPTY,
    GLOW_ENTRY,
    LAID_ENTRY,
    PAIR_BITS,
    PASSAGE,
    PLAN_ENTRY,
    Codes,
    Image,
    choose_two_colours,
    find_next_passes,
    make_image,
    mark_trail,
    rasterise_lines,
)
from topdress.console.app.overlay_file import LaidView
from topdress.console.app.terminal import has_few_colours
from topdress.console.app.units import METRIC, Units
from topdress.console.scale import COLOUR_STEPS, Rgb

_MACHINE_SIGNS = "▴▸▾◂"
# by which of a cell's quarters have the first colour: bit 0 the north-western
_QUADRANTS = " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"
_AHEAD_PIXELS = 4
_ENTRY_MASK = (1 << PAIR_BITS) - 1
_MACHINE, _CROSS = 1 << 20, (1 << 20) + len(_MACHINE_SIGNS)  # above all codes of ground
# of line k: + k x 2^16 + its dots x 2^8 + the entry behind it
_LINE_CODE = 1 << 21
# where colours are few: the outline; guidance, driven, ahead; the next pass
_LINE_SIGNS = "#*."
# of the outline's colour: the next pass is fainter
_NEXT_PASS_SHARE = 0.55
_GLOW_SHARE = 0.78  # of its own colour, the rest is the machine's
PLANNED_SHARE = 0.38  # planned ground is fainter than worked
LAID_SHARE = 0.62  # a laid file stands between the two
# where colours are few
LEVELS_DONE, LEVELS_PLAN, LEVELS_ERROR, LEVELS_LAID = "░▒▓█", "1234", "Ll.hH", "abcd"


class MapView(NamedTuple):
    """Holds what a map shows. version: of `worked`. place: outlets now, m; heading: degrees from
    north, clockwise. cross: a marked place."""

    worked: WorkedGround
    version: int
    picture: FieldPicture | None
    scale: LayerScale
    camera: MapCamera
    place: tuple[float, float] | None
    heading_deg: float | None
    plan: bool = True
    cross: tuple[float, float] | None = None
    stale: bool = False
    laid: LaidView | None = None
    # the guidance line, a boundary that is being driven
    lines: tuple[tuple[tuple[float, float], ...], ...] = ()


@lru_cache(maxsize=4)  # a field stands still, as a rule
def make_outline_dots(picture: FieldPicture | None, pixels: PixelGrid) -> Image:
    """The field's outline as dots of braille."""
    return rasterise_lines(
        [(*ring, ring[0]) for ring in picture.rings_m] if picture is not None else (), pixels
    )


def make_cell_codes(view: MapView, pixels: PixelGrid) -> Codes:
    """Every cell's content, in numbers that MapInk draws. pixels: two of them a cell."""
    width, height = pixels.columns, pixels.rows // 2
    fine = pixels.halve_pixels()
    seen = make_image(view.worked, view.picture, view.scale, fine, view.plan, view.laid)
    mark_trail(seen, view.worked, fine)
    found, behind = choose_two_colours(seen)
    for kind, dots in (
        (2, rasterise_lines(find_next_passes(view.worked, pixels), pixels)),
        (0, make_outline_dots(view.picture, pixels)),
        (1, rasterise_lines((*view.lines, *_list_way_ahead(view)), pixels)),
    ):
        at = np.nonzero(dots)
        found[at] = (
            _LINE_CODE
            + (kind << 2 * PAIR_BITS)
            + (dots[at].astype(np.int32) << PAIR_BITS)
            + behind[at]
        )
    for place, code in (
        (view.cross, _CROSS),
        (view.place, _MACHINE + round((view.heading_deg or 0.0) / 90) % 4),
    ):
        column, row = pixels.find_pixel(*place) if place is not None else (-1, -1)
        if 0 <= column < width and 0 <= row < 2 * height:
            found[row // 2, column] = code
    return found


def _list_way_ahead(view: MapView) -> tuple[Ring, ...]:
    if view.place is None or view.heading_deg is None:
        return ()
    far_m, angle = _AHEAD_PIXELS * view.camera.metres, radians(view.heading_deg)
    return ((view.place, (view.place[0] + far_m * sin(angle), view.place[1] + far_m * cos(angle))),)


class MapCell(NamedTuple):
    """Holds one cell of a map. None: the colour of the ground below."""

    text: str
    fore: Rgb | None = None
    back: Rgb | None = None


class MapInk:
    """Holds the colours of a map on a widget, by its theme. laid: the scale of a laid file.
    planned_share: of its colour, that planned ground has; the rest is background."""

    def __init__(
        self,
        on: Widget,
        scale: LayerScale,
        laid: LayerScale | None = None,
        stale: bool = False,
        planned_share: float = PLANNED_SHARE,
    ) -> None:
        named = on.app.theme_variables
        self.ground = find_rgb(on.rich_style.bgcolor, (0, 0, 0))
        passage, outline, machine, old, bare = (
            find_rgb(Color.parse(named[name]), (128, 128, 128))
            for name in ("track", "muted", "foreground", "stale", "background")
        )
        self._few, self._layers = (
            has_few_colours(on.app),
            {DONE_ENTRY: scale.layer, PLAN_ENTRY: scale.layer, LAID_ENTRY: (laid or scale).layer},
        )
        steps, of_laid = (
            [one.find_colour(step / (COLOUR_STEPS - 1)) for step in range(COLOUR_STEPS)]
            for one in (scale, laid or scale)
        )
        self._palette = (
            self.ground,
            passage,
            *steps,
            *(mix_colours(step, self.ground, planned_share) for step in steps),
            *(mix_colours(step, self.ground, LAID_SHARE) for step in of_laid),
            *(mix_colours(step, machine, _GLOW_SHARE) for step in steps),
        )
        self._line_colours = (outline, machine, mix_colours(outline, self.ground, _NEXT_PASS_SHARE))
        self._mark, self._machine = (bare, machine), (bare, old if stale else machine)

    def draw_cell(self, code: int) -> MapCell:
        """The cell of a code."""
        first, second = code >> PAIR_BITS & _ENTRY_MASK, code & _ENTRY_MASK
        kind = code >> 2 * PAIR_BITS & 0xF
        if code >= _LINE_CODE:
            return (
                MapCell(_LINE_SIGNS[kind])
                if self._few
                else MapCell(
                    chr(BLANK_CODE | first),
                    self._line_colours[kind],
                    self._find_entry_colour(second),
                )
            )
        if code >= _MACHINE:
            return (
                MapCell("+", *self._mark)
                if code == _CROSS
                else MapCell(_MACHINE_SIGNS[code - _MACHINE], *self._machine)
            )
        if self._few:
            return MapCell(self._find_plain_sign(second if kind == 0 or second != EMPTY else first))
        if kind == 0:
            return (
                MapCell(" ")
                if second == EMPTY
                else MapCell("█", self._palette[second], self._palette[second])
            )
        return MapCell(_QUADRANTS[kind], self._palette[first], self._find_entry_colour(second))

    def _find_entry_colour(self, entry: int) -> Rgb | None:
        return None if entry == EMPTY else self._palette[entry]

    def _find_plain_sign(self, entry: int) -> str:
        """A character for a palette entry, where there are few colours."""
        if entry in (EMPTY, PASSAGE):
            return {EMPTY: " ", PASSAGE: ":"}[entry]
        entry -= GLOW_ENTRY - DONE_ENTRY if entry >= GLOW_ENTRY else 0
        first, levels = next(
            (first, levels)
            for first, levels in (
                (LAID_ENTRY, LEVELS_LAID),
                (PLAN_ENTRY, LEVELS_PLAN),
                (DONE_ENTRY, LEVELS_DONE),
            )
            if entry >= first
        )
        levels = LEVELS_ERROR if self._layers[first] is MapLayer.ERROR else levels
        return levels[(entry - first) * len(levels) // COLOUR_STEPS]


_NO_GROUND = WorkedGround()


def find_planned_scale(picture: FieldPicture | None, units: Units) -> LayerScale:
    """The scale of the plan, where nothing is spread yet."""
    return find_colour_scale(MapLayer.APPLIED, _NO_GROUND, picture, units)


def draw_small_map(
    on: Widget, picture: FieldPicture | None, columns: int, rows: int
) -> list[list[tuple[str, str]]]:
    """Rows of (character, style) of a field without a machine, whole, for questions and lists: its
    outline, and the plan in full colours."""
    if picture is None or picture.box is None:
        return []
    scale = find_planned_scale(picture, METRIC)
    camera = fit_box(picture.box, columns, 2 * rows, snug=True)
    pixels = PixelGrid(
        columns,
        2 * rows,
        camera.metres,
        camera.east_m - 0.5 * columns * camera.metres,
        camera.north_m + rows * camera.metres,
    )
    ink = MapInk(on, scale, planned_share=1.0)

    def format_cell(cell: MapCell) -> tuple[str, str]:
        return cell.text, " on ".join(
            "#{:02x}{:02x}{:02x}".format(*rgb) for rgb in cell[1:] if rgb is not None
        )

    view = MapView(_NO_GROUND, 0, picture, scale, camera, None, None)
    return [
        [format_cell(ink.draw_cell(code)) for code in row]
        for row in make_cell_codes(view, pixels).tolist()
    ]


def mix_colours(rgb: Rgb, ground: Rgb, share: float) -> Rgb:
    """A colour of which `share` is seen over the background."""
    red, green, blue = (
        round(share * a + (1 - share) * b) for a, b in zip(rgb, ground, strict=True)
    )
    return red, green, blue


def find_rgb(colour: Color | None, otherwise: Rgb) -> Rgb:
    """The colour as RGB, else `otherwise`."""
    if colour is None:
        return otherwise
    red, green, blue = colour.get_truecolor()
    return red, green, blue
