"""The records of a fleet put together: courses, what is shared, what it cost; and as Parquet for others."""
from __future__ import annotations

import datetime as dt
import io
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from control.diagnosis.season.courses import Course, OneLog, Shared, courses
from control.diagnosis.season.evidence import Form, Worked
from control.diagnosis.season.owner import Low, MachineSeason, Told, low_hoppers, machines
from drivers.files.atomic import write_atomically

FIRST_DAY, DAY_AHEAD = 10_957.0, 1.0        # days since 1970: 2000-01-01; how far ahead of here a clock may be


class Aside(NamedTuple):
    """A log whose clock cannot be right: it is diagnosed, and left out of the courses and sums."""

    path: str
    date: str


class Season(NamedTuple):
    """units: of effects. broken: path and why. by_file_date: logs that tell no time but that of their file."""

    machines: tuple[MachineSeason, ...]
    shared: tuple[Shared, ...]
    low: tuple[Low, ...]
    told: tuple[Told, ...]
    courses: tuple[Course, ...]
    units: Mapping[str, str]
    broken: tuple[tuple[str, str], ...]
    aside: tuple[Aside, ...] = ()
    by_file_date: int = 0


def season(records: Sequence[Mapping[str, Any]], broken: Sequence[tuple[str, str]], now_d: float) -> Season:
    """records: as `fleet_job.record` makes them, with their key. now_d: days since 1970."""
    timely = [one for one in records if FIRST_DAY <= one["time_d"] <= now_d + DAY_AHEAD]
    aside = tuple(Aside(one["path"], _date(one["time_d"])) for one in records if one not in timely)
    named = one_spelling(timely)
    logs = [one_log(one) for one in named]
    told = [Told(one["key"], one["unit"], one["time_d"], Worked(**one["worked"]), one["percent"], one["shared"])
            for one in named]
    units: dict[str, str] = {}
    for one in named:
        units |= one["units"]
    found, shared = courses(logs)
    return Season(tuple(machines(told, found, shared)), tuple(shared), tuple(low_hoppers(told)), tuple(told),
                  tuple(found), units, tuple(broken), aside, sum(one["time_from"] == "file" for one in timely))


def one_log(record: Mapping[str, Any]) -> OneLog:
    """A record as the season sees it."""
    forms = tuple(Form(**{name: _tuples(value) for name, value in form.items()}) for form in record["forms"])
    return OneLog(record["key"], record["unit"], record["time_d"], forms, record["shared"])


def one_spelling(records: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Names that differ in capitals or blanks only are one, spelt as most logs do; a machine whose logs are held
    against several models is several."""
    every = list(records)
    factors = sorted({name for one in every for name in one["shared"]})
    unit = _spelt(one["unit"] for one in every)
    spelt = {name: _spelt(one["shared"].get(name, "") for one in every) for name in factors}
    models: dict[str, set[str]] = {}
    for one in every:
        models.setdefault(unit[one["unit"]], set()).add(one["model"])
    return [{**one, "unit": _of_model(unit[one["unit"]], one["model"], models),
             "shared": {name: spelt[name][level] for name, level in one["shared"].items()}} for one in every]


def _of_model(unit: str, model: str, models: Mapping[str, set[str]]) -> str:
    return f"{unit} ({model})" if len(models[unit]) > 1 else unit


def _spelt(names: Iterable[str]) -> dict[str, str]:
    """Each spelling's commonest one."""
    counts = Counter(names)
    best: dict[str, str] = {}
    for name, _ in counts.most_common():
        best.setdefault(_plain(name), " ".join(name.split()))
    return {name: best[_plain(name)] for name in counts}


def _plain(name: str) -> str:
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())


def _date(time_d: float) -> str:
    """The day, or its number where no calendar reaches it."""
    try:
        return dt.datetime.fromtimestamp(time_d * 86_400.0, dt.UTC).date().isoformat()
    except (ValueError, OverflowError, OSError):
        return f"day {time_d:.0f}"


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
        "machines": [{name: value for name, value in one._asdict().items() if name not in ("courses", "shared")}
                     for one in of.machines],
    }
    for name, rows in tables.items():
        data = io.BytesIO()
        pl.DataFrame(rows, infer_schema_length=None).write_parquet(data)
        write_atomically(out / f"{name}.parquet", data.getvalue())
