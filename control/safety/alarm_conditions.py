"""Which alarms have their cause in this tick? The module is the table of losses, with a function
for each group of rows.
"""

from __future__ import annotations

from math import isfinite

from topdress.control.orders import CANOPY_SOURCES, PLACE_SOURCES, State
from topdress.control.readings import EffortFinding, RefusedSpeed, ScaleFinding, SpeedDoubt
from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.memory import Memory
from topdress.control.safety.motion import Motion
from topdress.control.safety.sensor_validity import ValidReadings, has_lasted
from topdress.control.safety.standstill_monitor import StandstillWatch
from topdress.control.safety.words import Details, Situation
from topdress.control.safety.work_watch import FollowWatch, HopperWatch, RateWatch

_SENSOR_STATES = (State.READY, State.WORKING, State.HELD, State.FAULT)
# Share of its limit down to which a reported trim remains reported.
TRIM_HYSTERESIS = 0.7
_WORK_STATES = (State.READY, State.WORKING, State.HELD)
_UNKNOWN = "?"


def find_causes(
    m: Memory,
    now_s: float,
    s: Situation,
    *,
    seen: ValidReadings,
    motion: Motion,
    rate: RateWatch,
    hopper: HopperWatch,
    stand: StandstillWatch,
    follow: FollowWatch,
    scale_heard: bool,
    limits: SafetyLimits,
) -> dict[str, Details]:
    """Returns the details of each alarm whose cause is present in the state of the tick before,
    by alarm id."""
    found: dict[str, Details] = {}
    if not s.log_ok:
        found["log_failed"] = ()
    if s.measurements.log_cut:
        found["log_cut"] = (("log", s.measurements.log_cut),)
    if s.measurements.control_failed:
        found["control_failed"] = ()
    if s.measurements.put_aside:
        found["device_aside"] = (("devices", ", ".join(s.measurements.put_aside)),)
    if s.measurements.old_orders:
        found["old_orders"] = ()
    _find_standstill_causes(found, s, seen, stand)
    if m.state is State.OFF:
        return found
    _find_drive_causes(found, m, now_s, s, seen, limits)
    if m.state is State.CALIBRATING:
        _find_calibration_causes(found, seen, limits)
    if m.state in _SENSOR_STATES:
        _find_sensor_causes(
            found, m, now_s, s=s, seen=seen, motion=motion, scale_heard=scale_heard, limits=limits
        )
        _find_speed_causes(found, s.speed_doubt, limits)
        _find_hopper_low(found, s, seen, hopper)
    if m.state is State.WORKING:
        _find_work_causes(found, now_s, s, seen, motion, limits)
        _find_rate_causes(found, now_s, s, rate, limits)
        _find_range_causes(found, m, now_s, s, limits)
        _find_follow_causes(found, now_s, s, follow, limits)
        _find_scale_causes(found, m, s.scale, limits)
    _find_effort_causes(found, m, s.effort)
    _find_hopper_empty(found, m, now_s, seen, hopper, limits)
    return found


def _find_standstill_causes(
    found: dict[str, Details], s: Situation, seen: ValidReadings, stand: StandstillWatch
) -> None:
    """Finds drives that do not stand, in every state, also off, because a stop command is no
    proof of a standstill."""
    if stand.shaft.turns:
        found["shaft_turns"] = (
            ("shaft_rpm", _round_known(seen.shaft_rpm)),
            ("released_kg", _round_known(s.commanded.stopped_kg, 1)),
        )
    if stand.gate.opens:
        found["gate_opens"] = (
            ("opening_mm", _round_known(seen.opening_mm)),
            ("told_mm", _round_known(s.commanded.opening_mm)),
        )
    if stand.valves.stuck:
        found["valve_open"] = (("sections", ", ".join(map(str, stand.valves.stuck))),)
    if s.scale.unordered_kg > 0.0:
        found["flow_unordered"] = (("kg", _round_known(s.scale.unordered_kg, 1)),)


def _find_drive_causes(
    found: dict[str, Details],
    m: Memory,
    now_s: float,
    s: Situation,
    seen: ValidReadings,
    limits: SafetyLimits,
) -> None:
    """Finds silent or failing drives. A drive without any reading yet has `drive_silent_s` after
    leaving off."""
    waited = now_s - m.left_off_s > limits.drive_silent_s
    if not seen.is_shaft_heard and (waited or s.measurements.shaft_rpm is not None):
        found["shaft_silent"] = ()
    if not seen.is_gate_heard and (waited or s.measurements.opening_mm is not None):
        found["gate_silent"] = ()
    if s.measurements.drive_fault:
        found["drive_fault"] = ()
    if s.measurements.drive_stopped:
        found["drive_stopped"] = ()


def _find_calibration_causes(
    found: dict[str, Details], seen: ValidReadings, limits: SafetyLimits
) -> None:
    fastest = max(seen.wheel_speed_mps or 0.0, seen.gnss_speed_mps or 0.0)
    if fastest > limits.calibrate_fault_speed_mps:
        found["calibration_moved"] = (("speed_mps", round(fastest, 2)),)


def _find_sensor_causes(
    found: dict[str, Details],
    m: Memory,
    now_s: float,
    *,
    s: Situation,
    seen: ValidReadings,
    motion: Motion,
    scale_heard: bool,
    limits: SafetyLimits,
) -> None:
    """Finds silent sensors. A sensor without any reading yet has its time after leaving off, as
    the drives have."""
    on_s = now_s - m.left_off_s
    if not seen.gnss_ok and (s.measurements.gnss is not None or on_s > limits.gnss_period_max_s):
        found["gnss_silent"] = ()
    if s.position_refused_m is not None:
        found["position_walks" if s.position_walks else "position_jumped"] = (
            ("off_m", _round_known(s.position_refused_m)),
        )
    if has_lasted(motion.wheel_doubt_since_s, now_s, limits.wheel_fault_s):
        found["wheel_fault"] = (("speed_mps", round(seen.gnss_speed_mps or 0.0, 1)),)
    if scale_heard and seen.hopper_kg is None:
        found["scale_silent"] = ()
    if s.target_source not in CANOPY_SOURCES:
        return
    settled = on_s > limits.ndvi_silent_s
    if settled if s.ndvi_age_s is None else not s.ndvi_age_s <= limits.ndvi_silent_s:
        found["heads_by_map" if s.by_index_map else "ndvi_silent"] = ()
    all_spoke = all(reading is not None for reading in s.measurements.ndvi)
    if s.valid_heads is not None and s.valid_heads < limits.heads_min and (all_spoke or settled):
        found["heads_few"] = (("valid_heads", s.valid_heads), ("limit", limits.heads_min))
    if has_lasted(m.heads_full_since_s, now_s, limits.heads_full_s):
        found["heads_full"] = (("limit", limits.heads_full_ndvi),)
    # On the road nothing is spread.
    if s.usable_speed_mps is not None and m.state is State.WORKING:
        found["lead_short"] = (("usable_speed_mps", _round_known(s.usable_speed_mps, 1)),)


def _find_speed_causes(
    found: dict[str, Details], doubt: SpeedDoubt | None, limits: SafetyLimits
) -> None:
    """Finds contradicting speeds: immediately if the wrong sensor is known, otherwise after
    `speeds_differ_s`."""
    if doubt is None:
        return
    read = (
        ("wheel_mps", _round_known(doubt.wheel_mps, 2)),
        ("gnss_mps", _round_known(doubt.gnss_mps, 2)),
    )
    if doubt.refused is RefusedSpeed.GNSS:
        found["gnss_speed_wrong"] = read
    elif doubt.refused is RefusedSpeed.WHEEL:
        found["wheel_too_much" if doubt.wheel_mps > doubt.gnss_mps else "wheel_too_little"] = read
    elif has_lasted(doubt.since_s, doubt.differed_s, limits.speeds_differ_s):
        found["speeds_differ"] = read


def _find_hopper_low(
    found: dict[str, Details], s: Situation, seen: ValidReadings, hopper: HopperWatch
) -> None:
    if hopper.low and seen.hopper_kg is not None:
        found["hopper_low"] = (
            ("hopper_kg", round(seen.hopper_kg)),
            ("metres_left", _round_to_tens(s.metres_left_m)),
        )
    if s.scale.refill_percent is not None:
        found["refill_disagrees"] = (("percent", _round_known(s.scale.refill_percent)),)


def _find_work_causes(
    found: dict[str, Details],
    now_s: float,
    s: Situation,
    seen: ValidReadings,
    motion: Motion,
    limits: SafetyLimits,
) -> None:
    if are_speeds_silent(now_s, s, seen, motion, limits):
        found["speed_silent"] = ()
    if s.console_age_s is not None and not s.console_age_s <= limits.console_hold_s:
        found["console_silent"] = (("limit_s", limits.console_hold_s),)
    if (
        s.target_source in PLACE_SOURCES
        and not s.position_ok
        and (motion.moving or not s.course_awaited)
    ):
        found["position_lost"] = ()
    if s.silent_rate_kg_ha is not None:
        found["target_silent"] = (("silent_kg_ha", _round_known(s.silent_rate_kg_ha)),)
    if s.cut_from_kg_ha is not None:
        found["target_cut"] = (
            ("planned_kg_ha", _round_known(s.cut_from_kg_ha)),
            ("limit_kg_ha", _round_known(s.target_rate_kg_ha)),
        )
    if not is_target_acceptable(s, limits):
        found["target_refused"] = (("limit_kg_ha", limits.rate_max_kg_ha),)


def _find_rate_causes(
    found: dict[str, Details], now_s: float, s: Situation, rate: RateWatch, limits: SafetyLimits
) -> None:
    if has_lasted(rate.red_since_s, now_s, limits.rate_red_s):
        found["rate_far_off"] = (("error_percent", _round_known(rate.error_percent)),)
    elif has_lasted(rate.amber_since_s, now_s, limits.rate_amber_s):
        found["rate_off"] = (("error_percent", _round_known(rate.error_percent)),)
    if has_lasted(rate.above_since_s, now_s, limits.rate_max_s):
        found["rate_above_limit"] = (
            ("applied_kg_ha", _round_known(s.applied_rate_kg_ha)),
            ("limit_kg_ha", limits.rate_max_kg_ha),
        )


def _find_range_causes(
    found: dict[str, Details], m: Memory, now_s: float, s: Situation, limits: SafetyLimits
) -> None:
    """Finds a rate beyond the machine's range, and adds the speed at which the rate is possible."""
    breach = s.range_breach
    if breach is None or not has_lasted(m.beyond_range_since_s, now_s, limits.beyond_range_s):
        return
    found["rate_above_range" if breach.above else "rate_below_range"] = (
        ("wanted_kg_ha", _round_known(breach.wanted_kg_ha)),
        ("given_kg_ha", _round_known(breach.given_kg_ha)),
        ("usable_kmh", _round_known(3.6 * breach.usable_mps, 1)),
    )


def _find_follow_causes(
    found: dict[str, Details], now_s: float, s: Situation, follow: FollowWatch, limits: SafetyLimits
) -> None:
    commanded = s.commanded
    shaft_far = has_lasted(follow.shaft_far_since_s, now_s, limits.drive_far_s)
    gate_far = has_lasted(follow.gate_far_since_s, now_s, limits.drive_far_s)
    if shaft_far or has_lasted(follow.shaft_off_since_s, now_s, limits.shaft_off_s):
        found["shaft_far_off" if shaft_far else "shaft_off"] = (
            ("shaft_rpm", _round_known(commanded.expected_rpm + follow.shaft_off_rpm)),
            (
                "told_rpm",
                _round_known(commanded.shaft_rpm if shaft_far else commanded.expected_rpm),
            ),
        )
    if gate_far or has_lasted(follow.gate_off_since_s, now_s, limits.gate_off_s):
        found["gate_far_off" if gate_far else "gate_off"] = (
            ("opening_mm", _round_known(commanded.expected_mm + follow.gate_off_mm, 1)),
            ("told_mm", _round_known(commanded.expected_mm, 1)),
        )


def _find_hopper_empty(
    found: dict[str, Details],
    m: Memory,
    now_s: float,
    seen: ValidReadings,
    hopper: HopperWatch,
    limits: SafetyLimits,
) -> None:
    """Finds an empty hopper at work; the alarm remains until a refill, because a hold does not
    fill the hopper."""
    asked = m.state is State.WORKING or any(one.alarm.id == "hopper_empty" for one in m.live)
    if asked and has_lasted(hopper.empty_since_s, now_s, limits.hopper_confirm_s):
        found["hopper_empty"] = (("hopper_kg", round(seen.hopper_kg or 0.0, 1)),)


def _find_scale_causes(
    found: dict[str, Details], m: Memory, says: ScaleFinding, limits: SafetyLimits
) -> None:
    """Finds contradictions between the scale and the flow."""
    if says.share is not None:
        found["flow_missing" if says.share < 1.0 else "flow_above"] = (
            ("percent", _round_known(100.0 * says.share)),
        )
    if says.outlets:
        found["outlet_blocked"] = (("outlets", says.outlets), ("of", says.of_outlets))
    if says.below_percent is not None:
        found["flow_below"] = (("percent", _round_known(says.below_percent)),)
    if says.beyond_percent is not None:
        found["flow_disagrees"] = (("percent", _round_known(says.beyond_percent)),)
    if says.off_kg != 0.0:
        found["scale_unexplained"] = (("kg", _round_known(abs(says.off_kg), 1)),)
    trimmed = any(one.alarm.id == "flow_trimmed" for one in m.live)
    if abs(says.trimmed_percent) > limits.trimmed_percent * (TRIM_HYSTERESIS if trimmed else 1.0):
        found["flow_trimmed"] = (("percent", _round_known(says.trimmed_percent)),)


def _find_effort_causes(found: dict[str, Details], m: Memory, says: EffortFinding) -> None:
    """Finds a wrong effort at work; the alarm remains until the drive turns again."""
    if m.state not in _WORK_STATES:
        return
    if says.harder_percent > 0.0:
        found["effort_high"] = (("percent", _round_known(says.harder_percent)),)
    if says.unloaded:
        found["effort_low"] = ()


def _round_known(value: float | None, digits: int | None = None) -> str | float:
    return round(value, digits) if value is not None and isfinite(value) else _UNKNOWN


def _round_to_tens(metres: float | None) -> str | float:
    return round(metres / 10.0) * 10 if metres is not None and isfinite(metres) else _UNKNOWN


def are_speeds_silent(
    now_s: float, s: Situation, seen: ValidReadings, motion: Motion, limits: SafetyLimits
) -> bool:
    """Returns whether both speeds are silent for `speed_silent_s`: no speed was used for this time,
    or the newest is older.

    A standing wheel is not silent while it reads 0.
    """
    if has_lasted(motion.speed_lost_since_s, now_s, limits.speed_silent_s):
        return True
    heard_s = seen.speed_heard_s
    return heard_s is not None and not now_s - heard_s <= limits.speed_silent_s


def is_target_acceptable(s: Situation, limits: SafetyLimits) -> bool:
    """Returns whether the target is a number from 0 to the product's absolute limit."""
    return 0.0 <= s.target_rate_kg_ha <= limits.rate_max_kg_ha
