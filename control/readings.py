"""What did the machine's sensors read, and what is sent to its drives? Every value has its time."""

from __future__ import annotations

from enum import Enum
from itertools import pairwise
from math import inf, isfinite
from typing import Annotated, Any, NamedTuple

from topdress.control.signals import SIGNALS, Signal, ValidFor, read_signals

# Greatest number of points of a speed plan.
MAX_ANNOUNCED_POINTS = 200
# Highest speed that may be announced, m/s.
MAX_ANNOUNCED_MPS = 30.0
# A reading may be this much newer than the tick that uses it, s.
MAX_AHEAD_S = 0.1


class Reading(NamedTuple):
    """Holds an accepted value and the time of its sample on the loop's clock, s. None in place
    of a Reading: never received."""

    value: float
    time_s: float


class GnssFix(NamedTuple):
    """Holds one accepted GNSS epoch as received (antenna, WGS84, NMEA meanings)."""

    # Time of arrival on the loop's clock, s.
    time_s: float
    lat_deg: float
    lon_deg: float
    # NMEA GGA: 0 none, 1 GNSS, 2 differential, 4 RTK fixed, 5 RTK float
    fix_quality: int
    satellites: int | None = None
    hdop: float | None = None
    speed_mps: float | None = None
    # Course over ground, degrees.
    heading_deg: float | None = None
    # ISO 8601 with milliseconds and Z.
    utc: str | None = None


class CameraPlant(NamedTuple):
    """Holds a plant in a camera's picture: its distance ahead of the outlet when the picture was
    taken, m."""

    time_s: float
    ahead_m: float


class ValvePositions(NamedTuple):
    """Holds the positions of the section valves by their own switches, left to right."""

    time_s: float
    open: tuple[bool, ...]


# A rate of another display or controller, which no column of the log holds.
OUTSIDE_RATE_VALID = ValidFor(inf, 2.0)
OUTSIDE_RATE = Signal("kg/ha", possible=(0.0, 2_000.0), valid_for=OUTSIDE_RATE_VALID)


class Measurements(NamedTuple):
    """Holds everything known at one control tick. Values are the newest accepted ones, however
    old (see their time)."""

    time_s: float
    gnss: GnssFix | None = None
    wheel_speed_mps: Reading | None = None
    # One reading for each head, left to right.
    ndvi: tuple[Reading | None, ...] = ()
    shaft_rpm: Reading | None = None
    opening_mm: Reading | None = None
    hopper_kg: Reading | None = None
    supply_v: Reading | None = None
    # Nose up is positive.
    pitch_deg: Reading | None = None
    # Right side down is positive.
    roll_deg: Reading | None = None
    # None: no switch is fitted.
    work_switch: bool | None = None
    # A motor driver reports a fault.
    drive_fault: bool = False
    # The drives stand still although they are commanded to turn.
    drive_stopped: bool = False
    # The drive board receives old commands again, and stops.
    old_orders: bool = False
    # Devices whose driver failed; their data are no longer read.
    put_aside: tuple[str, ...] = ()
    # The tick before this one could not be finished.
    control_failed: bool = False
    # Name of the log in which the run continues after the one before was cut short.
    log_cut: str = ""
    # Plants in the pictures that arrived since the tick before (point mode).
    plants: tuple[CameraPlant, ...] = ()
    # The newest announced speed.
    speed_told: AnnouncedSpeeds | None = None
    # Index that the heads measure: ndvi or ndre.
    canopy_index: str = "ndvi"
    # None: there are no valves, or the board does not report them.
    valves: ValvePositions | None = None
    # Efforts are in the machine file's unit.
    shaft_effort: Reading | None = None
    gate_effort: Reading | None = None
    # Rate that another display wants.
    rate_asked: Annotated[Reading | None, OUTSIDE_RATE] = None
    # Rate that another controller reports to apply.
    rate_applied: Annotated[Reading | None, OUTSIDE_RATE] = None


class AnnouncedSpeeds(NamedTuple):
    """Holds the speeds that the tractor, or the planner of its way, announces as its targets.

    points: (seconds after `time_s`, m/s), rising in time, the first at 0; the last one holds.
    The change takes at most `acceleration_mps2`."""

    time_s: float
    points: tuple[tuple[float, float], ...]
    acceleration_mps2: float = 0.5


def describe_announcement(announced: AnnouncedSpeeds, now_s: float) -> str:
    """Returns the words of a log's row: age in s, acceleration in m/s2, then pairs of seconds
    after the announcement and m/s. A point with the speed of the one before is left out."""
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


def parse_announcement(text: str, now_s: float) -> AnnouncedSpeeds | None:
    """Reads what `describe_announcement` writes, in a row of the time `now_s`; None where the text
    is malformed."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        return None
    if len(numbers) < 4 or len(numbers) % 2:
        return None
    announced = AnnouncedSpeeds(
        now_s - numbers[0], tuple(zip(numbers[2::2], numbers[3::2], strict=True)), numbers[1]
    )
    return announced if is_announceable(announced) else None


class DoseOrder(NamedTuple):
    """Orders one turn of the standing shaft by an angle (point mode)."""

    angle_deg: float
    shaft_rpm: float


class DriveCommand(NamedTuple):
    """Holds the set-points that are sent, after every trim, limit and rounding to the drive's
    resolution."""

    shaft_rpm: float
    opening_mm: float
    # A dose that begins in this tick.
    dose: DoseOrder | None = None
    # Which sections are open, left to right; empty: the machine has no valves.
    valves: tuple[bool, ...] = ()


def is_reading_fresh(time_s: float, now_s: float, holds_s: float) -> bool:
    """Returns whether a sample of `time_s` is still valid at `now_s`: it is neither too old nor
    from the future, which means a wrong clock. False where a time is not a number."""
    return -MAX_AHEAD_S <= now_s - time_s <= holds_s


def find_valid_value(reading: Reading | None, now_s: float, holds_s: float) -> float | None:
    """Returns the value of a reading while it is valid; None where it was never received, is too
    old or is not a number."""
    if reading is None:
        return None
    value, time_s = reading
    return value if is_reading_fresh(time_s, now_s, holds_s) and isfinite(value) else None


_DECLARED = SIGNALS | read_signals(Measurements)
# Range of each reading on any spreader: far wider than a sensor's own range, which its driver
# checks.
POSSIBLE_RANGES = {
    name: possible
    for name in Measurements._fields
    if name in _DECLARED and (possible := _DECLARED[name].possible) is not None
}
# Columns of the log that hold the newest reading of a sensor.
SENSED_COLUMNS = tuple(name for name in POSSIBLE_RANGES if name in SIGNALS)
POSSIBLE_NDVI_RANGE = SIGNALS["ndvi_1"].possible or (-1.0, 1.0)
_FIX_NUMBERS = ("hdop", "speed_mps", "heading_deg")


def drop_impossible(m: Measurements) -> Measurements:
    """Returns the measurements without impossible readings.

    A reading that is not a number, outside `POSSIBLE_RANGES` or without a time counts as never
    received; so does a fix without a place on earth. Of other fixes only the numbers that are
    not finite are dropped."""
    unknown: dict[str, Any] = {}
    for name, (low, high) in POSSIBLE_RANGES.items():
        reading = getattr(m, name)
        if reading is not None and not (low <= reading.value <= high and isfinite(reading.time_s)):
            unknown[name] = None
    low, high = POSSIBLE_NDVI_RANGE
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
            for name in _FIX_NUMBERS
            if (value := getattr(fix, name)) is not None and not isfinite(value)
        }
        if not (isfinite(fix.time_s) and abs(fix.lat_deg) <= 90.0 and abs(fix.lon_deg) <= 180.0):
            unknown["gnss"] = None
        elif odd:
            unknown["gnss"] = fix._replace(**odd)
    if m.speed_told is not None and not is_announceable(m.speed_told):
        unknown["speed_told"] = None
    return m._replace(**unknown) if unknown else m


def is_announceable(announced: AnnouncedSpeeds) -> bool:
    """Returns whether these are speeds of a spreader at times that rise from now on."""
    times = [in_s for in_s, _ in announced.points]
    return (
        isfinite(announced.time_s)
        and 0.0 < announced.acceleration_mps2 <= 10.0
        and 0 < len(times) <= MAX_ANNOUNCED_POINTS
        and times[0] == 0.0
        and all(a < b for a, b in pairwise(times))
        and times[-1] <= 60.0
        and all(-MAX_ANNOUNCED_MPS <= mps <= MAX_ANNOUNCED_MPS for _, mps in announced.points)
    )


class ScaleFinding(NamedTuple):
    """Holds the findings of the scale that no trim corrects; neutral values mean none."""

    # Mass that left while nothing turned, kg.
    unordered_kg: float = 0.0
    # Mass that left beyond the believed flow (less: negative), kg, while the cause is undecided.
    off_kg: float = 0.0
    # Share of the believed flow that left, outside `low_share` to `high_share`.
    share: float | None = None
    # Closed outlets, by flow and effort of the drive, and all outlets of the machine.
    outlets: int = 0
    of_outlets: int = 0
    # Sudden fall of the flow without a known cause, %.
    below_percent: float | None = None
    # Error of the flow by the scale, larger than the greatest trim, %.
    beyond_percent: float | None = None
    # Present trim of the flow, %.
    trimmed_percent: float = 0.0
    # Difference of the scale's rise at the last refill from the ordered mass, %.
    refill_percent: float | None = None

    @property
    def is_agreeing(self) -> bool:
        """Returns whether the scale contradicts neither shaft nor gate."""
        return (
            self.off_kg == 0.0
            and self.share is None
            and self.beyond_percent is None
            and self.below_percent is None
        )

    @property
    def has_fallen(self) -> bool:
        """Returns whether the flow fell at once by more than is trimmed."""
        return self.outlets > 0 or self.below_percent is not None


NO_SCALE_FINDING = ScaleFinding()


class RangeBreach(NamedTuple):
    """Holds a wanted rate that the machine cannot give at its present speed."""

    # True: more is wanted than the machine can give. False: less.
    above: bool
    wanted_kg_ha: float
    # What the machine spreads instead, kg/ha; 0: its shaft rests.
    given_kg_ha: float
    # The ground speed from which on, or down to which, it can give the wanted rate, m/s.
    usable_mps: float


class EffortFinding(NamedTuple):
    """Holds the findings about the metering drive's effort; neutral values mean none. Efforts
    are in `unit`."""

    # Excess over the expected effort, %.
    harder_percent: float = 0.0
    # The effort is that of rollers without material.
    unloaded: bool = False
    # Mean of the last seconds; None: not judged.
    mean: float | None = None
    # Expected effort by the machine file at this speed, supply and load.
    should: float = 0.0
    # An alarm is raised below `low` and above `high`.
    low: float = 0.0
    high: float = 0.0
    # Empty: the machine file does not describe the effort.
    unit: str = ""


NO_EFFORT_FINDING = EffortFinding()


class RefusedSpeed(Enum):
    """Names the speed that is not trusted."""

    WHEEL = "wheel"
    GNSS = "gnss"
    # It is unknown which of the two is wrong.
    EITHER = "either"


class SpeedDoubt(NamedTuple):
    """Holds a contradiction between two speeds.

    `differed_s`: when they last differed. `*_mps`: mean readings of the window that showed it
    first (at a single moment a late receiver may show the opposite). `ratio`: GNSS's speed over
    the wheel's before they differed."""

    refused: RefusedSpeed
    since_s: float
    differed_s: float
    wheel_mps: float
    gnss_mps: float
    ratio: float
