"""The bottom row: keys and what they do, clickable; for some seconds, what was just refused or done."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content

from console.app.action import Action
from console.app.widgets.panel import Panel, Part, fit, line
from console.locale import _


class KeysView(NamedTuple):
    actions: tuple[Action, ...]
    locked: bool
    notice: str
    language: str


ALWAYS = ("hold", "stop", "palette")       # with the last one everything else can be reached by mouse at any width


def laid_out(actions: tuple[Action, ...], width: int) -> tuple[tuple[Action, int, int], ...]:
    """Actions that fit, the important ones first, each with its first cell and its width."""
    ordered = sorted((a for a in actions if a.bar), key=lambda a: a.bar)
    cells = {action.id: cell_len(f" {action.shown} {_(action.label)} ") for action in ordered}
    room = width - sum(cells[name] for name in ALWAYS if name in cells)
    placed, start = [], 0
    for action in ordered:
        if action.id not in ALWAYS:
            if cells[action.id] > room:
                continue
            room -= cells[action.id]
        if start + cells[action.id] <= width:
            placed.append((action, start, cells[action.id]))
            start += cells[action.id]
    return tuple(placed)


class KeyBar(Panel[KeysView]):
    def lines(self, view: KeysView, width: int, height: int) -> list[Content]:
        if view.notice:
            return [line((fit(f" {view.notice}", width), "bold reverse"))]
        parts: list[Part] = []
        for action, _start, _cells in laid_out(view.actions, width):
            off = view.locked and not action.locked
            key = "$stale on $keybar" if off else "bold $keybar-key on $keybar"
            word = "$stale on $keybar" if off else "$on-keybar on $keybar"
            if action.id == "stop":
                key = word = "bold $on-alarm-red on $alarm-red"
            parts += [(f" {action.shown} ", key), (f"{_(action.label)} ", word)]
        used = sum(cells for _a, _s, cells in laid_out(view.actions, width))
        return [line(*parts, (" " * max(0, width - used), "on $keybar"))]

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        for action, start, cells in laid_out(self.view.actions, self.content_size.width):
            if start <= event.x < start + cells and not self.view.notice:
                await self.run_action(f"app.do('{action.id}')")
