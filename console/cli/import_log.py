"""How does `topdress import` convert the log of any machine to a run log, and write a first import
file with --guess?
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer
from topdress.console.cli.inputs import LOG_KINDS, load_machine, refuse_other_kinds, require_suffix
from topdress.console.cli.outputs import (
    ForceOption,
    Output,
    list_log_files,
    list_new_log_files,
    refuse_collisions,
)
from topdress.console.cli.plain_errors import CommandError, print_note_lines
from topdress.console.cli.plain_output import AsJson, print_json

# Type checking only: the importers load their readers when a file is read.
if TYPE_CHECKING:
    from topdress.drivers.files.imports.guess_result import ImportGuess
    from topdress.drivers.files.imports.mapping import ImportFile
    from topdress.drivers.files.imports.raw_table import RawTable


# The answer as data, and as lines.
_ImportAnswer = tuple[dict[str, Any], list[str]]


class _ImportOptions(NamedTuple):
    """Holds the options of the command line: `source` of an import file, and the full value of each
    drive's columns."""

    said: dict[str, str]
    full: dict[str, float]


def run_import(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Text tables of any dialect, Excel, GeoJSON or "
            "shapefile of points, ISOXML task with a time log, Parquet.",
        ),
    ],
    *,
    mapping: Annotated[
        Path | None,
        typer.Option(
            metavar="M.yaml",
            help="Import file: what the columns mean. With "
            "--guess: where to write it; default: by the output or file.",
        ),
    ] = None,
    guess: Annotated[
        bool,
        typer.Option(
            "--guess", help="Write a first import file, what is unsure marked; import nothing."
        ),
    ] = False,
    machine: Annotated[
        str | None,
        typer.Option(
            metavar="MACHINE",
            help="Machine file, or name of a shipped one: what "
            "100 % or the full count of a command is, where the file does not "
            "say.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG.csv",
            help="The run log; its sidecar is written next to it. "
            "LOG.parquet: all in one small file; a run log becomes one too, and is "
            "read back equal.",
        ),
    ] = None,
    inside: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Of a zip or folder with several: the task set or shapefile."
        ),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(
            metavar="TASK",
            help="Of a task set with several that were worked: its id "
            "or title; all its time logs are joined.",
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            metavar="DEVICE", help="Only what this device of a task set logged: its id or name."
        ),
    ] = None,
    log: Annotated[
        str | None,
        typer.Option("--log", metavar="TLG", help="One time log of a task set: TLG00001."),
    ] = None,
    values_from: Annotated[
        str | None,
        typer.Option(
            metavar="ddi|presentation",
            help="Where a device contradicts the data dictionary on what a rate is worth.",
        ),
    ] = None,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Bring in the log of any machine: a run log that diagnose and replay read."""
    twice = next(
        (
            path
            for k, path in enumerate(files)
            if path.resolve() in [one.resolve() for one in files[:k]]
        ),
        None,
    )
    # Resolved paths also find a file that is named through a link.
    if twice is not None:
        raise CommandError(
            f"{twice}: named twice: allowed is each file once, for its rows would count twice"
        )
    # A machine or job file among the logs gets a message with the command that reads it.
    refuse_other_kinds(files, LOG_KINDS)
    given = _ImportOptions(
        _check_source_options(inside, task, device, log, values_from), _find_full_values(machine)
    )
    if guess:
        # With --guess --out LOG.csv names the later log, and the import file lies next to it.
        is_log = out is not None and out.suffix.lower() in (".csv", ".parquet", ".pq")
        option = "--mapping" if mapping is not None else "--out"
        require_suffix(option, mapping or (None if is_log else out), ".yaml", ".yml")
        found, lines = _write_guess(files, _choose_guess_path(files, mapping, out), given, force)
    elif out is None:
        raise CommandError("import: no --out LOG.csv given; --guess writes a first import file")
    # A log of topdress needs no mapping: its columns already have their names and units.
    elif _is_format_copy(files, mapping, out):
        found, lines = _copy_log(files[0], out, force)
    else:
        found, lines = _import_files(files, mapping, out, given, force)
    if as_json:
        print_json(found)
    else:
        typer.echo("\n".join(lines))


def _check_source_options(
    inside: str | None,
    task: str | None,
    device: str | None,
    log: str | None,
    values_from: str | None,
) -> dict[str, str]:
    """Returns the options about reading, as `source` of an import file has them."""
    # A device description can contradict the dictionary of ISO 11783; the user decides which holds.
    if values_from not in (None, "ddi", "presentation"):
        raise CommandError(f"--values-from {values_from}: allowed ddi, presentation")
    given = {
        "inside": inside,
        "task": task,
        "device": device,
        "task_log": log,
        "values_from": values_from,
    }
    # Options that are not given must not replace values of the import file.
    return {name: value for name, value in given.items() if value is not None}


def _choose_guess_path(files: list[Path], mapping: Path | None, out: Path | None) -> Path:
    if mapping is not None:
        return mapping
    if out is not None and out.suffix.lower() in (".yaml", ".yml"):
        return out
    next_to = out if out is not None else files[0]
    return next_to.with_name(f"{next_to.stem}.import.yaml")


def _find_full_values(machine: str | None) -> dict[str, float]:
    """Returns the full value of each drive's columns, by a machine file."""
    if machine is None:
        return {}
    # A command in percent or counts becomes r/min or mm only by the machine's full value.
    limits = load_machine(machine).limits
    return {
        "shaft_rpm_cmd": limits.shaft_high_rpm,
        "shaft_rpm": limits.shaft_high_rpm,
        "opening_mm_cmd": limits.opening_high_mm,
        "opening_mm": limits.opening_high_mm,
    }


def _write_guess(
    files: list[Path], place: Path, given: _ImportOptions, force: bool
) -> _ImportAnswer:
    from topdress.drivers.files.atomic_files import write_atomically
    from topdress.drivers.files.imports.guess_result import format_first_import

    # The guess reads the files, so an output among them would destroy its own input.
    refuse_collisions(_list_read_files(files), [Output((place,))], force)
    raw, found = _guess_import(files, given)
    write_atomically(place, format_first_import(found, files, place))
    questions = [*found.questions, *_list_element_notes(raw)]
    return (
        {"path": place, "unsure": found.unsure, "questions": questions},
        [f"{place}: {found.unsure}", *(f"{raw.path}: {line}" for line in questions)],
    )


def _list_element_notes(raw: RawTable) -> list[str]:
    """Returns notes on the machine parts in columns' names, where a question about them is open."""
    return [str(finding) for finding in raw.findings if finding.id == "elements"]


def _guess_import(files: list[Path], given: _ImportOptions) -> tuple[RawTable, ImportGuess]:
    from topdress.drivers.files.imports.guess import guess_import_file
    from topdress.drivers.files.imports.mapping import Source
    from topdress.drivers.files.imports.table_reader import read_raw_table

    # The first file alone is guessed: files of one import have the same columns.
    raw = read_raw_table(files[0], Source.model_validate(given.said))
    return raw, guess_import_file(raw, given.full)


def _list_read_files(files: list[Path]) -> list[Path]:
    """Returns the files with the companions of a shapefile and the files of a task."""
    from topdress.drivers.files.archives import list_opened_files

    return [one for path in files for one in list_opened_files(path)]


def _import_files(
    files: list[Path], mapping_file: Path | None, out: Path, given: _ImportOptions, force: bool
) -> _ImportAnswer:
    from topdress.drivers.files.columns import count_rows
    from topdress.drivers.files.imports.convert import convert_table
    from topdress.drivers.files.imports.log_file import is_import_of, write_imported_log
    from topdress.drivers.files.imports.log_join import join_files
    from topdress.drivers.files.imports.table_reader import read_raw_table

    reads = [*_list_read_files(files), *([] if mapping_file is None else [mapping_file])]
    # A log that an earlier import of these files wrote may be replaced without --force.
    refuse_collisions(
        reads, [Output(_list_written_files(out), lambda: is_import_of(out, files))], force
    )
    first, mapping = _read_or_guess_mapping(files, mapping_file, given)
    parts = [
        convert_table(
            # The first file is read already for the guess and is not read twice.
            read_raw_table(path, mapping.source) if first is None or path != files[0] else first,
            mapping,
        )
        for path in files
    ]
    # The parts are joined in time, since one drive may fill several files.
    log = join_files(parts, mapping.join)
    print_note_lines(
        (
            *(f"{part.raw.path}: {found}" for part in log.parts for found in part.findings),
            *log.findings,
        )
    )
    # The import file is stored with the log, so that the origin of each column stays known.
    columns = write_imported_log(out, log, mapping, mapping_file)
    rows, seconds = count_rows(columns), float(columns["time_s"][-1])
    return (
        {"path": out, "rows": rows, "duration_s": seconds, "columns": list(columns)},
        [f"{out}: {rows} rows, {seconds:.0f} s; columns {', '.join(columns)}"],
    )


def _list_written_files(out: Path) -> tuple[Path, ...]:
    from topdress.drivers.files.log_store import STORE_SUFFIXES

    if out.suffix.lower() in STORE_SUFFIXES:
        return (out,)
    if out.suffix != ".csv":
        raise CommandError(f"--out {out}: allowed is a name that ends in .csv or .parquet")
    return list_new_log_files(out)


def _is_format_copy(files: list[Path], mapping: Path | None, out: Path) -> bool:
    """Returns whether a run log is only converted to the other format: text to Parquet, or
    topdress's Parquet to text."""
    from topdress.drivers.files.file_content import FileContent
    from topdress.drivers.files.log_store import STORE_SUFFIXES, is_log_store

    if mapping is not None or len(files) != 1 or not files[0].exists():
        return False
    if is_log_store(files[0]):
        # A Parquet file of topdress holds columns and sidecar and converts back without loss.
        return True
    return out.suffix.lower() in STORE_SUFFIXES and not FileContent(files[0]).foreign


def _copy_log(source: Path, out: Path, force: bool) -> _ImportAnswer:
    from topdress.drivers.files.log_store import STORE_SUFFIXES, write_log_store, write_log_text
    from topdress.drivers.files.read_log import read_nonempty_log

    refuse_collisions(list_log_files(source), [Output(_list_written_files(out))], force)
    log = read_nonempty_log(source)
    print_note_lines(log.findings, f"{source}: ")
    if out.suffix.lower() in STORE_SUFFIXES:
        write_log_store(out, log.columns, log.meta, log.findings)
    else:
        write_log_text(out, log.columns, log.meta)
    return (
        {"path": out, "rows": len(log), "duration_s": log.duration_s, "columns": list(log.columns)},
        [f"{out}: {len(log)} rows, {log.duration_s:.0f} s, {out.stat().st_size / 1e6:.1f} MB"],
    )


def _read_or_guess_mapping(
    files: list[Path], place: Path | None, given: _ImportOptions
) -> tuple[RawTable | None, ImportFile]:
    """Returns the import file; without one, a guess in which nothing is unsure, with the table of
    the guess."""
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.imports.import_errors import LogImportError
    from topdress.drivers.files.imports.mapping import IMPORT_KIND

    if place is not None:
        mapping = load_config(place, IMPORT_KIND).model
        # Options of the command line take precedence over the import file.
        return None, mapping.model_copy(
            update={"source": mapping.source.model_copy(update=given.said)}
        )
    raw, found = _guess_import(files, given)
    # A guess with open questions writes no log: wrong units would look like a fault of the machine.
    if not found.is_sure:
        raise LogImportError(
            raw.path,
            *found.questions,
            *_list_element_notes(raw),
            "not imported: --guess writes an import file in which these lines can be put right",
        )
    return raw, found.mapping
