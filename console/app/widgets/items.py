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
        count = -(-len(view) // columns)
        label_widths = [max((cell_len(item.label) for item in view[first:first + count]), default=0) + 2
                        for first in range(0, len(view), max(1, count))]
        rows = []
        for row in range(count):
            parts: list[Part] = []
            for item, label_width in zip(view[row::count], label_widths, strict=False):
                style = "$stale" if item.value.stale else "bold"
                parts += [(fit(f" {item.label}", label_width), "$muted"),
                          (fit(f" {item.value.text}", each - label_width), style)]
            rows.append(line(*parts))
        return rows
