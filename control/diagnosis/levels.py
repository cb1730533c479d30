"""Shaft speeds and openings of a staircase that an operator drives: shares of the machine's ranges."""
from __future__ import annotations

from control.machine.effect import OPENING_RANGE, SHAFT_RANGE
from control.machine.machine import Machine, of_nominal

SHAFT_RPM = (20.0, 40.0, 60.0, 80.0)        # on the nominal machine, as the next
OPENING_MM = (10.0, 20.0, 30.0, 40.0)


def shaft_levels(machine: Machine) -> tuple[float, ...]:
    """r/min, none below the slowest that the shaft turns at."""
    scale = of_nominal(machine, SHAFT_RANGE)
    return tuple(round(max(machine.limits.shaft_low_rpm, scale * rpm), 1) for rpm in SHAFT_RPM)


def opening_levels(machine: Machine) -> tuple[float, ...]:
    """mm, none below the smallest opening."""
    scale = of_nominal(machine, OPENING_RANGE)
    return tuple(round(max(machine.limits.opening_low_mm, scale * mm), 1) for mm in OPENING_MM)
