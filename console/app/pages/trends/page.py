"""Shows the Trends screen: up to three channels of the run or log over any span, frozen or running,
read at a time.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from typing import ClassVar, NamedTuple

from textual.app import ComposeResult
from textual.containers import Vertical
from textual.content import Content
from textual.widgets import Button
from topdress.console.app.action import TRENDS, make_bindings
from topdress.console.app.braille import PlotPiece
from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.pages.log_page import LogPage
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.pages.trends.channel_plots import (
    ChannelPlot,
    Plots,
    PlotsView,
    round_axis_ends,
)
from topdress.console.app.pages.trends.keys import ACTIONS
from topdress.console.app.panel_views import MAX_FRESH_AGE_S, format_duration, format_local_time
from topdress.console.app.trend_channels import (
    BY_ID,
    CHANNELS,
    DEFAULT_TREND_CHANNELS,
    TrendChannel,
)
from topdress.console.app.trend_series import TrendStretch, summarise_stretch
from topdress.console.app.units import Unit, Units
from topdress.console.app.widgets.base_panel import Panel, Picked, fit_text_width, spread_parts
from topdress.console.frame import Frame
from topdress.console.locale import _

# The dialog lists all channels; Enter plots a channel or removes it. Three plots have readable
# heights on a usual screen.
MAX_CHANNELS = 3


class ChannelDialog(ChoiceDialog):
    """Asks which channels to plot. A fourth channel replaces the first.

    Parameters
    ----------
    tell
        Receives the ids of the chosen channels, in the order of choosing, after every change.
    """

    def __init__(
        self, chosen: tuple[str, ...], units: Units, tell: Callable[[tuple[str, ...]], None]
    ) -> None:
        self.chosen, self._units, self._tell = list(chosen), units, tell
        super().__init__(
            _("What is plotted"),
            self._list_choices(),
            "",
            _("Up to three; a fourth one takes the place of the first."),
        )

    def compose_buttons(self) -> ComposeResult:
        yield Button(f"{_('Enter')}  {_('take or drop')}", id="yes", classes="dialog-button")
        yield Button(f"Esc  {_('close')}", id="cancel", classes="dialog-button")

    def _list_choices(self) -> tuple[Choice, ...]:
        return tuple(Choice(one.id, self._format_channel(one)) for one in CHANNELS)

    def _format_channel(self, channel: TrendChannel) -> str:
        """Return a line for a channel: position among the plots, label, unit."""
        # The number is the position of the plot.
        mark = f"{self.chosen.index(channel.id) + 1}" if channel.id in self.chosen else " "
        return f"[{mark}] {fit_text_width(_(channel.label), 24)}{channel.unit(self._units).name}"

    def action_yes(self) -> None:
        """Plot the marked channel, or remove it."""
        if not self._unknown_number:
            self._toggle_channel(self.choices[self.at].value)

    def on_picked(self, event: Picked) -> None:
        """Plot the clicked channel, or remove it; the result is visible, and another click reverses
        it."""
        self._toggle_channel(self.choices[event.index].value)

    def _toggle_channel(self, channel: str) -> None:
        """Plot a channel, or remove it."""
        if channel in self.chosen:
            self.chosen.remove(channel)
        else:
            self.chosen = [*self.chosen, channel][-MAX_CHANNELS:]
        self.choices = self._list_choices()
        self._show_mark()
        self._tell(tuple(self.chosen))


class SpanView(NamedTuple):
    """Holds span and states; `standing` is True while the plots are frozen."""

    span: str
    states: tuple[str, ...]
    standing: bool


class SpanBar(Panel[SpanView]):
    """Shows span and states."""

    def draw_rows(self, view: SpanView, width: int, height: int) -> list[Content]:
        style = "bold reverse" if view.standing else "$muted"
        return [
            spread_parts(
                [(f" {view.span} ", "bold")], [(f" {'   '.join(view.states)} ", style)], width
            )
        ]


# Spans that zooming offers, s: from 10 s to 8 h.
SPANS_S = (10.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0, 7200.0, 14_400.0, 28_800.0)
# The first span shows two minutes, as the Run page does.
FIRST_SPAN_INDEX = SPANS_S.index(120.0)
# A time without rows beyond this, s, and beyond three buckets, is a gap.
MAX_ROW_STEP_S = 2.5
# More buckets than any span has rows, which selects the finest series.
FINEST_BUCKET_COUNT = 100_000


class TimeWindow(NamedTuple):
    """Holds the visible span, s of the run."""

    from_s: float
    to_s: float

    @property
    def length_s(self) -> float:
        """Length of the span, s."""
        return self.to_s - self.from_s


class TrendsScreen(LogPage):
    """Shows the plots.

    Attributes
    ----------
    ends_s
        End of the frozen span, s of the run; None while the plots run.
    span
        Index of the span; None means the whole run.
    """

    where: ClassVar[str] = TRENDS
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        self.channels: tuple[str, ...] = DEFAULT_TREND_CHANNELS
        self.span: int | None = FIRST_SPAN_INDEX
        self.ends_s: float | None = None
        self.cursor_s: float | None = None
        self.fixed: dict[str, tuple[float, float]] | None = None
        self._axes: dict[str, tuple[float, float]] = {}

    def compose_body(self) -> ComposeResult:
        with Vertical(id="trends-all"):
            yield SpanBar(SpanView("", (), False), id="trends-bar")
            yield Plots(PlotsView((), "", "", ""), id="plots")

    def find_replayed(self) -> ReplayJob | None:
        return self.app.replay_page.job if self.app.source is None or self.wants_log else None

    def show_due(self, now_s: float) -> None:
        super().show_due(now_s)
        if self.plots.is_due(now_s):
            self._draw_plots(*self.find_frame(now_s))

    # The following methods draw the plots.

    def find_window(self) -> TimeWindow:
        """Return the visible span."""
        series = self.find_series()
        # Before the first row the span is empty.
        first, last = series.start_s or 0.0, series.end_s or 0.0
        if self.span is None:
            return TimeWindow(first, max(last, first + SPANS_S[0]))
        job = self.find_replayed()
        running = job.source.at_s if job is not None else last
        # A running plot ends at the newest row, or where the log is played.
        end = running if self.ends_s is None else self.ends_s
        return TimeWindow(end - SPANS_S[self.span], end)

    def _draw_plots(self, frame: Frame | None, age_s: float) -> None:
        """Draw plots, cursor and the bar of the span."""
        window, series = self.find_window(), self.find_series()
        pane = self.query_one("#plots", Plots)
        # A braille cell has two dots side by side, and each dot shows one bucket.
        buckets = 2 * pane.count_columns(max(1, pane.content_size.width))
        stretches = {name: series.find_stretch(name, *window, buckets) for name in self.channels}
        self._axes = self._find_axis_ends(stretches)
        plots = tuple(
            self._make_plot(BY_ID[name], stretches[name], window, buckets) for name in self.channels
        )
        cursor = (
            None if self.cursor_s is None else (self.cursor_s - window.from_s) / window.length_s
        )
        # A cursor outside the span could not be seen, so it is removed.
        if cursor is not None and not 0.0 <= cursor <= 1.0:
            cursor = self.cursor_s = None
        times = (window.from_s, 0.5 * (window.from_s + window.to_s), window.to_s)
        begin, middle, end = (self._format_time(time_s, frame) for time_s in times)
        pane.show_view(
            PlotsView(
                plots,
                begin,
                middle,
                end,
                cursor,
                "" if self.cursor_s is None else self._format_time(self.cursor_s, frame),
                age_s > MAX_FRESH_AGE_S,
            )
        )
        self.query_one("#trends-bar", SpanBar).show_view(
            SpanView(self._describe_span(window), self._list_states(), self.ends_s is not None)
        )

    def _find_axis_ends(self, stretches: dict[str, TrendStretch]) -> dict[str, tuple[float, float]]:
        """Return the ends of the axes in displayed units; channels of one group share an axis."""
        axes: dict[str, tuple[float, float]] = {}
        for name, stretch in stretches.items():
            channel = BY_ID[name]
            if self.fixed is not None and name in self.fixed:
                axes[name] = self.fixed[name]
                continue
            unit = channel.unit(self.app.units)
            # Channels of one group, such as target and applied rate, are compared by eye.
            alike = [
                summarise_stretch(other)
                for one, other in stretches.items()
                if one == name or (channel.group and BY_ID[one].group == channel.group)
            ]
            known = [each for each in alike if each.low == each.low] or [summarise_stretch(stretch)]
            axes[name] = round_axis_ends(
                min(each.low for each in known) * unit.per_si,
                max(each.high for each in known) * unit.per_si,
                unit.decimals,
            )
        return axes

    def _make_plot(
        self, channel: TrendChannel, stretch: TrendStretch, window: TimeWindow, buckets: int
    ) -> ChannelPlot:
        """Return the view of one plot."""
        unit = channel.unit(self.app.units)
        low, high = self._axes[channel.id]
        all_of_it = summarise_stretch(stretch)
        words = (
            ""
            if all_of_it.low != all_of_it.low
            else _("min {low}   mean {mean}   max {high}").format(
                low=unit.format_value(all_of_it.low),
                mean=unit.format_value(all_of_it.mean),
                high=unit.format_value(all_of_it.high),
            )
        )
        # Buckets wider than a row's period make longer steps normal.
        gap_s = max(MAX_ROW_STEP_S, 3.0 * window.length_s / buckets)
        at_s = window.to_s if self.cursor_s is None else self.cursor_s
        return ChannelPlot(
            _(channel.label),
            unit.name,
            self._format_value_at(channel, unit, at_s),
            words,
            _format_axis_end(low, unit),
            _format_axis_end(0.5 * (low + high), unit),
            _format_axis_end(high, unit),
            _make_pieces(stretch, window, gap_s, unit, low, high),
            self.fixed is not None and channel.id in self.fixed,
        )

    def _format_value_at(self, channel: TrendChannel, unit: Unit, at_s: float) -> str:
        """Return the value in force at a time from the finest series; "--" in a gap."""
        before = self.find_series().find_stretch(
            channel.id, at_s - MAX_ROW_STEP_S, at_s, FINEST_BUCKET_COUNT
        )
        value = float(before.mean[-1]) if len(before.mean) else float("nan")
        return "--" if value != value else unit.format_value(value)

    def _format_time(self, time_s: float, frame: Frame | None) -> str:
        """Return the time of day where known, else the time of the run."""
        clock = (
            ""
            if frame is None
            else format_local_time(frame.row.utc, self.app.utc_offset_s, frame.row.time_s - time_s)
        )
        return clock or format_duration(time_s)

    def _describe_span(self, window: TimeWindow) -> str:
        """Describe the length of the span."""
        length = format_duration(window.length_s)
        return (
            _("whole run, {length}").format(length=length)
            if self.span is None
            else _("span {length}").format(length=length)
        )

    def _list_states(self) -> tuple[str, ...]:
        """Return the states: log, fixed scale, frozen or running."""
        log = (_("log"),) if self.find_replayed() is not None else ()
        fixed = (_("fixed scale"),) if self.fixed is not None else ()
        return (*log, *fixed, _("FROZEN") if self.ends_s is not None else _("running"))

    # The following methods react to keys and clicks.

    def toggle_freeze(self) -> None:
        """Freeze the plots, or let them run."""
        self.ends_s = self.find_window().to_s if self.ends_s is None else None
        # The whole run has no fixed length, so freezing selects the first span.
        self.span = FIRST_SPAN_INDEX if self.span is None and self.ends_s is not None else self.span

    def toggle_scale(self) -> None:
        """Fix the scales, or fit them to the values."""
        self.fixed = dict(self._axes) if self.fixed is None else None

    def ask_channels(self) -> None:
        """Ask which channels to plot."""

        def take_channels(chosen: tuple[str, ...]) -> None:
            # Fixed scales belong to the former channels.
            self.channels, self.fixed = chosen, None
            self.app.show_changes()

        self.app.push_screen(ChannelDialog(self.channels, self.app.units, take_channels))

    def change_span(self, steps: int) -> None:
        """Change the span; its end stays in place, or the cursor where it is set."""
        # The span before the change keeps the cursor at its place on the screen.
        before = self.find_window()
        at = bisect_left(SPANS_S, before.length_s - 1.0) if self.span is None else self.span
        self.span = max(0, min(len(SPANS_S) - 1, at + steps))
        if self.cursor_s is not None and self.ends_s is not None:
            share = (self.cursor_s - before.from_s) / before.length_s
            self.ends_s = self.cursor_s + (1.0 - share) * SPANS_S[self.span]
            self._clamp_window_end()

    def _clamp_window_end(self) -> None:
        """Keep the end of the frozen span within the series."""
        series = self.find_series()
        if self.ends_s is not None and series.start_s is not None and series.end_s is not None:
            self.ends_s = max(
                min(series.start_s + SPANS_S[0], series.end_s), min(series.end_s, self.ends_s)
            )

    def calc_cell_s(self) -> float:
        """Return the time that a cell covers, s."""
        pane = self.query_one("#plots", Plots)
        return self.find_window().length_s / pane.count_columns(max(1, pane.content_size.width))

    def move_cursor(self, by_s: float) -> None:
        """Move the cursor. This freezes the plots, because the value under the cursor must not move
        on."""
        self._freeze_if_running()
        window = self.find_window()
        now = window.to_s if self.cursor_s is None else self.cursor_s
        self.cursor_s = max(window.from_s, min(window.to_s, now + by_s))

    def _freeze_if_running(self) -> None:
        """Freeze the plots unless they are frozen or show the whole run."""
        if self.ends_s is None and self.span is not None:
            self.ends_s = self.find_window().to_s

    def scroll_span(self, share: float) -> None:
        """Scroll by a share of the span."""
        if self.span is None:
            return
        self._freeze_if_running()
        self.ends_s = (self.ends_s or 0.0) + share * self.find_window().length_s
        self._clamp_window_end()

    def on_plots_pointed(self, event: Plots.Pointed) -> None:
        """Set the cursor at the clicked time."""
        if not self.app.locked:
            self._freeze_if_running()
            window = self.find_window()
            self.cursor_s = window.from_s + max(0.0, min(1.0, event.share)) * window.length_s
            self.app.show_changes()

    def on_plots_named(self, event: Plots.Named) -> None:
        """Ask which channels to plot."""
        if not self.app.locked:
            self.ask_channels()

    def on_plots_wheeled(self, event: Plots.Wheeled) -> None:
        """Change the span with the mouse wheel."""
        if not self.app.locked:
            self.change_span(-event.steps)
            self.app.show_changes()


def _format_axis_end(shown: float, unit: Unit) -> str:
    """Return the number at an end of an axis, without trailing zeros."""
    text = f"{shown + 0.0:.{unit.decimals + 1}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _make_pieces(
    stretch: TrendStretch, window: TimeWindow, gap_s: float, unit: Unit, low: float, high: float
) -> tuple[PlotPiece, ...]:
    """Return the pieces of a stretch in shares of span and axis; unknown values and gaps interrupt
    the line."""
    pieces: list[PlotPiece] = []
    last_s: float | None = None
    for time_s, least, most in zip(
        stretch.time_s.tolist(), stretch.low.tolist(), stretch.high.tolist(), strict=True
    ):
        # Only NaN differs from itself.
        if least != least:
            last_s = None
            continue
        joined = last_s is not None and time_s - last_s <= gap_s
        pieces.append(
            PlotPiece(
                (time_s - window.from_s) / window.length_s,
                (least * unit.per_si - low) / (high - low),
                (most * unit.per_si - low) / (high - low),
                joined,
            )
        )
        last_s = time_s
    return tuple(pieces)
