"""The wheel's circumference by GNSS: a straight drive of 100 m or more, measured by both at once."""
from __future__ import annotations

from math import cos, hypot, radians, sin, sqrt
from typing import NamedTuple

LEAST_M = 100.0
STRAIGHT_M = 1.0              # farthest aside from the straight line: 100 m with a bend of 1 m are 0.03 % longer
GAP_S = 1.0                   # frames farther apart: the drive is not whole
POSITION_SD_M = {4: 0.02, 5: 0.30, 2: 0.60}       # by fix quality: RTK fixed, float, differential
PLAIN_SD_M = 1.5
SEMI_MAJOR_M = 6_378_137.0    # WGS84
ECCENTRICITY_SQUARED = 0.006_694_379_990_14


class WheelSample(NamedTuple):
    time_s: float
    lat_deg: float
    lon_deg: float
    fix_quality: int
    wheel_speed_mps: float
    flowing: bool = False             # under load a wheel slips


class WheelDrive(NamedTuple):
    """gnss_m: straight from first to last place. aside_m: farthest from that line. trouble: an id, empty while good."""

    gnss_m: float = 0.0
    wheel_m: float = 0.0
    aside_m: float = 0.0
    seconds: float = 0.0
    fix_quality: int = 0
    trouble: str = ""


class WheelRun:
    """Gathers while it is `running`; `drive` is what has been driven."""

    def __init__(self) -> None:
        self.running = False
        self.drive = WheelDrive()
        self.samples: list[WheelSample] = []

    def start(self) -> None:
        self.running, self.drive, self.samples = True, WheelDrive(), []

    def stop(self) -> None:
        self.running = False

    def see(self, sample: WheelSample | None) -> None:
        """One frame; None: wheel or GNSS is not known."""
        if not self.running:
            return
        last = self.samples[-1] if self.samples else None
        if sample is None or (last is not None and sample.time_s - last.time_s > GAP_S):
            if last is not None:
                self.drive = self.drive._replace(trouble="broken")
                self.running = False
            return
        if last is not None and sample.time_s <= last.time_s:
            return
        self.samples.append(sample)
        if last is not None:
            self.drive = self._driven(self.drive, last, sample)

    def _driven(self, before: WheelDrive, last: WheelSample, now: WheelSample) -> WheelDrive:
        first = self.samples[0]
        dt_s = now.time_s - last.time_s
        east, north = metres(first, now)
        far = hypot(east, north)
        aside = max((abs(e * north - n * east) / far for e, n in (metres(first, one) for one in self._thinned())),
                    default=0.0) if far > 5.0 else 0.0
        qualities = [one.fix_quality for one in (first, now)]
        worst = max(qualities, key=lambda quality: POSITION_SD_M.get(quality, PLAIN_SD_M))
        wheel_m = before.wheel_m + 0.5 * (last.wheel_speed_mps + now.wheel_speed_mps) * dt_s
        return WheelDrive(far, wheel_m, aside, now.time_s - first.time_s, worst,
                          "bent" if aside > STRAIGHT_M + 2.0 * POSITION_SD_M.get(worst, PLAIN_SD_M) else "")

    def _thinned(self) -> list[WheelSample]:
        return self.samples[::max(1, len(self.samples) // 50)]

    @property
    def enough(self) -> bool:
        return self.drive.gnss_m >= LEAST_M and not self.drive.trouble and self.drive.wheel_m > 0.0


def metres(origin: WheelSample, place: WheelSample) -> tuple[float, float]:
    """East and north of an origin, m, by the ellipsoid's radii of curvature there: to 1e-5 of the length over 1 km."""
    lat = radians(origin.lat_deg)
    bulge = 1.0 - ECCENTRICITY_SQUARED * sin(lat) ** 2
    across_m = SEMI_MAJOR_M / sqrt(bulge)
    along_m = across_m * (1.0 - ECCENTRICITY_SQUARED) / bulge
    return (radians(place.lon_deg - origin.lon_deg) * across_m * cos(lat),
            radians(place.lat_deg - origin.lat_deg) * along_m)
