"""The row above the small map; a click opens the Map page."""
from __future__ import annotations

from textual import events
from textual.content import Content

from console.app.widgets.panel import Panel, line
from console.locale import _


class MapTitle(Panel[tuple[str, str]]):
    """Shows (name of the rate's unit, language in use)."""

    def lines(self, view: tuple[str, str], width: int, height: int) -> list[Content]:
        return [line((f" {_('map')} ", "bold"), (f"{_('applied')} {view[0]}", "$muted"))]

    async def on_click(self, event: events.Click) -> None:
        event.stop()
        await self.run_action("app.do('map_screen')")
