"""Which values does safety exchange with the loop? The module defines its input and verdict, and
texts for translation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from topdress.control.orders import Alarm, State, TargetSource
from topdress.control.readings import (
    NO_EFFORT_FINDING,
    NO_SCALE_FINDING,
    EffortFinding,
    Measurements,
    RangeBreach,
    ScaleFinding,
    SpeedDoubt,
)
from topdress.control.signals import N_

Details = tuple[tuple[str, str | float], ...]


# The drives have power in these states.
POWERED_STATES = (State.WORKING, State.HELD, State.CALIBRATING)


class PreviousCommands(NamedTuple):
    """Holds the commands of the tick before, which the readings of this tick must follow."""

    # Whether the shaft should turn: a speed, or a dose that is not over yet.
    turn: bool = True
    # Whether material was allowed to flow.
    flow: bool = True
    # Whether the drives have power.
    enabled: bool = True
    opening_mm: float = 0.0
    # Commands of the section valves, left to right; empty for a machine without valves.
    valves: tuple[bool, ...] = ()
    # Shaft speed expected now by the machine model, r/min.
    expected_rpm: float = 0.0
    # Mass released in this stop so far, by the measured shaft, kg.
    stopped_kg: float = 0.0
    # Gate reading expected now by the machine model, mm.
    expected_mm: float = 0.0
    # Set-point of the shaft, r/min; 0 for a stop, a dose, or an unjudged speed.
    shaft_rpm: float = 0.0


class SafetySituation(NamedTuple):
    """Holds the facts of a tick that safety needs. None is unknown; a number that is not finite
    counts as unknown."""

    measurements: Measurements
    # Used speed, m/s; None while both speeds are silent.
    speed_used_mps: float | None
    # Observed period of GNSS epochs, s.
    gnss_period_s: float
    # Whether no wheel pulse arrived for 0.8 s, or the wheel reads 0.
    wheel_standstill: bool
    # Source of the operator's mode.
    target_source: TargetSource
    # Whether the measured or dead-reckoned position is usable.
    position_ok: bool
    # Whether material lands inside the field; None where no field is known.
    landing_inside: bool | None
    # Number of valid heads; None where this mode needs no heads.
    valid_heads: int | None
    ndvi_age_s: float | None
    # Target after the nominal response of the actuators, kg/ha.
    expected_rate_kg_ha: float | None
    # Unfiltered applied rate, kg/ha.
    applied_rate_kg_ha: float | None
    target_rate_kg_ha: float
    metres_left_m: float | None
    # Highest speed with sufficient lead of the heads, m/s; None where the present speed is not too
    # high.
    usable_speed_mps: float | None
    # Time since the operating console was heard, s; None where no console is required (headless).
    console_age_s: float | None
    log_ok: bool
    # Distance of the newest refused epoch from a possible position, m.
    position_refused_m: float | None = None
    # Whether the position drifts, although each epoch is near the one before.
    position_walks: bool = False
    # Wanted rate, where it is above the crop's limit, kg/ha.
    cut_from_kg_ha: float | None = None
    commanded: PreviousCommands = PreviousCommands()
    # Finding of the hopper scale on the flow, and on unordered material.
    scale: ScaleFinding = NO_SCALE_FINDING
    # Finding on the metering drive's effort.
    effort: EffortFinding = NO_EFFORT_FINDING
    # Whether the map is not at the place where work was started.
    map_elsewhere: bool = False
    # Rate while the other display sends no target, kg/ha; None while it sends a target or is not
    # used.
    silent_rate_kg_ha: float | None = None
    # Whether the index map replaces silent heads.
    by_index_map: bool = False
    # Whether the position is known but the heading is not, because the machine has not moved yet.
    course_awaited: bool = False
    # The speed that is not trusted, where wheel and GNSS contradict each other.
    speed_doubt: SpeedDoubt | None = None
    # The machine cannot give the wanted rate at this speed.
    range_breach: RangeBreach | None = None


class SafetyVerdict(NamedTuple):
    """Holds the verdict of safety on a tick."""

    state: State
    flow_allowed: bool
    # Ids of INTERLOCKS; empty exactly when flow is allowed.
    why_no_flow: tuple[str, ...]
    # Live alarms, worst first, then oldest first.
    alarms: tuple[Alarm, ...]
    # Reason for the state: an order, an alarm id, or one of STATE_REASONS.
    why_state: str = ""


STATE_REASONS: Mapping[str, str] = {
    "record_only": N_("This machine is recorded only: its drives are somebody else's."),
    "standstill": N_("Held after standing still."),
    "released": N_("The calibration button was let go."),
    "calibration_time": N_("The calibration run reached its time limit."),
    "console_gone": N_("No console came back; switched off."),
}

REFUSALS: Mapping[str, str] = {
    "not_from_state": N_("Not possible in state {state}."),
    "record_only": STATE_REASONS["record_only"],
    "acknowledge_first": N_("Acknowledge the alarm {alarm} first."),
    "cause_lives": N_("The cause is still there: {alarm}."),
    "calibrate_moving": N_("Calibrating needs wheel and GNSS, both below {speed_mps} m/s."),
    "calibrate_seconds": N_("A calibration run lasts more than 0 and at most {max_s} s."),
    "calibrate_setting": N_(
        "A shaft speed is a number of r/min, an opening a number of mm, both 0 or more."
    ),
    "map_elsewhere": N_(
        "The map lies {away_m} m from here and gives {outside_kg_ha} kg/ha outside of it. Choose "
        "another map, or allow it (H)."
    ),
    "start_held": N_("Let go of START first."),
    "release_first": N_("Let go of the calibration button first."),
    "no_such_alarm": N_("There is no live alarm {alarm}."),
    "log_works": N_("The log works; there is nothing to go on without."),
    "yes_or_no": N_("This order takes yes or no."),
    "refill_kg": N_("A refill is a number of kg above 0."),
    "refill_beyond_hopper": N_("A refill is at most what the hopper holds, {hopper_kg} kg."),
    "no_spread_margin": N_(
        "The field has margins that get nothing: flow outside of it is not allowed."
    ),
    "not_for_safety": N_("This order does not concern safety."),
}


def make_refusal(message_id: str, **details: str | float) -> str:
    """Returns the text of `Answer.why`: the id, then `;key=value` for each detail."""
    return ";".join((message_id, *(f"{key}={value}" for key, value in details.items())))


def read_refusal(why: str) -> tuple[str, dict[str, str]]:
    """Splits `Answer.why` into the id (a key of REFUSALS) and the details that its text
    contains."""
    message_id, *details = why.split(";")
    return message_id, dict(detail.split("=", 1) for detail in details)
