"""How fast will the machine go over the next seconds? Its own speed is extrapolated, with the
speeds that the tractor announces.

Without announcements a change of speed can only be detected after it began. Two filters detect
it: a quick one that follows an acceleration without delay, and a steady one that is quieter.
While they agree within noise the steady one is used, else the quick one.

With announcements the announced speeds are followed with the announced acceleration (the
reference). The machine's deviation from the reference (throttle, slope, slip) is extrapolated as
it would be without announcements. The weight of the reference is learnt: where the two forecasts
differ, both are kept until their time has come, and the more accurate one gains weight."""

from __future__ import annotations

from collections import deque
from math import exp
from typing import NamedTuple

from topdress.control.readings import AnnouncedSpeeds, is_reading_fresh

# Time constant of the filter `speed_used`, s. Its step response is half-way after 0.2 s; a steady
# acceleration passes without delay.
FILTER_TAU_S = 0.25
# Time constant of the filter `quick` of the same samples, s: half-way after 0.07 s. Only forecasts
# use it.
QUICK_TAU_S = 0.09
# After a longer gap between samples, s, the filter begins anew.
MAX_SAMPLE_GAP_S = 1.0
# With a sample of 0 and a filtered speed below this, m/s, the machine stands.
STANDSTILL_MPS = 0.05


class SpeedFilter(NamedTuple):
    """Holds the state of the filters `speed_used` and `quick`: second order, critically damped."""

    speed_mps: float = 0.0
    acceleration_mps2: float = 0.0

    def extrapolate(self, dt_s: float) -> SpeedFilter:
        """Returns the state a time later, without a sample."""
        return SpeedFilter(
            max(0.0, self.speed_mps + self.acceleration_mps2 * dt_s), self.acceleration_mps2
        )

    def take_sample(
        self, sample_mps: float, gap_s: float, tau_s: float = FILTER_TAU_S
    ) -> SpeedFilter:
        """Returns the state after a sample, `gap_s` after the one before."""
        if not 0.0 < gap_s < MAX_SAMPLE_GAP_S:
            return SpeedFilter(sample_mps, 0.0)
        keep = exp(-gap_s / tau_s)
        error = sample_mps - self.speed_mps
        speed = max(0.0, self.speed_mps + (1.0 - keep * keep) * error)
        if sample_mps == 0.0 and speed < STANDSTILL_MPS:
            return SpeedFilter()
        return SpeedFilter(
            speed, self.acceleration_mps2 + (1.0 - keep) * (1.0 - keep) / gap_s * error
        )


# Time constant with which an acceleration is expected to decay, s: drivers change from one speed to
# another, and a forecast that keeps the acceleration for the whole lag overshoots.
ACCELERATION_TAU_S = 0.8
# A machine that is slower than this, m/s, and slowing down is going to stop: nobody works so
# slowly.
STOPS_BELOW_MPS = 0.75
# The certainty of a stop grows from 0 to 1 over this span below the speed above, m/s.
STOPS_WITHIN_MPS = 0.15
# Time constant of the first-order filter `steady` behind `quick`, s.
STEADY_TAU_S = 0.35
# Half-width of the quiet band in medians of the difference of the two filters: 2.1 standard
# deviations of Gaussian noise. A smaller difference is noise, twice as much a change of speed.
BAND_OVER_MEDIAN = 3.2
# Initial half-width of the quiet band, m/s: the shipped wheel's noise is 0.02 m/s a sample.
INITIAL_BAND_MPS = 0.03
# Least half-width, m/s: what the gate's dead band leaves out, 1.2 % of 1.5 m/s
# (`setting.PLAN_BAND_MM_SHARE`).
MIN_BAND_MPS = 0.02
# Greatest half-width, m/s: an acceleration of 0.5 m/s2 parts the filters by 0.5 x 0.35 = 0.175 m/s
# and must be detected.
MAX_BAND_MPS = 0.12
# Time in which the running median of the filter `quiet band` moves by a factor e, s.
BAND_TAU_S = 20.0
# Below this speed, m/s, no noise is learnt: it is slower than work.
BAND_LEARNT_FROM_MPS = 0.3


# An announced speed is valid for this long, s.
ANNOUNCEMENT_VALID_S = 2.0
# Length and step of the reference ahead, s.
REFERENCE_SPAN_S, REFERENCE_STEP_S = 6.0, 0.1
# Forecasts are judged this long after they were made, s: a typical lag.
JUDGED_AHEAD_S = 1.3
# Forecasts closer to each other than this, m/s, do not show which is the better one.
MIN_DIFFERENCE_MPS = 0.05
# Factor on the learnt errors at each judged forecast; ten a second are judged where they differ.
MEMORY_FACTOR = 0.99
JUDGED_INTERVAL_S = 0.1
# Initial squared error of both forecasts, (m/s)^2: the weight begins at one half.
INITIAL_SQUARED_ERROR = 0.1**2


class SpeedForecast(NamedTuple):
    """Holds the forecast of one tick: a speed and an acceleration that decays; with
    announcements also the reference in steps of `REFERENCE_STEP_S`, the deviation from it, and its
    weight."""

    now_mps: float
    acceleration_mps2: float
    # Reference speeds ahead, m/s.
    announced_mps: tuple[float, ...] = ()
    # Distance of the reference from now on, m.
    announced_way_m: tuple[float, ...] = ()
    # Present speed minus the reference, m/s.
    faster_mps: float = 0.0
    faster_mps2: float = 0.0
    # Weight of the reference, 0 to 1.
    reference_weight: float = 0.0

    def predict_speed_mps(self, in_s: float) -> float:
        """Returns the speed expected so many seconds ahead, m/s; never below 0."""
        own = predict_speed_ahead_mps(self.now_mps, self.acceleration_mps2, in_s)
        if not self.announced_mps:
            return own
        known = (
            _interpolate_table(self.announced_mps, in_s)
            + self.faster_mps
            + _calc_speed_gain_mps(self.faster_mps2, in_s)
        )
        return max(0.0, own + self.reference_weight * (known - own))

    def predict_way_m(self, in_s: float) -> float:
        """Returns the distance expected until then, m."""
        own = predict_way_ahead_m(self.now_mps, self.acceleration_mps2, in_s)
        if not self.announced_mps:
            return own
        known = (
            _interpolate_table(self.announced_way_m, in_s)
            + self.faster_mps * in_s
            + _calc_way_gain_m(self.faster_mps2, in_s)
        )
        return max(0.0, own + self.reference_weight * (known - own))


class _SteadySpeed:
    """Returns a quiet speed: the quick filter's while it differs from the steady one by more
    than noise, else the steady one's.

    The noise is measured as the running median of their difference. A median depends on how
    long a change of speed lasts, not on its size, and a machine changes its speed during less
    than half of the time."""

    def __init__(self, quiet_mps: float = INITIAL_BAND_MPS) -> None:
        self._steady_mps: float | None = None
        self.quiet_mps = quiet_mps

    def update_speed(self, quick: SpeedFilter, dt_s: float) -> SpeedFilter:
        if self._steady_mps is None:
            self._steady_mps = quick.speed_mps
        self._steady_mps += (1.0 - exp(-dt_s / STEADY_TAU_S)) * (quick.speed_mps - self._steady_mps)
        apart_mps = abs(quick.speed_mps - self._steady_mps)
        if quick.speed_mps >= BAND_LEARNT_FROM_MPS:
            way = 1.0 if BAND_OVER_MEDIAN * apart_mps > self.quiet_mps else -1.0
            self.quiet_mps = min(
                MAX_BAND_MPS, max(MIN_BAND_MPS, self.quiet_mps * exp(way * dt_s / BAND_TAU_S))
            )
        share = min(1.0, max(0.0, apart_mps / self.quiet_mps - 1.0))
        return SpeedFilter(
            share * quick.speed_mps + (1.0 - share) * self._steady_mps,
            share * quick.acceleration_mps2,
        )


class SpeedForecaster:
    """Forecasts the speed of a run. `forecast_speed` is called once a tick."""

    def __init__(self) -> None:
        self._own = _SteadySpeed()
        self._forget_reference()
        # Squared errors of the reference and of the own forecast, (m/s)^2.
        self._errors_mps2 = [INITIAL_SQUARED_ERROR, INITIAL_SQUARED_ERROR]

    def _forget_reference(self) -> None:
        self._own, self._faster = (
            _SteadySpeed(self._own.quiet_mps),
            _SteadySpeed(self._own.quiet_mps),
        )
        self._reference_mps: float | None = None
        # Reference after the filter `quick`.
        self._reference = SpeedFilter()
        # Time, the reference's forecast, and the own forecast.
        self._waiting: deque[tuple[float, float, float]] = deque()

    @property
    def reference_weight(self) -> float:
        """Returns the weight of the announced reference, 0 to 1."""
        return self._errors_mps2[1] / sum(self._errors_mps2)

    def forecast_speed(
        self,
        now_s: float,
        speed_mps: float | None,
        acceleration_mps2: float,
        dt_s: float,
        announced: AnnouncedSpeeds | None = None,
    ) -> SpeedForecast:
        """Returns the forecast of this tick.

        Parameters
        ----------
        now_s : present time, s.
        speed_mps, acceleration_mps2 : of the filter `quick`; None: unknown, which counts as
            standing.
        dt_s : time since the last tick, s.
        announced : the tractor's newest announcement."""
        if speed_mps is None:
            self._forget_reference()
            return SpeedForecast(0.0, 0.0)
        own = self._own.update_speed(SpeedFilter(speed_mps, acceleration_mps2), dt_s)
        if announced is None or not is_reading_fresh(announced.time_s, now_s, ANNOUNCEMENT_VALID_S):
            self._reference_mps = None
            self._waiting.clear()
            return SpeedForecast(*own)
        self._judge_forecasts(now_s, speed_mps)
        self._drive_reference(announced, now_s, speed_mps, dt_s)
        faster = self._faster.update_speed(
            SpeedFilter(
                speed_mps - self._reference.speed_mps,
                acceleration_mps2 - self._reference.acceleration_mps2,
            ),
            dt_s,
        )
        table, way = _drive_ahead(announced, now_s - announced.time_s, self._reference_mps or 0.0)
        ahead = SpeedForecast(*own, table, way, *faster, self.reference_weight)
        if speed_mps >= STANDSTILL_MPS and (
            not self._waiting or now_s + JUDGED_AHEAD_S - self._waiting[-1][0] >= JUDGED_INTERVAL_S
        ):
            self._waiting.append(
                (
                    now_s + JUDGED_AHEAD_S,
                    ahead._replace(reference_weight=1.0).predict_speed_mps(JUDGED_AHEAD_S),
                    ahead._replace(reference_weight=0.0).predict_speed_mps(JUDGED_AHEAD_S),
                )
            )
        return ahead

    def _drive_reference(
        self, announced: AnnouncedSpeeds, now_s: float, speed_mps: float, dt_s: float
    ) -> None:
        """Advances the reference by one tick. It begins at the machine's speed, and anew where
        the machine stands: nobody knows when it will set off."""
        if self._reference_mps is None or speed_mps < STANDSTILL_MPS:
            self._reference_mps, self._reference = speed_mps, SpeedFilter(speed_mps, 0.0)
            self._faster = _SteadySpeed(self._own.quiet_mps)
        aim = _find_aimed_mps(announced, max(0.0, now_s - announced.time_s))
        self._reference_mps = _step_towards(
            self._reference_mps, aim, announced.acceleration_mps2 * dt_s
        )
        if dt_s > 0.0:
            self._reference = self._reference.extrapolate(dt_s).take_sample(
                self._reference_mps, dt_s, QUICK_TAU_S
            )

    def _judge_forecasts(self, now_s: float, speed_mps: float) -> None:
        while self._waiting and self._waiting[0][0] <= now_s:
            _, known, own = self._waiting.popleft()
            if abs(known - own) > MIN_DIFFERENCE_MPS:
                both = ((known - speed_mps) ** 2, (own - speed_mps) ** 2)
                self._errors_mps2 = [
                    MEMORY_FACTOR * kept + new
                    for kept, new in zip(self._errors_mps2, both, strict=True)
                ]


def _find_aimed_mps(announced: AnnouncedSpeeds, in_s: float) -> float:
    """Returns the announced target speed so many seconds after its announcement, m/s, without
    sign as `speed_used`."""
    return next(
        abs(mps)
        for since, mps in reversed(announced.points)
        if since <= in_s + 1e-9 or since == 0.0
    )


def _step_towards(mps: float, aimed: float, most: float) -> float:
    return mps + min(most, max(-most, aimed - mps))


def _drive_ahead(
    announced: AnnouncedSpeeds, since_s: float, reference_mps: float
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Returns the reference ahead, m/s, and its way, m, in steps of `REFERENCE_STEP_S`."""
    mps, way, table, ways = reference_mps, 0.0, [reference_mps], [0.0]
    most = announced.acceleration_mps2 * REFERENCE_STEP_S
    for k in range(round(REFERENCE_SPAN_S / REFERENCE_STEP_S)):
        following = _step_towards(
            mps, _find_aimed_mps(announced, max(0.0, since_s) + (k + 0.5) * REFERENCE_STEP_S), most
        )
        way += 0.5 * (mps + following) * REFERENCE_STEP_S
        mps = following
        table.append(mps)
        ways.append(way)
    return tuple(table), tuple(ways)


def _interpolate_table(table: tuple[float, ...], in_s: float) -> float:
    """Interpolates between the table's steps; beyond its end the last value holds."""
    place = min(len(table) - 1.0, max(0.0, in_s / REFERENCE_STEP_S))
    k = min(len(table) - 2, int(place))
    return table[k] + (place - k) * (table[k + 1] - table[k])


def _calc_speed_gain_mps(acceleration_mps2: float, in_s: float) -> float:
    """Returns the gain of speed from an acceleration that decays, m/s."""
    return (
        min(1.0, max(-1.0, acceleration_mps2))
        * ACCELERATION_TAU_S
        * (1.0 - exp(-in_s / ACCELERATION_TAU_S))
    )


def _calc_way_gain_m(acceleration_mps2: float, in_s: float) -> float:
    return (
        min(1.0, max(-1.0, acceleration_mps2))
        * ACCELERATION_TAU_S
        * (in_s - ACCELERATION_TAU_S * (1.0 - exp(-in_s / ACCELERATION_TAU_S)))
    )


def predict_way_ahead_m(speed_mps: float, acceleration_mps2: float, time_s: float) -> float:
    """Returns the distance covered in the next `time_s`, m: the integral of
    `predict_speed_ahead_mps`, at least half of the present speed's way unless the machine stops."""
    more_m = _calc_way_gain_m(acceleration_mps2, time_s)
    usual = speed_mps * time_s + min(
        0.5 * speed_mps * time_s, max(-0.5 * speed_mps * time_s, more_m)
    )
    share = _calc_stop_share(speed_mps, acceleration_mps2)
    if share <= 0.0:
        return usual
    until_s = min(time_s, -speed_mps / acceleration_mps2)
    return usual + share * (speed_mps * until_s + 0.5 * acceleration_mps2 * until_s**2 - usual)


def predict_speed_ahead_mps(speed_mps: float, acceleration_mps2: float, time_s: float) -> float:
    """Returns the speed expected in `time_s`, m/s.

    The acceleration, up to 1 m/s2, decays with `ACCELERATION_TAU_S`; the forecast stays within 50
    to 150 % of the present speed. A machine that is about to stop goes on slowing down."""
    more = _calc_speed_gain_mps(acceleration_mps2, time_s)
    usual = min(1.5 * speed_mps, max(0.5 * speed_mps, speed_mps + more))
    return usual + _calc_stop_share(speed_mps, acceleration_mps2) * (
        max(0.0, speed_mps + acceleration_mps2 * time_s) - usual
    )


def _calc_stop_share(speed_mps: float, acceleration_mps2: float) -> float:
    """Returns the certainty that the machine stops, 0 to 1."""
    return (
        0.0
        if acceleration_mps2 >= 0.0
        else min(1.0, max(0.0, (STOPS_BELOW_MPS - speed_mps) / STOPS_WITHIN_MPS))
    )
