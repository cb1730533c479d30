"""Which words do operator, loop and log share? States, strategies, sources of the target,
orders."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class State(StrEnum):
    """Names the states of the machine's control."""

    OFF = "off"
    READY = "ready"
    WORKING = "working"
    HELD = "held"
    CALIBRATING = "calibrating"
    FAULT = "fault"


class Strategy(StrEnum):
    """Names the metering strategies."""

    OPENING_FIRST = "opening_first"
    SPEED_FIRST = "speed_first"
    # Older job files, logs and orders use this word; it works as opening first.
    BALANCED = "balanced"

    @property
    def in_force(self) -> Strategy:
        """Returns the strategy that this word stands for."""
        return Strategy.OPENING_FIRST if self is Strategy.BALANCED else self


# The operator can choose among these.
STRATEGIES = tuple(one for one in Strategy if one is one.in_force)


class TargetSource(StrEnum):
    """Names the sources of the target rate."""

    CANOPY = "canopy"
    MAP = "map"
    POINT = "point"
    MANUAL = "manual"
    FALLBACK = "fallback"
    NONE = "none"
    # The map gives the mean rate, the heads vary it.
    MAP_AND_CANOPY = "map_and_canopy"
    # Another display gives the rate over a line.
    EXTERNAL = "external"
    # With source canopy, the index map decides where the heads are silent.
    INDEX_MAP = "index_map"


# These sources need the heads, the map, or a place.
CANOPY_SOURCES = (TargetSource.CANOPY, TargetSource.MAP_AND_CANOPY)
MAP_SOURCES = (TargetSource.MAP, TargetSource.MAP_AND_CANOPY)
PLACE_SOURCES = (*MAP_SOURCES, TargetSource.POINT)


class Severity(StrEnum):
    """Names how urgent an alarm is."""

    # Work continues.
    AMBER = "amber"
    # The flow is stopped or about to be; the operator must acknowledge.
    RED = "red"


class Do(StrEnum):
    """Names the operator's orders; the comment gives the value that accompanies each."""

    READY = "ready"  # off -> ready; held or fault -> ready
    # From ready or held to working. A value of True is repeated while the button is down.
    START = "start"
    HOLD = "hold"  # working -> held
    STOP = "stop"  # any -> off
    # From ready to calibrating, for so many seconds at most; repeated while the button is down.
    CALIBRATE = "calibrate"
    CALIBRATE_SHAFT = "calibrate_shaft"  # while calibrating; value: r/min
    CALIBRATE_OPENING = "calibrate_opening"  # while calibrating; value: mm
    # From calibrating to ready, when the hold-to-run button is released.
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
    # value: a strip as measured, as `StripMean.event_text` says it; `none`
    STRIP = "strip"
    # value: m, measured behind the machine on the newest doses; late is positive
    DOSE_ERROR = "dose_error"


class Order(NamedTuple):
    """Holds an order of the operator and its value."""

    do: Do
    value: str | float | bool | None = None


class Answer(NamedTuple):
    """Holds the answer to an order. `why` is a message id with its details, which the console
    translates; empty when accepted."""

    accepted: bool
    why: str = ""


class SectionState(NamedTuple):
    """Holds the state of one section of a machine with valves. `why` is the reason of its
    closing, one of `SECTION_CLOSED_REASONS`; empty where it is open."""

    open: bool
    why: str = ""


SECTION_CLOSED_REASONS = ("outside", "headland", "done", "map", "hand", "no_flow")


class Alarm(NamedTuple):
    """Holds a live alarm. `control.safety.ALARMS` has its text and remedy under the id."""

    id: str
    severity: Severity
    since_s: float
    acknowledged: bool = False
    # Names and values that the text contains.
    details: tuple[tuple[str, str | float], ...] = ()
    # Time since when the cause is gone although the alarm stands, s; None: the cause persists.
    gone_s: float | None = None
