"""How does a worker of the fleet diagnose one log? Bytes enter, one plain record leaves; the module
does not use Dask.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import hashlib
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from topdress.control.machine.machine import Machine
    from topdress.drivers.files.read_log import RunLog

# Workers of other versions are asked for this name, so it is a contract.
FORMAT = "topdress-fleet-log/3"
BLOCK_BYTES = 1 << 20
FIRST_BYTES = 4096
# Shortest log, s; a shorter log shows neither a hopper level nor a trend.
MIN_LOG_S = 20.0
SHARED_WORDS = ("product", "operator", "field")
# Options of fsspec, for logs at URLs.
StoreOptions = Mapping[str, str]


def hash_first_bytes(where: str, options: StoreOptions) -> tuple[str, str]:
    """Returns the SHA-256 of a log's first bytes, and the reason why they cannot be read; one of
    the two is empty."""
    try:
        if "://" in where:
            import fsspec

            with fsspec.open(where, "rb", **options) as opened:
                return hashlib.sha256(opened.read(FIRST_BYTES)).hexdigest(), ""
        with Path(where).open("rb") as opened:
            return hashlib.sha256(opened.read(FIRST_BYTES)).hexdigest(), ""
    # Stores raise errors of any kind.
    except Exception as error:
        return "", read_first_line(error)


def run_each(work: Callable[..., Any], of: Sequence[tuple[Any, ...]]) -> list[tuple[Any, str]]:
    """Returns the result for each log, and the reason without a result: the exception, or a fault
    of the worker."""
    return [_run_guarded(work, arguments) for arguments in of]


def _run_guarded(work: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[Any, str]:
    try:
        made = work(*arguments)
    # One log of thousands must not stop the others.
    except Exception as error:
        return None, read_first_line(error)
    if isinstance(made, dict) and "error" in made and not made.get("lasting", True):
        return None, str(made["error"])
    return made, ""


def calc_checksum(where: str, options: StoreOptions, salt: str, sides: Sequence[str] = ()) -> str:
    """Returns the SHA-256 of a log's bytes, its sidecar, its import file, and everything else that
    determines its record. `sides` is as in `open_local_copy`.

    Raises OSError, also for a missing file, because all files that a worker cannot read would
    otherwise share one checksum.
    """
    from topdress.drivers.files.any_log import find_import_file

    digest = hashlib.sha256(salt.encode())
    with open_local_copy(where, options, sides) as path:
        path.stat()
        for file in (
            path,
            path.with_suffix(".yaml"),
            find_import_file(path) or path.with_suffix(".yaml"),
        ):
            if file.is_file():
                with file.open("rb") as opened:
                    while block := opened.read(BLOCK_BYTES):
                        digest.update(block)
            digest.update(b"\0")
    return digest.hexdigest()


def make_record(
    where: str, options: StoreOptions, machine: Mapping[str, Any], sides: Sequence[str] = ()
) -> dict[str, Any]:
    """Returns the record of one log, of plain values. `machine` is used for logs that name none;
    `sides` is as in `open_local_copy`.

    A fault of a log is a record too: {"error": one line, "lasting": whether the log itself is at
    fault}. An error of a reader belongs to the log; a missing file, lack of memory or a missing
    package belong to the worker.
    """
    from topdress.control.machine.machine import Machine
    from topdress.drivers.files.config import ConfigError

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    began = time.perf_counter(), time.process_time()
    try:
        with open_local_copy(where, options, sides) as path:
            path.open("rb").close()
            made = _diagnose_log(where, options, path, Machine.model_validate(machine))
            return {
                **made,
                "took_s": time.perf_counter() - began[0],
                "processor_s": time.process_time() - began[1],
            }
    except ConfigError as error:
        return {"format": FORMAT, "path": where, "error": error.lines[0], "lasting": True}
    # One log of thousands must not stop the others.
    except Exception as error:
        return {
            "format": FORMAT,
            "path": where,
            "error": read_first_line(error),
            "lasting": isinstance(error, ValueError) and not isinstance(error.__context__, OSError),
        }


def read_record(text: str) -> Any:
    """Returns a record from its file with a third of the memory: sequences become arrays, and equal
    words share one object.

    Raises ValueError for text that is no JSON.
    """
    import numpy as np
    from topdress.control.diagnosis.season.log_evidence import QuadraticForm

    def compact_object(of: dict[str, Any]) -> Any:
        if "normal" in of:
            numbers: Any = {name: np.array(of[name]) for name in ("normal", "right", "pulls")}
            return QuadraticForm(
                names=tuple(map(sys.intern, of["names"])),
                open=tuple(map(sys.intern, of["open"])),
                **numbers,
            )
        return {
            sys.intern(name): sys.intern(value) if isinstance(value, str) else value
            for name, value in of.items()
        }

    return json.loads(text, object_hook=compact_object)


def read_first_line(error: Exception) -> str:
    """Returns the first line of an exception's message, else its class."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _diagnose_log(
    where: str, options: StoreOptions, path: Path, default: Machine
) -> dict[str, Any]:
    from topdress.control.diagnosis.season.log_evidence import collect_log_evidence
    from topdress.drivers.files.any_log import open_any_log
    from topdress.drivers.files.config import validate_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    log = open_any_log(path)
    if log.duration_s < MIN_LOG_S:
        raise ValueError(
            f"{where}: {log.duration_s:.0f} s long: allowed is a log of {MIN_LOG_S:.0f} s and more"
        )
    machine = default
    if log.meta is not None and log.meta.machine is not None:
        machine = validate_config(log.meta.machine, MACHINE_KIND, f"{where}: machine")
    seen = collect_log_evidence(log.columns, machine, where)
    found = seen.found
    return {
        "format": FORMAT,
        "path": where,
        "content": _hash_measurements(log),
        "rows": len(log),
        "duration_s": log.duration_s,
        "model": machine.id,
        "nominal": hashlib.sha256(machine.model_dump_json().encode()).hexdigest(),
        "unit": _read_sidecar_word(log, "unit") or _find_folder_name(where),
        **_find_log_time(log, path, where, options),
        "shared": {name: _read_sidecar_word(log, name) for name in SHARED_WORDS},
        "verdict": found.verdict,
        "worked": seen.worked._asdict(),
        "percent": seen.percent,
        "units": seen.units,
        "causes": [
            {
                "id": cause.id,
                "size": cause.size.value,
                "low": cause.size.low,
                "high": cause.size.high,
                "probability": cause.probability,
                "onset_s": cause.onset_s,
            }
            for cause in found.causes
        ],
        "forms": [form._asdict() for form in seen.forms],
    }


def _hash_measurements(log: RunLog) -> str:
    """Returns the SHA-256 of the measured columns, so that the same run as text and as Parquet is
    one log."""
    import numpy as np

    digest = hashlib.sha256()
    for name in ("time_s", "speed_mps", "wheel_speed_mps", "shaft_rpm", "opening_mm", "hopper_kg"):
        if name in log.columns:
            digest.update(
                name.encode()
                + (np.round(np.asarray(log.columns[name], np.float64), 6) + 0.0).tobytes()
            )
    return digest.hexdigest()


def _read_sidecar_word(log: RunLog, name: str) -> str:
    """Returns the value of a name in the log's sidecar."""
    said = "" if log.meta is None else log.meta.extra.get(name)
    if not said and name == "field" and log.meta is not None and log.meta.job is not None:
        said = (log.meta.job.get("field") or {}).get("title")
    return str(said or "")


def _find_folder_name(where: str) -> str:
    """Returns the name of the log's folder, which is the machine of a log that names none."""
    parts = where.replace("\\", "/").rstrip("/").split("/")
    return parts[-2] if len(parts) > 1 else ""


def _find_log_time(log: RunLog, path: Path, where: str, options: StoreOptions) -> dict[str, Any]:
    """Returns the begin of the log, in days since 1970, and its source: the sidecar, the first fix,
    else the file in the store, or the local copy where a store has no times."""
    first = next((str(text) for text in log.texts("utc")[:10_000] if text), None)
    for whence, said in (
        ("sidecar", None if log.meta is None else log.meta.started_utc),
        ("log", first),
    ):
        if said:
            with contextlib.suppress(ValueError):
                return {"time_d": find_epoch_days(said), "time_from": whence}
    modified_s = path.stat().st_mtime
    if "://" in where:
        import fsspec

        system, place = fsspec.core.url_to_fs(where, **options)
        with contextlib.suppress(NotImplementedError):
            modified_s = system.modified(place).timestamp()
    return {"time_d": modified_s / 86_400.0, "time_from": "file"}


def find_epoch_days(said: str) -> float:
    """Returns days since 1970 of an ISO 8601 time, UTC where it has no zone. Raises ValueError."""
    moment = dt.datetime.fromisoformat(said.replace("Z", "+00:00"))
    return (moment if moment.tzinfo else moment.replace(tzinfo=dt.UTC)).timestamp() / 86_400.0


@contextlib.contextmanager
def open_local_copy(where: str, options: StoreOptions, sides: Sequence[str] = ()) -> Iterator[Path]:
    """Yields the file at a path or fsspec URL as a local file, with its companion files next to it.

    `sides` are the places of the sidecar and import files of a URL in the store. Raises OSError.
    """
    if "://" not in where:
        yield Path(where)
        return
    import fsspec

    system, path = fsspec.core.url_to_fs(where, **options)
    with tempfile.TemporaryDirectory(prefix="topdress-") as folder:
        for place in (path, *sides):
            system.get_file(place, str(Path(folder, place.rpartition("/")[2])))
        yield Path(folder, path.rpartition("/")[2])


def list_side_urls(path: str) -> tuple[str, ...]:
    """Returns the places of a log's sidecar and import files. An http path is the whole URL,
    because pathlib would remove a slash."""
    from topdress.drivers.files.any_log import FOLDER_IMPORT_FILE, OWN_IMPORT_SUFFIX

    folder, stroke, name = path.rpartition("/")
    own = f"{folder}{stroke}{name.rpartition('.')[0] or name}"
    return f"{own}.yaml", f"{own}{OWN_IMPORT_SUFFIX}", f"{folder}{stroke}{FOLDER_IMPORT_FILE}"
