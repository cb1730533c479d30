"""How are the records of a fleet combined? A season has time courses of the effects, effects that
machines share, and costs.
"""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from topdress.control.diagnosis.season.effect_timelines import SeasonFit, fit_season
from topdress.control.diagnosis.season.log_evidence import LogWork, SeasonLog
from topdress.control.diagnosis.season.season_cost import (
    LogCostInput,
    LowHopperOperator,
    MachineCost,
    find_low_hoppers,
    rank_machines_by_cost,
)
from topdress.drivers import day_clock

# Earliest plausible begin, 2000-01-01 in days since 1970, and the time by which a log's clock may
# be ahead of this one, days.
FIRST_PLAUSIBLE_DAY, MAX_DAYS_AHEAD = 10_957.0, 1.0


class MistimedLog(NamedTuple):
    """Names a log whose clock is certainly wrong; it is diagnosed, but excluded from time courses
    and sums."""

    path: str
    date: str


class FleetSeason(NamedTuple):
    """Holds the combined records of a fleet.

    `units` are units of effects. `broken` has path and reason. `by_file_date` counts the logs whose
    only time is that of their file.
    """

    machines: tuple[MachineCost, ...]
    fit: SeasonFit
    low: tuple[LowHopperOperator, ...]
    logs: tuple[LogCostInput, ...]
    units: Mapping[str, str]
    broken: tuple[tuple[str, str], ...]
    aside: tuple[MistimedLog, ...] = ()
    by_file_date: int = 0


def make_season(
    records: Sequence[Mapping[str, Any]], broken: Sequence[tuple[str, str]], now_d: float
) -> FleetSeason:
    """Returns the season of a fleet.

    `records` are those of `fleet_job.read_record`, with their key. `now_d` is in days since 1970.
    """
    timely, aside = list[Mapping[str, Any]](), list[MistimedLog]()
    for one in records:
        if FIRST_PLAUSIBLE_DAY <= one["time_d"] <= now_d + MAX_DAYS_AHEAD:
            timely.append(one)
        else:
            aside.append(MistimedLog(one["path"], _format_date(one["time_d"])))
    named = unify_spelling(timely)
    logs = [
        SeasonLog(one["key"], one["unit"], one["time_d"], tuple(one["forms"]), one["shared"])
        for one in named
    ]
    owners = [
        LogCostInput(
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
    fit = fit_season(logs)
    return FleetSeason(
        tuple(rank_machines_by_cost(owners, fit)),
        fit,
        tuple(find_low_hoppers(owners)),
        tuple(owners),
        units,
        tuple(broken),
        tuple(aside),
        sum(one["time_from"] == "file" for one in timely),
    )


def unify_spelling(records: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Returns records with uniform spelling of names that differ only in capitals or blanks. A
    machine whose logs have several models becomes several machines."""
    every = list(records)
    factors = sorted({name for one in every for name in one["shared"]})
    unit = _find_common_spelling(one["unit"] for one in every)
    spelt = {
        name: _find_common_spelling(one["shared"].get(name, "") for one in every)
        for name in factors
    }
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


def _find_common_spelling(names: Iterable[str]) -> dict[str, str]:
    """Returns the most frequent spelling of each name."""
    counts = Counter(names)
    best: dict[str, str] = {}
    for name, _ in counts.most_common():
        best.setdefault(_fold_name(name), " ".join(name.split()))
    return {name: best[_fold_name(name)] for name in counts}


def _fold_name(name: str) -> str:
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())


def _format_date(time_d: float) -> str:
    """Returns the date, or its number if no calendar reaches it."""
    try:
        return day_clock.convert_to_utc(time_d * 86_400.0).date().isoformat()
    except (ValueError, OverflowError, OSError):
        return f"day {time_d:.0f}"
