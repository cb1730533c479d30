"""Ground that is spread while no place is known: done once the place returns and agrees."""

from __future__ import annotations

from math import cos, radians, sin

import numpy as np
import pytest
from topdress.control.field.coverage import Coverage
from topdress.control.field.ground_trace import MAX_UNLOCATED_PATH_M, GroundTrace

WIDTH_M = 2.4
STEP_M = 0.1


def a_trace(**options) -> GroundTrace:
    return GroundTrace(Coverage(WIDTH_M, 0.2, longest_m=5.0, **options))


def north(trace: GroundTrace, from_m: float, to_m: float, *, placed: bool, slip: float = 1.0):
    """North along the plane's axis, material flowing. slip: the wheel's way by the true one."""
    found = None
    for at_m in np.arange(from_m, to_m + 1e-9, STEP_M):
        place = (0.0, float(at_m)) if placed else None
        found = trace.pass_over(place, 0.0 if placed else None, True, slip * STEP_M) or found
    return found


def done_share(trace: GroundTrace, from_m: float, to_m: float, east_m: float = 0.0) -> float:
    places = [(east_m, at_m) for at_m in np.arange(from_m, to_m, 0.1)]
    return float(np.isfinite(trace.coverage._find_stamps(places)).mean())


@pytest.mark.parametrize("slip", [0.93, 1.0, 1.08])
def test_a_way_between_two_places_is_done_where_the_wheel_agrees(slip):
    trace = a_trace()
    north(trace, 0.0, 10.0, placed=True)
    assert north(trace, 10.1, 30.0, placed=False, slip=slip) is None
    assert done_share(trace, 11.0, 29.0) == 0.0
    way_m, is_done = north(trace, 30.1, 35.0, placed=True)
    assert is_done and way_m == pytest.approx(slip * 20.1, abs=0.2)
    assert done_share(trace, 0.5, 34.5) == 1.0
    assert trace.coverage.covered_area.area_ha == pytest.approx(35.0 * WIDTH_M / 1e4, rel=0.02)
    assert trace.coverage.covered_area.overlap_ha == 0.0


@pytest.mark.parametrize(
    ("what", "slip", "place", "heading_deg"),
    [
        ("the wheel spins", 1.5, (0.0, 30.1), 0.0),
        ("it came back", 1.0, (2.4, 12.0), 180.0),
        ("another pass", 1.0, (15.0, 23.0), 0.0),
        ("a turn by a right angle", 1.0, (12.0, 22.0), 90.0),
    ],
)
def test_a_way_that_may_be_any_is_not_done(what, slip, place, heading_deg):
    trace = a_trace()
    north(trace, 0.0, 10.0, placed=True)
    north(trace, 10.1, 30.0, placed=False, slip=slip)
    way_m, is_done = trace.pass_over(place, heading_deg, True, STEP_M)
    assert not is_done and way_m > 20.0, what
    assert done_share(trace, 11.0, 29.0) == 0.0


@pytest.mark.parametrize("ends", ["backwards", "too long"])
def test_a_way_that_nobody_can_follow_is_given_up(ends):
    trace = a_trace()
    north(trace, 0.0, 10.0, placed=True)
    north(trace, 10.1, 20.0, placed=False)
    trace.pass_over(None, None, True, -STEP_M if ends == "backwards" else MAX_UNLOCATED_PATH_M)
    north(trace, 20.1, 30.0, placed=False)
    assert trace.reckon_open_way() == [] and north(trace, 30.1, 31.0, placed=True) is None
    assert done_share(trace, 11.0, 29.0) == 0.0


def test_only_where_something_landed_and_in_its_strips():
    trace = a_trace(strips=[(-1.2, 0.0), (0.0, 1.2)])
    north(trace, 0.0, 10.0, placed=True)
    for at_m in np.arange(10.0, 30.0, STEP_M):
        flowing = (True, True) if at_m < 15.0 else (at_m < 20.0, False)
        trace.pass_over(None, None, flowing, STEP_M)
    assert trace.pass_over((0.0, 30.0), 0.0, (False, False), STEP_M)[1]
    found = [
        done_share(trace, *ends, east_m)
        for east_m in (-0.6, 0.6)
        for ends in ((10.5, 14.5), (15.5, 19.5))
    ]
    assert found == [1.0, 1.0, 1.0, 0.0]
    assert done_share(trace, 20.5, 29.5, -0.6) == 0.0


def test_a_curve_is_followed_between_both_courses():
    """A quarter of 40 degrees on a circle of 30 m: the chord leaves it by 1.8 m."""
    trace, radius_m = a_trace(), 30.0

    def at(angle_deg: float) -> tuple[float, float]:
        angle = radians(angle_deg)
        return radius_m * (1.0 - cos(angle)), radius_m * sin(angle)

    steps = np.arange(0.0, 40.0, 0.2)
    trace.pass_over(at(0.0), 0.0, True, 0.0)
    for _ in steps[1:]:
        trace.pass_over(None, None, True, radius_m * radians(0.2))
    assert trace.pass_over(at(40.0), 40.0, True, radius_m * radians(0.2))[1]
    assert np.isfinite(trace.coverage._find_stamps([at(float(a)) for a in steps])).all()


def test_an_open_way_is_reckoned_straight_on_as_far_as_a_course_is_believed():
    trace = a_trace()
    north(trace, 0.0, 10.0, placed=True)
    assert trace.reckon_open_way() == []
    north(trace, 10.1, 60.0, placed=False)
    way = [place[1] for place, _heading, _flowing in trace.reckon_open_way()]
    assert way[0] == pytest.approx(10.0) and way[-1] == pytest.approx(10.0 + 24.0)
    assert done_share(trace, 11.0, 60.0) == 0.0, "nothing is entered before the place returns"
