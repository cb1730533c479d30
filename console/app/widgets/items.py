"""Labels and values: one column where there is room, else two to a row."""
from __future__ import annotations

from rich.cells import cell_len
from textual.content import Content

from console.app.view import Item
from console.app.widgets.panel import Panel, Part, fit, line


class Items(Panel[tuple[Item, ...]]):
    def lines(self, view: tuple[Item, ...], width: int, height: int) -> list[Content]:
        columns = 1 if len(view) <= height else 2
        each = width // columns
        label_width = max((cell_len(item.label) for item in view), default=0) + 2
        count = -(-len(view) // columns)
        rows = []
        for row in range(count):
            parts: list[Part] = []
            for item in view[row::count]:
                style = "$stale" if item.value.stale else "bold"
                parts += [(fit(f" {item.label}", label_width), "$muted"),
                          (fit(f" {item.value.text}", each - label_width), style)]
            rows.append(line(*parts))
        return rows
