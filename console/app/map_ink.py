"""One drawing for every map: what a page, a preview or a list shows of it are cells of the
terminal, 2 x 2 pixels each in two colours, with lines over them as braille, half a pixel thin."""

from __future__ import annotations

from functools import lru_cache
from math import cos, radians, sin
from typing import NamedTuple

import numpy as np
from rich.color import Color
from textual.widget import Widget
from topdress.console.app.braille import BLANK
from topdress.console.app.camera import MapCamera, Pixels, fit
from topdress.console.app.coverage_raster import Worked
from topdress.console.app.field_picture import FieldPicture, Ring
from topdress.console.app.layers import LayerScale, MapLayer, find_colour_scale
from topdress.console.app.map_image import (
    DONE,
    EMPTY,
    GLOW,
    LAID,
    PAIR_BITS,
    PASSAGE,
    PLAN,
    Codes,
    Image,
    find_next_passes,
    glow,
    halves,
    image,
    rasterise_lines,
)
from topdress.console.app.overlay_file import LaidView
from topdress.console.app.terminal import has_few_colours
from topdress.console.app.units import METRIC, Units
from topdress.console.scale import COLOUR_STEPS, Rgb

_NOSES = "▴▸▾◂"
# by which of a cell's quarters have the first colour: bit 0 the north-western
_QUADRANTS = " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"
_AHEAD_PIXELS = 4
_ENTRY = (1 << PAIR_BITS) - 1
_MACHINE, _CROSS = 1 << 20, (1 << 20) + len(_NOSES)  # above all codes of ground
# of line k: + k x 2^16 + its dots x 2^8 + the entry behind it
_LINE = 1 << 21
# where colours are few: the outline; guidance, driven, ahead; the next pass
_LINES = "#*."
# of the outline's colour: the next pass is fainter
_NEXT_SHARE = 0.55
_GLOW_SHARE = 0.78  # of its own colour, the rest is the machine's
PLANNED_SHARE = 0.38  # planned ground is fainter than worked
LAID_SHARE = 0.62  # a laid file stands between the two
# where colours are few
LEVELS_DONE, LEVELS_PLAN, LEVELS_ERROR, LEVELS_LAID = "░▒▓█", "1234", "Ll.hH", "abcd"


class MapView(NamedTuple):
    """version: of `worked`. place: outlets now, m; heading: degrees from north, clockwise.
    cross: a marked place."""

    worked: Worked
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
def outline_dots(picture: FieldPicture | None, pixels: Pixels) -> Image:
    return rasterise_lines(
        [(*ring, ring[0]) for ring in picture.rings_m] if picture is not None else (), pixels
    )


def codes(view: MapView, pixels: Pixels) -> Codes:
    """What every cell shows, in numbers that MapInk draws. pixels: two of them a cell."""
    width, height = pixels.columns, pixels.rows // 2
    fine = pixels.quarters()
    seen = image(view.worked, view.picture, view.scale, fine, view.plan, view.laid)
    glow(seen, view.worked, fine)
    found, behind = halves(seen)
    for kind, dots in (
        (2, rasterise_lines(find_next_passes(view.worked, pixels), pixels)),
        (0, outline_dots(view.picture, pixels)),
        (1, rasterise_lines((*view.lines, *_ahead(view)), pixels)),
    ):
        at = np.nonzero(dots)
        found[at] = (
            _LINE + (kind << 2 * PAIR_BITS) + (dots[at].astype(np.int32) << PAIR_BITS) + behind[at]
        )
    for place, code in (
        (view.cross, _CROSS),
        (view.place, _MACHINE + round((view.heading_deg or 0.0) / 90) % 4),
    ):
        column, row = pixels.at(*place) if place is not None else (-1, -1)
        if 0 <= column < width and 0 <= row < 2 * height:
            found[row // 2, column] = code
    return found


def _ahead(view: MapView) -> tuple[Ring, ...]:
    if view.place is None or view.heading_deg is None:
        return ()
    far_m, angle = _AHEAD_PIXELS * view.camera.metres, radians(view.heading_deg)
    return ((view.place, (view.place[0] + far_m * sin(angle), view.place[1] + far_m * cos(angle))),)


class Cell(NamedTuple):
    """None: the colour of what it lies on."""

    text: str
    fore: Rgb | None = None
    back: Rgb | None = None


class MapInk:
    """The colours of a map on a widget, by its theme. laid: the scale of a laid file.
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
            {DONE: scale.layer, PLAN: scale.layer, LAID: (laid or scale).layer},
        )
        steps, of_laid = (
            [one.colour(step / (COLOUR_STEPS - 1)) for step in range(COLOUR_STEPS)]
            for one in (scale, laid or scale)
        )
        self._palette = (
            self.ground,
            passage,
            *steps,
            *(mixed(step, self.ground, planned_share) for step in steps),
            *(mixed(step, self.ground, LAID_SHARE) for step in of_laid),
            *(mixed(step, machine, _GLOW_SHARE) for step in steps),
        )
        self._line_colours = (outline, machine, mixed(outline, self.ground, _NEXT_SHARE))
        self._mark, self._machine = (bare, machine), (bare, old if stale else machine)

    def cell(self, code: int) -> Cell:
        first, second = code >> PAIR_BITS & _ENTRY, code & _ENTRY
        kind = code >> 2 * PAIR_BITS & 0xF
        if code >= _LINE:
            return (
                Cell(_LINES[kind])
                if self._few
                else Cell(chr(BLANK | first), self._line_colours[kind], self._seen(second))
            )
        if code >= _MACHINE:
            return (
                Cell("+", *self._mark)
                if code == _CROSS
                else Cell(_NOSES[code - _MACHINE], *self._machine)
            )
        if self._few:
            return Cell(self._plain(second if kind == 0 or second != EMPTY else first))
        if kind == 0:
            return (
                Cell(" ")
                if second == EMPTY
                else Cell("█", self._palette[second], self._palette[second])
            )
        return Cell(_QUADRANTS[kind], self._palette[first], self._seen(second))

    def _seen(self, entry: int) -> Rgb | None:
        return None if entry == EMPTY else self._palette[entry]

    def _plain(self, entry: int) -> str:
        """A character for a palette entry, where colours cannot tell."""
        if entry in (EMPTY, PASSAGE):
            return {EMPTY: " ", PASSAGE: ":"}[entry]
        entry -= GLOW - DONE if entry >= GLOW else 0
        first, levels = next(
            (first, levels)
            for first, levels in ((LAID, LEVELS_LAID), (PLAN, LEVELS_PLAN), (DONE, LEVELS_DONE))
            if entry >= first
        )
        levels = LEVELS_ERROR if self._layers[first] is MapLayer.ERROR else levels
        return levels[(entry - first) * len(levels) // COLOUR_STEPS]


_NOTHING = Worked()


def planned_scale(picture: FieldPicture | None, units: Units) -> LayerScale:
    """Where nothing is spread yet."""
    return find_colour_scale(MapLayer.APPLIED, _NOTHING, picture, units)


def draw_small_map(
    on: Widget, picture: FieldPicture | None, columns: int, rows: int
) -> list[list[tuple[str, str]]]:
    """Rows of (character, style) of a field that no machine is on, whole, for questions and
    lists: its outline, and what is planned in full colours."""
    if picture is None or picture.box is None:
        return []
    scale = planned_scale(picture, METRIC)
    camera = fit(picture.box, columns, 2 * rows, snug=True)
    pixels = Pixels(
        columns,
        2 * rows,
        camera.metres,
        camera.east_m - 0.5 * columns * camera.metres,
        camera.north_m + rows * camera.metres,
    )
    ink = MapInk(on, scale, planned_share=1.0)

    def part(cell: Cell) -> tuple[str, str]:
        return cell.text, " on ".join(
            "#{:02x}{:02x}{:02x}".format(*rgb) for rgb in cell[1:] if rgb is not None
        )

    view = MapView(_NOTHING, 0, picture, scale, camera, None, None)
    return [[part(ink.cell(code)) for code in row] for row in codes(view, pixels).tolist()]


def mixed(rgb: Rgb, ground: Rgb, share: float) -> Rgb:
    """A colour of which `share` is seen over the background."""
    red, green, blue = (
        round(share * a + (1 - share) * b) for a, b in zip(rgb, ground, strict=True)
    )
    return red, green, blue


def find_rgb(colour: Color | None, otherwise: Rgb) -> Rgb:
    if colour is None:
        return otherwise
    red, green, blue = colour.get_truecolor()
    return red, green, blue
