"""What the machine's sensors said, and what is sent to its drives. Every value carries its time."""

from __future__ import annotations

from enum import Enum
from itertools import pairwise
from math import isfinite
from typing import Any, NamedTuple

MOST_ANNOUNCED = 200  # points of a speed plan
FASTEST_ANNOUNCED_MPS = 30.0
# a reading may be this much newer than the tick that looks at it
AHEAD_S = 0.1


class Reading(NamedTuple):
    """One accepted value. `None` in place of a Reading: never received."""

    value: float
    time_s: float  # when it was sampled, on the loop's clock


class GnssFix(NamedTuple):
    """One accepted GNSS epoch, as received (antenna, WGS84, NMEA meanings)."""

    time_s: float  # arrival on the loop's clock
    lat_deg: float
    lon_deg: float
    # NMEA GGA: 0 none, 1 GNSS, 2 differential, 4 RTK fixed, 5 RTK float
    fix_quality: int
    satellites: int | None = None
    hdop: float | None = None
    speed_mps: float | None = None
    heading_deg: float | None = None  # course over ground
    utc: str | None = None  # ISO 8601, milliseconds, Z


class PlantSeen(NamedTuple):
    """A plant in a camera's picture: how far ahead of the outlet when the picture was taken."""

    time_s: float
    ahead_m: float


class ValvesSeen(NamedTuple):
    """How the sections' valves stand, left to right, by their own switches."""

    time_s: float
    open: tuple[bool, ...]


class Measurements(NamedTuple):
    """Everything known at one control tick; values are the newest accepted, however old (see
    their time)."""

    time_s: float
    gnss: GnssFix | None = None
    wheel_speed_mps: Reading | None = None
    ndvi: tuple[Reading | None, ...] = ()  # one per head, left to right
    shaft_rpm: Reading | None = None
    opening_mm: Reading | None = None
    hopper_kg: Reading | None = None
    supply_v: Reading | None = None
    pitch_deg: Reading | None = None  # nose up positive
    roll_deg: Reading | None = None  # right side down positive
    work_switch: bool | None = None  # None: not fitted
    drive_fault: bool = False  # a motor driver says so
    # the drives have stood still by themselves though commanded to turn
    drive_stopped: bool = False
    # the drive board hears commands that it had before: it stops
    old_orders: bool = False
    # devices whose driver failed: not listened to any more
    put_aside: tuple[str, ...] = ()
    control_failed: bool = False  # the tick before this one could not be finished
    # the log in which the run goes on: the one before was cut short
    log_cut: str = ""
    # of the pictures that came since the tick before (point mode)
    plants: tuple[PlantSeen, ...] = ()
    speed_told: SpeedPlan | None = None  # newest
    canopy_index: str = "ndvi"  # that the heads give: ndvi or ndre
    valves: ValvesSeen | None = None  # None: no valves, or a board that does not tell
    # how hard the drive works, in the machine file's unit
    shaft_effort: Reading | None = None
    gate_effort: Reading | None = None
    rate_asked: Reading | None = None  # kg/ha that another display wants
    rate_applied: Reading | None = None  # kg/ha that another controller says it applies


class SpeedPlan(NamedTuple):
    """Speeds that the tractor, or whoever plans its way, says it will aim at.

    points: (seconds after `time_s`, m/s), rising in time, the first at 0; the last one holds.
    It gets there with at most `acceleration_mps2`.
    """

    time_s: float
    points: tuple[tuple[float, float], ...]
    acceleration_mps2: float = 0.5


def announced_text(announced: SpeedPlan, now_s: float) -> str:
    """As a log's row says it: age in s, acceleration in m/s2, then pairs of seconds after its
    announcement and m/s. A point with the speed of the one before it says nothing new and is
    left out."""
    points = [
        point
        for k, point in enumerate(announced.points)
        if k == 0 or point[1] != announced.points[k - 1][1]
    ]
    return " ".join(
        map(
            repr,
            (
                max(0.0, now_s - announced.time_s),
                announced.acceleration_mps2,
                *(float(number) for point in points for number in point),
            ),
        )
    )


def announced_of(text: str, now_s: float) -> SpeedPlan | None:
    """What `announced_text` says, read in a row of the time `now_s`; None where it says nothing."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        return None
    if len(numbers) < 4 or len(numbers) % 2:
        return None
    announced = SpeedPlan(
        now_s - numbers[0], tuple(zip(numbers[2::2], numbers[3::2], strict=True)), numbers[1]
    )
    return announced if can_be_announced(announced) else None


class DoseOrder(NamedTuple):
    """Turn the standing shaft once by an angle (point mode)."""

    angle_deg: float
    shaft_rpm: float


class DriveCommand(NamedTuple):
    """Set-points on the wire, after every trim, limit and rounding to the drive's resolution."""

    shaft_rpm: float
    opening_mm: float
    dose: DoseOrder | None = None  # begins in this tick
    # of the sections, left to right: open; none: the machine has no valves
    valves: tuple[bool, ...] = ()


def is_fresh(time_s: float, now_s: float, holds_s: float) -> bool:
    """Whether what was sampled at `time_s` still holds at `now_s`: not too old, and not from
    the future, which is a clock gone wrong. False where a time is no number."""
    return -AHEAD_S <= now_s - time_s <= holds_s


def held(reading: Reading | None, now_s: float, holds_s: float) -> float | None:
    """What was read, as long as it holds; None: never received, too old, or no number."""
    if reading is None:
        return None
    value, time_s = reading
    return value if is_fresh(time_s, now_s, holds_s) and isfinite(value) else None


# What a reading can be on any machine that spreads: far wider than a sensor's own range, which
# its driver knows.
POSSIBLE: dict[str, tuple[float, float]] = {
    "wheel_speed_mps": (-100.0, 100.0),
    "shaft_rpm": (-10_000.0, 10_000.0),
    "opening_mm": (-1_000.0, 10_000.0),
    "hopper_kg": (-100_000.0, 100_000.0),
    "supply_v": (-1_000.0, 1_000.0),
    "pitch_deg": (-180.0, 180.0),
    "roll_deg": (-180.0, 180.0),
    "shaft_effort": (-1_000.0, 1_000.0),
    "gate_effort": (-1_000.0, 1_000.0),
    "rate_asked": (0.0, 2_000.0),
    "rate_applied": (0.0, 2_000.0),
}
POSSIBLE_NDVI = (-100.0, 100.0)
_OF_A_FIX = ("hdop", "speed_mps", "heading_deg")


def possible(m: Measurements) -> Measurements:
    """The measurements without what cannot be: a reading that is no number, outside `POSSIBLE`,
    or of no time counts as never received, a fix without a place on earth as well. Of a fix
    that has one, other numbers that are none go."""
    unknown: dict[str, Any] = {}
    for name, (low, high) in POSSIBLE.items():
        reading = getattr(m, name)
        if reading is not None and not (low <= reading.value <= high and isfinite(reading.time_s)):
            unknown[name] = None
    low, high = POSSIBLE_NDVI
    ndvi = tuple(
        [
            reading
            if reading is None or (low <= reading.value <= high and isfinite(reading.time_s))
            else None
            for reading in m.ndvi
        ]
    )
    if ndvi != m.ndvi:
        unknown["ndvi"] = ndvi
    fix = m.gnss
    if fix is not None:
        odd: dict[str, Any] = {
            name: None
            for name in _OF_A_FIX
            if (value := getattr(fix, name)) is not None and not isfinite(value)
        }
        if not (isfinite(fix.time_s) and abs(fix.lat_deg) <= 90.0 and abs(fix.lon_deg) <= 180.0):
            unknown["gnss"] = None
        elif odd:
            unknown["gnss"] = fix._replace(**odd)
    if m.speed_told is not None and not can_be_announced(m.speed_told):
        unknown["speed_told"] = None
    return m._replace(**unknown) if unknown else m


def can_be_announced(announced: SpeedPlan) -> bool:
    """Whether these are speeds of a machine that spreads, at times that rise from now on."""
    times = [in_s for in_s, _ in announced.points]
    return (
        isfinite(announced.time_s)
        and 0.0 < announced.acceleration_mps2 <= 10.0
        and 0 < len(times) <= MOST_ANNOUNCED
        and times[0] == 0.0
        and all(a < b for a, b in pairwise(times))
        and times[-1] <= 60.0
        and all(
            -FASTEST_ANNOUNCED_MPS <= mps <= FASTEST_ANNOUNCED_MPS for _, mps in announced.points
        )
    )


class ScaleSays(NamedTuple):
    """What the scale says that is no trim, now; neutral values: nothing."""

    unordered_kg: float = 0.0  # left while nothing turned
    # left more (less: negative) than is believed, and why is not decided yet
    off_kg: float = 0.0
    # of the believed flow, that left: outside `low_share` to `high_share`
    share: float | None = None
    # that give nothing, as flow and the drive's effort say
    outlets: int = 0
    of_outlets: int = 0  # the machine's
    # the flow fell at once by so much, %, and nothing says by what
    below_percent: float | None = None
    # the flow is so far off by the scale, which is more than is trimmed
    beyond_percent: float | None = None
    trimmed_percent: float = 0.0  # the flow is moved so far
    # the scale's rise at the last refill is so far off the order's kg
    refill_percent: float | None = None

    @property
    def agrees(self) -> bool:
        """Nothing that it says is against what shaft and gate read."""
        return (
            self.off_kg == 0.0
            and self.share is None
            and self.beyond_percent is None
            and self.below_percent is None
        )

    @property
    def fell(self) -> bool:
        """The flow fell at once, by more than is trimmed."""
        return self.outlets > 0 or self.below_percent is not None


NOTHING_SAID = ScaleSays()


class RangeBreach(NamedTuple):
    """A wanted rate that the machine cannot give at its present speed."""

    # True: more is wanted than the machine can give. False: less.
    above: bool
    wanted_kg_ha: float
    # What the machine spreads instead, kg/ha; 0: its shaft rests.
    given_kg_ha: float
    # The ground speed from which on, or down to which, it can give the wanted rate, m/s.
    usable_mps: float


class EffortSays(NamedTuple):
    """What the metering drive's effort says, now; neutral values: nothing. Efforts are in
    `unit`."""

    harder_percent: float = 0.0  # than it should
    unloaded: bool = False  # as if no material were in the rollers
    mean: float | None = None  # of the last seconds; None: not judged
    # by the machine file, at this speed, supply and load
    should: float = 0.0
    low: float = 0.0  # below it, and above `high`, it is an alarm
    high: float = 0.0
    unit: str = ""  # "": the machine file says nothing of effort


NO_EFFORT = EffortSays()


class Doubted(Enum):
    """Which speed is not believed."""

    WHEEL = "wheel"
    GNSS = "gnss"
    EITHER = "either"  # nothing says which


class SpeedDoubt(NamedTuple):
    """`differed_s`: when they were last seen to differ; `*_mps`: as read in the mean of the time
    that showed it first (of one moment a receiver that comes late may tell the other way round);
    `ratio`: GNSS's speed by the wheel's, before they parted."""

    refused: Doubted
    since_s: float
    differed_s: float
    wheel_mps: float
    gnss_mps: float
    ratio: float
