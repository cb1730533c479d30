"""Plots up to three channels in braille, stacked on one time axis. A click reads the values at that
time.
"""

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
from topdress.console.app.braille import BLANK_BRAILLE_CODE, CellDots, PlotPiece, trace_cells
from topdress.console.app.widgets.base_panel import align_text_right, fit_text_width
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.locale import _

# Columns for the numbers of the vertical axis.
_AXIS_LABEL_CELLS = 9
# A plot needs a title and two rows.
MIN_PLOT_ROWS = 3
# From this number of rows the middle of the axis has a label too.
MIN_LABELLED_ROWS = 5


class ChannelPlot(NamedTuple):
    """Holds one plot in words; `value` is that at the cursor, else the newest."""

    label: str
    unit: str
    value: str
    sums: str
    low: str
    middle: str
    high: str
    pieces: tuple[PlotPiece, ...]
    fixed: bool = False


class PlotsView(NamedTuple):
    """Holds the plots. `begin`, `middle` and `end` are displayed times; `cursor` is a share of the
    span, 0 to 1."""

    plots: tuple[ChannelPlot, ...]
    begin: str
    middle: str
    end: str
    cursor: float | None = None
    cursor_time: str = ""
    stale: bool = False


def _split_runs(text: str, style: Style) -> Iterator[Segment]:
    """Yield dots and gaps as separate segments, so that a picture in a font of other widths keeps
    every run in place."""
    return (Segment(run, style) for run in re.findall(" +|[^ ]+", text))


class Plots(Canvas[PlotsView]):
    """Plots the channels."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "trend--applied",
        "trend--muted",
        "trend--title",
        "trend--stale",
        "plots--cursor",
    }

    class Pointed(Message):
        """Reports a click or drag on the plot, at a share of the span."""

        def __init__(self, share: float) -> None:
            super().__init__()
            self.share = share

    class Named(Message):
        """Reports a click on a plot's title."""

    class Wheeled(Message):
        """Reports a turn of the wheel; positive steps shorten the span."""

        def __init__(self, steps: int) -> None:
            super().__init__()
            self.steps = steps

    @staticmethod
    def count_columns(width: int) -> int:
        """Return the number of cells of the plot itself."""
        return max(1, width - _AXIS_LABEL_CELLS - 1)

    def count_plot_rows(self, height: int) -> list[int]:
        """Return the rows of each plot, including its title, without the time axis."""
        count = max(1, len(self.view.plots))
        # The first plots take the remaining rows.
        each, rest = divmod(max(0, height - 1), count)
        return [each + (index < rest) for index in range(len(self.view.plots))]

    def draw_rows(self, view: PlotsView, width: int, height: int) -> list[Strip]:
        muted = self.find_style("trend--muted")
        if not view.plots:
            return [self.make_text_strip(width, (f" {_('V chooses what is plotted')}", muted))]
        if width < _AXIS_LABEL_CELLS + 20:
            return []
        rows: list[Strip] = []
        for plot, count in zip(view.plots, self.count_plot_rows(height), strict=True):
            if count >= MIN_PLOT_ROWS:
                rows.append(self._draw_title(plot, width))
                rows += self._draw_plot(plot, width, count - 1)
            else:
                # A plot without enough rows shows its title with the value.
                rows += [
                    self._draw_title(plot, width),
                    *[Strip.blank(width, self.rich_style)] * (count - 1),
                ][:count]
        rows.append(self._draw_time_axis(view, width))
        return rows

    def _draw_title(self, plot: ChannelPlot, width: int) -> Strip:
        """Return the title of a plot: label, value, unit, summary."""
        muted, value = (
            self.find_style("trend--muted"),
            self.find_style("trend--stale" if self.view.stale else "trend--title"),
        )
        unit = f" {plot.unit}" if plot.unit else ""
        left = [
            (f" {plot.label}", self.find_style("trend--title")),
            (f"  {plot.value}", value),
            (f"{unit}   ", muted),
        ]
        fixed = f"  {_('fixed')} " if plot.fixed else ""
        # The summary fills the rest of the title.
        room = width - sum(cell_len(text) for text, _style in left) - cell_len(fixed)
        return self.make_text_strip(
            width, *left, (fit_text_width(plot.sums, room), muted), (fixed, muted)
        )

    def _draw_plot(self, plot: ChannelPlot, width: int, count: int) -> Iterator[Strip]:
        """Yield the rows of a plot."""
        muted = self.find_style("trend--muted")
        columns = self.count_columns(width)
        line = self.find_style("trend--stale" if self.view.stale else "trend--applied")
        cursor_style = self.find_style("plots--cursor")
        dots = trace_cells(plot.pieces, columns, count)
        cursor = (
            # The same rounding as for the dots, so that the cursor is in the column of its value.
            None if self.view.cursor is None else round(self.view.cursor * (2 * columns - 1)) // 2
        )
        # A low plot has labels at its ends only.
        labels = {(count - 1) // 2: plot.middle} if count >= MIN_LABELLED_ROWS else {}
        labels |= {0: plot.high, count - 1: plot.low}
        for row in range(count):
            label = labels.get(row, "")
            segments = [Segment(align_text_right(label, _AXIS_LABEL_CELLS - 1) + " ", muted)]
            segments += self._draw_cells(dots, row, columns, cursor, line, cursor_style)
            yield Strip(segments).adjust_cell_length(width, self.rich_style)

    @staticmethod
    def _draw_cells(
        dots: CellDots, row: int, columns: int, cursor: int | None, line: Style, cursor_style: Style
    ) -> Iterator[Segment]:
        """Yield the cells before the cursor, its own cell, and the cells after it."""
        row_of = [
            chr(BLANK_BRAILLE_CODE | bits) if (bits := dots.get((column, row), 0)) else " "
            for column in range(columns)
        ]
        if cursor is None or not 0 <= cursor < columns:
            yield from _split_runs("".join(row_of), line)
            return
        yield from _split_runs("".join(row_of[:cursor]), line)
        yield Segment("│" if row_of[cursor] == " " else row_of[cursor], cursor_style)
        yield from _split_runs("".join(row_of[cursor + 1 :]), line)

    def _draw_time_axis(self, view: PlotsView, width: int) -> Strip:
        """Return the time axis; the cursor's time covers a label at the same position."""
        columns = self.count_columns(width)
        read = f" {view.cursor_time} " if view.cursor is not None else ""
        # The cursor's time is centred on the cursor and stays inside the axis.
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
        muted = self.find_style("trend--muted")
        return self.make_text_strip(
            width,
            (" " * _AXIS_LABEL_CELLS + line[:taken], muted),
            (read, self.find_style("plots--cursor")),
            (line[taken + len(read) :], muted),
        )

    # The following methods react to the mouse.

    def _find_title_rows(self) -> set[int]:
        """Return the rows of the titles."""
        found, row = set(), 0
        for count in self.count_plot_rows(self.content_size.height):
            found.add(row)
            row += count
        return found

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        return (
            tuple((0, row) for row in sorted(self._find_title_rows()))
            if self.view.plots
            else ((0, 0),)
        )

    def on_click(self, event: events.Click) -> None:
        """Read the clicked time, or ask for channels after a click on a title."""
        event.stop()
        # A click on a title chooses channels.
        if event.y in self._find_title_rows() or not self.view.plots:
            self.post_message(self.Named())
            return
        columns = self.count_columns(self.content_size.width)
        if _AXIS_LABEL_CELLS <= event.x < _AXIS_LABEL_CELLS + columns:
            self.post_message(
                self.Pointed((2 * (event.x - _AXIS_LABEL_CELLS) + 0.5) / (2 * columns - 1))
            )

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Shorten the span."""
        event.stop()
        self.post_message(self.Wheeled(1))

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Lengthen the span."""
        event.stop()
        self.post_message(self.Wheeled(-1))


# An axis has at least this number of round steps.
_MIN_AXIS_STEPS = 4


def round_axis_ends(low: float, high: float, decimals: int) -> tuple[float, float]:
    """Return round numbers that contain low to high and differ in the last displayed decimal. NaN
    gives 0 to 1."""
    # A channel without values still gets an axis.
    if not (isfinite(low) and isfinite(high)):
        return 0.0, 1.0
    least = _MIN_AXIS_STEPS * 10.0**-decimals
    if high - low < least:
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * least, middle + 0.5 * least
    step = _choose_round_step((high - low) / _MIN_AXIS_STEPS)
    # The tolerance prevents another step for a value exactly on a round number.
    return floor(low / step + 1e-9) * step, ceil(high / step - 1e-9) * step


def _choose_round_step(about: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at least `about`."""
    power = 10.0 ** floor(log10(about))
    return next(
        factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= about * (1.0 - 1e-9)
    )
