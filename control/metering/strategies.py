"""Opening first and speed first: which pair of true shaft speed and opening gives a wanted flow."""
from __future__ import annotations

from typing import NamedTuple

from control.machine.machine import Machine
from control.orders import Strategy

from .inverse import Conditions, lowest_flow_kg_s, opening_for, shaft_for
from .trims import NOTHING_LEFT, Left


class Pair(NamedTuple):
    """True shaft speed and opening. `limited`: "", "lowest", "highest" or "zero" (less than half the lowest)."""

    shaft_rpm: float
    opening_mm: float
    limited: str = ""


def pair_for(machine: Machine, strategy: Strategy, wanted_kg_s: float, opening_now_mm: float,
             c: Conditions = Conditions(), at_mm: float | None = None, left: Left = NOTHING_LEFT) -> Pair:
    """The pair that gives `wanted_kg_s`, kg/s, within the limits of the drives.

    `opening_now_mm`: at zero rate the shaft stops and the gate stays where it is. `at_mm`: speed first at this opening.
    `left`: what the drives are off; the one that moves makes up for it.
    Below half the smallest flow: zero; between that and it: the smallest.
    """
    limits = machine.limits
    lowest = lowest_flow_kg_s(machine, c)
    if not wanted_kg_s > 0.5 * lowest:
        return Pair(0.0, opening_now_mm, "" if wanted_kg_s <= 0.0 else "zero")
    if wanted_kg_s < lowest:
        return Pair(limits.shaft_low_rpm, limits.opening_low_mm, "lowest")
    if strategy is Strategy.SPEED_FIRST:
        return _speed_first(machine, wanted_kg_s, at_mm or machine.set_points.opening_mm, c, left)
    return _opening_first(machine, wanted_kg_s, c, left)


def _opening_first(machine: Machine, wanted: float, c: Conditions, left: Left) -> Pair:
    low, high, shaft_rpm = machine.limits.opening_low_mm, machine.limits.opening_high_mm, machine.set_points.shaft_rpm
    opening = opening_for(machine, wanted, (1.0 + left.shaft_share) * shaft_rpm, c) - left.gate_mm
    if low <= opening <= high:
        return Pair(shaft_rpm, opening)
    opening = min(high, max(low, opening))
    return _within_shaft(machine, wanted, opening, c)


def _speed_first(machine: Machine, wanted: float, opening_mm: float, c: Conditions, left: Left) -> Pair:
    low, high = machine.limits.shaft_low_rpm, machine.limits.shaft_high_rpm
    shaft = shaft_for(machine, wanted, opening_mm + left.gate_mm, c) / (1.0 + left.shaft_share)
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
