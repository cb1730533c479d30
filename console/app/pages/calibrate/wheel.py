"""The wheel's circumference by GNSS: a straight drive of 100 m or more, measured by both at
once."""

from __future__ import annotations

from math import hypot
from typing import NamedTuple

from topdress.control.geodesy import Place, TangentPlane

LEAST_DRIVE_M = 100.0
# farthest aside from the straight line: 100 m with a bend of 1 m are 0.03 % longer
STRAIGHT_M = 1.0
LONGEST_STEP_S = 1.0  # frames farther apart: the drive is not whole
# by fix quality: RTK fixed, float, differential
POSITION_SD_M = {4: 0.02, 5: 0.30, 2: 0.60}
UNKNOWN_FIX_SD_M = 1.5


class WheelSample(NamedTuple):
    """Holds a sample of a drive."""

    time_s: float
    lat_deg: float
    lon_deg: float
    fix_quality: int
    wheel_speed_mps: float
    flowing: bool = False  # under load a wheel slips


class WheelDrive(NamedTuple):
    """Describes a drive. gnss_m: straight from first to last place. aside_m: farthest from that
    line. trouble: an id, empty while good."""

    gnss_m: float = 0.0
    wheel_m: float = 0.0
    aside_m: float = 0.0
    seconds: float = 0.0
    fix_quality: int = 0
    trouble: str = ""


class WheelRun:
    """Gathers samples while it is `running`; `drive` describes the drive so far."""

    def __init__(self) -> None:
        self.running = False
        self.drive = WheelDrive()
        self.samples: list[WheelSample] = []
        self._places: list[Place] = []  # of the samples, on the plane of the first one

    def start_drive(self) -> None:
        """Start anew."""
        self.running, self.drive, self.samples, self._places = True, WheelDrive(), [], []

    def stop_drive(self) -> None:
        """Stop gathering."""
        self.running = False

    def add_sample(self, sample: WheelSample | None) -> None:
        """Add a frame's sample; None: wheel or GNSS is not known."""
        if not self.running:
            return
        last = self.samples[-1] if self.samples else None
        if sample is None or (last is not None and sample.time_s - last.time_s > LONGEST_STEP_S):
            if last is not None:
                self.drive = self.drive._replace(trouble="broken")
                self.running = False
            return
        if last is not None and sample.time_s <= last.time_s:
            return
        self.samples.append(sample)
        plane = TangentPlane(self.samples[0].lat_deg, self.samples[0].lon_deg)
        self._places.append(plane.project_to_m(sample.lat_deg, sample.lon_deg))
        if last is not None:
            self.drive = self._extend_drive(self.drive, last, sample)

    def _extend_drive(self, before: WheelDrive, last: WheelSample, now: WheelSample) -> WheelDrive:
        first = self.samples[0]
        dt_s = now.time_s - last.time_s
        east, north = self._places[-1]
        far = hypot(east, north)
        thinned = self._places[:: max(1, len(self._places) // 50)]
        aside = max(abs(e * north - n * east) / far for e, n in thinned) if far > 5.0 else 0.0
        qualities = [one.fix_quality for one in (first, now)]
        worst = max(qualities, key=lambda quality: POSITION_SD_M.get(quality, UNKNOWN_FIX_SD_M))
        wheel_m = before.wheel_m + 0.5 * (last.wheel_speed_mps + now.wheel_speed_mps) * dt_s
        return WheelDrive(
            far,
            wheel_m,
            aside,
            now.time_s - first.time_s,
            worst,
            "bent" if aside > STRAIGHT_M + 2.0 * POSITION_SD_M.get(worst, UNKNOWN_FIX_SD_M) else "",
        )

    @property
    def is_long_enough(self) -> bool:
        """Whether the drive gives a circumference."""
        return (
            self.drive.gnss_m >= LEAST_DRIVE_M
            and not self.drive.trouble
            and self.drive.wheel_m > 0.0
        )
