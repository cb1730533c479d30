"""Which files will a command write? They are compared with the files that it reads and with
existing files before anything is done.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, NamedTuple

import typer
from topdress.console.cli.plain_errors import CommandError

ForceOption = Annotated[
    bool, typer.Option("--force", help="Replace what is there already (never what is read).")
]

SEARCHED_BYTES = 65_536


class Output(NamedTuple):
    """Names files that are written together.

    `earlier` returns whether the existing files are an earlier output of the same command, which
    can be made again and is replaced silently.
    """

    files: tuple[Path, ...]
    earlier: Callable[[], bool] = lambda: False


def make_marked_output(file: Path, mark: bytes, with_it: Iterable[Path] = ()) -> Output:
    """Returns an output whose earlier versions have `mark` in the beginning of `file`."""
    return Output((file, *with_it), lambda: _has_mark(file, mark))


def refuse_collisions(reads: Iterable[Path], writes: Iterable[Output], force: bool) -> None:
    """Raises CommandError where a file that is read would be overwritten, two outputs have one
    path, or a file exists and `force` is False.

    Files are compared by identity: links, relative paths and other spellings of a name are the same
    file.
    """
    read = {identity: path for path in reads if (identity := _find_file_identity(path)) is not None}
    taken: dict[str, Path] = {}
    for output in writes:
        for file in output.files:
            identity = _find_file_identity(file)
            source = None if identity is None else read.get(identity)
            if source is not None:
                same = "" if source == file else f", the same file as {source}"
                raise CommandError(
                    f"{file}: would be written over, and is read{same}: allowed is another place"
                )
            # A missing file can only be compared by its name.
            place = str(file.resolve()).casefold()
            if place in taken:
                raise CommandError(f"{file}: two outputs go there: allowed is a place for each")
            taken[place] = file
        there = next((file for file in output.files if os.path.lexists(file)), None)
        if there is not None and not force and not output.earlier():
            raise CommandError(
                f"{there}: exists already: nothing is overwritten (--force replaces it)"
            )


def list_log_files(log: Path) -> tuple[Path, Path]:
    """Returns a run log and its sidecar."""
    return log, log.with_suffix(".yaml")


def list_new_log_files(log: Path) -> tuple[Path, Path]:
    """Returns a new run log and its sidecar. Raises CommandError for a name without the suffix of a
    log."""
    if log.suffix != ".csv":
        raise CommandError(f"--out {log}: allowed is a name that ends in .csv")
    return list_log_files(log)


def find_machine_file(where: str) -> Path:
    """Returns the machine file of a shipped name or path. Raises ConfigError."""
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    return find_named_file(where, MACHINE_KIND.folder)


def find_named_file(where: str, folder: str) -> Path:
    """Returns the configuration file of a shipped name or path. Raises ConfigError."""
    from topdress.drivers.files.config import resolve_config_path

    return resolve_config_path(where, [folder])


def _find_file_identity(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_dev, found.st_ino


def _has_mark(file: Path, mark: bytes) -> bool:
    try:
        with file.open("rb") as opened:
            return mark in opened.read(SEARCHED_BYTES)
    except OSError:
        return False
