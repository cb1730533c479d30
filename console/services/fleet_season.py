"""The records of a fleet put together: courses, what is shared, what it cost."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from topdress.control.diagnosis.season.effect_timelines import SeasonFit, fitted
from topdress.control.diagnosis.season.evidence import LogWork, OneLog
from topdress.control.diagnosis.season.season_cost import (
    Low,
    MachineSeason,
    OwnersLog,
    find_low_hoppers,
    machines,
)
from topdress.drivers import day_clock

# days since 1970: 2000-01-01; how far ahead of here a clock may be
FIRST_DAY, DAY_AHEAD = 10_957.0, 1.0


class Aside(NamedTuple):
    """A log whose clock cannot be right: it is diagnosed, and left out of the courses and sums."""

    path: str
    date: str


class Season(NamedTuple):
    """units: of effects. broken: path and why. by_file_date: logs that tell no time but that of
    their file."""

    machines: tuple[MachineSeason, ...]
    fit: SeasonFit
    low: tuple[Low, ...]
    logs: tuple[OwnersLog, ...]
    units: Mapping[str, str]
    broken: tuple[tuple[str, str], ...]
    aside: tuple[Aside, ...] = ()
    by_file_date: int = 0


def season(
    records: Sequence[Mapping[str, Any]], broken: Sequence[tuple[str, str]], now_d: float
) -> Season:
    """records: as `fleet_job.read_record` reads them, with their key. now_d: days since 1970."""
    timely, aside = list[Mapping[str, Any]](), list[Aside]()
    for one in records:
        if FIRST_DAY <= one["time_d"] <= now_d + DAY_AHEAD:
            timely.append(one)
        else:
            aside.append(Aside(one["path"], _date(one["time_d"])))
    named = one_spelling(timely)
    logs = [
        OneLog(one["key"], one["unit"], one["time_d"], tuple(one["forms"]), one["shared"])
        for one in named
    ]
    owners = [
        OwnersLog(
            one["key"],
            one["unit"],
            one["time_d"],
            LogWork(**one["worked"]),
            one["percent"],
            one["shared"],
        )
        for one in named
    ]
    units: dict[str, str] = {}
    for one in named:
        units |= one["units"]
    fit = fitted(logs)
    return Season(
        tuple(machines(owners, fit)),
        fit,
        tuple(find_low_hoppers(owners)),
        tuple(owners),
        units,
        tuple(broken),
        tuple(aside),
        sum(one["time_from"] == "file" for one in timely),
    )


def one_spelling(records: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Names that differ in capitals or blanks only are one, spelt as most logs do; a machine
    whose logs are held against several models is several."""
    every = list(records)
    factors = sorted({name for one in every for name in one["shared"]})
    unit = _spelt(one["unit"] for one in every)
    spelt = {name: _spelt(one["shared"].get(name, "") for one in every) for name in factors}
    models: dict[str, set[str]] = {}
    for one in every:
        models.setdefault(unit[one["unit"]], set()).add(one["model"])
    named = {
        (name, model): f"{name} ({model})" if len(known) > 1 else name
        for name, known in models.items()
        for model in known
    }
    return [
        {
            **one,
            "unit": named[unit[one["unit"]], one["model"]],
            "shared": {name: spelt[name][level] for name, level in one["shared"].items()},
        }
        for one in every
    ]


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
        return day_clock.moment(time_d * 86_400.0).date().isoformat()
    except (ValueError, OverflowError, OSError):
        return f"day {time_d:.0f}"
