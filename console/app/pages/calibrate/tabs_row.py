"""A row of choices, one of them open; a click or the arrows take another."""
from __future__ import annotations

from typing import NamedTuple

from textual import events
from textual.content import Content

from console.app.widgets.panel import Panel, Part, Picked, at_cell, in_row, line


class TabsView(NamedTuple):
    names: tuple[str, ...]
    at: int
    hint: str = ""


class TabsRow(Panel[TabsView]):
    """Posts Picked."""

    def _row(self) -> tuple[tuple[int, str, int], ...]:
        texts = (f"[{name}]" if index == self.view.at else f" {name} " for index, name in enumerate(self.view.names))
        return tuple((index, text, start + index) for index, text, start in in_row(enumerate(texts), 1))    # gaps

    def lines(self, view: TabsView, width: int, height: int) -> list[Content]:
        parts: list[Part] = [" "]
        for index, text, _start in self._row():
            parts += [(text, "bold reverse" if index == view.at else ""), " "]
        return [line(*parts, (view.hint, "$muted"))]

    def places(self) -> tuple[tuple[int, int], ...]:
        return tuple((start, 0) for _index, _text, start in self._row())

    def on_click(self, event: events.Click) -> None:
        event.stop()
        index = at_cell(self._row(), event.x)
        if index is not None:
            self.post_message(Picked(index))
