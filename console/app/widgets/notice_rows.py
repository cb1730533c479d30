"""Over the last rows of a page, above the keys: what was refused or done, where the row next to them is too short."""
from __future__ import annotations

from rich.cells import cell_len
from textual.content import Content

from console.app.widgets.panel import Panel, fit, line
from console.app.widgets.wrap import wrapped


class NoticeRows(Panel[str]):
    def lines(self, view: str, width: int, height: int) -> list[Content]:
        return [line((fit(f" {row}", width), "bold reverse")) for row in wrapped(view, width - 2)]

    def say(self, text: str, room: int, width: int) -> None:
        """room: cells of the row next to hold and STOP, which is enough for most."""
        long = text if cell_len(text) + 1 > room else ""
        self.display = bool(long)
        if long:
            self.styles.height = len(wrapped(long, width - 2))
        self.show(long)
