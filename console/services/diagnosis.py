"""How does the Diagnosis page find its logs and run a diagnosis? It lists folders of logs, and each
diagnosis has its own process.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from topdress.console.app.pages.diagnosis.adoption import find_offer, list_undecided
from topdress.console.app.pages.diagnosis.service import (
    IMPORT_KIND,
    Adoption,
    ComparedRow,
    ComparisonView,
    DiagnosisSource,
    DiagnosisView,
    ExportKind,
    ImportNeedsAnswersError,
    StopSignal,
    TellProgress,
    WorkStopped,
)
from topdress.console.reports.diagnosis_wording import list_rivals
from topdress.console.services.diagnosis_job import (
    REPORT_NAME,
    RESULT_NAME,
    VIEW_NAME,
    DiagnosisOrder,
)
from topdress.console.services.foreign_files import is_importable, is_likely_log
from topdress.console.services.launcher import find_data_folder
from topdress.console.thread_limits import ONE_THREAD_VARIABLES
from topdress.drivers import day_clock
from topdress.drivers.files.atomic_files import find_free_path
from topdress.drivers.files.optional_packages import (
    find_installer,
    format_extra_line,
    is_extra_installed,
    list_requirements,
    require_extras,
)

if TYPE_CHECKING:
    from topdress.control.machine.machine import Machine

# A folder of several seasons holds thousands of logs; the newest ones are those that a driver looks
# for.
MAX_LISTED_FILES = 200
# Name of the extra in pyproject.toml.
DIAGNOSIS_EXTRA = "diagnosis"
# "-P" keeps the current folder off the module path: a file named numpy.py there would replace the
# library.
JOB_ARGUMENTS = ("-P", "-m", "topdress.console.services.diagnosis_job")


class DiagnosisFiles:
    """Implements `console.app.pages.diagnosis.service.DiagnosisService` on real files.

    `folders` are searched for logs and tables. `machine` is the machine of data that name none.
    `effects` are simulated in the machine of this console; a separating run is driven on a machine
    with these effects.
    """

    def __init__(
        self,
        folders: Sequence[Path] | None = None,
        machine: str = "huanghai",
        effects: tuple[str, ...] = (),
        own: Path | None = None,
    ) -> None:
        self.own = own or find_data_folder()
        # The user's own logs come first; a folder that is named twice is searched once.
        self.folders = tuple(dict.fromkeys((self.own / "logs", *(folders or (Path.cwd(),)))))
        self.machine, self.effects = machine, effects
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        self._made = 0

    def list_sources(self, running_log: str) -> tuple[DiagnosisSource, ...]:
        """Returns logs and tables of the folders, the newest first; `running_log` is the log that
        is being written."""
        found: dict[Path, float] = {}
        for folder in self.folders:
            # A missing or unreadable folder, e.g. a removed USB stick, must not hide the other
            # folders.
            with contextlib.suppress(OSError):
                for path in folder.iterdir():
                    if is_likely_log(path):
                        # A log can vanish between the listing and the query of its time.
                        with contextlib.suppress(OSError):
                            found[path.resolve()] = path.stat().st_mtime
        # The log in progress may lie in a folder that is not searched.
        if running_log and Path(running_log).is_file():
            found[Path(running_log).resolve()] = Path(running_log).stat().st_mtime
        running = Path(running_log).resolve() if running_log else None
        listed = []
        for path in sorted(found, key=lambda one: -found[one])[:MAX_LISTED_FILES]:
            # A file that is no log after all is omitted without a message, since nobody chose it.
            with contextlib.suppress(OSError, ValueError):
                listed.append(_make_source(path)._replace(working=path == running))
        return tuple(listed)

    def find_source(self, path: str) -> DiagnosisSource:
        """Returns the log or table at a typed path. Raises ValueError."""
        if not path.strip():
            raise ValueError("no file is named")
        whole = Path(path.strip()).expanduser()
        try:
            return _make_source(whole.resolve())
        except OSError as error:
            raise ValueError(f"{whole}: {error.strerror or error}") from None

    def list_machines(self) -> tuple[str, ...]:
        """Returns shipped machines by name, then adopted machines by path."""
        from topdress.drivers.files.config import find_shipped_files

        adopted = sorted(str(path) for path in (self.own / "machines").glob("*.yaml"))
        return (*find_shipped_files("machines"), *adopted)

    def is_installed(self) -> bool:
        """Returns whether the extra diagnosis is installed."""
        return is_extra_installed(DIAGNOSIS_EXTRA)

    def install_extra(self, tell: TellProgress, stop: StopSignal) -> None:
        """Installs the extra diagnosis."""
        command = [*find_installer(), *list_requirements(DIAGNOSIS_EXTRA)]
        tell(0.0, "installing")
        try:
            # A process of its own survives no stop: the callback kills it, and the page stays
            # usable meanwhile.
            with subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                # A session of its own keeps Ctrl-C in the terminal from reaching the installer.
                start_new_session=True,
                text=True,
                errors="replace",
            ) as child:
                stop.call_on_stop(child.kill)
                trouble = child.communicate()[1].strip().splitlines()
        except OSError as error:
            raise ValueError(f"{command[0]}: {error.strerror or error}") from None
        if stop.is_set():
            raise WorkStopped
        # Python caches the folders' contents; without this call the new modules stay invisible
        # until a restart.
        importlib.invalidate_caches()
        if child.returncode or not self.is_installed():
            # The last line of pip's stderr states the reason.
            why = trouble[-1] if trouble else f"ended with {child.returncode}"
            raise ValueError(f"{format_extra_line(DIAGNOSIS_EXTRA)}: {why}")

    def run_diagnosis(
        self, source: DiagnosisSource, machine: str | None, tell: TellProgress, stop: StopSignal
    ) -> DiagnosisView:
        """Returns the diagnosis of a log or table on a machine (None: the machine that the data
        name)."""
        return self._run_order(
            DiagnosisOrder(
                source.path,
                str(self._make_job_folder()),
                source.kind,
                machine,
                self.machine,
                logs=str(self.own / "logs"),
            ),
            tell,
            stop,
        )

    def drive_separating_run(
        self, found: DiagnosisView, tell: TellProgress, stop: StopSignal
    ) -> DiagnosisView:
        """Drives the run that separates the rival causes on the simulated machine, and returns the
        diagnosis of its log."""
        if not found.drives:
            raise ValueError("this run cannot be driven on the simulated machine")
        # Without a planted effect the likeliest cause is simulated, so that the run has something
        # to separate.
        planted = self.effects or tuple(text for text in (_format_likeliest_cause(found),) if text)
        return self._run_order(
            DiagnosisOrder(
                found.found.data.path,
                str(self._make_job_folder()),
                "run",
                None,
                self.machine,
                found.drives,
                planted,
            ),
            tell,
            stop,
        )

    def compare_machines(
        self, machine: str, source: DiagnosisSource, tell: TellProgress, stop: StopSignal
    ) -> ComparisonView:
        """Returns the errors of a machine file on a log before and after its last change."""
        order = DiagnosisOrder(
            source.path, str(self._make_job_folder()), "run", machine, self.machine, compare=True
        )
        self._run_job_process(order, tell, stop)
        made = Path(order.folder) / REPORT_NAME
        # A result without a report is shown all the same.
        stem = f"{Path(source.path).stem}-compared"
        report = _copy_to_folder(made, self.own / "reports", stem, ".html") if made.exists() else ""
        plain = json.loads((Path(order.folder) / RESULT_NAME).read_text(encoding="utf-8"))
        return ComparisonView(
            tuple(ComparedRow(**one) for one in plain["logs"][0]["channels"]), report
        )

    def _run_order(
        self, order: DiagnosisOrder, tell: TellProgress, stop: StopSignal
    ) -> DiagnosisView:
        from topdress.drivers.files.plain_data import build_from_plain

        self._run_job_process(order, tell, stop)
        plain = json.loads((Path(order.folder) / VIEW_NAME).read_text(encoding="utf-8"))
        return build_from_plain(DiagnosisView, plain)._replace(folder=order.folder)

    def _run_job_process(self, order: DiagnosisOrder, tell: TellProgress, stop: StopSignal) -> None:
        """Carries out the order in a process of its own. Raises Stopped, OpenQuestions, and
        ValueError of one line."""
        require_extras("a diagnosis", DIAGNOSIS_EXTRA)
        # The order is a file, because a command line has a limit of length and shows in the list of
        # processes.
        orders = Path(order.folder) / "order.json"
        orders.write_text(json.dumps(dataclasses.asdict(order)), encoding="utf-8")
        # stderr goes to a file: a full pipe that nobody reads would block the process.
        trouble = Path(order.folder) / "trouble.txt"
        with (
            trouble.open("wb") as heard,
            subprocess.Popen(
                [sys.executable, *JOB_ARGUMENTS, str(orders)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=heard,
                # One thread for each numerical library leaves the cores to the control loop and the
                # screen.
                env=os.environ | ONE_THREAD_VARIABLES,
                start_new_session=True,
                text=True,
            ) as child,
        ):
            stop.call_on_stop(child.kill)
            done, why = False, ""
            asked: ImportNeedsAnswersError | None = None
            assert child.stdout is not None
            for line in child.stdout:
                # A line that is no JSON, e.g. a library's print, is skipped.
                with contextlib.suppress(ValueError):
                    said = json.loads(line)
                    if "share" in said:
                        tell(float(said["share"]), str(said["stage"]))
                    if "questions" in said:
                        asked = ImportNeedsAnswersError(
                            tuple(map(str, said["questions"])), str(said["import_file"])
                        )
                    done, why = bool(said.get("done", done)), str(said.get("error", why))
        # The stop comes first: a killed process also ends with an error, which is not what
        # happened.
        if stop.is_set():
            raise WorkStopped
        if asked is not None:
            raise asked
        if not done:
            lines = trouble.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            raise ValueError(
                why or (lines[-1] if lines else f"the diagnosis ended with code {child.returncode}")
            )

    def _make_job_folder(self) -> Path:
        # The last line of a Python traceback states the exception.
        if self._scratch is None:
            self._scratch = tempfile.TemporaryDirectory(prefix="topdress-")
        # Each order has a folder of its own, so that two results never mix their files.
        self._made += 1
        folder = Path(self._scratch.name) / str(self._made)
        folder.mkdir()
        return folder

    def adopt_effects(self, found: DiagnosisView, chosen: Adoption) -> str:
        """Writes the machine file with the chosen effects; returns its path. Raises ValueError."""
        if not found.adoptable:
            raise ValueError(
                "nothing here can be adopted" + "".join(f"; {why}" for why in found.refused)
            )
        offer = find_offer(found, chosen.ids)
        if offer is None:
            # Only a selection for which the diagnosis process wrote a machine file can be adopted.
            raise ValueError(
                f"{', '.join(chosen.ids) or 'nothing'}: not adopted together: pick one of "
                "them at a time"
            )
        if not offer.file:
            raise ValueError("; ".join(offer.refused) or "a machine file with it would be as it is")
        # The machine's id and the date make the name; find_free_path adds a number instead of
        # overwriting.
        return _copy_to_folder(
            Path(found.folder) / offer.file,
            self.own / "machines",
            f"{found.found.data.machine}-{day_clock.read_today().isoformat()}",
            ".yaml",
            _format_choice_comment(found, chosen),
        )

    def describe_last_change(self, machine: str | None) -> tuple[str, ...]:
        """Returns lines on the last change of a machine file; none for an unchanged file."""
        from topdress.console.reports.term_words import compare_side_by_side
        from topdress.control.machine.history import find_last_change

        change = find_last_change(self._load_machine(machine))
        return (
            ()
            if change is None
            else (f"{change.date}, {change.data}", *compare_side_by_side(change))
        )

    def undo_last_change(self, machine: str | None) -> str:
        """Writes the machine file without its last change; returns its path."""
        from topdress.control.machine.history import undo_last_change
        from topdress.drivers.files.config import save_config
        from topdress.drivers.files.config_kinds import MACHINE_KIND

        today = day_clock.read_today().isoformat()
        back = undo_last_change(self._load_machine(machine), date=today)
        path = find_free_path(self.own / "machines", f"{back.id}-{today}", ".yaml")
        path.parent.mkdir(parents=True, exist_ok=True)
        save_config(path, back, MACHINE_KIND)
        return str(path)

    def _load_machine(self, machine: str | None) -> Machine:
        from topdress.drivers.files.config import load_config
        from topdress.drivers.files.config_kinds import MACHINE_KIND

        found: Machine = load_config(machine or self.machine, MACHINE_KIND).model
        return found

    def export_result(self, found: DiagnosisView, what: ExportKind) -> str:
        """Copies the report or the JSON result to the user's folder; returns its path."""
        made = Path(found.folder) / (REPORT_NAME if what == "report" else RESULT_NAME)
        stem = f"{Path(found.source).stem}-diagnosis"
        return _copy_to_folder(
            made, self.own / "reports", stem, ".html" if what == "report" else ".json"
        )

    def write_separating_job(self, found: DiagnosisView) -> str:
        """Writes the separating run as a job file; returns its path. Raises ValueError."""
        from topdress.console.services.separating_run import make_drive
        from topdress.drivers.files.config import load_config, save_config
        from topdress.drivers.files.config_kinds import JOB_KIND, MACHINE_KIND

        run = found.found.next_run
        if run is None or not found.drives:
            raise ValueError("this run has no job file: do it by its steps")
        machine = load_config(self.machine, MACHINE_KIND).model
        drive = make_drive(found.drives, load_config("demo", JOB_KIND).model, machine)
        job = drive.job.model_copy(update={"title": run.plan})
        path = find_free_path(self.own / "jobs", job.id, ".yaml")
        said = (
            f"Separating run, {found.minutes:g} minutes, planned by a diagnosis of "
            f"{found.source}.\n"
        )
        said += run.plan
        # A job file has no orders for shaft, opening and halts, so the comment tells the operator.
        if drive.orders is not None:
            said += (
                "\nShaft, opening and halts are the operator's to set: this file holds "
                "ground, speed and rate."
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        save_config(path, job, JOB_KIND, said)
        return str(path)


def _make_source(path: Path) -> DiagnosisSource:
    """Returns the source at a path. Raises OSError, and ValueError for a file that is neither run
    log, bench table nor importable."""
    status = path.stat()
    kind = _find_source_kind(path)
    # The import is tried last, because it accepts almost any table.
    if kind is None and is_importable(path):
        kind = IMPORT_KIND
    if kind is None:
        raise ValueError(
            f"{path}: neither a run log (column time_s), a bench table nor a log that import reads"
        )
    changed = day_clock.format_file_time(status.st_mtime)
    size = status.st_size
    # Below 100 kB a figure in MB would round to 0.0.
    said = f"{size / 1e6:.1f} MB" if size >= 100_000 else f"{size / 1e3:.1f} kB"
    return DiagnosisSource(str(path), path.name, kind, changed, said, bytes=size)


def _find_source_kind(path: Path) -> str | None:
    """Returns "run" or the kind of a bench table; None for a file that the import may read."""
    # A file in another format is left to the import without being opened.
    if path.suffix.lower() not in (".csv", ".parquet", ".pq"):
        return None
    # This import takes a second and is needed for few files.
    from topdress.drivers.files.file_content import FileContent
    from topdress.drivers.files.imports.import_errors import TableError

    file = FileContent(path)
    try:
        return "run" if not file.foreign else file.bench if file.content_kind == "table" else None
    except TableError:
        return None


def _format_likeliest_cause(found: DiagnosisView) -> str:
    """Returns the likeliest unconfirmed cause with its size; used where this console simulates no
    effect of its own."""
    # The separating run is planned for causes with rivals; a cause without rivals is the
    # substitute.
    known = [cause for cause in found.found.causes if cause.size.value is not None]
    doubtful = [cause for cause in known if list_rivals(cause)] or known
    if not doubtful:
        return ""
    cause = doubtful[0]
    onset = "" if cause.onset_s is None else f"@{cause.onset_s:g}"
    member = "" if cause.member is None else f"#{cause.member}"
    return f"{cause.id}={cause.size.value:.4g}{onset}{member}"


def _format_choice_comment(found: DiagnosisView, chosen: Adoption) -> str:
    """Returns the operator's choice as a comment of the file; empty without a choice."""
    if not chosen.why:
        return ""
    groups = [
        "; ".join((one.id, *(rival for rival, _share in list_rivals(one))))
        for one in list_undecided(found)
    ]
    picked = [one.id for one in list_undecided(found) if one.id in chosen.ids]
    return "".join(
        f"# {line}\n"
        for line in (
            f"Not decided by the data: {' / '.join(groups)}",
            f"The operator picked: {', '.join(picked) or 'none of these'}. Why: "
            f"{' '.join(chosen.why.split())}",
        )
    )


def _copy_to_folder(made: Path, folder: Path, stem: str, ending: str, before: str = "") -> str:
    from topdress.drivers.files.atomic_files import write_atomically

    folder.mkdir(parents=True, exist_ok=True)
    path = find_free_path(folder, stem, ending)
    write_atomically(path, before.encode() + made.read_bytes())
    return str(path)
