"""Declares the data, results and functions that the Diagnosis page receives."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Literal, NamedTuple, Protocol

from topdress.control.diagnosis.result import Diagnosis

# Receives the share of work done, 0 to 1, and the stage as a word.
TellProgress = Callable[[float, str], None]
ExportKind = Literal["report", "data"]

# Kind of a file of another program, which is imported first.
IMPORT_KIND = "import"


class DiagnosisSource(NamedTuple):
    """Describes a file that can be diagnosed; `kind` is "run", the kind of a bench table, or
    IMPORT_KIND."""

    path: str
    name: str
    kind: str
    # Local date and time, to the minute.
    changed: str
    # Text such as "12.3 MB".
    size: str
    # True for the log that the control worker is writing.
    working: bool = False
    bytes: int = 0


class ResidualCurve(NamedTuple):
    """Holds means of a residual over bins of one variable, before and after the causes are in the
    model.

    Attributes
    ----------
    unit
        Unit of `before`, `after` and `half`.
    variable
        Id of the variable.
    at
        Centres of the bins.
    before, after
        Means; as long as `at`.
    half
        Half width of the 90 % interval of `after`.
    names
        Names of the categories 0, 1, ... where the variable is a category.
    onset
        Value of the variable at which a cause began.
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
    """Describes a prepared machine file in the folder of `DiagnosisView`.

    Attributes
    ----------
    ids
        Choice that the file adopts.
    file
        File name; "" where nothing can be adopted.
    changes
        Before and after, one line each.
    refused
        Reasons why a chosen cause is not in the file, one line each.
    """

    ids: tuple[str, ...]
    file: str
    changes: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()


class CauseCurves(NamedTuple):
    """Holds the curves of one cause: over its most informative variable and over time; None where
    nothing can be drawn."""

    over: ResidualCurve | None = None
    time: ResidualCurve | None = None


class DiagnosisView(NamedTuple):
    """Holds a diagnosis with the curves and offers that the page shows.

    `folder` contains report, data and the extended machine until they are exported or adopted.
    """

    # File name of the data.
    source: str
    # Diagnosis, whose suspected causes come last.
    found: Diagnosis
    # Curves of each cause, in the order of the causes.
    drawn: tuple[CauseCurves, ...]
    # Error of each channel with the causes in the model, where it was computed.
    after: dict[str, float]
    # Ids that can be adopted, including undecided causes.
    adoptable: tuple[str, ...]
    # Reasons why other causes are not adopted, one line each.
    refused: tuple[str, ...]
    # Next run as the simulated machine can drive it; "" where it cannot.
    drives: str = ""
    left_curve: ResidualCurve | None = None
    mean_target_kg_ha: float | None = None
    folder: str = ""
    # Effects that a simulated separating run put into its machine.
    planted: tuple[str, ...] = ()
    # Prepared machine files, one for each possible choice.
    offers: tuple[AdoptionOffer, ...] = ()

    @property
    def minutes(self) -> float:
        """Duration of the next run, min; 0 for a run that is not in the program's list."""
        return (self.found.next_run.minutes or 0.0) if self.found.next_run is not None else 0.0


class Adoption(NamedTuple):
    """Holds the operator's choice: all decided causes, and others by name. `why` is the operator's
    reason for the machine file; "" where nothing had to be chosen."""

    ids: tuple[str, ...]
    why: str = ""


class ComparedRow(NamedTuple):
    """Holds the root mean square error of one channel before and after; low and high are the 90 %
    interval of the difference, if known."""

    channel: str
    unit: str
    old: float
    new: float
    low: float | None
    high: float | None


class ComparisonView(NamedTuple):
    """Holds the comparison of a machine file before and after a change, on one log. `report` is the
    path of the page with pictures; "" if none could be drawn."""

    rows: tuple[ComparedRow, ...]
    report: str = ""


class StopSignal:
    """Cancels work in another thread. The function of `call_on_stop` runs at once when the stop is
    requested, or was requested before."""

    def __init__(self) -> None:
        self._set = threading.Event()
        self._then: Callable[[], None] | None = None

    def set(self) -> None:
        """Request the stop."""
        self._set.set()
        if self._then is not None:
            self._then()

    def is_set(self) -> bool:
        """Return whether a stop was requested."""
        return self._set.is_set()

    def call_on_stop(self, end: Callable[[], None]) -> None:
        """Set the function to run at the stop."""
        # The function is set before the check: a stop in between would otherwise be lost.
        self._then = end
        if self.is_set():
            end()


class WorkStopped(Exception):
    """Reports that the work was cancelled."""


class ImportNeedsAnswersError(ValueError):
    """Reports that a file cannot be imported before these questions are answered in the import
    file."""

    def __init__(self, questions: tuple[str, ...], import_file: str) -> None:
        super().__init__(questions[0] if questions else import_file)
        self.questions, self.import_file = questions, import_file


class DiagnosisService(Protocol):
    """Provides files and long work for the page.

    Errors are one-line ValueErrors; cancelled work raises WorkStopped. All functions block, so the
    page calls them in a thread.
    """

    def list_sources(self, running_log: str) -> tuple[DiagnosisSource, ...]:
        """Return the data to choose from, newest first. `running_log` is the path that the control
        worker writes, or ""."""

    def find_source(self, path: str) -> DiagnosisSource:
        """Return the file at a typed path. Raises ValueError."""

    def is_installed(self) -> bool:
        """Return whether the packages that compute a diagnosis are installed."""

    def install_extra(self, tell: TellProgress, stop: StopSignal) -> None:
        """Install the optional packages next to topdress, with the tool that installed topdress."""

    def list_machines(self) -> tuple[str, ...]:
        """Return the machine files for the comparison, in addition to the file that the log
        names."""

    def run_diagnosis(
        self, source: DiagnosisSource, machine: str | None, tell: TellProgress, stop: StopSignal
    ) -> DiagnosisView:
        """Diagnose data. A machine of None means the file that the log names, else the configured
        file.

        A file of kind IMPORT_KIND is first imported as a new log in the user's folder. Raises
        ImportNeedsAnswersError for open questions.
        """

    def adopt_effects(self, found: DiagnosisView, chosen: Adoption) -> str:
        """Write the new machine file and return its path."""

    def describe_last_change(self, machine: str | None) -> tuple[str, ...]:
        """Return the last change of a machine file by a diagnosis, before and after, one line each;
        () without a change."""

    def undo_last_change(self, machine: str | None) -> str:
        """Write a new machine file without the last change and return its path."""

    def export_result(self, found: DiagnosisView, what: ExportKind) -> str:
        """Write the report or the data next to the log and return the path."""

    def write_separating_job(self, found: DiagnosisView) -> str:
        """Write the separating run as a job file and return its path."""

    def drive_separating_run(
        self, found: DiagnosisView, tell: TellProgress, stop: StopSignal
    ) -> DiagnosisView:
        """Drive the separating run on the simulated machine and diagnose its log."""

    def compare_machines(
        self, machine: str, source: DiagnosisSource, tell: TellProgress, stop: StopSignal
    ) -> ComparisonView:
        """Compare a machine file before and after its last change, on a log that did not contribute
        to the change."""
