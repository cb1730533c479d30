"""Which speed and which place control uses.

The wheel tells changes of speed quickly, GNSS tells its level without slip: the wheel, corrected by a slowly learned
ratio, drives the filter `speed_used`; either alone serves when the other is silent.
"""
from __future__ import annotations

from dataclasses import dataclass
from math import cos, exp, radians, sin
from typing import NamedTuple

from control.geodesy import TangentPlane
from control.readings import Measurements

FILTER_TAU_S = 0.4              # filter `speed_used`, second order: its step response is half-way after 0.3 s;
                                # a steady acceleration passes without delay
RATIO_TAU_S = 10.0              # how slowly the wheel is corrected by GNSS
STANDSTILL_S = 0.8              # no wheel pulse for this long: standing
HELD_SPEED_S = 2.0              # both speeds silent: the last one holds this long
DEAD_RECKONING_S = 2.0          # a place without GNSS is believed this long
HEADING_FROM_MPS = 0.3          # below, course over ground is noise
HEADING_TAU_S = 0.5             # filter `heading`: first order


class Sensed(NamedTuple):
    time_s: float
    speed_mps: float | None             # the one control uses; None: both silent too long
    acceleration_mps2: float
    speed_source: str                   # both, gnss, wheel, held, none
    track_m: float                      # distance the outlet has travelled
    east_m: float | None                # outlet
    north_m: float | None
    heading_deg: float | None
    turn_deg_s: float
    position_ok: bool
    gnss_age_s: float | None
    gnss_period_s: float
    wheel_standstill: bool


@dataclass(frozen=True)
class SensingLimits:
    gnss_silent_s: float = 0.5          # at least
    gnss_silent_periods: float = 2.5


class Sensing:
    """One per run; `update` once a tick."""

    def __init__(self, antenna_m: float, plane: TangentPlane | None, limits: SensingLimits | None = None) -> None:
        self.plane = plane
        self._antenna_m = antenna_m
        self._limits = limits or SensingLimits()
        self._time_s: float | None = None
        self._speed = 0.0
        self._acceleration = 0.0
        self._filtered_s: float | None = None       # time of the sample last taken in
        self._ratio = 1.0
        self._track_m = 0.0
        self._fix_s: float | None = None
        self._period_s = 0.2
        self._heading: float | None = None
        self._course: float | None = None
        self._turn = 0.0
        self._east: float | None = None             # antenna
        self._north: float | None = None
        self._heard_s: float | None = None
        self._wheel_s: float | None = None

    def update(self, m: Measurements) -> Sensed:
        now = m.time_s
        dt = 0.0 if self._time_s is None else max(0.0, now - self._time_s)
        self._time_s = now
        fix_new = m.gnss is not None and m.gnss.time_s != self._fix_s
        if fix_new and m.gnss is not None and self._fix_s is not None:
            gap = m.gnss.time_s - self._fix_s
            if 0.0 < gap < 2.0:
                self._period_s += 0.1 * (gap - self._period_s)
        gnss_age = None if m.gnss is None else now - m.gnss.time_s
        silent_s = max(self._limits.gnss_silent_s, self._limits.gnss_silent_periods * self._period_s)
        gnss_ok = gnss_age is not None and gnss_age <= silent_s
        gnss_speed = m.gnss.speed_mps if m.gnss is not None and gnss_ok else None
        wheel = m.wheel_speed_mps
        wheel_ok = wheel is not None and now - wheel.time_s <= 0.5
        standstill = wheel is not None and (wheel.value <= 0.0 or now - wheel.time_s > STANDSTILL_S)
        wheel_faulty = standstill and gnss_speed is not None and gnss_speed > 0.5
        source = self._take_speed(m, now, dt, gnss_speed, wheel_ok and not wheel_faulty, fix_new)
        speed = self._speed if source != "none" else None
        if speed is not None:
            self._track_m += speed * dt
        self._take_place(m, now, dt, fix_new, gnss_ok)
        if fix_new and m.gnss is not None:
            self._fix_s = m.gnss.time_s
        position_ok = (self._east is not None and self._heading is not None and gnss_age is not None
                       and gnss_age <= max(silent_s, DEAD_RECKONING_S) and (m.gnss is None or m.gnss.fix_quality > 0))
        east, north = self._outlet()
        return Sensed(now, speed, self._acceleration, source, self._track_m, east, north, self._heading, self._turn,
                      position_ok, gnss_age, self._period_s, standstill)

    def _take_speed(self, m: Measurements, now: float, dt: float, gnss_mps: float | None, wheel_ok: bool,
                    fix_new: bool) -> str:
        sample: float | None = None
        source = "none"
        wheel = m.wheel_speed_mps
        if wheel_ok and wheel is not None:
            if gnss_mps is not None and fix_new and wheel.value > 0.5 and gnss_mps > 0.5:
                share = 1.0 - exp(-self._period_s / RATIO_TAU_S)
                self._ratio += share * (min(1.3, max(0.7, gnss_mps / wheel.value)) - self._ratio)
            if wheel.time_s != self._wheel_s:
                sample = wheel.value * self._ratio
                self._wheel_s = wheel.time_s
            source = "both" if gnss_mps is not None else "wheel"
        elif gnss_mps is not None:
            sample = gnss_mps if fix_new else None
            source = "gnss"
        if source == "none":
            if self._heard_s is not None and now - self._heard_s <= HELD_SPEED_S:
                return "held"
            self._acceleration = 0.0
            return "none"
        self._heard_s = now
        self._speed = max(0.0, self._speed + self._acceleration * dt)
        if sample is not None:
            self._filter(sample, now)
        return source

    def _filter(self, sample: float, now: float) -> None:
        gap = 0.0 if self._filtered_s is None else now - self._filtered_s
        self._filtered_s = now
        if not 0.0 < gap < 1.0:
            self._speed, self._acceleration = sample, 0.0
            return
        keep = exp(-gap / FILTER_TAU_S)
        error = sample - self._speed
        self._speed = max(0.0, self._speed + (1.0 - keep * keep) * error)
        self._acceleration += (1.0 - keep) * (1.0 - keep) / gap * error
        if sample == 0.0 and self._speed < 0.05:
            self._speed, self._acceleration = 0.0, 0.0

    def _take_place(self, m: Measurements, now: float, dt: float, fix_new: bool, gnss_ok: bool) -> None:
        fix = m.gnss
        if fix_new and fix is not None:
            if self.plane is None:
                self.plane = TangentPlane(fix.lat_deg, fix.lon_deg)
            self._east, self._north = self.plane.to_m(fix.lat_deg, fix.lon_deg)
            if fix.heading_deg is not None and (fix.speed_mps or 0.0) >= HEADING_FROM_MPS:
                self._take_heading(fix.heading_deg)
        elif self._east is not None and self._north is not None and self._heading is not None:
            self._east += self._speed * dt * sin(radians(self._heading))
            self._north += self._speed * dt * cos(radians(self._heading))

    def _take_heading(self, course: float) -> None:
        if self._heading is None:
            self._heading = course % 360.0
            return
        keep = exp(-self._period_s / HEADING_TAU_S)
        off = (course - self._heading + 180.0) % 360.0 - 180.0
        turned = (1.0 - keep) * off
        if abs(off) > 90.0:
            turned = off
        self._turn = keep * self._turn + (1.0 - keep) * turned / self._period_s
        self._heading = (self._heading + turned) % 360.0

    def _outlet(self) -> tuple[float | None, float | None]:
        if self._east is None or self._north is None or self._heading is None:
            return self._east, self._north
        angle = radians(self._heading)
        return self._east - self._antenna_m * sin(angle), self._north - self._antenna_m * cos(angle)


def travelled_ahead_m(speed_mps: float, acceleration_mps2: float, time_s: float) -> float:
    """Distance covered in `time_s` ahead; the acceleration is believed up to 1 m/s2 and never backs up, m."""
    a = min(1.0, max(-1.0, acceleration_mps2))
    if a < 0.0 and speed_mps + a * time_s < 0.0:
        return speed_mps * speed_mps / (-2.0 * a)
    return speed_mps * time_s + 0.5 * a * time_s * time_s


def speed_ahead_mps(speed_mps: float, acceleration_mps2: float, time_s: float) -> float:
    """Speed expected `time_s` ahead, bounded like `travelled_ahead_m` and to 50-150 % of the present, m/s."""
    a = min(1.0, max(-1.0, acceleration_mps2))
    return min(1.5 * speed_mps, max(0.5 * speed_mps, speed_mps + a * time_s))


