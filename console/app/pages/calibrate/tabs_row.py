"""A row of choices, one of them open; a click or the arrows take another."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content
from textual.message import Message

from console.app.widgets.panel import Panel, Part, line


class TabsView(NamedTuple):
    names: tuple[str, ...]
    at: int
    hint: str = ""


class TabsRow(Panel[TabsView]):
    class Picked(Message):
        def __init__(self, index: int) -> None:
            super().__init__()
            self.index = index

    @staticmethod
    def _text(view: TabsView, index: int) -> str:
        return f"[{view.names[index]}]" if index == view.at else f" {view.names[index]} "

    def lines(self, view: TabsView, width: int, height: int) -> list[Content]:
        parts: list[Part] = [" "]
        for index in range(len(view.names)):
            parts += [(self._text(view, index), "bold reverse" if index == view.at else ""), " "]
        return [line(*parts, (view.hint, "$muted"))]

    def places(self) -> tuple[tuple[int, int], ...]:
        found, start = [], 1
        for index in range(len(self.view.names)):
            found.append((start, 0))
            start += cell_len(self._text(self.view, index)) + 1
        return tuple(found)

    def on_click(self, event: events.Click) -> None:
        event.stop()
        start = 1
        for index in range(len(self.view.names)):
            cells = cell_len(self._text(self.view, index))
            if start <= event.x < start + cells:
                self.post_message(self.Picked(index))
            start += cells + 1
