"""Estimates the remaining area, product, distance and time of a job from its field and plan.
Pure.
"""

from __future__ import annotations

from typing import NamedTuple

from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.panel_views import format_time_left
from topdress.console.app.units import M2_PER_HA, Units
from topdress.console.frame import Frame

# Before this working time, s, the pace of the work is unknown.
MIN_WORKED_TIME_S = 30.0


class RemainingWork(NamedTuple):
    """Holds the remaining work. None means unknown: the job has no field, or has hardly started."""

    area_ha: float | None = None
    product_kg: float | None = None
    way_m: float | None = None
    time_s: float | None = None

    def format_remaining(self, units: Units) -> str:
        """Return time, mass and distance in one line."""
        if self.area_ha is None and self.product_kg is None:
            return "--"
        parts = (
            format_time_left(self.time_s, is_short=True),
            units.mass.format_with_name(self.product_kg),
            units.choose_way_unit(self.way_m).format_with_name(self.way_m),
        )
        return "  ".join(parts)


def estimate_remaining(frame: Frame | None, picture: FieldPicture | None) -> RemainingWork:
    """Estimate the remaining work.

    The product follows the plan, else the mean rate so far; the time follows the pace so far.
    """
    if frame is None or picture is None:
        return RemainingWork()
    planned = picture.planned
    work_ha = picture.work_ha
    left_ha = None if work_ha is None else max(0.0, work_ha - frame.area_ha)
    # The first square metre gives no mean rate yet.
    worked = frame.area_ha > 1.0 / M2_PER_HA
    left_kg = None
    if planned is not None:
        left_kg = max(0.0, planned.planned_mass_kg - frame.applied_kg)
    elif left_ha is not None and worked:
        left_kg = left_ha * (frame.mean_rate_kg_ha or 0.0)
    way_m = None if left_ha is None else left_ha * M2_PER_HA / picture.width_m
    worked_s = frame.totals.worked_s if frame.totals is not None else 0.0
    time_s = None
    if left_ha is not None and worked and worked_s >= MIN_WORKED_TIME_S:
        # Time on hold belongs to the pace: refills and turns will occur again.
        held_s = frame.tally.held_s if frame.tally is not None else 0.0
        time_s = left_ha * (worked_s + held_s) / frame.area_ha
    return RemainingWork(left_ha, left_kg, way_m, time_s)
