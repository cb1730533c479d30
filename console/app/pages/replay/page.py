"""Shows the Replay screen: the panels of the Run page, fed from a log. A working machine keeps its
alarms, hold and STOP.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

from rich.cells import cell_len
from textual import events
from textual.content import Content
from textual.message import Message
from topdress.console.app.widgets.base_panel import (
    Panel,
    TextPart,
    fit_text_width,
    make_line,
    spread_parts,
)
from topdress.console.locale import _

if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp

from collections.abc import Sequence
from itertools import islice
from typing import ClassVar

from textual.app import ComposeResult
from textual.worker import Worker, get_current_worker
from topdress.console.app import frame_words
from topdress.console.app.action import REPLAY, make_bindings
from topdress.console.app.coverage_raster import WorkedGround
from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.frame_history import LogHistory, TrendPoint
from topdress.console.app.pages.log_page import EMPTY_GROUND
from topdress.console.app.pages.panel_page import PanelScreen
from topdress.console.app.pages.replay.keys import ACTIONS
from topdress.console.app.pages.replay.service import LogFiles, ReplayJob, WhatIf
from topdress.console.app.panel_views import RunView, find_rate_error, format_duration
from topdress.console.app.replay_source import ReplaySource
from topdress.console.app.units import Units
from topdress.console.frame import Frame
from topdress.console.worker.resume_alarms import AlarmHistory, AlarmRecord


# The bar shows position, speed, and whether the log is shown as recorded or recomputed. A click
# seeks.
class ReplayView(NamedTuple):
    """Holds position, speed and mode of the replay."""

    name: str
    playing: bool
    speed: str
    at: str
    end: str
    # Position as a share of the log, rounded to the resolution of a wide bar, so that equal views
    # are not drawn again.
    share: float
    # "as recorded", or the names of what was changed.
    mode: str
    other: bool
    findings: int
    busy: str
    alarm_shares: tuple[float, ...] = ()
    # Effect of a recomputation, which replaces the log's name.
    changed: str = ""


class ReplayBar(Panel[ReplayView]):
    """Shows two rows: the log, and the time line with marks where alarms begin."""

    class Seek(Message):
        """Reports a click on the time line, at a share of the log."""

        def __init__(self, share: float) -> None:
            super().__init__()
            self.share = share

    class Cancel(Message):
        """Reports a click on the word that a computation is in progress."""

    def draw_rows(self, view: ReplayView, width: int, height: int) -> list[Content]:
        # A sign and a word: the state must be visible without colour.
        symbol, word = ("▸", _("playing")) if view.playing else ("▮▮", _("paused"))
        left: list[TextPart] = [
            (f" {symbol} {word} ", "bold"),
            (f" {view.speed} ", "bold $primary"),
            (f" {view.mode} ", "bold reverse" if view.other else "$muted"),
            f" {view.changed or view.name}",
        ]
        return [
            spread_parts(left, self._list_end_parts(view), width),
            self._draw_time_line(view, width),
        ]

    def _list_end_parts(self, view: ReplayView) -> list[TextPart]:
        """Return the parts at the right end. A computation excludes the other parts, because a
        click on it cancels."""
        if view.busy:
            return [(f" {view.busy} ", "bold reverse")]
        if view.findings:
            # The user's keymap may have another key.
            key = cast("TopdressApp", self.app).find_shown_key("findings")
            return [
                (
                    f" {key}: {_('findings')} {view.findings} ",
                    "bold $on-alarm-amber on $alarm-amber",
                )
            ]
        return []

    def _count_end_cells(self, view: ReplayView) -> int:
        """Return the cells of the parts at the right end."""
        return sum(
            cell_len(part if isinstance(part, str) else part[0])
            for part in self._list_end_parts(view)
        )

    @staticmethod
    def _format_ends(view: ReplayView) -> tuple[str, str]:
        """Return the texts at both ends of the time line."""
        return f" {view.at} ", f" {view.end} "

    def _draw_time_line(self, view: ReplayView, width: int) -> Content:
        """Return the time line with position and alarms."""
        first, last = self._format_ends(view)
        # Four cells are the shortest line on which a position is visible.
        room = max(4, width - cell_len(first) - cell_len(last))
        at = round(view.share * (room - 1))
        alarms = {round(share * (room - 1)) for share in view.alarm_shares}
        parts: list[TextPart] = [(first, "bold")]
        for cell in range(room):
            # The position covers an alarm in the same cell.
            if cell == at:
                parts.append(("┃", "bold $foreground on $track"))
            elif cell in alarms:
                parts.append(("!", "bold $on-alarm-red on $alarm-red"))
            else:
                parts.append(("━" if cell < at else "─", "$primary" if cell < at else "$muted"))
        return make_line(*parts, (fit_text_width(last, cell_len(last)), "$muted"))

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        """Return the clickable positions: word of a computation, ends of the log."""
        width = self.content_size.width
        first, last = (cell_len(text) for text in self._format_ends(self.view))
        cancel = ((width - self._count_end_cells(self.view), 0),) if self.view.busy else ()
        return (*cancel, (first, 1), (width - last - 1, 1))

    def on_click(self, event: events.Click) -> None:
        """Seek, or cancel the computation."""
        if (
            event.y == 0
            and self.view.busy
            and event.x >= self.content_size.width - self._count_end_cells(self.view)
        ):
            event.stop()
            self.post_message(self.Cancel())
            return
        first, last = self._format_ends(self.view)
        room = self.content_size.width - cell_len(first) - cell_len(last)
        if event.y == 1 and 0 <= event.x - cell_len(first) < room:
            event.stop()
            self.post_message(self.Seek((event.x - cell_len(first)) / max(1, room - 1)))


_VIEW_WITHOUT_LOG = ReplayView("", False, "", "--", "--", 0.0, "", False, 0, "")


def describe_difference(before: Sequence[Frame], after: Sequence[Frame], units: Units) -> str:
    """Describe the effect of a recomputation: total mass, and mean deviation of the rate from the
    target at work."""
    # The last frame contains the total of the log.
    kg, was_kg = (frames[-1].applied_kg for frames in (after, before))
    sign = "+" if kg >= was_kg else "-"
    said = _("{more} ({kg} instead of {before})").format(
        more=sign + units.mass.format_with_name(abs(kg - was_kg)),
        kg=units.mass.format_with_name(kg),
        before=units.mass.format_with_name(was_kg),
    )

    def calc_mean_error(frames: Sequence[Frame]) -> float | None:
        found = [
            abs(error)
            for frame in frames
            # A foreign log has no state; every row of it counts as work.
            if frame.row.state in (None, "working")
            and (
                error := find_rate_error(frame.row.target_rate_kg_ha, frame.row.applied_rate_kg_ha)
            )
            is not None
        ]
        return 100.0 * sum(found) / len(found) if found else None

    # The mean absolute error shows evenness, which the total does not.
    now, was = calc_mean_error(after), calc_mean_error(before)
    if now is None or was is None:
        return said
    off = _("off the target by {now} % instead of {before} %").format(
        now=f"{now:.1f}", before=f"{was:.1f}"
    )
    return f"{said}, {off}"


class ReplayScreen(PanelScreen):
    """Shows a log."""

    where: ClassVar[str] = REPLAY
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self, job: ReplayJob | None = None) -> None:
        super().__init__()
        self.add_class("replay")
        self.job: ReplayJob | None = None
        self.chosen = WhatIf()
        self.computing: Worker[None] | None = None
        self._history = LogHistory(())
        self._computed_share, self._difference_text = 0.0, ""
        if job is not None:
            self.open_job(job)

    def open_job(self, job: ReplayJob) -> None:
        """Play another log from its start."""
        self.job, self.chosen = job, WhatIf()
        # The recorded frames stay in memory, so that returning to them is immediate.
        self._recorded = job.source.frames
        self._note_alarms()
        self.refresh_all_next_tick()

    def _note_alarms(self) -> None:
        """Find the positions of the alarms' begins on the time line."""
        assert self.job is not None
        source = self.job.source
        # A log of one row has no length.
        length = max(1e-9, source.end_s - source.start_s)
        begins, before = [], frozenset[str]()
        for frame in source.frames:
            now = frozenset(alarm.id for alarm in frame.alarms)
            # Only new alarms get a mark: a standing alarm would fill the line.
            if now - before:
                begins.append(round((frame.row.time_s - source.start_s) / length, 3))
            before = now
        self._alarm_shares = tuple(dict.fromkeys(begins))

    def list_alarm_records(self) -> tuple[AlarmRecord, ...]:
        """Return all alarms of the log up to the present frame."""
        # The history is built anew, because the operator may seek backwards.
        book = AlarmHistory()
        if self.job is not None:
            source = self.job.source
            for frame in islice(source.frames, source.frame_index + 1):
                book.add_row_alarms(frame.row.time_s, frame.row.utc, frame.alarms)
        return book.records

    def compose_extra(self) -> ComposeResult:
        yield ReplayBar(
            _VIEW_WITHOUT_LOG._replace(name=_("no log is open: J opens one")), id="replay-bar"
        )

    def find_replayed(self) -> ReplayJob | None:
        return self.job

    def list_trend_points(self) -> tuple[TrendPoint, ...]:
        return () if self.job is None else super().list_trend_points()

    def find_ground(self, frame: Frame | None) -> tuple[WorkedGround, FieldPicture | None]:
        return (EMPTY_GROUND, None) if self.job is None else super().find_ground(frame)

    def find_history(self) -> LogHistory:
        """Return the history of the frames that are played now."""
        frames = self.job.source.frames if self.job is not None else ()
        # A recomputation replaces the frames, so their history begins anew.
        if self._history.frames is not frames:
            self._history = LogHistory(frames)
        return self._history

    def find_frame(self, now_s: float) -> tuple[Frame | None, float]:
        return (None, 0.0) if self.job is None else super().find_frame(now_s)

    def make_view(self, frame: Frame | None, age_s: float) -> RunView:
        view = super().make_view(frame, age_s)
        # Without a log the status line explains the empty page.
        silent = view.status.silent if self.job is not None else _("no log is open: J opens one")
        return view._replace(status=view.status._replace(lead=_("REPLAY"), silent=silent))

    def show_numbers(self, view: RunView) -> None:
        """Show the panels and the bar."""
        super().show_numbers(view)
        if self.job is None:
            return
        source = self.job.source
        share = (source.at_s - source.start_s) / max(1e-9, source.end_s - source.start_s)
        busy = (
            ""
            if self.computing is None
            else _("computing {percent} %, Esc cancels").format(
                percent=f"{100.0 * self._computed_share:.0f}"
            )
        )
        self.query_one("#replay-bar", ReplayBar).show_view(
            ReplayView(
                self.job.name,
                # At the end of the log nothing plays any more.
                source.playing and not source.is_at_end,
                f"{source.speed:g}x",
                format_duration(source.at_s),
                format_duration(source.end_s),
                round(share, 3),
                self.describe_mode(),
                self.chosen != WhatIf(),
                len(self.job.findings),
                busy,
                self._alarm_shares,
                self._difference_text if self.chosen != WhatIf() else "",
            )
        )

    def describe_mode(self) -> str:
        """Return the mode in words."""
        if self.chosen == WhatIf():
            return _("as recorded")
        other = (
            frame_words.name_strategy(self.chosen.strategy),
            self.chosen.crop or "",
            self.chosen.machine or "",
        )
        return _("what if: {other}").format(other=", ".join(part for part in other if part))

    async def on_replay_bar_cancel(self, event: ReplayBar.Cancel) -> None:
        """Cancel the computation."""
        await self.app.action_do("cancel_what_if")

    def on_replay_bar_seek(self, event: ReplayBar.Seek) -> None:
        """Seek the clicked position."""
        if self.job is not None:
            source = self.job.source
            source.seek_time(source.start_s + event.share * (source.end_s - source.start_s))
            self.refresh_all_next_tick()

    @property
    def opened_job(self) -> ReplayJob:
        """Log, for actions that need one."""
        assert self.job is not None
        return self.job

    @property
    def player(self) -> ReplaySource:
        """Source of the frames."""
        return self.opened_job.source

    def show_recorded(self) -> None:
        """Play the log as recorded."""
        self.cancel_what_if()
        self.player.replace_frames(self._recorded)
        self.chosen = WhatIf()
        self._note_alarms()

    def read_log(self, files: LogFiles, path: str) -> None:
        """Read a log in a thread and open it."""

        def open_read(job: ReplayJob) -> None:
            self.cancel_what_if()
            self.open_job(job)

        self.app.show_notice(_("reading the log"))
        self.app.run_with_files(lambda: files.open_log(path), open_read, group="open-log")

    def begin_what_if(self, choice: str) -> None:
        """Recompute the log with another strategy, crop or machine, in a thread."""
        if self.job is None or self.job.what_if is None:
            return
        # The choice names the field of `WhatIf` that it replaces.
        field, _colon, value = choice.partition(":")
        # Changes accumulate: the new choice extends the present choices.
        compute, wanted = self.job.what_if, self.chosen._replace(**{field: value})
        self.cancel_what_if()
        self._computed_share = 0.0

        def run_in_thread() -> Sequence[Frame]:
            me = get_current_worker()

            def note_progress(share: float) -> None:
                if not me.is_cancelled:
                    self._computed_share = share

            return compute(wanted, lambda: me.is_cancelled, note_progress)

        def take_frames(frames: Sequence[Frame]) -> None:
            self.cancel_what_if()
            # A recomputation of the present log has other rows; the position is restored by time.
            try:
                self.player.replace_frames(frames)
            except ValueError as error:
                self.app.show_notice(str(error))
                return
            self.chosen = wanted
            self._difference_text = describe_difference(self._recorded, frames, self.app.units)
            self._note_alarms()

        def note_failure(why: str) -> None:
            self.cancel_what_if()
            self.app.show_notice(why)

        self.computing = self.app.run_with_files(
            run_in_thread, take_frames, note_failure, group="what-if"
        )
        self.refresh_all_next_tick()

    def cancel_what_if(self) -> None:
        """Stop the thread at its next row and drop its result."""
        if self.computing is not None:
            self.computing.cancel()
            self.computing = None
            self.refresh_all_next_tick()
