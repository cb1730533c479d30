"""What the Job screen is given by the command line: files, exports, and going on after a power
cut."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.source import FrameSource
from topdress.console.locale import N_
from topdress.console.worker.resume_alarms import AlarmRecord
from topdress.control.agronomy.strips import StripValue
from topdress.control.field.job_names import JobNames as JobNames

if TYPE_CHECKING:
    from topdress.control.machine.machine import Machine
    from topdress.control.targets.map_check import MapCheck
    from topdress.drivers.files.setup import Setup

# steps of an export
READING, GATHERING, WRITING = N_("reading the log"), N_("gathering"), N_("writing")


class FileChoice(NamedTuple):
    """Describes a configuration that can be chosen: its path or name, and its label."""

    value: str
    label: str


@dataclass(frozen=True, slots=True)
class JobFacts:
    """Holds the content of the run's files, as its worker reads them, their places, and other
    choices.

    product_file: empty: machine and crop name the product. field, field_ha: of the ground that is
    worked, None: no boundary known. map_trouble: why the job's map cannot be used; one line.
    """

    setup: Setup
    job_file: str
    crop_file: str
    machine_file: str
    shipped_machine: bool = False
    product_file: str = ""
    field: str = ""
    field_ha: float | None = None
    map_file: str = ""
    map_check: MapCheck | None = None
    map_trouble: str = ""
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
    """Describes a job as an operator knows it. map: its file's name. done_ha, worked_utc: of its
    newest run, 0 and empty where there is none. picture: the field's outline, else its map's
    plan."""

    title: str
    field: str
    crop: str
    map: str = ""
    done_ha: float = 0.0
    worked_utc: str = ""
    picture: FieldPicture | None = None


class MapFile(NamedTuple):
    """Describes a file that may be a prescription. where: the stick or folder on which it lies."""

    path: str
    name: str
    where: str
    changed: str


class MapReading(NamedTuple):
    """Describes how a map's numbers are meant; empty: as the file says."""

    column: str = ""
    unit: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class MapPreview:
    """Holds a prescription as it was read. question: to be answered first, one line; then the rest
    is empty but for `columns`. kept: the map in kg of product per ha, in a file of ours."""

    path: str
    reading: MapReading
    columns: tuple[str, ...] = ()
    question: str = ""
    unit: str = ""
    area_ha: float = 0.0
    mass_kg: float = 0.0
    rates_kg_ha: tuple[float, float] = (0.0, 0.0)
    picture: FieldPicture | None = None
    check: MapCheck | None = None
    kept: str = ""


class JobOffer(NamedTuple):
    """Describes a job that was left, not ended: cut off, or started again. others: files of the
    next start with which it was not worked."""

    path: str
    began_utc: str
    saved_utc: str
    job: str
    area_ha: float
    others: tuple[str, ...] = ()


class RecentSet(NamedTuple):
    """Describes a job that was worked, or could be: its files, and words by which an operator knows
    it. began_utc: of its last run. card: of its job file."""

    files: tuple[str, ...]
    job: str
    field: str = ""
    machine: str = ""
    began_utc: str = ""
    card: JobCard | None = None


class EarlierRun(NamedTuple):
    """Holds the run before this console looked: alarms, and where material lies (east m, north m,
    heading, kg/ha)."""

    alarms: tuple[AlarmRecord, ...]
    track: tuple[tuple[float, float, float, float], ...]


class RunningLimits(NamedTuple):
    """Holds limits of the running machine."""

    most_rate_kg_ha: float
    hopper_kg: float
    machine: Machine | None = None  # None: what its log says of it cannot be read


Progress = Callable[[int, int, str], None]  # steps done, steps in all, what is being done
IsCancelled = Callable[[], bool]


class JobService(Protocol):
    """Does the files of the page.

    Errors are one-line ValueErrors. All but `restart_worker`, `resume_job` and `start_anew` may
    take their time: in a thread.
    """

    def find_facts(self) -> JobFacts: ...

    def find_free_bytes(self, log_path: str) -> int | None:
        """Free bytes on the disk where the log is written; None where it is not known."""

    def choose_file(self, kind: str, value: str) -> None:
        """Choose another job, crop or machine for `restart_worker`; checked first. `find_facts`
        gives the running files until then."""

    def list_recent(self) -> tuple[RecentSet, ...]:
        """File sets worked lately, the newest first."""

    def choose_recent(self, recent: RecentSet) -> None:
        """Choose all its files for `restart_worker`; checked first."""

    def drop_choices(self) -> None:
        """Drop the last choice: the next start has the running files."""

    def save_strip_value(self, strip: StripValue) -> str:
        """Write the job with this NDVI of a strip, or without one, which the worker knows already;
        returns its path."""

    def list_maps(self) -> tuple[MapFile, ...]:
        """Files that may be a prescription, on sticks, among downloads and the user's own files;
        the newest first."""

    def list_map_folder(self, folder: str, kind: str = "map") -> tuple[MapFile, ...]:
        """Folders, whose names end in a slash, then maps, or files of another kind (job, crop,
        machine); "": the places to begin with."""

    def preview_map(self, path: str, reading: MapReading) -> MapPreview:
        """Read a prescription for the job; nothing of the job changes."""

    def choose_map(self, preview: MapPreview) -> str:
        """Write the job with this map, for `restart_worker`; returns its path."""

    def save_driven_boundary(self, ring_deg: tuple[tuple[float, float], ...]) -> str:
        """Write the job with this ring of latitude and longitude as the field's edge, for
        `restart_worker`; returns its path."""

    def save_job_names(self, who: JobNames) -> str:
        """Write the job with these names, for `restart_worker`; returns its path."""

    def list_job_cards(self) -> tuple[tuple[FileChoice, JobCard | None], ...]:
        """The jobs of `find_facts`, the newest first; None: it cannot be read."""

    async def restart_worker(self, anew: bool = False) -> FrameSource:
        """Start a worker with the choices.

        The one before must have ended. The job left on its field goes on, or is ended (anew). Where
        it does not start, the files are those of before.
        """

    def export_as_applied(
        self, log_path: str, ending: str, progress: Progress, cancelled: IsCancelled
    ) -> tuple[str, ...]:
        """Export as applied, a file for each part of the job; returns their paths."""

    def write_reports(
        self, log_path: str, progress: Progress, cancelled: IsCancelled
    ) -> tuple[str, ...]: ...

    def find_offer(self) -> JobOffer | None:
        """The job that was left on the field of the next start; where no files are chosen, the
        newest of any."""

    async def resume_job(self, offer: JobOffer) -> FrameSource: ...

    async def start_anew(self, offer: JobOffer) -> FrameSource:
        """Begin another job; the job left on its field is ended."""
