"""Calculates the cost of a season for the owner: wrongly spread mass by machine, and operators who
let the hopper run low.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.diagnosis.judgement.gaussian import Array

from .effect_timelines import SeasonCause, SeasonFit
from .log_evidence import LogWork
from .mixed_model import FLEET_FACTOR, MACHINE_FACTOR, Alternative

# Maximum p value for an operator whose hopper runs low more often than by chance.
MAX_LOW_HOPPER_P_VALUE = 1e-3
# Minimum number of logs of an operator.
MIN_OPERATOR_LOGS = 5
# Minimum ratio to the other operators' minutes per hour.
MIN_LOW_MINUTES_RATIO = 2.0


class LogCostInput(NamedTuple):
    """One log with its evidence. percent: dose error per unit of an effect. shared: level of each
    factor."""

    key: str
    machine: str
    time_d: float
    worked: LogWork
    percent: Mapping[str, float]
    shared: Mapping[str, str]


class CauseCost(NamedTuple):
    """Mass that a cause spread wrongly, kg: expected value, lower bound by all alternatives, and
    upper bound by the costliest alternative."""

    cause: SeasonCause
    kg: float
    least_kg: float
    most_kg: float


class MachineCost(NamedTuple):
    """Cost of one machine. wrong_kg: expected mass spread too much or too little, over all causes
    with the probabilities of their sets.

    least_kg: lower bound by all alternatives of each set; most_kg: upper bound by the costliest of
    each. now_percent: expected dose error at the last log from the machine itself, between
    now_least and now_most; others_percent: from that log's operator, product and field. costs: of
    its own and shared causes, costliest first.
    """

    machine: str
    logs: int
    hours: float
    applied_kg: float
    wrong_kg: float
    least_kg: float
    most_kg: float
    now_percent: float
    now_least: float
    now_most: float
    others_percent: float
    costs: tuple[CauseCost, ...]


class LowHopperOperator(NamedTuple):
    """An operator who works with a nearly empty hopper: minutes per hour, against the other
    operators."""

    operator: str
    logs: int
    minutes_per_hour: float
    others: float
    p: float


def rank_machines_by_cost(logs: Sequence[LogCostInput], fit: SeasonFit) -> list[MachineCost]:
    """Return the machines by wrongly spread mass, worst first. A product's cause belongs to the
    product, and counts where the product was spread.

    The masses of effects are added in absolute value; in a log effects may compensate each other.
    """
    result, by_machine = [], dict[str, list[LogCostInput]]()
    for log in logs:
        by_machine.setdefault(log.machine, []).append(log)
    of_level = dict[tuple[str, str], list[SeasonCause]]()
    for cause in (*fit.courses, *fit.shared):
        of_level.setdefault((cause.factor, cause.level), []).append(cause)
    for machine, own in by_machine.items():
        own.sort(key=lambda one: (one.time_d, one.key))
        kg = np.array([one.worked.applied_kg for one in own])
        keys = [
            (MACHINE_FACTOR, machine),
            *sorted({key for one in own for key in one.shared.items()}),
            (FLEET_FACTOR, ""),
        ]
        doses = {one: _calc_dose_errors(one, own) for key in keys for one in of_level.get(key, [])}
        none = np.zeros((3, len(own)))
        mine, others = (
            sum(
                (each for one, each in doses.items() if (one.factor == MACHINE_FACTOR) is its_own),
                none,
            )
            for its_own in (True, False)
        )
        wrong, least, most = _sum_dose_error_kg(mine + others, kg)
        now, now_least, now_most = mine[:, -1].tolist()
        costs = sorted(
            (CauseCost(one, *_sum_dose_error_kg(each, kg)) for one, each in doses.items()),
            key=lambda one: (-one.kg, -one.most_kg),
        )
        result.append(
            MachineCost(
                machine,
                len(own),
                sum(one.worked.hours for one in own),
                float(kg.sum()),
                wrong,
                least,
                most,
                now,
                now_least,
                now_most,
                float(others[0, -1]),
                tuple(costs),
            )
        )
    return sorted(result, key=lambda one: (-one.wrong_kg, -one.most_kg, one.machine))


def _sum_dose_error_kg(doses: Array, kg: Array) -> tuple[float, float, float]:
    expected, least, most = (np.abs(doses) @ kg / 100.0).tolist()
    return expected, least, most


def _calc_dose_errors(cause: SeasonCause, own: Sequence[LogCostInput]) -> Array:
    """Return the dose error in % of each log, (3, n): expected value, lower bound by all
    alternatives, and the largest alternative.

    An alternative effect is assumed to have the time course of the cause.
    """
    level = cause.factor, cause.level
    set_ = cause.alternatives or (Alternative(*level, cause.effect, cause.final_size, 1.0),)
    sizes = np.array([find_size_at(cause, one.time_d) * is_of_level(*level, one) for one in own])
    own_size = next(
        (one.size for one in set_ if (one.factor, one.level, one.effect) == (*level, cause.effect)),
        # Sizes of alternatives refer to the last log with the cause.
        cause.final_size,
    )
    doses = np.stack(
        [
            np.array([each.percent.get(one.effect, 0.0) for each in own])
            * (
                sizes * (one.size / own_size if own_size else 0.0)
                if (one.factor, one.level) == level
                else np.array([one.size * is_of_level(one.factor, one.level, each) for each in own])
            )
            for one in set_
        ]
    )
    weights = np.array([one.probability for one in set_])
    each = np.arange(len(own))
    ends = doses[np.argmin(np.abs(doses), axis=0), each]
    # All three are weighted with the probability that any alternative is present, so that the
    # expected value lies between the other two.
    return cause.probability * np.stack(
        [
            (weights / weights.sum()) @ doses,
            np.where(np.all(doses > 0.0, axis=0) | np.all(doses < 0.0, axis=0), ends, 0.0),
            doses[np.argmax(np.abs(doses), axis=0), each],
        ]
    )


def is_of_level(factor: str, level: str, log: LogCostInput) -> bool:
    """Tell whether a log has a level."""
    return (
        factor == FLEET_FACTOR
        or (log.machine if factor == MACHINE_FACTOR else log.shared.get(factor)) == level
    )


def find_size_at(cause: SeasonCause, time_d: float) -> float:
    """Return the size at a time by the pieces of a course; constant before the first and after the
    last, and between two as at the start of the next."""
    if not cause.pieces:
        return cause.size
    piece = next((one for one in cause.pieces if time_d <= one.end_d), cause.pieces[-1])
    return float(np.interp(time_d, (piece.begin_d, piece.end_d), (piece.begin, piece.end)))


def is_still_there(cause: SeasonCause) -> bool:
    """Tell whether the cause is present at the end: a repaired cause needs no action."""
    return not cause.pieces or abs(cause.final_size) > cause.pieces[-1].end_half


def find_low_hoppers(logs: Sequence[LogCostInput]) -> list[LowHopperOperator]:
    """Return the operators who work with a nearly empty hopper for longer than the others (test of
    Mann and Whitney)."""
    found, rates = [], dict[str, list[float]]()
    for one in logs:
        if one.worked.hours > 0.0 and (operator := one.shared.get("operator", "")):
            rates.setdefault(operator, []).append(
                60.0 * one.worked.low_minutes / max(60.0 * one.worked.hours, 1e-9)
            )
    all_logs, total = sum(map(len, rates.values())), sum(map(sum, rates.values()))
    for operator, own in rates.items():
        rest, mean = all_logs - len(own), sum(own) / len(own)
        if min(len(own), rest) < MIN_OPERATOR_LOGS or mean <= MIN_LOW_MINUTES_RATIO * (
            usual := (total - sum(own)) / rest
        ):
            continue
        # scipy.stats takes half a second to import and is rarely needed.
        from scipy.stats import mannwhitneyu

        others = [rate for name, of in rates.items() if name != operator for rate in of]
        p = float(mannwhitneyu(own, others, alternative="greater").pvalue)
        if p < MAX_LOW_HOPPER_P_VALUE:
            found.append(LowHopperOperator(operator, len(own), mean, usual, p))
    return sorted(found, key=lambda one: (-one.minutes_per_hour, one.operator))
