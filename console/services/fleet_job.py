"""What a worker of the fleet does with one log: bytes in, one plain record out. Knows nothing of Dask."""
from __future__ import annotations

import contextlib
import datetime as dt
import hashlib
import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from control.machine.machine import Machine
    from drivers.files.read_log import RunLog

FORMAT = "topdress-fleet-log/3"
BLOCK = 1 << 20
FIRST_BYTES = 4096
LEAST_S = 20.0                  # of a log: what is shorter shows no level of a hopper and no course
SHARED = ("product", "operator", "field")
Options = Mapping[str, str]             # of fsspec, for logs at URLs


def first_bytes(where: str, options: Options) -> tuple[str, str]:
    """SHA-256 of a log's first bytes, and why they cannot be read; one of the two is empty."""
    try:
        if "://" in where:
            import fsspec
            with fsspec.open(where, "rb", **options) as opened:
                return hashlib.sha256(opened.read(FIRST_BYTES)).hexdigest(), ""
        with Path(where).open("rb") as opened:
            return hashlib.sha256(opened.read(FIRST_BYTES)).hexdigest(), ""
    except Exception as error:      # a store's own error of any kind
        return "", _first_line(error)


def checksum(where: str, options: Options, salt: str) -> str:
    """SHA-256 of a log's bytes, its sidecar's, its import file's, and of what else decides its record.

    Raises OSError; where there is no such file too: all that a worker does not see would have one checksum.
    """
    from drivers.files.any_log import import_file
    digest = hashlib.sha256(salt.encode())
    with local(where, options) as path:
        path.stat()
        for file in (path, path.with_suffix(".yaml"), import_file(path) or path.with_suffix(".yaml")):
            if file.is_file():
                with file.open("rb") as opened:
                    while block := opened.read(BLOCK):
                        digest.update(block)
            digest.update(b"\0")
    return digest.hexdigest()


def record(where: str, options: Options, machine: Mapping[str, Any]) -> dict[str, Any]:
    """The record of one log, of plain values. machine: for logs that name none.

    Whatever is wrong with it is a record too: {"error": one line, "lasting": whether it is the log's own fault}. What
    a reader refuses is the log's; no such file, no memory, a package that is missing are the worker's.
    """
    from control.machine.machine import Machine
    from drivers.files.config import ConfigError
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    began = time.perf_counter(), time.process_time()
    try:
        with local(where, options) as path:
            path.open("rb").close()
            made = _judged(where, path, Machine.model_validate(machine))
            return {**made, "took_s": time.perf_counter() - began[0], "processor_s": time.process_time() - began[1]}
    except ConfigError as error:
        return {"format": FORMAT, "path": where, "error": error.lines[0], "lasting": True}
    except Exception as error:      # one log of thousands never stops the rest
        return {"format": FORMAT, "path": where, "error": _first_line(error), "lasting": isinstance(error, ValueError)
                and not isinstance(error.__context__, OSError)}


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _judged(where: str, path: Path, default: Machine) -> dict[str, Any]:
    from control.diagnosis.season.evidence import evidence
    from drivers.files.any_log import open_log
    from drivers.files.config import validated
    from drivers.files.kinds import MACHINE
    log = open_log(path)
    if log.duration_s < LEAST_S:
        raise ValueError(f"{where}: {log.duration_s:.0f} s long: allowed is a log of {LEAST_S:.0f} s and more")
    machine = default
    if log.meta is not None and log.meta.machine is not None:
        machine = validated(log.meta.machine, MACHINE, f"{where}: machine")
    seen = evidence(log.columns, machine, where)
    found = seen.found
    return {
        "format": FORMAT, "path": where, "content": _content(log), "rows": len(log), "duration_s": log.duration_s,
        "model": machine.id, "nominal": hashlib.sha256(machine.model_dump_json().encode()).hexdigest(),
        "unit": _known(log, "unit") or _folder(where), **_time(log, path),
        "shared": {name: _known(log, name) for name in SHARED},
        "verdict": found.verdict, "worked": seen.worked._asdict(), "percent": seen.percent, "units": seen.units,
        "causes": [{"id": cause.id, "size": cause.size.value, "low": cause.size.low, "high": cause.size.high,
                    "probability": cause.probability, "onset_s": cause.onset_s} for cause in found.causes],
        "forms": [form._asdict() for form in seen.forms]}


def _content(log: RunLog) -> str:
    """SHA-256 of what was measured: the same run as text and as Parquet is one log."""
    import numpy as np
    digest = hashlib.sha256()
    for name in ("time_s", "speed_mps", "wheel_speed_mps", "shaft_rpm", "opening_mm", "hopper_kg"):
        if name in log.columns:
            digest.update(name.encode() + (np.round(np.asarray(log.columns[name], np.float64), 6) + 0.0).tobytes())
    return digest.hexdigest()


def _known(log: RunLog, name: str) -> str:
    """As the log's sidecar says."""
    said = "" if log.meta is None else log.meta.extra.get(name)
    if not said and name == "field" and log.meta is not None and log.meta.job is not None:
        said = (log.meta.job.get("field") or {}).get("title")
    return str(said or "")


def _folder(where: str) -> str:
    """The name of the folder in which it lies: where nobody says which machine a log is of."""
    parts = where.replace("\\", "/").rstrip("/").split("/")
    return parts[-2] if len(parts) > 1 else ""


def _time(log: RunLog, path: Path) -> dict[str, Any]:
    """When the log began, in days since 1970, and who says so: its sidecar, its first fix, else its file."""
    first = next((str(text) for text in log.texts("utc")[:10_000] if text), None)
    for whence, said in (("sidecar", None if log.meta is None else log.meta.started_utc), ("log", first)):
        if said:
            with contextlib.suppress(ValueError):
                return {"time_d": days_of(said), "time_from": whence}
    return {"time_d": path.stat().st_mtime / 86_400.0, "time_from": "file"}


def days_of(said: str) -> float:
    """Days since 1970 of an ISO 8601 time, UTC where it has no zone. Raises ValueError."""
    moment = dt.datetime.fromisoformat(said.replace("Z", "+00:00"))
    return (moment if moment.tzinfo else moment.replace(tzinfo=dt.UTC)).timestamp() / 86_400.0


@contextlib.contextmanager
def local(where: str, options: Options) -> Iterator[Path]:
    """The file at a path or fsspec URL as a file of this computer, its sidecar and import file next to it. Raises
    OSError."""
    if "://" not in where:
        yield Path(where)
        return
    import fsspec

    from drivers.files.any_log import OF_FOLDER, OWN
    system, path = fsspec.core.url_to_fs(where, **options)
    with tempfile.TemporaryDirectory(prefix="topdress-") as folder:
        place = Path(folder) / path.rstrip("/").split("/")[-1]
        system.get_file(path, str(place))
        for ending in (".yaml", OWN):
            if system.exists(side_file := sidecar_url(path, ending)):
                system.get_file(side_file, str(place.with_suffix(ending)))
        if system.exists(side_file := f"{path.rpartition('/')[0]}/{OF_FOLDER}"):
            system.get_file(side_file, str(place.with_name(OF_FOLDER)))
        yield place


def sidecar_url(path: str, ending: str = ".yaml") -> str:
    """Where a log's sidecar is. Of http a path is the whole URL: as a file's path it would lose a stroke."""
    folder, stroke, name = path.rpartition("/")
    return f"{folder}{stroke}{name.rpartition('.')[0] or name}{ending}"
