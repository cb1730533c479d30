"""Shows the meaning of a map's colours and a scale bar in one row."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

from rich.cells import cell_len
from rich.color import Color
from rich.style import Style
from textual.strip import Strip
from textual.widget import Widget
from topdress.console.app.map_ink import (
    ERROR_LEVEL_SIGNS,
    PLAN_LEVEL_SIGNS,
    WORKED_LEVEL_SIGNS,
    find_rgb,
    mix_colours,
)
from topdress.console.app.map_layers import RATE_LAYERS, LayerScale, MapLayer
from topdress.console.app.terminal import has_few_colours
from topdress.console.app.units import Unit
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.locale import _

# Length of the scale bar, in cells; a cell is one pixel wide.
_SCALE_BAR_CELLS = 6
# Limits of the width of the colour ramp, in cells.
_MIN_RAMP_CELLS, _MAX_RAMP_CELLS = 6, 32


class LegendView(NamedTuple):
    """Holds the legend. `metres` is the size of a pixel, `distance` the unit of the scale bar;
    `planned` is True if planned ground is visible."""

    scale: LayerScale
    metres: float
    distance: Unit
    planned: bool


def draw_colour_ramp(
    on: Widget, scale: LayerScale, cells: int, levels: str, share: float = 1.0
) -> list[tuple[str, Style]]:
    """Return the colours of a scale, or characters on a terminal with few colours. `share` is the
    share of the colour over the background of `on`."""
    base = on.rich_style
    if has_few_colours(on.app):
        return [(levels, base)]
    ground = find_rgb(base.bgcolor, (0, 0, 0))
    colours = [
        Color.from_rgb(*mix_colours(scale.find_colour(step / (cells - 1)), ground, share))
        for step in range(cells)
    ]
    return [("█", base + Style(color=colour, bgcolor=colour)) for colour in colours]


class MapLegend(Canvas[LegendView]):
    """Shows the map's colours and scale."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {"map--muted"}

    def draw_rows(self, view: LegendView, width: int, height: int) -> list[Strip]:
        if width < 16:
            return []
        muted = self.find_style("map--muted")
        scale = view.scale
        low, high = f" {scale.format_value(scale.low)} ", f" {scale.format_value(scale.high)}"
        unit = f" {scale.unit}" if scale.unit else ""
        bar = f" {view.distance.format_with_name(_SCALE_BAR_CELLS * view.metres)}"
        planned = f"  {_('faint: planned')}" if view.planned and scale.layer in RATE_LAYERS else ""
        if has_few_colours(self.app):
            planned = f" {PLAN_LEVEL_SIGNS} {_('planned')}" if planned else ""
        room = width - _SCALE_BAR_CELLS - 2 - sum(cell_len(text) for text in (low, high, bar))
        # Unit and remark are dropped before the ramp becomes too short.
        unit = unit if cell_len(unit) + _MIN_RAMP_CELLS <= room else ""
        room -= cell_len(unit)
        planned = planned if cell_len(planned) + _MIN_RAMP_CELLS <= room else ""
        levels = ERROR_LEVEL_SIGNS if scale.layer is MapLayer.ERROR else WORKED_LEVEL_SIGNS
        ramp = draw_colour_ramp(
            self,
            scale,
            max(_MIN_RAMP_CELLS, min(_MAX_RAMP_CELLS, room - cell_len(planned))),
            levels,
        )
        return [
            self.make_text_strip(
                width,
                (low, muted),
                *ramp,
                (f"{high}{unit}{planned}  ", muted),
                ("▀" * _SCALE_BAR_CELLS, muted),
                (bar, muted),
            )
        ]
