"""The lag rig: its lines, its clock laid over ours, and the paper's procedure on the simulated
machine."""

from __future__ import annotations

import random
import statistics

import pytest
from topdress.control.field.job import Job
from topdress.control.machine.machine import Machine
from topdress.control.readings import DriveCommand, Reading
from topdress.control.simulation.plant import Plant
from topdress.drivers.board.lag_rig import ARMED, LANDED
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.lag_rig import LagRig, RigReadings
from topdress.drivers.devices.lag_run import (
    DropProcedure,
    DropRun,
    LagProcedure,
    LagTestPlan,
    MeasuredLagRun,
    make_bench_table,
    make_drop_table,
)
from topdress.drivers.ports import make_memory_pair
from topdress.drivers.virtual.lag_rig import VirtualLagRig
from topdress.drivers.virtual.machine import VirtualMachine


def test_a_line_of_the_rig(board_line):
    rig = LagRig()
    (first,) = rig.feed(board_line("L1,0,7,2,1000000,12.500,503,900000,,0"), 50.0)
    assert (first.run, first.state, first.shaft_rpm.value, first.drop_s) == (7, 2, 12.5, None)
    assert first.start_s == pytest.approx(49.9)
    (last,) = rig.feed(board_line("L1,1,7,3,2700000,20.000,580,900000,2650000,2"), 51.75)
    assert last.drop_s == pytest.approx(1.75), "on the rig's own clock, whatever the link does"
    assert last.start_s == pytest.approx(49.9), "the line with the least delay sets the clock"
    assert last.plate_before and not last.turned_before


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        ("L1,0,7,2,1000000,12.5,503,,,0", "wrong_length"),
        ("L1,0,7,0,1000000,12.5,503,900000,,0", "wrong_length"),
        ("L1,0,7,4,1000000,12.5,503,,,0", "out_of_range"),
        ("L1,0,7,0,1000000,nan,503,,,0", "not_a_number"),
        ("L2,0,7,0,1000000,12.5,503,,,0", "unknown_frame"),
        ("L1,0,7,0,5000000000,1.0,503,,,0", "out_of_range"),
    ],
)
def test_wrong_lines_are_counted(board_line, payload, kind):
    rig = LagRig()
    assert rig.feed(board_line(payload), 0.0) == []
    assert rig.counts.rejected == {kind: 1}


def test_times_survive_the_wrap_of_the_rigs_clock(board_line):
    rig = LagRig()
    top = 2**32
    rig.feed(board_line(f"L1,0,1,1,{top - 500_000},0.0,500,,,0"), 10.0)
    (found,) = rig.feed(board_line(f"L1,1,1,3,1500000,20.0,500,{top - 100_000},1400000,0"), 12.0)
    assert found.drop_s == pytest.approx(1.5) and found.start_s == pytest.approx(10.4)


@pytest.mark.parametrize("drift", [50e-6, -50e-6])
def test_a_drifting_crystal_and_a_jittery_link_move_the_start_by_milliseconds_only(
    board_line, drift
):
    """Half an hour of lines, 50 ppm, up to 40 ms of delay, 2 ms at least."""
    chance, rig, worst = random.Random(5), LagRig(), 0.0
    for second in range(1800):
        for part in range(2):
            true_s = second + part * 0.5
            micros = round(true_s * (1.0 + drift) * 1e6) % 2**32
            start = (micros - 400_000) % 2**32
            delay_s = 0.002 + chance.random() ** 2 * 0.04
            (found,) = rig.feed(
                board_line(f"L1,{(2 * second + part) % 65536},1,2,{micros},20.0,500,{start},,0"),
                true_s + delay_s,
            )
            if second > 30:
                worst = max(worst, abs(found.start_s - (true_s - 0.4)))
    assert worst < 0.012


def test_orders_are_numbered_and_sealed(board_line):
    rig = LagRig()
    assert rig.make_order(7, True) == board_line("R1,0,7,1")
    assert rig.make_order(8, False) == board_line("R1,1,8,0")


@pytest.fixture
def bench(clock):
    """The simulated machine with a rig under its outlets, on ports in memory; ticks of 20 ms."""
    machine = Machine()
    job = Job()
    job = job.model_copy(
        update={"simulated": job.simulated.model_copy(update={"speed_kmh": 0.0001})}
    )
    plant = Plant(machine, job, seed=3, dt_s=0.02)
    pairs = {name: make_memory_pair(name, clock) for name in ("gnss", "heads", "board", "rig")}
    virtual = VirtualMachine(
        plant,
        pairs["gnss"][1],
        [pairs["heads"][1]],
        pairs["board"][1],
        clock(),
        multiplexed=True,
        extras=[VirtualLagRig(pairs["rig"][1], lambda: plant.truth)],
    )
    cab = Cab(
        CabConfig.model_validate({"board": {"port": "board"}, "lag_rig": {"port": "rig"}}),
        clock,
        lambda url, baud, _clock: pairs[url][0],
    )
    return cab, virtual, machine


def go(bench, clock, test: LagProcedure, seconds: float, allowed=lambda: True) -> list[str]:
    cab, virtual, _ = bench
    said = []
    for tick in range(round(seconds / 0.02)):
        clock.now_s += 0.02
        virtual.advance_to(clock.now_s)
        cab.read_measurements(clock.now_s)
        wish = test.run_tick(clock.now_s, cab.rig_readings, allowed())
        cab.send_rig_order(wish.run, wish.arm)
        cab.send_command(clock.now_s, DriveCommand(wish.shaft_rpm, 25.0), tick > 10 and allowed())
        if wish.failure:
            said.append(wish.failure)
        if test.is_done:
            break
    return said


def test_the_procedure_finds_the_models_lags(bench, clock):
    test = LagProcedure(LagTestPlan(shaft_rpm=(10.0, 40.0, 70.0), repeats=3))
    assert go(bench, clock, test, 120.0) == []
    assert test.is_done and test.progress == 1.0 and not test.left_out and len(test.runs) == 9
    fall = bench[2].fall
    for rpm in (10.0, 40.0, 70.0):
        runs = [run for run in test.runs if run.shaft_rpm == rpm]
        assert statistics.mean(run.response_s for run in runs) == pytest.approx(0.383, abs=0.035), (
            "two ticks of 20 ms"
        )
        # a start is what the line is fitted to
        drop_s = fall.intercept_s + fall.slope_s_per_rpm * rpm
        assert statistics.mean(run.drop_s for run in runs) == pytest.approx(drop_s, abs=0.05)


def test_a_released_button_stops_the_shaft_and_the_run_begins_again(bench, clock):
    test = LagProcedure(LagTestPlan(shaft_rpm=(40.0,), repeats=1))
    cab, *_ = bench
    go(bench, clock, test, 4.0)
    assert not test.runs and test.run_tick(clock.now_s, cab.rig_readings, True).shaft_rpm == 40.0
    assert test.run_tick(clock.now_s, cab.rig_readings, False).shaft_rpm == 0.0
    go(bench, clock, test, 1.0, allowed=lambda: False)
    assert go(bench, clock, test, 20.0) == []
    assert len(test.runs) == 1


def rig_says(
    now_s, run=0, state=0, rpm=0.0, start_s=None, drop_s=None, turned=False, *, plate=False
):
    return RigReadings(now_s, run, state, Reading(rpm, now_s), start_s, drop_s, turned, plate)


def until_running(test: LagProcedure, now_s: float) -> tuple[float, int]:
    state = 0
    run = 0
    for _ in range(1000):
        now_s += 0.05
        wish = test.run_tick(now_s, rig_says(now_s, run, state), True)
        run, state = wish.run, ARMED if wish.arm else 0
        if wish.phase == "running":
            return now_s, run
    raise AssertionError("never ran")


@pytest.mark.parametrize(
    ("landed", "said"),
    [
        ({"plate": True}, "the plate was touched"),
        ({"turned": True}, "turned before its command"),
        ({"early": -0.6}, "0.600 s before its command"),
    ],
)
def test_a_run_that_cannot_be_right_is_tried_again_and_then_left_out(landed, said):
    test = LagProcedure(LagTestPlan(shaft_rpm=(40.0,), repeats=1, tries=2))
    now_s = 0.0
    for _ in range(2):
        now_s, run = until_running(test, now_s)
        start_s = now_s + landed.get("early", 0.4)
        said_now = rig_says(
            now_s + 2.0,
            run,
            LANDED,
            40.0,
            start_s,
            1.5,
            landed.get("turned", False),
            plate=landed.get("plate", False),
        )
        wish = test.run_tick(now_s + 2.0, said_now, True)
        assert said in wish.failure and wish.shaft_rpm == 0.0
        now_s += 2.0
    assert test.is_done and not test.runs and said in test.left_out[0][2]


def test_nothing_lands_is_said_after_the_longest_wait():
    test = LagProcedure(LagTestPlan(shaft_rpm=(40.0,), repeats=1, tries=1, longest_s=3.0))
    now_s, run = until_running(test, 0.0)
    assert test.run_tick(now_s + 2.9, rig_says(now_s + 2.9, run, ARMED), True).shaft_rpm == 40.0
    assert (
        "did not turn"
        in test.run_tick(now_s + 3.1, rig_says(now_s + 3.1, run, ARMED), True).failure
    )


def test_a_silent_rig_starts_nothing():
    test = LagProcedure()
    wishes = [test.run_tick(tick * 0.05, rig_says(0.0), True) for tick in range(400)]
    assert {wish.shaft_rpm for wish in wishes} == {0.0}
    assert {
        wish.shaft_rpm for wish in (test.run_tick(tick * 0.05, None, True) for tick in range(400))
    } == {0.0}


def test_the_plan_is_the_papers():
    plan = LagTestPlan()
    assert plan.shaft_rpm == (10, 20, 30, 40, 50, 60, 70) and plan.repeats == 10


def test_the_bench_table():
    runs = [MeasuredLagRun(20.0, 1, 0.3834, 1.5), MeasuredLagRun(10.0, 1, 0.38, 1.7)]
    assert (
        make_bench_table(runs)
        == "shaft_rpm,replicate,response_s,drop_s\n10,1,0.380,1.700\n20,1,0.383,1.500\n"
    )


def test_drop_times_of_a_shaft_that_somebody_else_turns(bench, clock):
    """The hand starts the shaft half a second after it was asked to, at 60 r/min."""
    cab, virtual, machine = bench
    test, phases, asked_s = DropProcedure(), [], None
    for tick in range(1500):
        clock.now_s += 0.02
        virtual.advance_to(clock.now_s)
        cab.read_measurements(clock.now_s)
        wish = test.run_tick(clock.now_s, cab.rig_readings)
        cab.send_rig_order(wish.run, wish.arm)
        assert not wish.failure
        phases += [wish.phase] if phases[-1:] != [wish.phase] else []
        asked_s = None if wish.phase not in ("start", "falling") else asked_s or clock.now_s
        turns = asked_s is not None and clock.now_s - asked_s > 0.5
        cab.send_command(clock.now_s, DriveCommand(60.0 if turns else 0.0, 25.0), tick > 10)
        if len(test.runs) == 2:
            break
    assert phases == ["stop", "arming", "start", "falling"] * 2 + ["stop"]
    fall = machine.fall
    for run in test.runs:
        assert run.shaft_rpm == pytest.approx(60.0, abs=1.0)
        assert run.drop_s == pytest.approx(fall.intercept_s + fall.slope_s_per_rpm * 60.0, abs=0.05)


@pytest.mark.parametrize(
    ("flag", "said"),
    [({"turned": True}, "before the rig was ready"), ({"plate": True}, "the plate was touched")],
)
def test_a_drop_that_cannot_be_right_is_not_kept(flag, said):
    test = DropProcedure(settle_s=1.0)
    for tick in range(60):
        wish = test.run_tick(tick * 0.05, rig_says(tick * 0.05))
    assert (wish.run, wish.arm, wish.phase) == (1, True, "arming")
    assert test.run_tick(3.1, rig_says(3.1, 1, ARMED)).phase == "start"
    assert said in test.run_tick(5.0, rig_says(5.0, 1, LANDED, 50.0, 3.5, 1.4, **flag)).failure
    assert (
        not test.runs
        and test.run_tick(5.1, rig_says(5.1, 1, LANDED, 50.0, 3.5, 1.4)).phase == "stop"
    )


def test_granules_that_never_come_are_told_after_the_longest_wait():
    test = DropProcedure(settle_s=1.0, longest_s=4.0)
    for tick in range(60):
        test.run_tick(tick * 0.05, rig_says(tick * 0.05))
    test.run_tick(3.1, rig_says(3.1, 1, ARMED))
    assert test.run_tick(4.0, rig_says(4.0, 1, 2, 30.0, 3.9)).phase == "falling"
    assert test.run_tick(7.9, rig_says(7.9, 1, 2, 30.0, 3.9)).failure == ""
    assert test.run_tick(8.1, rig_says(8.1, 1, 2, 30.0, 3.9)).failure == "nothing landed"


def test_the_table_of_drops():
    assert make_drop_table([DropRun(59.96, 1.6304), DropRun(20.0, 1.75)]) == (
        "shaft_rpm,replicate,drop_s\n60.0,1,1.630\n20.0,2,1.750\n"
    )
