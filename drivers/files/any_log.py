"""How is a log of any program opened as a run log: our own as it is, another's through the
import file next to it, else where nothing is unsure?"""

from __future__ import annotations

import shlex
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from topdress.drivers.files.columns import Columns
from topdress.drivers.files.file_sniffer import what_is
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.log_store import is_store
from topdress.drivers.files.opened import Opened
from topdress.drivers.files.read_log import RunLog, log_of, read_rows
from topdress.drivers.files.run_meta import RunMeta

# Import file of a single log, and of a folder (docs/import.md).
OWN, OF_FOLDER = ".import.yaml", "import.yaml"


def import_file(log: Path) -> Path | None:
    """Returns `LOG.import.yaml` next to LOG.csv, else `import.yaml` in its folder; None where
    there is neither."""
    for place in (log.with_suffix(OWN), log.with_name(OF_FOLDER)):
        if place.is_file() and place != log:
            return place
    return None


if TYPE_CHECKING:
    from topdress.drivers.files.imports.join import JoinedFiles
    from topdress.drivers.files.imports.mapping import ImportFile
    from topdress.drivers.files.imports.raw import RawTable

# Suffixes of texts; other kinds under these names are refused.
TEXTS = frozenset({".csv", ".txt", ".tsv"})
# Kinds of files that often get such a name.
NO_TEXTS = ("zip", "kmz", "excel", "office", "parquet", "gzip")


def open_log(path: Path, without: Collection[str] = ()) -> RunLog:
    """Opens a log of any program as a run log.

    Parameters
    ----------
    path : the log.
    without : columns that need not be read.

    Returns
    -------
    the log; times and numbers as our own.

    Raises
    ------
    TableError : the log cannot be used, or the import is not sure of all (with the open questions).
    OSError : it cannot be opened.
    """
    if path.is_file() and path.suffix.lower() in TEXTS and (kind := what_is(path)).id in NO_TEXTS:
        raise TableError(path, f"{kind.words} by another name: allowed is its own suffix")
    file = Opened(path)
    if not file.foreign:
        try:
            return read_rows(path, without)
        except TableError:
            if is_store(path) or "time_s" in [name.strip().lower() for name in file.names]:
                # our own; of another's with names as ours the import knows more
                raise
    raw, mapping, said_by = raw_and_mapping(path)
    # Imported here: our own logs need no import.
    from topdress.drivers.files.imports.log_file import build_run_log

    imported = _converted(raw, mapping)
    log = build_run_log(path, imported, mapping, said_by)
    # Findings of the import first, each once.
    odd = (*(one for part in imported.parts for one in part.findings), *imported.findings)
    return replace(log, findings=(*odd, *(one for one in log.findings if one not in odd)))


def imported_columns(path: Path, raw: RawTable, mapping: ImportFile) -> Columns:
    """Returns the columns that `open_log` would give for lines of a log, whose sidecar wants all
    of it. Raises TableError."""
    from topdress.drivers.files.imports.log_file import build_read_columns

    return log_of(path, build_read_columns(_converted(raw, mapping)), RunMeta()).columns


def _converted(raw: RawTable, mapping: ImportFile) -> JoinedFiles:
    from topdress.drivers.files.imports.convert import convert_table
    from topdress.drivers.files.imports.join import join_files

    return join_files([convert_table(raw, mapping)], mapping.join)


def raw_and_mapping(
    path: Path, data: bytes | None = None
) -> tuple[RawTable, ImportFile, Path | None]:
    """Reads a table with the import file next to it, or with a guess in which nothing is unsure.

    Parameters
    ----------
    path : the log.
    data : lines of it, in place of the whole file.

    Returns
    -------
    table, mapping, and the import file's path (None : guessed).

    Raises
    ------
    LogImportError : the table cannot be read, or the guess is unsure.
    ConfigError : the import file is wrong.
    OSError : a file cannot be opened.
    """
    from topdress.drivers.files.imports.import_errors import UnsureImportError
    from topdress.drivers.files.imports.read import read_raw_table

    place = import_file(path)
    if place is not None:
        from topdress.drivers.files.config import load
        from topdress.drivers.files.imports.mapping import IMPORT

        mapping = load(place, IMPORT).model
        return read_raw_table(path, mapping.source, data), mapping, place
    from topdress.drivers.files.imports.guess import guess_import_file

    raw = read_raw_table(path, None, data)
    found = guess_import_file(raw)
    if not found.is_sure:
        raise UnsureImportError(
            path,
            *found.questions,
            f"not opened: topdress import {shlex.quote(str(path))} --guess writes "
            "an import file in which these lines can be put right",
        )
    return raw, found.mapping, None
