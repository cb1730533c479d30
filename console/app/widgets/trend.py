"""Target and applied rate over the last two minutes, in braille: 2 x 4 dots a cell. A click
reads a time off."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, NamedTuple

from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.message import Message
from textual.strip import Strip
from topdress.console.app.braille import BITS, BLANK, Dots, trace
from topdress.console.app.history import TREND_SPAN_S, Point
from topdress.console.app.units import Unit
from topdress.console.app.view import duration
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.app.widgets.panel import right
from topdress.console.locale import _
from topdress.console.scale import round_calm_ends

_AXIS = 6


class CursorReading(NamedTuple):
    """What the cursor reads: its time of the run, s, and in words; the values that were in
    force then."""

    time_s: float
    time: str
    target: str
    applied: str


class TrendView(NamedTuple):
    points: tuple[Point, ...]
    unit: Unit
    stale: bool = False
    span_s: float = TREND_SPAN_S
    read: CursorReading | None = None


def columns_of(width: int) -> int:
    """Cells of the plot itself."""
    return width - _AXIS - 1


class Trend(Canvas[TrendView]):
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
        """The plot was clicked at this share of its span."""

        def __init__(self, share: float) -> None:
            super().__init__()
            self.share = share

    class Left(Message):
        """The title was clicked: the cursor goes."""

    def on_click(self, event: events.Click) -> None:
        event.stop()
        columns = columns_of(self.content_size.width)
        if event.y == 0:
            self.post_message(self.Left())
        elif _AXIS <= event.x < _AXIS + columns:
            self.post_message(self.Pointed((2 * (event.x - _AXIS) + 0.5) / (2 * columns - 1)))

    def lines(self, view: TrendView, width: int, height: int) -> list[Strip]:
        plot_rows, plot_columns = height - 2, columns_of(width)
        if plot_rows < 2 or plot_columns < 10:
            return []
        muted, plain = self.style("trend--muted"), self.rich_style
        target_style = self.style("trend--stale" if view.stale else "trend--target")
        applied_style = self.style("trend--stale" if view.stale else "trend--applied")
        band_style = self.style("trend--stale-band" if view.stale else "trend--band")
        on_band = target_style + Style(bgcolor=band_style.bgcolor)
        unit = view.unit
        low, high = round_calm_ends(
            v * unit.per_si for p in view.points for v in p[1:] if v is not None
        )
        now_s = view.points[-1].time_s if view.points else 0.0

        def line(of: int) -> list[tuple[float, float | None]]:
            return [
                (
                    1 - (now_s - point.time_s) / view.span_s,
                    None
                    if (rate := point[of]) is None
                    else (rate * unit.per_si - low) / (high - low),
                )
                for point in view.points
            ]

        targets = trace(line(1), plot_columns, plot_rows)
        applieds = trace(line(2), plot_columns, plot_rows)
        read, cursor = view.read, None
        if read is not None:
            cursor = round((1 - (now_s - read.time_s) / view.span_s) * (plot_columns - 1))
        at = (
            ()
            if read is None
            else (("   ", muted), (f" {read.time} ", self.style("trend--cursor")))
        )
        rows = [
            self.text_strip(
                width,
                (f" {_('trend')} ", self.style("trend--title")),
                (f"{unit.name}   ", muted),
                ("▄▄▄", on_band),
                (f" {_('target')}{_after(read and read.target)}   ", target_style),
                ("⠤⠤⠤ ", applied_style),
                (f"{_('applied')}{_after(read and read.applied)}", applied_style),
                *at,
            )
        ]
        labels = {0: f"{high:.0f}", plot_rows - 1: f"{low:.0f}"}
        if plot_rows >= 5:
            labels[(plot_rows - 1) // 2] = f"{(low + high) / 2:.0f}"
        for row in range(plot_rows):
            segments = [Segment(right(labels.get(row, ""), _AXIS - 1) + " ", muted)]
            cells = list(self._cells(row, plot_columns, targets, applieds, on_band, applied_style))
            if cursor is not None and 0 <= cursor < plot_columns:
                cells[cursor] = Segment(
                    "│" if cells[cursor].text == " " else cells[cursor].text,
                    self.style("trend--cursor"),
                )
            segments += cells
            rows.append(Strip(segments).adjust_cell_length(width, plain))
        start = f"-{duration(view.span_s)}"
        middle = f"-{duration(view.span_s / 2)}"
        now = _("now")
        gap = plot_columns // 2 - len(start) - len(middle) // 2
        rest = right(now, plot_columns - len(start) - gap - len(middle))
        rows.append(
            self.text_strip(width, (" " * _AXIS + start + " " * gap + middle + rest, muted))
        )
        return rows

    def _cells(
        self,
        row: int,
        columns: int,
        targets: Dots,
        applieds: Dots,
        target_style: Style,
        applied_style: Style,
    ) -> Iterator[Segment]:
        """Cells that the target passes are tinted, and solid where the applied rate, in dots,
        does not lie over it: the two are told apart without colour too."""
        tinted = applied_style + Style(bgcolor=target_style.bgcolor)
        for column in range(columns):
            target, applied = targets.get((column, row), 0), applieds.get((column, row), 0)
            if applied:
                yield Segment(chr(BLANK | applied), tinted if target else applied_style)
            else:
                yield Segment(
                    _solid(target) if target else " ", target_style if target else applied_style
                )


def _solid(dots: int) -> str:
    """The half of a cell that these dots lie in; both halves of one that they pass through."""
    upper, lower = (
        dots & sum(left | right for left, right in half) for half in (BITS[:2], BITS[2:])
    )
    return "█" if upper and lower else "▀" if upper else "▄"


def _after(value: str | None) -> str:
    """A value behind its name; nothing where none is read."""
    return "" if value is None else f" {value}"
