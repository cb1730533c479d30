"""Has the machine started, since when does it stand, and does it reverse? The module stores the
movement.
"""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.safety_interface import SafetySituation
from topdress.control.safety.sensor_validity import ValidReadings, find_since_s


class MotionState(NamedTuple):
    """Holds the movement of the machine after a tick."""

    # Whether the machine has exceeded the start speed, and not fallen below the stop speed since.
    moving: bool = False
    standing_since_s: float | None = None
    speed_lost_since_s: float | None = None
    # Time since which the wheel stands while GNSS moves, s.
    wheel_doubt_since_s: float | None = None
    # Last trusted course, degrees.
    course_deg: float | None = None
    course_epoch_s: float | None = None
    # Whether the machine has stood since that course.
    stood: bool = False
    reversing: bool = False
    # Time since which material flows with START held, before the machine counts as moving, s.
    launched_since_s: float | None = None
    launching: bool = False
    # Whether a course was trusted since the last standstill.
    course_since_stood: bool = False


def update_motion(
    before: MotionState,
    now_s: float,
    s: SafetySituation,
    seen: ValidReadings,
    allow_reverse: bool,
    limits: SafetyLimits,
    start_held: bool = False,
    by_gnss: bool = False,
) -> MotionState:
    """Returns the movement after this tick. by_gnss: whether the wheel has failed and work without
    it is permitted.

    Reversing: the GNSS course differs by more than `reverse_flip_deg` from the last course before a
    standstill, until the course flips again across a standstill. A turn without a standstill has no
    effect. After a standstill the machine counts as moving only once its course is known again
    (where it was known before), or reversing is permitted. Launching: the machine creeps, START is
    held, and its course is known since the standstill (or was never known); at most `launch_max_s`
    for one press.
    """
    speed, gnss = seen.speed_mps, seen.gnss_speed_mps
    slow = speed is not None and speed < limits.stop_speed_mps
    standing = s.wheel_standstill or (speed is not None and speed < limits.standstill_speed_mps)
    course, epoch, stood, reversing = (
        before.course_deg,
        before.course_epoch_s,
        before.stood,
        before.reversing,
    )
    if (
        seen.gnss_course_deg is not None
        and gnss is not None
        and gnss >= limits.course_speed_mps
        and seen.gnss_epoch_s != epoch
    ):
        if (
            stood
            and course is not None
            and _calc_turn_deg(course, seen.gnss_course_deg) > limits.reverse_flip_deg
        ):
            reversing = not reversing
        course, epoch, stood = seen.gnss_course_deg, seen.gnss_epoch_s, False
    stood = stood or slow or standing or (gnss is not None and gnss < limits.course_speed_mps)
    may_start = allow_reverse or not (stood and course is not None)
    since_stood = not standing and (before.course_since_stood or epoch != before.course_epoch_s)
    both = limits.both_speeds_to_start and not by_gnss
    moving = _is_moving(before.moving, may_start, seen, s.wheel_standstill, limits, both)
    way_known = allow_reverse or before.course_deg is None or since_stood
    creeping = (
        start_held
        and not moving
        and way_known
        and _is_creeping(seen, s.wheel_standstill, limits, both)
    )
    launched = before.launched_since_s if start_held and not moving else None
    if launched is None and creeping:
        launched = now_s
    return MotionState(
        moving,
        find_since_s(before.standing_since_s, now_s, standing),
        find_since_s(before.speed_lost_since_s, now_s, speed is None),
        find_since_s(
            before.wheel_doubt_since_s,
            now_s,
            (s.wheel_standstill or by_gnss)
            and gnss is not None
            and gnss > limits.wheel_fault_speed_mps,
        ),
        course,
        epoch,
        stood,
        reversing,
        launched,
        creeping and launched is not None and now_s - launched < limits.launch_max_s,
        since_stood,
    )


def is_awaiting_course(motion: MotionState) -> bool:
    """Returns whether the machine has stood since its last course, so that its direction is
    unknown."""
    return motion.stood and motion.course_deg is not None


def _is_moving(
    was: bool,
    may_start: bool,
    seen: ValidReadings,
    wheel_standstill: bool,
    limits: SafetyLimits,
    both_to_start: bool,
) -> bool:
    speed, wheel, gnss, stop = (
        seen.speed_mps,
        seen.wheel_speed_mps,
        seen.gnss_speed_mps,
        limits.stop_speed_mps,
    )
    if speed is None or wheel_standstill or not speed >= stop:
        return False
    if was:
        return True
    both = wheel is not None and wheel >= stop and gnss is not None and gnss >= stop
    return may_start and speed >= limits.start_speed_mps and (both or not both_to_start)


def _is_creeping(
    seen: ValidReadings, wheel_standstill: bool, limits: SafetyLimits, both_to_start: bool
) -> bool:
    """Returns whether the used speed and both speed sensors show that the machine has started to
    move; a single sensor suffices where only one is fitted."""
    least = limits.launch_speed_mps
    moving = [v is not None and v >= least for v in (seen.wheel_speed_mps, seen.gnss_speed_mps)]
    both = all(moving) if both_to_start else any(moving)
    return not wheel_standstill and seen.speed_mps is not None and both


def _calc_turn_deg(a: float, b: float) -> float:
    return abs((b - a + 180.0) % 360.0 - 180.0)
