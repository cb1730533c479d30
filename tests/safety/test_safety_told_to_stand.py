"""Drives that do not stand though told to: seen in every state, and nothing that obeys is taken for it."""
from __future__ import annotations

from math import exp

import pytest

from control.orders import Do, State
from control.safety import Told

STANDS = Told(turn=False, flow=False, opening_mm=15.0)
BY_STATE = {State.OFF: (), State.READY: (Do.READY,), State.WORKING: (Do.READY, Do.START),
            State.HELD: (Do.READY, Do.START, Do.HOLD), State.CALIBRATING: (Do.READY, Do.CALIBRATE),
            State.FAULT: (Do.READY,)}


def brought_to(new_run, state, **standing):
    run = new_run()
    standing = {"speed_mps": 0.0, "told": STANDS, "shaft_rpm": 0.0} | standing
    run.tick(1.0, **standing)
    for do in BY_STATE[state]:
        assert run.order(do).accepted
        run.tick(0.1, **standing)
    if state is State.FAULT:
        run.tick(0.1, **standing, drive_fault=True)
    assert run.verdict.state is state
    return run, standing


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize(("alarm", "wrong"), [
    ("shaft_turns", {"shaft_rpm": 70.0}), ("gate_opens", {"opening_mm": 30.0}),
    ("valve_open", {"valves": (False, True)})])
def test_said_in_every_state_and_leaves_none_in_which_the_drives_have_power(new_run, state, alarm, wrong):
    told = STANDS._replace(enabled=state in (State.WORKING, State.HELD, State.CALIBRATING), valves=(False, False))
    run, standing = brought_to(new_run, state, told=told)
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
    run.tick(1.0, **(standing | {"told": Told(), "shaft_rpm": 100.0}))
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
    """Up to three seconds' time constant: the slowest that a machine file may have beside its own."""
    run, standing = turning_at_100(new_run)
    for k in range(200):
        after_s = k * run.period_s
        rpm = 100.0 * exp(-max(0.0, after_s - 0.4) / tau_s)
        if after_s >= 5.0 and rpm >= 2.0:
            break                           # longer than any run-down may last
        told = STANDS._replace(expected_rpm=0.0 if after_s > 0.9 else 50.0)
        run.tick(**(standing | {"shaft_rpm": rpm, "told": told}))
        assert run.alarm_ids() == [], after_s


def test_one_that_slows_down_for_ever_is_said_after_five_seconds(new_run):
    run, standing = turning_at_100(new_run)
    for k in range(140):
        run.tick(**(standing | {"shaft_rpm": 100.0 * 0.98 ** k}))
    assert "shaft_turns" in run.alarm_ids()


def test_a_gate_may_go_to_its_set_point_and_home_and_come_down(new_run):
    run, standing = brought_to(new_run, State.HELD)
    for mm in (15.0, 10.0, 0.0, 0.0, 8.0, 15.0, 16.0):
        run.tick(1.0, **(standing | {"opening_mm": mm}))
    assert run.alarm_ids() == []
    told = STANDS._replace(opening_mm=40.0)
    run.tick(3.0, **(standing | {"opening_mm": 40.0, "told": told}))
    assert run.alarm_ids() == []


def test_readings_that_are_too_old_accuse_nobody(new_run):
    run, standing = brought_to(new_run, State.OFF)
    run.tick(5.0, **(standing | {"shaft_rpm": 70.0, "shaft_age_s": 0.6}))
    assert run.alarm_ids() == []
