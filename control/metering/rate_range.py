"""Which rates can a machine spread at a speed, and at which speeds can it spread a rate?

Both follow from the smallest and the largest flow that the limits of its drives allow."""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.machine.machine import Machine
from topdress.control.readings import RangeBreach

from .inverse_model import Conditions, calc_flow_kg_s, calc_lowest_flow_kg_s
from .strategies import ROUND_UP_SHARE, DrivePair

# The factor converts kg/m2 to kg/ha.
# Square metres of a hectare.
M2_PER_HA = 10_000.0


class RateRange(NamedTuple):
    """Holds the lowest and highest rate at one ground speed, kg/ha."""

    low_kg_ha: float
    high_kg_ha: float


class SpeedRange(NamedTuple):
    """Holds the slowest and fastest ground speed at one rate, m/s."""

    low_mps: float
    high_mps: float


def _find_flow_range_kg_s(machine: Machine, c: Conditions) -> tuple[float, float]:
    limits = machine.limits
    highest = calc_flow_kg_s(machine, limits.shaft_high_rpm, limits.opening_high_mm, c)
    return calc_lowest_flow_kg_s(machine, c), highest


def find_rate_range(
    machine: Machine, speed_mps: float, width_m: float, c: Conditions = Conditions()
) -> RateRange:
    """Returns the lowest and highest rate that the limits of the drives allow.

    Parameters
    ----------
    machine
        The machine model with the limits of its drives.
    speed_mps
        Ground speed, m/s, above 0.
    width_m
        Spread width, m, above 0: less than the working width where sections are closed.
    c
        Conditions of the flow besides the two set-points.
    """
    low, high = (
        M2_PER_HA * flow / (width_m * speed_mps) for flow in _find_flow_range_kg_s(machine, c)
    )
    return RateRange(low, high)


def find_least_rate_kg_ha(machine: Machine, speed_mps: float) -> float:
    """Returns the rate below which nothing flows at this ground speed, kg/ha: half of what the
    drives' lowest set-points give. speed_mps: above 0."""
    of_range = find_rate_range(machine, speed_mps, machine.geometry.working_width_m)
    return ROUND_UP_SHARE * of_range.low_kg_ha


def find_speed_range(
    machine: Machine, rate_kg_ha: float, width_m: float, c: Conditions = Conditions()
) -> SpeedRange:
    """Returns the slowest and fastest ground speed at which the machine can give `rate_kg_ha`,
    above 0.

    The parameters are those of `find_rate_range`.
    """
    low, high = (
        M2_PER_HA * flow / (width_m * rate_kg_ha) for flow in _find_flow_range_kg_s(machine, c)
    )
    return SpeedRange(low, high)


def find_breach(
    machine: Machine,
    pair: DrivePair,
    rate_kg_ha: float,
    speed_mps: float,
    width_m: float,
    c: Conditions,
) -> RangeBreach | None:
    """Returns the rate that the machine spreads in place of a rate beyond its range.

    Parameters
    ----------
    pair
        Planned positions of the drives, with the limit that was met (`DrivePair.limited`).
    rate_kg_ha
        The wanted rate.
    machine, speed_mps, width_m, c
        As for `find_rate_range`.

    Returns
    -------
    RangeBreach or None
        None where the rate is within the range, or the machine or its outlets are at rest.
    """
    if not pair.limited or min(rate_kg_ha, speed_mps, width_m) <= 0.0:
        return None
    above, usable = pair.limited == "highest", find_speed_range(machine, rate_kg_ha, width_m, c)
    given = M2_PER_HA * calc_flow_kg_s(machine, *pair[:2], c) / (width_m * speed_mps)
    return RangeBreach(above, rate_kg_ha, given, usable.high_mps if above else usable.low_mps)
