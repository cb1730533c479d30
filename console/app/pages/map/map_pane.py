"""The large map: drag moves it, the wheel changes its scale at the pointer, and the place under the pointer is
reported."""
from __future__ import annotations

from textual import events
from textual.message import Message

from console.app.widgets.field_map import FieldMap

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
