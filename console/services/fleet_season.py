"""The records of a fleet put together: courses, what is shared, what it cost; and as Parquet for others."""
from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from control.diagnosis.season.courses import Course, OneLog, Shared, courses
from control.diagnosis.season.evidence import Form, Worked
from control.diagnosis.season.owner import Low, MachineSeason, Told, low_hoppers, machines
from drivers.files.atomic import write_atomically


class Season(NamedTuple):
    """units: of effects. broken: path and why."""

    machines: tuple[MachineSeason, ...]
    shared: tuple[Shared, ...]
    low: tuple[Low, ...]
    told: tuple[Told, ...]
    courses: tuple[Course, ...]
    units: Mapping[str, str]
    broken: tuple[tuple[str, str], ...]


def season(records: Iterable[Mapping[str, Any]], broken: Sequence[tuple[str, str]]) -> Season:
    """records: as `fleet_job.record` makes them, with their key."""
    logs: list[OneLog] = []
    told: list[Told] = []
    units: dict[str, str] = {}
    for one in records:
        forms = tuple(Form(**{name: _tuples(value) for name, value in form.items()}) for form in one["forms"])
        logs.append(OneLog(one["key"], one["unit"], one["time_d"], forms, one["shared"]))
        told.append(Told(one["key"], one["unit"], one["time_d"], Worked(**one["worked"]), one["percent"],
                         one["shared"]))
        units |= one["units"]
    found, shared = courses(logs)
    return Season(tuple(machines(told, found, shared)), tuple(shared), tuple(low_hoppers(told)), tuple(told),
                  tuple(found), units, tuple(broken))


def _tuples(of: Any) -> Any:
    """Lists of a record as the tuples that they were."""
    return tuple(map(_tuples, of)) if isinstance(of, list) else of


def write_tables(out: Path, of: Season, records: Sequence[Mapping[str, Any]]) -> None:
    """logs, courses, pieces, shared and machines, each a Parquet file in `out`. Raises OSError."""
    import polars as pl
    tables = {
        "logs": [{"path": one["path"], "checksum": one["key"], "machine": one["unit"], "time_d": one["time_d"],
                  **one["shared"], "rows": one["rows"], "verdict": one["verdict"],
                  "named": " ".join(cause["id"] for cause in one["causes"]), **one["worked"]} for one in records],
        "courses": [{"machine": one.machine, "effect": one.effect, "unit": of.units.get(one.effect, ""),
                     "time_d": time_d, "size": size, "half": half, "gain": one.gain}
                    for one in of.courses for time_d, size, half in zip(one.times_d, one.sizes, one.half, strict=True)],
        "pieces": [{"machine": one.machine, "effect": one.effect, **piece._asdict()}
                   for one in of.courses for piece in one.pieces],
        "shared": [one._asdict() for one in of.shared],
        "machines": [{name: value for name, value in one._asdict().items() if name != "courses"}
                     for one in of.machines],
    }
    for name, rows in tables.items():
        data = io.BytesIO()
        pl.DataFrame(rows, infer_schema_length=None).write_parquet(data)
        write_atomically(out / f"{name}.parquet", data.getvalue())
