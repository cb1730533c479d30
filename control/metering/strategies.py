"""Opening first, speed first, balanced: which pair of true shaft speed and opening gives a wanted flow."""
from __future__ import annotations

from typing import NamedTuple

from control.machine.fall import drop_s
from control.machine.machine import Machine
from control.orders import Strategy

from .inverse import Conditions, flow_kg_s, lowest_flow_kg_s, opening_for, shaft_for


class Pair(NamedTuple):
    """True shaft speed and opening. `limited`: "", "lowest", "highest" or "zero" (less than half the lowest)."""

    shaft_rpm: float
    opening_mm: float
    limited: str = ""


def pair_for(machine: Machine, strategy: Strategy, wanted_kg_s: float, opening_now_mm: float,
             c: Conditions = Conditions(), shaft_rpm: float | None = None, at_mm: float | None = None) -> Pair:
    """The pair that gives `wanted_kg_s`, kg/s, within the limits of the drives.

    `opening_now_mm`: at zero rate the shaft stops and the gate stays where it is. `shaft_rpm`: opening first at this
    shaft speed instead of the set-point; `at_mm`: speed first at this opening. Balanced is opening first where it is
    not known what a change of the shaft does to what falls. Below half the smallest flow: zero; between that and it:
    the smallest.
    """
    limits = machine.limits
    lowest = lowest_flow_kg_s(machine, c)
    if not wanted_kg_s > 0.5 * lowest:
        return Pair(0.0, opening_now_mm, "" if wanted_kg_s <= 0.0 else "zero")
    if wanted_kg_s < lowest:
        return Pair(limits.shaft_low_rpm, limits.opening_low_mm, "lowest")
    if strategy is Strategy.SPEED_FIRST:
        return _speed_first(machine, wanted_kg_s, at_mm or machine.set_points.opening_mm, c)
    if strategy is Strategy.BALANCED and machine.stream_carries:
        return _balanced(machine, wanted_kg_s, c)
    return _opening_first(machine, wanted_kg_s, shaft_rpm or machine.set_points.shaft_rpm, c)


def _opening_first(machine: Machine, wanted: float, shaft_rpm: float, c: Conditions) -> Pair:
    low, high = machine.limits.opening_low_mm, machine.limits.opening_high_mm
    opening = opening_for(machine, wanted, shaft_rpm, c)
    if low <= opening <= high:
        return Pair(shaft_rpm, opening)
    opening = min(high, max(low, opening))
    return _within_shaft(machine, wanted, opening, c)


def _speed_first(machine: Machine, wanted: float, opening_mm: float, c: Conditions) -> Pair:
    low, high = machine.limits.shaft_low_rpm, machine.limits.shaft_high_rpm
    shaft = shaft_for(machine, wanted, opening_mm, c)
    if low <= shaft <= high:
        return Pair(shaft, opening_mm)
    shaft = min(high, max(low, shaft))
    opening = opening_for(machine, wanted, shaft, c)
    if opening > machine.limits.opening_high_mm:
        return Pair(shaft, machine.limits.opening_high_mm, "highest")
    return Pair(shaft, max(machine.limits.opening_low_mm, opening))


def _within_shaft(machine: Machine, wanted: float, opening_mm: float, c: Conditions) -> Pair:
    shaft = shaft_for(machine, wanted, opening_mm, c)
    if shaft > machine.limits.shaft_high_rpm:
        return Pair(machine.limits.shaft_high_rpm, opening_mm, "highest")
    return Pair(max(machine.limits.shaft_low_rpm, shaft), opening_mm)


CANDIDATE_SHARES = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0)
TYPICAL_CHANGE = 0.15           # share of the rate by which it changes from one grade to the next


def _balanced(machine: Machine, wanted: float, c: Conditions) -> Pair:
    """The constant shaft speed at which a typical change of rate, met by the gate, misses least on the ground.

    Candidates are shaft speeds up to the end of the lag model's range. The predicted mean |landed - target| of one
    gives: rounding of the opening (coarse at small openings), the gate's transition, and the spread of drop times
    between the shaft speeds of the change (none where the gate alone moves). Extended effects enter through the model.
    """
    best: Pair | None = None
    best_miss = float("inf")
    top = min(machine.limits.shaft_high_rpm, machine.fall.valid_to_rpm)
    for share in CANDIDATE_SHARES:
        pair = _opening_first(machine, wanted, max(machine.limits.shaft_low_rpm, share * top), c)
        miss = _predicted_miss(machine, pair, c)
        if miss < best_miss:
            best, best_miss = pair, miss
    assert best is not None
    return best


def _predicted_miss(machine: Machine, pair: Pair, c: Conditions) -> float:
    """Relative |landed - target| of holding `pair` and changing its flow by TYPICAL_CHANGE, model in hand."""
    flow = max(1e-9, flow_kg_s(machine, pair.shaft_rpm, pair.opening_mm, c))
    p = machine.gate
    doubt_mm = 0.25 * machine.limits.opening_resolution_mm + 0.5 * p.backlash_mm + machine.tolerance.opening_mm
    high = flow_kg_s(machine, pair.shaft_rpm, pair.opening_mm + doubt_mm, c)
    low = flow_kg_s(machine, pair.shaft_rpm, pair.opening_mm - doubt_mm, c)
    rounding = 0.5 * (high - low) / flow
    moved_mm = TYPICAL_CHANGE * pair.opening_mm
    transition_s = moved_mm / max(0.5, p.slew_mm_s - p.slow_mm_s)
    tremor = 0.25 * machine.limits.shaft_resolution_rpm / max(1.0, pair.shaft_rpm)
    outside = max(0.0, pair.shaft_rpm - machine.fall.valid_to_rpm) / 30.0
    fall_s = drop_s(machine.fall, pair.shaft_rpm)
    return rounding + tremor + TYPICAL_CHANGE * (0.25 * transition_s + 0.02 * fall_s) + 0.05 * outside
