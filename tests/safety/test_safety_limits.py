"""Every limit changes what happens: no constant that nothing reads."""

from __future__ import annotations

import ast
from dataclasses import fields, replace
from pathlib import Path

import pytest
from topdress.control.machine.machine import Limits
from topdress.control.orders import Do
from topdress.control.readings import (
    DriveCommand,
    RangeBreach,
    RefusedSpeed,
    ScaleFinding,
    SpeedDoubt,
)
from topdress.control.safety import (
    ALARMS,
    DriveLimits,
    PreviousCommands,
    SafetyLimits,
    alarm_conditions,
    limit_command,
    select_machine_limits,
)

STANDS = PreviousCommands(turn=False, flow=False, opening_mm=15.0)
TURNS = PreviousCommands(shaft_rpm=70.0, expected_rpm=70.0, opening_mm=15.0, expected_mm=15.0)


def flow(seconds=0.05, **changes):
    return lambda run: run.tick(seconds, **changes).flow_allowed


def state(seconds=0.05, **changes):
    return lambda run: run.tick(seconds, **changes).state


def alarms(seconds=0.05, **changes):
    def observe(run):
        run.tick(seconds, **changes)
        return run.alarm_ids()

    return observe


def start_again(**changes):
    def observe(run):
        run.tick(speed_mps=0.2)
        return run.tick(0.5, **changes).flow_allowed

    return observe


def reverse(**changes):
    def observe(run):
        run.tick(1.0, speed_mps=0.0)
        return run.tick(0.5, **changes).flow_allowed

    return observe


def calibrate(changes, seconds=0.05):
    def observe(run):
        run.order(Do.STOP)
        run.order(Do.READY)
        run.tick(speed_mps=0.0)
        run.tick(**({"speed_mps": 0.0} | changes))
        if not run.order(Do.CALIBRATE, 100.0).accepted:
            return "refused"
        return run.tick(seconds, speed_mps=0.0).state

    return observe


def calibrate_then_move(run):
    calibrate({})(run)
    return run.tick(speed_mps=0.25).state


def creep_backwards(run):
    """Backwards at walking pace after a stop: too slow for its course to be believed by a
    higher limit."""
    run.tick(1.0, speed_mps=0.0)
    run.tick(0.2, gnss_mps=0.4, wheel_mps=0.6, speed_used_mps=0.6, course_deg=270.0)
    return run.verdict.why_no_flow


def launch(seconds=0.3, every_s=0.2, **changes):
    """Stand, then creep at 0.25 m/s with START held, the course known."""

    def observe(run):
        run.tick(1.0, speed_mps=0.0)
        for _ in range(round(seconds / every_s)):
            run.order(Do.START, True)
            run.tick(every_s, **({"speed_mps": 0.25} | changes))
        return run.verdict.why_no_flow

    return observe


def stand_without_wheel(run):
    return run.tick(12.0, speed_used_mps=0.15, wheel_mps=0.15, gnss_mps=0.15).state


def low_then_a_little_more(run):
    run.tick(2.0, hopper_kg=29.5)
    run.tick(3.0, hopper_kg=30.5)
    return run.alarm_ids()


def clears(run):
    run.tick(valid_heads=2)
    run.tick(1.5)
    return run.alarm_ids()


def gate_opens_by(mm):
    def observe(run):
        run.tick(commanded=STANDS, shaft_rpm=0.0)
        run.tick(3.0, commanded=STANDS, shaft_rpm=0.0, opening_mm=15.0 + mm)
        return run.alarm_ids()

    return observe


def dead_wheel(run):
    """The operator lets GNSS alone say how fast it goes; it speaks five times a second."""
    run.tick(1.0, wheel_mps=0.0)
    run.order(Do.ALLOW_NO_WHEEL, True)
    run.order(Do.ACKNOWLEDGE, "")
    return run.tick(0.5, wheel_mps=0.0).why_no_flow


def slowing_down(seconds):
    """A shaft that loses a tenth of its speed every 0.1 s."""

    def observe(run):
        rpm = 100.0
        for _ in range(round(seconds / run.period_s)):
            rpm *= 0.95
            run.tick(commanded=STANDS, shaft_rpm=max(3.0, rpm))
        return run.alarm_ids()

    return observe


CHANGES = [
    ("start_speed_mps", 0.8, start_again(speed_mps=0.6)),
    ("stop_speed_mps", 0.1, flow(speed_mps=0.2)),
    ("both_speeds_to_start", False, start_again(wheel_age_s=5.0)),
    ("launch_speed_mps", 0.3, launch()),
    ("launch_confirm_s", 2.0, launch(2.0, every_s=0.8)),
    ("launch_max_s", 9.0, launch(4.0)),
    ("standstill_speed_mps", 0.2, stand_without_wheel),
    ("standstill_hold_s", 20.0, state(15.0, speed_mps=0.0)),
    ("speed_silent_s", 4.0, state(3.0, speed_used_mps=None)),
    ("speed_silent_s", 4.0, state(gnss_age_s=3.0, wheel_age_s=3.0)),
    ("wheel_silent_s", 2.0, start_again(wheel_age_s=1.5)),
    ("wheel_fault_speed_mps", 1.0, alarms(1.0, wheel_mps=0.0, gnss_mps=0.8)),
    ("wheel_fault_s", 2.0, alarms(1.0, wheel_mps=0.0, gnss_mps=0.8)),
    (
        "speeds_differ_s",
        3.0,
        state(speed_doubt=SpeedDoubt(RefusedSpeed.EITHER, 100.0, 104.0, 2.5, 1.25, 1.0)),
    ),
    ("reverse_flip_deg", 170.0, reverse(course_deg=240.0)),
    ("course_speed_mps", 0.5, creep_backwards),
    ("drive_silent_s", 1.0, state(shaft_age_s=0.8)),
    ("gnss_silent_s", 1.0, alarms(gnss_age_s=0.8)),
    ("gnss_silent_periods", 5.0, alarms(gnss_age_s=0.8)),
    ("gnss_alone_period_s", 0.3, dead_wheel),
    ("gnss_period_max_s", 5.0, alarms(gnss_age_s=6.0, gnss_period_s=4.0)),
    ("ndvi_silent_s", 5.0, alarms(ndvi_age_s=3.0)),
    ("heads_min", 2, alarms(valid_heads=3)),
    ("heads_full_ndvi", 0.98, alarms(3.0, ndvi=0.97)),
    ("heads_full_s", 5.0, alarms(3.0, ndvi=0.97)),
    ("supply_low_v", 23.0, alarms(6.0, supply_v=22.0)),
    ("supply_low_s", 9.0, alarms(6.0, supply_v=11.0)),
    ("supply_silent_s", 5.0, alarms(6.0, supply_v=11.0, supply_age_s=3.0)),
    ("shaft_stands_rpm", 9.0, alarms(3.0, commanded=STANDS, shaft_rpm=5.0)),
    ("stand_settle_s", 4.0, alarms(3.0, commanded=STANDS)),
    ("run_down_max_s", 1.5, slowing_down(2.0)),
    ("stand_confirm_s", 4.0, alarms(3.0, commanded=STANDS)),
    ("gate_stands_mm", 9.0, gate_opens_by(5.0)),
    (
        "valve_closes_s",
        9.0,
        alarms(5.0, commanded=STANDS._replace(valves=(False,)), shaft_rpm=0.0, valves=(True,)),
    ),
    ("drive_far_percent", 40.0, alarms(3.0, commanded=TURNS, shaft_rpm=90.0)),
    ("drive_far_s", 5.0, alarms(3.0, commanded=TURNS, shaft_rpm=90.0)),
    ("shaft_off_percent", 15.0, alarms(11.0, commanded=TURNS, shaft_rpm=63.0)),
    ("shaft_off_s", 15.0, alarms(11.0, commanded=TURNS, shaft_rpm=63.0)),
    ("gate_off_mm", 3.0, alarms(3.0, commanded=TURNS, opening_mm=17.0)),
    ("gate_off_s", 5.0, alarms(3.0, commanded=TURNS, opening_mm=17.0)),
    ("scale_silent_s", 5.0, alarms(scale_age_s=3.0)),
    ("console_hold_s", 5.0, state(console_age_s=3.0)),
    ("console_off_s", 90.0, state(console_age_s=70.0)),
    (
        "rate_floor_kg_ha",
        10.0,
        alarms(4.0, applied_rate_kg_ha=24.0, expected_rate_kg_ha=20.0, target_rate_kg_ha=20.0),
    ),
    ("rate_amber_percent", 15.0, alarms(4.0, applied_rate_kg_ha=336.0)),
    ("rate_amber_s", 5.0, alarms(4.0, applied_rate_kg_ha=336.0)),
    ("rate_red_percent", 30.0, alarms(4.0, applied_rate_kg_ha=375.0)),
    ("rate_red_s", 5.0, alarms(4.0, applied_rate_kg_ha=375.0)),
    ("rate_max_kg_ha", 350.0, flow(target_rate_kg_ha=400.0)),
    ("rate_max_s", 3.0, state(2.0, applied_rate_kg_ha=1200.0)),
    ("beyond_range_s", 6.0, alarms(4.0, range_breach=RangeBreach(True, 480.0, 413.0, 4.8))),
    ("trimmed_percent", 9.0, alarms(scale=ScaleFinding(trimmed_percent=-7.0))),
    ("hopper_empty_kg", 1.0, state(2.0, hopper_kg=0.8)),
    ("hopper_low_kg", 50.0, alarms(2.0, hopper_kg=40.0)),
    ("hopper_clear_kg", 0.1, low_then_a_little_more),
    ("hopper_confirm_s", 3.0, alarms(2.0, hopper_kg=20.0)),
    ("calibrate_speed_mps", 0.2, calibrate({"speed_mps": 0.15})),
    ("calibrate_fault_speed_mps", 0.3, calibrate_then_move),
    ("calibrate_max_s", 60.0, calibrate({})),
    ("calibrate_confirm_s", 2.0, calibrate({}, seconds=1.0)),
    ("alarm_clear_s", 5.0, clears),
]


@pytest.mark.parametrize(
    ("name", "value", "observe"), CHANGES, ids=[f"{i}-{c[0]}" for i, c in enumerate(CHANGES)]
)
def test_a_changed_limit_changes_behaviour(working, name, value, observe):
    assert observe(working()) != observe(working(**{name: value}))


def test_no_limit_is_forgotten():
    assert {name for name, _, _ in CHANGES} == {f.name for f in fields(SafetyLimits)}


@pytest.mark.parametrize(
    ("name", "value", "cmd"),
    [
        ("shaft_min_rpm", 20.0, DriveCommand(15.0, 20.0)),
        ("shaft_max_rpm", 50.0, DriveCommand(60.0, 20.0)),
        ("opening_min_mm", 5.0, DriveCommand(50.0, 2.0)),
        ("opening_max_mm", 30.0, DriveCommand(50.0, 40.0)),
    ],
)
def test_a_changed_drive_limit_changes_the_command(name, value, cmd):
    assert limit_command(cmd, DriveLimits(), True) != limit_command(
        cmd, replace(DriveLimits(), **{name: value}), True
    )


def test_the_defaults_are_the_published_table():
    limits = SafetyLimits()
    assert (limits.start_speed_mps, limits.stop_speed_mps, limits.standstill_hold_s) == (
        0.5,
        0.3,
        10.0,
    )
    assert (limits.drive_silent_s, limits.gnss_silent_s, limits.gnss_silent_periods) == (
        0.5,
        0.5,
        2.5,
    )
    assert (limits.speed_silent_s, limits.wheel_silent_s, limits.wheel_fault_speed_mps) == (
        2.0,
        0.8,
        0.5,
    )
    assert (limits.ndvi_silent_s, limits.heads_min) == (2.0, 4)
    assert (limits.console_hold_s, limits.console_off_s) == (2.0, 60.0)
    assert (limits.rate_amber_percent, limits.rate_amber_s) == (10.0, 3.0)
    assert (limits.rate_red_percent, limits.rate_red_s, limits.rate_floor_kg_ha) == (
        20.0,
        2.0,
        50.0,
    )
    assert (limits.calibrate_speed_mps, limits.calibrate_fault_speed_mps) == (0.1, 0.2)
    assert (limits.calibrate_max_s, limits.calibrate_confirm_s) == (120.0, 0.5)
    assert limits.reverse_flip_deg == 120.0


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        (
            SafetyLimits,
            {"drive_silent_s": float("nan")},
            "drive_silent_s is nan; allowed is a finite number of at least 0",
        ),
        (
            SafetyLimits,
            {"ndvi_silent_s": -1.0},
            "ndvi_silent_s is -1.0; allowed is a finite number of at least 0",
        ),
        (
            SafetyLimits,
            {"stop_speed_mps": 0.6},
            "stop_speed_mps is 0.6; allowed is at most start_speed_mps, 0.5",
        ),
        (
            DriveLimits,
            {"opening_min_mm": 70.0},
            "opening_min_mm is 70.0; allowed is at most opening_max_mm, 60.0",
        ),
    ],
)
def test_senseless_limits_are_refused_in_one_line(kind, change, message):
    with pytest.raises(ValueError) as refused:
        kind(**change)
    assert str(refused.value) == message


# Limits in which machines differ: their files set them.
OF_MACHINES = {
    "hopper_low_kg",
    "hopper_empty_kg",
    "gate_off_mm",
    "supply_low_v",
    "shaft_off_percent",
    "trimmed_percent",
}


def test_a_machine_file_sets_the_limits_of_its_alarms():
    limits = Limits(gate_off_mm=4.0, trimmed_percent=8.0)
    made = SafetyLimits(**select_machine_limits(limits))
    assert (made.gate_off_mm, made.trimmed_percent, made.hopper_low_kg) == (4.0, 8.0, 15.0)
    assert OF_MACHINES == {f.name for f in fields(SafetyLimits)} & set(Limits.model_fields)
    nominal = SafetyLimits(**select_machine_limits(Limits()))
    assert nominal == SafetyLimits(hopper_low_kg=15.0)


def test_each_alarm_has_its_condition():
    assert set(alarm_conditions.CONDITIONS) == set(ALARMS)


def test_each_number_of_a_condition_is_a_limit():
    """No condition compares with a number of its own: 0 and 1 are none and all."""
    tree = ast.parse(Path(alarm_conditions.__file__).read_text(encoding="utf-8"))
    numbers = {
        side.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Compare)
        for side in (node.left, *node.comparators)
        if isinstance(side, ast.Constant) and isinstance(side.value, int | float)
    }
    assert numbers <= {0.0, 1.0}
