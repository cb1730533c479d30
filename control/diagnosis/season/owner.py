"""What a season of logs means to the owner: kilograms spread wrongly by machine, and who lets the hopper run low."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from control.diagnosis.judgement.gaussian import Array

from .courses import Course, SeasonFit, Shared
from .evidence import LogWork
from .mixed import FLEET

LOW_P = 1e-3                # of an operator, that chance made the hopper run low so often
LEAST_OPERATOR_LOGS = 5
LOW_RATIO = 2.0             # times the others' minutes an hour


class OwnersLog(NamedTuple):
    """One log along with its evidence. percent: dose error per unit of an effect. shared: factor -> level."""

    key: str
    machine: str
    time_d: float
    worked: LogWork
    percent: Mapping[str, float]
    shared: Mapping[str, str]


Doses = tuple[Course | Shared, Array, Array]    # in % of each log: what all of a set agree on; its largest


class Cost(NamedTuple):
    """What a cause spread wrongly: kilograms by what all of its set agree on, and by the one of it that costs most."""

    cause: Course | Shared
    kg: float
    most_kg: float


class MachineSeason(NamedTuple):
    """wrong_kg: what was spread too much or too little, by what all alternatives of each set agree on; most_kg: by the
    costliest of each. now_percent: of the dose at its last log, by the machine itself; others_percent: by what that
    log's operator, product and field do. courses, shared (what its logs share with others'): costliest first."""

    machine: str
    logs: int
    hours: float
    applied_kg: float
    wrong_kg: float
    most_kg: float
    now_percent: float
    others_percent: float
    courses: tuple[Cost, ...]
    shared: tuple[Cost, ...]


class Low(NamedTuple):
    """An operator who works with the hopper nearly empty: minutes an hour, against the others'."""

    operator: str
    logs: int
    minutes_per_hour: float
    others: float
    p: float


def machines(logs: Sequence[OwnersLog], fit: SeasonFit) -> list[MachineSeason]:
    """Worst first, by kilograms. What a product shares is the product's, and counts where it was spread.

    Each effect's kilograms count by themselves; in the sum of a log effects may make up for each other.
    """
    result = []
    for machine in sorted({one.machine for one in logs}):
        own = sorted((one for one in logs if one.machine == machine), key=lambda one: one.time_d)
        kg = np.array([one.worked.applied_kg for one in own])
        mine = [_doses(one, own) for one in fit.courses if one.machine == machine]
        others = [_doses(one, own) for one in fit.shared]
        agreed = sum((one[1] for one in (*mine, *others)), np.zeros(len(own)))
        most = sum((one[2] for one in (*mine, *others)), np.zeros(len(own)))
        result.append(MachineSeason(
            machine, len(own), sum(one.worked.hours for one in own), float(kg.sum()), _kg(agreed, kg), _kg(most, kg),
            sum(float(low[-1]) for _, low, _ in mine), sum(float(low[-1]) for _, low, _ in others), _costs(mine, kg),
            tuple(one for one in _costs(others, kg) if one.most_kg)))
    return sorted(result, key=lambda one: (-one.wrong_kg, -one.most_kg))


def _kg(doses: Array, kg: Array) -> float:
    return float(np.abs(doses) @ kg / 100.0)


def _costs(of: Sequence[Doses], kg: Array) -> tuple[Cost, ...]:
    found = [Cost(cause, _kg(low, kg), _kg(high, kg)) for cause, low, high in of]
    return tuple(sorted(found, key=lambda one: (-one.kg, -one.most_kg)))


def _doses(cause: Course | Shared, own: Sequence[OwnersLog]) -> Doses:
    """Dose error in % of each log: what all of the set agree on, and that of the set's largest."""
    sizes = np.array([at(cause, one.time_d) if isinstance(cause, Course) else cause.size * has(cause, one)
                      for one in own])
    here = cause.pieces[-1].end if isinstance(cause, Course) else cause.size
    shares = [(cause.effect, 1.0), *((other.effect, other.size / here if here else 0.0)       # of the same shape
                                     for other in cause.alternatives if other.effect != cause.effect)]
    doses = np.stack([sizes * share * np.array([one.percent.get(effect, 0.0) for one in own])
                      for effect, share in shares])
    least = doses[np.argmin(np.abs(doses), axis=0), np.arange(len(own))]
    agreed = np.where(np.all(doses > 0.0, axis=0) | np.all(doses < 0.0, axis=0), least, 0.0)
    return cause, agreed, doses[np.argmax(np.abs(doses), axis=0), np.arange(len(own))]


def has(one: Shared, log: OwnersLog) -> bool:
    """Whether a log is of a level."""
    return one.factor == FLEET or log.shared.get(one.factor) == one.level


def at(course: Course, time_d: float) -> float:
    """Size by the pieces of a course; before the first and after the last as there."""
    for piece in course.pieces:
        if time_d <= piece.end_d or piece is course.pieces[-1]:
            if piece.end_d <= piece.begin_d:
                return piece.begin
            share = min(1.0, max(0.0, (time_d - piece.begin_d) / (piece.end_d - piece.begin_d)))
            return piece.begin + share * (piece.end - piece.begin)
    return 0.0


def still_there(cause: Course | Shared) -> bool:
    """Whether it is there at the end: what was repaired calls for nothing."""
    if isinstance(cause, Shared):
        return True
    last = cause.pieces[-1]
    return abs(last.end) > last.end_half


def low_hoppers(logs: Sequence[OwnersLog]) -> list[Low]:
    """Operators whose hours with a nearly empty hopper are more than the others' (Mann and Whitney's test)."""
    found = []
    rates = [(one.shared.get("operator", ""), 60.0 * one.worked.low_minutes / max(60.0 * one.worked.hours, 1e-9))
             for one in logs if one.worked.hours > 0.0]
    for operator in sorted({name for name, _ in rates if name}):
        own = [rate for name, rate in rates if name == operator]
        others = [rate for name, rate in rates if name and name != operator]
        if len(own) < LEAST_OPERATOR_LOGS or len(others) < LEAST_OPERATOR_LOGS:
            continue
        from scipy.stats import mannwhitneyu  # takes half a second to load, and is seldom asked for
        p = float(mannwhitneyu(own, others, alternative="greater").pvalue)
        if p < LOW_P and np.mean(own) > LOW_RATIO * np.mean(others):
            found.append(Low(operator, len(own), float(np.mean(own)), float(np.mean(others)), p))
    return sorted(found, key=lambda one: -one.minutes_per_hour)
