"""A small map: where the outlets went, coloured by what was applied there, and where the tractor is now."""
from __future__ import annotations

from collections.abc import Iterable
from math import ceil
from typing import ClassVar, NamedTuple

from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

from console.app.history import Spot
from console.app.scale import Rgb, calm_ends, colour
from console.app.units import Unit
from console.app.widgets.canvas import Canvas
from console.locale import _

_STEPS_M = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0, 200.0)
_LEAST_SPAN_M = 40.0
_NOSES = "▴▸▾◂"
_NOTHING_KG_HA = 1.0           # less than this is drawn as passage, not as applied


class MapView(NamedTuple):
    """place: outlets now, m; heading: degrees from north, clockwise; unit: of the rate; distance: of the scale bar."""

    track: tuple[Spot, ...]
    place: tuple[float, float] | None
    heading_deg: float | None
    unit: Unit
    distance: Unit
    stale: bool = False


class Frame(NamedTuple):
    """How metres become pixels: metres a pixel, and the place of the upper left pixel's corner."""

    metres: float
    west_m: float
    north_m: float

    def pixel(self, east_m: float, north_m: float) -> tuple[int, int]:
        return int((east_m - self.west_m) // self.metres), int((self.north_m - north_m) // self.metres)


def frame_around(places: Iterable[tuple[float, float]], columns: int, rows: int) -> Frame:
    """The frame of columns x rows pixels that holds all places (m east, north), at a round scale."""
    places = list(places) or [(0.0, 0.0)]
    west, east = min(p[0] for p in places), max(p[0] for p in places)
    south, north = min(p[1] for p in places), max(p[1] for p in places)
    need = max((east - west) / (columns - 4), (north - south) / (rows - 4), _LEAST_SPAN_M / min(columns, rows))
    metres = next((step for step in _STEPS_M if step >= need), need)
    middle_east = ceil((west + east) / 2 / metres) * metres
    middle_north = ceil((south + north) / 2 / metres) * metres
    return Frame(metres, middle_east - columns / 2 * metres, middle_north + rows / 2 * metres)


class FieldMap(Canvas[MapView]):
    """Half-blocks: every cell is two square pixels."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {"map--passage", "map--muted", "map--title", "map--tractor", "map--stale"}

    def paint(self, view: MapView, width: int, height: int) -> list[Strip]:
        map_rows = height - 2
        if map_rows < 3 or width < 16:
            return []
        title, muted = self.style("map--title"), self.style("map--muted")
        given = [s.applied_kg_ha * view.unit.per_si for s in view.track
                 if s.applied_kg_ha is not None and s.applied_kg_ha >= _NOTHING_KG_HA]
        ends = calm_ends(given)
        places = [(spot.east_m, spot.north_m) for spot in view.track]
        if view.place is not None:
            places.append(view.place)
        frame = frame_around(places, width, map_rows * 2)
        rows = [self.text_strip(width, (f" {_('map')} ", title), (f"{_('applied')} {view.unit.name}", muted))]
        pixels = self._pixels(view, frame, ends)
        tractor = frame.pixel(*view.place) if view.place is not None else None
        rows += [Strip(self._row(row, width, pixels, tractor, view)).adjust_cell_length(width)
                 for row in range(map_rows)]
        if not places:
            rows[1 + map_rows // 2] = self.text_strip(width, (f" {_('no position yet')}", muted))
        rows.append(self._legend(view, width, frame, ends))
        return rows

    def _pixels(self, view: MapView, frame: Frame, ends: tuple[float, float]) -> dict[tuple[int, int], Rgb]:
        passage = self.style("map--passage").color
        passage_rgb: Rgb = tuple(passage.get_truecolor()) if passage else (128, 128, 128)
        pixels: dict[tuple[int, int], Rgb] = {}
        for spot in view.track:
            rate = spot.applied_kg_ha
            shown = None
            if rate is not None and rate >= _NOTHING_KG_HA:
                shown = colour((rate * view.unit.per_si - ends[0]) / (ends[1] - ends[0]))
            place = frame.pixel(spot.east_m, spot.north_m)
            if shown is not None:
                pixels[place] = shown
            else:
                pixels.setdefault(place, passage_rgb)
        return pixels

    def _row(self, row: int, width: int, pixels: dict[tuple[int, int], Rgb], tractor: tuple[int, int] | None,
             view: MapView) -> list[Segment]:
        base = self.rich_style
        segments = []
        for column in range(width):
            if tractor is not None and tractor[0] == column and tractor[1] // 2 == row:
                nose = _NOSES[round((view.heading_deg or 0.0) / 90) % 4]
                segments.append(Segment(nose, self.style("map--stale" if view.stale else "map--tractor")))
                continue
            up, down = pixels.get((column, 2 * row)), pixels.get((column, 2 * row + 1))
            if up is None and down is None:
                segments.append(Segment(" ", base))
            elif up == down:
                segments.append(Segment("█", base + _fore(up) + _back(up)))
            elif up is None:
                segments.append(Segment("▄", base + _fore(down)))
            elif down is None:
                segments.append(Segment("▀", base + _fore(up)))
            else:
                segments.append(Segment("▀", base + _fore(up) + _back(down)))
        return segments

    def _legend(self, view: MapView, width: int, frame: Frame, ends: tuple[float, float]) -> Strip:
        muted = self.style("map--muted")
        cells = max(6, min(16, width - 26))
        steps = [colour(step / (cells - 1)) for step in range(cells)]
        ramp = [("█", self.rich_style + _fore(step) + _back(step)) for step in steps]
        bar_cells = 6
        bar = view.distance.full(bar_cells * frame.metres)
        return self.text_strip(width, (f" {ends[0]:.0f} ", muted), *ramp, (f" {ends[1]:.0f}  ", muted),
                               ("▀" * bar_cells, muted), (f" {bar}", muted))


def _back(rgb: Rgb) -> Style:
    return Style(bgcolor=Color.from_rgb(*rgb))


def _fore(rgb: Rgb | None) -> Style:
    return Style(color=Color.from_rgb(*rgb)) if rgb is not None else Style()
