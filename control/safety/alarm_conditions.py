"""Which alarms have their cause at this tick? The table of losses, one function for each group
of rows."""

from __future__ import annotations

from math import isfinite

from topdress.control.orders import BY_CANOPY, BY_PLACE, State
from topdress.control.readings import Doubted, EffortSays, ScaleSays, SpeedDoubt
from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.memory import Memory
from topdress.control.safety.motion import Motion
from topdress.control.safety.sensor_validity import Senses, lasted
from topdress.control.safety.standstill_monitor import Stand
from topdress.control.safety.words import Details, Situation
from topdress.control.safety.work_watch import FollowWatch, HopperWatch, RateWatch

_LOOKING = (State.READY, State.WORKING, State.HELD, State.FAULT)
# Share of its limit down to which a reported trim stays reported.
TRIMMED_STILL = 0.7
_AT_WORK = (State.READY, State.WORKING, State.HELD)
_UNKNOWN = "?"


def troubles(
    m: Memory,
    now_s: float,
    s: Situation,
    *,
    seen: Senses,
    motion: Motion,
    rate: RateWatch,
    hopper: HopperWatch,
    stand: Stand,
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
    _commanded_to_stop(found, s, seen, stand)
    if m.state is State.OFF:
        return found
    _drives(found, m, now_s, s, seen, limits)
    if m.state is State.CALIBRATING:
        _calibrating(found, seen, limits)
    if m.state in _LOOKING:
        _sensors(
            found, m, now_s, s=s, seen=seen, motion=motion, scale_heard=scale_heard, limits=limits
        )
        _speeds(found, s.speed_doubt, limits)
        _hopper_low(found, s, seen, hopper)
    if m.state is State.WORKING:
        _working(found, now_s, s, seen, motion, limits)
        _rate(found, now_s, s, rate, limits)
        _range(found, m, now_s, s, limits)
        _follow(found, now_s, s, follow, limits)
        _scale(found, m, s.scale, limits)
    _effort(found, m, s.effort)
    _hopper_empty(found, m, now_s, seen, hopper, limits)
    return found


def _commanded_to_stop(found: dict[str, Details], s: Situation, seen: Senses, stand: Stand) -> None:
    """Finds drives that do not stand, in every state, also off: a command to stand is no proof."""
    if stand.shaft.turns:
        found["shaft_turns"] = (
            ("shaft_rpm", _rounded(seen.shaft_rpm)),
            ("released_kg", _rounded(s.commanded.stopped_kg, 1)),
        )
    if stand.gate.opens:
        found["gate_opens"] = (
            ("opening_mm", _rounded(seen.opening_mm)),
            ("told_mm", _rounded(s.commanded.opening_mm)),
        )
    if stand.valves.stuck:
        found["valve_open"] = (("sections", ", ".join(map(str, stand.valves.stuck))),)
    if s.scale.unordered_kg > 0.0:
        found["flow_unordered"] = (("kg", _rounded(s.scale.unordered_kg, 1)),)


def _drives(
    found: dict[str, Details],
    m: Memory,
    now_s: float,
    s: Situation,
    seen: Senses,
    limits: SafetyLimits,
) -> None:
    """Finds silent or failing drives. A drive that was never heard has `drive_silent_s` after
    off is left."""
    waited = now_s - m.left_off_s > limits.drive_silent_s
    if not seen.shaft_ok and (waited or s.measurements.shaft_rpm is not None):
        found["shaft_silent"] = ()
    if not seen.gate_ok and (waited or s.measurements.opening_mm is not None):
        found["gate_silent"] = ()
    if s.measurements.drive_fault:
        found["drive_fault"] = ()
    if s.measurements.drive_stopped:
        found["drive_stopped"] = ()


def _calibrating(found: dict[str, Details], seen: Senses, limits: SafetyLimits) -> None:
    fastest = max(seen.wheel_speed_mps or 0.0, seen.gnss_speed_mps or 0.0)
    if fastest > limits.calibrate_fault_speed_mps:
        found["calibration_moved"] = (("speed_mps", round(fastest, 2)),)


def _sensors(
    found: dict[str, Details],
    m: Memory,
    now_s: float,
    *,
    s: Situation,
    seen: Senses,
    motion: Motion,
    scale_heard: bool,
    limits: SafetyLimits,
) -> None:
    """Finds silent sensors. A sensor that was never heard has its time after off is left, as the
    drives have."""
    on_s = now_s - m.left_off_s
    if not seen.gnss_ok and (s.measurements.gnss is not None or on_s > limits.gnss_period_max_s):
        found["gnss_silent"] = ()
    if s.position_refused_m is not None:
        found["position_walks" if s.position_walks else "position_jumped"] = (
            ("off_m", _rounded(s.position_refused_m)),
        )
    if lasted(motion.wheel_doubt_since_s, now_s, limits.wheel_fault_s):
        found["wheel_fault"] = (("speed_mps", round(seen.gnss_speed_mps or 0.0, 1)),)
    if scale_heard and seen.hopper_kg is None:
        found["scale_silent"] = ()
    if s.target_source not in BY_CANOPY:
        return
    settled = on_s > limits.ndvi_silent_s
    if settled if s.ndvi_age_s is None else not s.ndvi_age_s <= limits.ndvi_silent_s:
        found["heads_by_map" if s.by_index_map else "ndvi_silent"] = ()
    all_spoke = all(reading is not None for reading in s.measurements.ndvi)
    if s.valid_heads is not None and s.valid_heads < limits.heads_min and (all_spoke or settled):
        found["heads_few"] = (("valid_heads", s.valid_heads), ("limit", limits.heads_min))
    if lasted(m.heads_full_since_s, now_s, limits.heads_full_s):
        found["heads_full"] = (("limit", limits.heads_full_ndvi),)
    # On the road nothing is spread.
    if s.usable_speed_mps is not None and m.state is State.WORKING:
        found["lead_short"] = (("usable_speed_mps", _rounded(s.usable_speed_mps, 1)),)


def _speeds(found: dict[str, Details], doubt: SpeedDoubt | None, limits: SafetyLimits) -> None:
    """Finds contradicting speeds: once it is known which is wrong, else after `speeds_differ_s`."""
    if doubt is None:
        return
    read = (("wheel_mps", _rounded(doubt.wheel_mps, 2)), ("gnss_mps", _rounded(doubt.gnss_mps, 2)))
    if doubt.refused is Doubted.GNSS:
        found["gnss_speed_wrong"] = read
    elif doubt.refused is Doubted.WHEEL:
        found["wheel_too_much" if doubt.wheel_mps > doubt.gnss_mps else "wheel_too_little"] = read
    elif lasted(doubt.since_s, doubt.differed_s, limits.speeds_differ_s):
        found["speeds_differ"] = read


def _hopper_low(found: dict[str, Details], s: Situation, seen: Senses, hopper: HopperWatch) -> None:
    if hopper.low and seen.hopper_kg is not None:
        found["hopper_low"] = (
            ("hopper_kg", round(seen.hopper_kg)),
            ("metres_left", _tens(s.metres_left_m)),
        )
    if s.scale.refill_percent is not None:
        found["refill_disagrees"] = (("percent", _rounded(s.scale.refill_percent)),)


def _working(
    found: dict[str, Details],
    now_s: float,
    s: Situation,
    seen: Senses,
    motion: Motion,
    limits: SafetyLimits,
) -> None:
    if speeds_silent(now_s, s, seen, motion, limits):
        found["speed_silent"] = ()
    if s.console_age_s is not None and not s.console_age_s <= limits.console_hold_s:
        found["console_silent"] = (("limit_s", limits.console_hold_s),)
    if (
        s.target_source in BY_PLACE
        and not s.position_ok
        and (motion.moving or not s.course_awaited)
    ):
        found["position_lost"] = ()
    if s.silent_rate_kg_ha is not None:
        found["target_silent"] = (("silent_kg_ha", _rounded(s.silent_rate_kg_ha)),)
    if s.cut_from_kg_ha is not None:
        found["target_cut"] = (
            ("planned_kg_ha", _rounded(s.cut_from_kg_ha)),
            ("limit_kg_ha", _rounded(s.target_rate_kg_ha)),
        )
    if not target_acceptable(s, limits):
        found["target_refused"] = (("limit_kg_ha", limits.rate_max_kg_ha),)


def _rate(
    found: dict[str, Details], now_s: float, s: Situation, rate: RateWatch, limits: SafetyLimits
) -> None:
    if lasted(rate.red_since_s, now_s, limits.rate_red_s):
        found["rate_far_off"] = (("error_percent", _rounded(rate.error_percent)),)
    elif lasted(rate.amber_since_s, now_s, limits.rate_amber_s):
        found["rate_off"] = (("error_percent", _rounded(rate.error_percent)),)
    if lasted(rate.above_since_s, now_s, limits.rate_max_s):
        found["rate_above_limit"] = (
            ("applied_kg_ha", _rounded(s.applied_rate_kg_ha)),
            ("limit_kg_ha", limits.rate_max_kg_ha),
        )


def _range(
    found: dict[str, Details], m: Memory, now_s: float, s: Situation, limits: SafetyLimits
) -> None:
    """Finds a rate beyond the machine's range, and names the speed that helps."""
    breach = s.range_breach
    if breach is None or not lasted(m.beyond_range_since_s, now_s, limits.beyond_range_s):
        return
    found["rate_above_range" if breach.above else "rate_below_range"] = (
        ("wanted_kg_ha", _rounded(breach.wanted_kg_ha)),
        ("given_kg_ha", _rounded(breach.given_kg_ha)),
        ("usable_kmh", _rounded(3.6 * breach.usable_mps, 1)),
    )


def _follow(
    found: dict[str, Details], now_s: float, s: Situation, follow: FollowWatch, limits: SafetyLimits
) -> None:
    commanded = s.commanded
    shaft_far = lasted(follow.shaft_far_since_s, now_s, limits.drive_far_s)
    gate_far = lasted(follow.gate_far_since_s, now_s, limits.drive_far_s)
    if shaft_far or lasted(follow.shaft_off_since_s, now_s, limits.shaft_off_s):
        found["shaft_far_off" if shaft_far else "shaft_off"] = (
            ("shaft_rpm", _rounded(commanded.expected_rpm + follow.shaft_off_rpm)),
            ("told_rpm", _rounded(commanded.shaft_rpm if shaft_far else commanded.expected_rpm)),
        )
    if gate_far or lasted(follow.gate_off_since_s, now_s, limits.gate_off_s):
        found["gate_far_off" if gate_far else "gate_off"] = (
            ("opening_mm", _rounded(commanded.expected_mm + follow.gate_off_mm, 1)),
            ("told_mm", _rounded(commanded.expected_mm, 1)),
        )


def _hopper_empty(
    found: dict[str, Details],
    m: Memory,
    now_s: float,
    seen: Senses,
    hopper: HopperWatch,
    limits: SafetyLimits,
) -> None:
    """Finds an empty hopper at work; the alarm stays until the hopper is filled, because holding
    fills none."""
    asked = m.state is State.WORKING or any(one.alarm.id == "hopper_empty" for one in m.live)
    if asked and lasted(hopper.empty_since_s, now_s, limits.hopper_confirm_s):
        found["hopper_empty"] = (("hopper_kg", round(seen.hopper_kg or 0.0, 1)),)


def _scale(found: dict[str, Details], m: Memory, says: ScaleSays, limits: SafetyLimits) -> None:
    """Finds contradictions between the scale and the flow."""
    if says.share is not None:
        found["flow_missing" if says.share < 1.0 else "flow_above"] = (
            ("percent", _rounded(100.0 * says.share)),
        )
    if says.outlets:
        found["outlet_blocked"] = (("outlets", says.outlets), ("of", says.of_outlets))
    if says.below_percent is not None:
        found["flow_below"] = (("percent", _rounded(says.below_percent)),)
    if says.beyond_percent is not None:
        found["flow_disagrees"] = (("percent", _rounded(says.beyond_percent)),)
    if says.off_kg != 0.0:
        found["scale_unexplained"] = (("kg", _rounded(abs(says.off_kg), 1)),)
    trimmed = any(one.alarm.id == "flow_trimmed" for one in m.live)
    if abs(says.trimmed_percent) > limits.trimmed_percent * (TRIMMED_STILL if trimmed else 1.0):
        found["flow_trimmed"] = (("percent", _rounded(says.trimmed_percent)),)


def _effort(found: dict[str, Details], m: Memory, says: EffortSays) -> None:
    """Finds a wrong effort at work; the alarm stays until the drive turns again."""
    if m.state not in _AT_WORK:
        return
    if says.harder_percent > 0.0:
        found["effort_high"] = (("percent", _rounded(says.harder_percent)),)
    if says.unloaded:
        found["effort_low"] = ()


def _rounded(value: float | None, digits: int | None = None) -> str | float:
    return round(value, digits) if value is not None and isfinite(value) else _UNKNOWN


def _tens(metres: float | None) -> str | float:
    return round(metres / 10.0) * 10 if metres is not None and isfinite(metres) else _UNKNOWN


def speeds_silent(
    now_s: float, s: Situation, seen: Senses, motion: Motion, limits: SafetyLimits
) -> bool:
    """Returns whether both speeds are silent for `speed_silent_s`: none is in use for so long,
    or the newest is older.

    A wheel that stands is not silent while it reads 0."""
    if lasted(motion.speed_lost_since_s, now_s, limits.speed_silent_s):
        return True
    heard_s = seen.speed_heard_s
    return heard_s is not None and not now_s - heard_s <= limits.speed_silent_s


def target_acceptable(s: Situation, limits: SafetyLimits) -> bool:
    """Returns whether the target is a number from 0 to the product's absolute limit."""
    return 0.0 <= s.target_rate_kg_ha <= limits.rate_max_kg_ha
