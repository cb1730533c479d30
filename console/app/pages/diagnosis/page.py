"""Shows the Diagnosis screen: choose data, follow the work, read the verdict, adopt corrections,
plan and drive the separating run. A process of the service does the work itself.
"""

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
from topdress.console.app.pages.base_page import Page
from topdress.console.app.pages.diagnosis import diagnosis_words, panel_views
from topdress.console.app.pages.diagnosis.causes import CauseList, CausesView
from topdress.console.app.pages.diagnosis.channel_table import ChannelsView, ChannelTable
from topdress.console.app.pages.diagnosis.diagnosis_words import KIND_NAMES
from topdress.console.app.pages.diagnosis.keys import ACTIONS, diagnose_chosen
from topdress.console.app.pages.diagnosis.residual_plot import ResidualPlot
from topdress.console.app.pages.diagnosis.run_plan import PlanView, RunPlanPanel
from topdress.console.app.pages.diagnosis.service import (
    IMPORT_KIND,
    ComparisonView,
    DiagnosisService,
    DiagnosisSource,
    DiagnosisView,
    ImportNeedsAnswersError,
    StopSignal,
    TellProgress,
    WorkStopped,
)
from topdress.console.app.pages.diagnosis.verdict import VerdictPanel
from topdress.console.app.panel_views import RunView, format_duration
from topdress.console.app.widgets.action_chips import ActionChip, Chips
from topdress.console.app.widgets.base_panel import (
    Panel,
    Picked,
    PickList,
    align_text_right,
    fit_text_width,
    make_line,
    make_solid_parts,
)
from topdress.console.frame import Frame
from topdress.console.locale import _, find_language_code

# The list has one row per file, newest first. A click marks a file; a second click on the marked
# row starts the diagnosis.
LIST_HEADING_ROWS = 2


class SourcesView(NamedTuple):
    """Holds the data to choose from."""

    sources: tuple[DiagnosisSource, ...]
    at: int
    # True while the folders are being read.
    looking: bool
    language: str


def find_first_row(at: int, count: int, room: int) -> int:
    """Return the index of the first visible file such that the marked file is visible."""
    return max(0, min(at - room // 2, count - room))


class SourceList(PickList[SourcesView]):
    """Shows the data to choose from."""

    def draw_rows(self, view: SourcesView, width: int, height: int) -> list[Content]:
        rows = [
            make_line(
                (fit_text_width(f" {_('Which data is to be checked?')}", width), "bold $primary")
            )
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
        room = max(1, height - LIST_HEADING_ROWS)
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
        """Return a row of the list as text, in columns."""
        return fit_text_width(
            f"{mark}{fit_text_width(changed, 17)} {fit_text_width(kind, 13)} "
            f"{align_text_right(size, 9)}  {name}",
            width,
        )

    def list_row_items(self) -> Sequence[int | None]:
        count, room = len(self.view.sources), max(1, self.content_size.height - LIST_HEADING_ROWS)
        first = find_first_row(self.view.at, count, room)
        return [*[None] * LIST_HEADING_ROWS, *range(first, min(first + room, count))]


# The panel shows stage, bar, remaining time, and the key that cancels.
class WorkView(NamedTuple):
    """Holds the progress, rounded to the displayed digits. `left_s` is None once the work takes
    longer than estimated."""

    title: str
    stage: str
    percent: int
    left_s: int | None


class WorkBar(Panel[WorkView | None]):
    """Shows the progress in three rows; a view of None shows nothing."""

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
            make_line((fit_text_width(f" {view.title}", width), "bold $primary")),
            make_line(
                " ",
                *make_solid_parts("█" * full, "$target"),
                *make_solid_parts("░" * (room - full), "$muted"),
                (f" {view.percent:3d} %", "bold"),
            ),
            make_line((fit_text_width(f" {view.stage}{left}   {_('Esc cancels')}", width), "")),
        ]


# The first estimate of the duration comes from the size of the file; later the work's own pace
# determines the estimate.
# Duration of imports and reading at any size, s.
START_DURATION_S = 3.0
# Duration per MB of a run log on two cores, s.
DURATION_S_PER_MB = 0.6
# Share of the bar that elapsed time alone may fill: a full bar must not stand still for minutes.
MAX_SHARE_BY_TIME = 0.3
# Share of the work after which its own pace determines the estimate alone.
TRUSTED_WORK_SHARE = 0.2


def estimate_duration_s(megabytes: float) -> float:
    """Return the expected duration of a diagnosis, s, for this computer of unknown pace."""
    return START_DURATION_S + DURATION_S_PER_MB * megabytes


class WorkEstimate:
    """Estimates progress: the bar starts at once and never moves back, and the remaining time is
    never negative."""

    def __init__(self, whole_s: float) -> None:
        self._whole_s = max(1.0, whole_s)
        self._shown = 0.0

    def estimate_progress(self, gone_s: float, share: float) -> tuple[float, float | None]:
        """Return the share of the work to display, and the remaining time in s.

        Parameters
        ----------
        gone_s
            Time since the start, s.
        share
            Share of the work done, as the work reports it. Beyond `TRUSTED_WORK_SHARE` its own pace
            alone determines the estimate.

        Returns
        -------
        tuple
            The remaining time is None once the work takes longer than estimated.
        """
        own_s = gone_s / share if share > 0.0 else self._whole_s
        # The weight moves gradually from the estimate by size to the estimate by pace, so that the
        # remaining time does not jump.
        trust = min(1.0, share / TRUSTED_WORK_SHARE)
        whole_s = (1.0 - trust) * self._whole_s + trust * own_s
        by_time = min(MAX_SHARE_BY_TIME, gone_s / max(whole_s, 1e-9))
        self._shown = max(self._shown, min(1.0, max(share, by_time)))
        left_s = whole_s - gone_s
        return self._shown, left_s if left_s > 0.0 else None


ViewName = Literal["causes", "channels", "over", "time", "run"]
# Result of a diagnosis or a comparison; None after an installation.
WorkResult = DiagnosisView | ComparisonView | None
LongWork = Callable[[TellProgress, StopSignal], WorkResult]
ListedData = tuple[tuple[DiagnosisSource, ...], tuple[str, ...], bool]


DIAGNOSE_ACTION = next(action for action in ACTIONS if action.do is diagnose_chosen)


class DiagnosisScreen(Page):
    """Shows data, work in progress and diagnosis."""

    where: ClassVar[str] = DIAGNOSIS
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        self.add_class("diagnosis")
        self.sources: tuple[DiagnosisSource, ...] | None = None
        # Index of the marked file.
        self.at = 0
        # Machine file for the comparison; None means the file that the data names.
        self.machine: str | None = None
        self.machines: tuple[str, ...] = ()
        # Machine file that this page wrote last.
        self.adopted = ""
        # Diagnosis of the log, and after it that of its separating run.
        self.found: tuple[DiagnosisView, ...] = ()
        # Index of the displayed diagnosis.
        self.which = 0
        self.cause = 0
        self.visible_view: ViewName = "causes"
        # Reason why the last action failed.
        self.said = ""
        # True if the packages that compute a diagnosis are installed.
        self.installed = True
        # Signal that cancels the work in progress.
        self.stop: StopSignal | None = None
        self._working: Worker[WorkResult] | None = None
        self._listing: Worker[ListedData] | None = None
        # True while an import will add a file to the list.
        self._imports_file = False
        self._title = ""
        self._started_s = 0.0
        self._share, self._stage = 0.0, ""
        self._expected = WorkEstimate(0.0)
        # Log that the worker wrote when the files were listed.
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
        """Service of the page, or None."""
        return self.app.services.diagnosis

    @property
    def required_service(self) -> DiagnosisService:
        """Service, for actions that need one."""
        assert self.service is not None
        return self.service

    @property
    def shown(self) -> DiagnosisView | None:
        """Diagnosis that is displayed, or None."""
        return self.found[self.which] if self.found else None

    @property
    def is_busy(self) -> bool:
        """Whether long work is in progress."""
        return self._working is not None

    def gather_frame(self, frame: Frame) -> None:
        """List the data again when the worker writes another log, because the list must contain the
        new job's files."""
        if self.sources is not None and frame.log_path != self._listed_for:
            self.sources = None

    # The following methods show the page.

    def show_numbers(self, view: RunView) -> None:
        """Show list, progress or diagnosis."""
        super().show_numbers(view)
        if self.sources is None and self._listing is None:
            self._list_data()
        found = self.shown
        # Style classes show and hide the panels; the style sheet knows the sizes.
        self.set_class(found is None, "-picking")
        self.set_class(len(self.found) > 1, "-two")
        for name in ("causes", "channels", "over", "time", "run"):
            self.set_class(self.visible_view == name, f"-see-{name}")
        said = self.query_one("#dia-said", Static)
        text = self.said
        if not (text or self.installed or self.is_busy):
            text = _("The diagnosis is not installed here (210 MB): Q8 installs it.")
        said.display = bool(text)
        # An update would redraw the widget although nothing has changed.
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
                    _(diagnosis_words.STAGE_NAMES.get(self._stage, self._stage)),
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
                    panel_views.make_verdict(
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
                panel_views.make_causes_view(found, self.cause, self.app.units)
            )
            self.query_one("#dia-channels", ChannelTable).show_view(
                panel_views.make_channels_view(found)
            )
            self.query_one("#dia-run", RunPlanPanel).show_view(panel_views.make_plan_view(found))

    def show_due(self, now_s: float) -> None:
        super().show_due(now_s)
        found = self.shown
        if found is not None and self.plots.is_due(now_s):
            self.query_one("#dia-over", ResidualPlot).show_view(
                panel_views.make_variable_plot(found, self.cause)
            )
            self.query_one("#dia-time", ResidualPlot).show_view(
                panel_views.make_time_plot(found, self.cause)
            )

    def list_views(self) -> tuple[ViewName, ...]:
        """Return the views that one key cycles through at this screen size; the other panels are
        visible together with them."""
        found = self.shown
        run: tuple[ViewName, ...] = (
            ("run",) if found is not None and found.found.next_run is not None else ()
        )
        if self.has_class("-wide") and self.has_class("-tall"):
            return ("causes", *run)
        if self.has_class("-wide"):
            return ("causes", "channels", *run)
        return ("causes", "channels", "over", "time", *run)

    def _list_chips(self) -> tuple[ActionChip, ...]:
        """Return the keys, with those that can be pressed now."""
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
            at = views.index(self.visible_view) + 1 if self.visible_view in views else 1
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
            ActionChip(name, known[name].shown, label or _(known[name].label), on, lead)
            for name, label, on, lead in wanted
        )

    # The following methods react to keys.

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
        """Refresh every panel at once, after a change."""
        self.refresh_all_next_tick()
        self.app.show_newest()

    def move_mark(self, by: int) -> None:
        """Move the mark in the list of data or causes."""
        if self.shown is None:
            self.at = max(0, min(len(self.sources or ()) - 1, self.at + by))
        else:
            self.cause = max(0, min(len(self.shown.found.causes) - 1, self.cause + by))

    def show_data_list(self) -> None:
        """Show the list of data again."""
        self.found, self.which, self.cause, self.said = (), 0, 0, ""

    def write_file(self, what: str, write: Callable[[], str], machine: bool = False) -> None:
        """Write a file in a thread and show its path.

        Parameters
        ----------
        what
            Name of the file, for the heading.
        write
            Writes the file and returns its path.
        machine
            True for a machine file: the operator is asked whether the job uses it.
        """

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

    # The following methods run work in threads and take its results.

    def _list_data(self) -> None:
        """Start to list data and machine files, in a thread."""
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
        self._imports_file = source.kind == IMPORT_KIND
        self.begin_work(
            _("Diagnosis of {name}").format(name=source.name),
            partial(self.service.run_diagnosis, source, self.machine),
            estimate_duration_s(source.bytes / 1e6),
        )

    def begin_work(self, title: str, work: LongWork, takes_s: float) -> None:
        """Begin long work; `takes_s` is its estimated duration, s."""
        self._expected = WorkEstimate(takes_s)
        self._title, self._started_s, self.said = title, self.app.clock(), ""
        self._share, self._stage = 0.0, "reading"
        # Work that was cancelled keeps its own signal, so that new work is not cancelled with it.
        stop = self.stop = StopSignal()
        self._working = self.run_worker(
            lambda: work(self._note_progress, stop), group="work", thread=True, exit_on_error=False
        )
        self.show_changes()

    def _note_progress(self, share: float, stage: str) -> None:
        """Store the progress. The working thread calls this function, so it touches no widget."""
        self._share, self._stage = min(1.0, max(0.0, share)), stage

    def key_escape(self) -> None:
        """Cancel the work, or return to the list."""
        if self.is_busy:
            self.cancel_work()
            self.said = _("cancelled")
        elif self.shown is not None:
            self.show_data_list()
        self.show_changes()

    def cancel_work(self) -> None:
        """Stop the work at once and drop its result."""
        if self.stop is not None:
            self.stop.set()
        self._working = self.stop = None

    def on_unmount(self) -> None:
        """Cancel the work."""
        self.cancel_work()

    def on_worker_state_changed(self, event: Worker.StateChanged) -> None:
        """Process the results of Textual workers."""
        if event.worker is self._listing:
            self._take_listed_data(event.worker, event.state)
        elif event.worker is self._working:
            self._take_work_result(event.worker, event.state)

    def _take_listed_data(
        self,
        worker: Worker[ListedData],
        state: WorkerState,
    ) -> None:
        """Process the list of data, or the reason why the list failed."""
        if state is WorkerState.SUCCESS and worker.result is not None:
            self.sources, self.machines, self.installed = worker.result
            self.at = min(self.at, max(0, len(self.sources) - 1))
        elif state is WorkerState.ERROR:
            self.sources, self.said = (), str(worker.error)
        if state in (WorkerState.SUCCESS, WorkerState.ERROR):
            self._listing = None
            self.show_changes()

    def _take_work_result(self, worker: Worker[WorkResult], state: WorkerState) -> None:
        """Process the result of long work."""
        if state is WorkerState.SUCCESS and isinstance(worker.result, ComparisonView):
            where = (
                [_("Pictures: {path}").format(path=worker.result.report)]
                if worker.result.report
                else []
            )
            self.app.push_screen(
                TextDialog(
                    _("Before and after, on a log that it was not made from"),
                    "\n".join([*diagnosis_words.list_compared_lines(worker.result), *where]),
                )
            )
        elif state is WorkerState.SUCCESS and isinstance(worker.result, DiagnosisView):
            # A simulated run has planted effects; its diagnosis is shown next to that of the log.
            drove = bool(self.found) and bool(worker.result.planted)
            self.found = (*self.found[:1], worker.result) if drove else (worker.result,)
            self.which, self.cause, self.visible_view = len(self.found) - 1, 0, "causes"
        elif state is WorkerState.SUCCESS:
            self.installed = True
        # Open questions are no failure: they are shown with the path of the file that answers them.
        elif state is WorkerState.ERROR and isinstance(worker.error, ImportNeedsAnswersError):
            self.show_open_questions(worker.error)
        elif state is WorkerState.ERROR and not isinstance(worker.error, WorkStopped):
            self.said = (str(worker.error).splitlines() or [type(worker.error).__name__])[0]
        # The app is closing: its process must not outlive the app.
        if state is WorkerState.CANCELLED:
            self.cancel_work()
        elif state in (WorkerState.SUCCESS, WorkerState.ERROR):
            self._working = self.stop = None
            if self._imports_file:
                self.sources, self._imports_file = None, False
            self.show_changes()

    def show_open_questions(self, open_: ImportNeedsAnswersError) -> None:
        """Show the open questions about a file of another machine, and the file in which to answer
        them."""
        self.said = _("not brought in: the import file has open questions")
        how = _(
            "Put these lines right in the import file, or take away the comments that say "
            "unsure; then choose it "
            "or the file again. It is written here:"
        )
        lines = [*open_.questions, "", how, open_.import_file]
        self.app.push_screen(TextDialog(_("What the file does not say"), "\n".join(lines)))

    # The following methods react to the mouse.

    def on_picked(self, event: Picked) -> None:
        """Mark the clicked cause or file; a second click on a file starts its diagnosis."""
        if self.shown is not None:
            self.cause = event.index
            self.show_changes()
            return
        again = event.index == self.at
        self.at = event.index
        if again and not self.is_busy and not self.app.locked:
            self.perform_action(DIAGNOSE_ACTION)
        self.show_changes()
