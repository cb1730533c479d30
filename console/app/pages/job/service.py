"""Declares the files and functions that the command line supplies to the Job screen: files,
exports, resumption after a power cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.frame_source import FrameSource
from topdress.console.locale import N_
from topdress.console.worker.resume_alarms import AlarmRecord
from topdress.control.agronomy.reference_strips import StripMean
from topdress.control.field.job_names import JobNames as JobNames

if TYPE_CHECKING:
    from topdress.control.machine.machine import Machine
    from topdress.control.targets.map_check import MapCheck
    from topdress.drivers.files.run_setup import Setup

# Stages of an export, for its progress.
READING, GATHERING, WRITING = N_("reading the log"), N_("gathering"), N_("writing")


class FileChoice(NamedTuple):
    """Describes a configuration that can be chosen, by its path or name, with a label."""

    value: str
    label: str


@dataclass(frozen=True, slots=True)
class JobFacts:
    """Holds the contents of the run's files as its worker reads them, their paths, and the
    alternatives.

    Attributes
    ----------
    product_file
        "" where machine and crop file define the product.
    field, field_ha
        Name and area of the worked field; an area of None means that no boundary is known.
    map_trouble
        Reason why the job's map cannot be used, in one line.
    """

    # The same class as the worker builds, so that the screen shows what the worker uses.
    setup: Setup
    job_file: str
    crop_file: str
    machine_file: str
    # True for a machine file of the program, which was not calibrated on this machine.
    shipped_machine: bool = False
    product_file: str = ""
    field: str = ""
    field_ha: float | None = None
    map_file: str = ""
    map_check: MapCheck | None = None
    map_trouble: str = ""
    # Alternatives for the lists of the Job page.
    jobs: tuple[FileChoice, ...] = ()
    crops: tuple[FileChoice, ...] = ()
    machines: tuple[FileChoice, ...] = ()
    products: tuple[FileChoice, ...] = ()

    @property
    def names(self) -> JobNames:
        """Names of the job and its product."""
        job, product = self.setup.job, self.setup.product
        return JobNames(
            job.client,
            job.farm,
            self.field,
            job.product or ("" if product is None else product.name),
            job.operator,
            self.product_file,
        )


class JobCard(NamedTuple):
    """Describes a job as an operator knows it.

    Attributes
    ----------
    map
        Name of the map file.
    done_ha, worked_utc
        Of the newest run; 0 and "" without a run.
    picture
        The field's outline, else the plan of the map.
    """

    title: str
    field: str
    crop: str
    map: str = ""
    done_ha: float = 0.0
    worked_utc: str = ""
    picture: FieldPicture | None = None


class MapFile(NamedTuple):
    """Describes a file that may be a prescription; `where` is its memory stick or folder."""

    path: str
    name: str
    where: str
    changed: str


class MapReading(NamedTuple):
    """Defines column and unit of a map's rates; "" means as declared in the file."""

    column: str = ""
    unit: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class MapPreview:
    """Holds a prescription as it was read.

    Attributes
    ----------
    question
        Question that must be answered first, in one line; then only `columns` is filled.
    kept
        Path of our copy of the map, in kg of product per ha.
    """

    path: str
    reading: MapReading
    columns: tuple[str, ...] = ()
    question: str = ""
    unit: str = ""
    # Area and mass of the whole map.
    area_ha: float = 0.0
    mass_kg: float = 0.0
    # Lowest and highest rate, kg/ha.
    rates_kg_ha: tuple[float, float] = (0.0, 0.0)
    picture: FieldPicture | None = None
    check: MapCheck | None = None
    kept: str = ""


class JobOffer(NamedTuple):
    """Describes a job that was interrupted, not ended. `others` are files of the next start that
    differ from those of the job."""

    path: str
    # UTC, ISO 8601, as in the snapshot.
    began_utc: str
    saved_utc: str
    job: str
    area_ha: float
    others: tuple[str, ...] = ()


class RecentSet(NamedTuple):
    """Describes a job that was worked or can be: its files and descriptive names. `began_utc` is
    the start of its last run."""

    files: tuple[str, ...]
    job: str
    field: str = ""
    machine: str = ""
    began_utc: str = ""
    card: JobCard | None = None


class EarlierRun(NamedTuple):
    """Holds the run before this console started: alarms, and positions of applied material (east m,
    north m, heading deg, kg/ha)."""

    alarms: tuple[AlarmRecord, ...]
    track: tuple[tuple[float, float, float, float], ...]


class RunningLimits(NamedTuple):
    """Holds the limits of the running machine."""

    most_rate_kg_ha: float
    hopper_kg: float
    # None means that the machine's description in its log is unreadable.
    machine: Machine | None = None


# Arguments: steps done, number of steps, name of the step.
Progress = Callable[[int, int, str], None]
IsCancelled = Callable[[], bool]


class JobService(Protocol):
    """Provides the files of the page.

    Errors are one-line ValueErrors. All functions except `restart_worker`, `resume_job` and
    `start_anew` may block, so the page calls them in a thread.
    """

    def find_facts(self) -> JobFacts: ...

    def find_free_bytes(self, log_path: str) -> int | None:
        """Return the free bytes on the log's disk; None where unknown."""

    def choose_file(self, kind: str, value: str) -> None:
        """Choose another job, crop or machine for `restart_worker`, after a check. Until then
        `find_facts` returns the running files."""

    def list_recent(self) -> tuple[RecentSet, ...]:
        """Return recent sets of files, newest first."""

    def choose_recent(self, recent: RecentSet) -> None:
        """Choose all files of a set for `restart_worker`, after a check."""

    def drop_choices(self) -> None:
        """Drop the choices, so that the next start uses the running files."""

    def save_strip_value(self, strip: StripMean) -> str:
        """Write the job with a strip's NDVI, or without it, and return its path; the worker knows
        the value already."""

    def list_maps(self) -> tuple[MapFile, ...]:
        """Return files that may be a prescription, newest first: on memory sticks, among downloads
        and in the user's own folders."""

    def list_map_folder(self, folder: str, kind: str = "map") -> tuple[MapFile, ...]:
        """Return the subfolders (names end in a slash), then the files of a kind: map, job, crop or
        machine. A folder of "" returns the starting points."""

    def preview_map(self, path: str, reading: MapReading) -> MapPreview:
        """Read a prescription for the job, without changing the job."""

    def choose_map(self, preview: MapPreview) -> str:
        """Write the job with this map for `restart_worker`, and return its path."""

    def save_driven_boundary(self, ring_deg: tuple[tuple[float, float], ...]) -> str:
        """Write the job with this ring of latitude and longitude as the field's boundary for
        `restart_worker`, and return its path."""

    def save_job_names(self, who: JobNames) -> str:
        """Write the job with these names for `restart_worker`, and return its path."""

    def list_job_cards(self) -> tuple[tuple[FileChoice, JobCard | None], ...]:
        """Return the jobs of `find_facts`, newest first; None marks an unreadable job."""

    async def restart_worker(self, anew: bool = False) -> FrameSource:
        """Start a worker with the chosen files.

        The former worker must have ended. An interrupted job on the field is resumed, or ended if
        `anew`. If the start fails, the former files stay in use.
        """

    def export_as_applied(
        self, log_path: str, ending: str, progress: Progress, cancelled: IsCancelled
    ) -> tuple[str, ...]:
        """Export the applied rates, one file per part of the job, and return the paths."""

    def write_reports(
        self, log_path: str, progress: Progress, cancelled: IsCancelled
    ) -> tuple[str, ...]: ...

    def find_offer(self) -> JobOffer | None:
        """Return the interrupted job on the field of the next start; without chosen files, the
        newest interrupted job."""

    async def resume_job(self, offer: JobOffer) -> FrameSource: ...

    async def start_anew(self, offer: JobOffer) -> FrameSource:
        """Begin another job, which ends the interrupted job on its field."""
