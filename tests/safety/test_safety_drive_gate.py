"""Nothing but finite numbers inside the limits reaches a drive."""

from __future__ import annotations

from math import exp, inf, isfinite, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st
from topdress.control.orders import Do, State
from topdress.control.readings import DoseOrder, DriveCommand
from topdress.control.safety import DriveLimits, PreviousCommands, limit_command, limit_dose

LIMITS = DriveLimits(
    shaft_min_rpm=10.0, shaft_max_rpm=90.0, opening_min_mm=5.0, opening_max_mm=50.0
)
ANY = st.floats(allow_nan=True, allow_infinity=True)


@given(ANY, ANY, st.booleans(), st.none() | ANY)
def test_any_number_comes_out_finite_and_inside(shaft_rpm, opening_mm, flow_allowed, now_mm):
    sent = limit_command(DriveCommand(shaft_rpm, opening_mm), LIMITS, flow_allowed, now_mm)
    assert isfinite(sent.shaft_rpm) and isfinite(sent.opening_mm)
    assert sent.shaft_rpm == 0.0 or LIMITS.shaft_min_rpm <= sent.shaft_rpm <= LIMITS.shaft_max_rpm
    assert LIMITS.opening_min_mm <= sent.opening_mm <= LIMITS.opening_max_mm
    if not (flow_allowed and isfinite(shaft_rpm) and isfinite(opening_mm)):
        assert sent.shaft_rpm == 0.0


@given(st.just(0.0) | st.floats(10.0, 90.0), st.floats(5.0, 50.0))
def test_a_command_inside_the_limits_is_not_touched(shaft_rpm, opening_mm):
    assert limit_command(DriveCommand(shaft_rpm, opening_mm), LIMITS, True) == DriveCommand(
        shaft_rpm, opening_mm
    )


@pytest.mark.parametrize(
    ("wanted_rpm", "sent_rpm"),
    [(-3.0, 0.0), (4.9, 0.0), (5.0, 10.0), (9.9, 10.0), (90.1, 90.0), (1e308, 90.0)],
)
def test_shaft_limits(wanted_rpm, sent_rpm):
    assert limit_command(DriveCommand(wanted_rpm, 20.0), LIMITS, True).shaft_rpm == sent_rpm


@pytest.mark.parametrize(
    "cmd", [DriveCommand(nan, 40.0), DriveCommand(50.0, inf), DriveCommand(nan, nan)]
)
def test_without_sense_the_shaft_stops_and_the_gate_stays(cmd):
    assert limit_command(cmd, LIMITS, True, opening_now_mm=22.0) == DriveCommand(0.0, 22.0)


def test_without_flow_the_shaft_stops_and_the_gate_stays():
    assert limit_command(
        DriveCommand(70.0, 40.0), LIMITS, False, opening_now_mm=22.0
    ) == DriveCommand(0.0, 22.0)
    assert limit_command(DriveCommand(70.0, 40.0), LIMITS, False) == DriveCommand(0.0, 40.0)


def test_a_gate_that_stands_nowhere_known_is_closed():
    closed = DriveCommand(0.0, LIMITS.opening_min_mm)
    assert limit_command(DriveCommand(70.0, nan), LIMITS, True) == closed
    assert limit_command(DriveCommand(70.0, nan), LIMITS, True, opening_now_mm=nan) == closed


@given(ANY, ANY, st.booleans())
def test_a_dose_comes_out_finite_and_inside_or_not_at_all(angle_deg, shaft_rpm, flow_allowed):
    sent = limit_dose(DoseOrder(angle_deg, shaft_rpm), LIMITS, flow_allowed)
    sensible = isfinite(angle_deg) and isfinite(shaft_rpm) and angle_deg > 0.0 and shaft_rpm > 0.0
    assert (sent is not None) == (flow_allowed and sensible)
    if sent is not None:
        assert 0.0 < sent.angle_deg <= 3600.0 and 10.0 <= sent.shaft_rpm <= 90.0


def test_a_dose_inside_the_limits_is_not_touched():
    assert limit_dose(DoseOrder(120.0, 70.0), LIMITS, True) == DoseOrder(120.0, 70.0)
    assert limit_dose(DoseOrder(120.0, 70.0), LIMITS, False) is None


# --- Drives that do not stand though told to: seen in every state, and nothing that obeys is
# taken for it ------------

STANDS = PreviousCommands(turn=False, flow=False, opening_mm=15.0)
BY_STATE = {
    State.OFF: (),
    State.READY: (Do.READY,),
    State.WORKING: (Do.READY, Do.START),
    State.HELD: (Do.READY, Do.START, Do.HOLD),
    State.CALIBRATING: (Do.READY, Do.CALIBRATE),
    State.FAULT: (Do.READY,),
}


def brought_to(new_run, state, **standing):
    run = new_run()
    standing = {"speed_mps": 0.0, "commanded": STANDS, "shaft_rpm": 0.0} | standing
    run.tick(1.0, **standing)
    for do in BY_STATE[state]:
        assert run.order(do).accepted
        run.tick(0.1, **standing)
    if state is State.FAULT:
        run.tick(0.1, **standing, drive_fault=True)
    assert run.verdict.state is state
    return run, standing


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize(
    ("alarm", "wrong"),
    [
        ("shaft_turns", {"shaft_rpm": 70.0}),
        ("gate_opens", {"opening_mm": 30.0}),
        ("valve_open", {"valves": (False, True)}),
    ],
)
def test_said_in_every_state_and_leaves_none_in_which_the_drives_have_power(
    new_run, state, alarm, wrong
):
    commanded = STANDS._replace(
        enabled=state in (State.WORKING, State.HELD, State.CALIBRATING), valves=(False, False)
    )
    run, standing = brought_to(new_run, state, commanded=commanded)
    for _ in range(100):
        if run.safety.state is State.CALIBRATING:
            run.order(Do.CALIBRATE)
        run.tick(**(standing | wrong))
    assert alarm in run.alarm_ids()
    assert not run.verdict.flow_allowed or alarm == "valve_open"
    if state is not State.OFF and alarm != "valve_open":
        assert run.verdict.state is State.FAULT
    if state is State.OFF and alarm == "shaft_turns":
        assert run.order(Do.READY).why == "cause_lives;alarm=shaft_turns"


def turning_at_100(new_run):
    run, standing = brought_to(new_run, State.READY)
    run.tick(1.0, **(standing | {"commanded": PreviousCommands(), "shaft_rpm": 100.0}))
    return run, standing


def test_it_stays_until_somebody_has_seen_it(new_run):
    run, standing = brought_to(new_run, State.READY)
    run.tick(3.0, **(standing | {"shaft_rpm": 70.0}))
    run.tick(30.0, **standing)
    assert run.alarm_ids()[0] == "shaft_turns"
    assert run.order(Do.READY).accepted and not run.order(Do.START).accepted
    assert run.order(Do.ACKNOWLEDGE).accepted and run.order(Do.START).accepted


@pytest.mark.parametrize("tau_s", [0.05, 0.5, 1.5, 3.0])
def test_a_shaft_that_runs_down_is_none(new_run, tau_s):
    """Up to three seconds' time constant: the slowest that a machine file may have beside its
    own."""
    run, standing = turning_at_100(new_run)
    for k in range(200):
        after_s = k * run.period_s
        rpm = 100.0 * exp(-max(0.0, after_s - 0.4) / tau_s)
        if after_s >= 5.0 and rpm >= 2.0:
            break  # longer than any run-down may last
        commanded = STANDS._replace(expected_rpm=0.0 if after_s > 0.9 else 50.0)
        run.tick(**(standing | {"shaft_rpm": rpm, "commanded": commanded}))
        assert run.alarm_ids() == [], after_s


def test_one_that_is_stopped_within_its_dead_time_turns_up_and_down_again(new_run):
    """A quarter of a second later than the machine model has it: no reading is below the first
    one until it stands."""
    run, standing = turning_at_100(new_run)
    run.tick(1.0, **(standing | {"commanded": PreviousCommands(), "shaft_rpm": 0.0}))
    for k in range(60):
        after_s = k * run.period_s

        def turns(at_s: float) -> float:
            return max(0.0, min(200.0 * (at_s - 0.1), 200.0 * (0.9 - at_s)))

        commanded = STANDS._replace(expected_rpm=turns(after_s + 0.25))
        run.tick(**(standing | {"shaft_rpm": turns(after_s), "commanded": commanded}))
        assert run.alarm_ids() == [], after_s


def test_one_that_slows_down_for_ever_is_said_after_five_seconds(new_run):
    run, standing = turning_at_100(new_run)
    for k in range(140):
        run.tick(**(standing | {"shaft_rpm": 100.0 * 0.98**k}))
    assert "shaft_turns" in run.alarm_ids()


def test_a_gate_may_go_to_its_set_point_and_home_and_come_down(new_run):
    run, standing = brought_to(new_run, State.HELD)
    for mm in (15.0, 10.0, 0.0, 0.0, 8.0, 15.0, 16.0):
        run.tick(1.0, **(standing | {"opening_mm": mm}))
    assert run.alarm_ids() == []
    commanded = STANDS._replace(opening_mm=40.0)
    run.tick(3.0, **(standing | {"opening_mm": 40.0, "commanded": commanded}))
    assert run.alarm_ids() == []


def test_readings_that_are_too_old_accuse_nobody(new_run):
    run, standing = brought_to(new_run, State.OFF)
    run.tick(5.0, **(standing | {"shaft_rpm": 70.0, "shaft_age_s": 0.6}))
    assert run.alarm_ids() == []
