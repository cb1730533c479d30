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
from topdress.console.app.pages.diagnosis.causes import Causes, CausesView
from topdress.console.app.pages.diagnosis.channel_table import ChannelsView, ChannelTable
from topdress.console.app.pages.diagnosis.keys import ACTIONS, diagnose
from topdress.console.app.pages.diagnosis.residual_plot import ResidualPlot
from topdress.console.app.pages.diagnosis.run_plan import PlanView, RunPlanPanel
from topdress.console.app.pages.diagnosis.service import (
    IMPORT,
    ComparedShown,
    DiagnosisService,
    DiagnosisSource,
    DiagnosisView,
    OpenQuestions,
    Stop,
    Tell,
    WorkStopped,
)
from topdress.console.app.pages.diagnosis.verdict import VerdictPanel
from topdress.console.app.pages.diagnosis.words import KINDS
from topdress.console.app.pages.page import Page
from topdress.console.app.view import RunView, duration
from topdress.console.app.widgets.chips import Chip, Chips
from topdress.console.app.widgets.panel import Panel, Picked, PickList, fit, line, right, solid
from topdress.console.frame import Frame
from topdress.console.locale import _, find_language_code

# Data to diagnose, newest first: a row a file. A click chooses, a second one on the same row
# begins.
HEAD_ROWS = 2


class SourcesView(NamedTuple):
    sources: tuple[DiagnosisSource, ...]
    at: int
    looking: bool  # True while the folders are read
    language: str


def first_row(at: int, count: int, room: int) -> int:
    """First file shown so that the chosen one is in sight."""
    return max(0, min(at - room // 2, count - room))


class SourceList(PickList[SourcesView]):
    def lines(self, view: SourcesView, width: int, height: int) -> list[Content]:
        rows = [line((fit(f" {_('Which data is to be checked?')}", width), "bold $primary"))]
        if not view.sources:
            said = (
                _("reading the folders")
                if view.looking
                else _("no log or table here; / types a path")
            )
            return [*rows, line((f" {said}", "$muted"))]
        rows.append(
            line((self._row(_("changed"), _("kind"), _("size"), _("file"), width), "$muted"))
        )
        room = max(1, height - HEAD_ROWS)
        first = first_row(view.at, len(view.sources), room)
        for index, source in enumerate(view.sources[first : first + room], first):
            mark = f"  < {_('now')}" if source.working else ""
            text = self._row(
                source.changed,
                _(KINDS.get(source.kind, source.kind)),
                source.size,
                source.name + mark,
                width,
                ">" if index == view.at else " ",
            )
            rows.append(line((text, "bold $on-select on $select" if index == view.at else "")))
        return rows

    @staticmethod
    def _row(changed: str, kind: str, size: str, name: str, width: int, mark: str = " ") -> str:
        return fit(f"{mark}{fit(changed, 17)} {fit(kind, 13)} {right(size, 9)}  {name}", width)

    def things(self) -> Sequence[int | None]:
        count, room = len(self.view.sources), max(1, self.content_size.height - HEAD_ROWS)
        first = first_row(self.view.at, count, room)
        return [*[None] * HEAD_ROWS, *range(first, min(first + room, count))]


# How far long work is: stage, bar, share, time left, how to cancel it.
class WorkView(NamedTuple):
    """percent, left_s: rounded to what is shown; left_s None where it takes longer than was
    thought."""

    title: str
    stage: str
    percent: int
    left_s: int | None


class WorkBar(Panel[WorkView | None]):
    """Three rows; nothing where the view is None."""

    def lines(self, view: WorkView | None, width: int, height: int) -> list[Content]:
        if view is None:
            return []
        left = (
            f"   {_('longer than expected')}"
            if view.left_s is None
            else (f"   {_('about {time} left').format(time=duration(view.left_s))}")
        )
        room = max(10, min(60, width - 12))
        full = round(room * view.percent / 100)
        return [
            line((fit(f" {view.title}", width), "bold $primary")),
            line(
                " ",
                *solid("█" * full, "$target"),
                *solid("░" * (room - full), "$muted"),
                (f" {view.percent:3d} %", "bold"),
            ),
            line((fit(f" {view.stage}{left}   {_('Esc cancels')}", width), "")),
        ]


# How far long work is and how long it still takes: by how much there is to read at first, by
# its own pace later.
START_S = 3.0  # imports and reading, whatever the size
S_PER_MB = 0.6  # of a run log, on two cores
# of the bar, that time alone may fill: it must not stand at its end for minutes
MOST_BY_TIME = 0.3
ENOUGH = 0.2  # of the work, to tell its pace


def estimate_duration_s(megabytes: float) -> float:
    """Before anything is known of this computer's pace."""
    return START_S + S_PER_MB * megabytes


class Expected:
    """The bar moves from the start and never back; the time left is reported from the start,
    and never less than none."""

    def __init__(self, whole_s: float) -> None:
        self._whole_s = max(1.0, whole_s)
        self._shown = 0.0

    def at(self, gone_s: float, share: float) -> tuple[float, float | None]:
        """Share of the work to show, and seconds left; None: longer than was thought, and
        nobody knows how long.

        share: as the work itself tells it. Its own pace counts alone once `ENOUGH` is done.
        """
        own_s = gone_s / share if share > 0.0 else self._whole_s
        trust = min(1.0, share / ENOUGH)
        whole_s = (1.0 - trust) * self._whole_s + trust * own_s
        by_time = min(MOST_BY_TIME, gone_s / max(whole_s, 1e-9))
        self._shown = max(self._shown, min(1.0, max(share, by_time)))
        left_s = whole_s - gone_s
        return self._shown, left_s if left_s > 0.0 else None


View = Literal["causes", "channels", "over", "time", "run"]
# what was found or compared; nothing of what was installed
Done = DiagnosisView | ComparedShown | None
Work = Callable[[Tell, Stop], Done]
Listed = tuple[tuple[DiagnosisSource, ...], tuple[str, ...], bool]


BEGIN = next(action for action in ACTIONS if action.do is diagnose)


class DiagnosisScreen(Page):
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
        self.see: View = "causes"
        self.said = ""  # why the last thing did not go
        self.installed = True  # what computes a diagnosis
        self.stop: Stop | None = None  # of the work under way
        self._working: Worker[Done] | None = None
        self._listing: Worker[Listed] | None = None
        self._brings_in = False  # a new file will be there
        self._title = ""
        self._started_s = 0.0
        self._share, self._stage = 0.0, ""
        self._expected = Expected(0.0)
        # the log that was written when the files were listed
        self._listed_for = ""

    def body(self) -> ComposeResult:
        with Vertical(id="diagnosis"):
            yield WorkBar(None, id="dia-work")
            yield Static("", id="dia-said", markup=False)
            yield SourceList(SourcesView((), 0, True, find_language_code()), id="dia-sources")
            yield VerdictPanel((), id="dia-verdict")
            with Horizontal(id="dia-found"):
                with Vertical(id="dia-left"):
                    yield Causes(CausesView((), 0, (), find_language_code()), id="dia-causes")
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
        return self.app.services.diagnosis

    @property
    def served(self) -> DiagnosisService:
        """For the actions, which are done only where there is one."""
        assert self.service is not None
        return self.service

    @property
    def shown(self) -> DiagnosisView | None:
        return self.found[self.which] if self.found else None

    @property
    def busy(self) -> bool:
        return self._working is not None

    def gather(self, frame: Frame) -> None:
        """Another log is written: another job, whose files belong into the list."""
        if self.sources is not None and frame.log_path != self._listed_for:
            self.sources = None

    # --- showing
    # ----------------------------------------------------------------------------------------------

    def show_numbers(self, view: RunView) -> None:
        super().show_numbers(view)
        if self.sources is None and self._listing is None:
            self._list()
        found = self.shown
        self.set_class(found is None, "-picking")
        self.set_class(len(self.found) > 1, "-two")
        for name in ("causes", "channels", "over", "time", "run"):
            self.set_class(self.see == name, f"-see-{name}")
        said = self.query_one("#dia-said", Static)
        text = self.said
        if not (text or self.installed or self.busy):
            text = _("The diagnosis is not installed here (210 MB): Q8 installs it.")
        said.display = bool(text)
        if str(said.content) != f" ! {text}":
            said.update(f" ! {text}")
        work = self.query_one("#dia-work", WorkBar)
        work.display = self.busy
        if self.busy:
            share, left_s = self._expected.at(self.app.clock() - self._started_s, self._share)
            work.show(
                WorkView(
                    self._title,
                    _(words.STAGES.get(self._stage, self._stage)),
                    int(100 * share),
                    None if left_s is None else max(1, round(left_s)),
                )
            )
        self.query_one("#dia-sources", SourceList).show(
            SourcesView(
                self.sources or (),
                self.at,
                self.sources is None and self.service is not None,
                find_language_code(),
            )
        )
        self.query_one("#dia-chips", Chips).show(self._chips())
        if found is not None:
            self.query_one("#dia-verdict", VerdictPanel).show(
                tuple(
                    shown.said(
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
            self.query_one("#dia-causes", Causes).show(
                shown.causes(found, self.cause, self.app.units)
            )
            self.query_one("#dia-channels", ChannelTable).show(shown.channels(found))
            self.query_one("#dia-run", RunPlanPanel).show(shown.plan(found))

    def tick(self, now_s: float) -> None:
        super().tick(now_s)
        found = self.shown
        if found is not None and self.plots.due(now_s):
            self.query_one("#dia-over", ResidualPlot).show(shown.over(found, self.cause))
            self.query_one("#dia-time", ResidualPlot).show(shown.time(found, self.cause))

    def views(self) -> tuple[View, ...]:
        """Those that one key goes through at this size; the others are shown with it."""
        found = self.shown
        run: tuple[View, ...] = (
            ("run",) if found is not None and found.found.next_run is not None else ()
        )
        if self.has_class("-wide") and self.has_class("-tall"):
            return ("causes", *run)
        if self.has_class("-wide"):
            return ("causes", "channels", *run)
        return ("causes", "channels", "over", "time", *run)

    def _chips(self) -> tuple[Chip, ...]:
        found = self.shown
        if self.busy:
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
            views = self.views()
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
        known = {action.id: action for action in self.app.offered(DIAGNOSIS)}
        return tuple(
            Chip(name, known[name].shown, label or _(known[name].label), on, lead)
            for name, label, on, lead in wanted
        )

    # --- what is done
    # ----------------------------------------------------------------------------------------------

    def perform(self, action: Action) -> None:
        if self.service is None:
            self.app.notice(_("diagnosis is not available here"))
            return
        if self.busy:
            self.app.notice(_("at work: Esc cancels"))
            return
        super().perform(action)
        self.look()

    def look(self) -> None:
        self.hurry()
        self.app.tick()

    def move(self, by: int) -> None:
        if self.shown is None:
            self.at = max(0, min(len(self.sources or ()) - 1, self.at + by))
        else:
            self.cause = max(0, min(len(self.shown.found.causes) - 1, self.cause + by))

    def back(self) -> None:
        self.found, self.which, self.cause, self.said = (), 0, 0, ""

    def write(self, what: str, write: Callable[[], str], machine: bool = False) -> None:
        """A file; the path stays on the screen until it is read. machine: then it is asked
        whether the job takes the file."""

        def written(path: str) -> None:
            def read(_answer: bool | None) -> None:
                if machine and self.app.services.job is not None:
                    self.app.job_page.ask_use(path)

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
            self.app.push_screen(TextDialog(_("{what} is written").format(what=what), text), read)
            self.look()

        def failed(why: str) -> None:
            self.said = why
            self.look()

        self.app.with_files(write, written, failed)

    # --- long work
    # ----------------------------------------------------------------------------------------------

    def _list(self) -> None:
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

    def diagnose(self, source: DiagnosisSource) -> None:
        assert self.service is not None
        self.back()
        self._brings_in = source.kind == IMPORT
        self.begin(
            _("Diagnosis of {name}").format(name=source.name),
            partial(self.service.run_diagnosis, source, self.machine),
            estimate_duration_s(source.bytes / 1e6),
        )

    def begin(self, title: str, work: Work, takes_s: float) -> None:
        """takes_s: as far as that is known beforehand."""
        self._expected = Expected(takes_s)
        self._title, self._started_s, self.said = title, self.app.clock(), ""
        self._share, self._stage = 0.0, "reading"
        stop = self.stop = Stop()
        self._working = self.run_worker(
            lambda: work(self._tell, stop), group="work", thread=True, exit_on_error=False
        )
        self.look()

    def _tell(self, share: float, stage: str) -> None:
        """Called by the working thread: only remembers."""
        self._share, self._stage = min(1.0, max(0.0, share)), stage

    def key_escape(self) -> None:
        if self.busy:
            self.cancel()
            self.said = _("cancelled")
        elif self.shown is not None:
            self.back()
        self.look()

    def cancel(self) -> None:
        """The work ends at once; what it might still say is not looked at."""
        if self.stop is not None:
            self.stop.set()
        self._working = self.stop = None

    def on_unmount(self) -> None:
        self.cancel()

    def on_worker_state_changed(self, event: Worker.StateChanged) -> None:
        if event.worker is self._listing:
            self._listed(event.worker, event.state)
        elif event.worker is self._working:
            self._worked(event.worker, event.state)

    def _listed(
        self,
        worker: Worker[Listed],
        state: WorkerState,
    ) -> None:
        if state is WorkerState.SUCCESS and worker.result is not None:
            self.sources, self.machines, self.installed = worker.result
            self.at = min(self.at, max(0, len(self.sources) - 1))
        elif state is WorkerState.ERROR:
            self.sources, self.said = (), str(worker.error)
        if state in (WorkerState.SUCCESS, WorkerState.ERROR):
            self._listing = None
            self.look()

    def _worked(self, worker: Worker[Done], state: WorkerState) -> None:
        if state is WorkerState.SUCCESS and isinstance(worker.result, ComparedShown):
            where = (
                [_("Pictures: {path}").format(path=worker.result.report)]
                if worker.result.report
                else []
            )
            self.app.push_screen(
                TextDialog(
                    _("Before and after, on a log that it was not made from"),
                    "\n".join([*words.compared(worker.result), *where]),
                )
            )
        elif state is WorkerState.SUCCESS and isinstance(worker.result, DiagnosisView):
            drove = bool(self.found) and bool(worker.result.planted)
            self.found = (*self.found[:1], worker.result) if drove else (worker.result,)
            self.which, self.cause, self.see = len(self.found) - 1, 0, "causes"
        elif state is WorkerState.SUCCESS:
            self.installed = True
        elif state is WorkerState.ERROR and isinstance(worker.error, OpenQuestions):
            self.ask(worker.error)
        elif state is WorkerState.ERROR and not isinstance(worker.error, WorkStopped):
            self.said = (str(worker.error).splitlines() or [type(worker.error).__name__])[0]
        if state is WorkerState.CANCELLED:  # the app ends: its process must not outlive it
            self.cancel()
        elif state in (WorkerState.SUCCESS, WorkerState.ERROR):
            self._working = self.stop = None
            if self._brings_in:
                self.sources, self._brings_in = None, False
            self.look()

    def ask(self, open_: OpenQuestions) -> None:
        """What is unsure about a file of another machine, and where it can be put right."""
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
        """A cause of what was found; before, a file: the second click on it begins."""
        if self.shown is not None:
            self.cause = event.index
            self.look()
            return
        again = event.index == self.at
        self.at = event.index
        if again and not self.busy and not self.app.locked:
            self.perform(BEGIN)
        self.look()
