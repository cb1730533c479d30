"""How does `topdress check` report errors of configuration files, and write the schemas for
editors?
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from topdress.console.cli.outputs import ForceOption, make_marked_output, refuse_collisions
from topdress.console.cli.plain_errors import CommandError
from topdress.console.cli.plain_output import AsJson, print_json
from topdress.drivers import day_clock
from topdress.drivers.files.config_error import ConfigError

# The machine of a job without another machine file, as for `topdress` itself.
SHIPPED_MACHINE = "huanghai"
# Name of the schema of a run log's row.
RUN_LOG = "run-log"

if TYPE_CHECKING:
    from pydantic import BaseModel


def check_files(
    files: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="CFG...",
            help="Configuration files, or names of shipped "
            "ones; or task files (ISOXML): what is in "
            "them.",
        ),
    ] = None,
    schema: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="Show the JSON schema of a kind of file instead: machine, crop, job, cab, ...",
        ),
    ] = None,
    write_schemas: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Write the schemas of all kinds there instead."),
    ] = None,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Check configuration files of any kind; one plain line for each thing that is wrong."""
    # Collisions are found before anything is written: either all schemas are written or none.
    if write_schemas is not None:
        outputs = [
            make_marked_output(write_schemas / f"{name}.json", b'"$schema"')
            for name in list_kinds_by_name()
        ]
        refuse_collisions(map(Path, files or ()), outputs, force)
    if schema is not None:
        # The schema ends with a newline of its own.
        typer.echo(format_schema(schema), nl=False)
    if write_schemas is not None:
        write_all_schemas(write_schemas)
    if not files and schema is None and write_schemas is None:
        raise CommandError(
            "check: no file given: allowed are configuration files, --schema KIND or "
            "--write-schemas "
            "FOLDER"
        )
    if files:
        _check_named_files(files, as_json)


def list_kinds_by_name() -> dict[str, Any]:
    """Returns the kinds of configuration files by the short name of their format."""
    from topdress.drivers.files.config_kinds import CONFIG_KINDS

    return {
        # "topdress-job/1" becomes "job", the word that a user types.
        name.removeprefix("topdress-").partition("/")[0]: kind
        for name, kind in CONFIG_KINDS.items()
    }


def format_schema(name: str) -> str:
    """Returns the JSON schema of a kind, or of a row of a run log, by its short name or its format.
    Raises CommandError."""
    from topdress.control.log_row import make_row_schema
    from topdress.drivers.files.config import make_json_schema

    kinds = list_kinds_by_name()
    short = name.removeprefix("topdress-").partition("/")[0]
    if short not in (*kinds, RUN_LOG):
        raise CommandError(f"--schema {name}: allowed is one of {', '.join((*kinds, RUN_LOG))}")
    schema = make_row_schema() if short == RUN_LOG else make_json_schema(kinds[short])
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def write_all_schemas(folder: Path) -> None:
    """Writes `<kind>.json` for every kind, completely or not at all. Raises OSError."""
    from topdress.drivers.files.atomic_files import write_atomically

    folder.mkdir(parents=True, exist_ok=True)
    for name in list_kinds_by_name():
        write_atomically(folder / f"{name}.json", format_schema(name))
        typer.echo(folder / f"{name}.json")


def _check_named_files(files: list[str], as_json: bool) -> None:
    from topdress.drivers.files.config_kinds import CAB_KIND, JOB_KIND, MACHINE_KIND
    from topdress.drivers.files.run_setup import find_disagreements

    wrong: list[str] = []
    notes: list[str] = []
    # Every file is read before the report, so one run lists all faults.
    read = [found for file in files if (found := _read_file(file, notes, wrong)) is not None]
    jobs, cabs, machines = (
        [one for kind, one in read if kind is wanted]
        for wanted in (JOB_KIND, CAB_KIND, MACHINE_KIND)
    )
    wrong += [line for job in jobs for line in _check_cab_heads(job, cabs)]
    # Jobs are checked on the machines of this command, else on the shipped one, as a start would
    # do.
    machine_files = [str(machine.path) for machine in machines] or [SHIPPED_MACHINE]
    notes += [
        line for job in jobs for file in machine_files for line in _check_job_rates(job, file)
    ]
    for machine in machines:
        notes += _check_products(machine.model, jobs)
        wrong += [
            line
            for cab in cabs
            for line in find_disagreements(cab, machine.model, str(machine.path))
        ]
    # The format of each file is listed, so that a mistaken kind is noticed.
    ok = [{"path": loaded.path, "format": kind.format} for kind, loaded in read]
    if as_json:
        print_json({"ok": ok, "notes": notes, "wrong": wrong})
    else:
        for line in (*("{path}: ok ({format})".format(**one) for one in ok), *notes):
            typer.echo(line)
    # The faults come last and raise, so that the exit code is 2 and the notes are printed before.
    if wrong:
        raise ConfigError(wrong)


def _read_file(file: str, notes: list[str], wrong: list[str]) -> tuple[Any, Any] | None:
    """Returns kind and content of one configuration file; None for a task file, and for a wrong
    file. Appends a line to `notes` or `wrong` for each finding."""
    from topdress.drivers.files.config import load_any_config
    from topdress.drivers.files.config_kinds import CONFIG_KINDS, JOB_KIND

    _refuse_no_configuration(Path(file))
    # An ISOXML file is no configuration, but people check what a folder of tasks contains.
    if (lines := _list_task_content(Path(file))) is not None:
        notes += lines
        return None
    try:
        kind, loaded = load_any_config(file, CONFIG_KINDS)
    except ConfigError as error:
        wrong += error.lines
        return None
    # The keys need the console's own names of actions, which the file format does not know.
    if trouble := _find_keymap_fault(loaded.model):
        wrong.append(f"{loaded.path}: {trouble}")
        return None
    # Only some kinds of files have warnings.
    own = list(getattr(loaded.model, "warnings", ()))
    if kind is JOB_KIND:
        own = [*_find_job_notes(loaded), *own]
        wrong += _check_job_files(loaded, own)
    notes += [f"{loaded.path}: note: {line}" for line in own]
    return kind, loaded


def _refuse_no_configuration(path: Path) -> None:
    """Raises WrongKindError for a file that is no configuration, and for a name that is neither a
    file nor shipped."""
    from topdress.console.cli.inputs import CHECKED_KINDS, refuse_other_kinds

    # A bare name can be a shipped file, which has no path here.
    if path.exists() or path.suffix.lower() not in ("", ".yaml", ".yml") or len(path.parts) > 1:
        refuse_other_kinds([path], CHECKED_KINDS)
    if path.suffix.lower() in (".csv", ".tsv", ".xlsx"):
        raise CommandError(
            f"{path}: this is a table (topdress import and diagnose read it): allowed here is "
            f"{CHECKED_KINDS.words}"
        )


def _list_task_content(path: Path) -> list[str] | None:
    """Returns the contents of a task file, its folder or its zip, one line each; None for any other
    file."""
    if not path.is_dir() and not (path.suffix.lower() in (".xml", ".zip") and path.is_file()):
        return None
    from topdress.drivers.files.imports.task_log import describe_task_file

    return describe_task_file(path)


def _check_job_files(loaded: Any, notes: list[str]) -> list[str]:
    """Notes the parts of a job's map that will not be applied unchanged, also because of its
    ceiling. Returns the faults of the files that the job names, one line each."""
    from topdress.console.app.pages.job.map_words import describe_map_check
    from topdress.console.app.units import METRIC
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import CROP_KIND
    from topdress.drivers.files.prescriptions.job_targets import find_map_check, read_job_plants
    from topdress.drivers.files.run_setup import find_year_nitrogen, load_job_product
    from topdress.drivers.plain_text import RefusedInput

    folder = loaded.path.parent

    def check_job_map() -> None:
        crop = load_config(loaded.model.crop, CROP_KIND, base=folder).model
        # The ceiling of the year lowers the limit, so rates above it are noted too.
        n_year = find_year_nitrogen(loaded, crop, day_clock.read_today())
        limited = crop if n_year is None else crop.limit_rates(n_year.most_kg_ha)
        if (found := find_map_check(loaded.model, limited.max_rate_kg_ha, folder)) is not None:
            notes.extend(describe_map_check(found, METRIC))

    wrong: list[str] = []
    looks: tuple[Callable[[], object], ...] = (
        check_job_map,
        lambda: read_job_plants(loaded.model, folder),
        lambda: load_job_product(loaded.model, folder),
    )
    # Each part is tried by itself, so that a faulty map does not hide faulty plants.
    for look in looks:
        try:
            look()
        except ConfigError as error:
            wrong += error.lines
        except (RefusedInput, OSError) as error:
            wrong.append(f"{loaded.path}: {error}")
        except ValueError as error:
            wrong.append(str(error))
    return wrong


def _find_job_notes(loaded: Any) -> list[str]:
    """Returns notes on a job before work: missing or doubtful strips, and the crop's stage."""
    from topdress.control.agronomy.reference_strips import calc_measured_index, find_index_doubt
    from topdress.drivers.files.run_setup import describe_growth, load_setup

    try:
        setup = load_setup(SHIPPED_MACHINE, loaded.path, day_clock.read_today())
    # The error is reported with the crop, or when the job is started.
    except ConfigError:
        return []
    found = [describe_growth(setup.growth), "" if setup.n_year is None else setup.n_year.text]
    target = loaded.model.target
    # A silent display stops the spreading by default, which a driver may not expect.
    if target.source == "external" and target.external_silent_kg_ha is None:
        found.append(
            "source external: nothing is spread while the other display is silent; "
            "target.external_silent_kg_ha may say how much is"
        )
    rule = setup.rule
    lowest = (
        f"{setup.crop.min_rate_kg_ha:g} kg/ha" if setup.crop.min_rate_kg_ha > 0.0 else "nothing"
    )
    if rule.response_rule == "field":
        index = calc_measured_index(rule.strip_ndvi)
        # The texts of a doubtful index exist only here: before work nothing else warns of it.
        said = {
            "below_1": f"response index {index or 0.0:.2f}: no response, {lowest} will be given",
            "above_3": f"response index {index or 0.0:.2f}: above 3 is not to be believed",
        }
        found.append(said.get(find_index_doubt(rule.strip_ndvi), ""))
        if index is None:
            found.append(
                "response index of the field: strips missing yet: mark both on the way; "
                "until then the "
                f"{'fixed yield' if rule.is_ready else 'fallback rate'} holds"
            )
    elif rule.crop.sufficiency is not None and not rule.is_ready:
        found.append(
            "sufficiency index: N-rich strip missing yet: mark it on the way; until then "
            "the fallback rate "
            "holds"
        )
    return [line for line in found if line]


def _check_cab_heads(job: Any, cabs: list[Any]) -> list[str]:
    """Returns notes on whether the heads of each cab, or without a cab the simulated heads, have
    the index that the job's crop needs."""
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import CROP_KIND
    from topdress.drivers.files.run_setup import find_index_disagreements

    try:
        crop = load_config(job.model.crop, CROP_KIND, base=job.path.parent).model
    # The error is reported with the job.
    except ConfigError:
        return []
    return [
        # Without a cab file the heads of the simulated machine are compared.
        line
        for cab in cabs or [None]
        for line in find_index_disagreements(cab, crop, job.model)
    ]


def _check_job_rates(job: Any, machine_file: str) -> list[str]:
    """Returns notes on the rates of a job that the machine of a file cannot apply."""
    from topdress.console.cli.check_range import find_range_notes
    from topdress.drivers.files.run_setup import load_setup

    # Unreadable files are reported with the job.
    with suppress(ConfigError, ValueError, OSError):
        setup = load_setup(machine_file, job.path, day_clock.read_today())
        return [f"{job.path}: note: {line}" for line in find_range_notes(setup)]
    return []


def _check_products(machine: Any, jobs: list[Any]) -> list[str]:
    """Returns notes on the jobs' products on this machine."""
    from topdress.drivers.files.run_setup import describe_product, load_job_product

    found = []
    for job in jobs:
        # The error is reported with the job.
        with suppress(ConfigError):
            product = load_job_product(job.model, job.path.parent)
            note = "" if product is None else describe_product(product.model, machine)
            found += [f"{job.path}: note: {note}"] if note else []
    return found


def _find_keymap_fault(model: BaseModel) -> str:
    """Returns the fault of the keys of a settings file, one line; empty for files of other
    kinds."""
    from topdress.drivers.files.settings import Settings

    if not isinstance(model, Settings) or not model.keymap:
        return ""
    # The import comes late, since it loads the console's screens.
    from topdress.console.app.settings import find_keymap_fault

    return find_keymap_fault(model.keymap)
