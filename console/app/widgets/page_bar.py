"""The row of pages with their F-keys, clickable; the one that is open stands out."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content

from console.app.action import Action
from console.app.widgets.panel import Panel, Part, at_cell, in_row, line
from console.locale import _


class PagesView(NamedTuple):
    """actions: those that open a page; where: the page that is open."""

    actions: tuple[Action, ...]
    where: str


class PageBar(Panel[PagesView]):
    def lines(self, view: PagesView, width: int, height: int) -> list[Content]:
        parts: list[Part] = [(text, "bold reverse" if name == f"{view.where}_screen" else "$muted")
                             for name, text, _start in self._row(width)]
        return [line(*parts)]

    def _row(self, width: int) -> tuple[tuple[str, str, int], ...]:
        """Ids of the actions that fit."""
        row = in_row((action.id, f" {action.shown} {_(action.label)} ") for action in self.view.actions)
        return tuple(one for one in row if one[2] + cell_len(one[1]) <= width)

    def places(self) -> tuple[tuple[int, int], ...]:
        return tuple((start, 0) for _name, _text, start in self._row(self.content_size.width))

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        name = at_cell(self._row(self.content_size.width), event.x)
        if name is not None:
            await self.run_action(f"app.do('{name}')")
