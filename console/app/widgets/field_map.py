"""A map in half-blocks: every cell of the terminal is two square pixels. Lines lie over the colours as braille, half a
pixel thin. Only rows that changed are drawn again."""
from __future__ import annotations

from math import cos, radians, sin
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.strip import Strip

from console.app.braille import BLANK
from console.app.camera import MapCamera, Pixels
from console.app.field_picture import FieldPicture, Ring
from console.app.laid import LaidView
from console.app.layers import LayerScale, MapLayer
from console.app.map_image import DONE, EMPTY, GLOW, LAID, PASSAGE, PLAN, Image, glow, image, line_dots, next_passes
from console.app.scale import STEPS, Rgb
from console.app.terminal import few_colours
from console.app.widgets.canvas import Canvas
from console.app.worked import Worked
from console.locale import _

Codes = npt.NDArray[np.int32]            # (rows, columns) of the terminal

_NOSES = "▴▸▾◂"
_AHEAD_PIXELS = 4
_PAIR = 256                              # a cell's code: upper entry x _PAIR + lower entry
_MACHINE, _CROSS = _PAIR * _PAIR, _PAIR * _PAIR + 4
_LINE = 2 * _PAIR * _PAIR                # of line k: (k + 2) x _PAIR^2 + its dots x _PAIR + the entry behind it
_LINES = "#*."                           # where colours are few: the outline; guidance, driven, ahead; the next pass
_NEXT_SHARE = 0.55                       # of the outline's colour: the next pass is fainter
_GLOW_SHARE = 0.78                       # of its own colour, the rest is the machine's
_PLANNED_SHARE = 0.38                    # of its colour, the rest is background: planned ground is fainter than worked
LAID_SHARE = 0.62                        # a laid file stands between the two
LEVELS_DONE, LEVELS_PLAN, LEVELS_ERROR, LEVELS_LAID = "░▒▓█", "1234", "Ll.hH", "abcd"     # where colours are few


class MapView(NamedTuple):
    """version: of `worked`. place: outlets now, m; heading: degrees from north, clockwise. cross: a marked place."""

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
    lines: tuple[tuple[tuple[float, float], ...], ...] = ()       # the guidance line, a boundary that is being driven


class FieldMap(Canvas[MapView]):
    COMPONENT_CLASSES: ClassVar[set[str]] = {"map--passage", "map--outline", "map--muted", "map--tractor",
                                             "map--stale"}

    def __init__(self, view: MapView, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(view, id=id, classes=classes)
        self._codes: Codes | None = None
        self._outline: tuple[FieldPicture | None, Pixels, Image] | None = None      # of a field, as seen
        self._segments: dict[int, Segment] = {}
        self._dressed_for: object = None
        self.rows_drawn = 0

    def pixels(self) -> Pixels:
        """What is seen at the widget's size."""
        width, height = self.content_size
        return self.view.camera.pixels(width, 2 * height)

    def show(self, view: MapView) -> None:
        """Only the rows that look other than before are drawn again."""
        if view == self.view:
            return
        self.view = view
        self.redraws += 1
        width, height = self.content_size
        if self._painted_for != (width, height, self.app.theme) or self._codes is None:
            self._painted_for = None
            self.refresh()
            return
        changed = self._bring(width, height)
        self.refresh(*(Region(0, row, width, 1) for row in changed))

    def paint(self, view: MapView, width: int, height: int) -> list[Strip]:
        self._codes = None
        self._painted = []
        if width > 0 and height > 0:
            self._bring(width, height)
        return self._painted

    def _bring(self, width: int, height: int) -> list[int]:
        """Strips of the rows whose codes are other than before; their numbers."""
        self._dress()
        codes = self._cells(width, height)
        old = self._codes
        fresh = old is None or old.shape != codes.shape or len(self._painted) != height
        changed = list(range(height)) if fresh or old is None else np.flatnonzero(
            (codes != old).any(axis=1)).tolist()
        if fresh:
            self._painted = [Strip.blank(width)] * height
        for row in changed:
            self._painted[row] = self._strip(codes[row], width)
        self._codes = codes
        self.rows_drawn += len(changed)
        view = self.view
        if view.place is None and view.worked.box is None and (view.picture is None or view.picture.box is None):
            self._painted[height // 2] = self.text_strip(width, (f" {_('no position yet')}", self.style("map--muted")))
            changed = list(range(height))
        return changed

    def _cells(self, width: int, height: int) -> Codes:
        view, pixels = self.view, self.pixels()
        seen = image(view.worked, view.picture, view.scale, pixels, view.plan, view.laid)
        glow(seen, view.worked, pixels)
        machine = pixels.at(*view.place) if view.place is not None else None
        codes = seen[0::2].astype(np.int32) * _PAIR + seen[1::2]
        if self._outline is None or self._outline[:2] != (view.picture, pixels):        # it stands still, as a rule
            rings = view.picture.rings_m if view.picture is not None else ()
            self._outline = view.picture, pixels, line_dots([(*ring, ring[0]) for ring in rings], pixels)
        for kind, dots in ((2, line_dots(next_passes(view.worked, pixels), pixels)), (0, self._outline[2]),
                           (1, line_dots((*view.lines, *self._ahead()), pixels))):
            at = np.nonzero(dots)
            up, down = seen[0::2][at], seen[1::2][at]
            codes[at] = _LINE + (kind * _PAIR + dots[at].astype(np.int32)) * _PAIR + np.where(up != EMPTY, up, down)
        if view.cross is not None:
            column, row = pixels.at(*view.cross)
            if 0 <= column < width and 0 <= row < 2 * height:
                codes[row // 2, column] = _CROSS
        if machine is not None and 0 <= machine[0] < width and 0 <= machine[1] < 2 * height:
            codes[machine[1] // 2, machine[0]] = _MACHINE + round((view.heading_deg or 0.0) / 90) % 4
        return codes

    def _ahead(self) -> tuple[Ring, ...]:
        place, heading_deg = self.view.place, self.view.heading_deg
        if place is None or heading_deg is None:
            return ()
        far_m, angle = _AHEAD_PIXELS * self.view.camera.metres, radians(heading_deg)
        return ((place, (place[0] + far_m * sin(angle), place[1] + far_m * cos(angle))),)

    def _strip(self, codes: npt.NDArray[np.int32], width: int) -> Strip:
        begins = np.concatenate(([0], np.flatnonzero(np.diff(codes)) + 1, [width]))
        segments = []
        for begin, end in zip(begins[:-1].tolist(), begins[1:].tolist(), strict=True):
            code = int(codes[begin])
            one = self._segments.get(code)
            if one is None:
                one = self._segments[code] = self._segment(code)
            segments.append(one if end - begin == 1 else Segment(one.text * (end - begin), one.style))
        return Strip(segments, width)

    # --- colours ------------------------------------------------------------------------------------------------

    def _dress(self) -> None:
        """Forget segments that were made for other colours."""
        laid = self.view.laid.scale if self.view.laid is not None else self.view.scale
        wanted = (self.view.scale.layer, laid.layer, self.app.theme, self.view.stale, few_colours(self.app))
        if wanted == self._dressed_for:
            return
        self._dressed_for = wanted
        self._segments.clear()
        self._codes = None
        base = self.rich_style
        ground = rgb_of(base.bgcolor, (0, 0, 0))
        steps = [self.view.scale.colour(step / (STEPS - 1)) for step in range(STEPS)]
        outline, machine = self._rgb("map--outline"), rgb_of(self.style("map--tractor").bgcolor, (128, 128, 128))
        self._palette: list[Rgb] = [ground, self._rgb("map--passage"), *steps,
                                    *(mixed(step, ground, _PLANNED_SHARE) for step in steps),
                                    *(mixed(laid.colour(step / (STEPS - 1)), ground, LAID_SHARE)
                                      for step in range(STEPS)),
                                    *(mixed(step, machine, _GLOW_SHARE) for step in steps)]
        self._line_colours = (outline, machine, mixed(outline, ground, _NEXT_SHARE))

    def _rgb(self, name: str) -> Rgb:
        return rgb_of(self.style(name).color, (128, 128, 128))

    def _segment(self, code: int) -> Segment:
        base = self.rich_style
        if code >= _LINE:
            kind, rest = divmod(code - _LINE, _PAIR * _PAIR)
            dots, behind = divmod(rest, _PAIR)
            if few_colours(self.app):
                return Segment(_LINES[kind], base)
            back = None if behind == EMPTY else self._palette[behind]
            return Segment(chr(BLANK | dots), base + _style(self._line_colours[kind], back))
        if code >= _CROSS:
            return Segment("+", self.style("map--tractor"))
        if code >= _MACHINE:
            return Segment(_NOSES[code - _MACHINE], self.style("map--stale" if self.view.stale else "map--tractor"))
        up, down = divmod(code, _PAIR)
        if few_colours(self.app):
            return Segment(_plain(up or down, self.view), base)
        if up == down:
            return Segment(" " if up == EMPTY else "█", base + _style(self._palette[up], self._palette[up]))
        if up == EMPTY:
            return Segment("▄", base + _style(self._palette[down], None))
        if down == EMPTY:
            return Segment("▀", base + _style(self._palette[up], None))
        return Segment("▀", base + _style(self._palette[up], self._palette[down]))


def _plain(entry: int, view: MapView) -> str:
    """A character for a palette entry, where colours cannot tell."""
    if entry in (EMPTY, PASSAGE):
        return {EMPTY: " ", PASSAGE: ":"}[entry]
    entry -= GLOW - DONE if entry >= GLOW else 0
    first, levels = next((first, levels) for first, levels in (
        (LAID, LEVELS_LAID), (PLAN, LEVELS_PLAN), (DONE, LEVELS_DONE)) if entry >= first)
    scale = view.laid.scale if first == LAID and view.laid is not None else view.scale
    levels = LEVELS_ERROR if scale.layer is MapLayer.ERROR else levels
    return levels[(entry - first) * len(levels) // STEPS]


def mixed(rgb: Rgb, ground: Rgb, share: float) -> Rgb:
    """A colour of which `share` is seen over the background."""
    red, green, blue = (round(share * a + (1 - share) * b) for a, b in zip(rgb, ground, strict=True))
    return red, green, blue


def _style(fore: Rgb, back: Rgb | None) -> Style:
    return Style(color=Color.from_rgb(*fore), bgcolor=Color.from_rgb(*back) if back is not None else None)


def rgb_of(colour: Color | None, otherwise: Rgb) -> Rgb:
    if colour is None:
        return otherwise
    red, green, blue = colour.get_truecolor()
    return red, green, blue
