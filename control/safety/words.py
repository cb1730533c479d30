"""Which values does safety exchange with the loop? Its input and verdict, and texts for
translation."""

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

Details = tuple[tuple[str, str | float], ...]


def N_(message: str) -> str:
    """Marks an English source string for translation; the console translates it when it is
    shown."""
    return message


# The drives have power in these states.
POWERED_STATES = (State.WORKING, State.HELD, State.CALIBRATING)


class Commanded(NamedTuple):
    """Holds the commands of the tick before, which the readings of this tick must follow."""

    # the shaft: a speed, or a dose that is not over yet
    turn: bool = True
    flow: bool = True  # material was allowed to flow
    enabled: bool = True  # the drives have power
    opening_mm: float = 0.0
    valves: tuple[bool, ...] = ()  # of the sections, left to right; none: no valves
    expected_rpm: float = 0.0  # of the shaft by now, by the machine model
    # released in this stop so far, by the measured shaft
    stopped_kg: float = 0.0
    # what the gate should read by now, by the machine model
    expected_mm: float = 0.0
    shaft_rpm: float = 0.0  # set-point; 0: to stop, in a dose, or not judged


class Situation(NamedTuple):
    """Holds what safety needs to know of a tick. None is unknown; a number that is not finite
    counts as unknown."""

    measurements: Measurements
    speed_used_mps: float | None  # None: both speeds silent
    gnss_period_s: float  # observed period of GNSS epochs
    wheel_standstill: bool  # no wheel pulse for 0.8 s, or the wheel reads 0
    target_source: TargetSource  # of the operator's mode
    position_ok: bool  # own or dead-reckoned position is usable
    landing_inside: bool | None  # None: no field known
    valid_heads: int | None  # None: heads not needed in this mode
    ndvi_age_s: float | None
    # target passed through the nominal response of the actuators
    expected_rate_kg_ha: float | None
    applied_rate_kg_ha: float | None  # raw
    target_rate_kg_ha: float
    metres_left_m: float | None
    # highest speed whose lead the heads still cover; None: not short
    usable_speed_mps: float | None
    # since the operating console was heard; None: none needed (headless)
    console_age_s: float | None
    log_ok: bool
    # the newest epoch was ruled out: how far off it lies
    position_refused_m: float | None = None
    # it has walked off, each epoch near the one before
    position_walks: bool = False
    # the rate that was wanted, where it is above the crop's limit
    cut_from_kg_ha: float | None = None
    commanded: Commanded = Commanded()
    # what the hopper scale says of the flow, and of material that nobody ordered
    scale: ScaleFinding = NO_SCALE_FINDING
    # what the metering drive's effort says of its load
    effort: EffortFinding = NO_EFFORT_FINDING
    map_elsewhere: bool = False  # the map does not lie where work was started
    # what is spread while the other display tells no target; None: it tells one, or is not asked
    silent_rate_kg_ha: float | None = None
    by_index_map: bool = False  # the index map stands in for silent heads
    # the position is known, but it never moved: where it points is not
    course_awaited: bool = False
    # wheel and GNSS do not tell one speed: which is not believed
    speed_doubt: SpeedDoubt | None = None
    # The machine cannot give the wanted rate at this speed.
    range_breach: RangeBreach | None = None


class Verdict(NamedTuple):
    """Holds the answer of safety to a tick."""

    state: State
    flow_allowed: bool
    # ids of INTERLOCKS; empty exactly when flow is allowed
    why_no_flow: tuple[str, ...]
    alarms: tuple[Alarm, ...]  # live, worst first, then oldest first
    # what led to the state: an order, an alarm id, or one of STATE_REASONS
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
