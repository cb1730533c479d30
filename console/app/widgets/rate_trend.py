"""Plots target and applied rate over the last two minutes in braille, 2 x 4 dots per cell. A click
reads the values at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, NamedTuple

from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.message import Message
from textual.strip import Strip
from topdress.console.app.braille import BLANK_BRAILLE_CODE, CELL_DOT_BITS, CellDots, trace_values
from topdress.console.app.frame_history import TREND_SPAN_S, TrendPoint
from topdress.console.app.panel_views import format_duration
from topdress.console.app.units import Unit
from topdress.console.app.widgets.base_panel import align_text_right
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.colour_scale import round_calm_ends
from topdress.console.locale import _

# Columns for the numbers of the vertical axis.
_AXIS_LABEL_CELLS = 6


class CursorReading(NamedTuple):
    """Holds the reading at the cursor: time of the run (s), time in words, and the values in force
    at that time."""

    time_s: float
    time: str
    target: str
    applied: str


class TrendView(NamedTuple):
    """Holds the trend."""

    points: tuple[TrendPoint, ...]
    unit: Unit
    stale: bool = False
    span_s: float = TREND_SPAN_S
    read: CursorReading | None = None


def count_plot_columns(width: int) -> int:
    """Return the number of cells of the plot itself."""
    return width - _AXIS_LABEL_CELLS - 1


class Trend(Canvas[TrendView]):
    """Shows target and applied rate over time."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "trend--target",
        "trend--applied",
        "trend--muted",
        "trend--title",
        "trend--stale",
        "trend--band",
        "trend--stale-band",
        "trend--cursor",
    }

    class Pointed(Message):
        """Reports a click on the plot, at a share of its span."""

        def __init__(self, share: float) -> None:
            super().__init__()
            self.share = share

    class Left(Message):
        """Reports a click on the title, which removes the cursor."""

    def on_click(self, event: events.Click) -> None:
        """Report where the plot was clicked."""
        event.stop()
        columns = count_plot_columns(self.content_size.width)
        # The first row is the title.
        if event.y == 0:
            self.post_message(self.Left())
        elif _AXIS_LABEL_CELLS <= event.x < _AXIS_LABEL_CELLS + columns:
            self.post_message(
                self.Pointed((2 * (event.x - _AXIS_LABEL_CELLS) + 0.5) / (2 * columns - 1))
            )

    def draw_rows(self, view: TrendView, width: int, height: int) -> list[Strip]:
        plot_rows, plot_columns = height - 2, count_plot_columns(width)
        # A smaller plot shows nothing readable.
        if plot_rows < 2 or plot_columns < 10:
            return []
        muted, plain = self.find_style("trend--muted"), self.rich_style
        target_style = self.find_style("trend--stale" if view.stale else "trend--target")
        applied_style = self.find_style("trend--stale" if view.stale else "trend--applied")
        band_style = self.find_style("trend--stale-band" if view.stale else "trend--band")
        # The target is a filled band and the applied rate a line above it.
        on_band = target_style + Style(bgcolor=band_style.bgcolor)
        unit = view.unit
        # Round ends that change rarely keep the curves calm while new values arrive.
        low, high = round_calm_ends(
            v * unit.per_si for p in view.points for v in p[1:] if v is not None
        )
        # The right edge is the newest point, not the clock: a stale trend stands still.
        now_s = view.points[-1].time_s if view.points else 0.0

        def make_plot_line(of: int) -> list[tuple[float, float | None]]:
            return [
                (
                    1 - (now_s - point.time_s) / view.span_s,
                    None
                    # An unknown rate interrupts the curve.
                    if (rate := point[of]) is None
                    else (rate * unit.per_si - low) / (high - low),
                )
                for point in view.points
            ]

        targets = trace_values(make_plot_line(1), plot_columns, plot_rows)
        applieds = trace_values(make_plot_line(2), plot_columns, plot_rows)
        read, cursor = view.read, None
        if read is not None:
            # The cursor is a whole cell, as wide as the resolution of a click.
            cursor = round((1 - (now_s - read.time_s) / view.span_s) * (plot_columns - 1))
        at = (
            ()
            if read is None
            else (("   ", muted), (f" {read.time} ", self.find_style("trend--cursor")))
        )
        rows = [
            self.make_text_strip(
                width,
                (f" {_('trend')} ", self.find_style("trend--title")),
                (f"{unit.name}   ", muted),
                ("▄▄▄", on_band),
                (f" {_('target')}{_format_after_name(read and read.target)}   ", target_style),
                ("⠤⠤⠤ ", applied_style),
                (f"{_('applied')}{_format_after_name(read and read.applied)}", applied_style),
                *at,
            )
        ]
        labels = {0: f"{high:.0f}", plot_rows - 1: f"{low:.0f}"}
        # The middle label needs a row of distance to the others.
        if plot_rows >= 5:
            labels[(plot_rows - 1) // 2] = f"{(low + high) / 2:.0f}"
        for row in range(plot_rows):
            segments = [
                Segment(align_text_right(labels.get(row, ""), _AXIS_LABEL_CELLS - 1) + " ", muted)
            ]
            cells = list(
                self._iterate_cells(row, plot_columns, targets, applieds, on_band, applied_style)
            )
            if cursor is not None and 0 <= cursor < plot_columns:
                # The cursor keeps the character of the curve below it.
                cells[cursor] = Segment(
                    "│" if cells[cursor].text == " " else cells[cursor].text,
                    self.find_style("trend--cursor"),
                )
            segments += cells
            rows.append(Strip(segments).adjust_cell_length(width, plain))
        start = f"-{format_duration(view.span_s)}"
        middle = f"-{format_duration(view.span_s / 2)}"
        now = _("now")
        gap = plot_columns // 2 - len(start) - len(middle) // 2
        rest = align_text_right(now, plot_columns - len(start) - gap - len(middle))
        rows.append(
            self.make_text_strip(
                width, (" " * _AXIS_LABEL_CELLS + start + " " * gap + middle + rest, muted)
            )
        )
        return rows

    def _iterate_cells(
        self,
        row: int,
        columns: int,
        targets: CellDots,
        applieds: CellDots,
        target_style: Style,
        applied_style: Style,
    ) -> Iterator[Segment]:
        """Yield the cells of one row. Cells of the target are tinted, and solid where no dot of the
        applied rate covers them, so that both curves differ without colour too."""
        tinted = applied_style + Style(bgcolor=target_style.bgcolor)
        for column in range(columns):
            target, applied = targets.get((column, row), 0), applieds.get((column, row), 0)
            if applied:
                yield Segment(
                    chr(BLANK_BRAILLE_CODE | applied), tinted if target else applied_style
                )
            else:
                yield Segment(
                    _draw_solid_half(target) if target else " ",
                    target_style if target else applied_style,
                )


def _draw_solid_half(dots: int) -> str:
    """Return the half block of a cell that contains these dots, or a full block if both halves
    contain dots."""
    upper, lower = (
        dots & sum(left | right for left, right in half)
        for half in (CELL_DOT_BITS[:2], CELL_DOT_BITS[2:])
    )
    return "█" if upper and lower else "▀" if upper else "▄"


def _format_after_name(value: str | None) -> str:
    """Return a value after its name; "" without a reading."""
    return "" if value is None else f" {value}"
