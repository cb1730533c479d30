"""Which kinds of files and suffixes does a command accept? They are checked before the command does
anything.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer
from topdress.console.cli.plain_errors import CommandError
from topdress.drivers.files.formats.registry import describe_able, list_kinds

if TYPE_CHECKING:
    from topdress.control.machine.machine import Machine

JobName = Annotated[str, typer.Option(metavar="JOB", help="Job file, or name of a shipped one.")]
PlantedEffects = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ID=SIZE[@ONSET_S][#MEMBER]",
        help="Plant an effect that the controller does not know (repeatable).",
    ),
]
MachineName = Annotated[
    str, typer.Option(metavar="MACHINE", help="Machine file, or name of a shipped one.")
]

PDF_HINT = "a browser prints that page to a PDF"


class AcceptedKinds(NamedTuple):
    """Names the files that a command reads. `kinds` are ids of `file_sniffer`, `words` the
    description for people."""

    kinds: tuple[str, ...]
    words: str


LOG_KINDS = AcceptedKinds(
    (*list_kinds("read_table"), "empty"),
    f"a log: a table, points, or a task that was worked ({describe_able('read_table')})",
)
TABLE_FILE_KINDS = AcceptedKinds(("text", "excel", "empty"), "a bench table (CSV, Excel)")
RUN_LOG_KINDS = AcceptedKinds(("text", "excel", "parquet", "empty"), "a run log (CSV, Parquet)")
MAP_FILE_KINDS = AcceptedKinds(
    list_kinds("read_map", "read_table"),
    f"a prescription ({describe_able('read_map')}), or a log of work done",
)
CHECKED_KINDS = AcceptedKinds(
    ("config", "text", "task", "zip", "folder", "empty"),
    "a configuration file, or an ISOXML task file",
)
CAPTURE_KINDS = AcceptedKinds(
    ("text", "nmea", "capture", "json", "binary", "empty"), "the capture of a device, as received"
)


def refuse_other_kinds(files: Iterable[Path], reads: AcceptedKinds) -> None:
    """Raises WrongKindError in one line for a missing file, or a file of another kind; OSError."""
    from topdress.drivers.files.file_sniffer import refuse_kind

    for file in files:
        refuse_kind(file, reads.kinds, reads.words)


def load_machine(name: str) -> Machine:
    """Returns the machine of a machine file, or of the name of a shipped file. Raises
    ConfigError."""
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    return load_config(name, MACHINE_KIND).model


def require_suffix(option: str, path: Path | None, *endings: str) -> None:
    """Raises CommandError for a name with another suffix, before anything is read or written."""
    if path is not None and str(path) != "-" and path.suffix.lower() not in endings:
        said = "a folder, or a name" if "" in endings else "a name"
        how = f": {PDF_HINT}" if path.suffix.lower() == ".pdf" and ".html" in endings else ""
        raise CommandError(
            f"{option} {path}: allowed is {said} that ends in "
            f"{' or '.join(filter(None, endings))}{how}"
        )


def refuse_run_log(table: Path, command: str) -> None:
    """Raises CommandError for a run log where a bench table is needed."""
    from topdress.drivers.files.file_content import FileContent

    if FileContent(table).content_kind == "log":
        raise CommandError(
            f"{table}: this is a run log (topdress diagnose reads it, topdress calibrate wheel and "
            f"heads too): allowed for {command} is a bench table"
        )


def refuse_bench_table(log: Path, command: str) -> None:
    """Raises CommandError for a bench table where a run log is needed."""
    from topdress.drivers.files.file_content import FileContent

    file = FileContent(log)
    if file.is_table and file.content_kind == "table":
        raise CommandError(
            f"{log}: this is a bench table ({file.bench}; topdress diagnose reads it, "
            "calibrate lag "
            f"and catch fit it): allowed for {command} is a run log"
        )
