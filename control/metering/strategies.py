"""Which pair of true shaft speed and opening gives a wanted flow? The strategies opening first
and speed first."""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.machine.machine import Machine
from topdress.control.orders import Strategy

from .inverse_model import (
    Conditions,
    calc_flow_kg_s,
    calc_lowest_flow_kg_s,
    find_opening_mm,
    find_shaft_rpm,
)
from .trims import NO_ERROR, UncorrectedError

# Share of the lowest flow above which a wanted flow is rounded up to the lowest, and below which to
# none.
ROUND_UP_SHARE = 0.5


class DrivePair(NamedTuple):
    """Holds true shaft speed and opening. `limited` is the limit that was met: "", "lowest",
    "highest" or "zero" (less than half the lowest)."""

    shaft_rpm: float
    opening_mm: float
    limited: str = ""


class StrategyReach(NamedTuple):
    """Describes a strategy on one machine at one rate and ground speed: lowest and highest rate
    by its own drive, kg/ha; the smallest step of that drive, % of the flow; distance between the
    lumps of one row, m; change of the flow by 1 mm of the gate and by 1 r/min of the shaft, %."""

    low_kg_ha: float
    high_kg_ha: float
    step_percent: float
    lumps_m: float
    percent_mm: float
    percent_rpm: float


def describe_reach(
    machine: Machine, strategy: Strategy, rate_kg_ha: float, speed_mps: float
) -> StrategyReach | None:
    """Describes a strategy at this rate and speed; None where the machine stands or nothing
    flows. Beyond the ends of the range the other drive helps."""
    limits, sets = machine.limits, machine.set_points
    to_kg_ha = 10_000.0 / (machine.geometry.working_width_m * speed_mps) if speed_mps > 0.0 else 0.0
    pair = (
        find_pair(machine, strategy, rate_kg_ha / to_kg_ha, sets.opening_mm)
        if to_kg_ha
        else DrivePair(0.0, 0.0)
    )
    by_shaft = strategy is Strategy.SPEED_FIRST
    ends = (
        [(rpm, sets.opening_mm) for rpm in (limits.shaft_low_rpm, limits.shaft_high_rpm)]
        if by_shaft
        else [(sets.shaft_rpm, mm) for mm in (limits.opening_low_mm, limits.opening_high_mm)]
    )
    low, high = (to_kg_ha * calc_flow_kg_s(machine, *end) for end in ends)
    if pair.shaft_rpm <= 0.0:
        return None
    flow = calc_flow_kg_s(machine, *pair[:2])
    percent_mm = 100.0 * (
        calc_flow_kg_s(machine, pair.shaft_rpm, pair.opening_mm + 1.0) / flow - 1.0
    )
    percent_rpm = 100.0 * (
        calc_flow_kg_s(machine, pair.shaft_rpm + 1.0, pair.opening_mm) / flow - 1.0
    )
    step = (
        limits.shaft_resolution_rpm * percent_rpm
        if by_shaft
        else limits.opening_resolution_mm * percent_mm
    )
    return StrategyReach(
        low,
        high,
        step,
        60.0 * speed_mps / (machine.flow.flutes * pair.shaft_rpm),
        percent_mm,
        percent_rpm,
    )


def find_pair(
    machine: Machine,
    strategy: Strategy,
    wanted_kg_s: float,
    opening_now_mm: float,
    c: Conditions = Conditions(),
    at_mm: float | None = None,
    left: UncorrectedError = NO_ERROR,
) -> DrivePair:
    """Returns the pair that gives `wanted_kg_s` within the limits of the drives. Below half the
    smallest flow the pair is zero, between that and the smallest flow it is the smallest.

    Parameters
    ----------
    machine, strategy : the machine model and the strategy. wanted_kg_s : flow, kg/s. opening_now_mm
    : present opening, mm: at zero rate the shaft stops and the gate stays there. c : conditions of
    the flow. at_mm : opening of speed first, mm; None means the machine's set-point. left : errors
    of the drives, which the moving drive compensates.
    """
    limits = machine.limits
    lowest = calc_lowest_flow_kg_s(machine, c)
    if not wanted_kg_s > ROUND_UP_SHARE * lowest:
        return DrivePair(0.0, opening_now_mm, "" if wanted_kg_s <= 0.0 else "zero")
    if wanted_kg_s < lowest:
        return DrivePair(limits.shaft_low_rpm, limits.opening_low_mm, "lowest")
    if strategy is Strategy.SPEED_FIRST:
        return _find_speed_first(
            machine, wanted_kg_s, at_mm or machine.set_points.opening_mm, c, left
        )
    return _find_opening_first(machine, wanted_kg_s, c, left)


def _find_opening_first(
    machine: Machine, wanted: float, c: Conditions, left: UncorrectedError
) -> DrivePair:
    low, high, shaft_rpm = (
        machine.limits.opening_low_mm,
        machine.limits.opening_high_mm,
        machine.set_points.shaft_rpm,
    )
    opening = (
        find_opening_mm(machine, wanted, (1.0 + left.shaft_share) * shaft_rpm, c) - left.gate_mm
    )
    if low <= opening <= high:
        return DrivePair(shaft_rpm, opening)
    opening = min(high, max(low, opening))
    return _find_shaft_within_limits(machine, wanted, opening, c)


def _find_speed_first(
    machine: Machine, wanted: float, opening_mm: float, c: Conditions, left: UncorrectedError
) -> DrivePair:
    low, high = machine.limits.shaft_low_rpm, machine.limits.shaft_high_rpm
    shaft = find_shaft_rpm(machine, wanted, opening_mm + left.gate_mm, c) / (1.0 + left.shaft_share)
    if low <= shaft <= high:
        return DrivePair(shaft, opening_mm)
    shaft = min(high, max(low, shaft))
    opening = find_opening_mm(machine, wanted, shaft, c)
    if opening > machine.limits.opening_high_mm:
        return DrivePair(shaft, machine.limits.opening_high_mm, "highest")
    return DrivePair(shaft, max(machine.limits.opening_low_mm, opening))


def _find_shaft_within_limits(
    machine: Machine, wanted: float, opening_mm: float, c: Conditions
) -> DrivePair:
    shaft = find_shaft_rpm(machine, wanted, opening_mm, c)
    if shaft > machine.limits.shaft_high_rpm:
        return DrivePair(machine.limits.shaft_high_rpm, opening_mm, "highest")
    return DrivePair(max(machine.limits.shaft_low_rpm, shaft), opening_mm)
