"""What the calibrations gather: a held key, revolutions of a catch, heads against their median,
wheel against GNSS."""

from __future__ import annotations

from math import cos, radians

import pytest
from topdress.console.app.held_key import MAX_FIRST_REPEAT_S, MAX_REPEAT_GAP_S, HeldKey
from topdress.console.app.pages.calibrate.catch_test import MIN_CATCH_REVOLUTIONS, CatchRun
from topdress.console.app.pages.calibrate.heads_calibration import CHECK_DURATION_S, HeadsCheck
from topdress.console.app.pages.calibrate.wheel_drive import MIN_DRIVE_M, WheelRun, WheelSample


def test_one_press_turns_nothing_and_a_held_key_runs_until_it_is_let_go():
    held = HeldKey()
    held.note_key(0.0)
    assert held.is_armed and not held.is_down(0.1)
    for index in range(20):
        held.note_key(0.5 + 0.04 * index)
    last_s = 0.5 + 0.04 * 19
    assert held.is_down(last_s + MAX_REPEAT_GAP_S - 0.01)
    assert not held.is_down(last_s + MAX_REPEAT_GAP_S + 0.01)
    assert not held.is_down(last_s + 0.1), "what was let go stays so"


def test_two_presses_far_apart_are_two_single_presses():
    held = HeldKey()
    held.note_key(0.0)
    held.note_key(MAX_FIRST_REPEAT_S + 0.1)
    assert not held.is_down(MAX_FIRST_REPEAT_S + 0.15) and held.is_armed


def test_a_mouse_button_runs_at_once_and_stops_at_once():
    held = HeldKey()
    held.note_mouse(True)
    assert held.is_down(100.0) and held.is_down(160.0)
    held.note_mouse(False)
    assert not held.is_down(160.0)


def test_after_a_refusal_the_repeats_of_the_same_key_do_not_begin_again():
    held = HeldKey()
    held.note_key(0.0)
    held.note_key(0.5)
    held.block_repeats(0.5)
    for index in range(1, 50):
        held.note_key(0.5 + 0.05 * index)
        assert not held.is_down(0.5 + 0.05 * index)
    held.note_key(4.0)
    held.note_key(4.5)
    assert held.is_down(4.5), "let go and pressed again, it runs"


def turn(test, begin_s, seconds, rpm, mm=30.0, *, step_s=0.2, hopper_kg=100.0, ramp_rpm_s=200.0):
    """Frames of a run: up, on, down, then standing for 4 s; returns the time after it."""
    steps = int((seconds + 5.0) / step_s)
    for index in range(steps):
        t = index * step_s
        speed = max(0.0, min(rpm, ramp_rpm_s * (t - 0.37), rpm - ramp_rpm_s * (t - seconds - 0.37)))
        test.add_frame(begin_s + t, speed, mm, hopper_kg, t < seconds)
    return begin_s + steps * step_s


def exact_revolutions(seconds, rpm):
    """Of the same trapezoid: as long as commanded, the ramps are alike."""
    return rpm * seconds / 60.0


@pytest.mark.parametrize(
    ("rpm", "seconds"), [(20.0, 30.0), (70.0, 30.0), (100.0, 12.3), (45.0, 61.7)]
)
def test_revolutions_are_counted_to_a_fiftieth(rpm, seconds):
    test = CatchRun(rpm, 30.0)
    end_s = turn(test, 0.0, 6.0, rpm)
    assert test.phase == "weigh" and test.shaft_turns.revolutions == 0.0
    turn(test, end_s, seconds, rpm)
    assert test.shaft_turns.revolutions == pytest.approx(exact_revolutions(seconds, rpm), abs=0.04)
    test.add_weighed_catch(5.0)
    point = test.points[0]
    assert point.revolutions == pytest.approx(exact_revolutions(seconds, rpm), abs=0.04)
    assert point.shaft_rpm == pytest.approx(rpm, rel=0.02), "the ramps hardly count"
    assert point.opening_mm == pytest.approx(30.0)


def test_a_run_too_short_to_settle_does_not_settle():
    test = CatchRun(70.0, 30.0)
    turn(test, 0.0, 3.0, 70.0)
    assert test.phase == "settle" and not test.can_weigh


def test_frames_that_were_missed_are_not_counted():
    test = CatchRun(60.0, 30.0)
    turn(test, 0.0, 6.0, 60.0)
    test.add_frame(100.0, 60.0, 30.0, 100.0, True)
    test.add_frame(110.0, 60.0, 30.0, 100.0, True)
    assert test.shaft_turns.revolutions == 0.0


def test_another_setting_settles_anew_and_keeps_the_points():
    test = CatchRun(70.0, 30.0)
    end_s = turn(test, 0.0, 6.0, 70.0)
    end_s = turn(test, end_s, 20.0, 70.0)
    test.add_weighed_catch(4.0)
    assert test.phase == "weigh" and test.shaft_turns.revolutions == 0.0
    test.change_setting(opening_mm=40.0)
    assert test.phase == "settle" and len(test.points) == 1
    test.change_setting(opening_mm=40.0)
    turn(test, end_s, 6.0, 70.0, 40.0)
    assert test.phase == "weigh"
    assert MIN_CATCH_REVOLUTIONS > 0 and not test.can_weigh


def test_the_hopper_scale_says_about_what_left_in_the_catch_alone():
    test = CatchRun(70.0, 30.0)
    end_s = turn(test, 0.0, 6.0, 70.0, hopper_kg=100.0)
    end_s = turn(test, end_s, 0.0, 0.0, hopper_kg=99.0)
    assert test.scale_loss_kg is None
    turn(test, end_s, 20.0, 70.0, hopper_kg=95.5)
    assert test.scale_loss_kg == pytest.approx(3.5, abs=0.3)


def checked(offsets, spread=0.01, silent=()):
    check = HeadsCheck()
    check.start_check(0.0)
    for index in range(int(CHECK_DURATION_S / 0.2) + 1):
        heads = [
            0.5 + offset + spread * (1 if (index + k) % 2 else -1)
            for k, offset in enumerate(offsets)
        ]
        check.add_frame(
            0.2 * index, [None if k in silent else value for k, value in enumerate(heads)]
        )
    return check


def test_one_fouled_head_is_named_with_its_offset():
    found = checked([0.0, 0.0, -0.05, 0.0, 0.0, 0.0]).list_heads()
    assert [one.verdict for one in found] == ["good", "good", "fouled", "good", "good", "good"]
    assert found[2].offset == pytest.approx(-0.05, abs=0.011)


def test_an_unsteady_and_a_silent_head_are_named():
    check = HeadsCheck()
    check.start_check(0.0)
    for index in range(int(CHECK_DURATION_S / 0.2) + 1):
        check.add_frame(0.2 * index, [0.5, 0.5, 0.5 + (0.1 if index % 2 else -0.1), None, 0.5, 0.5])
    assert [one.verdict for one in check.list_heads()] == [
        "good",
        "good",
        "unsteady",
        "silent",
        "good",
        "good",
    ]


def test_nothing_is_judged_before_the_time_is_over():
    check = HeadsCheck()
    check.start_check(10.0)
    for index in range(50):
        check.add_frame(10.0 + 0.2 * index, [0.5, 0.5, 0.2, 0.5, 0.5, 0.5])
    assert check.is_running and {one.verdict for one in check.list_heads()} == {""}


def straight(length_m, wheel_factor=1.0, bend_m=0.0, fix=4, speed_mps=2.0):
    run = WheelRun()
    run.start_drive()
    steps = round(length_m / speed_mps / 0.2)
    for index in range(steps + 1):
        along = index * 0.2 * speed_mps
        aside = bend_m * 4.0 * (along / length_m) * (1.0 - along / length_m)
        lon_deg = 113.6 + aside / (111_320.0 * cos(radians(34.8)))
        run.add_sample(
            WheelSample(
                index * 0.2, 34.8 + along / 110_940.0, lon_deg, fix, speed_mps * wheel_factor
            )
        )
    return run


def test_both_ways_are_measured():
    drive = straight(150.0, 1.01).drive
    assert drive.gnss_m == pytest.approx(150.0, rel=5e-4) and drive.wheel_m == pytest.approx(
        151.5, rel=1e-3
    )
    assert straight(150.0).is_long_enough


@pytest.mark.parametrize(
    ("run", "trouble"),
    [(lambda: straight(150.0, bend_m=4.0), "bent"), (lambda: straight(MIN_DRIVE_M - 5.0), "")],
)
def test_a_bent_or_short_drive_is_not_enough(run, trouble):
    got = run()
    assert not got.is_long_enough and got.drive.trouble == trouble


def test_a_gap_ends_the_drive():
    run = straight(50.0)
    run.add_sample(None)
    assert not run.running and run.drive.trouble == "broken"
