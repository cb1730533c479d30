"""A heading, where it has one, and rows of label and text; a long text is broken, not cut,
while there is room."""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.widgets.panel import Panel, fit, line, wrapped


class DeviceRow(NamedTuple):
    """level: "", stale, amber, red."""

    label: str
    text: str
    level: str = ""


class RowsView(NamedTuple):
    title: str
    rows: tuple[DeviceRow, ...]


_STYLES = {
    "": "",
    "stale": "$stale",
    "amber": "bold $on-alarm-amber on $alarm-amber",
    "red": "bold $on-alarm-red on $alarm-red",
}


class Rows(Panel[RowsView]):
    def lines(self, view: RowsView, width: int, height: int) -> list[Content]:
        labels = max((cell_len(row.label) for row in view.rows), default=0) + 3
        found = [line((fit(f" {view.title}", width), "bold $primary"))] if view.title else []
        for index, row in enumerate(view.rows):
            after = len(view.rows) - index - 1
            room = max(1, height - len(found) - after)
            texts = wrapped(row.text, width - labels - 1) or [""]
            if len(texts) > room:
                texts = [*texts[: room - 1], fit("".join(texts[room - 1 :]), width - labels - 1)]
            for number, text in enumerate(texts):
                found.append(
                    line(
                        (fit(f" {row.label}" if not number else "", labels), "$muted"),
                        (text, _STYLES[row.level]),
                    )
                )
        return found
