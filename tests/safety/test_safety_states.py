"""The states: which orders and which losses move between them."""

from __future__ import annotations

from math import nan

import pytest
from topdress.control.orders import Do, State
from topdress.control.safety import REFUSALS, read_refusal

from tests.safety.steps import NEVER, order, play, tick

DRIVES = ("shaft", "gate")


def in_state(state, new_run, working, calibrating):
    if state in (State.OFF, State.READY):
        run = new_run()
        if state is State.READY:
            run.order(Do.READY)
        run.tick()
        return run
    if state is State.CALIBRATING:
        return calibrating()
    run = working()
    if state is State.HELD:
        run.order(Do.HOLD)
    if state is State.FAULT:
        run.tick(shaft_age_s=0.6)
        run.tick()
        run.order(Do.ACKNOWLEDGE)
    assert run.safety.state is state
    return run


ALLOWED = {
    (State.OFF, Do.READY): State.READY,
    (State.HELD, Do.READY): State.READY,
    (State.FAULT, Do.READY): State.READY,
    (State.READY, Do.READY): State.READY,
    (State.READY, Do.START): State.WORKING,
    (State.HELD, Do.START): State.WORKING,
    (State.WORKING, Do.START): State.WORKING,
    (State.WORKING, Do.HOLD): State.HELD,
    (State.HELD, Do.HOLD): State.HELD,
    (State.CALIBRATING, Do.HOLD): State.READY,
    (State.CALIBRATING, Do.RELEASE): State.READY,
    (State.CALIBRATING, Do.CALIBRATE): State.CALIBRATING,
    **{(state, Do.STOP): State.OFF for state in State},
    **{(state, Do.RELEASE): state for state in State if state is not State.CALIBRATING},
}


@pytest.mark.parametrize("do", [Do.READY, Do.START, Do.HOLD, Do.STOP, Do.CALIBRATE, Do.RELEASE])
@pytest.mark.parametrize("state", list(State))
def test_the_table_of_orders(state, do, new_run, working, calibrating):
    run = in_state(state, new_run, working, calibrating)
    answer = run.order(do)
    assert answer.accepted is ((state, do) in ALLOWED)
    assert run.safety.state is ALLOWED.get((state, do), state)
    if not answer.accepted:
        message_id, details = read_refusal(answer.why)
        assert REFUSALS[message_id].format(**details)


def test_an_order_of_another_room_is_refused(working):
    assert working().order(Do.NUDGE, 5.0).why == "not_for_safety"


@pytest.mark.parametrize(
    "do", [Do.ALLOW_REVERSE, Do.ALLOW_OUTSIDE, Do.GO_ON_UNLOGGED, Do.ALLOW_NO_WHEEL]
)
@pytest.mark.parametrize("value", ["yes", 1.0, 1, None])
def test_an_allowance_is_yes_or_no_and_nothing_like_it(working, do, value):
    run = working()
    run.tick(log_ok=False)
    assert run.order(do, value).why == "yes_or_no"
    assert not any(run.safety.memory.allow)


OFF, READY, WORKING, HELD, FAULT = State.OFF, State.READY, State.WORKING, State.HELD, State.FAULT
NO_SPEED, OLD_SPEEDS = {"speed_used_mps": None}, {"gnss_age_s": 2.1, "wheel_age_s": 2.1}

# From work on.
AT_WORK = {
    "ten seconds at standstill hold, and driving on does not leave held": (
        tick(9.9, speed_mps=0.0, state=WORKING),
        tick(0.2, speed_mps=0.0, state=HELD, why_state="standstill"),
        tick(5.0, state=HELD),
        order(Do.START),
        tick(flows=True),
    ),
    "console: two seconds of silence hold and sixty switch off": (
        tick(console_age_s=1.9, flows=True),
        tick(console_age_s=2.1, state=HELD, why_state="console_silent"),
        tick(console_age_s=59.9, state=HELD),
        tick(console_age_s=60.1, state=OFF, why_state="console_gone"),
    ),
    "a console that returns finds it held": (tick(console_age_s=3.0), tick(5.0, state=HELD)),
    "a console's age that is no number is silence": (tick(console_age_s=nan, state=HELD),),
    "headless needs no console": (tick(console_age_s=None, flows=True),),
    "fault stays fault without a console": (
        tick(shaft_age_s=1.0),
        tick(console_age_s=100.0, state=FAULT),
    ),
    "off ends every allowance": (
        order(Do.ALLOW_OUTSIDE, True),
        tick(console_age_s=61.0),
        order(Do.READY),
        order(Do.ACKNOWLEDGE),
        order(Do.START),
        tick(landing_inside=False, flows=False),
    ),
    "both speeds silent: held after two seconds without any": (
        tick(1.9, **NO_SPEED, state=WORKING, why=("speed_silent",)),
        tick(0.3, **NO_SPEED, state=HELD, why_state="speed_silent"),
    ),
    "a last speed is good for two seconds": (
        tick(gnss_age_s=1.9, wheel_age_s=1.9, flows=True),
        tick(**OLD_SPEEDS, state=HELD),
    ),
    "the wheel's speed is enough": (tick(gnss_age_s=NEVER, wheel_age_s=0.1, flows=True),),
    "GNSS's speed is enough": (tick(gnss_age_s=0.1, wheel_age_s=NEVER, flows=True),),
    **{
        f"{drive}: half a second is a fault": (
            tick(**{f"{drive}_age_s": 0.49}, flows=True),
            tick(
                **{f"{drive}_age_s": 0.51},
                state=FAULT,
                why_state=f"{drive}_silent",
                why=("not_working", "drive_silent"),
            ),
            tick(5.0, state=FAULT),
        )
        for drive in DRIVES
    },
    **{
        f"{drive}: fault is left by order only once the cause is gone": (
            tick(**{f"{drive}_age_s": 0.6}),
            order(Do.READY, refused=f"cause_lives;alarm={drive}_silent"),
            tick(),
            order(Do.READY),
            order(Do.START, refused=f"acknowledge_first;alarm={drive}_silent"),
            order(Do.ACKNOWLEDGE),
            order(Do.START),
        )
        for drive in DRIVES
    },
    **{
        f"{drive}: a reading that is no number or has no time is silence": (
            tick(**{f"{drive}_age_s": nan}, state=FAULT),
        )
        for drive in DRIVES
    },
}
# From the very start on.
NEW = {
    "a start at standstill has ten seconds to move": (
        order(Do.READY),
        tick(60.0, speed_mps=0.0),
        order(Do.START),
        tick(9.8, speed_mps=0.0, state=WORKING),
        tick(0.3, speed_mps=0.0, state=HELD),
    ),
    **{
        f"{drive}: never heard is a fault half a second after off": (
            tick(5.0, **{f"{drive}_age_s": NEVER}, state=OFF),
            order(Do.READY),
            order(Do.START),
            tick(0.4, **{f"{drive}_age_s": NEVER}, state=WORKING, why=("drive_silent",)),
            tick(0.2, **{f"{drive}_age_s": NEVER}, state=FAULT),
        )
        for drive in DRIVES
    },
}


@pytest.mark.parametrize("name", AT_WORK)
def test_from_work_on(working, name):
    play(working(), AT_WORK[name])


@pytest.mark.parametrize("name", NEW)
def test_from_the_start_on(new_run, name):
    play(new_run(), NEW[name])


@pytest.mark.parametrize("state", [READY, HELD, State.CALIBRATING])
@pytest.mark.parametrize("drive", DRIVES)
def test_a_silent_drive_is_a_fault_from_other_states_too(
    state, drive, new_run, working, calibrating
):
    run = in_state(state, new_run, working, calibrating)
    assert run.tick(speed_mps=0.0, **{f"{drive}_age_s": 0.6}).state is FAULT


class TestCalibrating:
    @pytest.mark.parametrize(
        "steps",
        [
            pytest.param(
                (
                    tick(
                        speed_mps=0.0,
                        **NO_SPEED,
                        landing_inside=False,
                        state=State.CALIBRATING,
                        flows=True,
                    ),
                ),
                id="flow without speed and field",
            ),
            pytest.param(
                (order(Do.RELEASE), tick(speed_mps=0.0, state=READY, flows=False)),
                id="release stops at once",
            ),
            pytest.param(
                (tick(speed_mps=0.0, work_switch=False, why=("work_switch_up",)),),
                id="the work switch still counts",
            ),
        ],
    )
    def test_what_flows(self, calibrating, steps):
        play(calibrating(), steps)

    @pytest.mark.parametrize(
        "moving",
        [
            {"wheel_mps": 0.11},
            {"gnss_mps": 0.11},
            {"gnss_age_s": 9.0},
            {"wheel_age_s": 9.0, "wheel_mps": 0.01},
        ],
    )
    def test_begins_only_with_both_sensors_known_and_still(self, new_run, moving):
        run = new_run()
        run.order(Do.READY)
        run.tick(**({"speed_mps": 0.0} | moving))
        assert run.order(Do.CALIBRATE).why == "calibrate_moving;speed_mps=0.1"
        assert run.safety.state is State.READY

    def test_not_on_old_knowledge(self, new_run):
        run = new_run()
        run.order(Do.READY)
        run.tick(speed_mps=0.0)
        run.ticks += 20
        assert not run.order(Do.CALIBRATE).accepted

    @pytest.mark.parametrize(
        ("both", "silent", "other_mps", "accepted"),
        [
            (True, "gnss_age_s", 0.0, False),
            (False, "gnss_age_s", 0.0, True),
            (False, "wheel_age_s", 0.0, True),
            (False, "gnss_age_s", 0.15, False),
        ],
    )
    def test_one_speed_is_enough_only_where_the_other_is_not_fitted(
        self, new_run, both, silent, other_mps, accepted
    ):
        run = new_run(both_speeds_to_start=both)
        run.order(Do.READY)
        run.tick(speed_mps=other_mps, **{silent: 5.0})
        assert run.order(Do.CALIBRATE).accepted is accepted

    @pytest.mark.parametrize("moving", [{"wheel_mps": 0.21}, {"gnss_mps": 0.21}])
    def test_moving_is_a_fault(self, calibrating, moving):
        run = calibrating()
        assert run.tick(**({"speed_mps": 0.15} | dict.fromkeys(moving, 0.19))).flow_allowed
        verdict = run.tick(**({"speed_mps": 0.0} | moving))
        assert (verdict.state, verdict.why_state) == (State.FAULT, "calibration_moved")
        assert not verdict.flow_allowed

    def test_a_button_not_confirmed_for_half_a_second_is_released(self, calibrating):
        run = calibrating()
        seconds = run.until(lambda v: not v.flow_allowed, 5.0, speed_mps=0.0)
        assert 0.4 <= seconds <= 0.5
        assert run.verdict.why_state == "released"

    def hold_down(self, run, seconds):
        """The button is down, the order repeated every 0.2 s; seconds of flow."""
        begun_s, flowing_s = run.now_s, None
        while run.now_s - begun_s < seconds:
            run.order(Do.CALIBRATE, 5.0)
            if not run.tick(0.2, speed_mps=0.0).flow_allowed and flowing_s is None:
                flowing_s = run.now_s - begun_s
        return flowing_s

    def test_a_run_ends_and_does_not_begin_again_under_the_same_press(self, calibrating):
        run = calibrating(5.0)
        assert self.hold_down(run, 20.0) == pytest.approx(5.0, abs=0.3)
        assert run.verdict.state is State.READY
        assert run.order(Do.CALIBRATE, 5.0).why == "release_first"
        run.order(Do.RELEASE)
        assert run.order(Do.CALIBRATE, 5.0).accepted

    def test_no_run_is_longer_than_120_s(self, calibrating):
        run = calibrating()
        for _ in range(700):
            run.order(Do.CALIBRATE)
            run.tick(0.2, speed_mps=0.0)
            if run.verdict.state is not State.CALIBRATING:
                break
        assert run.verdict.why_state == "calibration_time"
        assert run.now_s - run.origin_s == pytest.approx(120.0, abs=0.5)

    @pytest.mark.parametrize("value", [0.0, -1.0, 120.1, nan, True, "10"])
    def test_odd_durations_are_refused(self, new_run, value):
        run = new_run()
        run.order(Do.READY)
        run.tick(speed_mps=0.0)
        assert run.order(Do.CALIBRATE, value).why == "calibrate_seconds;max_s=120.0"

    def test_a_late_confirmation_does_not_revive_it(self, calibrating):
        run = calibrating()
        run.ticks += 12
        assert run.order(Do.CALIBRATE).why == "release_first"
        assert not run.tick(speed_mps=0.0).flow_allowed


@pytest.mark.parametrize("cause", ["drive_fault", "drive_stopped"])
def test_a_faulty_or_stopped_drive_leaves_no_flow_and_no_way_back_while_it_lasts(
    working, calibrating, cause
):
    run = working()
    verdict = run.tick(**{cause: True})
    assert (verdict.state, verdict.flow_allowed, verdict.why_state) == (State.FAULT, False, cause)
    run.order(Do.ACKNOWLEDGE, "")
    assert run.order(Do.READY).why == f"cause_lives;alarm={cause}"
    run.tick()
    assert run.order(Do.READY).accepted
    run = calibrating()
    assert run.tick(speed_mps=0.0, **{cause: True}).state is State.FAULT


def test_a_stop_ends_what_was_allowed_also_while_the_machine_is_off(new_run):
    run = new_run()
    run.order(Do.ALLOW_OUTSIDE, True)
    assert run.safety.memory.allow.outside
    run.order(Do.STOP)
    assert not run.safety.memory.allow.outside


def test_a_start_that_is_held_down_begins_work_after_ready(working):
    run = working()
    run.order(Do.START, True)
    run.order(Do.HOLD)
    run.tick(0.1)
    assert not run.order(Do.START, True).accepted
    assert run.order(Do.READY).accepted
    assert run.order(Do.START, True).accepted


def test_both_speeds_silent_is_held_after_two_seconds_though_the_wheel_counts_as_standing(working):
    """A wheel that was not heard for 0.8 s stops the flow at once; that must not hide that
    nobody knows the speed."""
    run = working()
    at_s = run.now_s

    def silent():
        age_s = run.now_s - at_s
        return run.tick(gnss_age_s=age_s, wheel_age_s=age_s, wheel_standstill=age_s > 0.8)

    while run.now_s - at_s < 1.9:
        assert silent().state is State.WORKING
    assert not run.verdict.flow_allowed
    while run.now_s - at_s < 2.2:
        silent()
    assert (run.verdict.state, run.verdict.why_state) == (State.HELD, "speed_silent")


def test_what_a_check_does_not_judge_is_remembered_as_it_was(working):
    """Each field that orders alone write: a check that forgot one would forget when START was
    held, or calibrating."""
    written = {
        "left_off_s": -7.0,
        "calibrate_s": -6.0,
        "calibrate_until_s": 5.0,
        "start_held_s": -4.0,
    }
    run = working()
    run.safety._memory = run.safety.memory._replace(**written)
    run.tick()
    assert {name: getattr(run.safety.memory, name) for name in written} == written
