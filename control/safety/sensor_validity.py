"""Which sensors can be trusted in this tick? Pure: the inputs are readings and limits, the
results plain values.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from topdress.control.readings import (
    MAX_AHEAD_S,
    Reading,
    RefusedSpeed,
    find_valid_value,
    is_reading_fresh,
)
from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.safety_interface import SafetySituation


class ValidReadings(NamedTuple):
    """Holds the valid readings of this tick; None means silent, missing, not a number, or (for a
    speed) not trusted."""

    # Whether an epoch with a fix exists that is not older than its limit.
    gnss_ok: bool
    gnss_speed_mps: float | None
    gnss_course_deg: float | None
    gnss_epoch_s: float | None
    # Wheel speed, m/s; 0 for a standing wheel.
    wheel_speed_mps: float | None
    # The speed that control uses.
    speed_mps: float | None
    # Time of the newest GNSS or wheel speed, s.
    speed_heard_s: float | None
    hopper_kg: float | None
    shaft_rpm: float | None
    opening_mm: float | None
    # Whether every canopy head with a valid reading reads more than any canopy.
    heads_full: bool
    supply_v: float | None = None

    @property
    def is_shaft_heard(self) -> bool:
        return self.shaft_rpm is not None

    @property
    def is_gate_heard(self) -> bool:
        return self.opening_mm is not None


def judge_readings(now_s: float, s: SafetySituation, limits: SafetyLimits) -> ValidReadings:
    """Returns the readings of situation `s` that are valid at `now_s` (seconds on the loop's
    clock)."""
    m = s.measurements
    fix = m.gnss
    gnss_ok, gnss_speed, course, epoch = False, None, None, None
    if fix is not None:
        epoch = fix.time_s
        period_s = min(s.gnss_period_s, limits.gnss_period_max_s)
        silent_s = max(limits.gnss_silent_s, limits.gnss_silent_periods * period_s)
        gnss_ok = is_reading_fresh(epoch, now_s, silent_s) and fix.fix_quality > 0
        if gnss_ok:
            gnss_speed, course = _select_finite(fix.speed_mps), _select_finite(fix.heading_deg)
    wheel, refused = m.wheel_speed_mps, None if s.speed_doubt is None else s.speed_doubt.refused
    if refused in (RefusedSpeed.GNSS, RefusedSpeed.EITHER):
        gnss_speed = None
    wheel_speed = (
        0.0
        if s.wheel_standstill
        else None
        if refused in (RefusedSpeed.WHEEL, RefusedSpeed.EITHER)
        else find_valid_value(wheel, now_s, limits.wheel_silent_s)
    )
    heard_s = epoch if fix is not None and _select_finite(fix.speed_mps) is not None else None
    if heard_s is not None and not heard_s <= now_s + MAX_AHEAD_S:
        heard_s = None
    if (
        wheel is not None
        and wheel.time_s <= now_s + MAX_AHEAD_S
        and (heard_s is None or wheel.time_s > heard_s)
    ):
        heard_s = wheel.time_s
    return ValidReadings(
        gnss_ok,
        gnss_speed,
        course,
        epoch,
        wheel_speed,
        _select_finite(s.speed_used_mps),
        heard_s,
        find_valid_value(m.hopper_kg, now_s, limits.scale_silent_s),
        find_valid_value(m.shaft_rpm, now_s, limits.drive_silent_s),
        find_valid_value(m.opening_mm, now_s, limits.drive_silent_s),
        _are_heads_full(now_s, m.ndvi, limits),
        find_valid_value(m.supply_v, now_s, limits.supply_silent_s),
    )


def _are_heads_full(now_s: float, heads: tuple[Reading | None, ...], limits: SafetyLimits) -> bool:
    heard = False
    for head in heads:
        value = find_valid_value(head, now_s, limits.ndvi_silent_s)
        if value is not None and not value >= limits.heads_full_ndvi:
            return False
        heard = heard or value is not None
    return heard


def _select_finite(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) else None


def find_since_s(before_s: float | None, now_s: float, condition: bool) -> float | None:
    """Returns the time since when a condition holds without a break; None while it does not
    hold."""
    if not condition:
        return None
    return now_s if before_s is None else before_s


def has_lasted(since_s: float | None, now_s: float, for_s: float) -> bool:
    """Returns whether a condition has held for at least `for_s` seconds."""
    return since_s is not None and now_s - since_s >= for_s
