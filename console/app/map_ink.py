"""Draws every map: pages, previews and lists show terminal cells of 2 x 2 pixels in two colours,
with braille lines of half a pixel above them.
"""

from __future__ import annotations

from functools import lru_cache
from math import cos, radians, sin
from typing import NamedTuple

import numpy as np
from rich.color import Color
from textual.widget import Widget
from topdress.console.app.braille import BLANK_BRAILLE_CODE
from topdress.console.app.coverage_raster import WorkedGround
from topdress.console.app.field_picture import FieldPicture, Ring
from topdress.console.app.map_camera import MapCamera, PixelGrid, fit_box
from topdress.console.app.map_image import (
    DONE_ENTRY,
    EMPTY_ENTRY,
    ENTRY_BITS,
    OVERLAY_ENTRY,
    PASSAGE_ENTRY,
    PLAN_ENTRY,
    TRAIL_ENTRY,
    Codes,
    Image,
    choose_two_colours,
    find_next_passes,
    make_image,
    mark_trail,
    rasterise_lines,
)
from topdress.console.app.map_layers import LayerScale, MapLayer, find_colour_scale
from topdress.console.app.overlay_file import OverlayView
from topdress.console.app.terminal import has_few_colours
from topdress.console.app.units import METRIC, Units
from topdress.console.colour_scale import COLOUR_STEPS, Rgb

# Arrows for north, east, south and west: a cell has no room for finer headings.
_MACHINE_SIGNS = "▴▸▾◂"
# Block character by the bits of the quarters in the first colour; bit 0 is the north-western
# quarter.
_QUADRANTS = " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"
# Length of the line ahead of the machine, in pixels.
_WAY_AHEAD_PIXELS = 4
_ENTRY_MASK = (1 << ENTRY_BITS) - 1
# Codes of machine and cross lie above all codes of ground.
_MACHINE, _CROSS = 1 << 20, (1 << 20) + len(_MACHINE_SIGNS)  # above all codes of ground
# Code of a line: this base, plus the kind of line x 2^16, plus its dots x 2^8, plus the entry
# behind the line.
_LINE_CODE = 1 << 21
# Characters of the lines on terminals with few colours: outline; guidance, boundary and way ahead;
# next pass.
_LINE_SIGNS = "#*."
# The next pass has this share of the outline's colour, because it is a suggestion only.
_NEXT_PASS_COLOUR_SHARE = 0.55
# Share of the layer's colour on the trail; the rest is the machine's colour.
_TRAIL_COLOUR_SHARE = 0.78
# Share of the layer's colour on planned ground, which must look fainter than worked ground.
PLAN_COLOUR_SHARE = 0.38
# Share of the layer's colour in an overlaid file: between planned and worked ground.
OVERLAY_COLOUR_SHARE = 0.62
# Characters of the levels on terminals with few colours, from low to high.
WORKED_LEVEL_SIGNS, PLAN_LEVEL_SIGNS, ERROR_LEVEL_SIGNS, OVERLAY_LEVEL_SIGNS = (
    "░▒▓█",
    "1234",
    "Ll.hH",
    "abcd",
)


class MapView(NamedTuple):
    """Holds everything that a map shows.

    Attributes
    ----------
    version
        Version of `worked` at this moment: `worked` itself changes in place, so comparing views
        needs the number.
    place
        Position of the outlets, east and north, m.
    heading_deg
        Heading in degrees clockwise from north.
    cross
        Marked position, m.
    stale
        True if the position is outdated.
    """

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
    laid: OverlayView | None = None
    # Guidance line and boundary in progress.
    lines: tuple[tuple[tuple[float, float], ...], ...] = ()


# A field does not move, so few outlines are drawn again and again.
@lru_cache(maxsize=4)
def make_outline_dots(picture: FieldPicture | None, pixels: PixelGrid) -> Image:
    """Return the field's outline as braille dots."""
    return rasterise_lines(
        [(*ring, ring[0]) for ring in picture.rings_m] if picture is not None else (), pixels
    )


def make_cell_codes(view: MapView, pixels: PixelGrid) -> Codes:
    """Return every cell's content as a number that `MapInk` draws.

    Parameters
    ----------
    view
        Contents of the map.
    pixels
        Grid with two pixels per terminal cell.
    """
    width, height = pixels.columns, pixels.rows // 2
    # Two pixels across a cell show details of half a cell.
    fine = pixels.halve_pixels()
    seen = make_image(view.worked, view.picture, view.scale, fine, view.plan, view.laid)
    mark_trail(seen, view.worked, fine)
    found, behind = choose_two_colours(seen)
    # Later lines cover earlier lines: guidance matters more than the outline, the outline more than
    # the next pass.
    for kind, dots in (
        (2, rasterise_lines(find_next_passes(view.worked, pixels), pixels)),
        (0, make_outline_dots(view.picture, pixels)),
        (1, rasterise_lines((*view.lines, *_list_way_ahead(view)), pixels)),
    ):
        at = np.nonzero(dots)
        found[at] = (
            _LINE_CODE
            + (kind << 2 * ENTRY_BITS)
            + (dots[at].astype(np.int32) << ENTRY_BITS)
            + behind[at]
        )
    # The machine comes last, so that nothing hides it.
    for place, code in (
        (view.cross, _CROSS),
        (view.place, _MACHINE + round((view.heading_deg or 0.0) / 90) % 4),
    ):
        column, row = pixels.find_pixel(*place) if place is not None else (-1, -1)
        if 0 <= column < width and 0 <= row < 2 * height:
            found[row // 2, column] = code
    return found


def _list_way_ahead(view: MapView) -> tuple[Ring, ...]:
    """Return the short line ahead of the machine that shows its heading."""
    if view.place is None or view.heading_deg is None:
        return ()
    far_m, angle = _WAY_AHEAD_PIXELS * view.camera.metres, radians(view.heading_deg)
    return ((view.place, (view.place[0] + far_m * sin(angle), view.place[1] + far_m * cos(angle))),)


class MapCell(NamedTuple):
    """Holds one cell of a map; a colour of None means the background."""

    text: str
    fore: Rgb | None = None
    back: Rgb | None = None


class MapInk:
    """Holds the colours of a map on a widget, from the widget's theme.

    Parameters
    ----------
    on
        Widget that shows the map.
    scale
        Colour scale of the layer.
    laid
        Colour scale of the overlaid file.
    stale
        True: the machine is drawn in the colour of outdated values.
    planned_share
        Share of the layer's colour on planned ground; the rest is background.
    """

    def __init__(
        self,
        on: Widget,
        scale: LayerScale,
        laid: LayerScale | None = None,
        stale: bool = False,
        planned_share: float = PLAN_COLOUR_SHARE,
    ) -> None:
        named = on.app.theme_variables
        self.ground = find_rgb(on.rich_style.bgcolor, (0, 0, 0))
        passage, outline, machine, old, bare = (
            find_rgb(Color.parse(named[name]), (128, 128, 128))
            for name in ("track", "muted", "foreground", "stale", "background")
        )
        self._has_few_colours, self._layers = (
            has_few_colours(on.app),
            {
                DONE_ENTRY: scale.layer,
                PLAN_ENTRY: scale.layer,
                OVERLAY_ENTRY: (laid or scale).layer,
            },
        )
        steps, of_laid = (
            [one.find_colour(step / (COLOUR_STEPS - 1)) for step in range(COLOUR_STEPS)]
            for one in (scale, laid or scale)
        )
        # The order of the palette is that of the `*_ENTRY` constants of `map_image`.
        self._palette = (
            self.ground,
            passage,
            *steps,
            *(mix_colours(step, self.ground, planned_share) for step in steps),
            *(mix_colours(step, self.ground, OVERLAY_COLOUR_SHARE) for step in of_laid),
            *(mix_colours(step, machine, _TRAIL_COLOUR_SHARE) for step in steps),
        )
        self._line_colours = (
            outline,
            machine,
            mix_colours(outline, self.ground, _NEXT_PASS_COLOUR_SHARE),
        )
        self._mark, self._machine = (bare, machine), (bare, old if stale else machine)

    def draw_cell(self, code: int) -> MapCell:
        """Return the cell of a code of `make_cell_codes`."""
        first, second = code >> ENTRY_BITS & _ENTRY_MASK, code & _ENTRY_MASK
        kind = code >> 2 * ENTRY_BITS & 0xF
        if code >= _LINE_CODE:
            return (
                MapCell(_LINE_SIGNS[kind])
                if self._has_few_colours
                else MapCell(
                    chr(BLANK_BRAILLE_CODE | first),
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
        # A terminal with few colours shows one character per cell, so the emptier entry yields.
        if self._has_few_colours:
            return MapCell(
                self._find_plain_sign(second if kind == 0 or second != EMPTY_ENTRY else first)
            )
        if kind == 0:
            return (
                MapCell(" ")
                if second == EMPTY_ENTRY
                else MapCell("█", self._palette[second], self._palette[second])
            )
        return MapCell(_QUADRANTS[kind], self._palette[first], self._find_entry_colour(second))

    def _find_entry_colour(self, entry: int) -> Rgb | None:
        """Return the colour of an entry; empty ground has the background's."""
        return None if entry == EMPTY_ENTRY else self._palette[entry]

    def _find_plain_sign(self, entry: int) -> str:
        """Return a character for a palette entry on a terminal with few colours."""
        if entry in (EMPTY_ENTRY, PASSAGE_ENTRY):
            return {EMPTY_ENTRY: " ", PASSAGE_ENTRY: ":"}[entry]
        # The trail has the characters of worked ground.
        entry -= TRAIL_ENTRY - DONE_ENTRY if entry >= TRAIL_ENTRY else 0
        first, levels = next(
            (first, levels)
            for first, levels in (
                (OVERLAY_ENTRY, OVERLAY_LEVEL_SIGNS),
                (PLAN_ENTRY, PLAN_LEVEL_SIGNS),
                (DONE_ENTRY, WORKED_LEVEL_SIGNS),
            )
            if entry >= first
        )
        levels = ERROR_LEVEL_SIGNS if self._layers[first] is MapLayer.ERROR else levels
        return levels[(entry - first) * len(levels) // COLOUR_STEPS]


# Ground of maps without a machine.
_NO_WORKED_GROUND = WorkedGround()


def find_planned_scale(picture: FieldPicture | None, units: Units) -> LayerScale:
    """Return the colour scale of a plan before anything is spread."""
    return find_colour_scale(MapLayer.APPLIED, _NO_WORKED_GROUND, picture, units)


def draw_small_map(
    on: Widget, picture: FieldPicture | None, columns: int, rows: int
) -> list[list[tuple[str, str]]]:
    """Draw a whole field without a machine, for questions and lists: outline and plan in full
    colours.

    Returns
    -------
    list
        Rows of (character, Rich style).
    """
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

    view = MapView(_NO_WORKED_GROUND, 0, picture, scale, camera, None, None)
    return [
        [format_cell(ink.draw_cell(code)) for code in row]
        for row in make_cell_codes(view, pixels).tolist()
    ]


def mix_colours(rgb: Rgb, ground: Rgb, share: float) -> Rgb:
    """Return a colour of which `share` is visible over the background."""
    red, green, blue = (
        round(share * a + (1 - share) * b) for a, b in zip(rgb, ground, strict=True)
    )
    return red, green, blue


def find_rgb(colour: Color | None, otherwise: Rgb) -> Rgb:
    """Return a colour as RGB, or `otherwise` for None."""
    if colour is None:
        return otherwise
    red, green, blue = colour.get_truecolor()
    return red, green, blue
