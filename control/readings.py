"""What the machine's sensors said, and what is sent to its drives. Every value carries its time."""
from __future__ import annotations

from typing import NamedTuple

AHEAD_S = 0.1           # a reading may be this much newer than the tick that looks at it


class Reading(NamedTuple):
    """One accepted value. `None` in place of a Reading: never received."""

    value: float
    time_s: float          # when it was sampled, on the loop's clock


class GnssFix(NamedTuple):
    """One accepted GNSS epoch, as received (antenna, WGS84, NMEA meanings)."""

    time_s: float          # arrival on the loop's clock
    lat_deg: float
    lon_deg: float
    fix_quality: int       # NMEA GGA: 0 none, 1 GNSS, 2 differential, 4 RTK fixed, 5 RTK float
    satellites: int | None = None
    hdop: float | None = None
    speed_mps: float | None = None
    heading_deg: float | None = None     # course over ground
    utc: str | None = None               # ISO 8601, milliseconds, Z


class PlantSeen(NamedTuple):
    """A plant in a camera's picture: how far ahead of the outlet when the picture was taken."""

    time_s: float
    ahead_m: float


class Measurements(NamedTuple):
    """Everything known at one control tick; values are the newest accepted, however old (see their time)."""

    time_s: float
    gnss: GnssFix | None = None
    wheel_speed_mps: Reading | None = None
    ndvi: tuple[Reading | None, ...] = ()        # one per head, left to right
    shaft_rpm: Reading | None = None
    opening_mm: Reading | None = None
    hopper_kg: Reading | None = None
    supply_v: Reading | None = None
    pitch_deg: Reading | None = None             # nose up positive
    roll_deg: Reading | None = None              # right side down positive
    work_switch: bool | None = None              # None: not fitted
    drive_fault: bool = False                    # a motor driver says so
    drive_stopped: bool = False                  # the drives have stood still by themselves though told to turn
    plants: tuple[PlantSeen, ...] = ()           # of the pictures that came since the tick before (point mode)


class DoseOrder(NamedTuple):
    """Turn the standing shaft once by an angle (point mode)."""

    angle_deg: float
    shaft_rpm: float


class DriveCommand(NamedTuple):
    """Set-points on the wire, after every trim, limit and rounding to the drive's resolution."""

    shaft_rpm: float
    opening_mm: float
    dose: DoseOrder | None = None       # begins in this tick


def is_fresh(time_s: float, now_s: float, holds_s: float) -> bool:
    """Whether what was sampled at `time_s` still holds at `now_s`: not too old, and not from the future, which is a
    clock gone wrong. False where a time is no number."""
    return -AHEAD_S <= now_s - time_s <= holds_s
