"""One row: which file is laid on the map, and what its colours mean."""
from __future__ import annotations

from typing import ClassVar, NamedTuple

from rich.cells import cell_len
from textual.strip import Strip

from console.app.layers import LABELS, LayerScale, MapLayer
from console.app.widgets.canvas import Canvas
from console.app.widgets.field_map import LAID_SHARE, LEVELS_ERROR, LEVELS_LAID
from console.app.widgets.map_legend import ramp_of
from console.app.widgets.panel import fit
from console.locale import _

_LEAST_CELLS, _MOST_CELLS = 4, 24


class LaidLegendView(NamedTuple):
    """scale None: `said` in its place."""

    name: str
    label: str
    scale: LayerScale | None
    said: str


class LaidLegend(Canvas[LaidLegendView]):
    COMPONENT_CLASSES: ClassVar[set[str]] = {"map--muted"}

    def paint(self, view: LaidLegendView, width: int, height: int) -> list[Strip]:
        muted = self.style("map--muted")
        name = f" {_('file')} {view.name}: "
        if view.scale is None:
            name = fit(name, min(cell_len(name), max(0, width - cell_len(view.said))))
            return [self.text_strip(width, (name, self.rich_style), (view.said, muted))]
        scale = view.scale
        unit = f" {scale.unit}" if scale.unit else ""
        low, high = f"{view.label} {scale.text(scale.low)} ", f" {scale.text(scale.high)}{unit}"
        room = width - sum(map(cell_len, (low, high)))
        name = fit(name, min(cell_len(name), max(0, room - _LEAST_CELLS)))
        cells = max(_LEAST_CELLS, min(_MOST_CELLS, room - cell_len(name)))
        levels = LEVELS_ERROR if scale.layer is MapLayer.ERROR else LEVELS_LAID
        return [self.text_strip(width, (name, self.rich_style), (low, muted),
                                *ramp_of(self, scale, cells, levels, LAID_SHARE), (high, muted))]


def label_of(scale: LayerScale | None, harvest: str) -> str:
    """What is shown of the file: a rate and the like, or its harvest."""
    return harvest if harvest or scale is None else _(LABELS[scale.layer])
