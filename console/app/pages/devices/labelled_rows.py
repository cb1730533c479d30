"""Draws an optional heading and rows of label and text; a long text wraps while there is room."""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.widgets.base_panel import Panel, fit_text_width, make_line, wrap_text


class DeviceRow(NamedTuple):
    """Holds a label and a text; `level` is "", stale, amber or red."""

    label: str
    text: str
    level: str = ""


class RowsView(NamedTuple):
    """Holds a heading and rows."""

    title: str
    rows: tuple[DeviceRow, ...]


_LEVEL_STYLES = {
    "": "",
    "stale": "$stale",
    "amber": "bold $on-alarm-amber on $alarm-amber",
    "red": "bold $on-alarm-red on $alarm-red",
}


class LabelledRows(Panel[RowsView]):
    """Shows the rows."""

    def draw_rows(self, view: RowsView, width: int, height: int) -> list[Content]:
        labels = max((cell_len(row.label) for row in view.rows), default=0) + 3
        found = (
            [make_line((fit_text_width(f" {view.title}", width), "bold $primary"))]
            if view.title
            else []
        )
        for index, row in enumerate(view.rows):
            # Every later row keeps one line, so only the remaining room is available to a long
            # text.
            after = len(view.rows) - index - 1
            room = max(1, height - len(found) - after)
            texts = wrap_text(row.text, width - labels - 1) or [""]
            if len(texts) > room:
                texts = [
                    *texts[: room - 1],
                    fit_text_width("".join(texts[room - 1 :]), width - labels - 1),
                ]
            for number, text in enumerate(texts):
                found.append(
                    make_line(
                        (fit_text_width(f" {row.label}" if not number else "", labels), "$muted"),
                        (text, _LEVEL_STYLES[row.level]),
                    )
                )
        return found
