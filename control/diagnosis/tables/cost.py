"""What an effect costs in the field: rate error and place error at the machine's set-points."""
from __future__ import annotations

from control.diagnosis.cost import WITHOUT_MODEL, OperatingPoint, rate_error_percent
from control.diagnosis.effects import ROWS
from control.diagnosis.result import FieldCost
from control.experiments.levels import USUAL_MPS
from control.machine.fall import start_drop_s
from control.machine.machine import Machine
from control.machine.start import response_s

from .piece import SizedEffect, with_effects


def field_cost(machine: Machine, effect: SizedEffect, speed_mps: float | None) -> FieldCost:
    """Applied over wanted - 1 in %, and landed minus wanted in m, if the controller does not know of the effect.

    The flow trim is taken as on for an effect of the scale: the machine then follows a wrong scale. A lag taken off
    distances at a wrong speed is a wrong lag. What the heads' effects cost depends on the crop and is left open (None).
    """
    costs = ROWS[effect.candidate.id].costs
    if costs in WITHOUT_MODEL:
        return WITHOUT_MODEL[costs]
    changed = with_effects(machine, (effect,))
    speed = speed_mps if speed_mps is not None else USUAL_MPS
    points = (OperatingPoint(machine.set_points.shaft_rpm, machine.set_points.opening_mm, machine.flow.full_kg, speed),)
    rate = rate_error_percent(machine, points, changed, points)
    learnt_percent = changed.fall.speed_scale_percent - machine.fall.speed_scale_percent
    place = (speed * (_lag_s(changed) - _lag_s(machine)) + changed.fall.lever_arm_m - machine.fall.lever_arm_m
             + speed * _lag_s(machine) * learnt_percent / 100.0)
    return FieldCost(rate, place)


def _lag_s(machine: Machine) -> float:
    """Whole lag of a start at the set-point, the worst of its direction; s."""
    fall, rpm = machine.fall, machine.set_points.shaft_rpm
    return (response_s(machine, rpm) + start_drop_s(fall, rpm) + fall.latency_s + fall.first_fill_s
            + 0.5 * abs(fall.asymmetry_s))
