"""Which set-points give this flow? The machine model solved for its set-points, effects
included."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from topdress.control.machine.flow import Flow, common_factor, grams_per_rev
from topdress.control.machine.machine import Machine
from topdress.control.machine.shaft import Shaft
from topdress.control.machine.term_sums import StandingTerms
from topdress.control.machine.terms import Acts

OF_FLOW = (Acts.FLOW_PERCENT, Acts.FLOW_KG_MIN)
OF_SHAFT = (Acts.SHAFT_PERCENT, Acts.SHAFT_RPM)
OF_GATE = (Acts.GATE_MM,)
# Greatest number of iterations with terms in the model.
MOST_ROUNDS = 20
# An iteration ends within this step, mm and r/min.
SETTLED_MM, SETTLED_RPM = 1e-4, 1e-4
# Least share of the flow that is divided by: with every outlet blocked no opening is wide enough.
LEAST_LEFT = 1e-3
# Least share of a drive's command or of the flow that known errors are assumed to leave.
LEAST_SHARE = 0.2


class Conditions(NamedTuple):
    """Holds the conditions that the model's steady state depends on besides the set-points."""

    elapsed_s: float = 0.0
    hopper_kg: float | None = None
    pitch_deg: float = 0.0
    supply_v: float | None = None
    refilled: bool = False
    # This factor is the scale's correction of the flow model.
    flow_trim: float = 1.0
    # These are the terms of the machine file that control knows.
    terms: StandingTerms | None = None
    # This is `common_of` these conditions, where it is calculated once for many set-points.
    common: float | None = None


def common_of(
    p: Flow, elapsed_s: float, hopper_kg: float | None, pitch_deg: float, refilled: bool
) -> float:
    """Returns the factor on every flow whatever the set-points are, without the scale's
    correction."""
    full = 1.0 if hopper_kg is None else min(1.0, max(0.0, hopper_kg / p.full_kg))
    return common_factor(p, full, elapsed_s, pitch_deg, 0.0, refilled)


def standing_factor(p: Flow, c: Conditions) -> float:
    """Returns the factor on every flow whatever the set-points are, with the scale's correction."""
    common = c.common
    if common is None:
        common = common_of(p, c.elapsed_s, c.hopper_kg, c.pitch_deg, c.refilled)
    return common * c.flow_trim


def flow_kg_s(
    machine: Machine, shaft_rpm: float, opening_mm: float, c: Conditions = Conditions()
) -> float:
    """Returns the steady flow, kg/s.

    Parameters
    ----------
    machine : the machine model.
    shaft_rpm, opening_mm : true shaft speed, r/min, and true opening, mm.
    c : conditions; their `flow_trim` is included."""
    flow = (
        grams_per_rev(machine.flow, shaft_rpm, opening_mm)
        * shaft_rpm
        / 60_000.0
        * standing_factor(machine.flow, c)
    )
    if c.terms is None or shaft_rpm <= 0.0:
        return flow
    more = c.terms.at(OF_FLOW, shaft_rpm=shaft_rpm, opening_mm=opening_mm)
    return max(
        0.0, flow * (1.0 + more.flow_percent / 100.0) + more.flow_kg_min / 60.0 * c.flow_trim
    )


def opening_for(
    machine: Machine, wanted_kg_s: float, shaft_rpm: float, c: Conditions = Conditions()
) -> float:
    """Returns the true opening, mm, that gives `wanted_kg_s` at a true `shaft_rpm` above 0. It
    is not limited."""
    if c.terms is not None:
        return _opening_with_terms(machine, wanted_kg_s, shaft_rpm, c, c.terms)
    p = machine.flow
    at_500_mm = grams_per_rev(p, shaft_rpm, 500.0)
    slope = (grams_per_rev(p, shaft_rpm, 1000.0) - at_500_mm) / 500.0
    needed = wanted_kg_s * 60_000.0 / (shaft_rpm * max(LEAST_LEFT, standing_factor(p, c)))
    return 500.0 + (needed - at_500_mm) / slope


def _opening_with_terms(
    machine: Machine, wanted_kg_s: float, shaft_rpm: float, c: Conditions, terms: StandingTerms
) -> float:
    """Returns the same with terms that act on the flow: they are inserted anew until the opening
    stands still."""
    bare, limits = c._replace(terms=None), machine.limits
    opening = opening_for(machine, wanted_kg_s, shaft_rpm, bare)
    for _ in range(MOST_ROUNDS):
        at = min(limits.opening_high_mm, max(limits.opening_low_mm, opening))
        more = terms.at(OF_FLOW, shaft_rpm=shaft_rpm, opening_mm=at)
        left = wanted_kg_s - more.flow_kg_min / 60.0 * c.flow_trim
        share = max(LEAST_SHARE, 1.0 + more.flow_percent / 100.0)
        found = opening_for(machine, max(0.0, left) / share, shaft_rpm, bare)
        if abs(found - opening) < SETTLED_MM:
            return found
        opening = found
    return opening


def shaft_for(
    machine: Machine, wanted_kg_s: float, opening_mm: float, c: Conditions = Conditions()
) -> float:
    """Returns the true shaft speed, r/min, that gives `wanted_kg_s` at a true opening; infinity
    where the highest does not."""
    low, high = 0.0, machine.limits.shaft_high_rpm
    most = flow_kg_s(machine, high, opening_mm, c)
    if wanted_kg_s <= 0.0:
        return 0.0
    if wanted_kg_s > most * (1.0 + 1e-12):
        return inf
    given = 0.0
    for _ in range(60):
        guess = low + (high - low) * (wanted_kg_s - given) / (most - given)
        if guess <= low + 1e-9 or guess >= high - 1e-9:
            return min(high, max(low, guess))
        flow = flow_kg_s(machine, guess, opening_mm, c)
        if abs(flow - wanted_kg_s) <= 1e-7 * wanted_kg_s:
            return guess
        if flow < wanted_kg_s:
            low, given = guess, flow
        else:
            high, most = guess, flow
    return 0.5 * (low + high)


def shaft_command(
    machine: Machine, wanted_rpm: float, opening_mm: float, c: Conditions = Conditions()
) -> float:
    """Returns the command that turns the shaft at a true `wanted_rpm`, with known gain, sag,
    droop and neutral point inverted. 0 stops the shaft."""
    p = machine.shaft
    kept = abs(1.0 + p.gain_percent / 100.0)
    if c.supply_v is not None:
        kept *= 1.0 - p.sag_percent_per_v * max(0.0, p.nominal_supply_v - c.supply_v) / 100.0
    kept *= 1.0 - p.droop_percent * opening_mm / p.full_opening_mm / 100.0
    command = _asked_for(p, wanted_rpm / max(LEAST_SHARE, kept))
    if c.terms is None:
        return command
    bare = max(LEAST_SHARE, kept)
    for _ in range(MOST_ROUNDS):
        more = c.terms.at(OF_SHAFT, told_rpm=command, opening_mm=opening_mm)
        found = _asked_for(
            p,
            max(0.0, wanted_rpm - more.shaft_rpm)
            / max(LEAST_SHARE, bare * (1.0 + more.shaft_percent / 100.0)),
        )
        if abs(found - command) < SETTLED_RPM:
            return found
        command = found
    return command


def _asked_for(p: Shaft, settled_rpm: float) -> float:
    """Returns the forward command of a settled speed (`asked_rpm`), with its curve, dead zone
    and neutral point inverted."""
    if settled_rpm <= 0.0:
        return 0.0
    bend = p.saturation_percent / (100.0 - p.saturation_percent) * settled_rpm / p.full_rpm
    beyond = settled_rpm / max(LEAST_SHARE, 1.0 - bend) + p.dead_zone_rpm
    return p.neutral_rpm - beyond if p.gain_percent < -100.0 else p.neutral_rpm + beyond


def gate_command(machine: Machine, wanted_mm: float, c: Conditions = Conditions()) -> float:
    """Returns the command that opens the gate to a true `wanted_mm`, with known homing error and
    terms inverted."""
    command = wanted_mm - machine.gate.home_error_mm
    if c.terms is None:
        return command
    bare = command
    for _ in range(MOST_ROUNDS):
        found = bare - c.terms.at(OF_GATE, told_mm=command).gate_mm
        if abs(found - command) < SETTLED_MM:
            return found
        command = found
    return command


def lowest_flow_kg_s(machine: Machine, c: Conditions = Conditions()) -> float:
    """Returns the smallest flow above 0 that the drives' limits allow, kg/s."""
    return flow_kg_s(machine, machine.limits.shaft_low_rpm, machine.limits.opening_low_mm, c)
