"""Which speed and which place does control use?

The wheel shows changes of speed quickly, GNSS shows their level without slip: the wheel,
corrected by a slowly learnt ratio, drives the filter `speed_used`; either alone serves while the
other is silent."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, exp, hypot, inf, isfinite, radians, sin
from typing import NamedTuple

from topdress.control.geodesy import Place, TangentPlane
from topdress.control.readings import (
    MAX_AHEAD_S,
    GnssFix,
    Measurements,
    Reading,
    RefusedSpeed,
    SpeedDoubt,
    is_reading_fresh,
)
from topdress.control.sensing.gnss_delay import GnssDelay
from topdress.control.sensing.place_drift import Velocity
from topdress.control.sensing.position_gate import (
    MAX_SPEED_MPS,
    JudgedPlace,
    PositionGate,
    find_place_sd_m,
)
from topdress.control.sensing.speed_check import SLIP_RANGE, SpeedCheck
from topdress.control.sensing.speed_forecast import QUICK_TAU_S, SpeedFilter
from topdress.control.signals import VALID_FOR

# Time constant of the first-order filter `ratio`, by which GNSS corrects the wheel, s. Slip comes
# in bursts of some 20 s.
RATIO_TAU_S = 3.0
# A wheel speed is valid for this long, s.
WHEEL_VALID_S = VALID_FOR["wheel_speed_mps"].control_s
# Without a wheel pulse for this long, s, the machine stands.
NO_PULSE_STANDSTILL_S = 0.8
# While both speeds are silent the last speed is held for this long, s.
SPEED_HOLD_S = 2.0
# A place without GNSS is trusted for this long, s. On a straight way it is trusted for as long as
# its standard deviation is below `SensingLimits.reckoned_m`; that comes from the last accepted
# place and the three values below.
DEAD_RECKONING_S = 2.0
# Standard deviation along the way as a share of it: slip of a wheel that was corrected just now
# (`speed_check`).
WHEEL_SLIP_SD_SHARE = 0.1
# Standard deviation across the way as a share of it: 3 degrees, as well as a driver holds a course.
COURSE_SD_SHARE = 0.05
# A way is straight below this rate of turn, degrees/s: the noise of the course alone makes 2.
STRAIGHT_BELOW_DEG_S = 6.0
# Below this speed, m/s, the course over ground is mostly noise.
HEADING_FROM_MPS = 0.3
# The first heading is taken from this speed on, m/s: it is 9 degrees uncertain with 0.03 m/s of
# noise, which is better than none.
FIRST_HEADING_FROM_MPS = 0.2
# Time constant of the first-order filter `heading`, s.
HEADING_TAU_S = 0.5
# Below this speed, m/s, the direction of travel may reverse unseen.
STANDSTILL_BELOW_MPS = 0.3
# From this GNSS speed on, m/s, its course shows the direction of travel.
COURSE_FROM_MPS = 0.2
# A course that differs by more than this across a standstill, degrees, is the opposite direction.
REVERSED_COURSE_DEG = 120.0
# A place that GNSS loses and finds again within this distance, m, is the same place.
PLACE_JUMP_M = 1.0
# A tangent plane that began with a wrong place is recognised by having had no more epochs than
# these.
UNSETTLED_EPOCHS = 2


class SensedMotion(NamedTuple):
    """Holds the speed, place and heading that control uses in one tick."""

    time_s: float
    # Used speed, m/s; None where both sensors are silent for too long.
    speed_mps: float | None
    acceleration_mps2: float
    # Source of the speed: both, gnss, wheel, held, none.
    speed_source: str
    # Distance travelled by the outlet, m; reversing decreases it.
    track_m: float
    # Position of the outlet, m.
    east_m: float | None
    north_m: float | None
    # Heading of the machine, degrees, also while reversing.
    heading_deg: float | None
    turn_deg_s: float
    position_ok: bool
    gnss_age_s: float | None
    gnss_period_s: float
    wheel_standstill: bool
    backwards: bool
    # Distance of the newest refused epoch from a possible position, m.
    refused_m: float | None = None
    # Distance of a newly accepted position from the assumed position in this tick, m.
    moved_m: float | None = None
    # Whether the refused epoch contradicts the receiver's own speed and course.
    walks: bool = False
    # State of the filter `quick`; equal to `speed_used` with GNSS alone.
    quick: SpeedFilter = SpeedFilter()
    # Whether the position is known but not the heading, because the machine has not moved yet.
    course_awaited: bool = False
    # The speed that is not trusted, where wheel and GNSS contradict each other.
    doubt: SpeedDoubt | None = None


@dataclass(frozen=True)
class SensingLimits:
    # Minimum time until GNSS is silent, s.
    gnss_silent_s: float = VALID_FOR["speed_mps"].control_s
    gnss_silent_periods: float = 2.5
    # Maximum standard deviation of a dead-reckoned position, m; 0 means `DEAD_RECKONING_S` alone.
    reckoned_m: float = 0.0


class Sensing:
    """Chooses speed, place and heading of a run. `sense_motion` is called once a tick."""

    def __init__(
        self, antenna_m: float, plane: TangentPlane | None, limits: SensingLimits | None = None
    ) -> None:
        self.plane = plane
        self._antenna_m = antenna_m
        self._limits = limits or SensingLimits()
        self._time_s: float | None = None
        # State of the filter `speed_used`.
        self._moving = SpeedFilter()
        # State of the filter `quick`.
        self._quick = SpeedFilter()
        # Time of the last filtered sample, s.
        self._filtered_s: float | None = None
        # Source of the last speed.
        self._source = "none"
        self._ratio = 1.0
        self._late = GnssDelay()
        self._track_m = 0.0
        self._fix_s: float | None = None
        # Period of the epochs, s, and whether two epochs were received; a plain receiver is not
        # silent until then.
        self._period_s, self._paced = 1.0, False
        self._heading: float | None = None
        self._course: float | None = None
        self._turn = 0.0
        # Position of the antenna, m.
        self._east: float | None = None
        self._north: float | None = None
        self._heard_s: float | None = None
        self._wheel_s: float | None = None
        # Time of the wheel's last report, s.
        self._turned_s: float | None = None
        self._direction = _TravelDirection()
        self._gate = PositionGate()
        self._check = SpeedCheck()
        # Time of the last accepted position, s.
        self._placed_s: float | None = None
        # Standard deviation of that position, m.
        self._spread_m = inf
        # Dead-reckoned distance since then, m; infinite where speed or course was unknown.
        self._way_m = 0.0
        self._refused_m: float | None = None
        self._walks = False
        # Number of epochs on a plane that the first of them defined.
        self._own_epochs: int | None = None

    def sense_motion(self, m: Measurements) -> SensedMotion:
        """Returns speed, place and heading of this tick."""
        m = _drop_impossible(m)
        now = m.time_s
        dt = 0.0 if self._time_s is None else max(0.0, now - self._time_s)
        self._time_s = now
        fix_new = (
            m.gnss is not None
            and m.gnss.time_s != self._fix_s
            and m.gnss.time_s <= now + MAX_AHEAD_S
        )
        if fix_new and m.gnss is not None and self._fix_s is not None:
            gap = m.gnss.time_s - self._fix_s
            if 0.0 < gap < 2.0:
                self._period_s += (0.1 if self._paced else 1.0) * (gap - self._period_s)
                self._paced = True
        gnss_age = None if m.gnss is None else now - m.gnss.time_s
        silent_s = max(
            self._limits.gnss_silent_s, self._limits.gnss_silent_periods * self._period_s
        )
        gnss_ok = m.gnss is not None and is_reading_fresh(m.gnss.time_s, now, silent_s)
        gnss_speed = m.gnss.speed_mps if m.gnss is not None and gnss_ok else None
        wheel = m.wheel_speed_mps
        wheel_ok = wheel is not None and is_reading_fresh(wheel.time_s, now, WHEEL_VALID_S)
        standstill = self._is_wheel_standing(wheel, now)
        self._check.record_tick(
            wheel.value if wheel is not None and wheel_ok and not standstill else None,
            self._heading,
            self._direction.backwards,
            self._ratio,
            dt,
        )
        if not self._is_gnss_speed_usable(gnss_speed, wheel if wheel_ok else None):
            gnss_speed = None
        wheel_faulty = standstill and gnss_speed is not None and gnss_speed > 0.5
        wheel_ok = wheel_ok and not wheel_faulty and self._is_wheel_usable(gnss_speed)
        source = self._update_speed(m, now, dt, gnss_speed, wheel_ok, fix_new)
        speed = self._moving.speed_mps if source != "none" else None
        self._track_m += self._direction.find_signed_way_m(
            (speed or 0.0) * dt,
            standstill or (speed or 0.0) < STANDSTILL_BELOW_MPS,
            m.gnss if fix_new else None,
        )
        moved_m = self._update_place(m, speed, dt, fix_new)
        if fix_new and m.gnss is not None:
            self._fix_s = m.gnss.time_s
        heard = (
            self._placed_s is not None
            and is_reading_fresh(self._placed_s, now, max(silent_s, DEAD_RECKONING_S))
            and (m.gnss is None or m.gnss.fix_quality > 0)
        )
        placed = self._east is not None and (heard or self._can_reckon(source))
        position_ok = placed and self._heading is not None
        east, north = self._locate_outlet()
        return SensedMotion(
            now,
            speed,
            self._moving.acceleration_mps2,
            source,
            self._track_m,
            east,
            north,
            self._heading,
            self._turn,
            position_ok,
            gnss_age,
            self._period_s,
            standstill,
            self._direction.backwards,
            self._refused_m,
            moved_m,
            self._walks,
            self._quick,
            placed and not position_ok,
            self._check.doubt,
        )

    def _can_reckon(self, source: str) -> bool:
        """Returns whether the place is good enough without GNSS: it is silent or has no fix, and
        the wheel is trusted."""
        off_m = hypot(self._spread_m, hypot(WHEEL_SLIP_SD_SHARE, COURSE_SD_SHARE) * self._way_m)
        return (
            off_m <= self._limits.reckoned_m
            and abs(self._turn) <= STRAIGHT_BELOW_DEG_S
            and self._refused_m is None
            and source in ("wheel", "both")
            and self._check.doubt is None
        )

    def _is_wheel_standing(self, wheel: Reading | None, now: float) -> bool:
        """Returns whether the wheel reads 0 or has been silent for long. A wheel that was heard
        once is fitted: it stands also when its readings are impossible."""
        if wheel is not None and wheel.time_s <= now + MAX_AHEAD_S:
            self._turned_s = (
                wheel.time_s if self._turned_s is None else max(self._turned_s, wheel.time_s)
            )
            if wheel.value <= 0.0:
                return True
        return self._turned_s is not None and now - self._turned_s > NO_PULSE_STANDSTILL_S

    def _is_gnss_speed_usable(self, gnss_mps: float | None, wheel: Reading | None) -> bool:
        """Returns whether GNSS's speed is used. While it is unknown which of the two is wrong,
        the slower one is used: too little product can be made up for."""
        doubt = self._check.doubt
        if doubt is None or doubt.refused is RefusedSpeed.WHEEL or gnss_mps is None:
            return True
        return doubt.refused is RefusedSpeed.EITHER and (
            wheel is None or gnss_mps < wheel.value * self._ratio
        )

    def _is_wheel_usable(self, gnss_mps: float | None) -> bool:
        """Returns whether the wheel's speed is used. gnss_mps: GNSS's speed where that is used."""
        doubt = self._check.doubt
        return doubt is None or (doubt.refused is not RefusedSpeed.WHEEL and gnss_mps is None)

    def _update_speed(
        self,
        m: Measurements,
        now: float,
        dt: float,
        gnss_mps: float | None,
        wheel_ok: bool,
        fix_new: bool,
    ) -> str:
        sample: float | None = None
        source = "none"
        wheel = m.wheel_speed_mps
        if wheel_ok and wheel is not None:
            self._late.record_wheel(now, wheel.value, dt)
            then = (
                self._late.take_epoch(now, gnss_mps, self._ratio)
                if gnss_mps is not None and fix_new
                else None
            )
            if (
                then is not None
                and gnss_mps is not None
                and then.speed_mps > 0.5
                and gnss_mps > 0.5
            ):
                share = then.weight * (1.0 - exp(-self._period_s / RATIO_TAU_S))
                self._ratio += share * (_limit_ratio(gnss_mps / then.speed_mps) - self._ratio)
            if wheel.time_s != self._wheel_s:
                sample = wheel.value * self._ratio
                self._wheel_s = wheel.time_s
            source = "both" if gnss_mps is not None else "wheel"
        elif gnss_mps is not None:
            sample = gnss_mps if fix_new else None
            source = "gnss"
        if source == "none":
            if self._heard_s is not None and now - self._heard_s <= SPEED_HOLD_S:
                return "held"
            self._moving = self._quick = self._moving._replace(acceleration_mps2=0.0)
            return "none"
        self._heard_s = now
        # The speed of the refused sensor caused an apparent acceleration.
        if source != self._source and self._check.doubt is not None:
            believed = gnss_mps if wheel is None or source == "gnss" else wheel.value * self._ratio
            self._moving, self._filtered_s = SpeedFilter(believed or 0.0), now
            self._quick, sample = self._moving, None
        self._source = source
        self._moving, self._quick = self._moving.extrapolate(dt), self._quick.extrapolate(dt)
        if sample is not None:
            gap = 0.0 if self._filtered_s is None else now - self._filtered_s
            self._moving, self._filtered_s = self._moving.take_sample(sample, gap), now
            self._quick = (
                self._quick.take_sample(sample, gap, QUICK_TAU_S)
                if source != "gnss"
                else self._moving
            )
        return source

    def _update_place(
        self, m: Measurements, speed: float | None, dt: float, fix_new: bool
    ) -> float | None:
        """Updates the place by a new epoch, else by reckoning. Returns how far off the old place
        was, m, where the new one contradicts it and is accepted."""
        fix, backwards = m.gnss, self._direction.backwards
        east_m = north_m = 0.0
        if self._heading is None or speed is None:
            self._gate.add_unknown_way(speed, dt)
            self._way_m = inf
        else:
            way = -speed * dt if backwards else speed * dt
            self._way_m += abs(way)
            east_m, north_m = way * sin(radians(self._heading)), way * cos(radians(self._heading))
            self._gate.add_way(abs(way), east_m, north_m)
        if fix_new and fix is not None:
            before, walked = (self._east, self._north), self._walks
            judged = self._judge_fix(fix, speed)
            self._refused_m = None if judged is None or judged.taken else judged.off_m
            self._walks = judged is not None and judged.walks
            # A course may be right where a position is not.
            if judged is not None and (judged.taken or judged.walks):
                if fix.heading_deg is not None and (fix.speed_mps or 0.0) >= (
                    FIRST_HEADING_FROM_MPS if self._heading is None else HEADING_FROM_MPS
                ):
                    self._update_heading(fix.heading_deg + (180.0 if backwards else 0.0))
                if judged.back is not None:
                    self._east, self._north = judged.back
                if judged.back is not None or (walked and judged.taken):
                    return self._find_jump_m(before)
                if judged.taken:
                    return judged.off_m if judged.anew else None
        if self._east is not None and self._north is not None:
            self._east += east_m
            self._north += north_m
        return None

    def _find_jump_m(self, before: tuple[float | None, float | None]) -> float | None:
        """Returns the distance of the antenna from its assumed place, m; None where it is
        negligible."""
        if self._east is None or self._north is None or before[0] is None or before[1] is None:
            return None
        gone_m = hypot(self._east - before[0], self._north - before[1])
        return gone_m if gone_m >= PLACE_JUMP_M else None

    def _judge_fix(self, fix: GnssFix, speed: float | None) -> JudgedPlace | None:
        """Passes the place of a new epoch through the gate and stores it where it is accepted;
        None where the epoch has no place."""
        if fix.fix_quality <= 0:
            return None
        if not (-90.0 <= fix.lat_deg <= 90.0 and -180.0 <= fix.lon_deg <= 180.0):
            return JudgedPlace(False, float("inf"))
        if self.plane is None:
            self.plane, self._own_epochs = TangentPlane(fix.lat_deg, fix.lon_deg), 0
        place = self.plane.project_to_m(fix.lat_deg, fix.lon_deg)
        believes_speed = self._check_speed(fix, place)
        judged = self._gate.judge_epoch(
            place,
            fix.fix_quality,
            fix.hdop,
            speed,
            fix.time_s,
            _find_velocity(fix) if believes_speed else None,
        )
        if not judged.taken:
            return judged
        if judged.anew:
            self._check.forget_places()
        if judged.anew and self._own_epochs is not None and self._own_epochs <= UNSETTLED_EPOCHS:
            self.plane, self._own_epochs = TangentPlane(fix.lat_deg, fix.lon_deg), 0
            place = (0.0, 0.0)
            self._gate.move_to_plane(place)
        if self._own_epochs is not None:
            self._own_epochs += 1
        self._east, self._north = place
        self._placed_s, self._spread_m, self._way_m = (
            fix.time_s,
            find_place_sd_m(fix.fix_quality, fix.hdop),
            0.0,
        )
        return judged

    def _check_speed(self, fix: GnssFix, place: Place) -> bool:
        """Returns whether the receiver's speed is trusted with this epoch."""
        of_place_m = inf if self._gate.is_walking else find_place_sd_m(fix.fix_quality, fix.hdop)
        changed = self._check.take_epoch(fix.time_s, place, of_place_m, _find_velocity(fix))
        doubt = self._check.doubt
        if changed and doubt is not None:
            self._ratio = doubt.ratio
            if doubt.refused is not RefusedSpeed.WHEEL:
                self._gate.forget_places()
        if doubt is not None and doubt.refused is RefusedSpeed.GNSS:
            ratio = self._check.measure_wheel_ratio()
            self._ratio = self._ratio if ratio is None else _limit_ratio(ratio)
        return doubt is None or doubt.refused is RefusedSpeed.WHEEL

    def _update_heading(self, course: float) -> None:
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

    def _locate_outlet(self) -> tuple[float | None, float | None]:
        if self._east is None or self._north is None or self._heading is None:
            return self._east, self._north
        angle = radians(self._heading)
        return self._east - self._antenna_m * sin(angle), self._north - self._antenna_m * cos(angle)


def _limit_ratio(ratio: float) -> float:
    return min(SLIP_RANGE[1], max(SLIP_RANGE[0], ratio))


def _find_velocity(fix: GnssFix) -> Velocity | None:
    """Returns the receiver's velocity east and north, m/s; at a standstill it may report no
    course."""
    if fix.speed_mps is None or (fix.heading_deg is None and fix.speed_mps >= COURSE_FROM_MPS):
        return None
    angle = radians(fix.heading_deg or 0.0)
    return fix.speed_mps * sin(angle), fix.speed_mps * cos(angle)


def _drop_impossible(m: Measurements) -> Measurements:
    """Returns the measurements without speeds and courses that are not numbers or faster than
    any spreader."""
    wheel, fix = m.wheel_speed_mps, m.gnss
    if wheel is not None and not wheel.value <= MAX_SPEED_MPS:
        m = m._replace(wheel_speed_mps=None)
    if fix is not None and fix.speed_mps is not None and not 0.0 <= fix.speed_mps <= MAX_SPEED_MPS:
        fix = fix._replace(speed_mps=None, heading_deg=None)
    if fix is not None and fix.heading_deg is not None and not isfinite(fix.heading_deg):
        fix = fix._replace(heading_deg=None)
    return m if fix is m.gnss else m._replace(gnss=fix)


class _TravelDirection:
    """Tells forwards from backwards: the wheel cannot, but the GNSS course reverses across a
    standstill when the direction changes.

    The way made between the standstill and the first course after it is put right once the
    direction is known."""

    def __init__(self) -> None:
        self.backwards = False
        self._course_deg: float | None = None
        self._stood = False
        # Distance with an uncertain sign, m, counted as if the direction had not changed.
        self._unsure_m = 0.0

    def find_signed_way_m(self, way_m: float, slow: bool, fix: GnssFix | None) -> float:
        """Returns the signed way of this tick, m. way_m: unsigned; fix: a new one, or None."""
        signed = -way_m if self.backwards else way_m
        self._stood = self._stood or slow
        self._unsure_m = self._unsure_m + signed if self._stood else 0.0
        if fix is None or fix.speed_mps is None or fix.heading_deg is None:
            return signed
        if fix.speed_mps < COURSE_FROM_MPS:
            self._stood = True
            return signed
        if (
            self._stood
            and self._course_deg is not None
            and abs((fix.heading_deg - self._course_deg + 180.0) % 360.0 - 180.0)
            > REVERSED_COURSE_DEG
        ):
            self.backwards = not self.backwards
            signed -= 2.0 * self._unsure_m
        self._course_deg, self._stood, self._unsure_m = fix.heading_deg, slow, 0.0
        return signed
