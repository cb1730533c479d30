"""At which settings are experiments made? Shares of the machine's ranges, and the usual ground
speed."""

from __future__ import annotations

from collections.abc import Sequence

from topdress.control.machine.effect import OPENING_RANGE, SHAFT_RANGE
from topdress.control.machine.machine import Machine, scale_nominal

# Steps of a staircase on the nominal machine, r/min and mm.
SHAFT_RPM = (20.0, 40.0, 60.0, 80.0)
OPENING_MM = (10.0, 20.0, 30.0, 40.0)
# Ground speed where data have none, m/s (decision paper: about 4.5 km/h).
USUAL_SPEED_MPS = 1.25


def list_shaft_levels(
    machine: Machine, nominal_rpm: Sequence[float] = SHAFT_RPM
) -> tuple[float, ...]:
    """Returns shaft speeds on this machine, r/min, none below its slowest."""
    scale = scale_nominal(machine, SHAFT_RANGE)
    return tuple(round(max(machine.limits.shaft_low_rpm, scale * rpm), 1) for rpm in nominal_rpm)


def list_opening_levels(
    machine: Machine, nominal_mm: Sequence[float] = OPENING_MM
) -> tuple[float, ...]:
    """Returns openings on this machine, mm, none below its smallest."""
    scale = scale_nominal(machine, OPENING_RANGE)
    return tuple(round(max(machine.limits.opening_low_mm, scale * mm), 1) for mm in nominal_mm)
