"""Rows under the alarms: what the guided tour asks for, and how to skip or end it. The last row is clickable."""
from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual import events
from textual.content import Content

from console.app.widgets.panel import Panel, at_cell, fit, in_row, line, wrapped
from console.locale import _


class TourView(NamedTuple):
    number: int
    of: int
    text: str


def ends(width: int) -> tuple[tuple[str, str, int], ...]:
    """What can be clicked: action id, text, first cell."""
    texts = ("tour_next", f" ^N {_('next')} "), ("tour_end", f" ^E {_('end the tour')} ")
    return in_row(texts, width - sum(cell_len(text) for _action, text in texts))


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
        action = at_cell(ends(self.content_size.width), event.x) if event.y == self.content_size.height - 1 else None
        if action is not None:
            await self.run_action(f"app.do('{action}')")
