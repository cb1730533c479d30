"""The words shared by operator, loop and log: states, strategies, sources of the target, orders."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class State(StrEnum):
    OFF = "off"
    READY = "ready"
    WORKING = "working"
    HELD = "held"
    CALIBRATING = "calibrating"
    FAULT = "fault"


class Strategy(StrEnum):
    OPENING_FIRST = "opening_first"
    SPEED_FIRST = "speed_first"
    # a word of older job files, logs and orders: it works as opening first
    BALANCED = "balanced"

    @property
    def in_force(self) -> Strategy:
        return Strategy.OPENING_FIRST if self is Strategy.BALANCED else self


# those that can be chosen
STRATEGIES = tuple(one for one in Strategy if one is one.in_force)


class TargetSource(StrEnum):
    CANOPY = "canopy"
    MAP = "map"
    POINT = "point"
    MANUAL = "manual"
    FALLBACK = "fallback"
    NONE = "none"
    MAP_AND_CANOPY = "map_and_canopy"  # the map's rate, the heads' around it
    EXTERNAL = "external"  # another display's, over a line
    # by source canopy: decided from the index map, where the heads are silent
    INDEX_MAP = "index_map"


BY_CANOPY = (TargetSource.CANOPY, TargetSource.MAP_AND_CANOPY)  # the heads are needed
BY_MAP = (TargetSource.MAP, TargetSource.MAP_AND_CANOPY)
BY_PLACE = (*BY_MAP, TargetSource.POINT)  # a place is needed


class Severity(StrEnum):
    AMBER = "amber"  # work goes on
    # flow stopped or about to be; must be acknowledged
    RED = "red"


class Do(StrEnum):
    """What an operator may order. The value that goes with it stands in the comment."""

    READY = "ready"  # off -> ready; held or fault -> ready
    # ready or held -> working; value True: the button is down, repeated while it is
    START = "start"
    HOLD = "hold"  # working -> held
    STOP = "stop"  # any -> off
    # ready -> calibrating; value: seconds at most; repeated while the button is down
    CALIBRATE = "calibrate"
    CALIBRATE_SHAFT = "calibrate_shaft"  # while calibrating; value: r/min
    CALIBRATE_OPENING = "calibrate_opening"  # while calibrating; value: mm
    # hold-to-run button released: calibrating -> ready
    RELEASE = "release"
    STRATEGY = "strategy"  # value: a Strategy
    SOURCE = "source"  # value: a TargetSource
    NUDGE = "nudge"  # value: percent on top of the target, -30 to 30
    MANUAL_RATE = "manual_rate"  # value: kg/ha
    ACKNOWLEDGE = "acknowledge"  # value: alarm id, or "" for all
    MARK = "mark"  # value: free text, kept in the log's events
    REFILL = "refill"  # value: kg filled in
    # value: kg; the last refill reported with this mass was none
    REFILL_BACK = "refill_back"
    ALLOW_REVERSE = "allow_reverse"  # value: True / False
    ALLOW_OUTSIDE = "allow_outside"  # value: True / False
    # value: True / False: the outside rate of a map that lies elsewhere
    ALLOW_MAP_ELSEWHERE = "allow_map_elsewhere"
    # value: True / False: a wheel that stands counts for nothing, GNSS alone does
    ALLOW_NO_WHEEL = "allow_no_wheel"
    GO_ON_UNLOGGED = "go_on_unlogged"  # value: True / False
    # value: True / False: the scale may correct the flow model
    FLOW_TRIM = "flow_trim"
    LOOK_AHEAD = "look_ahead"  # value: True / False
    # value: True / False: ground that has its material gets no more
    NO_DOUBLE = "no_double"
    # value: "2 off", "2 auto" or "all auto"; sections count from 1, left to right
    SECTION = "section"
    # value: a strip as measured, as `agronomy.strips.StripValue.text` says it; `none`
    STRIP = "strip"
    # value: m, measured behind the machine on the newest doses; late is positive
    DOSE_ERROR = "dose_error"


class Order(NamedTuple):
    do: Do
    value: str | float | bool | None = None


class Answer(NamedTuple):
    """`why` is a message id with its details, translated by the console; empty when accepted."""

    accepted: bool
    why: str = ""


class SectionState(NamedTuple):
    """One section of a machine with valves. `why` it is commanded closed: `WHY_CLOSED`, empty
    where it is open."""

    open: bool
    why: str = ""


WHY_CLOSED = ("outside", "headland", "done", "map", "hand", "no_flow")


class Alarm(NamedTuple):
    """A live alarm. Text and what to do are found under the id in `control.safety.ALARMS`."""

    id: str
    severity: Severity
    since_s: float
    acknowledged: bool = False
    details: tuple[tuple[str, str | float], ...] = ()  # values that the text names
    # its cause is away since then, and the alarm stands still; None: the cause is there
    gone_s: float | None = None
