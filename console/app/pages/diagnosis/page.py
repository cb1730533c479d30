"""The Diagnosis screen: choose data, watch, read the verdict, adopt it; plan and drive the run
that tells rivals apart. The work itself is done by a process that the service starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.widgets import Static
from textual.worker import Worker, WorkerState
from topdress.console.app.action import DIAGNOSIS, Action, make_bindings
from topdress.console.app.dialogs import TextDialog
from topdress.console.app.pages.diagnosis import shown, words
from topdress.console.app.pages.diagnosis.causes import CauseList, CausesView
from topdress.console.app.pages.diagnosis.channel_table import ChannelsView, ChannelTable
from topdress.console.app.pages.diagnosis.keys import ACTIONS, diagnose_chosen
from topdress.console.app.pages.diagnosis.residual_plot import ResidualPlot
from topdress.console.app.pages.diagnosis.run_plan import PlanView, RunPlanPanel
from topdress.console.app.pages.diagnosis.service import (
    IMPORT_KIND,
    ComparedShown,
    DiagnosisService,
    DiagnosisSource,
    DiagnosisView,
    ImportNeedsAnswersError,
    StopSignal,
    TellProgress,
    WorkStopped,
)
from topdress.console.app.pages.diagnosis.verdict import VerdictPanel
from topdress.console.app.pages.diagnosis.words import KIND_NAMES
from topdress.console.app.pages.page import Page
from topdress.console.app.view import RunView, format_duration
from topdress.console.app.widgets.chips import Chip, Chips
from topdress.console.app.widgets.panel import (
    Panel,
    Picked,
    PickList,
    align_right,
    fit_width,
    make_line,
    make_solid_parts,
)
from topdress.console.frame import Frame
from topdress.console.locale import _, find_language_code

# Data to diagnose, newest first: a row a file. A click chooses, a second one on the same row
# begins.
HEADING_ROWS = 2


class SourcesView(NamedTuple):
    """Holds the data to choose from."""

    sources: tuple[DiagnosisSource, ...]
    at: int
    looking: bool  # True while the folders are read
    language: str


def find_first_row(at: int, count: int, room: int) -> int:
    """First file shown so that the chosen one is in sight."""
    return max(0, min(at - room // 2, count - room))


class SourceList(PickList[SourcesView]):
    """Shows the data to choose from."""

    def draw_rows(self, view: SourcesView, width: int, height: int) -> list[Content]:
        rows = [
            make_line((fit_width(f" {_('Which data is to be checked?')}", width), "bold $primary"))
        ]
        if not view.sources:
            said = (
                _("reading the folders")
                if view.looking
                else _("no log or table here; / types a path")
            )
            return [*rows, make_line((f" {said}", "$muted"))]
        rows.append(
            make_line(
                (self._format_row(_("changed"), _("kind"), _("size"), _("file"), width), "$muted")
            )
        )
        room = max(1, height - HEADING_ROWS)
        first = find_first_row(view.at, len(view.sources), room)
        for index, source in enumerate(view.sources[first : first + room], first):
            mark = f"  < {_('now')}" if source.working else ""
            text = self._format_row(
                source.changed,
                _(KIND_NAMES.get(source.kind, source.kind)),
                source.size,
                source.name + mark,
                width,
                ">" if index == view.at else " ",
            )
            rows.append(make_line((text, "bold $on-select on $select" if index == view.at else "")))
        return rows

    @staticmethod
    def _format_row(
        changed: str, kind: str, size: str, name: str, width: int, mark: str = " "
    ) -> str:
        return fit_width(
            f"{mark}{fit_width(changed, 17)} {fit_width(kind, 13)} {align_right(size, 9)}  {name}",
            width,
        )

    def list_row_items(self) -> Sequence[int | None]:
        count, room = len(self.view.sources), max(1, self.content_size.height - HEADING_ROWS)
        first = find_first_row(self.view.at, count, room)
        return [*[None] * HEADING_ROWS, *range(first, min(first + room, count))]


# How far long work is: stage, bar, share, time left, how to cancel it.
class WorkView(NamedTuple):
    """Holds the progress. percent, left_s: rounded to what is shown; left_s None where it takes
    longer than estimated."""

    title: str
    stage: str
    percent: int
    left_s: int | None


class WorkBar(Panel[WorkView | None]):
    """Shows three rows; nothing where the view is None."""

    def draw_rows(self, view: WorkView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        left = (
            f"   {_('longer than expected')}"
            if view.left_s is None
            else (f"   {_('about {time} left').format(time=format_duration(view.left_s))}")
        )
        room = max(10, min(60, width - 12))
        full = round(room * view.percent / 100)
        return [
            make_line((fit_width(f" {view.title}", width), "bold $primary")),
            make_line(
                " ",
                *make_solid_parts("█" * full, "$target"),
                *make_solid_parts("░" * (room - full), "$muted"),
                (f" {view.percent:3d} %", "bold"),
            ),
            make_line((fit_width(f" {view.stage}{left}   {_('Esc cancels')}", width), "")),
        ]


# How far long work is and how long it still takes: by how much there is to read at first, by
# its own pace later.
START_DURATION_S = 3.0  # imports and reading, whatever the size
DURATION_S_PER_MB = 0.6  # of a run log, on two cores
# of the bar, that time alone may fill: it must not stand at its end for minutes
MOST_SHARE_BY_TIME = 0.3
TRUSTED_SHARE = 0.2  # of the work, to tell its pace


def estimate_duration_s(megabytes: float) -> float:
    """Duration of a diagnosis, s, before anything is known of this computer's pace."""
    return START_DURATION_S + DURATION_S_PER_MB * megabytes


class WorkEstimate:
    """Estimates progress: the bar moves from the start and never back; the time left is reported
    from the start, and is never negative."""

    def __init__(self, whole_s: float) -> None:
        self._whole_s = max(1.0, whole_s)
        self._shown = 0.0

    def estimate_progress(self, gone_s: float, share: float) -> tuple[float, float | None]:
        """Share of the work to show, and seconds left; None: longer than estimated, and nobody
        knows how long.

        share: as the work itself reports it. Its own pace counts alone once `TRUSTED_SHARE` is
        done.
        """
        own_s = gone_s / share if share > 0.0 else self._whole_s
        trust = min(1.0, share / TRUSTED_SHARE)
        whole_s = (1.0 - trust) * self._whole_s + trust * own_s
        by_time = min(MOST_SHARE_BY_TIME, gone_s / max(whole_s, 1e-9))
        self._shown = max(self._shown, min(1.0, max(share, by_time)))
        left_s = whole_s - gone_s
        return self._shown, left_s if left_s > 0.0 else None


ViewName = Literal["causes", "channels", "over", "time", "run"]
# what was found or compared; nothing of what was installed
WorkResult = DiagnosisView | ComparedShown | None
LongWork = Callable[[TellProgress, StopSignal], WorkResult]
ListedData = tuple[tuple[DiagnosisSource, ...], tuple[str, ...], bool]


DIAGNOSE_ACTION = next(action for action in ACTIONS if action.do is diagnose_chosen)


class DiagnosisScreen(Page):
    """Shows data, work and diagnosis."""

    where: ClassVar[str] = DIAGNOSIS
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        self.add_class("diagnosis")
        self.sources: tuple[DiagnosisSource, ...] | None = None
        self.at = 0  # chosen file
        self.machine: str | None = None  # None: the one that the data names
        self.machines: tuple[str, ...] = ()
        self.adopted = ""  # the machine file that was written here last
        # the log's, then that of its separating run
        self.found: tuple[DiagnosisView, ...] = ()
        self.which = 0  # the one that is shown
        self.cause = 0
        self.see: ViewName = "causes"
        self.said = ""  # why the last thing did not go
        self.installed = True  # what computes a diagnosis
        self.stop: StopSignal | None = None  # of the work under way
        self._working: Worker[WorkResult] | None = None
        self._listing: Worker[ListedData] | None = None
        self._brings_in = False  # a new file will be there
        self._title = ""
        self._started_s = 0.0
        self._share, self._stage = 0.0, ""
        self._expected = WorkEstimate(0.0)
        # the log that was written when the files were listed
        self._listed_for = ""

    def compose_body(self) -> ComposeResult:
        with Vertical(id="diagnosis"):
            yield WorkBar(None, id="dia-work")
            yield Static("", id="dia-said", markup=False)
            yield SourceList(SourcesView((), 0, True, find_language_code()), id="dia-sources")
            yield VerdictPanel((), id="dia-verdict")
            with Horizontal(id="dia-found"):
                with Vertical(id="dia-left"):
                    yield CauseList(CausesView((), 0, (), find_language_code()), id="dia-causes")
                    yield ChannelTable(
                        ChannelsView((), (), (), find_language_code()), id="dia-channels"
                    )
                    yield RunPlanPanel(PlanView("", (), "", find_language_code()), id="dia-run")
                with Vertical(id="dia-right"):
                    yield ResidualPlot(None, id="dia-over")
                    yield ResidualPlot(None, id="dia-time")
            yield Chips((), id="dia-chips")

    @property
    def service(self) -> DiagnosisService | None:
        """The service, if there is one."""
        return self.app.services.diagnosis

    @property
    def served(self) -> DiagnosisService:
        """The service, for actions that need one."""
        assert self.service is not None
        return self.service

    @property
    def shown(self) -> DiagnosisView | None:
        """The diagnosis that is shown."""
        return self.found[self.which] if self.found else None

    @property
    def is_busy(self) -> bool:
        """Whether long work goes on."""
        return self._working is not None

    def gather_frame(self, frame: Frame) -> None:
        """List anew when another log is written: another job, whose files belong into the list."""
        if self.sources is not None and frame.log_path != self._listed_for:
            self.sources = None

    # --- showing
    # ----------------------------------------------------------------------------------------------

    def show_numbers(self, view: RunView) -> None:
        """Show list, progress or diagnosis."""
        super().show_numbers(view)
        if self.sources is None and self._listing is None:
            self._list_data()
        found = self.shown
        self.set_class(found is None, "-picking")
        self.set_class(len(self.found) > 1, "-two")
        for name in ("causes", "channels", "over", "time", "run"):
            self.set_class(self.see == name, f"-see-{name}")
        said = self.query_one("#dia-said", Static)
        text = self.said
        if not (text or self.installed or self.is_busy):
            text = _("The diagnosis is not installed here (210 MB): Q8 installs it.")
        said.display = bool(text)
        if str(said.content) != f" ! {text}":
            said.update(f" ! {text}")
        work = self.query_one("#dia-work", WorkBar)
        work.display = self.is_busy
        if self.is_busy:
            share, left_s = self._expected.estimate_progress(
                self.app.clock() - self._started_s, self._share
            )
            work.show_view(
                WorkView(
                    self._title,
                    _(words.STAGE_NAMES.get(self._stage, self._stage)),
                    int(100 * share),
                    None if left_s is None else max(1, round(left_s)),
                )
            )
        self.query_one("#dia-sources", SourceList).show_view(
            SourcesView(
                self.sources or (),
                self.at,
                self.sources is None and self.service is not None,
                find_language_code(),
            )
        )
        self.query_one("#dia-chips", Chips).show_view(self._list_chips())
        if found is not None:
            self.query_one("#dia-verdict", VerdictPanel).show_view(
                tuple(
                    shown.make_verdict(
                        one,
                        ""
                        if len(self.found) == 1
                        else _("log")
                        if not index
                        else _("separating run"),
                    )
                    for index, one in enumerate(self.found)
                )
            )
            self.query_one("#dia-causes", CauseList).show_view(
                shown.make_causes_view(found, self.cause, self.app.units)
            )
            self.query_one("#dia-channels", ChannelTable).show_view(shown.make_channels_view(found))
            self.query_one("#dia-run", RunPlanPanel).show_view(shown.make_plan_view(found))

    def show_due(self, now_s: float) -> None:
        super().show_due(now_s)
        found = self.shown
        if found is not None and self.plots.is_due(now_s):
            self.query_one("#dia-over", ResidualPlot).show_view(
                shown.make_variable_plot(found, self.cause)
            )
            self.query_one("#dia-time", ResidualPlot).show_view(
                shown.make_time_plot(found, self.cause)
            )

    def list_views(self) -> tuple[ViewName, ...]:
        """The views that one key goes through at this size; the others are shown with it."""
        found = self.shown
        run: tuple[ViewName, ...] = (
            ("run",) if found is not None and found.found.next_run is not None else ()
        )
        if self.has_class("-wide") and self.has_class("-tall"):
            return ("causes", *run)
        if self.has_class("-wide"):
            return ("causes", "channels", *run)
        return ("causes", "channels", "over", "time", *run)

    def _list_chips(self) -> tuple[Chip, ...]:
        found = self.shown
        if self.is_busy:
            return ()
        if found is None:
            against = Path(self.machine).stem if self.machine is not None else _("as the log says")
            wanted = [
                *([] if self.installed else [("dia_install", "", True, True)]),
                ("dia_begin", "", bool(self.sources) and self.installed, self.installed),
                ("dia_path", "", True, False),
                ("dia_machine", f"{_('against')}: {against}", True, False),
                ("dia_pick", _("read anew"), True, False),
            ]
        else:
            run = bool(found.drives)
            views = self.list_views()
            at = views.index(self.see) + 1 if self.see in views else 1
            wanted = [
                ("dia_view", f"{_('next view')} {at}/{len(views)}", len(views) > 1, False),
                ("dia_adopt", "", bool(found.adoptable), found.found.verdict == "named"),
                *([("dia_compare", "", True, True)] if self.adopted else []),
                ("dia_back", "", bool(self.adopted), False),
                ("dia_report", "", True, False),
                ("dia_data", "", True, False),
            ]
            if found.found.next_run is not None:
                wanted += [
                    ("dia_run_file", "", run, False),
                    ("dia_drive", "", run, found.found.verdict == "ambiguous"),
                ]
            if len(self.found) > 1:
                wanted.append(("dia_other", "", True, False))
            wanted.append(("dia_pick", "", True, False))
        known = {action.id: action for action in self.app.list_offered_actions(DIAGNOSIS)}
        return tuple(
            Chip(name, known[name].shown, label or _(known[name].label), on, lead)
            for name, label, on, lead in wanted
        )

    # --- what is done
    # ----------------------------------------------------------------------------------------------

    def perform_action(self, action: Action) -> None:
        if self.service is None:
            self.app.show_notice(_("diagnosis is not available here"))
            return
        if self.is_busy:
            self.app.show_notice(_("at work: Esc cancels"))
            return
        super().perform_action(action)
        self.show_changes()

    def show_changes(self) -> None:
        """Show at once what has changed."""
        self.refresh_all_next_tick()
        self.app.show_newest()

    def move_mark(self, by: int) -> None:
        """Move the mark in list or causes."""
        if self.shown is None:
            self.at = max(0, min(len(self.sources or ()) - 1, self.at + by))
        else:
            self.cause = max(0, min(len(self.shown.found.causes) - 1, self.cause + by))

    def show_data_list(self) -> None:
        """Show the list of data again."""
        self.found, self.which, self.cause, self.said = (), 0, 0, ""

    def write_file(self, what: str, write: Callable[[], str], machine: bool = False) -> None:
        """Write a file; the path stays on the screen until it is read. machine: then it is asked
        whether the job takes the file."""

        def show_written(path: str) -> None:
            def ask_to_use(_answer: bool | None) -> None:
                if machine and self.app.services.job is not None:
                    self.app.job_page.ask_to_use_machine(path)

            self.said = ""
            text = path
            if machine:
                self.adopted = path
                text = "\n".join(
                    (
                        path,
                        _("Del on the Diagnosis page takes the last change of it back."),
                        _("Q4 there says, on another log, whether it predicts better than before."),
                    )
                )
            self.app.push_screen(
                TextDialog(_("{what} is written").format(what=what), text), ask_to_use
            )
            self.show_changes()

        def show_failure(why: str) -> None:
            self.said = why
            self.show_changes()

        self.app.run_with_files(write, show_written, show_failure)

    # --- long work
    # ----------------------------------------------------------------------------------------------

    def _list_data(self) -> None:
        service = self.service
        if service is None:
            return
        frame = self.app.arrival.frame
        running = frame.log_path if frame is not None else ""
        self._listed_for = running
        self._listing = self.run_worker(
            lambda: (
                service.list_sources(running),
                service.list_machines(),
                service.is_installed(),
            ),
            group="list",
            thread=True,
            exit_on_error=False,
        )

    def diagnose_source(self, source: DiagnosisSource) -> None:
        """Diagnose a log or table."""
        assert self.service is not None
        self.show_data_list()
        self._brings_in = source.kind == IMPORT_KIND
        self.begin_work(
            _("Diagnosis of {name}").format(name=source.name),
            partial(self.service.run_diagnosis, source, self.machine),
            estimate_duration_s(source.bytes / 1e6),
        )

    def begin_work(self, title: str, work: LongWork, takes_s: float) -> None:
        """Begin long work. takes_s: its estimated duration, s."""
        self._expected = WorkEstimate(takes_s)
        self._title, self._started_s, self.said = title, self.app.clock(), ""
        self._share, self._stage = 0.0, "reading"
        stop = self.stop = StopSignal()
        self._working = self.run_worker(
            lambda: work(self._note_progress, stop), group="work", thread=True, exit_on_error=False
        )
        self.show_changes()

    def _note_progress(self, share: float, stage: str) -> None:
        """Called by the working thread: only remembers."""
        self._share, self._stage = min(1.0, max(0.0, share)), stage

    def key_escape(self) -> None:
        """Cancel the work, or go back to the list."""
        if self.is_busy:
            self.cancel_work()
            self.said = _("cancelled")
        elif self.shown is not None:
            self.show_data_list()
        self.show_changes()

    def cancel_work(self) -> None:
        """End the work at once; its result is dropped."""
        if self.stop is not None:
            self.stop.set()
        self._working = self.stop = None

    def on_unmount(self) -> None:
        """Cancel the work."""
        self.cancel_work()

    def on_worker_state_changed(self, event: Worker.StateChanged) -> None:
        """Take results of workers."""
        if event.worker is self._listing:
            self._take_listed(event.worker, event.state)
        elif event.worker is self._working:
            self._take_result(event.worker, event.state)

    def _take_listed(
        self,
        worker: Worker[ListedData],
        state: WorkerState,
    ) -> None:
        if state is WorkerState.SUCCESS and worker.result is not None:
            self.sources, self.machines, self.installed = worker.result
            self.at = min(self.at, max(0, len(self.sources) - 1))
        elif state is WorkerState.ERROR:
            self.sources, self.said = (), str(worker.error)
        if state in (WorkerState.SUCCESS, WorkerState.ERROR):
            self._listing = None
            self.show_changes()

    def _take_result(self, worker: Worker[WorkResult], state: WorkerState) -> None:
        if state is WorkerState.SUCCESS and isinstance(worker.result, ComparedShown):
            where = (
                [_("Pictures: {path}").format(path=worker.result.report)]
                if worker.result.report
                else []
            )
            self.app.push_screen(
                TextDialog(
                    _("Before and after, on a log that it was not made from"),
                    "\n".join([*words.list_compared_lines(worker.result), *where]),
                )
            )
        elif state is WorkerState.SUCCESS and isinstance(worker.result, DiagnosisView):
            drove = bool(self.found) and bool(worker.result.planted)
            self.found = (*self.found[:1], worker.result) if drove else (worker.result,)
            self.which, self.cause, self.see = len(self.found) - 1, 0, "causes"
        elif state is WorkerState.SUCCESS:
            self.installed = True
        elif state is WorkerState.ERROR and isinstance(worker.error, ImportNeedsAnswersError):
            self.show_open_questions(worker.error)
        elif state is WorkerState.ERROR and not isinstance(worker.error, WorkStopped):
            self.said = (str(worker.error).splitlines() or [type(worker.error).__name__])[0]
        if state is WorkerState.CANCELLED:  # the app ends: its process must not outlive it
            self.cancel_work()
        elif state in (WorkerState.SUCCESS, WorkerState.ERROR):
            self._working = self.stop = None
            if self._brings_in:
                self.sources, self._brings_in = None, False
            self.show_changes()

    def show_open_questions(self, open_: ImportNeedsAnswersError) -> None:
        """Show the open questions about a file of another machine, and where they can be
        answered."""
        self.said = _("not brought in: the import file has open questions")
        how = _(
            "Put these lines right in the import file, or take away the comments that say "
            "unsure; then choose it "
            "or the file again. It is written here:"
        )
        lines = [*open_.questions, "", how, open_.import_file]
        self.app.push_screen(TextDialog(_("What the file does not say"), "\n".join(lines)))

    # --- mouse
    # ----------------------------------------------------------------------------------------------

    def on_picked(self, event: Picked) -> None:
        """Mark a cause of the diagnosis; before, a file: the second click on it begins."""
        if self.shown is not None:
            self.cause = event.index
            self.show_changes()
            return
        again = event.index == self.at
        self.at = event.index
        if again and not self.is_busy and not self.app.locked:
            self.perform_action(DIAGNOSE_ACTION)
        self.show_changes()
