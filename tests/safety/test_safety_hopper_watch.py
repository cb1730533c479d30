"""What the scale says becomes alarms and states, whatever it says; what it says is tested in `test_scale_watch.py`."""
from __future__ import annotations

import pytest

from control.orders import Do, State
from control.readings import ScaleSays


@pytest.mark.parametrize(("share", "alarm"), [(0.1, "flow_missing"), (2.0, "flow_above")])
def test_flow_far_from_what_the_shaft_reads_holds_until_it_is_acknowledged(working, share, alarm):
    run = working()
    run.tick(scale=ScaleSays(share=share))
    assert (run.verdict.state, run.verdict.why_state) == (State.HELD, alarm)
    assert not run.verdict.flow_allowed
    assert run.order(Do.START).why == f"acknowledge_first;alarm={alarm}"
    run.order(Do.ACKNOWLEDGE)
    assert run.order(Do.START).accepted
    assert run.tick(1.0).flow_allowed


@pytest.mark.parametrize("states", [(), (Do.READY,), (Do.READY, Do.START), (Do.READY, Do.START, Do.HOLD)])
def test_material_that_nobody_ordered_is_red_in_every_state(new_run, states):
    run = new_run()
    run.tick()
    for do in states:
        assert run.order(do).accepted
        run.tick()
    run.tick(scale=ScaleSays(unordered_kg=0.9))
    assert "flow_unordered" in run.alarm_ids()
    assert run.verdict.state is (State.FAULT if states else State.OFF)
    assert run.order(Do.READY).why == "cause_lives;alarm=flow_unordered"


def test_what_is_only_asked_lets_the_work_go_on(working):
    run = working()
    for says in (ScaleSays(outlets=1, of_outlets=6), ScaleSays(beyond_percent=30.0), ScaleSays(off_kg=1.0)):
        assert run.tick(scale=says).flow_allowed


@pytest.mark.parametrize("value", [0.0, -5.0, True, "much", None, float("nan")])
def test_odd_refills_are_refused(working, value):
    assert working().order(Do.REFILL, value).why == "refill_kg"


def test_an_empty_hopper_stays_empty_while_it_is_held_and_the_scale_rustles(working):
    """It read "cause gone" from the moment that the machine was held."""
    run = working()
    for _again in range(15):
        run.tick(0.1, hopper_kg=0.3)
    assert run.verdict.state is State.HELD
    for kg in (0.6, 0.4, 0.7, 0.3) * 10:
        run.tick(0.1, hopper_kg=kg)
    alarm, = (one for one in run.verdict.alarms if one.id == "hopper_empty")
    assert alarm.gone_s is None
    run.order(Do.ACKNOWLEDGE)
    for _again in range(30):
        run.tick(0.1, hopper_kg=0.4)
    assert "hopper_empty" in run.alarm_ids(), "an acknowledged one, too"
    for _again in range(30):
        run.tick(0.1, hopper_kg=200.0)
    assert "hopper_empty" not in run.alarm_ids()
