"""What does safety remember between ticks? The memory is one frozen value."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from topdress.control.orders import State
from topdress.control.safety.alarms import LiveAlarm
from topdress.control.safety.motion import MotionState
from topdress.control.safety.standstill_monitor import StandstillWatch
from topdress.control.safety.work_watch import FollowWatch, HopperTimes, RateWatch


class Allowances(NamedTuple):
    """Holds the operator's permissions; all of them end with a stop."""

    reverse: bool = False
    outside: bool = False
    # Whether work without a log is permitted. The permission also ends when the log works again.
    unlogged: bool = False
    # Whether the outside rate of a distant map is permitted.
    map_elsewhere: bool = False
    # Whether work with GNSS alone is permitted, because the wheel sensor has failed.
    no_wheel: bool = False


class SafetyMemory(NamedTuple):
    """Holds the state of safety after a tick."""

    state: State = State.OFF
    why_state: str = ""
    # Time at which the state was entered, s.
    entered_s: float = -inf
    # Time at which off was last left, s.
    left_off_s: float = -inf
    # Time of the last report that the calibrate button is held, s.
    calibrate_s: float = -inf
    calibrate_until_s: float = -inf
    # Time of the last report that START is held, s.
    start_held_s: float = -inf
    allow: Allowances = Allowances()
    # Whether flow was allowed in the last tick.
    flowing: bool = False
    motion: MotionState = MotionState()
    rate: RateWatch = RateWatch()
    hopper: HopperTimes = HopperTimes()
    stand: StandstillWatch = StandstillWatch()
    follow: FollowWatch = FollowWatch()
    scale_heard: bool = False
    heads_full_since_s: float | None = None
    supply_low_since_s: float | None = None
    # Time since which the wanted rate is beyond the machine's range, s.
    beyond_range_since_s: float | None = None
    live: tuple[LiveAlarm, ...] = ()
    # Time of the check from which the following values come, s.
    checked_s: float = -inf
    # Whether wheel and GNSS are known and both slow enough to calibrate.
    still: bool = False
    # Alarm with a present cause that leads to fault.
    fault_cause: str | None = None
    log_ok: bool = True
