"""How are imported columns written as a run log with its sidecar (docs/format-run-log.md)? They are
written completely or not at all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import COLUMNS, DECIMALS, TEXT_COLUMNS, WHOLE_COLUMNS
from topdress.drivers.files.atomic_files import find_sidecar, write_atomically
from topdress.drivers.files.columns import (
    TIME_TYPE,
    Columns,
    count_rows,
    format_csv,
    format_numbers,
    is_text_column,
    make_text_column,
    make_texts_array,
)
from topdress.drivers.files.config import calc_sha256
from topdress.drivers.files.imports.convert import TIME_US_COLUMN, UTC_US_COLUMN
from topdress.drivers.files.imports.log_join import JoinedFiles
from topdress.drivers.files.imports.mapping import ImportFile
from topdress.drivers.files.log_store import STORE_SUFFIXES, write_log_store
from topdress.drivers.files.plain_data import convert_to_plain
from topdress.drivers.files.read_log import RunLog, build_log, read_log_meta
from topdress.drivers.files.run_meta import format_meta_yaml, make_run_meta, parse_meta_yaml


def build_log_columns(log: JoinedFiles) -> Columns:
    """Returns the columns as they are written: the columns of the run log in their order, then
    extra columns; times as texts."""
    there = log.columns
    # Time comes first, as in every run log.
    columns: Columns = {"time_s": make_text_column(_format_times(there[TIME_US_COLUMN]))}
    if UTC_US_COLUMN in there:
        columns["utc"] = make_text_column(_format_utc_times(there[UTC_US_COLUMN]))
    # Columns of the run log keep its order, so that logs of different machines are comparable.
    own = [name for name in COLUMNS if name in there and name not in ("time_s", "utc")]
    beyond = [
        name
        for name in there
        if name not in COLUMNS and name not in (TIME_US_COLUMN, UTC_US_COLUMN)
    ]
    return columns | {name: _round_column(name, there[name]) for name in [*own, *beyond]}


def build_run_log(
    path: Path, log: JoinedFiles, mapping: ImportFile, mapping_file: Path | None
) -> RunLog:
    """Returns the log and its sidecar in memory, as if they had been read from `path`. Raises
    TableError."""
    return build_log(
        path, build_read_columns(log), parse_meta_yaml(_format_sidecar(log, mapping, mapping_file))
    )


def build_read_columns(log: JoinedFiles) -> Columns:
    """Returns the columns as a reader of the written log gets them, times as numbers."""
    columns = build_log_columns(log)
    # A reader of the log gets numbers, so the texts are converted back.
    return {**columns, "time_s": columns["time_s"].astype(np.float64)}


def write_imported_log(
    path: Path, log: JoinedFiles, mapping: ImportFile, mapping_file: Path | None
) -> Columns:
    """Writes the log with its sidecar next to it (in a store, inside of it).

    Parameters
    ----------
    path : the log.
    log : its columns.
    mapping : the import file, kept in the sidecar.
    mapping_file : path of the import file, for its checksum; None for a guess.

    Returns
    -------
    the columns as written.

    Raises
    ------
    OSError : the log cannot be written.
    """
    # A Parquet store holds its sidecar inside of the file.
    if path.suffix.lower() in STORE_SUFFIXES:
        read = build_run_log(path, log, mapping, mapping_file)
        write_log_store(path, read.columns, read.meta, read.findings)
        return build_log_columns(log)
    columns = build_log_columns(log)
    text = format_csv(columns, _format_cells)
    path.parent.mkdir(parents=True, exist_ok=True)
    # The log is renamed after its sidecar exists, so that no log lacks a sidecar.
    part = path.with_name(f".{path.stem}.part.csv")
    try:
        # The temporary name begins with a point, so that no list of logs shows it.
        write_atomically(part, text)
        write_atomically(find_sidecar(path), _format_sidecar(log, mapping, mapping_file))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return columns


def is_import_of(log: Path, files: Iterable[Path]) -> bool:
    """Returns whether the log at `log` was made from exactly these files, so that it can be made
    again."""
    # A damaged or edited sidecar must not stop an import, so every error means "no".
    try:
        meta = read_log_meta(log)
        stated = [] if meta is None else meta.extra["imported"]["files"]
        return meta is not None and {file["sha256"] for file in stated} == {
            _calc_checksum(path) for path in files
        }
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _format_sidecar(log: JoinedFiles, mapping: ImportFile, mapping_file: Path | None) -> str:
    files = [
        {
            "name": part.raw.path.name,
            "sha256": _calc_checksum(part.raw.path),
            "rows": count_rows(part.columns),
            "begins_s": begin,
            # The begin of each part allows a row of the log to be traced to its file.
        }
        for part, begin in zip(log.parts, log.begins_s, strict=True)
    ]
    known = filter(
        None, _format_utc_times(log.columns[UTC_US_COLUMN]) if UTC_US_COLUMN in log.columns else ()
    )
    found = [str(finding) for part in log.parts for finding in part.findings]
    stated: dict[str, object] = {
        "files": files,
        "mapping": _drop_empty_keys(convert_to_plain(mapping)),
        "found": [*found, *map(str, log.findings)],
    }
    widths = {part.raw.width_m for part in log.parts}
    # Parts with different widths have no common width.
    if len(widths) == 1 and (width_m := widths.pop()) is not None:
        # As-applied areas are compared with this width.
        stated["width_m"] = width_m
    checksums = {} if mapping_file is None else {mapping_file.name: calc_sha256(mapping_file)}
    return format_meta_yaml(
        make_run_meta(sha256=checksums, started_utc=next(known, None), extra={"imported": stated})
    )


def _calc_checksum(path: Path) -> str:
    """Returns the checksum of a file; for a task's folder, of the checksums of its files."""
    if not path.is_dir():
        return calc_sha256(path)
    # Sorted names make the checksum independent of the order on the disk.
    lines = [
        f"{file.name} {calc_sha256(file)}" for file in sorted(path.iterdir()) if file.is_file()
    ]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _drop_empty_keys(value: object) -> object:
    """Returns the value without keys that have their default."""
    if isinstance(value, dict):
        return {
            key: _drop_empty_keys(part) for key, part in value.items() if part not in (None, [], {})
        }
    return value


def _format_times(us: NDArray[np.float64]) -> list[str]:
    """Returns seconds with 3 decimals, or with 6 where two rows fall into the same millisecond."""
    whole = us.astype(np.int64)
    # Half a millisecond is added, because the integer division rounds down.
    ms = (whole + 500) // 1000
    # Rows within one millisecond would otherwise have equal times, which no reader accepts.
    unit, digits = (whole, 6) if (np.diff(ms) == 0).any() else (ms, 3)
    return [f"{one // 10**digits}.{one % 10**digits:0{digits}d}" for one in unit.tolist()]


def _format_utc_times(us: NDArray[np.float64]) -> list[str]:
    """Returns ISO 8601 with milliseconds; empty for unknown times."""
    # NaN cannot be converted to an integer; such texts are emptied below.
    times = np.nan_to_num(us).astype(np.int64).astype(TIME_TYPE)
    texts = np.datetime_as_string(times, unit="ms", casting="unsafe").tolist()
    return [f"{text}Z" if one == one else "" for text, one in zip(texts, us.tolist(), strict=True)]


def _round_column(name: str, column: NDArray[Any]) -> NDArray[Any]:
    if is_text_column(column):
        return make_texts_array(column.tolist())
    # Columns of counts and flags have no decimals.
    if name in WHOLE_COLUMNS:
        return np.round(column)
    if name in DECIMALS and name not in TEXT_COLUMNS:
        return np.round(column, DECIMALS[name])
    return column


def _format_cells(name: str, column: NDArray[Any]) -> list[str]:
    """Returns cells as texts; integers without a point."""
    if is_text_column(column):
        return list(column)
    texts = format_numbers(column)
    return [text.removesuffix(".0") for text in texts] if name in WHOLE_COLUMNS else texts
