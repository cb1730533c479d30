"""The list of alarms, how each is raised, latched, acknowledged and gone."""

from __future__ import annotations

import json
from math import inf, nan
from string import Formatter

import numpy as np
import pytest
from topdress.control.orders import Do, Severity, State, TargetSource
from topdress.control.readings import (
    EffortFinding,
    RangeBreach,
    RefusedSpeed,
    ScaleFinding,
    SpeedDoubt,
)
from topdress.control.safety import ALARMS, INTERLOCKS, REFUSALS, STATE_REASONS, PreviousCommands

from tests.safety.steps import NEVER, order, play, tick

MAP, POINT, MANUAL = TargetSource.MAP, TargetSource.POINT, TargetSource.MANUAL

# alarm, what brings it about, seconds before which it is not there, seconds by which it is,
# state then
STANDS = PreviousCommands(turn=False, flow=False, opening_mm=15.0)
TURNS = PreviousCommands(shaft_rpm=70.0, expected_rpm=70.0, opening_mm=15.0, expected_mm=15.0)
DOUBT = SpeedDoubt(RefusedSpeed.WHEEL, 100.0, 100.0, 2.5, 1.25, 1.0)
OPEN = DOUBT._replace(refused=RefusedSpeed.EITHER)
ABOVE_RANGE = RangeBreach(True, 480.0, 413.0, 4.8)
BELOW_RANGE = RangeBreach(False, 12.0, 23.0, 1.6)
SHUT = STANDS._replace(valves=(False, False))
RAISED = [
    ("shaft_turns", {"commanded": STANDS}, 0.45, 0.6, State.FAULT),
    ("shaft_turns", {"commanded": STANDS, "shaft_rpm": 2.5}, 0.45, 0.6, State.FAULT),
    ("shaft_far_off", {"commanded": TURNS, "shaft_rpm": 85.0}, 1.9, 2.1, State.FAULT),
    ("shaft_far_off", {"commanded": TURNS, "shaft_rpm": 0.0}, 1.9, 2.1, State.FAULT),
    (
        "shaft_far_off",
        {"commanded": TURNS._replace(shaft_rpm=20.0), "shaft_rpm": 100.0},
        1.9,
        2.1,
        State.FAULT,
    ),
    ("gate_far_off", {"commanded": TURNS, "opening_mm": 18.5}, 1.9, 2.1, State.FAULT),
    ("gate_far_off", {"commanded": TURNS, "opening_mm": 0.0}, 1.9, 2.1, State.FAULT),
    ("shaft_off", {"commanded": TURNS, "shaft_rpm": 66.4}, 9.9, 10.1, State.WORKING),
    ("gate_off", {"commanded": TURNS, "opening_mm": 17.0}, 1.9, 2.1, State.WORKING),
    ("gate_off", {"commanded": TURNS, "opening_mm": 13.0}, 1.9, 2.1, State.WORKING),
    (
        "valve_open",
        {"commanded": SHUT, "shaft_rpm": 0.0, "valves": (False, True)},
        3.4,
        3.6,
        State.HELD,
    ),
    ("heads_full", {"ndvi": 0.99}, 1.9, 2.1, State.WORKING),
    ("shaft_silent", {"shaft_age_s": 0.51}, 0.0, 0.05, State.FAULT),
    ("gate_silent", {"gate_age_s": 0.51}, 0.0, 0.05, State.FAULT),
    ("drive_fault", {"drive_fault": True}, 0.0, 0.05, State.FAULT),
    ("drive_stopped", {"drive_stopped": True}, 0.0, 0.05, State.FAULT),
    ("hopper_empty", {"hopper_kg": 0.3}, 0.9, 1.1, State.HELD),
    ("flow_unordered", {"scale": ScaleFinding(unordered_kg=0.9)}, 0.0, 0.05, State.FAULT),
    ("flow_missing", {"scale": ScaleFinding(share=0.3)}, 0.0, 0.05, State.HELD),
    ("flow_above", {"scale": ScaleFinding(share=2.0)}, 0.0, 0.05, State.HELD),
    ("outlet_blocked", {"scale": ScaleFinding(outlets=1, of_outlets=6)}, 0.0, 0.05, State.WORKING),
    ("flow_disagrees", {"scale": ScaleFinding(beyond_percent=-30.0)}, 0.0, 0.05, State.WORKING),
    ("flow_below", {"scale": ScaleFinding(below_percent=16.0)}, 0.0, 0.05, State.WORKING),
    ("flow_trimmed", {"scale": ScaleFinding(trimmed_percent=-5.1)}, 0.0, 0.05, State.WORKING),
    ("effort_high", {"effort": EffortFinding(harder_percent=12.0)}, 0.0, 0.05, State.WORKING),
    ("effort_low", {"effort": EffortFinding(unloaded=True)}, 0.0, 0.05, State.WORKING),
    ("scale_unexplained", {"scale": ScaleFinding(off_kg=-0.9)}, 0.0, 0.05, State.WORKING),
    ("refill_disagrees", {"scale": ScaleFinding(refill_percent=-30.0)}, 0.0, 0.05, State.WORKING),
    (
        "rate_above_limit",
        {"applied_rate_kg_ha": 1100.0, "expected_rate_kg_ha": None},
        0.9,
        1.1,
        State.HELD,
    ),
    ("speed_silent", {"speed_used_mps": None}, 1.9, 2.1, State.HELD),
    ("console_silent", {"console_age_s": 2.1}, 0.0, 0.05, State.HELD),
    ("log_failed", {"log_ok": False}, 0.0, 0.05, State.WORKING),
    ("control_failed", {"control_failed": True}, 0.0, 0.05, State.WORKING),
    ("old_orders", {"old_orders": True}, 0.0, 0.05, State.WORKING),
    ("log_cut", {"log_cut": "run-2.csv"}, 0.0, 0.05, State.WORKING),
    ("device_aside", {"put_aside": ("gnss", "head_2")}, 0.0, 0.05, State.WORKING),
    ("position_lost", {"target_source": MAP, "position_ok": False}, 0.0, 0.05, State.WORKING),
    ("position_lost", {"target_source": POINT, "position_ok": False}, 0.0, 0.05, State.WORKING),
    (
        "position_lost",
        {"target_source": TargetSource.MAP_AND_CANOPY, "position_ok": False},
        0.0,
        0.05,
        State.WORKING,
    ),
    ("wheel_fault", {"wheel_mps": 0.0, "gnss_mps": 0.55}, 0.4, 0.6, State.WORKING),
    ("target_refused", {"target_rate_kg_ha": nan}, 0.0, 0.05, State.WORKING),
    ("target_cut", {"cut_from_kg_ha": 1000.0}, 0.0, 0.05, State.WORKING),
    ("target_silent", {"silent_rate_kg_ha": 0.0}, 0.0, 0.05, State.WORKING),
    ("rate_above_range", {"range_breach": ABOVE_RANGE}, 2.9, 3.1, State.WORKING),
    ("rate_below_range", {"range_breach": BELOW_RANGE}, 2.9, 3.1, State.WORKING),
    ("rate_far_off", {"applied_rate_kg_ha": 365.0}, 1.9, 2.1, State.WORKING),
    ("rate_far_off", {"applied_rate_kg_ha": 235.0}, 1.9, 2.1, State.WORKING),
    ("rate_off", {"applied_rate_kg_ha": 335.0}, 2.9, 3.1, State.WORKING),
    (
        "rate_off",
        {"applied_rate_kg_ha": 26.0, "expected_rate_kg_ha": 20.0, "target_rate_kg_ha": 20.0},
        2.9,
        3.1,
        State.WORKING,
    ),
    ("wheel_too_much", {"speed_doubt": DOUBT}, 0.0, 0.05, State.WORKING),
    ("wheel_too_little", {"speed_doubt": DOUBT._replace(wheel_mps=0.6)}, 0.0, 0.05, State.WORKING),
    (
        "gnss_speed_wrong",
        {"speed_doubt": DOUBT._replace(refused=RefusedSpeed.GNSS)},
        0.0,
        0.05,
        State.WORKING,
    ),
    ("speeds_differ", {"speed_doubt": OPEN._replace(differed_s=106.0)}, 0.0, 0.05, State.HELD),
    ("gnss_silent", {"gnss_age_s": 0.55}, 0.0, 0.05, State.WORKING),
    ("gnss_silent", {"gnss_age_s": 2.6, "gnss_period_s": 1.0}, 0.0, 0.05, State.WORKING),
    ("gnss_silent", {"fix_quality": 0}, 0.0, 0.05, State.WORKING),
    ("position_jumped", {"position_refused_m": 1000.0}, 0.0, 0.05, State.WORKING),
    ("position_jumped", {"position_refused_m": inf}, 0.0, 0.05, State.WORKING),
    (
        "position_walks",
        {"position_refused_m": 4.0, "position_walks": True},
        0.0,
        0.05,
        State.WORKING,
    ),
    ("ndvi_silent", {"ndvi_age_s": 2.1}, 0.0, 0.05, State.WORKING),
    ("ndvi_silent", {"ndvi_age_s": None}, 1.3, 1.6, State.WORKING),
    ("ndvi_silent", {"ndvi_age_s": nan}, 0.0, 0.05, State.WORKING),
    ("heads_by_map", {"ndvi_age_s": 2.1, "by_index_map": True}, 0.0, 0.05, State.WORKING),
    ("heads_few", {"valid_heads": 3}, 0.0, 0.05, State.WORKING),
    ("supply_low", {"supply_v": 11.0}, 4.9, 5.1, State.WORKING),
    ("hopper_low", {"hopper_kg": 29.0}, 0.9, 1.1, State.WORKING),
    ("lead_short", {"usable_speed_mps": 2.04}, 0.0, 0.05, State.WORKING),
    ("scale_silent", {"scale_age_s": 2.1}, 0.0, 0.05, State.WORKING),
]
SILENT = [
    ("gnss_silent", {"gnss_age_s": 0.45}),
    ("gnss_silent", {"gnss_age_s": 2.4, "gnss_period_s": 1.0}),
    ("ndvi_silent", {"ndvi_age_s": 1.9}),
    ("ndvi_silent", {"ndvi_age_s": None, "target_source": MANUAL}),
    ("heads_few", {"valid_heads": 4}),
    ("heads_few", {"valid_heads": None}),
    ("heads_few", {"valid_heads": 2, "target_source": MAP}),
    ("position_lost", {"target_source": MANUAL, "position_ok": False}),
    ("wheel_fault", {"wheel_mps": 0.0, "gnss_mps": 0.45}),
    ("rate_off", {"applied_rate_kg_ha": 329.0}),
    ("rate_off", {"applied_rate_kg_ha": None}),
    (
        "rate_off",
        {"applied_rate_kg_ha": 24.0, "expected_rate_kg_ha": 20.0, "target_rate_kg_ha": 20.0},
    ),
    ("rate_far_off", {"applied_rate_kg_ha": 359.0}),
    ("hopper_low", {"hopper_kg": 31.0}),
    ("supply_low", {"supply_v": 11.6}),
    ("supply_low", {"supply_v": 11.0, "supply_age_s": 2.1}),
    ("shaft_turns", {"commanded": STANDS, "shaft_rpm": 1.9}),
    ("shaft_turns", {"commanded": STANDS._replace(turn=True)}),
    ("gate_opens", {"commanded": STANDS, "shaft_rpm": 0.0, "opening_mm": 17.9}),
    ("gate_opens", {"commanded": STANDS._replace(flow=True), "shaft_rpm": 0.0, "opening_mm": 40.0}),
    (
        "gate_opens",
        {"commanded": STANDS._replace(opening_mm=40.0), "shaft_rpm": 0.0, "opening_mm": 40.0},
    ),
    ("speeds_differ", {"speed_doubt": OPEN._replace(differed_s=105.9)}),
    (
        "wheel_fault",
        {
            "speed_doubt": DOUBT._replace(refused=RefusedSpeed.GNSS),
            "wheel_mps": 0.0,
            "gnss_mps": 0.9,
        },
    ),
    ("shaft_far_off", {"commanded": TURNS, "shaft_rpm": 83.0}),
    ("shaft_far_off", {"commanded": TURNS, "shaft_rpm": 57.0}),
    # it slows down
    ("shaft_far_off", {"commanded": TURNS._replace(shaft_rpm=20.0), "shaft_rpm": 65.0}),
    # a dose, or a stop
    ("shaft_far_off", {"commanded": TURNS._replace(shaft_rpm=0.0), "shaft_rpm": 0.0}),
    ("shaft_off", {"commanded": TURNS, "shaft_rpm": 66.6}),
    ("gate_far_off", {"commanded": TURNS, "opening_mm": 17.9}),
    ("gate_off", {"commanded": TURNS, "opening_mm": 16.4}),
    ("gate_off", {"commanded": TURNS._replace(shaft_rpm=0.0), "opening_mm": 25.0}),
    (
        "valve_open",
        {
            "commanded": STANDS._replace(valves=(False, True)),
            "shaft_rpm": 0.0,
            "valves": (False, True),
        },
    ),
    ("heads_full", {"ndvi": 0.93}),
    ("hopper_empty", {"hopper_kg": 0.6}),
    ("console_silent", {"console_age_s": None}),
]


@pytest.mark.parametrize(("alarm", "changes", "not_before_s", "by_s", "state"), RAISED)
def test_raised_in_time_and_not_before(working, alarm, changes, not_before_s, by_s, state):
    run = working()
    if not_before_s:
        run.tick(not_before_s, **changes)
        assert alarm not in run.alarm_ids()
        run.tick(by_s - not_before_s, **changes)
    else:
        run.tick(by_s, **changes)
    assert alarm in run.alarm_ids()
    assert run.verdict.state is state


@pytest.mark.parametrize(("alarm", "changes"), SILENT)
def test_not_raised_inside_the_limit(working, alarm, changes):
    run = working()
    run.tick(5.0, **changes)
    assert alarm not in run.alarm_ids()


def test_every_alarm_of_the_list_is_raised_by_a_test():
    elsewhere = {"calibration_moved", "gate_opens"}
    assert {row[0] for row in RAISED} | elsewhere == set(ALARMS)


def test_nothing_is_raised_while_all_is_well(working):
    assert working().tick(60.0).alarms == ()


def test_the_list_is_whole():
    for alarm_id, kind in ALARMS.items():
        assert kind.id == alarm_id
        assert kind.text and kind.todo and kind.place
        assert kind.leads_to in (None, State.HELD, State.FAULT)
        assert kind.leads_to is None or kind.severity is Severity.RED
    assert not set(STATE_REASONS) & set(ALARMS)
    for sentence in (*INTERLOCKS.values(), *STATE_REASONS.values(), *REFUSALS.values()):
        assert sentence.endswith(".")


@pytest.mark.parametrize("odd", [None, inf, nan, 1234.0])
def test_texts_can_be_filled_and_sent_whatever_the_numbers(working, odd):
    run = working()
    run.tick(
        5.0,
        hopper_kg=25.0,
        valid_heads=1,
        usable_speed_mps=odd,
        metres_left_m=odd,
        applied_rate_kg_ha=inf if odd is None else 2e3,
    )
    for alarm in run.verdict.alarms:
        details = dict(alarm.details)
        wanted = {name for _, name, _, _ in Formatter().parse(ALARMS[alarm.id].text) if name}
        assert wanted <= set(details)
        assert ALARMS[alarm.id].text.format(**details)
        ALARMS[alarm.id].todo.format(**details)
    json.dumps(run.verdict.alarms, allow_nan=False)
    assert {"hopper_low", "heads_few"} <= set(run.alarm_ids())


def test_metres_left_and_usable_speed_are_told(working):
    run = working()
    run.tick(2.0, hopper_kg=25.0, metres_left_m=1234.0, usable_speed_mps=1.1234)
    commanded = {a.id: dict(a.details) for a in run.verdict.alarms}
    assert commanded == {
        "hopper_low": {"hopper_kg": 25, "metres_left": 1230},
        "lead_short": {"usable_speed_mps": 1.1},
    }


NOTHING_HEARD = {"gnss_age_s": NEVER, "ndvi_age_s": None, "valid_heads": 0, "heads_heard": 0}
FEW, LOW = {"valid_heads": 2}, {"hopper_kg": 20.0}
TOO_MUCH = {"applied_rate_kg_ha": 400.0}

# From work on.
STANDING = {
    "red latches until acknowledged and amber does not": (
        tick(1.0, log_ok=False, **FEW),
        tick(60.0, alarms=("log_failed",)),
        order(Do.ACKNOWLEDGE, "log_failed"),
        tick(alarms=()),
    ),
    "worst first": (
        tick(2.0, **LOW, **FEW),
        tick(log_ok=False, **FEW, **LOW, target_source=TargetSource.CANOPY),
        tick(
            shaft_age_s=1.0,
            **FEW,
            **LOW,
            alarms=("shaft_silent", "log_failed", "heads_few", "hopper_low"),
        ),
    ),
    "acknowledging what is not there is refused": (
        order(Do.ACKNOWLEDGE, "rate_off", refused="no_such_alarm;alarm=rate_off"),
    ),
    "STOP keeps a red alarm that nobody has seen": (
        tick(shaft_age_s=1.0),
        order(Do.STOP),
        tick(10.0, alarms=("shaft_silent",)),
    ),
    "rate: an excess must last without a break": (
        *(tick(1.9, **TOO_MUCH), tick()) * 20,
        tick(alarms=()),
    ),
    "rate: a stop of flow begins the count anew": (
        tick(1.9, **TOO_MUCH),
        tick(0.1, **TOO_MUCH, landing_inside=False),
        tick(1.9, **TOO_MUCH, alarms=()),
    ),
    "rate: not judged without flow": (
        tick(60.0, applied_rate_kg_ha=0.0, landing_inside=False, alarms=()),
    ),
    "rate: a red one does not show an amber one too": (
        tick(5.0, **TOO_MUCH, alarms=("rate_far_off",)),
    ),
    "hopper low: a refill ends it": (
        tick(2.0, hopper_kg=25.0),
        tick(2.0, hopper_kg=250.0, alarms=()),
    ),
}
# From the very start on.
NEW = {
    "a machine without a scale raises no scale alarm": (
        order(Do.READY),
        order(Do.START),
        tick(30.0, scale_age_s=NEVER, alarms=()),
    ),
    "what was never heard has two seconds after off to speak up": (
        order(Do.READY),
        tick(1.9, **NOTHING_HEARD, alarms=()),
        tick(0.2, **NOTHING_HEARD, alarms=("gnss_silent", "ndvi_silent", "heads_few")),
    ),
    "few heads are told at once where all have spoken": (
        order(Do.READY),
        tick(valid_heads=3, heads_heard=6, alarms=("heads_few",)),
    ),
}


@pytest.mark.parametrize("name", STANDING)
def test_what_stands_and_what_goes(working, name):
    play(working(), STANDING[name])


@pytest.mark.parametrize("name", NEW)
def test_what_is_said_of_a_new_start(new_run, name):
    play(new_run(), NEW[name])


def test_acknowledged_red_stays_while_its_cause_does(working):
    run = working()
    run.tick(1.0, log_ok=False)
    since_s = run.verdict.alarms[0].since_s
    run.order(Do.ACKNOWLEDGE, "")
    run.tick(5.0, log_ok=False)
    (alarm,) = run.verdict.alarms
    assert (alarm.acknowledged, alarm.since_s) == (True, since_s)
    run.tick(1.1)
    assert run.alarm_ids() == []
    run.tick(log_ok=False)
    assert not run.verdict.alarms[0].acknowledged, "a new occurrence is a new alarm"


class TestRate:
    @pytest.mark.exam
    def test_a_day_of_one_second_grades_raises_none(self, working):
        """Rates step every second over the eleven grades; applied follows with the shaft's
        nominal lag, 2 % noise."""
        grades = np.array([0, 0, 60, 110, 160, 210, 260, 300, 340, 366, 380], dtype=float)
        rng = np.random.default_rng(4)
        run, applied, expected, steps_s = working(), 300.0, 300.0, 1200
        noise = 1.0 + 0.02 * rng.standard_normal((steps_s, 20))
        for second, target in enumerate(rng.choice(grades, steps_s)):
            for k in range(20):
                wanted = float(target) if k >= 8 else expected
                expected += (wanted - expected) * 0.63
                applied = expected * float(noise[second, k])
                run.tick(
                    target_rate_kg_ha=float(target),
                    expected_rate_kg_ha=expected,
                    applied_rate_kg_ha=applied,
                )
                assert run.alarm_ids() == []

    @pytest.mark.parametrize(
        ("true_percent", "alarm"), [(14.0, "rate_off"), (25.0, "rate_far_off")]
    )
    def test_errors_clear_of_the_threshold_are_found_through_noise(
        self, working, true_percent, alarm
    ):
        rng, run = np.random.default_rng(7), working()
        delays = []
        for _ in range(20):
            run.tick(2.0)
            run.order(Do.ACKNOWLEDGE)
            begun_s = run.now_s
            while alarm not in run.alarm_ids() and run.now_s - begun_s < 30.0:
                run.tick(
                    applied_rate_kg_ha=300.0
                    * (1 + true_percent / 100 + 0.015 * float(rng.standard_normal()))
                )
            delays.append(run.now_s - begun_s)
        assert np.median(delays) < 6.0


def test_hopper_low_does_not_flicker_at_its_limit(working):
    """The hopper empties past the limit at 0.05 kg/s under 0.15 kg of noise: one alarm, not
    many."""
    rng, run, noise, changes, live = np.random.default_rng(2), working(), 0.0, 0, False
    for k in range(4000):
        noise = 0.95 * noise + 0.15 * (1 - 0.95**2) ** 0.5 * float(rng.standard_normal())
        run.tick(hopper_kg=32.0 - 0.05 * 0.05 * k + noise)
        changes += live is not ("hopper_low" in run.alarm_ids())
        live = "hopper_low" in run.alarm_ids()
    assert live and changes == 1


# --- What the scale says becomes alarms and states, whatever it says; what it says is tested in
# `test_scale_watch.py`.


@pytest.mark.parametrize(("share", "alarm"), [(0.1, "flow_missing"), (2.0, "flow_above")])
def test_flow_far_from_what_the_shaft_reads_holds_until_it_is_acknowledged(working, share, alarm):
    run = working()
    run.tick(scale=ScaleFinding(share=share))
    assert (run.verdict.state, run.verdict.why_state) == (State.HELD, alarm)
    assert not run.verdict.flow_allowed
    assert run.order(Do.START).why == f"acknowledge_first;alarm={alarm}"
    run.order(Do.ACKNOWLEDGE)
    assert run.order(Do.START).accepted
    assert run.tick(1.0).flow_allowed


@pytest.mark.parametrize(
    "states", [(), (Do.READY,), (Do.READY, Do.START), (Do.READY, Do.START, Do.HOLD)]
)
def test_material_that_nobody_ordered_is_red_in_every_state(new_run, states):
    run = new_run()
    run.tick()
    for do in states:
        assert run.order(do).accepted
        run.tick()
    run.tick(scale=ScaleFinding(unordered_kg=0.9))
    assert "flow_unordered" in run.alarm_ids()
    assert run.verdict.state is (State.FAULT if states else State.OFF)
    assert run.order(Do.READY).why == "cause_lives;alarm=flow_unordered"


def test_what_is_only_asked_lets_the_work_go_on(working):
    run = working()
    for says in (
        ScaleFinding(outlets=1, of_outlets=6),
        ScaleFinding(below_percent=16.0),
        ScaleFinding(beyond_percent=30.0),
        ScaleFinding(off_kg=1.0),
    ):
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
    (alarm,) = (one for one in run.verdict.alarms if one.id == "hopper_empty")
    assert alarm.gone_s is None
    run.order(Do.ACKNOWLEDGE)
    for _again in range(30):
        run.tick(0.1, hopper_kg=0.4)
    assert "hopper_empty" in run.alarm_ids(), "an acknowledged one, too"
    for _again in range(30):
        run.tick(0.1, hopper_kg=200.0)
    assert "hopper_empty" not in run.alarm_ids()


@pytest.mark.parametrize("had_set_point", [False, True])
def test_a_gate_that_has_moved_without_power_refuses_ready_until_it_stands(new_run, had_set_point):
    """Without power it stays where it is, and only READY gives it a set-point again: READY was
    refused until the program's end."""
    run, stands = new_run(), {"commanded": STANDS._replace(enabled=False), "shaft_rpm": 0.0}
    if had_set_point:
        run.tick(1.0, opening_mm=15.0, shaft_rpm=0.0, commanded=STANDS)
    run.tick(2.0, opening_mm=15.0, **stands)
    for step in range(30):
        run.tick(0.2, opening_mm=15.0 + step, **stands)
    assert "gate_opens" in run.alarm_ids()
    assert run.order(Do.READY).why.startswith("cause_lives")
    run.tick(5.5, opening_mm=44.0, **stands)
    assert "gate_opens" in run.alarm_ids(), "red until it is acknowledged"
    run.order(Do.ACKNOWLEDGE, "")
    run.tick(2.0, opening_mm=44.0, **stands)
    assert "gate_opens" not in run.alarm_ids()
    assert run.order(Do.READY).accepted
    run.tick(2.0, opening_mm=48.0, **stands)
    assert "gate_opens" in run.alarm_ids()
