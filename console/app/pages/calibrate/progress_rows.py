"""Draws the rows of a measurement in progress: bars that fill, bars about a centre, a small table,
plain lines.
"""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.widgets.base_panel import (
    Panel,
    TextPart,
    align_text_right,
    fit_text_width,
    make_line,
    make_solid_parts,
    wrap_text,
)

# Emphasis of a row: "", stale, amber, red or lead.
RowLevel = str

_LEVEL_STYLES = {
    "": "bold",
    "stale": "$stale",
    "amber": "bold $on-alarm-amber on $alarm-amber",
    "red": "bold $on-alarm-red on $alarm-red",
    "lead": "bold reverse",
}


class BarRow(NamedTuple):
    """Holds a bar that is filled by a share of 0 to 1."""

    label: str
    share: float
    text: str
    level: RowLevel = ""


class MiddleRow(NamedTuple):
    """Holds a bar about a centre, with a share of -1 to 1; None means unknown."""

    label: str
    share: float | None
    text: str
    level: RowLevel = ""


class LineRow(NamedTuple):
    """Holds a line of label and text."""

    label: str
    text: str
    level: RowLevel = ""


class CellsRow(NamedTuple):
    """Holds a row of a table, with cells of equal width aligned right."""

    cells: tuple[str, ...]
    level: RowLevel = ""
    heading: bool = False


ProgressRow = BarRow | MiddleRow | LineRow | CellsRow


class ProgressRows(Panel[tuple[ProgressRow, ...]]):
    """Shows the rows."""

    def draw_rows(self, view: tuple[ProgressRow, ...], width: int, height: int) -> list[Content]:
        # Labels and texts have the width of the longest, so that the bars align.
        labels = (
            max((cell_len(row.label) for row in view if not isinstance(row, CellsRow)), default=0)
            + 2
        )
        texts = (
            max(
                (cell_len(row.text) for row in view if isinstance(row, (BarRow, MiddleRow))),
                default=0,
            )
            + 2
        )
        # Six cells are the shortest bar that shows anything.
        room = max(6, width - labels - texts - 2)
        return [
            line_
            for row in _drop_oldest_cells(view, height)
            for line_ in self._draw_wrapped(row, labels, room, width)
        ][:height]

    @classmethod
    def _draw_wrapped(cls, row: ProgressRow, labels: int, room: int, width: int) -> list[Content]:
        """Return the lines of a row; a text that is too long continues below."""
        if not isinstance(row, LineRow) or cell_len(row.text) + 1 <= width - labels:
            return [cls._draw_row(row, labels, room, width)]
        texts = wrap_text(row.text, width - labels - 1)
        return [
            cls._draw_row(LineRow("" if k else row.label, text, row.level), labels, room, width)
            # Only the first row of a wrapped text has a label.
            for k, text in enumerate(texts)
        ]

    @staticmethod
    def _draw_row(row: ProgressRow, labels: int, room: int, width: int) -> Content:
        """Return the line of a row."""
        if isinstance(row, CellsRow):
            # Cells share the width equally.
            each = max(3, (width - 1) // max(1, len(row.cells)))
            style = "$muted" if row.heading else _LEVEL_STYLES[row.level]
            return make_line(
                (
                    fit_text_width(
                        "".join(align_text_right(cell, each) for cell in row.cells), width
                    ),
                    style,
                )
            )
        label: TextPart = (fit_text_width(f" {row.label}", labels), "$muted")
        if isinstance(row, LineRow):
            return make_line(
                label, (fit_text_width(f" {row.text}", width - labels), _LEVEL_STYLES[row.level])
            )
        # Alarm colours belong to the text; the bar itself stays calm.
        colour = "$stale" if row.level == "stale" else "$target"
        if isinstance(row, BarRow):
            full = round(max(0.0, min(1.0, row.share)) * room)
            drawn = [*make_solid_parts("█" * full, colour), ("░" * (room - full), "$muted")]
        else:
            # An odd number of cells puts the mark exactly in the centre.
            arm = (room - 1) // 2
            share = max(-1.0, min(1.0, row.share or 0.0))
            filled = round(abs(share) * arm)
            left = " " * (arm - filled) + "█" * filled if share < 0 else " " * arm
            after = "█" * filled + " " * (arm - filled) if share > 0 else " " * arm
            drawn = [
                *make_solid_parts(left, colour, "$track"),
                ("┃", "bold on $track"),
                *make_solid_parts(after, colour, "$track"),
                " " * (room - 2 * arm - 1),
            ]
        return make_line(label, *drawn, " ", (f" {row.text} ", _LEVEL_STYLES[row.level]))


def _drop_oldest_cells(rows: tuple[ProgressRow, ...], height: int) -> list[ProgressRow]:
    """Return the rows that fit, without the oldest rows of the table; the table's heading and its
    newest rows remain."""
    # Rows that do not fit.
    spare = len(rows) - height
    if spare <= 0:
        return list(rows)
    table = [
        index for index, row in enumerate(rows) if isinstance(row, CellsRow) and not row.heading
    ]
    gone = set(table[:spare])
    return [row for index, row in enumerate(rows) if index not in gone]
