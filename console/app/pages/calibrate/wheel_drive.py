"""Records a straight drive of 100 m or more by GNSS and by the wheel, for the wheel's
circumference.
"""

from __future__ import annotations

from math import hypot
from typing import NamedTuple

from topdress.control.geodesy import Place, TangentPlane

# Shortest drive, m: over 100 m the noise of two differential fixes is below 1 %.
MIN_DRIVE_M = 100.0
# Largest offset from the straight line, m: a bend of 1 m lengthens 100 m by 0.03 %.
MAX_STRAIGHT_OFFSET_M = 1.0
# Frames further apart than this, s, interrupt the drive.
MAX_SAMPLE_STEP_S = 1.0
# Standard deviation of a position by fix quality, m: 4 RTK fixed, 5 RTK float, 2 differential.
POSITION_SD_M = {4: 0.02, 5: 0.30, 2: 0.60}
# Standard deviation of a position without correction, m.
UNKNOWN_FIX_SD_M = 1.5


class WheelSample(NamedTuple):
    """Holds a sample of a drive."""

    time_s: float
    lat_deg: float
    lon_deg: float
    fix_quality: int
    wheel_speed_mps: float
    # True while material flows: a wheel slips under load.
    flowing: bool = False


class WheelDrive(NamedTuple):
    """Describes a drive.

    Attributes
    ----------
    gnss_m
        Straight distance from the first to the last position, m.
    wheel_m
        Distance by the wheel, m.
    aside_m
        Largest offset from the straight line, m.
    trouble
        "bent" or "broken"; "" for a good drive.
    """

    gnss_m: float = 0.0
    wheel_m: float = 0.0
    aside_m: float = 0.0
    seconds: float = 0.0
    fix_quality: int = 0
    trouble: str = ""


class WheelRun:
    """Collects samples while it is `running`; `drive` describes the drive so far."""

    def __init__(self) -> None:
        self.running = False
        self.drive = WheelDrive()
        self.samples: list[WheelSample] = []
        # Positions of the samples in the plane of the first sample.
        self._places: list[Place] = []

    def start_drive(self) -> None:
        """Start a new drive."""
        self.running, self.drive, self.samples, self._places = True, WheelDrive(), [], []

    def stop_drive(self) -> None:
        """Stop collecting."""
        self.running = False

    def add_sample(self, sample: WheelSample | None) -> None:
        """Add a frame's sample; None means that the wheel or GNSS is silent."""
        if not self.running:
            return
        last = self.samples[-1] if self.samples else None
        if sample is None or (last is not None and sample.time_s - last.time_s > MAX_SAMPLE_STEP_S):
            if last is not None:
                self.drive = self.drive._replace(trouble="broken")
                self.running = False
            return
        # The same frame may arrive twice.
        if last is not None and sample.time_s <= last.time_s:
            return
        self.samples.append(sample)
        plane = TangentPlane(self.samples[0].lat_deg, self.samples[0].lon_deg)
        self._places.append(plane.project_to_m(sample.lat_deg, sample.lon_deg))
        if last is not None:
            self.drive = self._extend_drive(self.drive, last, sample)

    def _extend_drive(self, before: WheelDrive, last: WheelSample, now: WheelSample) -> WheelDrive:
        """Return the description of a drive that has one more sample."""
        first = self.samples[0]
        dt_s = now.time_s - last.time_s
        east, north = self._places[-1]
        far = hypot(east, north)
        # At most 50 positions are checked: a bend shows in every sample of a drive.
        thinned = self._places[:: max(1, len(self._places) // 50)]
        aside = max(abs(e * north - n * east) / far for e, n in thinned) if far > 5.0 else 0.0
        qualities = [one.fix_quality for one in (first, now)]
        # The worse of the two end positions determines the tolerance.
        worst = max(qualities, key=lambda quality: POSITION_SD_M.get(quality, UNKNOWN_FIX_SD_M))
        wheel_m = before.wheel_m + 0.5 * (last.wheel_speed_mps + now.wheel_speed_mps) * dt_s
        return WheelDrive(
            far,
            wheel_m,
            aside,
            now.time_s - first.time_s,
            worst,
            "bent"
            if aside > MAX_STRAIGHT_OFFSET_M + 2.0 * POSITION_SD_M.get(worst, UNKNOWN_FIX_SD_M)
            else "",
        )

    @property
    def is_long_enough(self) -> bool:
        """Whether the drive is long and straight enough for a circumference."""
        return (
            self.drive.gnss_m >= MIN_DRIVE_M and not self.drive.trouble and self.drive.wheel_m > 0.0
        )
