"""Which GNSS places can be trusted? A gate on the innovation decides.

The innovation is the distance between the place that GNSS reports and the place that dead
reckoning predicts from the last accepted one. Its square over its variance, the normalised
innovation squared, has a chi-square distribution with two degrees of freedom for a healthy
receiver; an epoch beyond `GATE_CHI_SQUARE` is refused (Bar-Shalom, Li and Kirubarajan, Estimation
with Applications to Tracking and Navigation, 2001, section 5.4). Refused epochs that agree with
each other, by the same gate, are accepted as a new place: the receiver was restarted, the machine
was transported, or reckoning was wrong.

`place_drift` finds a place that drifts off although each epoch is near the one before. From then
on no place is accepted until three agree again with the place before the drift and the way
since. Or until places have agreed with speed and course for a minute, or for as long as those
before the drift had (some seconds after a cold start): then they are a new place."""

from __future__ import annotations

from math import hypot, isfinite
from typing import NamedTuple

from topdress.control.geodesy import Place
from topdress.control.sensing.place_drift import (
    WINDOWS_S,
    PlaceDrift,
    PlaceDriftWatch,
    ReckonedMark,
    ReckonedWay,
    Velocity,
    find_walk_between,
)

# Chi-square with 2 degrees of freedom that one healthy epoch in a million exceeds.
GATE_CHI_SQUARE = 27.6
# Standard deviation of a place by GGA fix quality, m. They are wide because the antenna sways and
# errors persist.
PLACE_SD_M = {2: 1.5, 4: 0.5, 5: 1.0}
# Standard deviation at all other qualities, m, times HDOP: 2.5 m CEP in the data sheets of
# receivers is 2.1 m an axis. From plain GNSS to RTK a place may jump 12 m.
DEFAULT_PLACE_SD_M = 2.2
MAX_HDOP = 10.0
# Standard deviation of an epoch's time, s: epochs arrive late by uneven times.
EPOCH_TIMING_SD_S = 0.1
# Standard deviation of the reckoned way as a share of it: speed, slip, and in a turn the filtered
# course.
WAY_SD_SHARE = 0.25
# Age of the last place, s, beyond which the course since is unknown: any place within the way is
# possible.
MAX_RECKONING_S = 2.0
# Upper limit of an unknown speed, m/s: the machine on a lorry.
MAX_SPEED_MPS = 30.0
# A new place needs so many epochs that agree with each other.
AGREEING_EPOCHS = 3
# A new place needs epochs that agree over this time, s.
AGREEING_S = 1.0


class JudgedPlace(NamedTuple):
    """Holds the verdict on an epoch's place. `off_m` is its distance from the nearest possible
    place, m; infinite where the place is not a number."""

    taken: bool
    off_m: float
    # Whether the position was accepted although dead reckoning contradicts it.
    anew: bool = False
    # Whether the position drifts, or has drifted and does not agree again yet.
    walks: bool = False
    # Antenna position by the position before the drift, set in the epoch that detects the drift.
    back: Place | None = None


class _ReckonedPlace(NamedTuple):
    """Holds a place reported by GNSS, and the sums of dead reckoning at that moment."""

    place: Place
    spread_m: float
    time_s: float
    way_m: float
    east_m: float
    north_m: float
    lost: int


class PositionGate:
    """Accepts or refuses the places of a receiver, in constant time for each epoch. `add_way` or
    `add_unknown_way` is called once a tick, then `judge_epoch` for a new epoch."""

    def __init__(self) -> None:
        self._taken: _ReckonedPlace | None = None
        # First of the refused epochs that agree with each other.
        self._other: _ReckonedPlace | None = None
        self._agreeing = 0
        # Dead-reckoned distance since the start, and its two components, m.
        self._way_m = 0.0
        self._east_m = 0.0
        self._north_m = 0.0
        # Number of ticks with an unknown heading.
        self._lost = 0
        self._watch = PlaceDriftWatch()
        # Last trusted position before a drift; None without a drift.
        self._before_walk: ReckonedMark | None = None
        # Number of epochs that agree with that position again.
        self._back = 0
        # Time for which positions must agree with speed and course, s.
        self._again_s = 0.0

    def add_way(self, way_m: float, east_m: float, north_m: float) -> None:
        """Adds the reckoned way of a tick: its length and its two components, m."""
        self._way_m += way_m
        self._east_m += east_m
        self._north_m += north_m

    def add_unknown_way(self, speed_mps: float | None, dt_s: float) -> None:
        """Adds a tick whose heading or speed (None) is unknown."""
        self._lost += 1
        self._way_m += (MAX_SPEED_MPS if speed_mps is None else speed_mps) * dt_s

    def move_to_plane(self, place: Place) -> None:
        """Moves the last accepted place to another tangent plane, where it has these
        coordinates."""
        if self._taken is not None:
            self._taken = self._taken._replace(place=place)
        self._watch.forget_marks()
        self._before_walk = None

    @property
    def is_walking(self) -> bool:
        """Returns whether the places have drifted off and do not agree again yet."""
        return self._before_walk is not None

    def forget_places(self) -> None:
        """Forgets the recent places, because the receiver's speed that they were compared with
        was wrong."""
        self._watch.forget_marks()

    def judge_epoch(
        self,
        place: Place,
        quality: int,
        hdop: float | None,
        speed_mps: float | None,
        time_s: float,
        velocity: Velocity | None = None,
    ) -> JudgedPlace:
        """Accepts or refuses the place of a new epoch.

        Parameters
        ----------
        place : east and north on one plane, m.
        quality : GGA fix quality.
        hdop : horizontal dilution of precision; None: not reported.
        speed_mps : speed of the machine, m/s; None: unknown.
        time_s : of the epoch, s.
        velocity : east and north by the receiver's own speed and course, m/s; None: it reports
            none."""
        if not (isfinite(place[0]) and isfinite(place[1])):
            return JudgedPlace(False, float("inf"))
        mark = self._watch.record_epoch(
            time_s,
            place,
            find_place_sd_m(quality, hdop),
            velocity,
            ReckonedWay(self._east_m, self._north_m, self._way_m, self._lost),
        )
        timing_m = EPOCH_TIMING_SD_S * (speed_mps or 0.0)
        if self._before_walk is not None:
            return self._judge_during_walk(mark, quality, hdop, timing_m)
        judged = self._judge_innovation(place, quality, hdop, timing_m, time_s)
        if judged.anew:
            self._watch.forget_marks(mark)
        elif judged.taken:
            walk = self._watch.find_walk(mark, GATE_CHI_SQUARE, timing_m)
            if walk is not None:
                return self._begin_walk(walk, mark)
            self._watch.keep_mark(mark)
        return judged

    def _begin_walk(self, walk: PlaceDrift, mark: ReckonedMark) -> JudgedPlace:
        self._before_walk, self._back = walk.since, 0
        self._again_s = min(
            WINDOWS_S[-1], max(AGREEING_S, mark.time_s - self._watch.places_agree_since_s)
        )
        self._watch.forget_marks(mark)
        return JudgedPlace(False, walk.off_m, walks=True, back=walk.place)

    def _judge_during_walk(
        self, mark: ReckonedMark, quality: int, hdop: float | None, timing_m: float
    ) -> JudgedPlace:
        """Judges a place after a drift: whether it agrees with the place before, or for long
        enough with speed and course."""
        assert self._before_walk is not None
        walk = find_walk_between(self._before_walk, mark, GATE_CHI_SQUARE, timing_m)
        self._back = self._back + 1 if walk is None else 0
        long_enough = mark.time_s - self._watch.places_agree_since_s >= self._again_s - 1e-6
        if self._watch.find_walk(mark, GATE_CHI_SQUARE, timing_m) is not None:
            self._watch.forget_marks(mark)
        elif self._back >= AGREEING_EPOCHS or long_enough:
            self._before_walk, self._taken = None, None
            if walk is None:
                self._watch.forget_marks(mark)
            self._judge_innovation(mark.place, quality, hdop, timing_m, mark.time_s)
            return (
                JudgedPlace(True, 0.0) if walk is None else JudgedPlace(True, walk.off_m, anew=True)
            )
        self._watch.keep_mark(mark)
        return JudgedPlace(False, 0.0 if walk is None else walk.off_m, walks=True)

    def _judge_innovation(
        self, place: Place, quality: int, hdop: float | None, timing_m: float, time_s: float
    ) -> JudgedPlace:
        """Judges a place by this epoch and the last accepted one alone."""
        now = _ReckonedPlace(
            place,
            find_place_sd_m(quality, hdop),
            time_s,
            self._way_m,
            self._east_m,
            self._north_m,
            self._lost,
        )
        if self._taken is None:
            return self._accept_place(now, 0.0)
        off_m = _find_innovation_m(self._taken, now)
        if _is_within_gate(off_m, self._taken, now, timing_m):
            return self._accept_place(now, off_m)
        if self._other is None or not _is_within_gate(
            _find_innovation_m(self._other, now), self._other, now, timing_m
        ):
            self._other, self._agreeing = now, 1
            return JudgedPlace(False, off_m)
        self._agreeing += 1
        if self._agreeing < AGREEING_EPOCHS or time_s - self._other.time_s < AGREEING_S - 1e-6:
            return JudgedPlace(False, off_m)
        return self._accept_place(now, off_m, anew=True)

    def _accept_place(self, mark: _ReckonedPlace, off_m: float, anew: bool = False) -> JudgedPlace:
        self._taken, self._other, self._agreeing = mark, None, 0
        return JudgedPlace(True, off_m, anew)


def _find_innovation_m(before: _ReckonedPlace, now: _ReckonedPlace) -> float:
    """Returns the innovation, m; infinite where a place is not a number."""
    east, north = now.place[0] - before.place[0], now.place[1] - before.place[1]
    reckoned = now.lost == before.lost and now.time_s - before.time_s <= MAX_RECKONING_S
    if reckoned:
        off_m = hypot(east - (now.east_m - before.east_m), north - (now.north_m - before.north_m))
    else:
        off_m = max(0.0, hypot(east, north) - (now.way_m - before.way_m))
    return off_m if isfinite(off_m) else float("inf")


def _is_within_gate(
    off_m: float, before: _ReckonedPlace, now: _ReckonedPlace, timing_m: float
) -> bool:
    way_m = WAY_SD_SHARE * (now.way_m - before.way_m)
    variance = before.spread_m**2 + now.spread_m**2 + way_m**2 + timing_m**2
    return off_m * off_m <= GATE_CHI_SQUARE * variance


def find_place_sd_m(quality: int, hdop: float | None) -> float:
    """Returns the standard deviation of a position, m per axis."""
    known = PLACE_SD_M.get(quality)
    if known is not None:
        return known
    return DEFAULT_PLACE_SD_M * min(
        MAX_HDOP, max(1.0, hdop if hdop is not None and isfinite(hdop) else 1.0)
    )
