"""Imported columns as a run log with its sidecar (docs/format-run-log.md), whole or not at all."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterable
from pathlib import Path

import polars as pl

from control.log_row import COLUMNS, DECIMALS, TEXT_COLUMNS, WHOLE_COLUMNS
from drivers.files.atomic import sidecar, write_atomically
from drivers.files.config import sha256_of
from drivers.files.imports.convert import US, UTC_US
from drivers.files.imports.join import JoinedFiles
from drivers.files.imports.mapping import ImportFile
from drivers.files.log_store import SUFFIXES, write_store
from drivers.files.plain import plain
from drivers.files.read_log import RunLog, log_of, meta_of
from drivers.files.run_meta import meta_from_yaml, meta_to_yaml, run_meta


def log_frame(log: JoinedFiles) -> pl.DataFrame:
    """The columns as they are written: those of the run log in their order, then those beyond
    it."""
    frame = log.frame
    columns = [_time_text(frame[US]).alias("time_s")]
    if UTC_US in frame.columns:
        columns.append(
            frame[UTC_US].cast(pl.Datetime("us")).dt.strftime("%Y-%m-%dT%H:%M:%S%.3fZ").alias("utc")
        )
    own = [name for name in COLUMNS if name in frame.columns and name not in ("time_s", "utc")]
    beyond = [name for name in frame.columns if name not in COLUMNS and name not in (US, UTC_US)]
    return pl.DataFrame([*columns, *(_rounded(frame[name]) for name in [*own, *beyond])])


def run_log(path: Path, log: JoinedFiles, mapping: ImportFile, mapping_file: Path | None) -> RunLog:
    """The log and its sidecar as they would be read from `path`, in memory. Raises TableError."""
    return log_of(path, as_read(log), meta_from_yaml(_meta(log, mapping, mapping_file)))


def as_read(log: JoinedFiles) -> pl.DataFrame:
    """The columns as a reader of what is written has them, times as numbers."""
    frame = log_frame(log)
    return frame.with_columns(frame["time_s"].cast(pl.Float64))


def write_imported(
    path: Path, log: JoinedFiles, mapping: ImportFile, mapping_file: Path | None
) -> pl.DataFrame:
    """The log at `path`, its sidecar next to it (in a store: within); returns what was written.
    Raises OSError."""
    if path.suffix.lower() in SUFFIXES:
        read = run_log(path, log, mapping, mapping_file)
        write_store(path, read.columns, read.meta, read.findings)
        return log_frame(log)
    frame = log_frame(log)
    text = io.BytesIO()
    frame.write_csv(text)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.stem}.part.csv")
    try:
        write_atomically(part, text.getvalue())
        write_atomically(sidecar(path), _meta(log, mapping, mapping_file))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return frame


def is_import_of(log: Path, files: Iterable[Path]) -> bool:
    """Whether the log at `log` was made of these very files, so that it can be made again."""
    try:
        meta = meta_of(log)
        stated = [] if meta is None else meta.extra["imported"]["files"]
        return meta is not None and {file["sha256"] for file in stated} == {
            _checksum(path) for path in files
        }
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _meta(log: JoinedFiles, mapping: ImportFile, mapping_file: Path | None) -> str:
    files = [
        {
            "name": part.raw.path.name,
            "sha256": _checksum(part.raw.path),
            "rows": part.frame.height,
            "begins_s": begin,
        }
        for part, begin in zip(log.parts, log.begins_s, strict=True)
    ]
    started = log.frame[UTC_US].drop_nulls() if UTC_US in log.frame.columns else None
    utc = (
        None
        if started is None or not started.len()
        else started.head(1).cast(pl.Datetime("us")).dt.strftime("%Y-%m-%dT%H:%M:%S%.3fZ")[0]
    )
    found = [str(finding) for part in log.parts for finding in part.findings]
    stated: dict[str, object] = {
        "files": files,
        "mapping": _without_nothing(plain(mapping)),
        "found": [*found, *map(str, log.findings)],
    }
    widths = {part.raw.width_m for part in log.parts}
    if len(widths) == 1 and (width_m := widths.pop()) is not None:
        stated["width_m"] = width_m  # as-applied areas are held against it
    checksums = {} if mapping_file is None else {mapping_file.name: sha256_of(mapping_file)}
    return meta_to_yaml(run_meta(sha256=checksums, started_utc=utc, extra={"imported": stated}))


def _checksum(path: Path) -> str:
    """Of a file; of a task's folder, of the checksums of what lies in it."""
    if not path.is_dir():
        return sha256_of(path)
    lines = [f"{file.name} {sha256_of(file)}" for file in sorted(path.iterdir()) if file.is_file()]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _without_nothing(value: object) -> object:
    """Without keys that are left out anyway."""
    if isinstance(value, dict):
        return {
            key: _without_nothing(part) for key, part in value.items() if part not in (None, [], {})
        }
    return value


def _time_text(us: pl.Series) -> pl.Series:
    """Seconds with 3 decimals; with 6 where two rows fall into the same millisecond."""
    ms = (us + 500) // 1000
    unit, digits = (us, 6) if (ms.diff() == 0).any() else (ms, 3)
    per_second = 10**digits
    frame = unit.alias("n").to_frame()
    text = pl.concat_str(
        pl.col("n") // per_second,
        pl.lit("."),
        (pl.col("n") % per_second).cast(pl.String).str.zfill(digits),
    )
    return frame.select(text.alias("time_s"))["time_s"]


def _rounded(series: pl.Series) -> pl.Series:
    if series.name in WHOLE_COLUMNS:
        return series.round(0).cast(pl.Int64, strict=False)
    if series.name in DECIMALS and series.name not in TEXT_COLUMNS:
        return series.round(DECIMALS[series.name])
    return series
