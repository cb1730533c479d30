"""Up to three channels, one above the other, on one time axis, in braille. A click reads the
values at that time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from math import ceil, floor, isfinite, log10
from typing import ClassVar, NamedTuple

from rich.cells import cell_len
from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.message import Message
from textual.strip import Strip
from topdress.console.app.braille import BLANK, Dots, Piece, trace_cells
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.app.widgets.panel import fit, right
from topdress.console.locale import _

_AXIS = 9  # cells of the axis' numbers
LEAST_ROWS = 3  # a title and two rows of plot
LEAST_LABELLED = 5  # rows of a plot whose middle is labelled too


class Plot(NamedTuple):
    """Texts as shown. value: at the cursor, else the newest."""

    label: str
    unit: str
    value: str
    sums: str
    low: str
    middle: str
    high: str
    pieces: tuple[Piece, ...]
    fixed: bool = False


class PlotsView(NamedTuple):
    """begin, middle, end: times as shown; cursor: place in the span, 0 ... 1; now: where the
    log is played."""

    plots: tuple[Plot, ...]
    begin: str
    middle: str
    end: str
    cursor: float | None = None
    cursor_time: str = ""
    stale: bool = False


def _runs(text: str, style: Style) -> Iterator[Segment]:
    """Dots and gaps apart, so that a picture in a font of other widths keeps every run in its
    place."""
    return (Segment(run, style) for run in re.findall(" +|[^ ]+", text))


class Plots(Canvas[PlotsView]):
    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "trend--applied",
        "trend--muted",
        "trend--title",
        "trend--stale",
        "plots--cursor",
    }

    class Pointed(Message):
        """The plot was clicked or dragged over at this share of the span."""

        def __init__(self, share: float) -> None:
            super().__init__()
            self.share = share

    class Named(Message):
        """A plot's title was clicked."""

    class Wheeled(Message):
        """steps > 0: a shorter span is wanted."""

        def __init__(self, steps: int) -> None:
            super().__init__()
            self.steps = steps

    @staticmethod
    def columns(width: int) -> int:
        """Cells of the plot itself."""
        return max(1, width - _AXIS - 1)

    def rows_of(self, height: int) -> list[int]:
        """Rows of each plot, its title in, the time axis out."""
        count = max(1, len(self.view.plots))
        each, rest = divmod(max(0, height - 1), count)
        return [each + (index < rest) for index in range(len(self.view.plots))]

    def lines(self, view: PlotsView, width: int, height: int) -> list[Strip]:
        muted = self.style("trend--muted")
        if not view.plots:
            return [self.text_strip(width, (f" {_('V chooses what is plotted')}", muted))]
        if width < _AXIS + 20:
            return []
        rows: list[Strip] = []
        for plot, count in zip(view.plots, self.rows_of(height), strict=True):
            if count >= LEAST_ROWS:
                rows.append(self._title(plot, width))
                rows += self._plot(plot, width, count - 1)
            else:
                rows += [
                    self._title(plot, width),
                    *[Strip.blank(width, self.rich_style)] * (count - 1),
                ][:count]
        rows.append(self._times(view, width))
        return rows

    def _title(self, plot: Plot, width: int) -> Strip:
        muted, value = (
            self.style("trend--muted"),
            self.style("trend--stale" if self.view.stale else "trend--title"),
        )
        unit = f" {plot.unit}" if plot.unit else ""
        left = [
            (f" {plot.label}", self.style("trend--title")),
            (f"  {plot.value}", value),
            (f"{unit}   ", muted),
        ]
        fixed = f"  {_('fixed')} " if plot.fixed else ""
        room = width - sum(cell_len(text) for text, _style in left) - cell_len(fixed)
        return self.text_strip(width, *left, (fit(plot.sums, room), muted), (fixed, muted))

    def _plot(self, plot: Plot, width: int, count: int) -> Iterator[Strip]:
        muted = self.style("trend--muted")
        columns = self.columns(width)
        line = self.style("trend--stale" if self.view.stale else "trend--applied")
        cursor_style = self.style("plots--cursor")
        dots = trace_cells(plot.pieces, columns, count)
        cursor = (
            None if self.view.cursor is None else round(self.view.cursor * (2 * columns - 1)) // 2
        )
        labels = {(count - 1) // 2: plot.middle} if count >= LEAST_LABELLED else {}
        labels |= {0: plot.high, count - 1: plot.low}
        for row in range(count):
            label = labels.get(row, "")
            segments = [Segment(right(label, _AXIS - 1) + " ", muted)]
            segments += self._cells(dots, row, columns, cursor, line, cursor_style)
            yield Strip(segments).adjust_cell_length(width, self.rich_style)

    @staticmethod
    def _cells(
        dots: Dots, row: int, columns: int, cursor: int | None, line: Style, cursor_style: Style
    ) -> Iterator[Segment]:
        """Cells before the cursor, its own, and those after it."""
        row_of = [
            chr(BLANK | bits) if (bits := dots.get((column, row), 0)) else " "
            for column in range(columns)
        ]
        if cursor is None or not 0 <= cursor < columns:
            yield from _runs("".join(row_of), line)
            return
        yield from _runs("".join(row_of[:cursor]), line)
        yield Segment("│" if row_of[cursor] == " " else row_of[cursor], cursor_style)
        yield from _runs("".join(row_of[cursor + 1 :]), line)

    def _times(self, view: PlotsView, width: int) -> Strip:
        columns = self.columns(width)
        read = f" {view.cursor_time} " if view.cursor is not None else ""
        taken = max(
            0,
            min(columns - len(read), round((view.cursor or 0.0) * (columns - 1)) - len(read) // 2),
        )
        text = [" "] * columns
        for words, at in (
            (view.begin, 0),
            (view.middle, (columns - len(view.middle)) // 2),
            (view.end, columns - len(view.end)),
        ):
            if not read or at + len(words) < taken or at > taken + len(read):
                text[max(0, at) : max(0, at) + len(words)] = words
        line = "".join(text)[:columns]
        muted = self.style("trend--muted")
        return self.text_strip(
            width,
            (" " * _AXIS + line[:taken], muted),
            (read, self.style("plots--cursor")),
            (line[taken + len(read) :], muted),
        )

    # --- mouse
    # ----------------------------------------------------------------------------------------------

    def _titles(self) -> set[int]:
        found, row = set(), 0
        for count in self.rows_of(self.content_size.height):
            found.add(row)
            row += count
        return found

    def places(self) -> tuple[tuple[int, int], ...]:
        return tuple((0, row) for row in sorted(self._titles())) if self.view.plots else ((0, 0),)

    def on_click(self, event: events.Click) -> None:
        event.stop()
        if event.y in self._titles() or not self.view.plots:
            self.post_message(self.Named())
            return
        columns = self.columns(self.content_size.width)
        if _AXIS <= event.x < _AXIS + columns:
            self.post_message(self.Pointed((2 * (event.x - _AXIS) + 0.5) / (2 * columns - 1)))

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        event.stop()
        self.post_message(self.Wheeled(1))

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        event.stop()
        self.post_message(self.Wheeled(-1))


_PIECES = 4


def round_axis_ends(low: float, high: float, decimals: int) -> tuple[float, float]:
    """Round numbers that hold low ... high, wide enough that their last shown decimal differs.
    NaN: 0 ... 1."""
    if not (isfinite(low) and isfinite(high)):
        return 0.0, 1.0
    least = _PIECES * 10.0**-decimals
    if high - low < least:
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * least, middle + 0.5 * least
    step = _round_step((high - low) / _PIECES)
    return floor(low / step + 1e-9) * step, ceil(high / step - 1e-9) * step


def _round_step(about: float) -> float:
    """1, 2 or 5 times a power of ten, not below `about`."""
    power = 10.0 ** floor(log10(about))
    return next(
        factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= about * (1.0 - 1e-9)
    )
