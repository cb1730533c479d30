"""What a season of logs means to the owner: kilograms spread wrongly by machine, and who lets the hopper run low."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import mannwhitneyu

from .courses import Course, Shared
from .evidence import Worked

WEAR_P = 1e-3               # of a slope, that it is noise
REPAIR_SHARE = 0.25         # of an effect, that a repair takes away at least
LOW_P = 1e-3                # of an operator, that chance made the hopper run low so often
LEAST_OPERATOR_LOGS = 5
LOW_RATIO = 2.0             # times the others' minutes an hour


class Told(NamedTuple):
    """One log beside its evidence. percent: dose error per unit of an effect. shared: factor -> level."""

    key: str
    machine: str
    time_d: float
    worked: Worked
    percent: Mapping[str, float]
    shared: Mapping[str, str]


class MachineSeason(NamedTuple):
    """wrong_kg: what was spread too much or too little; now_percent: of the dose, at its last log. courses: costliest
    first, with the kg of each; shared: what its logs share with others', the same."""

    machine: str
    logs: int
    hours: float
    applied_kg: float
    wrong_kg: float
    now_percent: float
    courses: tuple[tuple[Course, float], ...]
    shared: tuple[tuple[Shared, float], ...]


class Low(NamedTuple):
    """An operator who works with the hopper nearly empty: minutes an hour, against the others'."""

    operator: str
    logs: int
    minutes_per_hour: float
    others: float
    p: float


def machines(told: Sequence[Told], found: Sequence[Course], shared: Sequence[Shared]) -> list[MachineSeason]:
    """Worst first, by kilograms. What a product shares is the product's, and counts where it was spread.

    Each effect's kilograms count by themselves; in the sum of a log effects may make up for each other.
    """
    result = []
    for machine in sorted({one.machine for one in told}):
        own = sorted((one for one in told if one.machine == machine), key=lambda one: one.time_d)
        mine = [course for course in found if course.machine == machine]
        percent = [np.array([at(course, one.time_d) * one.percent.get(course.effect, 0.0) for one in own])
                   for course in mine]
        kg = np.array([one.worked.applied_kg for one in own])
        levels = [np.array([_percent(one, log) for log in own]) for one in shared]
        whole = sum((*percent, *levels), np.zeros(len(own)))
        wrong = np.abs(whole) @ kg / 100.0
        costs = [(course, float(np.abs(one) @ kg / 100.0)) for course, one in zip(mine, percent, strict=True)]
        others = [(one, float(np.abs(each) @ kg / 100.0)) for one, each in zip(shared, levels, strict=True)]
        now = float(whole[-1])
        result.append(MachineSeason(machine, len(own), sum(one.worked.hours for one in own), float(kg.sum()),
                                    float(wrong), now, tuple(sorted(costs, key=lambda each: -each[1])),
                                    tuple(sorted((each for each in others if each[1]), key=lambda each: -each[1]))))
    return sorted(result, key=lambda one: -one.wrong_kg)


def _percent(one: Shared, log: Told) -> float:
    """Dose error of one log by what it shares with others."""
    return one.size * log.percent.get(one.effect, 0.0) if log.shared.get(one.factor) == one.level else 0.0


def at(course: Course, time_d: float) -> float:
    """Size by the pieces of a course; before the first and after the last as there."""
    for piece in course.pieces:
        if time_d <= piece.end_d or piece is course.pieces[-1]:
            if piece.end_d <= piece.begin_d:
                return piece.begin
            share = min(1.0, max(0.0, (time_d - piece.begin_d) / (piece.end_d - piece.begin_d)))
            return piece.begin + share * (piece.end - piece.begin)
    return 0.0


def wears(course: Course) -> bool:
    """Whether its last piece grows away from zero."""
    last = course.pieces[-1]
    return last.per_day_p < WEAR_P and last.per_day * last.end > 0.0


def repaired_d(course: Course) -> list[float]:
    """When it jumped towards zero, by more than its uncertainty and a part of it that is worth the name."""
    return [0.5 * (a.end_d + b.begin_d) for a, b in zip(course.pieces, course.pieces[1:], strict=False)
            if abs(b.begin) < (1.0 - REPAIR_SHARE) * abs(a.end) and abs(a.end - b.begin) > a.end_half + b.begin_half]


def low_hoppers(told: Sequence[Told]) -> list[Low]:
    """Operators whose hours with a nearly empty hopper are more than the others' (Mann and Whitney's test)."""
    found = []
    rates = [(one.shared.get("operator", ""), 60.0 * one.worked.low_minutes / max(60.0 * one.worked.hours, 1e-9))
             for one in told if one.worked.hours > 0.0]
    for operator in sorted({name for name, _ in rates if name}):
        own = [rate for name, rate in rates if name == operator]
        others = [rate for name, rate in rates if name and name != operator]
        if len(own) < LEAST_OPERATOR_LOGS or len(others) < LEAST_OPERATOR_LOGS:
            continue
        p = float(mannwhitneyu(own, others, alternative="greater").pvalue)
        if p < LOW_P and np.mean(own) > LOW_RATIO * np.mean(others):
            found.append(Low(operator, len(own), float(np.mean(own)), float(np.mean(others)), p))
    return sorted(found, key=lambda one: -one.minutes_per_hour)
