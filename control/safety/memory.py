"""What does safety remember from one tick to the next? One frozen value."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from topdress.control.orders import State
from topdress.control.safety.alarms import LiveAlarm
from topdress.control.safety.motion import Motion
from topdress.control.safety.standstill_monitor import StandstillWatch
from topdress.control.safety.work_watch import FollowWatch, HopperWatch, RateWatch


class Allowances(NamedTuple):
    """Holds what the operator allows; everything ends with a stop."""

    reverse: bool = False
    outside: bool = False
    unlogged: bool = False  # ends also when the log works again
    # the outside rate of a map that does not lie here is wanted
    map_elsewhere: bool = False
    # the wheel sensor is dead: GNSS alone says how fast it goes
    no_wheel: bool = False


class Memory(NamedTuple):
    """Holds the state of safety after a tick."""

    state: State = State.OFF
    why_state: str = ""
    entered_s: float = -inf  # the state was entered
    left_off_s: float = -inf  # off was last left
    # last time the calibrate button was reported down
    calibrate_s: float = -inf
    calibrate_until_s: float = -inf
    start_held_s: float = -inf  # last time START was reported held down
    allow: Allowances = Allowances()
    flowing: bool = False  # flow was allowed at the last tick
    motion: Motion = Motion()
    rate: RateWatch = RateWatch()
    hopper: HopperWatch = HopperWatch()
    stand: StandstillWatch = StandstillWatch()
    follow: FollowWatch = FollowWatch()
    scale_heard: bool = False
    heads_full_since_s: float | None = None
    # The wanted rate has been beyond the machine's range since then.
    beyond_range_since_s: float | None = None
    live: tuple[LiveAlarm, ...] = ()
    checked_s: float = -inf  # what follows is from that check
    # wheel and GNSS known, both slow enough to calibrate
    still: bool = False
    # an alarm that leads to fault and whose cause is there now
    fault_cause: str | None = None
    log_ok: bool = True
