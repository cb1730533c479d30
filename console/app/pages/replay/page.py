"""The Replay screen: the same panels, fed from a log; a machine at work keeps its alarms, hold and stop."""
from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from threading import Event
from typing import ClassVar

from textual.app import ComposeResult
from textual.worker import Worker, WorkerState

from console.app import words
from console.app.action import REPLAY, Action, bindings
from console.app.field_picture import FieldPicture
from console.app.history import LogHistory, Point
from console.app.pages.log_page import EMPTY_GROUND
from console.app.pages.panel_page import PanelScreen
from console.app.pages.replay.keys import ACTIONS
from console.app.pages.replay.log_files import LogFiles
from console.app.pages.replay.replay_bar import ReplayBar, ReplayView
from console.app.replay_job import ReplayJob, WhatIf
from console.app.view import RunView, duration
from console.app.worked import Worked
from console.frame import Frame
from console.locale import _
from console.worker.resume_alarms import AlarmBook, AlarmRecord

_NO_LOG = ReplayView("", False, "", "--", "--", 0.0, "", False, 0, "")


class ReplayScreen(PanelScreen):
    where: ClassVar[str] = REPLAY
    BINDINGS: ClassVar = bindings(ACTIONS)

    def __init__(self, job: ReplayJob | None = None) -> None:
        super().__init__()
        self.add_class("replay")
        self.job: ReplayJob | None = None
        self.chosen = WhatIf()
        self.computing: Worker[Sequence[Frame]] | None = None
        self.opening: Worker[ReplayJob] | None = None
        self._wanted = WhatIf()
        self._history = LogHistory(())
        self._stop, self._share = Event(), 0.0
        if job is not None:
            self.open(job)

    def open(self, job: ReplayJob) -> None:
        """Play another log, from its start."""
        self.job, self.chosen = job, WhatIf()
        self._recorded = job.source.frames
        self._note_alarms()
        self.hurry()

    def _note_alarms(self) -> None:
        assert self.job is not None
        source = self.job.source
        length = max(1e-9, source.end_s - source.start_s)
        begins, before = [], frozenset[str]()
        for frame in source.frames:
            now = frozenset(alarm.id for alarm in frame.alarms)
            if now - before:
                begins.append(round((frame.row.time_s - source.start_s) / length, 3))
            before = now
        self._alarm_shares = tuple(dict.fromkeys(begins))

    def alarm_records(self) -> tuple[AlarmRecord, ...]:
        """All alarms of the log up to what is shown."""
        book = AlarmBook()
        if self.job is not None:
            source = self.job.source
            for frame in islice(source.frames, source.index + 1):
                book.see(frame.row.time_s, frame.row.utc, frame.alarms)
        return book.records

    def extra(self) -> ComposeResult:
        yield ReplayBar(_NO_LOG._replace(name=_("no log is open: J opens one")), id="replay-bar")

    def replayed(self) -> ReplayJob | None:
        return self.job

    def points(self) -> tuple[Point, ...]:
        return () if self.job is None else super().points()

    def ground(self, frame: Frame | None) -> tuple[Worked, FieldPicture | None]:
        return (EMPTY_GROUND, None) if self.job is None else super().ground(frame)

    def history(self) -> LogHistory:
        """What is remembered of the frames that are played now."""
        frames = self.job.source.frames if self.job is not None else ()
        if self._history.frames is not frames:
            self._history = LogHistory(frames)
        return self._history

    def seen(self, now_s: float) -> tuple[Frame | None, float]:
        return (None, 0.0) if self.job is None else super().seen(now_s)

    def seen_view(self, frame: Frame | None, age_s: float) -> RunView:
        view = super().seen_view(frame, age_s)
        silent = view.status.silent if self.job is not None else _("no log is open: J opens one")
        return view._replace(status=view.status._replace(lead=_("REPLAY"), silent=silent))

    def show_numbers(self, view: RunView) -> None:
        super().show_numbers(view)
        if self.job is None:
            return
        source = self.job.source
        share = (source.at_s - source.start_s) / max(1e-9, source.end_s - source.start_s)
        busy = "" if self.computing is None else _("computing {percent} %, Esc cancels").format(
            percent=f"{100.0 * self._share:.0f}")
        self.query_one("#replay-bar", ReplayBar).show(ReplayView(
            self.job.name, source.playing and not source.at_end, f"{source.speed:g}x", duration(source.at_s),
            duration(source.end_s), round(share, 3), self.mode_words(), self.chosen != WhatIf(),
            len(self.job.findings), busy, self._alarm_shares))

    def mode_words(self) -> str:
        if self.chosen == WhatIf():
            return _("as recorded")
        other = (words.strategy_word(self.chosen.strategy), self.chosen.crop or "", self.chosen.machine or "")
        return _("what if: {other}").format(other=", ".join(part for part in other if part))

    async def on_replay_bar_cancel(self, event: ReplayBar.Cancel) -> None:
        await self.app.action_do("cancel_what_if")

    def on_replay_bar_seek(self, event: ReplayBar.Seek) -> None:
        if self.job is not None:
            source = self.job.source
            source.seek(source.start_s + event.share * (source.end_s - source.start_s))
            self.hurry()

    def perform(self, action: Action) -> None:
        super().perform(action)
        self.hurry()

    @property
    def played(self) -> ReplayJob:
        """For the actions, which are done only where a log is open."""
        assert self.job is not None
        return self.job

    def back_to_recorded(self) -> None:
        self.cancel()
        self.played.source.replace(self._recorded)
        self.chosen = WhatIf()
        self._note_alarms()

    def read_log(self, files: LogFiles, path: str) -> None:
        self.app.notice(_("reading the log"))
        self.opening = self.run_worker(lambda: files.open(path), group="open-log", thread=True, exclusive=True,
                                       exit_on_error=False)

    def _opened(self, event: Worker.StateChanged) -> None:
        if event.state is WorkerState.SUCCESS and event.worker.result is not None:
            self.cancel()
            self.open(event.worker.result)
        elif event.state is WorkerState.ERROR:
            self.app.notice(str(event.worker.error))

    def begin(self, choice: str | None) -> None:
        if choice is None or self.job is None or self.job.what_if is None:
            return
        field, _colon, value = choice.partition(":")
        self._wanted = self.chosen._replace(**{field: value})
        compute, wanted = self.job.what_if, self._wanted
        self.cancel()
        self._stop, self._share = Event(), 0.0
        stop = self._stop

        def tell(share: float) -> None:
            if not stop.is_set():
                self._share = share

        self.computing = self.run_worker(lambda: compute(wanted, stop.is_set, tell), group="what-if", thread=True,
                                         exit_on_error=False)
        self.hurry()

    def cancel(self) -> None:
        """The thread ends at its next row; its result is no longer looked at."""
        self._stop.set()
        if self.computing is not None:
            self.computing.cancel()
            self.computing = None
            self.hurry()

    def on_worker_state_changed(self, event: Worker.StateChanged) -> None:
        if event.worker is self.opening:
            self._opened(event)
            return
        if event.worker is not self.computing or self.job is None:
            return
        if event.state is WorkerState.SUCCESS:
            self.computing = None
            try:
                self.job.source.replace(event.worker.result or ())
            except ValueError as error:
                self.app.notice(str(error))
                return
            self.chosen = self._wanted
            self._note_alarms()
            self.hurry()
        elif event.state is WorkerState.ERROR:
            self.computing = None
            self.app.notice(str(event.worker.error))
            self.hurry()
