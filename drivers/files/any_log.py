"""How is a log of any program opened as a run log? A topdress log is read directly, a foreign log
by the import file next to it or, if nothing is unsure, by a guess.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from topdress.drivers.files.columns import Columns
from topdress.drivers.files.file_content import FileContent
from topdress.drivers.files.file_sniffer import sniff_file_kind
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.log_store import is_log_store
from topdress.drivers.files.read_log import RunLog, build_log, read_nonempty_log
from topdress.drivers.files.run_meta import RunMeta

# Names of the import file of a single log, and of a folder (docs/import.md).
OWN_IMPORT_SUFFIX, FOLDER_IMPORT_FILE = ".import.yaml", "import.yaml"


def find_import_file(log: Path) -> Path | None:
    """Returns `LOG.import.yaml` next to LOG.csv, else `import.yaml` in its folder; None without
    either."""
    for place in (log.with_suffix(OWN_IMPORT_SUFFIX), log.with_name(FOLDER_IMPORT_FILE)):
        if place.is_file() and place != log:
            return place
    return None


if TYPE_CHECKING:
    from topdress.drivers.files.imports.log_join import JoinedFiles
    from topdress.drivers.files.imports.mapping import ImportFile
    from topdress.drivers.files.imports.raw_table import RawTable

# Suffixes of texts; files of other kinds under these names are refused.
TEXT_SUFFIXES = frozenset({".csv", ".txt", ".tsv"})
# Kinds of files that often carry a text suffix by mistake.
NON_TEXT_KINDS = ("zip", "kmz", "excel", "office", "parquet", "gzip")


def open_any_log(path: Path, without: Collection[str] = ()) -> RunLog:
    """Returns a log of any program as a run log.

    Parameters
    ----------
    path : the log.
    without : columns that need not be read.

    Returns
    -------
    the log, with times and numbers in topdress's own units.

    Raises
    ------
    TableError : the log cannot be used, or the import is unsure (with the open questions).
    OSError : the file cannot be opened.
    """
    if (
        path.is_file()
        and path.suffix.lower() in TEXT_SUFFIXES
        and (kind := sniff_file_kind(path)).id in NON_TEXT_KINDS
    ):
        raise TableError(path, f"{kind.words} by another name: allowed is its own suffix")
    file = FileContent(path)
    if not file.foreign:
        try:
            return read_nonempty_log(path, without)
        except TableError:
            if is_log_store(path) or "time_s" in [name.strip().lower() for name in file.names]:
                # A topdress log that fails is not imported. A foreign log may use the same names,
                # and the import knows more about it.
                raise
    raw, mapping, said_by = read_with_mapping(path)
    # This import is slow and a topdress log does not need it.
    from topdress.drivers.files.imports.log_file import build_run_log

    imported = _convert_and_join(raw, mapping)
    log = build_run_log(path, imported, mapping, said_by)
    # The findings of the import come first, each once.
    odd = (*(one for part in imported.parts for one in part.findings), *imported.findings)
    return replace(log, findings=(*odd, *(one for one in log.findings if one not in odd)))


def convert_log_columns(path: Path, raw: RawTable, mapping: ImportFile) -> Columns:
    """Returns the columns that `open_any_log` would return for some lines of a log whose sidecar
    requests all columns. Raises TableError."""
    from topdress.drivers.files.imports.log_file import build_read_columns

    return build_log(path, build_read_columns(_convert_and_join(raw, mapping)), RunMeta()).columns


def _convert_and_join(raw: RawTable, mapping: ImportFile) -> JoinedFiles:
    from topdress.drivers.files.imports.convert import convert_table
    from topdress.drivers.files.imports.log_join import join_files

    return join_files([convert_table(raw, mapping)], mapping.join)


def read_with_mapping(
    path: Path, data: bytes | None = None
) -> tuple[RawTable, ImportFile, Path | None]:
    """Returns a table with the import file next to it, or with a guess in which nothing is unsure.

    Parameters
    ----------
    path : the log.
    data : some of its lines, which replace the whole file.

    Returns
    -------
    the table, the mapping, and the path of the import file (None for a guess).

    Raises
    ------
    LogImportError : the table cannot be read, or the guess is unsure.
    ConfigError : the import file is wrong.
    OSError : a file cannot be opened.
    """
    from topdress.drivers.files.imports.import_errors import UnsureImportError
    from topdress.drivers.files.imports.table_reader import read_raw_table

    place = find_import_file(path)
    if place is not None:
        from topdress.drivers.files.config import load_config
        from topdress.drivers.files.imports.mapping import IMPORT_KIND

        mapping = load_config(place, IMPORT_KIND).model
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
