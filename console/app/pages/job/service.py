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


class File(NamedTuple):
    """A configuration that can be taken: what is loaded, and what it is called."""

    value: str
    label: str


@dataclass(frozen=True, slots=True)
class Facts:
    """What the files of the run say, as its worker reads them, where they stand, and what else
    can be taken.

    product_file: empty: machine and crop say what is spread. field, field_ha: of the ground
    that is worked, None: no boundary known. map_trouble: why the job's map cannot be used; one
    line.
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
    jobs: tuple[File, ...] = ()
    crops: tuple[File, ...] = ()
    machines: tuple[File, ...] = ()
    products: tuple[File, ...] = ()

    @property
    def names(self) -> JobNames:
        """Whose job it is, and what is spread."""
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
    """What an operator knows a job by. map: its file's name. done_ha, worked_utc: of its newest
    run, 0 and empty where there is none. picture: the field's outline, else what its map plans."""

    title: str
    field: str
    crop: str
    map: str = ""
    done_ha: float = 0.0
    worked_utc: str = ""
    picture: FieldPicture | None = None


class MapFile(NamedTuple):
    """A file that may be a prescription. where: the stick or folder that it lies on."""

    path: str
    name: str
    where: str
    changed: str


class MapReading(NamedTuple):
    """How a map's numbers are meant; empty: as the file says."""

    column: str = ""
    unit: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class MapPreview:
    """A prescription as it was read. question: what has to be said first, one line; then the
    rest is empty but for `columns`. kept: the map in kg of product per ha, in a file of ours."""

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


class Offer(NamedTuple):
    """A job that was left, not ended: cut off, or started again. others: files of the next
    start that it did not go by."""

    path: str
    began_utc: str
    saved_utc: str
    job: str
    area_ha: float
    others: tuple[str, ...] = ()


class Recent(NamedTuple):
    """A job that was worked, or could be: its files, and what an operator knows it by.
    began_utc: of its last run. card: of its job file."""

    files: tuple[str, ...]
    job: str
    field: str = ""
    machine: str = ""
    began_utc: str = ""
    card: JobCard | None = None


class Earlier(NamedTuple):
    """What happened before this console looked: alarms, and where material lies (east m, north
    m, heading, kg/ha)."""

    alarms: tuple[AlarmRecord, ...]
    track: tuple[tuple[float, float, float, float], ...]


class AtWork(NamedTuple):
    """What the machine that runs goes by."""

    most_rate_kg_ha: float
    hopper_kg: float
    machine: Machine | None = None  # None: what its log says of it cannot be read


Progress = Callable[[int, int, str], None]  # steps done, steps in all, what is being done
Cancelled = Callable[[], bool]


class JobService(Protocol):
    """Errors are one-line ValueErrors. All but `restart`, `resume` and `anew` may take their
    time: in a thread."""

    def find_facts(self) -> Facts: ...

    def find_free_bytes(self, log_path: str) -> int | None:
        """On the disk where the log is written; None where it is not known."""

    def choose_file(self, kind: str, value: str) -> None:
        """Another job, crop or machine for `restart`; checked first. `facts` are those of what
        runs until then."""

    def list_recent(self) -> tuple[Recent, ...]:
        """What was worked lately, the newest first."""

    def choose_recent(self, recent: Recent) -> None:
        """All its files for `restart`; checked first."""

    def drop_choices(self) -> None:
        """What was taken last is not wanted: the next start has the files that run."""

    def save_strip_value(self, strip: StripValue) -> str:
        """The job with this NDVI of a strip, or without one, which the worker knows already;
        returns where it stands."""

    def list_maps(self) -> tuple[MapFile, ...]:
        """What may be a prescription, on sticks, among downloads and the user's own files; the
        newest first."""

    def list_map_folder(self, folder: str, kind: str = "map") -> tuple[MapFile, ...]:
        """Folders, whose names end in a slash, then maps, or files of another kind (job, crop,
        machine); "": the places where one may begin to look."""

    def preview_map(self, path: str, reading: MapReading) -> MapPreview:
        """Reads a prescription for the job; nothing of the job changes."""

    def choose_map(self, preview: MapPreview) -> str:
        """The job with this map, for `restart`; returns where it stands."""

    def save_driven_boundary(self, ring_deg: tuple[tuple[float, float], ...]) -> str:
        """The job with this ring of latitude and longitude as the field's edge, for `restart`;
        returns where it stands."""

    def save_job_names(self, who: JobNames) -> str:
        """The job with these names, for `restart`; returns where it stands."""

    def list_job_cards(self) -> tuple[tuple[File, JobCard | None], ...]:
        """The jobs of `facts`, the newest first; None: it cannot be read."""

    async def restart_worker(self, anew: bool = False) -> FrameSource:
        """A worker with what was taken. The one before must have ended. What was left on its
        field goes on, or is ended (anew). Where it does not start, the files are those of
        before."""

    def export_as_applied(
        self, log_path: str, ending: str, progress: Progress, cancelled: Cancelled
    ) -> tuple[str, ...]:
        """As applied, a file for each part of the job; returns where they stand."""

    def write_reports(
        self, log_path: str, progress: Progress, cancelled: Cancelled
    ) -> tuple[str, ...]: ...

    def find_offer(self) -> Offer | None:
        """The job that was left on the field of the next start; where no files are chosen, the
        newest of any."""

    async def resume_job(self, offer: Offer) -> FrameSource: ...

    async def start_anew(self, offer: Offer) -> FrameSource:
        """Begin another job; what was left on its field is ended."""
