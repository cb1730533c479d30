"""Plots measured points, the fitted line, and the band that contains 90 % of single measurements.

The parts differ in shape as well as colour: points are the letter o, the line is continuous
braille, the edges of the band are dotted braille.
"""

from __future__ import annotations

from itertools import pairwise
from math import ceil, floor, log10
from typing import ClassVar, NamedTuple

from rich.cells import cell_len
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip
from topdress.console.app.braille import BLANK_BRAILLE_CODE, CELL_DOT_BITS
from topdress.console.app.widgets.base_panel import align_text_right, fit_text_width
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.locale import _

# Columns for the numbers of the vertical axis.
_AXIS_LABEL_CELLS = 8


class CurveView(NamedTuple):
    """Holds a curve.

    Attributes
    ----------
    x_name, y_name
        Quantity and unit, in the language in use.
    points
        Measured (x, y).
    line
        Fitted (x, y, low, high), in the order of x.
    """

    x_name: str
    y_name: str
    points: tuple[tuple[float, float], ...] = ()
    line: tuple[tuple[float, float, float, float], ...] = ()


def round_axis_ends(values: list[float], least: float) -> tuple[float, float]:
    """Return round ends that contain all values with a margin and differ by at least `least`."""
    # Both ends are rounded outwards with a margin, so that no point touches the frame.
    low, high = min(values), max(values)
    if high - low < least:
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * least, middle + 0.5 * least
    step = 10.0 ** floor(log10(high - low)) / 2.0
    return floor(low / step - 0.05) * step, ceil(high / step + 0.05) * step


class CurvePlot(Canvas[CurveView]):
    """Plots points and line."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "curve--point",
        "curve--line",
        "curve--band",
        "curve--muted",
        "curve--title",
    }

    def draw_rows(self, view: CurveView, width: int, height: int) -> list[Strip]:
        rows, columns = height - 2, width - _AXIS_LABEL_CELLS - 1
        # A plot of fewer cells shows nothing readable.
        if rows < 2 or columns < 10:
            return []
        muted, title = self.find_style("curve--muted"), self.find_style("curve--title")
        point, drawn, band = (
            self.find_style("curve--point"),
            self.find_style("curve--line"),
            self.find_style("curve--band"),
        )
        head = [(f" {view.y_name}  ", title), ("o ", point), (_("measured"), muted)]
        if view.line:
            head += [
                ("  ⣀⣀ ", drawn),
                (_("fitted"), muted),
                ("  ⢀⢀ ", band),
                (_("90 % lie between"), muted),
            ]
        # The head must fit: the entry that matters least, the band, is dropped first.
        while sum(cell_len(text) for text, _style in head) > width and len(head) > 3:
            # An entry is dropped with its sign, so that no sign stays unexplained.
            head = head[:-2]
        strips = [self.make_text_strip(width, *head)]
        ys = [y for _x, y in view.points] + [value for one in view.line for value in one[1:]]
        # Without points the axes have no scale.
        if not ys:
            blank = self.make_text_strip(
                width,
                (align_text_right(_("no points yet"), _AXIS_LABEL_CELLS + columns // 2 + 6), muted),
            )
            return [*strips, *([Strip.blank(width, self.rich_style)] * (rows // 2)), blank]
        xs = [x for x, _y in view.points] + [one[0] for one in view.line]
        across, up = (
            round_axis_ends(xs, max(1.0, 0.1 * abs(max(xs)))),
            round_axis_ends(ys, max(0.001, 0.02 * abs(max(ys)))),
        )

        def find_dot(x: float, y: float) -> tuple[int, int]:
            return (
                round((x - across[0]) / (across[1] - across[0]) * (2 * columns - 1)),
                round((1.0 - (y - up[0]) / (up[1] - up[0])) * (4 * rows - 1)),
            )

        line = _connect_dots([find_dot(x, y) for x, y, _low, _high in view.line])
        edges = {
            place
            for edge in (2, 3)
            for place in _connect_dots([find_dot(one[0], one[edge]) for one in view.line])
            # Every second cell only, so that the edges of the band look dotted.
            if place[0] % 4 == 0
        }
        marks = {(x // 2, y // 4) for x, y in (find_dot(*one) for one in view.points)}
        labels = {0: _format_axis_number(up[1], up), rows - 1: _format_axis_number(up[0], up)}
        # The middle label needs a row of distance to the others.
        if rows >= 5:
            labels[rows // 2] = _format_axis_number(
                up[1] + (up[0] - up[1]) * (rows // 2 + 0.5) / rows, up
            )
        for row in range(rows):
            cells = [
                Segment(align_text_right(labels.get(row, ""), _AXIS_LABEL_CELLS - 1) + " ", muted)
            ]
            cells += [
                _draw_cell(
                    column,
                    row,
                    marks=marks,
                    line=line,
                    edges=edges,
                    point=point,
                    drawn=drawn,
                    band=band,
                )
                or Segment(" ", self.rich_style)
                for column in range(columns)
            ]
            strips.append(Strip(cells).adjust_cell_length(width, self.rich_style))
        # The axis has numbers at its ends only.
        first, last = _format_axis_number(across[0], across), _format_axis_number(across[1], across)
        middle = fit_text_width(f" {view.x_name}", max(0, columns - len(first) - len(last)))
        strips.append(
            self.make_text_strip(
                width, (" " * _AXIS_LABEL_CELLS + first, muted), (middle, title), (last, muted)
            )
        )
        return strips


def _connect_dots(places: list[tuple[int, int]]) -> set[tuple[int, int]]:
    """Return every dot on the straight lines between successive positions."""
    found = set(places)
    for (x0, y0), (x1, y1) in pairwise(places):
        # The longer direction determines the number of dots, so that the line has no gap.
        steps = max(abs(x1 - x0), abs(y1 - y0), 1)
        found |= {
            (round(x0 + (x1 - x0) * k / steps), round(y0 + (y1 - y0) * k / steps))
            for k in range(steps + 1)
        }
    return found


def _draw_cell(
    column: int,
    row: int,
    *,
    marks: set[tuple[int, int]],
    line: set[tuple[int, int]],
    edges: set[tuple[int, int]],
    point: Style,
    drawn: Style,
    band: Style,
) -> Segment | None:
    """Return the segment of a cell, or None for an empty cell. A point covers the line, the line
    covers the band."""
    if (column, row) in marks:
        return Segment("o", point)
    for places, style in ((line, drawn), (edges, band)):
        bits = sum(
            CELL_DOT_BITS[y][x]
            for y in range(4)
            for x in range(2)
            if (2 * column + x, 4 * row + y) in places
        )
        if bits:
            return Segment(chr(BLANK_BRAILLE_CODE | bits), style)
    return None


def _format_axis_number(value: float, span: tuple[float, float]) -> str:
    """Return a number of an axis with decimals that suit the span."""
    decimals = max(0, min(4, 1 - floor(log10(span[1] - span[0]))))
    return f"{value:.{decimals}f}"
