"""Shows labels and values: in one column where there is room, else two per row."""

from __future__ import annotations

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.panel_views import ItemView
from topdress.console.app.widgets.base_panel import (
    Panel,
    TextPart,
    choose_longest_fit,
    fit_text_width,
    make_line,
)

# Blanks between the parts of a value.
VALUE_PART_GAP = "  "


class Items(Panel[tuple[ItemView, ...]]):
    """Shows labels and values."""

    def draw_rows(self, view: tuple[ItemView, ...], width: int, height: int) -> list[Content]:
        columns = 1 if len(view) <= height else 2
        each = width // columns
        # The negated floor division rounds up.
        count = -(-len(view) // columns)
        label_widths = [
            max((cell_len(item.label) for item in view[first : first + count]), default=0) + 2
            for first in range(0, len(view), max(1, count))
        ]
        rows, left = [], height - count
        for row in range(count):
            cells = [
                _draw_item(item, each, label_width, left)
                for item, label_width in zip(view[row::count], label_widths, strict=False)
            ]
            high = max(len(cell) for cell in cells)
            left -= high - 1
            rows += [
                make_line(
                    *(
                        part
                        for cell in cells
                        for part in (cell[number] if number < len(cell) else [(" " * each, "")])
                    )
                )
                for number in range(high)
            ]
        return rows


def _draw_item(item: ItemView, width: int, label_width: int, more: int) -> list[list[TextPart]]:
    """Return the rows of label and value. A long value first loses the wide gaps; then its parts
    take rows of their own, at most `more`."""
    style = "$stale" if item.value.stale else "bold"
    room = width - label_width - 1
    text = choose_longest_fit((item.value.text, item.value.text.replace(VALUE_PART_GAP, " ")), room)
    texts = [text]
    if cell_len(text) > room:
        parts = item.value.text.split(VALUE_PART_GAP)
        whole = len(parts) - max(0, len(parts) - 1 - more)
        texts = [*parts[: whole - 1], VALUE_PART_GAP.join(parts[whole - 1 :])]
    return [
        [
            (fit_text_width(f" {item.label if not number else ''}", label_width), "$muted"),
            (fit_text_width(f" {one}", width - label_width), style),
        ]
        for number, one in enumerate(texts)
    ]
