"""Shows the large map: dragging moves it, the wheel zooms at the pointer, and the position under
the pointer is reported.
"""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from textual.message import Message
from topdress.console.app.map_layers import LAYER_LABELS, MapLayer
from topdress.console.app.pages.map.place_reading import PlaceReading
from topdress.console.app.widgets.base_panel import (
    Panel,
    TextPart,
    find_at_cell,
    make_line,
    place_in_row,
    spread_parts,
)
from topdress.console.app.widgets.field_map import FieldMap
from topdress.console.locale import _


# The row above the large map lists the layers (a click chooses one) and shows whether the map
# follows the machine.
class MapBarView(NamedTuple):
    """Holds layer and states."""

    layer: MapLayer
    states: tuple[str, ...]


def place_layers() -> tuple[tuple[MapLayer, str, int], ...]:
    """Return the layers with their texts and first cells."""
    return place_in_row((layer, f"  {_(LAYER_LABELS[layer])}  ") for layer in MapLayer)


class MapBar(Panel[MapBarView]):
    """Shows the layers."""

    class Chosen(Message):
        """Reports the chosen layer."""

        def __init__(self, layer: MapLayer) -> None:
            super().__init__()
            self.layer = layer

    def draw_rows(self, view: MapBarView, width: int, height: int) -> list[Content]:
        left: list[TextPart] = [
            (text, "bold reverse" if layer is view.layer else "bold $primary")
            for layer, text, _start in place_layers()
        ]
        return [spread_parts(left, [(f" {'   '.join(view.states)} ", "$muted")], width)]

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        return tuple((start, 0) for _layer, _text, start in place_layers())

    def on_click(self, event: events.Click) -> None:
        """Choose the clicked layer."""
        event.stop()
        layer = find_at_cell(place_layers(), event.x)
        if layer is not None:
            self.post_message(self.Chosen(layer))


class ReadingLine(Panel[PlaceReading]):
    """Shows the reading at a position."""

    def draw_rows(self, view: PlaceReading, width: int, height: int) -> list[Content]:
        where = f" {view.where}"
        parts: list[TextPart] = [(where, "bold")]
        used = cell_len(where)
        for part in view.parts:
            label, text = f"   {part.label} ", part.text
            used += cell_len(label) + cell_len(text)
            # Whole parts only: a truncated number would be read as another number.
            if used > width:
                break
            parts += [(label, "$muted"), (text, "bold")]
        return [make_line(*parts)]


Place = tuple[float, float]


class MapPane(FieldMap):
    """Shows a map that can be dragged."""

    class Pointed(Message):
        """Reports the position under the pointer; None after the pointer has left the map."""

        def __init__(self, place: Place | None) -> None:
            super().__init__()
            self.place = place

    class Dragged(Message):
        """Reports that the map was dragged by pixels, to the right and down."""

        def __init__(self, columns: int, rows: int) -> None:
            super().__init__()
            self.columns, self.rows = columns, rows

    class Wheeled(Message):
        """Reports a turn of the wheel; positive steps magnify at a position that stays in place."""

        def __init__(self, steps: int, place: Place) -> None:
            super().__init__()
            self.steps, self.place = steps, place

    _held: tuple[int, int] | None = None

    def _find_place(self, event: events.MouseEvent) -> Place:
        """Return the position under the pointer."""
        return self.make_grid().find_middle(event.x, 2 * event.y + 0.5)

    def on_mouse_down(self, event: events.MouseDown) -> None:
        """Begin to drag."""
        self._held = (event.screen_x, event.screen_y)
        # With the capture, a drag continues outside the widget.
        self.capture_mouse()

    def on_mouse_up(self, event: events.MouseUp) -> None:
        """End the drag."""
        self._held = None
        self.release_mouse()

    def on_mouse_move(self, event: events.MouseMove) -> None:
        """Drag the map, or report the position under the pointer."""
        if self._held is not None:
            columns, rows = event.screen_x - self._held[0], event.screen_y - self._held[1]
            self._held = (event.screen_x, event.screen_y)
            if columns or rows:
                # A cell has two pixels, one above the other.
                self.post_message(self.Dragged(columns, 2 * rows))
            return
        self.post_message(self.Pointed(self._find_place(event)))

    def on_leave(self, event: events.Leave) -> None:
        """Report that the pointer has left the map."""
        self.post_message(self.Pointed(None))

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Zoom in at the pointer."""
        event.stop()
        self.post_message(self.Wheeled(1, self._find_place(event)))

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Zoom out at the pointer."""
        event.stop()
        self.post_message(self.Wheeled(-1, self._find_place(event)))
