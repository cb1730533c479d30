"""Which set-points give this flow? The module solves the machine model for its set-points,
effects included.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from topdress.control.machine.flow import Flow, calc_common_factor, calc_grams_per_rev
from topdress.control.machine.machine import Machine
from topdress.control.machine.shaft import Shaft, ShaftInput, calc_speed_factor
from topdress.control.machine.term_sums import FrozenTerms
from topdress.control.machine.terms import TermTarget

FLOW_TARGETS = (TermTarget.FLOW_PERCENT, TermTarget.FLOW_KG_MIN)
SHAFT_TARGETS = (TermTarget.SHAFT_PERCENT, TermTarget.SHAFT_RPM)
GATE_TARGETS = (TermTarget.GATE_MM,)
# Maximum number of iterations with terms in the model.
MAX_ROUNDS = 20
# An iteration ends within this step, mm and r/min.
TOLERANCE_MM, TOLERANCE_RPM = 1e-4, 1e-4
# Minimum share of the flow for a division: with every outlet blocked no opening is wide enough.
MIN_FLOW_SHARE = 1e-3
# Minimum share of a drive's command or of the flow that remains after known errors.
MIN_REMAINING_COMMAND_SHARE = 0.2


class Conditions(NamedTuple):
    """Holds the conditions that the model's steady state depends on besides the set-points."""

    elapsed_s: float = 0.0
    hopper_kg: float | None = None
    pitch_deg: float = 0.0
    supply_v: float | None = None
    refilled: bool = False
    # The scale's correction factor of the flow model.
    flow_trim: float = 1.0
    # Terms of the machine file that control can evaluate.
    terms: FrozenTerms | None = None
    # Value of `calc_conditions_factor` for these conditions, where it is calculated once for many
    # set-points.
    common: float | None = None


def calc_conditions_factor(
    p: Flow, elapsed_s: float, hopper_kg: float | None, pitch_deg: float, refilled: bool
) -> float:
    """Returns the factor on every flow that is independent of the set-points, without the
    scale's correction."""
    full = 1.0 if hopper_kg is None else min(1.0, max(0.0, hopper_kg / p.full_kg))
    return calc_common_factor(p, full, elapsed_s, pitch_deg, 0.0, refilled)


def calc_standing_factor(p: Flow, c: Conditions) -> float:
    """Returns the factor on every flow that is independent of the set-points, with the scale's
    correction."""
    common = c.common
    if common is None:
        common = calc_conditions_factor(p, c.elapsed_s, c.hopper_kg, c.pitch_deg, c.refilled)
    return common * c.flow_trim


def calc_flow_kg_s(
    machine: Machine, shaft_rpm: float, opening_mm: float, c: Conditions = Conditions()
) -> float:
    """Returns the steady flow, kg/s.

    Parameters
    ----------
    machine : the machine model.
    shaft_rpm, opening_mm : true shaft speed, r/min, and true opening, mm.
    c : conditions; their `flow_trim` is included."""
    flow = (
        calc_grams_per_rev(machine.flow, shaft_rpm, opening_mm)
        * shaft_rpm
        / 60_000.0
        * calc_standing_factor(machine.flow, c)
    )
    if c.terms is None or shaft_rpm <= 0.0:
        return flow
    more = c.terms.find_totals(FLOW_TARGETS, shaft_rpm=shaft_rpm, opening_mm=opening_mm)
    return max(
        0.0, flow * (1.0 + more.flow_percent / 100.0) + more.flow_kg_min / 60.0 * c.flow_trim
    )


def find_opening_mm(
    machine: Machine, wanted_kg_s: float, shaft_rpm: float, c: Conditions = Conditions()
) -> float:
    """Returns the true opening, mm, that gives `wanted_kg_s` at a true `shaft_rpm` above 0. It
    is not limited."""
    if c.terms is not None:
        return _find_opening_with_terms(machine, wanted_kg_s, shaft_rpm, c, c.terms)
    p = machine.flow
    at_500_mm = calc_grams_per_rev(p, shaft_rpm, 500.0)
    slope = (calc_grams_per_rev(p, shaft_rpm, 1000.0) - at_500_mm) / 500.0
    needed = wanted_kg_s * 60_000.0 / (shaft_rpm * max(MIN_FLOW_SHARE, calc_standing_factor(p, c)))
    return 500.0 + (needed - at_500_mm) / slope


def _find_opening_with_terms(
    machine: Machine, wanted_kg_s: float, shaft_rpm: float, c: Conditions, terms: FrozenTerms
) -> float:
    """Returns the opening with terms that affect the flow, mm: the terms are evaluated again
    until the opening converges."""
    bare, limits = c._replace(terms=None), machine.limits
    opening = find_opening_mm(machine, wanted_kg_s, shaft_rpm, bare)
    for _ in range(MAX_ROUNDS):
        at = min(limits.opening_high_mm, max(limits.opening_low_mm, opening))
        more = terms.find_totals(FLOW_TARGETS, shaft_rpm=shaft_rpm, opening_mm=at)
        left = wanted_kg_s - more.flow_kg_min / 60.0 * c.flow_trim
        share = max(MIN_REMAINING_COMMAND_SHARE, 1.0 + more.flow_percent / 100.0)
        found = find_opening_mm(machine, max(0.0, left) / share, shaft_rpm, bare)
        if abs(found - opening) < TOLERANCE_MM:
            return found
        opening = found
    return opening


def find_shaft_rpm(
    machine: Machine, wanted_kg_s: float, opening_mm: float, c: Conditions = Conditions()
) -> float:
    """Returns the true shaft speed, r/min, that gives `wanted_kg_s` at a true opening; infinity
    where the highest does not."""
    low, high = 0.0, machine.limits.shaft_high_rpm
    most = calc_flow_kg_s(machine, high, opening_mm, c)
    if wanted_kg_s <= 0.0:
        return 0.0
    if wanted_kg_s > most * (1.0 + 1e-12):
        return inf
    given = 0.0
    for _ in range(60):
        guess = low + (high - low) * (wanted_kg_s - given) / (most - given)
        if guess <= low + 1e-9 or guess >= high - 1e-9:
            return min(high, max(low, guess))
        flow = calc_flow_kg_s(machine, guess, opening_mm, c)
        if abs(flow - wanted_kg_s) <= 1e-7 * wanted_kg_s:
            return guess
        if flow < wanted_kg_s:
            low, given = guess, flow
        else:
            high, most = guess, flow
    return 0.5 * (low + high)


def find_shaft_command(
    machine: Machine, wanted_rpm: float, opening_mm: float, c: Conditions = Conditions()
) -> float:
    """Returns the command that turns the shaft at a true `wanted_rpm`, with its known
    factor (`calc_speed_factor`) and neutral point inverted. 0 stops the shaft."""
    p = machine.shaft
    supply_v = p.nominal_supply_v if c.supply_v is None else c.supply_v
    kept = calc_speed_factor(p, ShaftInput(0.0, opening_mm, supply_v, pitch_deg=c.pitch_deg))
    command = _invert_shaft_curve(p, wanted_rpm / max(MIN_REMAINING_COMMAND_SHARE, kept))
    if c.terms is None:
        return command
    bare = max(MIN_REMAINING_COMMAND_SHARE, kept)
    for _ in range(MAX_ROUNDS):
        more = c.terms.find_totals(SHAFT_TARGETS, told_rpm=command, opening_mm=opening_mm)
        found = _invert_shaft_curve(
            p,
            max(0.0, wanted_rpm - more.shaft_rpm)
            / max(MIN_REMAINING_COMMAND_SHARE, bare * (1.0 + more.shaft_percent / 100.0)),
        )
        if abs(found - command) < TOLERANCE_RPM:
            return found
        command = found
    return command


def _invert_shaft_curve(p: Shaft, settled_rpm: float) -> float:
    """Returns the forward command, r/min, that settles at a speed, with its curve, dead zone
    and neutral point inverted."""
    if settled_rpm <= 0.0:
        return 0.0
    bend = p.saturation_percent / (100.0 - p.saturation_percent) * settled_rpm / p.full_rpm
    beyond = settled_rpm / max(MIN_REMAINING_COMMAND_SHARE, 1.0 - bend) + p.dead_zone_rpm
    return p.neutral_rpm - beyond if p.gain_percent < -100.0 else p.neutral_rpm + beyond


def find_gate_command(machine: Machine, wanted_mm: float, c: Conditions = Conditions()) -> float:
    """Returns the command that opens the gate to a true `wanted_mm`, with known homing error and
    terms inverted."""
    command = wanted_mm - machine.gate.home_error_mm
    if c.terms is None:
        return command
    bare = command
    for _ in range(MAX_ROUNDS):
        found = bare - c.terms.find_totals(GATE_TARGETS, told_mm=command).gate_mm
        if abs(found - command) < TOLERANCE_MM:
            return found
        command = found
    return command


def calc_lowest_flow_kg_s(machine: Machine, c: Conditions = Conditions()) -> float:
    """Returns the smallest flow above 0 that the drives' limits allow, kg/s."""
    return calc_flow_kg_s(machine, machine.limits.shaft_low_rpm, machine.limits.opening_low_mm, c)
