"""The large map: drag moves it, the wheel changes its scale at the pointer, and the place under
the pointer is reported."""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from textual.message import Message
from topdress.console.app.layers import LABELS, MapLayer
from topdress.console.app.pages.map.reading import PlaceReading
from topdress.console.app.widgets.field_map import FieldMap
from topdress.console.app.widgets.panel import Panel, Part, at_cell, in_row, line, spread
from topdress.console.locale import _


# The row above the large map: its layers, a click chooses one; and whether it follows the machine.
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
        left: list[Part] = [
            (text, "bold reverse" if layer is view.layer else "bold $primary")
            for layer, text, _start in laid_out()
        ]
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


Place = tuple[float, float]


class MapPane(FieldMap):
    class Pointed(Message):
        """The pointer stands over a place; None: it left the map."""

        def __init__(self, place: Place | None) -> None:
            super().__init__()
            self.place = place

    class Dragged(Message):
        """The map was pulled by so many pixels, to the right and down."""

        def __init__(self, columns: int, rows: int) -> None:
            super().__init__()
            self.columns, self.rows = columns, rows

    class Wheeled(Message):
        """steps > 0: nearer, at a place that is to stay where it is."""

        def __init__(self, steps: int, place: Place) -> None:
            super().__init__()
            self.steps, self.place = steps, place

    _held: tuple[int, int] | None = None

    def _place(self, event: events.MouseEvent) -> Place:
        return self.pixels().place(event.x, 2 * event.y + 0.5)

    def on_mouse_down(self, event: events.MouseDown) -> None:
        self._held = (event.screen_x, event.screen_y)
        self.capture_mouse()

    def on_mouse_up(self, event: events.MouseUp) -> None:
        self._held = None
        self.release_mouse()

    def on_mouse_move(self, event: events.MouseMove) -> None:
        if self._held is not None:
            columns, rows = event.screen_x - self._held[0], event.screen_y - self._held[1]
            self._held = (event.screen_x, event.screen_y)
            if columns or rows:
                self.post_message(self.Dragged(columns, 2 * rows))
            return
        self.post_message(self.Pointed(self._place(event)))

    def on_leave(self, event: events.Leave) -> None:
        self.post_message(self.Pointed(None))

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        event.stop()
        self.post_message(self.Wheeled(1, self._place(event)))

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        event.stop()
        self.post_message(self.Wheeled(-1, self._place(event)))
