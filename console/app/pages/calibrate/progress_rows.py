"""Rows of a measurement under way: bars that fill, bars about a middle, a small table, plain
lines."""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.widgets.panel import Panel, Part, fit, line, right, solid, wrapped

Level = str  # "", stale, amber, red, lead

_TEXTS = {
    "": "bold",
    "stale": "$stale",
    "amber": "bold $on-alarm-amber on $alarm-amber",
    "red": "bold $on-alarm-red on $alarm-red",
    "lead": "bold reverse",
}


class Bar(NamedTuple):
    """share: 0 to 1 of the way."""

    label: str
    share: float
    text: str
    level: Level = ""


class Middle(NamedTuple):
    """share: -1 to 1 about the middle; None: not known."""

    label: str
    share: float | None
    text: str
    level: Level = ""


class Line(NamedTuple):
    label: str
    text: str
    level: Level = ""


class Cells(NamedTuple):
    """A row of a table, each cell flush right in the same width."""

    cells: tuple[str, ...]
    level: Level = ""
    heading: bool = False


Row = Bar | Middle | Line | Cells


class Sheet(Panel[tuple[Row, ...]]):
    def lines(self, view: tuple[Row, ...], width: int, height: int) -> list[Content]:
        labels = (
            max((cell_len(row.label) for row in view if not isinstance(row, Cells)), default=0) + 2
        )
        texts = (
            max((cell_len(row.text) for row in view if isinstance(row, (Bar, Middle))), default=0)
            + 2
        )
        room = max(6, width - labels - texts - 2)
        return [
            line_ for row in _kept(view, height) for line_ in self._rows(row, labels, room, width)
        ][:height]

    @classmethod
    def _rows(cls, row: Row, labels: int, room: int, width: int) -> list[Content]:
        """A text that is too long goes on below."""
        if not isinstance(row, Line) or cell_len(row.text) + 1 <= width - labels:
            return [cls._row(row, labels, room, width)]
        texts = wrapped(row.text, width - labels - 1)
        return [
            cls._row(Line("" if k else row.label, text, row.level), labels, room, width)
            for k, text in enumerate(texts)
        ]

    @staticmethod
    def _row(row: Row, labels: int, room: int, width: int) -> Content:
        if isinstance(row, Cells):
            each = max(3, (width - 1) // max(1, len(row.cells)))
            style = "$muted" if row.heading else _TEXTS[row.level]
            return line((fit("".join(right(cell, each) for cell in row.cells), width), style))
        label: Part = (fit(f" {row.label}", labels), "$muted")
        if isinstance(row, Line):
            return line(label, (fit(f" {row.text}", width - labels), _TEXTS[row.level]))
        colour = "$stale" if row.level == "stale" else "$target"
        if isinstance(row, Bar):
            full = round(max(0.0, min(1.0, row.share)) * room)
            drawn = [*solid("█" * full, colour), ("░" * (room - full), "$muted")]
        else:
            arm = (room - 1) // 2
            share = max(-1.0, min(1.0, row.share or 0.0))
            filled = round(abs(share) * arm)
            left = " " * (arm - filled) + "█" * filled if share < 0 else " " * arm
            after = "█" * filled + " " * (arm - filled) if share > 0 else " " * arm
            drawn = [
                *solid(left, colour, "$track"),
                ("┃", "bold on $track"),
                *solid(after, colour, "$track"),
                " " * (room - 2 * arm - 1),
            ]
        return line(label, *drawn, " ", (f" {row.text} ", _TEXTS[row.level]))


def _kept(rows: tuple[Row, ...], height: int) -> list[Row]:
    """Where rows are few, the oldest of the table go: its heading and its end stay."""
    spare = len(rows) - height
    if spare <= 0:
        return list(rows)
    table = [index for index, row in enumerate(rows) if isinstance(row, Cells) and not row.heading]
    gone = set(table[:spare])
    return [row for index, row in enumerate(rows) if index not in gone]
