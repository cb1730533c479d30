"""Hypothesis tries to break the interlocks: any orders, any situations, in any sequence.

What is demanded is written here a second time, straight from the published rules, with a memory
of its own.
"""

from __future__ import annotations

import json
from math import inf, isfinite, nan
from time import thread_time

import pytest
from hypothesis import HealthCheck, assume, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test
from topdress.control.orders import PLACE_SOURCES, Do, Order, Severity, State, TargetSource
from topdress.control.readings import NO_SCALE_FINDING, DriveCommand, ScaleFinding
from topdress.control.safety import (
    ALARMS,
    INTERLOCKS,
    REFUSALS,
    STATE_REASONS,
    DriveLimits,
    Safety,
    limit_command,
    limit_valves,
    read_refusal,
)

from tests.safety.steps import NEVER, good_situation

ODD = (nan, inf, -inf, -1.0, 1e300)
AGES = (0.0, 0.1, 0.4, 0.6, 1.9, 2.2, 70.0, nan)
SPEEDS = (0.0, 0.05, 0.15, 0.22, 0.25, 0.35, 0.45, 0.55, 1.25)
YES_NO = (True, False)

SAYS = (
    NO_SCALE_FINDING,
    ScaleFinding(unordered_kg=1.0),
    ScaleFinding(share=0.2),
    ScaleFinding(share=nan),
    ScaleFinding(outlets=2),
    ScaleFinding(below_percent=nan),
    ScaleFinding(beyond_percent=inf),
    ScaleFinding(trimmed_percent=nan),
    ScaleFinding(off_kg=nan),
)
DISTURBANCES = {
    "speed_mps": SPEEDS,
    "gnss_mps": (*SPEEDS, *ODD, None),
    "wheel_mps": (*SPEEDS, *ODD),
    "speed_used_mps": (*SPEEDS, *ODD, None),
    "course_deg": (0.0, 90.0, 180.0, 270.0, None, nan),
    "gnss_age_s": AGES,
    "wheel_age_s": AGES,
    "shaft_age_s": AGES,
    "gate_age_s": AGES,
    "scale_age_s": AGES,
    "fix_quality": (0, 1, 4),
    "gnss_period_s": (0.1, 1.0, nan, inf, 0.0),
    "hopper_kg": (0.0, 0.4, 20.0, 31.0, 200.0, nan),
    "work_switch": (True, False, None),
    "wheel_standstill": YES_NO,
    "target_source": tuple(TargetSource),
    "position_ok": YES_NO,
    "landing_inside": (True, False, None),
    "valid_heads": (None, 0, 3, 4, 6),
    "ndvi_age_s": (None, *AGES),
    "expected_rate_kg_ha": (None, 0.0, 300.0, *ODD),
    "applied_rate_kg_ha": (None, 0.0, 335.0, 400.0, 2000.0, *ODD),
    "scale": SAYS,
    "target_rate_kg_ha": (0.0, 300.0, *ODD),
    "metres_left_m": (None, 55.0, *ODD),
    "usable_speed_mps": (None, 1.0, *ODD),
    "console_age_s": (None, 0.1, 1.9, 2.1, 59.0, 61.0, nan),
    "log_ok": YES_NO,
}
EVERY_ONE = [{name: value} for name, values in DISTURBANCES.items() for value in values]
CHANGES = st.one_of(
    st.just({}),
    st.lists(st.sampled_from(EVERY_ONE), max_size=3).map(
        lambda singles: {name: value for single in singles for name, value in single.items()}
    ),
)
ORDERS = st.sampled_from(
    [
        Order(Do.READY),
        Order(Do.START),
        Order(Do.START, True),
        Order(Do.HOLD),
        Order(Do.STOP),
        Order(Do.CALIBRATE),
        Order(Do.CALIBRATE, 1.0),
        Order(Do.CALIBRATE, nan),
        Order(Do.RELEASE),
        Order(Do.ACKNOWLEDGE, ""),
        Order(Do.ACKNOWLEDGE, "log_failed"),
        Order(Do.ALLOW_REVERSE, True),
        Order(Do.ALLOW_REVERSE, False),
        Order(Do.ALLOW_OUTSIDE, True),
        Order(Do.ALLOW_OUTSIDE, "yes"),
        Order(Do.GO_ON_UNLOGGED, True),
        Order(Do.GO_ON_UNLOGGED, False),
        Order(Do.REFILL, 100.0),
        Order(Do.REFILL, nan),
        Order(Do.NUDGE, 5.0),
    ]
)
STEPS_S = st.sampled_from([0.01, 0.05, 0.05, 0.2, 0.5, 1.0])
BY_TICK = {
    State.OFF: {State.OFF},
    State.FAULT: {State.FAULT},
    State.READY: {State.READY, State.FAULT, State.OFF},
    State.WORKING: {State.WORKING, State.HELD, State.FAULT, State.OFF},
    State.HELD: {State.HELD, State.FAULT, State.OFF},
    State.CALIBRATING: {State.CALIBRATING, State.READY, State.FAULT, State.OFF},
}
BY_ORDER = {
    (State.OFF, Do.READY): State.READY,
    (State.HELD, Do.READY): State.READY,
    (State.FAULT, Do.READY): State.READY,
    (State.READY, Do.START): State.WORKING,
    (State.HELD, Do.START): State.WORKING,
    (State.WORKING, Do.HOLD): State.HELD,
    (State.CALIBRATING, Do.HOLD): State.READY,
    (State.CALIBRATING, Do.RELEASE): State.READY,
    (State.READY, Do.CALIBRATE): State.CALIBRATING,
} | {(state, Do.STOP): State.OFF for state in State}

ALLOWANCES = {
    Do.ALLOW_OUTSIDE: "outside_allowed",
    Do.ALLOW_REVERSE: "reverse_allowed",
    Do.GO_ON_UNLOGGED: "unlogged_allowed",
}


def fresh(reading, now_s, limit_s):
    return reading is not None and now_s - reading.time_s <= limit_s and isfinite(reading.value)


class Rules(RuleBasedStateMachine):
    """One run of safety, and beside it what the published rules demand."""

    def __init__(self, has_work_switch):
        super().__init__()
        self.has_work_switch = has_work_switch
        self.safety = Safety(has_work_switch=has_work_switch)
        self.now_s = 50.0
        self.state = State.OFF
        self.verdict = None
        self.ticked = False
        self.situation = None
        self.outside_allowed = self.unlogged_allowed = self.reverse_allowed = False
        self.calibrate_s = self.calibrate_ends_s = -inf
        self.unseen_red: set[str] = set()
        self.course_deg = self.epoch_s = None
        self.started = False
        self.stopped_since_course = False
        self.backwards = False
        self.start_s = -inf  # START last told to be held
        # since when it flows under it, slower than a start
        self.launched_s = None
        self.course_since_stood = False
        self.creeps = False

    def bring_to(self, state):
        """Most of what matters happens where random orders alone seldom get."""
        self.tick({}, 0.05)
        self.give_order(Order(Do.ACKNOWLEDGE))
        # the good situation's scale stands still: no missing flow yet
        self.give_order(Order(Do.REFILL, 1.0))
        for do in (Do.RELEASE, Do.STOP, Do.READY):
            self.give_order(Order(do))
        if state in (State.WORKING, State.HELD):
            self.give_order(Order(Do.START))
            self.tick({}, 0.05)
            assert self.verdict.flow_allowed or (self.backwards and not self.reverse_allowed)
        if state is State.HELD:
            self.give_order(Order(Do.HOLD))
        if state is State.CALIBRATING:
            self.tick({"speed_mps": 0.0}, 0.6)
            self.give_order(Order(Do.CALIBRATE, 1.0))
            self.tick({"speed_mps": 0.0}, 0.05)
            assert self.verdict.flow_allowed
        if state is State.FAULT:
            self.tick({"shaft_age_s": 0.6}, 0.05)
        assert self.safety.state is state

    @rule(change=st.sampled_from(EVERY_ONE))
    def start_again_with_one_thing_odd(self, change):
        self.bring_to(State.WORKING)
        self.tick({"speed_mps": 0.2}, 0.05)
        self.tick(dict(change), 0.05)

    @rule(
        every_s=st.sampled_from([0.05, 0.2, 0.45, 0.6]),
        times=st.sampled_from([1, 4, 20]),
        speed_mps=st.sampled_from([0.05, 0.15, 0.22, 0.25, 0.45]),
        course_deg=st.sampled_from([90.0, 270.0, None]),
        change=st.one_of(st.just({}), st.sampled_from(EVERY_ONE)),
    )
    def launch(self, every_s, times, speed_mps, course_deg, change):
        """START held while the machine creeps, with one thing odd."""
        self.bring_to(State.WORKING)
        self.tick({"speed_mps": 0.0}, 0.05)
        for _ in range(times):
            self.give_order(Order(Do.START, True))
            self.tick({"speed_mps": speed_mps, "course_deg": course_deg} | dict(change), every_s)

    @rule(seconds=st.sampled_from([0.3, 0.45, 0.6]), checked=st.booleans())
    def let_go_without_saying_so(self, seconds, checked):
        self.bring_to(State.CALIBRATING)
        for _ in range(round(seconds / 0.05)):
            if checked:
                self.tick({"speed_mps": 0.0}, 0.05)
            else:
                self.now_s += 0.05
        self.give_order(Order(Do.CALIBRATE, 1.0))

    @rule(
        state=st.sampled_from([s for s in State if s is not State.OFF]),
        age_s=st.sampled_from([2.1, 61.0]),
    )
    def leave_the_console(self, state, age_s):
        self.bring_to(state)
        self.tick({"console_age_s": age_s, "speed_mps": 0.0}, 0.05)

    @rule()
    def lose_the_log_twice(self):
        self.bring_to(State.WORKING)
        self.tick({"log_ok": False}, 0.05)
        self.give_order(Order(Do.GO_ON_UNLOGGED, True))
        for log_ok in (False, True, False):
            self.tick({"log_ok": log_ok}, 0.05)

    @rule(drive=st.sampled_from(["shaft_age_s", "gate_age_s"]))
    def a_drive_never_heard(self, drive):
        """Within its half second of grace a drive that never spoke is no fault yet, and no flow
        either."""
        for do in (Do.STOP, Do.ACKNOWLEDGE, Do.READY, Do.START):
            self.give_order(Order(do))
        self.tick({drive: NEVER}, 0.05)

    @rule(
        state=st.sampled_from(
            [State.WORKING, State.WORKING, *(s for s in State if s is not State.OFF)]
        ),
        change=st.sampled_from(EVERY_ONE),
        ticks=st.sampled_from([1, 3]),
        source=st.sampled_from(list(TargetSource)),
        allowance=st.sampled_from([None, Do.ALLOW_OUTSIDE, Do.ALLOW_REVERSE]),
    )
    def disturb(self, state, change, ticks, source, allowance):
        """One thing goes wrong in a known state, and comes right again."""
        self.bring_to(state)
        if allowance is not None:
            self.give_order(Order(allowance, True))
        standing = {"speed_mps": 0.0} if state is State.CALIBRATING else {}
        for _ in range(ticks):
            self.tick({"target_source": source} | standing | change, 0.05)
        self.tick(dict(standing), 0.05)

    @rule()
    def start_without_looking(self):
        self.give_order(Order(Do.READY))
        self.give_order(Order(Do.START))

    @rule(ticks=st.integers(1, 10))
    def hold_the_button_down(self, ticks):
        self.bring_to(State.CALIBRATING)
        for _ in range(ticks):
            self.give_order(Order(Do.CALIBRATE, 120.0))
            self.tick({"speed_mps": 0.0}, 0.2)

    @rule(seconds=STEPS_S)
    def time_passes_unchecked(self, seconds):
        self.now_s += seconds

    @rule(order=ORDERS)
    def give_order(self, order):
        before = self.safety.state
        if order == Order(Do.START, True):
            self.start_s = self.now_s
        answer = self.safety.handle_order(order, self.now_s)
        after = self.safety.state
        self.ticked = False
        if after is not before:
            assert answer.accepted and BY_ORDER[before, order.do] is after
        if not answer.accepted:
            message_id, details = read_refusal(answer.why)
            assert REFUSALS[message_id].format(**details)
        if order.do is Do.STOP:
            assert after is State.OFF
        if answer.accepted:
            self.remember(order, before)
        if after is State.WORKING and before is not State.WORKING:
            assert not self.unseen_red
        self.state = after

    def remember(self, order, before):
        """What an accepted order changes besides the state."""
        if order.do is Do.STOP:
            self.outside_allowed = self.unlogged_allowed = self.reverse_allowed = False
        elif order.do is Do.CALIBRATE:
            assert before is State.READY or self.now_s - self.calibrate_s < 0.5, (
                "let go, and yet goes on"
            )
            self.calibrate_s = self.now_s
            if before is State.READY:
                self.calibrate_ends_s = self.now_s + (order.value or 120.0)
        elif order.do is Do.ACKNOWLEDGE:
            self.unseen_red = set() if not order.value else self.unseen_red - {order.value}
        elif order.do in ALLOWANCES:
            setattr(self, ALLOWANCES[order.do], order.value)

    @rule(changes=CHANGES, step_s=STEPS_S, ticks=st.sampled_from([1, 1, 3, 30]))
    def live_on(self, changes, step_s, ticks):
        for _ in range(ticks):
            self.tick(dict(changes), step_s)

    @rule(
        slowest_mps=st.sampled_from([0.0, 0.25]),
        course_deg=st.sampled_from([0.0, 90.0, 180.0, 270.0]),
    )
    def stop_and_go_on(self, slowest_mps, course_deg):
        self.tick({"speed_mps": slowest_mps}, 0.05)
        self.tick({"course_deg": course_deg}, 0.05)
        self.tick({"course_deg": course_deg}, 0.05)

    def tick(self, changes, step_s):
        self.now_s += step_s
        before = self.state
        switch = {"work_switch": True} if self.has_work_switch else {}
        self.situation = s = good_situation(self.now_s, **(switch | changes))
        self.follow_motion(s)
        if s.log_ok:
            self.unlogged_allowed = False
        self.verdict = self.safety.check_tick(self.now_s, s)
        self.state, self.ticked = self.verdict.state, True
        if self.state is State.OFF and before is not State.OFF:
            assert not s.console_age_s <= 60.0
            self.outside_allowed = self.unlogged_allowed = self.reverse_allowed = False
        assert self.state in BY_TICK[before]
        assert self.verdict.why_state in {*ALARMS, *STATE_REASONS, *(do.value for do in Do), ""}
        self.check_alarms()
        self.check_flow()

    def follow_motion(self, s):
        """Backwards or not, started or not: a course flip above 120 degrees across a
        standstill; 0.5 and 0.3 m/s."""
        fix = s.measurements.gnss
        period_s = (
            s.gnss_period_s if s.gnss_period_s <= 2.0 else (2.0 if s.gnss_period_s > 2.0 else 0.0)
        )
        heard = self.now_s - fix.time_s <= max(0.5, 2.5 * period_s) and fix.fix_quality > 0
        speed = (
            fix.speed_mps
            if heard and fix.speed_mps is not None and isfinite(fix.speed_mps)
            else None
        )
        course_known = (
            fix.heading_deg is not None and isfinite(fix.heading_deg) and fix.time_s != self.epoch_s
        )
        self.new_course, self.course_before = False, self.course_deg is not None
        if speed is not None and speed >= 0.2 and course_known:
            self.new_course, self.epoch_s = True, fix.time_s
            if self.course_deg is not None and self.stopped_since_course:
                flip = abs(fix.heading_deg - self.course_deg)
                if min(flip, 360.0 - flip) > 120.0:
                    self.backwards = not self.backwards
            self.course_deg, self.stopped_since_course = fix.heading_deg, False
        used = s.speed_used_mps
        used_ok = used is not None and isfinite(used)
        if s.wheel_standstill or (used_ok and used < 0.3) or (speed is not None and speed < 0.2):
            self.stopped_since_course = True
        wheel = s.measurements.wheel_speed_mps
        standing = s.wheel_standstill or (used_ok and used < 0.1)
        self.course_since_stood = not standing and (self.course_since_stood or self.new_course)
        creeping = (
            fresh(wheel, self.now_s, 0.8)
            and wheel.value >= 0.1
            and speed is not None
            and speed >= 0.1
        )
        self.creeps = (
            creeping
            and used_ok
            and not s.wheel_standstill
            and (self.reverse_allowed or self.course_since_stood or not self.course_before)
        )
        both = (
            fresh(wheel, self.now_s, 0.8)
            and wheel.value >= 0.3
            and speed is not None
            and speed >= 0.3
        )
        if s.wheel_standstill or not used_ok or used < 0.3:
            self.started = False
        elif used >= 0.5 and both:
            self.started = True

    def check_flow(self):
        v, s, m = self.verdict, self.situation, self.situation.measurements
        assert v.flow_allowed is (not v.why_no_flow)
        assert set(v.why_no_flow) <= set(INTERLOCKS)
        if self.started or not self.now_s - self.start_s < 0.5 or v.state is not State.WORKING:
            self.launched_s = None
        if not v.flow_allowed:
            return
        assert v.state in (State.WORKING, State.CALIBRATING)
        assert fresh(m.shaft_rpm, self.now_s, 0.5) and fresh(m.opening_mm, self.now_s, 0.5)
        assert m.work_switch is True or (m.work_switch is None and not self.has_work_switch)
        if v.state is State.CALIBRATING:
            assert self.now_s - self.calibrate_s < 0.5 and self.now_s < self.calibrate_ends_s
            return
        if not self.started:
            assert self.now_s - self.start_s < 0.5 and self.creeps, (
                "flow before 0.5 m/s with both sensors moving, or after less than 0.3 m/s, "
                "and START not held"
            )
            self.launched_s = self.now_s if self.launched_s is None else self.launched_s
            assert self.now_s - self.launched_s < 3.0, "a launch has its time"
        assert s.position_ok or s.target_source not in PLACE_SOURCES
        assert s.landing_inside is not False or self.outside_allowed
        assert s.log_ok or self.unlogged_allowed
        assert 0.0 <= s.target_rate_kg_ha <= 1000.0
        assert s.console_age_s is None or s.console_age_s <= 2.0
        assert not self.backwards or self.reverse_allowed

    def check_alarms(self):
        ids = [a.id for a in self.verdict.alarms]
        assert len(set(ids)) == len(ids)
        for alarm in self.verdict.alarms:
            assert alarm.severity is ALARMS[alarm.id].severity
            assert alarm.since_s <= self.now_s
            ALARMS[alarm.id].text.format(**dict(alarm.details))
            json.dumps(alarm.details, allow_nan=False)
        reds = [a.severity is Severity.RED for a in self.verdict.alarms]
        assert reds == sorted(reds, reverse=True)
        assert self.unseen_red <= set(ids), "a red alarm went before anybody saw it"
        self.unseen_red = {
            a.id for a in self.verdict.alarms if a.severity is Severity.RED and not a.acknowledged
        }

    @rule(
        shaft_rpm=st.floats(),
        opening_mm=st.floats(),
        valves=st.lists(st.sampled_from([True, False, None, nan, 1, "1"]), max_size=16),
    )
    def send(self, shaft_rpm, opening_mm, valves):
        assume(self.verdict is not None)
        limits = DriveLimits()
        sent = limit_command(
            DriveCommand(shaft_rpm, opening_mm),
            limits,
            self.verdict.flow_allowed,
            opening_now_mm=20.0,
        )
        assert (
            sent.shaft_rpm == 0.0 or limits.shaft_min_rpm <= sent.shaft_rpm <= limits.shaft_max_rpm
        )
        assert limits.opening_min_mm <= sent.opening_mm <= limits.opening_max_mm
        assert self.verdict.flow_allowed or sent == DriveCommand(0.0, 20.0, None)
        opened = limit_valves(tuple(valves), self.verdict.flow_allowed)
        assert opened == tuple(self.verdict.flow_allowed and wanted is True for wanted in valves)

    @invariant()
    def state_agrees(self):
        assert self.safety.state is self.state
        if self.ticked:
            assert self.verdict.state is self.state


# Of make exam; make test runs a third of them, which are the first of the same ones.
ALL = settings(
    max_examples=150,
    stateful_step_count=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
)


@pytest.mark.parametrize("has_work_switch", [False, True])
@pytest.mark.parametrize("examples", [50, pytest.param(150, marks=pytest.mark.exam)])
def test_nothing_breaks_the_rules(examples, has_work_switch):
    run_state_machine_as_test(
        lambda: Rules(has_work_switch), settings=settings(ALL, max_examples=examples)
    )


@pytest.mark.parametrize("has_work_switch", [False, pytest.param(True, marks=pytest.mark.exam)])
@pytest.mark.parametrize("state", [state for state in State if state is not State.OFF])
def test_every_single_disturbance_in_every_state(state, has_work_switch):
    """No chance in this one: each value of each disturbance, in each state and, at work, in
    each mode."""
    for source in TargetSource if state is State.WORKING else (TargetSource.MAP,):
        for change in EVERY_ONE:
            rules = Rules(has_work_switch)
            rules.bring_to(state)
            standing = {"speed_mps": 0.0} if state is State.CALIBRATING else {}
            for _ in range(3):
                rules.tick({"target_source": source} | standing | change, 0.05)
            rules.start_again_with_one_thing_odd(change)


# --- A check costs the same for hours. Figures: docs/safety.md ------------------------------------


def test_a_check_costs_no_more_after_many_than_at_first(working):
    """The median of the last 500 of 4,000 checks over that of 500 early ones, in the thread's
    own time."""
    run = working()
    took_s = []
    for k in range(1, 4001):
        s = good_situation(run.now_s + 0.05 * k, hopper_kg=200.0 - 0.005 * k)
        begin_s = thread_time()
        verdict = run.safety.check_tick(s.measurements.time_s, s)
        took_s.append(thread_time() - begin_s)
        assert verdict.flow_allowed
    early_s, late_s = (sorted(some)[250] for some in (took_s[50:550], took_s[3500:]))
    assert late_s < 3.0 * early_s
