"""Measured less predicted along one variable: before and after the causes are in the model, and
where they began.

Told apart by shape too: `o` and a dotted line before, `+` and a whole line after, `-` the line
of no error.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, floor, log10
from typing import ClassVar, NamedTuple

from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip
from topdress.console.app.pages.diagnosis.service import ResidualCurve
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.app.widgets.panel import fit, right
from topdress.console.locale import _

# row, column of a braille cell
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
_AXIS = 8
_MOST_MARKS = 16  # with more places the lines alone are drawn

Places = Sequence[tuple[float, float]]


class PlotView(NamedTuple):
    title: str
    label: str  # of the axis
    curve: ResidualCurve
    same: bool  # nothing was named: there is no after
    language: str


def round_plot_ends(values: Sequence[float]) -> tuple[float, float]:
    """Round ends that hold all values, and zero."""
    low, high = min(0.0, *values), max(0.0, *values)
    span = high - low or 1.0
    step = 10.0 ** floor(log10(span)) / 2.0
    return floor(low / step - 0.02) * step, ceil(high / step + 0.02) * step


def rasterise_line(places: Sequence[tuple[int, int]], every: int = 1) -> set[tuple[int, int]]:
    """Dots on straight lines from place to place; `every` second, third, ... only."""
    found: list[tuple[int, int]] = list(places[:1])
    for (x0, y0), (x1, y1) in pairwise(places):
        steps = max(abs(x1 - x0), abs(y1 - y0), 1)
        found += [
            (round(x0 + (x1 - x0) * k / steps), round(y0 + (y1 - y0) * k / steps))
            for k in range(1, steps + 1)
        ]
    return set(found[::every])


class ResidualPlot(Canvas[PlotView | None]):
    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "plot--before",
        "plot--after",
        "plot--muted",
        "plot--title",
        "plot--onset",
    }

    def lines(self, view: PlotView | None, width: int, height: int) -> list[Strip]:
        rows, columns = height - 3, width - _AXIS - 1
        if rows < 2 or columns < 10:
            return []
        muted, title = self.style("plot--muted"), self.style("plot--title")
        if view is None or len(view.curve.at) < 2:
            return [self.text_strip(width, (f" {_('nothing to draw here')}", muted))]
        curve = view.curve
        before, after, began = (
            self.style("plot--before"),
            self.style("plot--after"),
            self.style("plot--onset"),
        )
        legend = [(f" {view.title}   ", title), ("o ", before), (_("before") + "  ", muted)]
        if not view.same:
            legend += [("+ ", after), (_("after"), muted)]
        strips = [self.text_strip(width, *legend)]
        up = round_plot_ends([*curve.before, *curve.after])
        spread = (min(curve.at), max(curve.at))
        across = (spread[0] - 0.5, spread[1] + 0.5) if curve.names else spread

        def dot(x: float, y: float) -> tuple[int, int]:
            return (
                round((x - across[0]) / ((across[1] - across[0]) or 1.0) * (2 * columns - 1)),
                round((1.0 - (y - up[0]) / (up[1] - up[0])) * (4 * rows - 1)),
            )

        old = [dot(x, y) for x, y in zip(curve.at, curve.before, strict=True)]
        new = [] if view.same else [dot(x, y) for x, y in zip(curve.at, curve.after, strict=True)]
        marks = dict.fromkeys(((x // 2, y // 4) for x, y in old), ("o", before))
        marks |= dict.fromkeys(((x // 2, y // 4) for x, y in new), ("+", after))
        if len(curve.at) > _MOST_MARKS:
            marks = {}
        lines = (
            [] if curve.names else [(rasterise_line(new), after), (rasterise_line(old, 3), before)]
        )
        zero = dot(across[0], 0.0)[1] // 4
        onset = None if curve.onset is None else dot(curve.onset, 0.0)[0] // 2
        labels = {0: _short(up[1], up), rows - 1: _short(up[0], up), zero: "0"}
        for row in range(rows):
            cells = [Segment(right(labels.get(row, ""), _AXIS - 1) + " ", muted)]
            for column in range(columns):
                cells.append(
                    self._cell(
                        (column, row), marks, lines, row == zero, column == onset, muted, began
                    )
                )
            strips.append(Strip(cells).adjust_cell_length(width, self.rich_style))
        return [*strips, *self._below(view, width, columns, spread, onset)]

    @staticmethod
    def _cell(
        place: tuple[int, int],
        marks: dict[tuple[int, int], tuple[str, Style]],
        lines: list[tuple[set[tuple[int, int]], Style]],
        zero: bool,
        onset: bool,
        muted: Style,
        began: Style,
    ) -> Segment:
        if place in marks:
            return Segment(*marks[place])
        column, row = place
        for dots, style in lines:
            bits = sum(
                _DOTS[y][x]
                for y in range(4)
                for x in range(2)
                if (2 * column + x, 4 * row + y) in dots
            )
            if bits:
                return Segment(chr(0x2800 | bits), style)
        if onset:
            return Segment(":", began)
        return Segment("-" if zero else " ", muted)

    def _below(
        self,
        view: PlotView,
        width: int,
        columns: int,
        spread: tuple[float, float],
        onset: int | None,
    ) -> list[Strip]:
        muted, title = self.style("plot--muted"), self.style("plot--title")
        curve = view.curve
        if curve.names:
            room = columns // max(1, len(curve.at))
            ends = " " * _AXIS + "".join(
                fit(f"{curve.names[round(x)]:^{max(1, room)}}", room) for x in curve.at
            )
        else:
            first, last = _short(spread[0], spread), _short(spread[1], spread)
            middle = ""
            if onset is not None:
                middle = " " * max(0, onset - len(first)) + _("begins here")
            ends = (
                " " * _AXIS + first + fit(middle, max(0, columns - len(first) - len(last))) + last
            )
        return [
            self.text_strip(width, (fit(ends, width), muted)),
            self.text_strip(width, (fit(" " * _AXIS + view.label, width), title)),
        ]


def _short(value: float, span: tuple[float, float]) -> str:
    wide = span[1] - span[0]
    decimals = max(0, min(4, 1 - floor(log10(wide)))) if wide > 0.0 else 1
    return f"{value:.{decimals}f}"
