"""Calculates the cost of an uncompensated effect in the field: the dose, through the machine model.

Control sets shaft speed and opening by the nominal machine, takes the ground speed from a wheel or
a receiver, and trims the flow by the scale. Control trusts all three. So the dose is proportional
to the flow and to the measured speed, and inversely proportional to the measured mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from topdress.control.diagnosis.effects import CostKind
from topdress.control.diagnosis.result import FieldCost
from topdress.control.experiments.setting_levels import USUAL_SPEED_MPS
from topdress.control.machine.flow import FlowInput, FlowState, step_flow
from topdress.control.machine.machine import Machine
from topdress.control.machine.scale import ScaleInput, read_scale
from topdress.control.machine.speed import SpeedInput, make_speed_start, step_speed

# Time over which the measured mass is integrated, s.
STEP_S = 1.0
# Causes are ordered by consequence: 0.1 m of position error counts as 1 % of rate error.
PERCENT_PER_METRE = 10.0
# Costs of effects outside the machine model; the cost of a head's error depends on the crop.
COSTS_OUTSIDE_MODEL = {CostKind.CROP: FieldCost(None, None), CostKind.NEITHER: FieldCost(0.0, 0.0)}


class OperatingPoint(NamedTuple):
    """One operating point: true positions of the drives, and the operating conditions."""

    shaft_rpm: float
    opening_mm: float
    hopper_kg: float
    speed_mps: float = USUAL_SPEED_MPS
    pitch_deg: float = 0.0
    # Time since the run began, s.
    time_s: float = 0.0
    # 1 while the machine pulls under load, else 0.
    working: float = 1.0
    # Number of refills so far.
    refills: float = 0.0


def integrate_dose_kg(machine: Machine, points: Sequence[OperatingPoint]) -> float:
    """Return the mass that leaves the machine over operating points, kg, for a second at each
    point.

    Control trusts its sensors: the speed at each point, and the mass by the scale over all points,
    because the trim is slow.
    """
    left = asked = reported = 0.0
    for point in points:
        state = FlowState(point.time_s, point.hopper_kg, 0.0, point.refills)
        asked_of = FlowInput(point.shaft_rpm, point.opening_mm, point.pitch_deg)
        kg = step_flow(machine.flow, state, asked_of, STEP_S)[1].flow_kg_s * STEP_S
        left += kg
        asked += kg * _calc_speed_ratio(machine, point)
        reported += _calc_measured_mass(machine, point, kg)
    return asked * left / reported if reported > 0.0 else asked


def _calc_speed_ratio(machine: Machine, point: OperatingPoint) -> float:
    """Return measured over true speed, whichever of the two sensors control uses: an effect changes
    only one of them."""
    true = point.speed_mps
    if true <= 0.0:
        return 1.0
    _, reported = step_speed(
        machine.speed,
        make_speed_start(true),
        SpeedInput(true, point.working, point.pitch_deg),
        STEP_S,
    )
    return reported.wheel_mps * reported.gnss_mps / true**2


def _calc_measured_mass(machine: Machine, point: OperatingPoint, left_kg: float) -> float:
    """Return the mass that the scale reports when `left_kg` have left; 0 while nothing leaves."""
    if left_kg <= 0.0:
        return 0.0
    before = read_scale(machine.scale, ScaleInput(point.hopper_kg, point.time_s, point.pitch_deg))
    after = read_scale(
        machine.scale, ScaleInput(point.hopper_kg - left_kg, point.time_s + STEP_S, point.pitch_deg)
    )
    return before - after


def calc_rate_error(
    nominal: Machine,
    wanted: Sequence[OperatingPoint],
    changed: Machine,
    applied: Sequence[OperatingPoint],
) -> float | None:
    """Return applied over target rate minus 1, %, over operating points; None where the target is
    zero.

    wanted : operating points at the nominal machine's positions. applied : those of the changed
    machine under the same commands.
    """
    asked = integrate_dose_kg(nominal, wanted)
    return 100.0 * (integrate_dose_kg(changed, applied) / asked - 1.0) if asked > 0.0 else None


def calc_consequence(cost: FieldCost) -> float:
    """Return the consequence by which causes are ordered, % of the dose; an unknown cost counts as
    zero."""
    return abs(cost.rate_error_percent or 0.0) + PERCENT_PER_METRE * abs(cost.place_error_m or 0.0)
