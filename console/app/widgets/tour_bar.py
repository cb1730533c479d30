"""Rows under the alarms: what the guided tour asks for, and how to skip or end it. The last row is clickable."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content

from console.app.widgets.panel import Panel, fit, line, wrapped
from console.locale import _


class TourView(NamedTuple):
    number: int
    of: int
    text: str
    language: str


def ends(width: int) -> tuple[tuple[str, str, int], ...]:
    """What can be clicked: action id, text, first cell."""
    skip, end = f" ^N {_('next')} ", f" ^E {_('end the tour')} "
    start = width - cell_len(skip) - cell_len(end)
    return ("tour_next", skip, start), ("tour_end", end, start + cell_len(skip))


def rows_of(text: str, width: int) -> int:
    """Rows that the bar needs."""
    return max(1, len(wrapped(text, width - 2))) + 1


class TourBar(Panel[TourView | None]):
    def lines(self, view: TourView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        (_skip_id, skip, start), (_end_id, end, _start) = ends(width)
        style = "$background on $primary"
        lead = fit(f" {_('guided tour')} {view.number}/{view.of}", start)
        return [*(line((fit(f" {row}", width), f"bold {style}")) for row in wrapped(view.text, width - 2)),
                line((lead, style), (skip, "bold reverse"), (end, "bold reverse"))]

    def places(self) -> tuple[tuple[int, int], ...]:
        last = self.content_size.height - 1
        return tuple((start, last) for _action, _text, start in ends(self.content_size.width)) if self.view else ()

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        if event.y != self.content_size.height - 1:
            return
        for action, text, start in ends(self.content_size.width):
            if start <= event.x < start + cell_len(text):
                await self.run_action(f"app.do('{action}')")
