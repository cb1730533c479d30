"""What forbids flow in this tick? Every condition is written so that an unknown value or a NaN
forbids flow.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from topdress.control.orders import PLACE_SOURCES, State
from topdress.control.safety.alarm_conditions import is_target_acceptable
from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.memory import Allowances
from topdress.control.safety.motion import MotionState, is_awaiting_course
from topdress.control.safety.safety_interface import SafetySituation
from topdress.control.safety.sensor_validity import ValidReadings
from topdress.control.signals import N_

INTERLOCKS: Mapping[str, str] = MappingProxyType(
    {
        "not_working": N_("The machine is not in work."),
        "drive_silent": N_("A drive does not answer."),
        "speed_silent": N_("There is no travel speed."),
        "standstill": N_("The wheel stands still."),
        "low_speed": N_("Too slow, or not yet fast enough on both speed sensors to start."),
        "wheel_speed_missing": N_(
            "The wheel sensor is silent, and both speed sensors must move to start: check it, or "
            "allow GNSS alone (H)."
        ),
        "gnss_speed_missing": N_(
            "GNSS tells no speed, and both speed sensors must move to start: check the receiver."
        ),
        "reversing": N_("The machine runs backwards."),
        "course_unknown": N_("Its course after the standstill is not known yet."),
        "position_lost": N_("There is no usable position."),
        "outside_field": N_("What is released now would land outside the field."),
        "map_elsewhere": N_(
            "The map lies somewhere else: only its rate for outside would be spread."
        ),
        "work_switch_up": N_("The work switch is up or silent."),
        "log_failed": N_("The log cannot be written."),
        "below_range": N_("The rate is less than half of the least that flows at this speed."),
        "target_refused": N_("The target is above the product's limit or not a number."),
    }
)


def find_interlocks(
    state: State,
    s: SafetySituation,
    seen: ValidReadings,
    motion: MotionState,
    allow: Allowances,
    has_work_switch: bool,
    below_range: bool,
    limits: SafetyLimits,
) -> tuple[str, ...]:
    """Returns the ids of the interlocks that forbid flow in `state`; an empty result allows flow.

    `below_range`: whether the alarm for a rate below the machine's range is live. Calibrating has
    its own rules in place of the speed, field and target interlocks.
    """
    drives = () if seen.is_shaft_heard and seen.is_gate_heard else ("drive_silent",)
    switch_up = s.measurements.work_switch is False or (
        has_work_switch and s.measurements.work_switch is None
    )
    switch = ("work_switch_up",) if switch_up else ()
    if state is State.CALIBRATING:
        return drives + switch
    if state is not State.WORKING:
        return ("not_working", *drives) if state is not State.OFF else ("not_working",)
    return (
        *drives,
        *_check_speed(s, seen, motion, allow, limits),
        *_check_place(s, allow),
        *switch,
        *_check_records(s, allow, limits),
        *(("below_range",) if below_range and _is_shaft_resting(s) else ()),
    )


def _is_shaft_resting(s: SafetySituation) -> bool:
    """Returns whether the wanted rate is so far below the machine's range that its shaft is
    stopped."""
    return s.range_breach is not None and s.range_breach.given_kg_ha <= 0.0


def _check_speed(
    s: SafetySituation,
    seen: ValidReadings,
    motion: MotionState,
    allow: Allowances,
    limits: SafetyLimits,
) -> tuple[str, ...]:
    if seen.speed_mps is None:
        return ("speed_silent",)
    if s.wheel_standstill:
        return ("standstill",)
    if not motion.moving and not motion.launching:
        fast_enough = seen.speed_mps >= limits.start_speed_mps
        if fast_enough and is_awaiting_course(motion):
            return ("course_unknown",)
        return (_name_missing_speed(s, seen, limits) if fast_enough else "low_speed",)
    return ("reversing",) if motion.reversing and not allow.reverse else ()


def _name_missing_speed(s: SafetySituation, seen: ValidReadings, limits: SafetyLimits) -> str:
    """Returns the interlock of a machine whose used speed is sufficient but which has not
    started."""
    if not limits.both_speeds_to_start or s.speed_doubt is not None:
        return "low_speed"
    if seen.wheel_speed_mps is None:
        return "wheel_speed_missing"
    return "gnss_speed_missing" if seen.gnss_speed_mps is None else "low_speed"


def _check_place(s: SafetySituation, allow: Allowances) -> tuple[str, ...]:
    where = "course_unknown" if s.course_awaited else "position_lost"
    lost = (where,) if s.target_source in PLACE_SOURCES and not s.position_ok else ()
    outside = ("outside_field",) if s.landing_inside is False and not allow.outside else ()
    elsewhere = ("map_elsewhere",) if s.map_elsewhere and not allow.map_elsewhere else ()
    return lost + outside + elsewhere


def _check_records(s: SafetySituation, allow: Allowances, limits: SafetyLimits) -> tuple[str, ...]:
    log = () if s.log_ok or allow.unlogged else ("log_failed",)
    return log if is_target_acceptable(s, limits) else (*log, "target_refused")
