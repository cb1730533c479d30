"""A row under the alarms while somebody else is at the machine too: the latest order and whose it is, then who is
there. A click lists everybody."""
from __future__ import annotations

from rich.cells import cell_len
from textual import events
from textual.content import Content

from console.app.company import CompanyView
from console.app.widgets.panel import Panel, fit, line


class CompanyBar(Panel[CompanyView | None]):
    def lines(self, view: CompanyView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        order = f" {view.order}  " if view.order else ""
        return [line((order, "bold"), (fit(f" {view.others}", width - cell_len(order)), "$muted"))]

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        await self.run_action("app.company")
