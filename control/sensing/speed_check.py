"""Which of three witnesses of ground speed is wrong: the wheel, GNSS's speed, or the way between
GNSS's places?

Each is integrated to a way and compared with the others over windows of time.

*Wheel and GNSS's speed* differ where the ratio of their ways over 1, 2, 4 or 8 s is outside
`SLIP_RANGE`, the limits within which GNSS corrects the wheel: slip (10 %, bursts to 20 %), slopes
and tyres are within. A GNSS speed arrives up to `SPEED_DELAY_S` late, so GNSS's way is taken over
windows that are later than the wheel's by up to as much, and the two differ only where none of
these fits. `PULSE_NOISE_M` allows for noise and pulses, `LEVER_ARM_M` times the turn for the lever
arm between antenna and wheel. A factor of 2 or 0.5 is detected within 2 s.

*GNSS's speed and its places* differ by the statistic of `place_drift`: chi-square, two degrees of
freedom, over 1 to 60 s. With RTK 20 % are detected after some 25 s; plain GNSS shows a factor of
two but not 20 %.

*The third witness* decides which of two is wrong. Between wheel and GNSS's speed the places
decide: each of the two predicts a place, and the nearer one is right where the odds are a
hundred to one (`DECISION_CHI_SQUARE`, in units of the places' variance) and it fits. With RTK that
takes 1 to 4 s, with plain GNSS 10 to 20 s. Between GNSS's speed and its places the wheel decides,
with its correction from before they differed. Nothing decides where places are missing or drift,
where all three differ, or where the wheel rolls less than GNSS's speed and places and GNSS has
changed more than the wheel: speed and places come from one receiver, and a receiver in error
looks like that.

A refused witness is trusted again once it has agreed, moving, for `AGREEMENT_S` without a break."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from math import atan2, cos, hypot, isfinite, pi, radians, sin

from topdress.control.geodesy import Place
from topdress.control.readings import RefusedSpeed, SpeedDoubt
from topdress.control.sensing.place_drift import (
    MAX_EPOCH_GAP_S,
    SPEED_DELAY_S,
    SPEED_SD_SHARE,
    PlaceDriftWatch,
    ReckonedMark,
    ReckonedWay,
    Velocity,
    get_time_s,
)

# Limits of the ratio of GNSS's way to the wheel's.
SLIP_RANGE = (0.7, 1.3)
WINDOWS_S = (1.0, 2.0, 4.0, 8.0)
GNSS_DELAYS_S = (0.0, 0.5 * SPEED_DELAY_S, SPEED_DELAY_S)
# Noise of a way, m: a pulse of the wheel is 0.16 m.
PULSE_NOISE_M = 0.2
# Lever arm between the antenna ahead of the axle and a wheel at the side, m.
LEVER_ARM_M = 2.0
# Slower than this, m/s, receivers report 0 or noise; flow ends at 0.3.
JUDGED_FROM_MPS = 0.4
# Difference of the two chi-squares at odds of a hundred to one: 2 ln 100.
DECISION_CHI_SQUARE = 9.2
# Chi-square with 2 degrees of freedom that one healthy epoch in a million exceeds.
GATE_CHI_SQUARE = 27.6
# Slip of a wheel that was corrected just now, as a share of its way (1 standard deviation).
WHEEL_SLIP_SD_SHARE = 0.1
# Speeds that differ in a window began to differ at most this long before it, s.
PARTING_MARGIN_S = 2.0
NO_SPEEDS = 0.0, 0.0
# Marks are kept for the longest window, its delay and `PARTING_MARGIN_S`, s.
MARKS_KEPT_S = 12.0
# The wheel is corrected over the way between places of this time, s, while GNSS's speed is refused.
RATIO_SPAN_S = 15.0
# A way is straight where its ends are at least this share of its length apart.
MIN_STRAIGHT_WAY_SHARE = 0.95


# Time of agreement until a witness is trusted again, s: that of the longest window that shows the
# fault; while neither is refused, a wheel that has stopped spinning.
AGREEMENT_S = {RefusedSpeed.WHEEL: 8.0, RefusedSpeed.GNSS: 60.0, RefusedSpeed.EITHER: 2.0}


class SpeedCheck:
    """Finds the witness of ground speed that is wrong. `record_tick` is called once a tick,
    `take_epoch` for each new place; an epoch takes constant time."""

    def __init__(self) -> None:
        self.doubt: SpeedDoubt | None = None
        self._watch = PlaceDriftWatch()
        self._wheel = ReckonedWay(0.0, 0.0, 0.0, 0)
        # Mark before the two speeds differed.
        self._before: ReckonedMark | None = None
        # Longest examined window, s; while undecided, the window that showed the difference.
        self._window_s = WINDOWS_S[-1]
        self._agreed_s = 0.0

    def record_tick(
        self,
        wheel_mps: float | None,
        heading_deg: float | None,
        backwards: bool,
        ratio: float,
        dt_s: float,
    ) -> None:
        """Adds a tick of the wheel.

        Parameters
        ----------
        wheel_mps : as the sensor reads; None: silent or standing.
        heading_deg : heading, degrees; None: unknown.
        backwards : whether the machine reverses.
        ratio : present correction factor of the wheel.
        dt_s : time since the last tick, s."""
        was = self._wheel
        if wheel_mps is None or heading_deg is None:
            self._wheel = was._replace(lost=was.lost + 1)
            return
        way_m, angle = wheel_mps * dt_s, radians(heading_deg) + (pi if backwards else 0.0)
        self._wheel = ReckonedWay(
            was.east_m + way_m * sin(angle),
            was.north_m + way_m * cos(angle),
            was.way_m + way_m,
            was.lost,
            ratio,
            wheel_mps,
        )

    def take_epoch(
        self, time_s: float, place: Place, spread_m: float, velocity: Velocity | None
    ) -> bool:
        """Takes a new epoch and returns whether from now on another speed is refused than
        before. spread_m: infinite for a place that is not trusted."""
        last_s, was = self._watch.newest_epoch_s, self.doubt
        now = self._watch.record_epoch(
            time_s, place, spread_m if isfinite(spread_m) else 1e6, velocity, self._wheel
        )
        differing, window_s, read_mps = self._find_difference(now)
        wrong_since = (
            None
            if differing or self._is_refusing(RefusedSpeed.WHEEL)
            else self._find_wrong_speed(now)
        )
        parted = differing or wrong_since
        if self.doubt is not None:
            self._settle_doubt(
                self.doubt, now, parted, min(MAX_EPOCH_GAP_S, time_s - last_s) if window_s else 0.0
            )
        elif parted is not None:
            self.doubt = SpeedDoubt(
                RefusedSpeed.EITHER if differing else RefusedSpeed.GNSS,
                time_s,
                time_s,
                *(read_mps if differing else _calc_mean_speeds_mps(parted, now)),
                parted.reckoned.ratio,
            )
            self._before, self._agreed_s = parted, 0.0
            self._window_s = window_s if differing else WINDOWS_S[-1]
        if wrong_since is not None:
            self._watch.forget_marks()
        if self._is_refusing(RefusedSpeed.EITHER):
            self._decide_by_places(now)
        self._watch.keep_mark(now)
        return (self.doubt and self.doubt.refused) is not (was and was.refused)

    def forget_places(self) -> None:
        """Forgets earlier places, because the machine is at another place."""
        self._watch.forget_marks()
        self._before = None

    def measure_wheel_ratio(self) -> float | None:
        """Returns the ratio of the way between places to the wheel's way on the newest straight
        piece; None where there is none."""
        marks = self._watch.recent_marks
        now = marks[-1] if marks else None
        first = next(
            (mark for mark in reversed(marks) if now and now.time_s - mark.time_s >= RATIO_SPAN_S),
            None,
        )
        if now is None or first is None or first.reckoned.lost != now.reckoned.lost:
            return None
        rolled_m, way_m = (
            hypot(*_calc_wheel_way(first, now)),
            now.reckoned.way_m - first.reckoned.way_m,
        )
        return (
            hypot(*_calc_place_way(first, now)) / rolled_m
            if rolled_m > MIN_STRAIGHT_WAY_SHARE * way_m
            else None
        )

    def _is_refusing(self, refused: RefusedSpeed) -> bool:
        return self.doubt is not None and self.doubt.refused is refused

    def _settle_doubt(
        self, doubt: SpeedDoubt, now: ReckonedMark, parted: ReckonedMark | None, judged_s: float
    ) -> None:
        """Ends the doubt where the two agree again for long enough."""
        if parted is not None:
            self.doubt, self._agreed_s = doubt._replace(differed_s=now.time_s), 0.0
            # The machine stood in the meantime.
            if self._before is None or self._before.reckoned.lost != now.reckoned.lost:
                self._before = parted
            return
        self._agreed_s += judged_s
        if self._agreed_s >= AGREEMENT_S[doubt.refused]:
            self.doubt, self._before, self._window_s = None, None, WINDOWS_S[-1]
            self._watch.forget_marks()

    def _find_difference(
        self, now: ReckonedMark
    ) -> tuple[ReckonedMark | None, float, tuple[float, float]]:
        """Finds the window in which wheel and GNSS's speed differ.

        Returns
        -------
        A mark from before they differed (None where they agree), the window in s (where they
        agree the longest that was judged, 0 where none could be), and the mean speeds of wheel
        and GNSS, m/s."""
        recent = [*self._watch.recent_marks, now]
        del recent[: bisect_left(recent, now.time_s - MARKS_KEPT_S, key=get_time_s)]
        while recent[0].reckoned.lost != now.reckoned.lost or recent[0].gap_m != now.gap_m:
            # Lost ticks and gaps only add up, so later marks belong to this piece.
            del recent[0]
        since_s, end_s, judged_s = recent[0].time_s, now.time_s - SPEED_DELAY_S, 0.0
        if end_s - WINDOWS_S[0] < since_s:
            return None, 0.0, NO_SPEEDS
        end = _interpolate_ways(recent, end_s)
        for window_s in WINDOWS_S:
            begin_s = end_s - window_s
            if begin_s < since_s or window_s > self._window_s:
                break
            begin, least_m = _interpolate_ways(recent, begin_s), JUDGED_FROM_MPS * window_s
            wheel_m, way_m = end[0] - begin[0], end[1] - begin[1]
            if (
                max(wheel_m, way_m) >= least_m
                and SLIP_RANGE[0] * wheel_m - PULSE_NOISE_M
                <= way_m
                <= SLIP_RANGE[1] * wheel_m + PULSE_NOISE_M
            ):
                # Usually the speeds agree without a delay.
                judged_s = window_s
                continue
            ways_m = [
                way_m,
                *(
                    _interpolate_ways(recent, end_s + late)[1]
                    - _interpolate_ways(recent, begin_s + late)[1]
                    for late in GNSS_DELAYS_S[1:]
                ),
            ]
            if max(wheel_m, *ways_m) < least_m:
                continue
            judged_s = window_s
            first = recent[bisect_right(recent, begin_s, key=get_time_s) - 1]
            room_m = PULSE_NOISE_M + LEVER_ARM_M * _calc_turn_rad(first.velocity, now.velocity)
            less, more = max(ways_m) < SLIP_RANGE[0] * wheel_m - room_m, min(ways_m)
            if less or more > SLIP_RANGE[1] * wheel_m + room_m:
                gnss_m = max(ways_m) if less else more
                before = max(
                    0, bisect_right(recent, begin_s - PARTING_MARGIN_S, key=get_time_s) - 1
                )
                return recent[before], window_s, (wheel_m / window_s, gnss_m / window_s)
        return None, judged_s, NO_SPEEDS

    def _find_wrong_speed(self, now: ReckonedMark) -> ReckonedMark | None:
        """Returns a mark since which GNSS's speed contradicts its places while the wheel
        confirms them; None where it does not."""
        walk = self._watch.find_walk(now, GATE_CHI_SQUARE, 0.0)
        if walk is None or walk.since.reckoned.lost != now.reckoned.lost:
            return None
        east, north = _calc_wheel_way(walk.since, now)
        places, speed = (
            _calc_place_way(walk.since, now),
            (now.east_m - walk.since.east_m, now.north_m - walk.since.north_m),
        )
        off_places_m, off_speed_m = (hypot(e - east, n - north) for e, n in (places, speed))
        return walk.since if 2.0 * off_places_m < off_speed_m else None

    def _decide_by_places(self, now: ReckonedMark) -> None:
        """Decides by the places whether the wheel or GNSS's speed is wrong."""
        before, doubt = self._before, self.doubt
        if before is None or doubt is None or before.reckoned.lost != now.reckoned.lost:
            return
        places, wheel = _calc_place_way(before, now), _calc_wheel_way(before, now)
        speed = now.east_m - before.east_m, now.north_m - before.north_m
        changed_mps = hypot(
            now.velocity[0] - before.velocity[0], now.velocity[1] - before.velocity[1]
        )
        variance = before.spread_m**2 + now.spread_m**2 + (SPEED_DELAY_S * changed_mps) ** 2
        by_wheel, by_speed = (
            (way[0] - places[0]) ** 2 + (way[1] - places[1]) ** 2 for way in (wheel, speed)
        )
        if abs(by_wheel - by_speed) < DECISION_CHI_SQUARE * variance:
            return
        if by_wheel < by_speed:
            fits = by_wheel <= GATE_CHI_SQUARE * (
                variance + (WHEEL_SLIP_SD_SHARE * hypot(*wheel)) ** 2
            )
            refused = RefusedSpeed.GNSS
        else:
            fits = by_speed <= GATE_CHI_SQUARE * (variance + (SPEED_SD_SHARE * hypot(*speed)) ** 2)
            refused = RefusedSpeed.WHEEL
            if hypot(*wheel) < hypot(*speed) and changed_mps > abs(
                now.reckoned.wheel_mps - before.reckoned.wheel_mps
            ):
                # One receiver contradicts one wheel, so nothing decides.
                return
        if fits:
            self.doubt, self._window_s = doubt._replace(refused=refused), WINDOWS_S[-1]
            self._watch.forget_marks()


def _calc_mean_speeds_mps(before: ReckonedMark, now: ReckonedMark) -> tuple[float, float]:
    """Returns the mean speeds of wheel and GNSS between two marks, m/s."""
    since_s = max(1e-3, now.time_s - before.time_s)
    rolled_m = now.reckoned.way_m - before.reckoned.way_m
    return rolled_m / since_s, (now.way_m - before.way_m) / since_s


def _calc_place_way(before: ReckonedMark, now: ReckonedMark) -> tuple[float, float]:
    return now.place[0] - before.place[0], now.place[1] - before.place[1]


def _calc_wheel_way(before: ReckonedMark, now: ReckonedMark) -> tuple[float, float]:
    """Returns the wheel's way east and north, m, with the correction of the first mark."""
    ratio = before.reckoned.ratio
    return (
        ratio * (now.reckoned.east_m - before.reckoned.east_m),
        ratio * (now.reckoned.north_m - before.reckoned.north_m),
    )


def _calc_turn_rad(before: Velocity, now: Velocity) -> float:
    """Returns the angle between two courses, 0 to pi radians."""
    angle = atan2(now[0], now[1]) - atan2(before[0], before[1])
    return abs((angle + pi) % (2.0 * pi) - pi)


def _interpolate_ways(marks: list[ReckonedMark], time_s: float) -> tuple[float, float]:
    """Returns the ways of wheel and GNSS's speed until a time, interpolated between two marks;
    beyond the last mark its own."""
    k = bisect_right(marks, time_s, key=get_time_s)
    if k >= len(marks):
        return marks[-1].reckoned.way_m, marks[-1].way_m
    one, other = marks[k - 1], marks[k]
    share = (time_s - one.time_s) / (other.time_s - one.time_s)
    rolled_m, way_m = one.reckoned.way_m, one.way_m
    return rolled_m + share * (other.reckoned.way_m - rolled_m), way_m + share * (
        other.way_m - way_m
    )
