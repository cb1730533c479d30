"""Which alarms have their cause in this tick? The table of losses: each alarm with the states in
which it is looked for, and its cause."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import NamedTuple

from topdress.control.orders import CANOPY_SOURCES, PLACE_SOURCES, State
from topdress.control.readings import RefusedSpeed
from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.memory import SafetyMemory
from topdress.control.safety.safety_interface import Details, SafetySituation
from topdress.control.safety.sensor_validity import ValidReadings, has_lasted

# Share of its limit down to which a reported trim remains reported.
TRIM_HYSTERESIS = 0.7
_UNKNOWN = "?"
# The states of the tick before in which conditions are looked for.
_ALWAYS = frozenset(State)
_ON = _ALWAYS - {State.OFF}
_SENSING = frozenset({State.READY, State.WORKING, State.HELD, State.FAULT})
_WORKED = frozenset({State.READY, State.WORKING, State.HELD})
_WORKING = frozenset({State.WORKING})


class ConditionFacts(NamedTuple):
    """Holds all that a condition may depend on. `memory` has the state of the tick before, and
    what is watched up to this tick."""

    memory: SafetyMemory
    now_s: float
    situation: SafetySituation
    seen: ValidReadings
    limits: SafetyLimits

    @property
    def on_s(self) -> float:
        """Time since the machine left off, s: a sensor without any reading yet has its time
        from then on."""
        return self.now_s - self.memory.left_off_s

    def has_lasted(self, since_s: float | None, for_s: float) -> bool:
        """Returns whether a condition has held for at least `for_s` seconds."""
        return has_lasted(since_s, self.now_s, for_s)

    def is_live(self, alarm_id: str) -> bool:
        """Returns whether the alarm was live in the tick before."""
        return any(one.alarm.id == alarm_id for one in self.memory.live)


class AlarmCondition(NamedTuple):
    """Declares the cause of an alarm. `find_details` returns None without a cause."""

    states: frozenset[State]
    find_details: Callable[[ConditionFacts], Details | None]


def find_causes(facts: ConditionFacts) -> dict[str, Details]:
    """Returns the details of each alarm whose cause is present in the state of the tick before,
    by alarm id."""
    state = facts.memory.state
    return {
        alarm_id: details
        for alarm_id, one in CONDITIONS.items()
        if state in one.states and (details := one.find_details(facts)) is not None
    }


def _find_speed_doubt(
    f: ConditionFacts, refused: RefusedSpeed, wheel_above: bool
) -> Details | None:
    """Finds contradicting speeds: immediately if the wrong sensor is known, otherwise after
    `speeds_differ_s`."""
    doubt = f.situation.speed_doubt
    if doubt is None or doubt.refused is not refused:
        return None
    other_wheel = (doubt.wheel_mps > doubt.gnss_mps) != wheel_above
    undecided = not has_lasted(doubt.since_s, doubt.differed_s, f.limits.speeds_differ_s)
    if (refused is RefusedSpeed.WHEEL and other_wheel) or (
        refused is RefusedSpeed.EITHER and undecided
    ):
        return None
    return (
        ("wheel_mps", _round_known(doubt.wheel_mps, 2)),
        ("gnss_mps", _round_known(doubt.gnss_mps, 2)),
    )


def _find_refused_place(f: ConditionFacts, walks: bool) -> Details | None:
    off_m = f.situation.position_refused_m
    found = off_m is not None and f.situation.position_walks == walks
    return (("off_m", _round_known(off_m)),) if found else None


def _find_silent_heads(f: ConditionFacts, by_map: bool) -> Details | None:
    s, silent_s = f.situation, f.limits.ndvi_silent_s
    if s.target_source not in CANOPY_SOURCES or s.by_index_map != by_map:
        return None
    silent = f.on_s > silent_s if s.ndvi_age_s is None else not s.ndvi_age_s <= silent_s
    return () if silent else None


def _find_few_heads(f: ConditionFacts) -> Details | None:
    s, least = f.situation, f.limits.heads_min
    if s.target_source not in CANOPY_SOURCES or s.valid_heads is None or s.valid_heads >= least:
        return None
    spoke = all(reading is not None for reading in s.measurements.ndvi)
    judged = spoke or f.on_s > f.limits.ndvi_silent_s
    return (("valid_heads", s.valid_heads), ("limit", least)) if judged else None


def _find_unused_range(f: ConditionFacts, above: bool) -> Details | None:
    """Finds a rate beyond the machine's range, and adds the speed at which the rate is possible."""
    breach = f.situation.range_breach
    lasted = f.has_lasted(f.memory.beyond_range_since_s, f.limits.beyond_range_s)
    if breach is None or breach.above != above or not lasted:
        return None
    return (
        ("wanted_kg_ha", _round_known(breach.wanted_kg_ha)),
        ("given_kg_ha", _round_known(breach.given_kg_ha)),
        ("usable_kmh", _round_known(3.6 * breach.usable_mps, 1)),
    )


def _is_rate_far_off(f: ConditionFacts) -> bool:
    return f.has_lasted(f.memory.rate.red_since_s, f.limits.rate_red_s)


def _is_shaft_far_off(f: ConditionFacts) -> bool:
    return f.has_lasted(f.memory.follow.shaft_far_since_s, f.limits.drive_far_s)


def _is_gate_far_off(f: ConditionFacts) -> bool:
    return f.has_lasted(f.memory.follow.gate_far_since_s, f.limits.drive_far_s)


def _list_shaft_speeds(f: ConditionFacts, told_rpm: float) -> Details:
    speed_rpm = f.situation.commanded.expected_rpm + f.memory.follow.shaft_off_rpm
    return ("shaft_rpm", _round_known(speed_rpm)), ("told_rpm", _round_known(told_rpm))


def _list_openings(f: ConditionFacts) -> Details:
    expected_mm = f.situation.commanded.expected_mm
    return (
        ("opening_mm", _round_known(expected_mm + f.memory.follow.gate_off_mm, 1)),
        ("told_mm", _round_known(expected_mm, 1)),
    )


def _find_trim(f: ConditionFacts) -> Details | None:
    trimmed = f.situation.scale.trimmed_percent
    share = TRIM_HYSTERESIS if f.is_live("flow_trimmed") else 1.0
    # A trim that is not a number is none.
    return _find_percent(trimmed) if abs(trimmed) > f.limits.trimmed_percent * share else None


def _find_moved_calibration(f: ConditionFacts) -> Details | None:
    fastest = max(f.seen.wheel_speed_mps or 0.0, f.seen.gnss_speed_mps or 0.0)
    return (
        (("speed_mps", round(fastest, 2)),)
        if fastest > f.limits.calibrate_fault_speed_mps
        else None
    )


def _find_empty_hopper(f: ConditionFacts) -> Details | None:
    """Finds an empty hopper at work; the alarm remains until a refill, because a hold does not
    fill the hopper."""
    asked = f.memory.state is State.WORKING or f.is_live("hopper_empty")
    empty = asked and f.has_lasted(f.memory.hopper.empty_since_s, f.limits.hopper_confirm_s)
    return (("hopper_kg", round(f.seen.hopper_kg or 0.0, 1)),) if empty else None


def _find_lost_place(f: ConditionFacts) -> Details | None:
    s = f.situation
    lost = s.target_source in PLACE_SOURCES and not s.position_ok
    return () if lost and (f.memory.motion.moving or not s.course_awaited) else None


def _find_silent_gnss(f: ConditionFacts) -> Details | None:
    awaited = f.situation.measurements.gnss is not None or f.on_s > f.limits.gnss_period_max_s
    return () if awaited and not f.seen.gnss_ok else None


def _find_missing_flow(f: ConditionFacts, above: bool) -> Details | None:
    share = f.situation.scale.share
    return None if share is None or (share < 1.0) == above else _find_percent(100.0 * share)


def _find_short_lead(f: ConditionFacts) -> Details | None:
    """Finds a speed that is too high for the heads' lead; on the road nothing is spread."""
    speed_mps = f.situation.usable_speed_mps
    short = f.situation.target_source in CANOPY_SOURCES and speed_mps is not None
    return (("usable_speed_mps", _round_known(speed_mps, 1)),) if short else None


def _find_silent_speeds(f: ConditionFacts) -> Details | None:
    """Finds that no speed was used for `speed_silent_s`, or that the newest is older. A standing
    wheel is not silent while it reads 0."""
    silent_s, heard_s = f.limits.speed_silent_s, f.seen.speed_heard_s
    unused = f.has_lasted(f.memory.motion.speed_lost_since_s, silent_s)
    return () if unused or (heard_s is not None and not f.now_s - heard_s <= silent_s) else None


def _find_percent(percent: float | None) -> Details | None:
    return None if percent is None else (("percent", _round_known(percent)),)


# Of several causes that lead to the same state the first is the reason.
CONDITIONS: dict[str, AlarmCondition] = {
    alarm_id: AlarmCondition(states, find_details)
    for states, of_states in (
        (
            _ALWAYS,
            {
                "log_failed": lambda f: None if f.situation.log_ok else (),
                "log_cut": lambda f: (
                    (("log", f.situation.measurements.log_cut),)
                    if f.situation.measurements.log_cut
                    else None
                ),
                "control_failed": lambda f: () if f.situation.measurements.control_failed else None,
                "device_aside": lambda f: (
                    (("devices", ", ".join(f.situation.measurements.put_aside)),)
                    if f.situation.measurements.put_aside
                    else None
                ),
                "old_orders": lambda f: () if f.situation.measurements.old_orders else None,
                # Drives that do not stand are looked for in every state, also off, because a stop
                # command is no proof of a standstill.
                "shaft_turns": lambda f: (
                    (
                        ("shaft_rpm", _round_known(f.seen.shaft_rpm)),
                        ("released_kg", _round_known(f.situation.commanded.stopped_kg, 1)),
                    )
                    if f.memory.stand.shaft.turns
                    else None
                ),
                "gate_opens": lambda f: (
                    (
                        ("opening_mm", _round_known(f.seen.opening_mm)),
                        ("told_mm", _round_known(f.situation.commanded.opening_mm)),
                    )
                    if f.memory.stand.gate.opens
                    else None
                ),
                "valve_open": lambda f: (
                    (("sections", ", ".join(map(str, f.memory.stand.valves.stuck))),)
                    if f.memory.stand.valves.stuck
                    else None
                ),
                "flow_unordered": lambda f: (
                    (("kg", _round_known(f.situation.scale.unordered_kg, 1)),)
                    if f.situation.scale.unordered_kg > 0.0
                    else None
                ),
            },
        ),
        (
            _ON,
            {
                "shaft_silent": lambda f: (
                    ()
                    if not f.seen.is_shaft_heard
                    and (
                        f.on_s > f.limits.drive_silent_s
                        or f.situation.measurements.shaft_rpm is not None
                    )
                    else None
                ),
                "gate_silent": lambda f: (
                    ()
                    if not f.seen.is_gate_heard
                    and (
                        f.on_s > f.limits.drive_silent_s
                        or f.situation.measurements.opening_mm is not None
                    )
                    else None
                ),
                "drive_fault": lambda f: () if f.situation.measurements.drive_fault else None,
                "drive_stopped": lambda f: () if f.situation.measurements.drive_stopped else None,
            },
        ),
        (frozenset({State.CALIBRATING}), {"calibration_moved": _find_moved_calibration}),
        (
            _SENSING,
            {
                "gnss_silent": _find_silent_gnss,
                "position_jumped": lambda f: _find_refused_place(f, False),
                "position_walks": lambda f: _find_refused_place(f, True),
                "wheel_fault": lambda f: (
                    (("speed_mps", round(f.seen.gnss_speed_mps or 0.0, 1)),)
                    if f.has_lasted(f.memory.motion.wheel_doubt_since_s, f.limits.wheel_fault_s)
                    else None
                ),
                "scale_silent": lambda f: (
                    () if f.memory.scale_heard and f.seen.hopper_kg is None else None
                ),
                "heads_by_map": lambda f: _find_silent_heads(f, True),
                "ndvi_silent": lambda f: _find_silent_heads(f, False),
                "heads_few": _find_few_heads,
                "heads_full": lambda f: (
                    (("limit", f.limits.heads_full_ndvi),)
                    if f.situation.target_source in CANOPY_SOURCES
                    and f.has_lasted(f.memory.heads_full_since_s, f.limits.heads_full_s)
                    else None
                ),
                "supply_low": lambda f: (
                    (
                        ("supply_v", _round_known(f.seen.supply_v, 1)),
                        ("limit", round(f.limits.supply_low_v, 1)),
                    )
                    if f.has_lasted(f.memory.supply_low_since_s, f.limits.supply_low_s)
                    else None
                ),
                "gnss_speed_wrong": lambda f: _find_speed_doubt(f, RefusedSpeed.GNSS, False),
                "wheel_too_much": lambda f: _find_speed_doubt(f, RefusedSpeed.WHEEL, True),
                "wheel_too_little": lambda f: _find_speed_doubt(f, RefusedSpeed.WHEEL, False),
                "speeds_differ": lambda f: _find_speed_doubt(f, RefusedSpeed.EITHER, False),
                "hopper_low": lambda f: (
                    (
                        ("hopper_kg", _round_known(f.seen.hopper_kg)),
                        ("metres_left", _round_to_tens(f.situation.metres_left_m)),
                    )
                    if f.memory.hopper.low and f.seen.hopper_kg is not None
                    else None
                ),
                "refill_disagrees": lambda f: _find_percent(f.situation.scale.refill_percent),
            },
        ),
        (
            _WORKING,
            {
                "lead_short": _find_short_lead,
                "speed_silent": _find_silent_speeds,
                "console_silent": lambda f: (
                    (("limit_s", f.limits.console_hold_s),)
                    if f.situation.console_age_s is not None
                    and not f.situation.console_age_s <= f.limits.console_hold_s
                    else None
                ),
                "position_lost": _find_lost_place,
                "target_silent": lambda f: (
                    (("silent_kg_ha", _round_known(f.situation.silent_rate_kg_ha)),)
                    if f.situation.silent_rate_kg_ha is not None
                    else None
                ),
                "target_cut": lambda f: (
                    (
                        ("planned_kg_ha", _round_known(f.situation.cut_from_kg_ha)),
                        ("limit_kg_ha", _round_known(f.situation.target_rate_kg_ha)),
                    )
                    if f.situation.cut_from_kg_ha is not None
                    else None
                ),
                "target_refused": lambda f: (
                    None
                    if is_target_acceptable(f.situation, f.limits)
                    else (("limit_kg_ha", f.limits.rate_max_kg_ha),)
                ),
                "rate_far_off": lambda f: (
                    (("error_percent", _round_known(f.memory.rate.error_percent)),)
                    if _is_rate_far_off(f)
                    else None
                ),
                "rate_off": lambda f: (
                    (("error_percent", _round_known(f.memory.rate.error_percent)),)
                    if f.has_lasted(f.memory.rate.amber_since_s, f.limits.rate_amber_s)
                    and not _is_rate_far_off(f)
                    else None
                ),
                "rate_above_limit": lambda f: (
                    (
                        ("applied_kg_ha", _round_known(f.situation.applied_rate_kg_ha)),
                        ("limit_kg_ha", f.limits.rate_max_kg_ha),
                    )
                    if f.has_lasted(f.memory.rate.above_since_s, f.limits.rate_max_s)
                    else None
                ),
                "rate_above_range": lambda f: _find_unused_range(f, True),
                "rate_below_range": lambda f: _find_unused_range(f, False),
                "shaft_far_off": lambda f: (
                    _list_shaft_speeds(f, f.situation.commanded.shaft_rpm)
                    if _is_shaft_far_off(f)
                    else None
                ),
                "shaft_off": lambda f: (
                    _list_shaft_speeds(f, f.situation.commanded.expected_rpm)
                    if f.has_lasted(f.memory.follow.shaft_off_since_s, f.limits.shaft_off_s)
                    and not _is_shaft_far_off(f)
                    else None
                ),
                "gate_far_off": lambda f: _list_openings(f) if _is_gate_far_off(f) else None,
                "gate_off": lambda f: (
                    _list_openings(f)
                    if f.has_lasted(f.memory.follow.gate_off_since_s, f.limits.gate_off_s)
                    and not _is_gate_far_off(f)
                    else None
                ),
                "flow_missing": lambda f: _find_missing_flow(f, False),
                "flow_above": lambda f: _find_missing_flow(f, True),
                "outlet_blocked": lambda f: (
                    (
                        ("outlets", f.situation.scale.outlets),
                        ("of", f.situation.scale.of_outlets),
                    )
                    if f.situation.scale.outlets
                    else None
                ),
                "flow_below": lambda f: _find_percent(f.situation.scale.below_percent),
                "flow_disagrees": lambda f: _find_percent(f.situation.scale.beyond_percent),
                "scale_unexplained": lambda f: (
                    (("kg", _round_known(abs(f.situation.scale.off_kg), 1)),)
                    if f.situation.scale.off_kg != 0.0
                    else None
                ),
                "flow_trimmed": _find_trim,
            },
        ),
        (
            # A wrong effort remains an alarm until the drive turns again.
            _WORKED,
            {
                "effort_high": lambda f: (
                    (("percent", _round_known(f.situation.effort.harder_percent)),)
                    if f.situation.effort.harder_percent > 0.0
                    else None
                ),
                "effort_low": lambda f: () if f.situation.effort.unloaded else None,
            },
        ),
        (_ON, {"hopper_empty": _find_empty_hopper}),
    )
    for alarm_id, find_details in of_states.items()
}


def _round_known(value: float | None, digits: int | None = None) -> str | float:
    return round(value, digits) if value is not None and isfinite(value) else _UNKNOWN


def _round_to_tens(metres: float | None) -> str | float:
    return round(metres / 10.0) * 10 if metres is not None and isfinite(metres) else _UNKNOWN


def is_target_acceptable(s: SafetySituation, limits: SafetyLimits) -> bool:
    """Returns whether the target is a number from 0 to the product's absolute limit."""
    return 0.0 <= s.target_rate_kg_ha <= limits.rate_max_kg_ha
