"""How is a season written as Parquet files for other programs? Each table is one file."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from topdress.drivers.files.atomic_files import write_atomically

if TYPE_CHECKING:
    from topdress.console.services.fleet_season import FleetSeason

_TEXT, _NUMBER, _COUNT = "Utf8", "Float64", "Int64"
# Every column of every table is listed, so that an empty table has them too.
TABLE_COLUMNS = {
    "logs": {
        "path": _TEXT,
        "checksum": _TEXT,
        "machine": _TEXT,
        "time_d": _NUMBER,
        "product": _TEXT,
        "operator": _TEXT,
        "field": _TEXT,
        "rows": _COUNT,
        "verdict": _TEXT,
        "named": _TEXT,
        "hours": _NUMBER,
        "applied_kg": _NUMBER,
        "area_ha": _NUMBER,
        "low_minutes": _NUMBER,
        "refills": _COUNT,
    },
    "courses": {
        "machine": _TEXT,
        "effect": _TEXT,
        "unit": _TEXT,
        "time_d": _NUMBER,
        "size": _NUMBER,
        "half": _NUMBER,
        "probability": _NUMBER,
    },
    "pieces": {
        "machine": _TEXT,
        "effect": _TEXT,
        "begin_d": _NUMBER,
        "end_d": _NUMBER,
        "begin": _NUMBER,
        "end": _NUMBER,
        "begin_half": _NUMBER,
        "end_half": _NUMBER,
        "per_day": _NUMBER,
        "per_day_p": _NUMBER,
    },
    "changes": {
        "machine": _TEXT,
        "effect": _TEXT,
        "time_d": _NUMBER,
        "probability": _NUMBER,
        "repair": _NUMBER,
        "before": _NUMBER,
        "after": _NUMBER,
        "logs_after": _COUNT,
    },
    "levels": {
        "factor": _TEXT,
        "level": _TEXT,
        "effect": _TEXT,
        "unit": _TEXT,
        "size": _NUMBER,
        "half": _NUMBER,
        "probability": _NUMBER,
        "logs": _COUNT,
        "apart": "Boolean",
    },
    "alternatives": {
        "factor": _TEXT,
        "level": _TEXT,
        "effect": _TEXT,
        "or_factor": _TEXT,
        "or_level": _TEXT,
        "or_effect": _TEXT,
        "size": _NUMBER,
        "probability": _NUMBER,
    },
    "machines": {
        "machine": _TEXT,
        "logs": _COUNT,
        "hours": _NUMBER,
        "applied_kg": _NUMBER,
        "wrong_kg": _NUMBER,
        "least_kg": _NUMBER,
        "most_kg": _NUMBER,
        "now_percent": _NUMBER,
        "now_least": _NUMBER,
        "now_most": _NUMBER,
        "others_percent": _NUMBER,
    },
    "costs": {
        "machine": _TEXT,
        "factor": _TEXT,
        "level": _TEXT,
        "effect": _TEXT,
        "kg": _NUMBER,
        "least_kg": _NUMBER,
        "most_kg": _NUMBER,
    },
}


def write_tables(out: Path, of: FleetSeason, records: Sequence[Mapping[str, Any]]) -> None:
    """Writes `TABLE_COLUMNS`, each table as a Parquet file in `out`. Raises OSError."""
    import polars as pl

    fit = of.fit
    tables: dict[str, list[dict[str, Any]]] = {
        "logs": [
            {
                "path": one["path"],
                "checksum": one["key"],
                "machine": one["unit"],
                "time_d": one["time_d"],
                **one["shared"],
                "rows": one["rows"],
                "verdict": one["verdict"],
                "named": " ".join(cause["id"] for cause in one["causes"]),
                **one["worked"],
            }
            for one in records
        ],
        "courses": [
            {
                **one._asdict(),
                "machine": one.level,
                "unit": of.units.get(one.effect, ""),
                "time_d": at_d,
                "size": size,
                "half": half,
            }
            for one in fit.courses
            for at_d, size, half in zip(one.times_d, one.sizes, one.halves, strict=True)
        ],
        "pieces": [
            {"machine": one.level, "effect": one.effect, **piece._asdict()}
            for one in fit.courses
            for piece in one.pieces
        ],
        "changes": [
            {"machine": one.level, "effect": one.effect, **change._asdict()}
            for one in fit.courses
            for change in one.changes
        ],
        "levels": [{**one._asdict(), "unit": of.units.get(one.effect, "")} for one in fit.levels],
        "alternatives": [
            {
                "factor": one.factor,
                "level": one.level,
                "effect": one.effect,
                "or_factor": other.factor,
                "or_level": other.level,
                "or_effect": other.effect,
                "size": other.size,
                "probability": other.probability,
            }
            for one in (*fit.courses, *fit.shared)
            for other in one.alternatives
        ],
        "machines": [one._asdict() for one in of.machines],
        "costs": [
            {
                "machine": one.machine,
                "factor": cost.cause.factor,
                "level": cost.cause.level,
                "effect": cost.cause.effect,
                **cost._asdict(),
            }
            for one in of.machines
            for cost in one.costs
        ],
    }
    for name, columns in TABLE_COLUMNS.items():
        data = io.BytesIO()
        rows = [{column: row.get(column) for column in columns} for row in tables[name]]
        schema = {column: getattr(pl, kind) for column, kind in columns.items()}
        pl.DataFrame(rows, schema=schema).write_parquet(data)
        write_atomically(out / f"{name}.parquet", data.getvalue())
