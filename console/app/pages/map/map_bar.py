"""The row above the large map: its layers, a click chooses one; and whether it follows the machine."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from textual.message import Message

from console.app.layers import LABELS, MapLayer
from console.app.pages.map.reading import PlaceReading
from console.app.widgets.panel import Panel, Part, at_cell, in_row, line, spread
from console.locale import _


class MapBarView(NamedTuple):
    layer: MapLayer
    states: tuple[str, ...]


def laid_out() -> tuple[tuple[MapLayer, str, int], ...]:
    """Layers with their texts and first cells."""
    return in_row((layer, f"  {_(LABELS[layer])}  ") for layer in MapLayer)


class MapBar(Panel[MapBarView]):
    class Chosen(Message):
        def __init__(self, layer: MapLayer) -> None:
            super().__init__()
            self.layer = layer

    def lines(self, view: MapBarView, width: int, height: int) -> list[Content]:
        left: list[Part] = [(text, "bold reverse" if layer is view.layer else "bold $primary")
                            for layer, text, _start in laid_out()]
        return [spread(left, [(f" {'   '.join(view.states)} ", "$muted")], width)]

    def places(self) -> tuple[tuple[int, int], ...]:
        return tuple((start, 0) for _layer, _text, start in laid_out())

    def on_click(self, event: events.Click) -> None:
        event.stop()
        layer = at_cell(laid_out(), event.x)
        if layer is not None:
            self.post_message(self.Chosen(layer))


class ReadingLine(Panel[PlaceReading]):
    def lines(self, view: PlaceReading, width: int, height: int) -> list[Content]:
        where = f" {view.where}"
        parts: list[Part] = [(where, "bold")]
        used = cell_len(where)
        for part in view.parts:
            label, text = f"   {part.label} ", part.text
            used += cell_len(label) + cell_len(text)
            if used > width:
                break
            parts += [(label, "$muted"), (text, "bold")]
        return [line(*parts)]
