"""Each interlock alone stops flow, and flow comes back when it is gone."""
from __future__ import annotations

from math import inf, nan

import pytest

from control.orders import Do, State, TargetSource
from control.readings import Doubted, SpeedDoubt
from control.safety import INTERLOCKS

FORBIDDEN = [
    ("speed_silent", {"speed_used_mps": None}),
    ("speed_silent", {"speed_used_mps": nan}),
    ("low_speed", {"speed_mps": 0.29}),
    ("standstill", {"wheel_standstill": True}),
    ("position_lost", {"position_ok": False, "target_source": TargetSource.MAP}),
    ("position_lost", {"position_ok": False, "target_source": TargetSource.POINT}),
    ("position_lost", {"position_ok": False, "target_source": TargetSource.MAP_AND_CANOPY}),
    ("outside_field", {"landing_inside": False}),
    ("map_elsewhere", {"target_source": TargetSource.MAP, "map_elsewhere": True}),
    ("work_switch_up", {"work_switch": False}),
    ("log_failed", {"log_ok": False}),
    ("target_refused", {"target_rate_kg_ha": nan}),
    ("target_refused", {"target_rate_kg_ha": inf}),
    ("target_refused", {"target_rate_kg_ha": -1.0}),
    ("target_refused", {"target_rate_kg_ha": 1000.5}),
]


@pytest.mark.parametrize(("interlock", "changes"), FORBIDDEN)
def test_one_interlock_alone_stops_flow_and_lets_it_return(working, interlock, changes):
    run = working()
    verdict = run.tick(**changes)
    assert (verdict.state, verdict.flow_allowed, verdict.why_no_flow) == (State.WORKING, False, (interlock,))
    assert run.tick().flow_allowed


def test_every_interlock_of_the_list_is_tested():
    seen = {interlock for interlock, _ in FORBIDDEN}
    elsewhere = {"not_working", "drive_silent", "reversing", "course_unknown"}
    assert seen | elsewhere == set(INTERLOCKS)


def test_no_flow_when_not_working(new_run):
    run = new_run()
    assert run.tick().why_no_flow == ("not_working",)
    run.order(Do.READY)
    assert run.tick().why_no_flow == ("not_working",)


@pytest.mark.parametrize("source", [TargetSource.CANOPY, TargetSource.MANUAL, TargetSource.FALLBACK])
def test_position_is_needed_in_map_and_point_mode_only(working, source):
    assert working().tick(position_ok=False, target_source=source).flow_allowed


def test_no_known_field_forbids_nothing(working):
    assert working().tick(landing_inside=None).flow_allowed


@pytest.mark.parametrize("refused", Doubted)
def test_a_speed_that_is_not_believed_goes_on_with_flow_and_begins_none(working, refused):
    run, doubt = working(), {"speed_doubt": SpeedDoubt(refused, 100.0, 100.0, 5.0, 1.25, 1.0)}
    assert run.tick(2.0, **doubt).flow_allowed
    run.tick(1.0, speed_mps=0.0, wheel_mps=5.0, **doubt)
    assert run.tick(3.0, wheel_mps=5.0, **doubt).why_no_flow in (("low_speed",), ("course_unknown",))
    assert run.tick(1.0).flow_allowed


def test_a_fitted_work_switch_that_is_silent_counts_as_up(working, new_run):
    run = new_run(has_work_switch=True)
    run.order(Do.READY)
    run.order(Do.START)
    assert run.tick(work_switch=True).flow_allowed
    assert run.tick(work_switch=None).why_no_flow == ("work_switch_up",)
    assert working().tick(work_switch=None).flow_allowed


def test_flow_starts_above_half_and_stops_below_0_3(working):
    run = working()
    assert run.tick(speed_mps=0.31).flow_allowed
    assert not run.tick(speed_mps=0.29).flow_allowed
    assert not run.tick(1.0, speed_mps=0.45).flow_allowed
    assert run.tick(speed_mps=0.51).flow_allowed


class TestLaunching:
    """Flow from a walking creep on, with START held: it lands a lag later, where the machine is then."""

    @staticmethod
    def creeping(run, seconds=0.2, **changes):
        for _ in range(max(1, round(seconds / 0.2))):
            run.order(Do.START, True)
            run.tick(0.2, **({"speed_mps": 0.25} | changes))
        return run.verdict.why_no_flow

    def stood(self, working, **settings):
        run = working(**settings)
        run.tick(1.0, speed_mps=0.0)
        return run

    def test_flow_from_the_creep_on_while_start_is_held(self, working):
        run = self.stood(working)
        assert run.tick(0.3, speed_mps=0.25).why_no_flow, "not held: as ever"
        assert self.creeping(run) == ()
        assert run.tick(0.6, speed_mps=0.25).why_no_flow, "let go"
        assert self.creeping(run) == ()

    def test_not_without_moving_however_long_it_is_held(self, working):
        assert self.creeping(self.stood(working), 2.0, speed_mps=0.0) == ("standstill",)
        assert self.creeping(self.stood(working), 2.0, speed_mps=0.05)

    @pytest.mark.parametrize("still", [
        {"gnss_mps": 0.05}, {"wheel_mps": 0.05}, {"gnss_age_s": 5.0}, {"fix_quality": 0}])
    def test_both_sensors_must_say_so(self, working, still):
        assert self.creeping(self.stood(working), **still) != ()

    def test_for_three_seconds_and_not_again_under_the_same_press(self, working):
        run = self.stood(working)
        assert self.creeping(run, 2.6) == ()
        assert self.creeping(run, 1.0) != ()
        run.tick(0.6, speed_mps=0.25)
        assert self.creeping(run) == ()

    def test_the_course_must_be_known_since_it_stood_and_forwards(self, working):
        assert self.creeping(self.stood(working), course_deg=None) == ("low_speed",)
        assert self.creeping(self.stood(working), course_deg=270.0) == ("reversing",)

    def test_the_work_switch_holds(self, working):
        assert self.creeping(self.stood(working), work_switch=False) == ("work_switch_up",)

    def test_a_press_that_outlived_work_does_not_begin_it_again(self, working):
        run = working()
        run.order(Do.START, True)
        run.order(Do.HOLD)
        assert run.order(Do.START, True).why == "start_held"
        run.tick(0.6)
        assert run.order(Do.START, True).accepted


@pytest.mark.parametrize("one_still", [
    {"gnss_mps": 0.05}, {"wheel_mps": 0.05}, {"gnss_age_s": 5.0}, {"wheel_age_s": 5.0}, {"fix_quality": 0}])
def test_both_speed_sensors_must_move_to_start_but_one_is_enough_to_go_on(working, one_still):
    run = working()
    assert run.tick(**one_still).flow_allowed
    run.tick(speed_mps=0.2)
    assert run.tick(0.5, **one_still).why_no_flow in (("low_speed",), ("course_unknown",))
    assert run.tick().flow_allowed


def test_the_wheel_s_standstill_wins_over_a_late_gnss_speed(working):
    verdict = working().tick(wheel_mps=0.0)
    assert verdict.why_no_flow == ("standstill",)


def test_field_edge_and_low_speed_keep_working(working):
    run = working()
    assert run.tick(30.0, landing_inside=False).state is State.WORKING
    assert run.tick(30.0, speed_mps=0.25).state is State.WORKING


class TestReversing:
    def stop_and_go(self, run, course_deg, stand_s=2.0):
        run.tick(stand_s, speed_mps=0.0, course_deg=course_deg)
        return run.tick(0.5, course_deg=course_deg)

    def test_backwards_after_a_standstill_gives_no_flow_until_forwards_again(self, working):
        run = working()
        assert self.stop_and_go(run, 270.0).why_no_flow == ("reversing",)
        assert run.tick(5.0, course_deg=265.0).why_no_flow == ("reversing",)
        assert self.stop_and_go(run, 88.0).flow_allowed

    @pytest.mark.parametrize(("course_deg", "flow"), [(205.0, True), (215.0, False), (-25.0, True), (325.0, False)])
    def test_the_flip_is_more_than_120_degrees_either_way(self, working, course_deg, flow):
        assert self.stop_and_go(working(), course_deg).flow_allowed is flow

    def test_north_is_no_flip(self, working):
        run = working()
        run.tick(0.5, course_deg=350.0)
        assert self.stop_and_go(run, 10.0).flow_allowed

    def test_a_turn_without_a_standstill_is_none(self, working):
        run = working()
        assert run.tick(5.0, course_deg=270.0).flow_allowed

    def test_a_quick_shuttle_counts(self, working):
        run = working()
        run.tick(speed_mps=0.1, course_deg=90.0)
        assert run.tick(0.5, course_deg=270.0).why_no_flow == ("reversing",)

    def test_a_gnss_speed_late_by_a_second_does_not_hide_it(self, working):
        """The wheel stops for 0.3 s and goes backwards while GNSS still tells of going forwards."""
        run = working()
        run.tick(0.3, wheel_mps=0.0, speed_used_mps=0.0)
        run.tick(0.7, gnss_mps=1.0)
        run.tick(0.2, gnss_mps=0.1)
        assert run.tick(0.5, course_deg=270.0).why_no_flow == ("reversing",)

    def test_no_flow_before_the_new_course_is_known(self, working):
        run = working()
        run.tick(2.0, speed_mps=0.0)
        assert run.tick(1.0, course_deg=None).why_no_flow == ("course_unknown",)
        assert run.tick(0.5).flow_allowed

    def test_a_receiver_without_courses_is_not_judged(self, new_run):
        run = new_run()
        run.order(Do.READY)
        run.order(Do.START)
        assert run.tick(1.0, course_deg=None).flow_allowed

    def test_the_operator_may_allow_it_until_stop(self, working):
        run = working()
        self.stop_and_go(run, 270.0)
        assert run.order(Do.ALLOW_REVERSE, True).accepted
        assert run.tick(course_deg=270.0).flow_allowed
        run.order(Do.STOP)
        run.order(Do.READY)
        run.order(Do.START)
        assert run.tick(course_deg=270.0).why_no_flow == ("reversing",)


def test_the_operator_may_allow_landing_outside(working):
    run = working()
    assert run.order(Do.ALLOW_OUTSIDE, True).accepted
    assert run.tick(landing_inside=False).flow_allowed
    assert run.order(Do.ALLOW_OUTSIDE, False).accepted
    assert not run.tick(landing_inside=False).flow_allowed


def test_the_operator_may_want_the_outside_rate_of_a_map_elsewhere(working):
    run = working()
    assert not run.order(Do.ALLOW_MAP_ELSEWHERE, 1.0).accepted
    assert run.order(Do.ALLOW_MAP_ELSEWHERE, True).accepted
    assert run.tick(map_elsewhere=True).flow_allowed
    assert run.order(Do.STOP).accepted and run.order(Do.READY).accepted and run.order(Do.START).accepted
    assert run.tick(map_elsewhere=True).why_no_flow == ("map_elsewhere",)


def test_without_a_log_work_goes_on_only_if_the_operator_says_so(working):
    run = working()
    assert not run.order(Do.GO_ON_UNLOGGED, True).accepted
    assert run.tick(log_ok=False).why_no_flow == ("log_failed",)
    assert run.order(Do.GO_ON_UNLOGGED, True).accepted
    assert run.tick(log_ok=False).flow_allowed
    run.tick()
    assert run.tick(log_ok=False).why_no_flow == ("log_failed",), "asked anew after the log had recovered"
