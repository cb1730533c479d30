"""Map mode along the track: changes made stay, the rest is seen anew; edges, jitter, turns and lost positions."""
from __future__ import annotations

import math

import numpy as np
import pytest

from control.geodesy import TangentPlane, offset
from control.machine.change_lag import Lag
from control.orders import TargetSource
from control.targets.lag_correction import ChangeQueue, Fired
from control.targets.map_profile import MapProfile
from control.targets.prescription import Fallbacks, Prescription
from control.targets.profile import Target, TargetChange
from control.targets.rate_map import GridMap, frame_m

START = Target(0.0, TargetSource.NONE)


class Fixed:
    """A reach of so many metres."""

    farthest_m = 12.0

    def __init__(self, lag_m: float) -> None:
        self.lag_m = lag_m

    def lag(self, before: Target, change: TargetChange) -> Lag:
        return Lag(0.0, 0.0, self.lag_m)

    def distance_m(self, lag: Lag) -> float:
        return self.lag_m


@pytest.fixture
def profile(chequered: Prescription) -> MapProfile:
    return MapProfile(chequered, TangentPlane(34.0, 119.0))


def drive(profile: MapProfile, start: tuple[float, float], heading: float, way_m: float, lag_m: float = 2.6,
          jitter: tuple[float, float] = (0.0, 0.0), step_m: float = 0.06) -> list[Fired]:
    rng = np.random.default_rng(5)
    queue = ChangeQueue(START)
    fired = []
    for track in np.arange(0.0, way_m, step_m):
        aside, turned = jitter[0] * rng.standard_normal(), jitter[1] * rng.standard_normal()
        place = offset(start, heading, float(track), aside)
        profile.look(float(track), *place, heading + turned, queue.fired_to_m)
        fired += queue.advance(profile, float(track), float(track), Fixed(lag_m))
    return fired


@pytest.mark.parametrize("heading", [0.0, 17.0, 45.0, 78.0])
def test_each_edge_fires_once_a_lag_distance_before_it(profile: MapProfile, heading: float) -> None:
    start = (15.0, 15.0)
    fired = drive(profile, start, heading, 60.0)[1:]
    wanted = [s for s in profile.prescription.ahead(start, heading, 62.6) if s.distance_m > 0.0]
    for change, stretch in zip(fired, wanted, strict=False):
        assert change.place_m == pytest.approx(stretch.distance_m, abs=1e-6)
        assert change.after == stretch.target
        assert change.place_m - change.track_m == pytest.approx(2.6, abs=0.061) or len(
            [f for f in fired if f.track_m == change.track_m]) > 1
    assert abs(len(fired) - len(wanted)) <= 1


@pytest.mark.parametrize("heading", [0.0, 17.0, 45.0])
def test_a_jitter_of_place_and_heading_adds_no_change(profile: MapProfile, heading: float) -> None:
    calm = [f.after for f in drive(profile, (15.0, 15.0), heading, 60.0)]
    shaken = [f.after for f in drive(profile, (15.0, 15.0), heading, 60.0, jitter=(0.02, 0.7))]
    assert shaken == calm


def test_driving_along_an_edge_does_not_chatter(profile: MapProfile) -> None:
    fired = drive(profile, (40.0, 15.0), 0.0, 60.0, jitter=(0.03, 0.0))
    assert len(fired) <= 8


def test_what_holds_after_a_sharp_turn_is_taken_over(profile: MapProfile) -> None:
    queue = ChangeQueue(START)
    profile.look(0.0, 35.0, 35.0, 0.0, queue.fired_to_m)
    queue.advance(profile, 0.0, 0.0, Fixed(2.6))
    profile.look(4.0, 35.0, 39.0, 0.0, queue.fired_to_m)
    queue.advance(profile, 0.0, 4.0, Fixed(2.6))
    held = profile.prescription.at((35.0, 45.0))
    assert queue.holding == held                       # made for the cell to the north
    profile.look(4.5, 35.0, 39.4, 90.0, queue.fired_to_m)      # turned away from it before reaching it
    queue.advance(profile, 0.0, 4.5, Fixed(2.6))
    assert queue.holding == profile.prescription.at((36.0, 39.4))


def test_the_way_ahead_bends_with_the_turn(profile: MapProfile) -> None:
    """On a right turn of 8 m radius the edge to the east is met along the arc, the one straight ahead never."""
    radius = 8.0
    turn = math.degrees(1.0) / radius
    profile.look(0.0, 22.0, 25.0, 0.0, float("-inf"), turn_deg_m=turn)
    angle = math.acos((radius - 8.0) / radius) if radius >= 8.0 else 0.0
    changes, holding, after = [], profile.at(0.0), 0.0
    while (change := profile.next_change(after, 14.0, holding)) is not None:
        changes.append(change)
        holding, after = change.target, change.place_m
    arc = [(22.0 + radius * (1 - math.cos(s / radius)), 25.0 + radius * math.sin(s / radius))
           for s in np.arange(0.0, 14.0, 0.01)]
    on_arc = profile.prescription.targets_at(arc)
    true = [0.01 * k for k in range(1, len(arc)) if on_arc[k] != on_arc[k - 1]]
    assert angle > 0.0
    assert [c.place_m for c in changes] == pytest.approx(true, abs=0.15)


def test_a_lost_position_has_its_rate_and_is_found_again(profile: MapProfile) -> None:
    profile.look(0.0, 35.0, 35.0, 0.0, float("-inf"))
    here = profile.at(1.0)
    profile.lost()
    assert profile.at(1.0) == Target(60.0, TargetSource.FALLBACK)
    assert profile.next_change(1.0, 10.0, here) == TargetChange(1.0, Target(60.0, TargetSource.FALLBACK))
    profile.look(1.0, 35.0, 36.0, 0.0, 1.0)
    assert profile.at(1.5) == here


def test_what_was_passed_stays_known_behind(profile: MapProfile) -> None:
    drive(profile, (15.0, 15.0), 0.0, 30.0)
    assert profile.at(2.0) == profile.prescription.at((15.0, 17.0))
    assert profile.at(12.0) == profile.prescription.at((15.0, 27.0))


def test_a_map_without_changes_needs_none() -> None:
    flat = Prescription(GridMap(frame_m((-500.0, -500.0), 10.0, 10.0), np.full((100, 100), 250.0)), Fallbacks())
    fired = drive(MapProfile(flat, TangentPlane(34.0, 119.0)), (0.0, 0.0), 33.0, 100.0)
    assert [f.after for f in fired] == [Target(250.0, TargetSource.MAP)]
