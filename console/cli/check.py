"""`topdress check`: is this configuration file right? And the schemas by which editors know the same."""
from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from console.cli.outputs import Force, Output, marked, refuse_collisions
from console.cli.plain_errors import CommandError

if TYPE_CHECKING:
    from pydantic import BaseModel


def check(
    files: Annotated[list[str] | None, typer.Argument(metavar="CFG...", help="Configuration files, or names of shipped "
                                                      "ones.")] = None,
    schema: Annotated[str | None, typer.Option(metavar="KIND", help="Show the JSON schema of a kind of file instead: "
                                               "machine, crop, job, cab, ...")] = None,
    write_schemas: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Write the schemas of all kinds there "
                                                       "instead.")] = None,
    force: Force = False,
) -> None:
    """Check configuration files of any kind; one plain line for each thing that is wrong."""
    if write_schemas is not None:
        refuse_collisions(map(Path, files or ()), _outputs(write_schemas), force)
    if schema is not None:
        typer.echo(schema_text(schema), nl=False)
    if write_schemas is not None:
        write_all(write_schemas)
    if not files and schema is None and write_schemas is None:
        raise CommandError("check: no file given: allowed are configuration files, --schema KIND or --write-schemas "
                           "FOLDER")
    if files:
        _check(files)


def kinds_by_name() -> dict[str, Any]:
    """The kinds of configuration files by the short name of their format."""
    from drivers.files.kinds import KINDS
    return {name.removeprefix("topdress-").partition("/")[0]: kind for name, kind in KINDS.items()}


def schema_text(name: str) -> str:
    """The JSON schema of a kind, by its short name or its format. Raises CommandError."""
    from drivers.files.config import schema
    kinds = kinds_by_name()
    short = name.removeprefix("topdress-").partition("/")[0]
    if short not in kinds:
        raise CommandError(f"--schema {name}: allowed is one of {', '.join(kinds)}")
    return json.dumps(schema(kinds[short]), indent=1, ensure_ascii=False) + "\n"


def _outputs(folder: Path) -> list[Output]:
    return [marked(folder / f"{name}.json", b'"$schema"') for name in kinds_by_name()]


def write_all(folder: Path) -> None:
    """`<kind>.json` for every kind, whole or not at all. Raises OSError."""
    from drivers.files.atomic import write_atomically
    folder.mkdir(parents=True, exist_ok=True)
    for name in kinds_by_name():
        write_atomically(folder / f"{name}.json", schema_text(name))
        typer.echo(folder / f"{name}.json")


def _check(files: list[str]) -> None:
    from drivers.files.config import ConfigError, load_any
    from drivers.files.kinds import CAB, JOB, KINDS, MACHINE
    from drivers.files.setup import wheel_disagreements
    wrong: list[str] = []
    read: list[tuple[Any, Any]] = []
    for file in files:
        try:
            kind, loaded = load_any(file, KINDS)
        except ConfigError as error:
            wrong += error.lines
            continue
        trouble = _of_keymap(loaded.model)
        if trouble:
            wrong.append(f"{loaded.path}: {trouble}")
            continue
        typer.echo(f"{loaded.path}: ok ({kind.format})")
        read.append((kind, loaded))
        if kind is JOB:
            wrong += _map_of(loaded)
        for warning in getattr(loaded.model, "warnings", ()):
            typer.echo(f"{loaded.path}: note: {warning}")
    for kind, machine in read:
        if kind is MACHINE:
            wrong += [line for other, cab in read if other is CAB
                      for line in wheel_disagreements(cab, machine.model, str(machine.path))]
    if wrong:
        raise ConfigError(wrong)


def _map_of(loaded: Any) -> list[str]:
    """Says what of a job's map will not be applied as it stands. Returns what is wrong, a line each."""
    from console.cli.map_notes import told_map
    from drivers.files.config import ConfigError, load
    from drivers.files.kinds import CROP
    from drivers.files.prescriptions.for_job import check_of_job, plants_of_job
    from drivers.files.prescriptions.words import PrescriptionError
    folder = loaded.path.parent
    try:
        crop = load(loaded.model.crop, CROP, beside=folder).model
        told_map(check_of_job(loaded.model, crop.max_rate_kg_ha, folder), str(loaded.path))
        plants_of_job(loaded.model, folder)
    except ConfigError as error:
        return list(error.lines)
    except (PrescriptionError, OSError) as error:
        return [f"{loaded.path}: {error}"]
    return []


def _of_keymap(model: BaseModel) -> str:
    """What is wrong with the keys of a settings file, one line; empty for files of other kinds."""
    from drivers.files.settings import Settings
    if not isinstance(model, Settings) or not model.keymap:
        return ""
    from console.app.settings import keymap_problem
    return keymap_problem(model.keymap)
