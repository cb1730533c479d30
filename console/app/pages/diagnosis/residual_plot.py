"""Plots measured minus predicted values over one variable, before and after the causes are in the
model, with the onset of a cause.

The parts differ in shape as well as colour: `o` and a dotted line before, `+` and a continuous line
after, `-` for zero error.
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
from topdress.console.app.widgets.base_panel import align_text_right, fit_text_width
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.locale import _

# Bits of the dots of a braille cell, by row and column.
_BRAILLE_DOT_BITS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
# Columns for the numbers of the vertical axis.
_AXIS_LABEL_CELLS = 8
# With more points only the lines are drawn, because marks would cover each other.
_MAX_MARKED_POINTS = 16

PlotPlaces = Sequence[tuple[float, float]]


class PlotView(NamedTuple):
    """Holds a curve with its words."""

    title: str
    # Label of the horizontal axis.
    label: str
    curve: ResidualCurve
    # True if no cause was named, so that "after" equals "before".
    same: bool
    language: str


def round_plot_ends(values: Sequence[float]) -> tuple[float, float]:
    """Return round ends that contain all values and zero."""
    low, high = min(0.0, *values), max(0.0, *values)
    span = high - low or 1.0
    step = 10.0 ** floor(log10(span)) / 2.0
    return floor(low / step - 0.02) * step, ceil(high / step + 0.02) * step


def rasterise_line(places: Sequence[tuple[int, int]], every: int = 1) -> set[tuple[int, int]]:
    """Return the dots on straight lines between successive positions; only every n-th dot for
    `every` = n."""
    found: list[tuple[int, int]] = list(places[:1])
    for (x0, y0), (x1, y1) in pairwise(places):
        steps = max(abs(x1 - x0), abs(y1 - y0), 1)
        found += [
            (round(x0 + (x1 - x0) * k / steps), round(y0 + (y1 - y0) * k / steps))
            for k in range(1, steps + 1)
        ]
    return set(found[::every])


class ResidualPlot(Canvas[PlotView | None]):
    """Plots the residual."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "plot--before",
        "plot--after",
        "plot--muted",
        "plot--title",
        "plot--onset",
    }

    def draw_rows(self, view: PlotView | None, width: int, height: int) -> list[Strip]:
        rows, columns = height - 3, width - _AXIS_LABEL_CELLS - 1
        if rows < 2 or columns < 10:
            return []
        muted, title = self.find_style("plot--muted"), self.find_style("plot--title")
        if view is None or len(view.curve.at) < 2:
            return [self.make_text_strip(width, (f" {_('nothing to draw here')}", muted))]
        curve = view.curve
        before, after, began = (
            self.find_style("plot--before"),
            self.find_style("plot--after"),
            self.find_style("plot--onset"),
        )
        legend = [(f" {view.title}   ", title), ("o ", before), (_("before") + "  ", muted)]
        if not view.same:
            legend += [("+ ", after), (_("after"), muted)]
        strips = [self.make_text_strip(width, *legend)]
        up = round_plot_ends([*curve.before, *curve.after])
        spread = (min(curve.at), max(curve.at))
        # Categories need half a unit of margin, so that the outer names have room.
        across = (spread[0] - 0.5, spread[1] + 0.5) if curve.names else spread

        def find_dot(x: float, y: float) -> tuple[int, int]:
            return (
                round((x - across[0]) / ((across[1] - across[0]) or 1.0) * (2 * columns - 1)),
                round((1.0 - (y - up[0]) / (up[1] - up[0])) * (4 * rows - 1)),
            )

        old = [find_dot(x, y) for x, y in zip(curve.at, curve.before, strict=True)]
        new = (
            []
            if view.same
            else [find_dot(x, y) for x, y in zip(curve.at, curve.after, strict=True)]
        )
        marks = dict.fromkeys(((x // 2, y // 4) for x, y in old), ("o", before))
        # Later entries win: a mark "after" covers a mark "before" in the same cell.
        marks |= dict.fromkeys(((x // 2, y // 4) for x, y in new), ("+", after))
        if len(curve.at) > _MAX_MARKED_POINTS:
            marks = {}
        # Categories have no order, so no line connects them.
        lines = (
            [] if curve.names else [(rasterise_line(new), after), (rasterise_line(old, 3), before)]
        )
        zero = find_dot(across[0], 0.0)[1] // 4
        onset = None if curve.onset is None else find_dot(curve.onset, 0.0)[0] // 2
        labels = {
            0: _format_axis_number(up[1], up),
            rows - 1: _format_axis_number(up[0], up),
            zero: "0",
        }
        for row in range(rows):
            cells = [
                Segment(align_text_right(labels.get(row, ""), _AXIS_LABEL_CELLS - 1) + " ", muted)
            ]
            for column in range(columns):
                cells.append(
                    self._draw_cell(
                        (column, row), marks, lines, row == zero, column == onset, muted, began
                    )
                )
            strips.append(Strip(cells).adjust_cell_length(width, self.rich_style))
        return [*strips, *self._draw_axis(view, width, columns, spread, onset)]

    @staticmethod
    def _draw_cell(
        place: tuple[int, int],
        marks: dict[tuple[int, int], tuple[str, Style]],
        lines: list[tuple[set[tuple[int, int]], Style]],
        zero: bool,
        onset: bool,
        muted: Style,
        began: Style,
    ) -> Segment:
        """Return the segment of a cell: mark, line, onset, zero line or blank, in this order of
        priority."""
        if place in marks:
            return Segment(*marks[place])
        column, row = place
        for dots, style in lines:
            bits = sum(
                _BRAILLE_DOT_BITS[y][x]
                for y in range(4)
                for x in range(2)
                if (2 * column + x, 4 * row + y) in dots
            )
            if bits:
                return Segment(chr(0x2800 | bits), style)
        if onset:
            return Segment(":", began)
        return Segment("-" if zero else " ", muted)

    def _draw_axis(
        self,
        view: PlotView,
        width: int,
        columns: int,
        spread: tuple[float, float],
        onset: int | None,
    ) -> list[Strip]:
        """Return the two rows below the plot: numbers or categories, and the label of the axis."""
        muted, title = self.find_style("plot--muted"), self.find_style("plot--title")
        curve = view.curve
        if curve.names:
            room = columns // max(1, len(curve.at))
            ends = " " * _AXIS_LABEL_CELLS + "".join(
                fit_text_width(f"{curve.names[round(x)]:^{max(1, room)}}", room) for x in curve.at
            )
        else:
            first, last = (
                _format_axis_number(spread[0], spread),
                _format_axis_number(spread[1], spread),
            )
            middle = ""
            if onset is not None:
                middle = " " * max(0, onset - len(first)) + _("begins here")
            ends = (
                " " * _AXIS_LABEL_CELLS
                + first
                + fit_text_width(middle, max(0, columns - len(first) - len(last)))
                + last
            )
        return [
            self.make_text_strip(width, (fit_text_width(ends, width), muted)),
            self.make_text_strip(
                width, (fit_text_width(" " * _AXIS_LABEL_CELLS + view.label, width), title)
            ),
        ]


def _format_axis_number(value: float, span: tuple[float, float]) -> str:
    """Return a number of an axis with decimals that suit the span."""
    wide = span[1] - span[0]
    decimals = max(0, min(4, 1 - floor(log10(wide)))) if wide > 0.0 else 1
    return f"{value:.{decimals}f}"
