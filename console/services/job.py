"""How does the Job screen work with files? It shows facts of the configuration, chooses files,
exports, and continues an interrupted job.
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING

from topdress.console.app.pages.job.service import (
    GATHERING,
    READING,
    WRITING,
    FileChoice,
    IsCancelled,
    JobCard,
    JobFacts,
    JobNames,
    JobOffer,
    MapFile,
    MapPreview,
    MapReading,
    Progress,
    RecentSet,
)
from topdress.console.services.launcher import Launcher, find_data_folder, list_other_files
from topdress.console.worker import resume
from topdress.control.orders import MAP_SOURCES, TargetSource
from topdress.drivers import day_clock
from topdress.drivers.files.config import LoadedConfig, find_shipped_files, load_config, save_config
from topdress.drivers.files.config_error import ConfigError
from topdress.drivers.files.config_kinds import (
    CAB_KIND,
    CROP_KIND,
    JOB_KIND,
    MACHINE_KIND,
    PRODUCT_KIND,
)
from topdress.drivers.plain_text import RefusedInput

# These modules are needed by the type checker only: the screens start sooner without them.
if TYPE_CHECKING:
    from pydantic import BaseModel
    from topdress.console.link import Link
    from topdress.console.worker.resume_field import InterruptedJob
    from topdress.control.agronomy.reference_strips import StripMean
    from topdress.control.field.job import Job
    from topdress.control.machine.machine import Machine
    from topdress.control.targets.map_check import MapCheck
    from topdress.drivers.files.exports.as_applied import AsApplied
    from topdress.drivers.files.read_log import RunLog
    from topdress.drivers.files.run_setup import Setup


@contextlib.contextmanager
def shorten_config_error() -> Iterator[None]:
    """Raises the first line of a ConfigError as the ValueError of the screens."""
    try:
        yield
    except ConfigError as error:
        raise ValueError(error.lines[0]) from None


class JobFiles:
    """Implements `console.app.pages.job.service.JobService` on real files."""

    def __init__(self, launcher: Launcher, folder: Path | None = None) -> None:
        """`folder` is the user's own folder; changed jobs are in its folder `jobs`."""
        self._launcher = launcher
        self._folder = folder or find_data_folder()
        # Files of the next start that the operator considers, instead of those in use.
        self._next: tuple[str, ...] | None = None
        # A changed job among these files: its path, and its next version.
        self._changed: tuple[Path, Path] | None = None
        # Check of the map in its last known state.
        self._checked: tuple[object, MapCheck | RefusedInput | OSError] | None = None
        # Temporary folder of maps that are only previewed.
        self._scratch: tempfile.TemporaryDirectory[str] | None = None

    def find_facts(self) -> JobFacts:
        """Returns facts about the files of the next start. Raises ValueError."""
        from topdress.drivers.files.run_setup import build_setup, load_job_product

        with shorten_config_error():
            found = self._load_files()
            setup = build_setup(found, day_clock.read_today())
            # A start without a job or machine file uses the shipped demo job and the shipped
            # Huanghai machine.
            job_path, machine_path = (
                _find_file_path(found, JOB_KIND.format, "demo"),
                _find_file_path(found, MACHINE_KIND.format, "huanghai"),
            )
            crop = load_config(setup.job.crop, CROP_KIND, base=setup.folder)
        product = load_job_product(setup.job, setup.folder)
        field, area = self._find_field_area(setup.job, setup.machine, found)
        return JobFacts(
            setup,
            str(job_path),
            str(crop.path),
            str(machine_path),
            machine_path in find_shipped_files(MACHINE_KIND.folder).values(),
            "" if product is None else str(product.path),
            field,
            area,
            *self._check_map(setup, found),
            self._list_files("jobs", job_path),
            self._list_files("crops", crop.path),
            self._list_files("machines", machine_path),
            self._list_files(PRODUCT_KIND.folder, None if product is None else product.path),
        )

    @staticmethod
    def _find_field_area(
        job: Job, machine: Machine, found: dict[str, LoadedConfig[BaseModel]]
    ) -> tuple[str, float | None]:
        from topdress.control.field.boundary import Boundary

        ground = _add_simulated_field(job, machine, found).field
        return ground.title, Boundary(
            ground.boundary_m, ground.holes_m
        ).area_ha if ground.boundary_m else None

    def _check_map(
        self, setup: Setup, found: dict[str, LoadedConfig[BaseModel]]
    ) -> tuple[str, MapCheck | None, str]:
        """Returns the path of the job's map, its parts that will not be applied, and the reason why
        it cannot be used.

        The map is checked again only after a change of the file or the job, because a large map
        takes seconds.
        """
        from topdress.drivers.files.archives import list_opened_files
        from topdress.drivers.files.prescriptions.job_targets import find_map_check

        if setup.job.target.map is None:
            return "", None, ""
        path, limit_kg_ha = setup.folder / setup.job.target.map, setup.crop.max_rate_kg_ha
        # The check uses the field in which the loop will run: a simulated job without a boundary
        # gets the simulator's field.
        job = _add_simulated_field(setup.job, setup.machine, found)
        # A map can consist of several files, e.g. shapefile and .dbf or the parts of a zip; a
        # change of any of them makes the check old.
        stands = tuple(
            (file, file.stat().st_mtime_ns, file.stat().st_size)
            for file in list_opened_files(path)
            if file.is_file()
        )
        # The crop's limit belongs to the key, because the check compares the map's rates with this
        # limit.
        key = (stands, job.target, job.field, limit_kg_ha)
        if self._checked is None or self._checked[0] != key:
            try:
                check = find_map_check(job, limit_kg_ha, setup.folder)
                assert check is not None
                self._checked = key, check
            # The refusal is remembered as well, so that an unusable large map is not read again at
            # each refresh.
            except (RefusedInput, OSError) as error:
                self._checked = key, error
        checked = self._checked[1]
        if isinstance(checked, RefusedInput):
            from topdress.console.services.map_refusal import describe_refusal

            return str(path), None, f"{path}: {describe_refusal(checked, path)}"
        if isinstance(checked, OSError):
            return str(path), None, f"{path}: {checked.strerror or checked}"
        return str(path), checked, ""

    def _list_files(self, folder: str, now: Path | None) -> tuple[FileChoice, ...]:
        """Returns the file in use, the user's own files, the newest first, and the shipped
        files."""
        own = [path for path in (self._folder / folder).glob("*.yaml") if path.is_file()]
        own.sort(key=lambda path: path.stat().st_mtime, reverse=True)
        found: dict[str, FileChoice] = {}
        # setdefault keeps the first mention of a path, so the file in use stays first and appears
        # once.
        for path in (*(() if now is None else (now,)), *own, *find_shipped_files(folder).values()):
            found.setdefault(str(path), FileChoice(str(path), path.stem))
        return tuple(found.values())

    def find_free_bytes(self, log_path: str) -> int | None:
        """Returns the free space on the log's disk, bytes; None where it cannot be read."""
        try:
            return shutil.disk_usage(Path(log_path).parent).free
        except OSError:
            return None

    def choose_file(self, kind: str, value: str) -> None:
        """Chooses another job, crop or machine file for the next start. Raises ValueError."""
        value = _clean_typed_path(value)
        with shorten_config_error():
            # A crop has no place of its own in the file set: the job names it, so the job is
            # rewritten.
            if kind == "crop":
                load_config(Path(value), CROP_KIND)
                self._write_new_job({"crop": value}, f"crop {Path(value).stem}")
                return
            wanted = {"job": JOB_KIND, "machine": MACHINE_KIND}[kind]
            # The file is loaded on its own first: its own error is clearer than an error of the
            # whole set.
            load_config(Path(value), wanted)
            self._replace_file(wanted.format, value)

    def list_recent(self) -> tuple[RecentSet, ...]:
        """Returns the file sets of recent jobs, the newest first."""
        from topdress.console.services.recent_jobs import find_recent_sets

        return find_recent_sets(self._launcher.log_folder, self._folder)

    def choose_recent(self, recent: RecentSet) -> None:
        """Chooses the files of a recent job. Raises ValueError."""
        from topdress.drivers.files.run_setup import build_setup, load_by_kind

        # The old set is checked before it is chosen, because a recent job's files may have been
        # moved or deleted since.
        with shorten_config_error():
            build_setup(load_by_kind(recent.files), day_clock.read_today())
        self._next = recent.files

    def save_strip_value(self, strip: StripMean) -> str:
        """Saves a strip's NDVI in the job; returns the comment. Raises ValueError."""
        what = "N-rich strip" if strip.which == "nrich" else "Farmer check"
        how = (
            "" if strip.se is None else f", standard error {strip.se:.4f}, {strip.samples} samples"
        )
        with shorten_config_error():
            said = (
                f"{what} taken back"
                if strip.ndvi is None
                else f"{what}: NDVI {strip.ndvi:.4f}{how}"
            )
            self._write_new_job({f"ndvi_{strip.which}": strip.ndvi}, said)
            # The file gets its place at once, because no restart of the worker follows that would
            # do it.
            self._settle_changed_job()
            self._launcher.config, self._next, self._changed = (
                self._next or self._launcher.config,
                None,
                None,
            )
            return str(_find_file_path(self._load_files(), JOB_KIND.format, "demo"))

    def list_maps(self) -> tuple[MapFile, ...]:
        """Returns maps on USB sticks, among downloads and in the user's folder, the newest
        first."""
        from topdress.console.services.removable_media import find_maps, list_places

        return find_maps(list_places())

    def list_map_folder(self, folder: str, kind: str = "map") -> tuple[MapFile, ...]:
        """Returns the entries of a folder; for an empty name the folders with which a search
        begins. Raises ValueError."""
        from topdress.console.services.removable_media import list_entries, list_places

        if not folder:
            return (
                *(MapFile(str(path), f"{name}/", "", "") for path, name in list_places()),
                MapFile(str(Path.home()), "~/", "", ""),
                MapFile(Path.home().anchor, Path.home().anchor, "", ""),
            )
        try:
            return list_entries(Path(folder), kind)
        except OSError as error:
            raise ValueError(f"{error.strerror or error}: {folder}") from None

    def preview_map(self, path: str, reading: MapReading) -> MapPreview:
        """Returns a map as it would be read. Raises ValueError."""
        from topdress.console.services.field import make_job_picture
        from topdress.console.services.map_refusal import describe_map_refusal, describe_refusal
        from topdress.control.targets.prescription import calc_rate_shares
        from topdress.drivers.files.prescriptions.job_targets import find_map_check
        from topdress.drivers.files.prescriptions.map_choices import (
            UNIT_NOT_NAMED,
            RateChoice,
            RateQuestion,
        )
        from topdress.drivers.files.prescriptions.map_reader import read_prescription
        from topdress.drivers.files.prescriptions.map_writer import write_prescription
        from topdress.drivers.files.run_setup import build_setup

        found = self._load_files()
        setup = build_setup(found, day_clock.read_today())
        choice = RateChoice(
            column=reading.column or None,
            unit=reading.unit or None,
            width_m=setup.machine.geometry.working_width_m,
        )
        path = _clean_typed_path(path)
        try:
            read = read_prescription(path, choice)
        # A file with several rate columns is no error: the operator chooses the column on the
        # screen.
        except RateQuestion as question:
            return MapPreview(
                path, reading, question.columns, describe_refusal(question, Path(path))
            )
        except RefusedInput as error:
            raise ValueError(
                f"{describe_map_refusal(Path(path), error)} ({Path(path).name})"
            ) from None
        except OSError as error:
            raise ValueError(f"{error.strerror or error}: {path}") from None
        if self._scratch is None:
            self._scratch = tempfile.TemporaryDirectory(prefix="topdress-maps-")
        # The preview is written as GeoJSON in kg/ha, so the job reads the values that the operator
        # saw on the screen, whatever the source's format.
        kept = Path(self._scratch.name) / f"{Path(path).stem}.geojson"
        write_prescription(read.data, kept)
        shares = calc_rate_shares(read.data)
        doubtful = find_implausible_rates(
            [share.rate_kg_ha for share in shares], setup.crop.max_rate_kg_ha
        )
        # A file without a unit is read as kg/ha; rates that no field gets show that this reading is
        # wrong.
        if read.unit_from == UNIT_NOT_NAMED and doubtful:
            return MapPreview(
                path,
                reading._replace(column=reading.column or (read.layers or ("",))[0]),
                read.layers,
                f"{doubtful}, and the file names no unit: say which one it is",
            )
        target = setup.job.target.model_copy(update={"map": str(kept), "source": TargetSource.MAP})
        job = _add_simulated_field(
            setup.job.model_copy(update={"target": target}), setup.machine, found
        )
        check = find_map_check(job, setup.crop.max_rate_kg_ha, kept.parent)
        # An empty map has no rates, and min() and max() of an empty list would raise.
        rates = [share.rate_kg_ha for share in shares] or [0.0]
        picture = make_job_picture(job, kept.parent, setup.machine.geometry.working_width_m)
        return MapPreview(
            path,
            reading._replace(column=reading.column or (read.layers or ("",))[0]),
            read.layers,
            "",
            f"{read.unit} ({read.unit_from})",
            sum(share.area_ha for share in shares),
            sum(share.mass_kg for share in shares),
            (min(rates), max(rates)),
            picture,
            check,
            str(kept),
        )

    def choose_map(self, preview: MapPreview) -> str:
        """Writes a map into the job; returns the comment. Raises ValueError."""
        from topdress.drivers.files.atomic_files import find_free_path, write_atomically

        place = find_free_path(self._folder / "maps", Path(preview.kept).stem, ".geojson")
        target = load_config(
            _find_file_path(self._load_files(), JOB_KIND.format, "demo"), JOB_KIND
        ).model.target
        said = (
            f"Prescription {Path(preview.path).name}, column "
            f"{preview.reading.column or '-'}, {preview.unit}"
        )
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(place, Path(preview.kept).read_bytes())
            # A job whose source already uses a map keeps this source; any other job changes to the
            # map.
            source = target.source if target.source in MAP_SOURCES else TargetSource.MAP
            # Only source canopy may have `hold_mean_kg_ha`: a job with both is refused.
            changed = target.model_copy(
                update={"map": str(place), "source": source, "hold_mean_kg_ha": None}
            )
            with shorten_config_error():
                return self._write_new_job({"target": changed}, said)
        except OSError as error:
            raise ValueError(f"{place}: {error.strerror or error}") from None

    def save_driven_boundary(self, ring_deg: tuple[tuple[float, float], ...]) -> str:
        """Writes a driven boundary into the job; returns the comment. Raises ValueError for
        crossing edges or too few corners."""
        from topdress.console.services.driven_field import make_driven_field

        ground = load_config(
            _find_file_path(self._load_files(), JOB_KIND.format, "demo"), JOB_KIND
        ).model.field
        with shorten_config_error():
            field, area_ha = make_driven_field(ground, ring_deg)
            said = f"Boundary driven, {area_ha:.2f} ha, {len(field.boundary_m)} corners"
            return self._write_new_job({"field": field}, said)

    def save_job_names(self, who: JobNames) -> str:
        """Writes client, farm and field names into the job; returns the comment. Raises
        ValueError."""
        job = load_config(
            _find_file_path(self._load_files(), JOB_KIND.format, "demo"), JOB_KIND
        ).model
        field = job.field.model_copy(update={"title": who.field})
        with shorten_config_error():
            return self._write_new_job(
                {
                    "client": who.client,
                    "farm": who.farm,
                    "product": who.product,
                    "product_file": who.product_file or None,
                    "operator": who.operator,
                    "field": field,
                },
                "Names given in the cab",
            )

    def list_job_cards(self) -> tuple[tuple[FileChoice, JobCard | None], ...]:
        """Returns the job files with their cards; None for an unreadable file."""
        from topdress.console.services.recent_jobs import find_done_of_jobs, make_job_card

        now = _find_file_path(self._load_files(), JOB_KIND.format, "demo")
        done = find_done_of_jobs(self._launcher.log_folder)
        return tuple(
            (file, make_job_card(Path(file.value), done))
            for file in self._list_files(JOB_KIND.folder, now)
        )

    def _write_new_job(self, changes: dict[str, object], comment: str) -> str:
        """Writes the changed job. A job of the user keeps its file, and its earlier version goes to
        the folder `history`; another job is copied under its own name."""
        from topdress.drivers.files.atomic_files import find_free_path

        path = _find_file_path(self._load_files(), JOB_KIND.format, "demo")
        loaded = load_config(path, JOB_KIND)
        job, folder, own = loaded.model, path.parent, self._folder / JOB_KIND.folder
        # A job outside the user's folder, e.g. a shipped one, is never overwritten: the copy gets a
        # free name.
        place = path if folder.resolve() == own.resolve() else find_free_path(own, job.id, ".yaml")
        crop = _resolve_named_file(folder, job.crop)
        product_file = (
            None if job.product_file is None else _resolve_named_file(folder, job.product_file)
        )
        # Names of files in a job are relative to its folder; the copy lies in another folder and
        # therefore gets whole paths.
        new = job.model_copy(
            update={"crop": crop, "product_file": product_file, "id": place.stem} | changes
        ).rename_files(lambda named: str((folder / named).resolve()))
        now = day_clock.read_local_now()
        # The new version waits in the history until the worker starts with it: a failed start then
        # leaves the job as it was.
        kept = (
            find_free_path(own / "history", f"{place.stem}-{now:%Y%m%d-%H%M%S}", ".yaml")
            if place == path
            else place
        )
        try:
            kept.parent.mkdir(parents=True, exist_ok=True)
            # The history of the changes stays at the head of the file; a copy begins a history of
            # its own.
            before = _read_head_comments(path) if place == path else [f"From {path.name}."]
            save_config(
                kept, new, JOB_KIND, "\n".join([*before, f"{now:%Y-%m-%d %H:%M} {comment}"])
            )
        except OSError as error:
            raise ValueError(f"{kept}: {error.strerror or error}") from None
        self._replace_file(JOB_KIND.format, str(kept))
        self._changed = place, kept
        return str(kept)

    def _settle_changed_job(self) -> None:
        """Puts the changed job in its place, and the earlier job into the history; a second call
        reverses this. Raises ValueError."""
        from topdress.drivers.files.atomic_files import write_atomically

        if self._changed is None:
            return
        place, kept = self._changed
        if kept != place:
            try:
                # Both contents are read before either file is written, so a failed read changes
                # nothing.
                new, old = kept.read_bytes(), place.read_bytes()
                write_atomically(place, new)
                write_atomically(kept, old)
            except OSError as error:
                raise ValueError(f"{place}: {error.strerror or error}") from None
        if self._next is not None:
            self._next = tuple(str(place) if file == str(kept) else file for file in self._next)

    def _check_file_set(self, kind: str, value: str) -> None:
        """Checks the new set of files together. Raises ConfigError."""
        from topdress.drivers.files.run_setup import build_setup, load_by_kind

        # Files that are valid alone can contradict each other, e.g. a job's rate and a machine's
        # limits.
        build_setup(load_by_kind(self._make_file_set(kind, value)), day_clock.read_today())

    def _replace_file(self, kind: str, value: str) -> None:
        self._check_file_set(kind, value)
        self._next = self._make_file_set(kind, value)

    def _make_file_set(self, kind: str, value: str) -> tuple[str, ...]:
        kept = [str(one.path) for format_, one in self._load_files().items() if format_ != kind]
        return (*kept, value)

    def _load_files(self) -> dict[str, LoadedConfig[BaseModel]]:
        from topdress.drivers.files.run_setup import load_by_kind

        return load_by_kind(self._launcher.config)

    def drop_choices(self) -> None:
        """Discards the choices for the next start."""
        # The version that was never used is deleted; the job's own file must survive.
        if self._changed is not None and self._changed[0] != self._changed[1]:
            self._changed[1].unlink(missing_ok=True)
        self._next = self._changed = None

    async def restart_worker(self, anew: bool = False) -> Link:
        """Starts a worker with the chosen files. Raises WorkerFailed, ValueError, OSError; the
        previous files then stay in use."""
        # The interrupted jobs are found before the files change, because they are searched on the
        # field of these files.
        before, left = self._launcher.config, self._find_left_jobs()
        self._settle_changed_job()
        self._launcher.config, self._next = self._next or before, None
        try:
            return await self._begin_worker(left, anew)
        # After a failed start the earlier files return, and the second call of
        # `_settle_changed_job` swaps the contents back.
        except (RuntimeError, ValueError, OSError):
            self._launcher.config = before
            self._settle_changed_job()
            raise
        finally:
            self._changed = None

    async def _begin_worker(self, left: Sequence[InterruptedJob], anew: bool) -> Link:
        """Starts a worker on a field with these interrupted jobs, the newest first."""
        if anew:
            # A job that starts anew is offered no longer: its interrupted parts count as finished.
            for one in left:
                resume.mark_finished(one.path)
        return await self._launcher.start_link(
            None if anew else next((one.path for one in left if one.is_same_job), None)
        )

    def export_as_applied(
        self, log_path: str, ending: str, progress: Progress, cancelled: IsCancelled
    ) -> tuple[str, ...]:
        """Exports the as-applied map of each part of the job. Raises ValueError, OSError."""
        from topdress.drivers.files.exports.as_applied import build_as_applied
        from topdress.drivers.files.exports.export_writer import write_as_applied

        return self._write_part_files(
            log_path,
            f"-applied{ending}",
            build_as_applied,
            lambda _recorded, applied, out: write_as_applied(applied, out),
            progress,
            cancelled,
        )

    def write_reports(
        self, log_path: str, progress: Progress, cancelled: IsCancelled
    ) -> tuple[str, ...]:
        """Writes the report of each part of the job. Raises ValueError, OSError."""
        from topdress.console.reports.job_metadata import read_job_metadata
        from topdress.console.reports.job_page import MAX_DRAWN_SEGMENTS, make_job_page
        from topdress.drivers.files.atomic_files import write_atomically
        from topdress.drivers.files.exports.as_applied import DEFAULT_STRETCH_S, build_as_applied
        from topdress.drivers.files.run_meta import find_software_version

        def gather_as_applied(recorded: RunLog) -> AsApplied:
            applied = build_as_applied(recorded)
            every_s = applied.totals.worked_s / MAX_DRAWN_SEGMENTS
            # A long job has more segments than a page draws quickly; segments are then made longer,
            # and totals stay equal.
            return (
                build_as_applied(recorded, every_s=every_s)
                if every_s > DEFAULT_STRETCH_S
                else applied
            )

        def write_report(recorded: RunLog, applied: AsApplied, out: Path) -> None:
            write_atomically(
                out,
                make_job_page(
                    applied, f"topdress {find_software_version()}", read_job_metadata(recorded)
                ),
            )

        return self._write_part_files(
            log_path, "-report.html", gather_as_applied, write_report, progress, cancelled
        )

    def _write_part_files(
        self,
        log_path: str,
        ending: str,
        gathered: Callable[[RunLog], AsApplied],
        write: Callable[[RunLog, AsApplied, Path], object],
        progress: Progress,
        cancelled: IsCancelled,
    ) -> tuple[str, ...]:
        """Writes a file for each log of the job, next to the log; a cancelled call returns the
        finished files. An empty log is skipped, unless all logs are empty. Raises ValueError,
        OSError."""
        from topdress.drivers.files.exports.as_applied import ExportError
        from topdress.drivers.files.imports.import_errors import TableError
        from topdress.drivers.files.read_log import read_log

        logs = self._list_parts(log_path)
        written: list[str] = []
        for number, log in enumerate(logs):
            try:
                for step, what in enumerate((READING, GATHERING, WRITING)):
                    # A cancelled export keeps the files that are complete; no half-written file
                    # remains, because each is written at once.
                    if cancelled():
                        return tuple(written)
                    progress(3 * number + step, 3 * len(logs), what)
                    if what == READING:
                        recorded = read_log(log)
                    elif what == GATHERING:
                        applied = gathered(recorded)
                    else:
                        out = log.with_name(f"{log.stem}{ending}")
                        write(recorded, applied, out)
                        written.append(str(out))
            except (ExportError, TableError) as error:
                # A part without work, e.g. after a restart in the yard, is no error while another
                # part has a file.
                if len(logs) == 1 or (log == logs[-1] and not written):
                    raise ValueError(str(error).splitlines()[0]) from None
        return tuple(written)

    @staticmethod
    def _list_parts(log_path: str) -> tuple[Path, ...]:
        """Returns the logs of the job, oldest first."""
        log = Path(log_path)
        try:
            # Only the snapshot lists the logs of the earlier parts; without it the log is the only
            # part.
            before = resume.read_snapshot(resume.make_snapshot_path(log)).logs_before
        except (OSError, ValueError):
            before = ()
        # The operator may have moved an earlier part to another disk.
        return (*(path for path in map(Path, before) if path.exists()), log)

    def find_offer(self) -> JobOffer | None:
        """Returns the interrupted job that can continue; None without such a job."""
        # A job of the same name comes before other jobs on this field; sorted() keeps the newest
        # first within each group.
        left = sorted(self._find_left_jobs(), key=lambda one: not one.is_same_job)
        if not left:
            return None
        kept = left[0].snapshot
        return JobOffer(
            str(left[0].path),
            kept.began_utc,
            kept.saved_utc,
            kept.job,
            kept.area_ha,
            list_other_files(kept.config, self._next or self._launcher.config),
        )

    def _find_left_jobs(self) -> list[InterruptedJob]:
        """Returns the interrupted jobs on the field of the next start, the newest first; if no
        files are chosen, the newest of all. Raises ValueError."""
        from topdress.console.worker.resume_field import InterruptedJob, find_jobs_here
        from topdress.drivers.files.run_setup import build_setup, load_by_kind

        now, config = day_clock.read_utc_now(), self._next or self._launcher.config
        if not config:
            return [
                # Without files the field is unknown; a share of 1.0 lets the newest job continue
                # with its totals.
                InterruptedJob(*one, 1.0)
                for one in resume.find_open_jobs(self._launcher.log_folder, now)
            ][:1]
        with shorten_config_error():
            found = load_by_kind(config)
            setup = build_setup(found, day_clock.read_today())
        return find_jobs_here(
            self._launcher.log_folder,
            _add_simulated_field(setup.job, setup.machine, found),
            _is_simulated_cab(found),
            now,
        )

    async def resume_job(self, offer: JobOffer) -> Link:
        """Continues a job with the files of the next start, else with its own. Raises WorkerFailed,
        ValueError, OSError."""
        kept, left = resume.read_snapshot(Path(offer.path)), self._find_left_jobs()
        launcher = self._launcher
        # Effects, seed and tick rate of the interrupted job return, so that a simulated job
        # continues on the machine on which it began.
        launcher.config, launcher.effects = launcher.config or kept.config, kept.effects
        launcher.seed, launcher.hz = kept.seed, kept.hz
        return await self._begin_worker(left, False)

    async def start_anew(self, offer: JobOffer) -> Link:
        """Starts the job anew. Raises WorkerFailed, ValueError, OSError."""
        return await self._begin_worker(self._find_left_jobs(), True)


def _clean_typed_path(path: str) -> str:
    """Returns a typed path, or a path that a file manager pasted, without quotes and URL syntax."""
    return str(Path(path.strip().strip("'\"")).expanduser())


# Implausible rates: twice the crop's limit, or less than any dressing, kg/ha.
MAX_PLAUSIBLE_LIMIT_FACTOR, MIN_PLAUSIBLE_RATE_KG_HA = 2.0, 10.0


def find_implausible_rates(rates_kg_ha: Sequence[float], most_kg_ha: float) -> str:
    """Returns a description of rates that no field gets, if they are in kg/ha; empty for plausible
    rates."""
    highest = max(rates_kg_ha, default=0.0)
    if highest > MAX_PLAUSIBLE_LIMIT_FACTOR * most_kg_ha:
        return (
            f"rates up to {highest:.0f}, read as kg/ha, are far above the crop's limit of "
            f"{most_kg_ha:.0f}"
        )
    if 0.0 < highest < MIN_PLAUSIBLE_RATE_KG_HA:
        return f"rates up to {highest:g}, read as kg/ha, are less than any dressing"
    return ""


def _add_simulated_field(
    job: Job, machine: Machine, found: dict[str, LoadedConfig[BaseModel]]
) -> Job:
    """Returns the job with its field; on the simulated machine a job without a boundary gets a
    field."""
    from topdress.control.simulation.assembly import add_simulated_field

    return add_simulated_field(job, machine) if _is_simulated_cab(found) else job


def _is_simulated_cab(found: dict[str, LoadedConfig[BaseModel]]) -> bool:
    cab = found.get(CAB_KIND.format)
    # Without a cab file the console runs on its simulated machine.
    return cab is None or bool(getattr(cab.model, "virtual", False))


def _find_file_path(found: dict[str, LoadedConfig[BaseModel]], kind: str, nominal: str) -> Path:
    folder = {JOB_KIND.format: JOB_KIND.folder, MACHINE_KIND.format: MACHINE_KIND.folder}[kind]
    return found[kind].path if kind in found else find_shipped_files(folder)[nominal]


def _read_head_comments(path: Path) -> list[str]:
    """Returns the comments at the beginning of a topdress file: its history, one line for each
    change."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line.removeprefix("# ") for line in takewhile(lambda line: line.startswith("#"), lines)]


def _resolve_named_file(folder: Path, name: str) -> str:
    """Returns a file that a job names by its path from another folder; a shipped file by
    its name."""
    is_path = "/" in name or "\\" in name or name.lower().endswith((".yaml", ".yml"))
    return str((folder / name).resolve()) if is_path else name
