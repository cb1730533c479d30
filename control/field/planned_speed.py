"""Finds the speed that the job plans for the machine's present pass."""

from __future__ import annotations

from math import cos, floor, radians, sin

from topdress.control.field.job import Job

# Angle from the passes' heading, degrees, beyond which the machine is on no pass.
ALONG_PASS_DEG = 30.0


def find_pass_number(
    job: Job, width_m: float, east_m: float, north_m: float, heading_deg: float
) -> int | None:
    """Return the number of the pass, from 1 at the origin to the right of the passes' heading,
    by working width; None between passes and before the first. Positions are on the field's plane.
    """
    along = job.field.pass_heading_deg
    off = (heading_deg - along + 90.0) % 180.0 - 90.0
    across_m = east_m * cos(radians(along)) - north_m * sin(radians(along))
    if abs(off) > ALONG_PASS_DEG or across_m < 0.0:
        return None
    return floor(across_m / width_m) + 1


def find_planned_mps(
    job: Job, width_m: float, place_m: tuple[float, float] | None, heading_deg: float | None
) -> float | None:
    """Return the planned speed of the pass at a position, m/s; the last entry of a list applies to
    all further passes.

    The result is None without a plan, or for a list where the pass is unknown: the pass requires
    the field's boundary.
    """
    kmh = job.planned_speed_kmh
    if kmh is None or isinstance(kmh, float | int):
        return None if kmh is None else kmh / 3.6
    if place_m is None or heading_deg is None or not job.field.boundary_m:
        return None
    number = find_pass_number(job, width_m, *place_m, heading_deg)
    return None if number is None else kmh[min(number, len(kmh)) - 1] / 3.6
