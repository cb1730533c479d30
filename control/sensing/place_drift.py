"""Does GNSS's place follow its own speed and course? The innovations are summed over seconds and
over a minute.

A place that drifts by half a metre a second passes every gate on single epochs, because each
agrees with the one before. Their sum does not: over a window the place must have moved as far as
speed and course add up to. The square of the residual over its variance has a chi-square
distribution with two degrees of freedom for a healthy receiver (`position_gate`).

The variance has these terms, all as 1 standard deviation: the error of the two places; the
relative error of a receiver's speed (`SPEED_SD_SHARE` of the way) and the step in which it is
reported (`SPEED_STEP_SD_MPS`); the delay of speed behind place (`SPEED_DELAY_S` of the change of
velocity: nothing on a straight pass); creeping that is reported as standing (`CREEP_MPS`); a
quarter of the reckoned way where epochs have no speed, all of it where epochs are missing. The
wheel is not used here, so that a wheel that slips, spins or is calibrated wrongly accuses nobody.

So a steady drift is detected from 5.25 (the gate's root) times the terms that grow with time:
0.2 m/s at 1.25 m/s, over a minute. A slower drift is not detected, nor a receiver whose speed
and course drift with its place: `speed_check` finds that, and a wrong speed, with the wheel."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from math import hypot, inf
from operator import attrgetter
from typing import NamedTuple

from topdress.control.geodesy import Place

WINDOWS_S = (1.0, 2.0, 4.0, 8.0, 15.0, 30.0, 60.0)
# Marks are kept at this interval, s.
MARK_INTERVAL_S = 0.5
# Marks are kept for this long, s.
MARKS_KEPT_S = WINDOWS_S[-1] + 1.0
# Relative error of a receiver's speed (1 standard deviation).
SPEED_SD_SHARE = 0.01
# Error of a reported speed, m/s (1 standard deviation): a step of a tenth of a knot, 0.05 m/s, has
# 0.015, and a bias as much again.
SPEED_STEP_SD_MPS = 0.03
# GNSS speeds arrive 0.1 to 1 s late.
SPEED_DELAY_S = 1.0
# Speed that may be reported as standing, m/s: receivers cut speeds below some 0.1 to 0.2 m/s to 0.
CREEP_MPS = 0.05
STANDSTILL_MPS = 0.2
# Between epochs farther apart than this, s, the course is unknown.
MAX_EPOCH_GAP_S = 2.0
# Error of the reckoned way where epochs have no speed, as `position_gate.WAY_SD_SHARE`.
UNKNOWN_WAY_SHARE = 0.25

# Key of binary searches in a list of marks.
get_time_s = attrgetter("time_s")
# Velocity east and north, m/s.
Velocity = tuple[float, float]


class ReckonedWay(NamedTuple):
    """Holds the way by wheel and heading since the beginning. `lost` counts ticks whose heading
    or speed was unknown. `ratio` and `wheel_mps` are the correction factor of the wheel and its
    uncorrected reading (`speed_check`)."""

    east_m: float
    north_m: float
    way_m: float
    lost: int
    ratio: float = 1.0
    wheel_mps: float = 0.0


class ReckonedMark(NamedTuple):
    """Holds a place reported by GNSS, and the sums until then."""

    time_s: float
    place: Place
    spread_m: float
    # Distance by the receiver's own speed and course, m.
    east_m: float
    north_m: float
    way_m: float
    creep_m: float
    gap_m: float
    velocity: Velocity
    reckoned: ReckonedWay


class PlaceDrift(NamedTuple):
    """Holds a place that has drifted off: how far, over how many seconds, and where it would be
    without the drift."""

    off_m: float
    over_s: float
    since: ReckonedMark
    place: Place


class PlaceDriftWatch:
    """Detects a drift of places, in constant time for each epoch. `record_epoch` is called
    for every epoch, then `find_walk` with its mark, then `keep_mark` where the place is
    accepted."""

    def __init__(self) -> None:
        self._marks: deque[ReckonedMark] = deque()
        # Place and reckoned way at the newest GNSS epoch, also if its place was refused.
        self._last: ReckonedMark | None = None

    @property
    def recent_marks(self) -> Sequence[ReckonedMark]:
        """Returns the marks of the last minute, oldest first."""
        return self._marks

    @property
    def newest_epoch_s(self) -> float:
        """Returns the time of the newest epoch, s; minus infinity before the first."""
        return -inf if self._last is None else self._last.time_s

    @property
    def places_agree_since_s(self) -> float:
        """Returns the time since when places agree, s; infinity before the first."""
        return self._marks[0].time_s if self._marks else inf

    def record_epoch(
        self,
        time_s: float,
        place: Place,
        spread_m: float,
        velocity: Velocity | None,
        reckoned: ReckonedWay,
    ) -> ReckonedMark:
        """Returns the mark of a new epoch. velocity: as the receiver reports it; None: it
        reports none."""
        before = self._last
        if before is None:
            now = ReckonedMark(
                time_s, place, spread_m, 0.0, 0.0, 0.0, 0.0, 0.0, velocity or (0.0, 0.0), reckoned
            )
        else:
            now = _advance_mark(before, time_s, place, spread_m, velocity, reckoned)
        self._last = now
        return now

    def find_walk(self, now: ReckonedMark, gate: float, timing_m: float) -> PlaceDrift | None:
        """Returns the drift over the longest window that shows one; None where none does."""
        found, over_s, marks, now_s = None, 0.0, self._marks, now.time_s
        for window_s in WINDOWS_S:
            # The mark covers the window before as well.
            if window_s <= over_s:
                continue
            k = bisect_right(marks, now_s - window_s + 1e-6, key=get_time_s)
            # The tolerance covers rounding errors.
            if k and now_s - marks[k - 1].time_s < window_s:
                k -= 1
            if k == 0:
                break
            over_s = now_s - marks[k - 1].time_s
            found = find_walk_between(marks[k - 1], now, gate, timing_m) or found
        return found

    def keep_mark(self, now: ReckonedMark) -> None:
        """Keeps the mark of an accepted place."""
        if not self._marks or now.time_s - self._marks[-1].time_s >= MARK_INTERVAL_S - 1e-6:
            self._marks.append(now)
            while now.time_s - self._marks[0].time_s > MARKS_KEPT_S:
                self._marks.popleft()

    def forget_marks(self, now: ReckonedMark | None = None) -> None:
        """Forgets earlier marks, because they say nothing about later ones."""
        self._marks.clear()
        if now is not None:
            self._marks.append(now)


def find_walk_between(
    before: ReckonedMark, now: ReckonedMark, gate: float, timing_m: float
) -> PlaceDrift | None:
    """Returns the drift between two epochs, compared with the receiver's own speed; None where
    it is within the gate (chi-square)."""
    (east1, north1), (east0, north0) = now.place, before.place
    east, north = east1 - east0, north1 - north0
    over_s, places = now.time_s - before.time_s, before.spread_m**2 + now.spread_m**2 + timing_m**2
    moved_east, moved_north = now.east_m - before.east_m, now.north_m - before.north_m
    off_m = hypot(east - moved_east, north - moved_north)
    # Usually this holds, because the other terms only increase the variance.
    if off_m * off_m <= gate * places:
        return None
    way_m, creep_m, gap_m = (
        now.way_m - before.way_m,
        now.creep_m - before.creep_m,
        now.gap_m - before.gap_m,
    )
    late_m = SPEED_DELAY_S * hypot(
        now.velocity[0] - before.velocity[0], now.velocity[1] - before.velocity[1]
    )
    variance = (
        places
        + (SPEED_SD_SHARE * way_m) ** 2
        + (SPEED_STEP_SD_MPS * over_s) ** 2
        + creep_m**2
        + gap_m**2
        + late_m**2
    )
    if off_m * off_m > gate * variance:
        return PlaceDrift(off_m, over_s, before, (east0 + moved_east, north0 + moved_north))
    return None


def _advance_mark(
    before: ReckonedMark,
    time_s: float,
    place: Place,
    spread_m: float,
    velocity: Velocity | None,
    reckoned: ReckonedWay,
) -> ReckonedMark:
    """Advances the sums to a new epoch."""
    step_s = max(0.0, time_s - before.time_s)
    if velocity is None or step_s > MAX_EPOCH_GAP_S:
        way_m = reckoned.way_m - before.reckoned.way_m
        on_course = step_s <= MAX_EPOCH_GAP_S and reckoned.lost == before.reckoned.lost
        share = UNKNOWN_WAY_SHARE if on_course else 1.0
        return ReckonedMark(
            time_s,
            place,
            spread_m,
            before.east_m + reckoned.east_m - before.reckoned.east_m,
            before.north_m + reckoned.north_m - before.reckoned.north_m,
            before.way_m + way_m,
            before.creep_m + CREEP_MPS * step_s,
            before.gap_m + share * way_m,
            before.velocity if velocity is None else velocity,
            reckoned,
        )
    (east0, north0), (east1, north1) = before.velocity, velocity
    speed_mps = 0.5 * (hypot(east0, north0) + hypot(east1, north1))
    return ReckonedMark(
        time_s,
        place,
        spread_m,
        before.east_m + 0.5 * (east0 + east1) * step_s,
        before.north_m + 0.5 * (north0 + north1) * step_s,
        before.way_m + speed_mps * step_s,
        before.creep_m + (CREEP_MPS * step_s if speed_mps < STANDSTILL_MPS else 0.0),
        before.gap_m,
        velocity,
        reckoned,
    )
