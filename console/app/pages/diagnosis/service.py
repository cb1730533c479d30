"""What the Diagnosis page is given: data to choose from, what was found in it, and who finds it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Literal, NamedTuple, Protocol

from topdress.control.diagnosis.result import Diagnosis

# share of the work done, 0 to 1; the stage, a word
TellProgress = Callable[[float, str], None]
ExportKind = Literal["report", "data"]

# kind of a file that is brought in first, or of how one is
IMPORT_KIND = "import"


class DiagnosisSource(NamedTuple):
    """Describes a file that can be diagnosed. kind: run, that of a bench table, or IMPORT_KIND."""

    path: str
    name: str
    kind: str
    changed: str  # local date and time, to the minute
    size: str  # "12.3 MB"
    working: bool = False  # the log that the control worker writes now
    bytes: int = 0


class ResidualCurve(NamedTuple):
    """Holds means of a residual over bins of one variable (by its id), before and after the causes
    are in the model.

    before, after, half: in `unit`, as long as `at`; half: of the 90 % interval of `after`. names:
    of the places 0, 1, ... where the variable is no scale. onset: place on the axis where a cause
    began.
    """

    channel: str
    unit: str
    variable: str
    at: tuple[float, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    half: tuple[float, ...]
    names: tuple[str, ...] = ()
    onset: float | None = None


class AdoptionOffer(NamedTuple):
    """Describes a machine file that is made already, in the folder of `DiagnosisView`. ids: the
    choice; file: "" where nothing can be adopted; changes: before and after, a line each; refused:
    why a chosen cause is not in it, a line each."""

    ids: tuple[str, ...]
    file: str
    changes: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()


class CauseCurves(NamedTuple):
    """Holds curves of one cause: over its telling variable, and over the log; None where nothing
    can be drawn."""

    over: ResidualCurve | None = None
    time: ResidualCurve | None = None


class DiagnosisView(NamedTuple):
    """Holds a diagnosis, and what the page shows along with it.

    folder: where report, data and the extended machine lie until they are exported or adopted.
    """

    source: str  # file name
    found: Diagnosis  # the causes that are only suspected come last
    drawn: tuple[CauseCurves, ...]  # one for each cause
    # error of a channel with the causes in the model, where it was computed
    after: dict[str, float]
    adoptable: tuple[str, ...]  # ids, those that are not decided among them
    refused: tuple[str, ...]  # why the others are not adopted, a line each
    # the next run as the simulated machine can drive it; "" where it cannot
    drives: str = ""
    left_curve: ResidualCurve | None = None
    mean_target_kg_ha: float | None = None
    folder: str = ""
    # of a simulated separating run: what its machine had
    planted: tuple[str, ...] = ()
    # machine files, one for each choice that the operator can come to
    offers: tuple[AdoptionOffer, ...] = ()

    @property
    def minutes(self) -> float:
        """Duration of the next run, min; 0 where it is none of the program's list."""
        return (self.found.next_run.minutes or 0.0) if self.found.next_run is not None else 0.0


class Adoption(NamedTuple):
    """Holds the operator's choice: all sure causes, and others by name. why: in their own words,
    kept in the machine file; empty where nothing had to be chosen."""

    ids: tuple[str, ...]
    why: str = ""


class ComparedRow(NamedTuple):
    """Holds the error (r.m.s.) of one channel before and after; low, high: 90 % interval of before
    less after, if known."""

    channel: str
    unit: str
    old: float
    new: float
    low: float | None
    high: float | None


class ComparedShown(NamedTuple):
    """Holds the comparison of a machine file before and after a change on one log. report: path of
    the page with pictures, empty where none could be drawn."""

    rows: tuple[ComparedRow, ...]
    report: str = ""


class StopSignal:
    """Cancels work in another thread: the function of `call_on_stop` is called at once when it is
    set, or was."""

    def __init__(self) -> None:
        self._set = threading.Event()
        self._then: Callable[[], None] | None = None

    def set(self) -> None:
        """Stop the work."""
        self._set.set()
        if self._then is not None:
            self._then()

    def is_set(self) -> bool:
        """Whether the work is to stop."""
        return self._set.is_set()

    def call_on_stop(self, end: Callable[[], None]) -> None:
        """Call a function on the stop."""
        self._then = end
        if self.is_set():
            end()


class WorkStopped(Exception):
    """The work was cancelled."""


class ImportNeedsAnswersError(ValueError):
    """A file cannot be imported before these lines are answered in the import file."""

    def __init__(self, questions: tuple[str, ...], import_file: str) -> None:
        super().__init__(questions[0] if questions else import_file)
        self.questions, self.import_file = questions, import_file


class DiagnosisService(Protocol):
    """Does files and long work of the page.

    Errors are one-line ValueErrors; long work raises WorkStopped where it is cancelled. Everything
    here blocks: the page calls it in a thread.
    """

    def list_sources(self, running_log: str) -> tuple[DiagnosisSource, ...]:
        """Data to choose from, newest first. running_log: path that the control worker writes, or
        empty."""

    def find_source(self, path: str) -> DiagnosisSource:
        """Find a file by its typed path."""

    def is_installed(self) -> bool:
        """Whether the package that computes a diagnosis is installed."""

    def install_extra(self, tell: TellProgress, stop: StopSignal) -> None:
        """Install it next to topdress, by the tool that installed topdress."""

    def list_machines(self) -> tuple[str, ...]:
        """Machine files for the comparison, along with the one that the log names."""

    def run_diagnosis(
        self, source: DiagnosisSource, machine: str | None, tell: TellProgress, stop: StopSignal
    ) -> DiagnosisView:
        """Diagnose data. machine None: the one that the log names, else the configured one.

        A file of kind IMPORT_KIND is imported first: as a new log of the user's own folder;
        OpenQuestions where not sure.
        """

    def adopt_effects(self, found: DiagnosisView, chosen: Adoption) -> str:
        """Write the new machine file; its path."""

    def describe_last_change(self, machine: str | None) -> tuple[str, ...]:
        """The last change of a machine file by a diagnosis, before and after, a line each; () where
        there is none."""

    def undo_last_change(self, machine: str | None) -> str:
        """Write a new machine file without the last change; its path."""

    def export_result(self, found: DiagnosisView, what: ExportKind) -> str:
        """Write the report or the data next to the log; the path."""

    def write_separating_job(self, found: DiagnosisView) -> str:
        """Write the separating run as a job file; its path."""

    def drive_separating_run(
        self, found: DiagnosisView, tell: TellProgress, stop: StopSignal
    ) -> DiagnosisView:
        """Drive the separating run on the simulated machine and diagnose its log."""

    def compare_machines(
        self, machine: str, source: DiagnosisSource, tell: TellProgress, stop: StopSignal
    ) -> ComparedShown:
        """Compare a machine file before and after its last change, on a log that it was not made
        from."""
