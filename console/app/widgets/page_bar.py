"""The row of pages with their F-keys, clickable; the one that is open stands out."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content

from console.app.action import Action
from console.app.widgets.panel import Panel, Part, line
from console.locale import _


class PagesView(NamedTuple):
    """actions: those that open a page; where: the page that is open."""

    actions: tuple[Action, ...]
    where: str
    language: str


def laid_out(actions: tuple[Action, ...], width: int) -> tuple[tuple[Action, str, int], ...]:
    """Actions that fit, each with its text and its first cell."""
    placed, start = [], 0
    for action in actions:
        text = f" {action.shown} {_(action.label)} "
        if start + cell_len(text) <= width:
            placed.append((action, text, start))
            start += cell_len(text)
    return tuple(placed)


class PageBar(Panel[PagesView]):
    def lines(self, view: PagesView, width: int, height: int) -> list[Content]:
        parts: list[Part] = [(text, "bold reverse" if action.id == f"{view.where}_screen" else "$muted")
                             for action, text, _start in laid_out(view.actions, width)]
        return [line(*parts)]

    def places(self) -> tuple[tuple[int, int], ...]:
        return tuple((start, 0) for _action, _text, start in laid_out(self.view.actions, self.content_size.width))

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        for action, text, start in laid_out(self.view.actions, self.content_size.width):
            if start <= event.x < start + cell_len(text):
                await self.run_action(f"app.do('{action.id}')")
