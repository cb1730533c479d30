"""Set-points of a calibrating run: obeyed while the button is down and the machine stands, and
by nothing else."""

from __future__ import annotations

from datetime import date
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from topdress.control.loop.tick import Tick
from topdress.control.orders import Answer, Do, Order, State
from topdress.control.readings import DriveCommand, GnssFix, Measurements, Reading
from topdress.control.simulation.assembly import make_control_loop
from topdress.drivers.files.run_setup import load_setup

from tests.control_loop.closed import SETUP, STEP_S, Change, Closed

DAY = date(2014, 3, 7)
STANDS, MOVES = (({"at_s": 0.0, "speed_kmh": kmh},) for kmh in (0.0, 4.0))


class Bench(Closed):
    """A standing machine, its loop, and somebody who holds the button down while `held`."""

    held = False

    def run(self, seconds: float, change: Change = lambda m: m) -> Tick:
        for k in range(round(seconds / STEP_S)):
            if self.held and k % 4 == 0:
                self.order(Do.CALIBRATE)
            self.tick(change)
        return self.ticks[-1]

    def press(self) -> Answer:
        self.held = True
        return self.order(Do.CALIBRATE)


@pytest.fixture
def bench() -> Any:
    made = Bench(sim={"speed_changes": STANDS})
    made.run(1.0)
    made.order(Do.READY)
    made.run(0.2)
    return made


def test_set_points_reach_the_drives_and_nothing_trims_them(bench: Any) -> None:
    assert bench.press().accepted
    begins = bench.run(0.5).bench
    assert begins[:2] == pytest.approx((0.0, 25.0), abs=0.2), (
        "a standing shaft, the gate where it is"
    )
    assert bench.order(Do.CALIBRATE_SHAFT, 50.04).accepted
    assert bench.order(Do.CALIBRATE_OPENING, 18.0).accepted
    tick = bench.run(8.0)
    assert tick.row.state == "calibrating"
    assert tick.command[:2] == pytest.approx((50.0, 18.0), abs=0.06)
    assert bench.plant.truth.shaft_rpm == pytest.approx(50.0, abs=1.0)
    assert bench.plant.truth.opening_mm == pytest.approx(18.0, abs=0.3)
    assert tick.bench.elapsed_s == pytest.approx(8.5, abs=0.1)
    assert tick.bench.left_s == pytest.approx(111.5, abs=0.1)
    events = ";".join(filter(None, (tick.row.events for tick in bench.ticks))).split(";")
    assert [e.split()[0] for e in events] == [
        "ready",
        "calibrate",
        "calibrate_shaft",
        "calibrate_opening",
    ]


def test_the_shaft_stops_within_half_a_second_of_letting_go(bench: Any) -> None:
    bench.press()
    bench.order(Do.CALIBRATE_SHAFT, 60.0)
    bench.run(2.0)
    bench.held = False
    tick = bench.run(0.5)
    assert (tick.row.state, tick.command.shaft_rpm, tick.is_enabled, tick.bench) == (
        "ready",
        0.0,
        False,
        None,
    )
    assert tick.why_state == "released"


def test_a_run_lasts_two_minutes_at_most_and_the_next_begins_standing(bench: Any) -> None:
    bench.press()
    bench.order(Do.CALIBRATE_SHAFT, 60.0)
    bench.order(Do.CALIBRATE_OPENING, 12.0)
    assert bench.run(119.9).command.shaft_rpm == 60.0
    tick = bench.run(0.2)
    assert (tick.row.state, tick.command.shaft_rpm, tick.why_state) == (
        "ready",
        0.0,
        "calibration_time",
    )
    bench.held = False
    bench.order(Do.RELEASE)
    assert bench.press().accepted
    assert bench.run(0.5).bench[:2] == (0.0, 12.0), "the set-points of the run before are forgotten"


def test_set_points_are_cut_to_the_drives_limits(bench: Any) -> None:
    bench.press()
    bench.order(Do.CALIBRATE_SHAFT, 1e6)
    bench.order(Do.CALIBRATE_OPENING, 1e6)
    limits = bench.loop.machine.limits
    assert bench.run(0.2).command == DriveCommand(limits.shaft_high_rpm, limits.opening_high_mm)
    bench.order(Do.CALIBRATE_SHAFT, 3.0)
    bench.order(Do.CALIBRATE_OPENING, 0.0)
    assert bench.run(0.2).command == DriveCommand(0.0, limits.opening_low_mm)


@pytest.mark.parametrize("value", [None, True, "50", -1.0, float("nan"), float("inf")])
def test_what_is_no_set_point_is_refused(bench: Any, value: Any) -> None:
    bench.press()
    for do in (Do.CALIBRATE_SHAFT, Do.CALIBRATE_OPENING):
        assert bench.order(do, value) == (False, "calibrate_setting")
    assert bench.run(0.2).bench[:2] == pytest.approx((0.0, 25.0), abs=0.2)


@pytest.mark.parametrize("state", [State.OFF, State.READY, State.WORKING, State.HELD])
def test_in_no_other_state_is_a_set_point_taken(state: State) -> None:
    bench = Bench(sim={"speed_changes": MOVES})
    bench.run(3.0)
    for do in {
        State.OFF: (),
        State.READY: (Do.READY,),
        State.WORKING: (Do.READY, Do.START),
        State.HELD: (Do.READY, Do.START, Do.HOLD),
    }[state]:
        assert bench.order(do).accepted
        bench.run(0.1)
    for do in (Do.CALIBRATE_SHAFT, Do.CALIBRATE_OPENING):
        assert bench.order(do, 60.0) == (False, f"not_from_state;state={state.value}")


def test_a_machine_that_moves_is_not_calibrated(bench: Any) -> None:
    moving = Bench(sim={"speed_changes": MOVES})
    moving.run(3.0)
    moving.order(Do.READY)
    moving.run(0.2)
    assert moving.press() == (False, "calibrate_moving;speed_mps=0.1")
    assert moving.run(1.0).bench is None


def test_work_after_calibrating_is_as_without(bench: Any) -> None:
    """Nothing learnt on the bench stays in the trims."""
    bench.press()
    bench.order(Do.CALIBRATE_SHAFT, 33.0)
    bench.run(10.0)
    assert bench.loop._drive_trim.shaft_share == bench.loop._drive_trim.gate_mm == 0.0


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just(Do.CALIBRATE), st.sampled_from([None, 1.0, 120.0, 500.0])),
        st.tuples(
            st.sampled_from([Do.CALIBRATE_SHAFT, Do.CALIBRATE_OPENING]),
            st.sampled_from([0.0, 3.0, 7.0, 40.0, 99.0, 1e9, -1.0, float("nan"), "40", None]),
        ),
        st.tuples(
            st.sampled_from([Do.RELEASE, Do.HOLD, Do.READY, Do.START, Do.STOP, Do.ACKNOWLEDGE]),
            st.none(),
        ),
        st.tuples(st.just("wait"), st.sampled_from([1, 4, 8, 12])),
        st.tuples(st.just("speed"), st.sampled_from([0.0, 0.0, 0.15, 0.3, 1.5])),
        st.tuples(st.just("drives"), st.booleans()),
    ),
    min_size=5,
    max_size=40,
)


class HeldToTheRules:
    """A loop to which anything may happen, and beside it what the published rules demand of
    each tick."""

    def __init__(self) -> None:
        self.loop = make_control_loop(SETUP.machine, SETUP.crop, SETUP.rule, SETUP.job)
        self.limits, self.now_s, self.speed_mps, self.heard = SETUP.machine.limits, 100.0, 0.0, True
        self.drives = (Reading(0.0, self.now_s), Reading(25.0, self.now_s))
        self.confirmed_s = self.begun_s = -1e9
        self.asked_rpm, self.before = 0.0, State.OFF

    def tick(self) -> None:
        self.now_s += 0.05
        now_s, limits = self.now_s, self.limits
        if self.heard:
            self.drives = (Reading(0.0, now_s), Reading(25.0, now_s))
        fix = GnssFix(now_s, 34.28, 119.88, 4, speed_mps=self.speed_mps, heading_deg=10.0)
        said = self.loop.run_tick(
            Measurements(
                now_s,
                gnss=fix,
                wheel_speed_mps=Reading(self.speed_mps, now_s),
                ndvi=(Reading(0.5, now_s),) * 6,
                shaft_rpm=self.drives[0],
                opening_mm=self.drives[1],
            )
        )
        rpm, mm = said.command.shaft_rpm, said.command.opening_mm
        assert rpm == 0.0 or limits.shaft_low_rpm <= rpm <= limits.shaft_high_rpm
        assert limits.opening_low_mm <= mm <= limits.opening_high_mm
        if said.row.state == State.CALIBRATING:
            assert (
                now_s - self.confirmed_s < 0.5
                and now_s - self.begun_s <= 120.05
                and self.speed_mps <= 0.2
            )
            lowest = limits.shaft_low_rpm if self.asked_rpm >= limits.shaft_low_rpm / 2 else 0.0
            assert rpm <= max(self.asked_rpm, lowest)
            assert rpm == 0.0 or now_s - self.drives[0].time_s <= 0.5
        elif said.row.state != State.WORKING:
            assert rpm == 0.0 and said.bench is None
        self.before = State(said.row.state)

    def order(self, do: Do, value: Any) -> None:
        if not self.loop.handle_order(Order(do, value)).accepted:
            return
        if do is Do.CALIBRATE:
            if self.before is not State.CALIBRATING:
                self.begun_s, self.asked_rpm = self.now_s, 0.0
            self.confirmed_s, self.before = self.now_s, State.CALIBRATING
        elif do is Do.CALIBRATE_SHAFT:
            self.asked_rpm = value
        elif do is not Do.CALIBRATE_OPENING:
            self.before = self.loop.safety.state


@settings(max_examples=80, deadline=None, suppress_health_check=list(HealthCheck))
@given(STEPS)
def test_whatever_is_ordered_the_shaft_turns_on_the_bench_only_while_the_button_is_down(
    steps: list[Any],
) -> None:
    """Orders, movement and silent drives in any sequence, against the published rules."""
    bench = HeldToTheRules()
    bench.tick()
    for do, value in steps:
        if do == "wait":
            for _ in range(value):
                bench.tick()
        elif do == "speed":
            bench.speed_mps = value
        elif do == "drives":
            bench.heard = value
        else:
            bench.order(do, value)
    bench.tick()


def test_every_valve_is_open_while_a_catch_is_made() -> None:
    setup = load_setup("huanghai_sections", "sections_demo", DAY)
    bench = Bench(setup, sim={"speed_changes": STANDS})
    bench.run(1.0)
    bench.order(Do.READY)
    bench.run(0.2)
    assert bench.press().accepted
    bench.run(0.5)
    assert bench.order(Do.CALIBRATE_SHAFT, 50.0).accepted
    assert bench.run(1.0).command.valves == (True,) * len(setup.machine.switched_strips)


def test_what_is_caught_is_no_loss_of_the_hopper(bench: Any) -> None:
    bench.run(40.0)
    assert bench.press().accepted
    bench.run(0.5)
    assert bench.order(Do.CALIBRATE_SHAFT, 70.0).accepted
    bench.run(20.0)
    bench.held = False
    bench.order(Do.RELEASE)
    alarms = {alarm.id for _ in range(60) for alarm in bench.run(1.0).verdict.alarms}
    assert bench.plant.truth.hopper_kg < 299.0
    assert not alarms & {"flow_unordered", "scale_unexplained"}
