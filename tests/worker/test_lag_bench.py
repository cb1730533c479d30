"""The lag test inside the worker: the real loop, cab, board and rig programs on a standing
simulated machine."""

from __future__ import annotations

import datetime as dt
import statistics

import pytest
from topdress.console.cli.lag_rig import LagOperator
from topdress.console.worker.loop_host import Host
from topdress.console.worker.requests import ClientQuestion
from topdress.console.worker.run_interfaces import RunAssembly, RunNames
from topdress.console.worker.side_files import SideFiles
from topdress.control.calibration.lag_fit import fit_lag
from topdress.control.field.job import Simulated
from topdress.control.orders import Answer, Do, Order
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.lag_run import LagTestPlan
from topdress.drivers.files.bench_table import read_bench_table
from topdress.drivers.files.run_setup import load_setup
from topdress.drivers.ports import make_memory_pair
from topdress.drivers.virtual.lag_rig import VirtualLagRig
from topdress.drivers.virtual.machine import VirtualMachine

STEP_S = 0.02


class Rig:
    """A host at 50 Hz on the virtual machine; `held`: somebody holds the button down."""

    def __init__(self, log_path, fake, speed_kmh=0.0):
        setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
        values = setup.job.simulated.model_dump() | {
            "speed_changes": ({"at_s": 0.0, "speed_kmh": speed_kmh},)
        }
        job = add_simulated_field(
            setup.job.model_copy(update={"simulated": Simulated.model_validate(values)}),
            setup.machine,
        )
        self.now_s = 0.0
        self.machine = setup.machine
        self.plant = make_plant(setup.machine, job, 1, STEP_S)
        pairs = {
            name: make_memory_pair(name, lambda: self.now_s)
            for name in ("gnss", "heads", "board", "rig")
        }
        self.virtual = VirtualMachine(
            self.plant,
            pairs["gnss"][1],
            [pairs["heads"][1]],
            pairs["board"][1],
            0.0,
            multiplexed=True,
            extras=[VirtualLagRig(pairs["rig"][1], lambda: self.plant.truth)],
        )
        cab = Cab(
            CabConfig.model_validate(
                {"gnss": {"port": "gnss"}, "board": {"port": "board"}, "lag_rig": {"port": "rig"}}
            ),
            lambda: self.now_s,
            lambda url, baud, clock: pairs[url][0],
        )
        loop = make_control_loop(setup.machine, setup.crop, setup.rule, job)
        self.writer = fake.FakeWriter()
        self.host = Host(
            RunAssembly(cab, loop, self.writer, RunNames(log_path=str(log_path))),
            lambda: self.now_s,
            lambda _: None,
            hz=50.0,
        )
        self.held = False

    def ask(self, what):
        said = []
        self.host.queue_request(what, lambda answer, extra: said.append(answer))
        self.run(STEP_S)
        return said[0]

    def order(self, do, value=None):
        return self.ask(Order(do, value))

    def run(self, seconds):
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            if self.held and round(self.now_s / STEP_S) % 10 == 0:
                self.host.queue_request(Order(Do.CALIBRATE), lambda *_: None)
            self.virtual.advance_to(self.now_s)
            self.host.run_one_tick(self.now_s)
            self.host.note_console_heard()
        return self.host.newest_frame


@pytest.fixture
def bench(tmp_path, fake):
    made = Rig(tmp_path / "run.csv", fake)
    made.run(3.0)
    assert made.order(Do.READY).accepted
    yield made
    made.host.close_run("end of test")


def test_the_test_measures_while_the_button_is_held_and_its_table_calibrates(bench, tmp_path):
    assert bench.ask(ClientQuestion.LAG_TEST).accepted
    bench.host.lag.begin_lag_test(
        tmp_path / "run.lag.1.csv", LagTestPlan((10.0, 40.0, 70.0), repeats=1, settle_s=2.5)
    )
    view = bench.run(5.0).lag_test
    assert (view.phase, view.runs) == ("settling", ()) and not any(
        row.shaft_rpm_cmd for row in bench.writer.rows
    )
    bench.held = True
    view = bench.run(35.0).lag_test
    assert (view.phase, view.progress, view.left_out, len(view.runs)) == ("done", 1.0, 0, 3)
    assert {row.shaft_rpm_cmd for row in bench.writer.rows} == {0.0, 10.0, 40.0, 70.0}
    responses = [response_s for _, response_s, _ in view.runs]
    assert statistics.mean(responses) == pytest.approx(bench.machine.shaft.dead_time_s, abs=0.06)
    bench.host.close_run("end")
    table = read_bench_table(tmp_path / "run.lag.1.csv", None)
    assert (table.kind, table.rows, view.table_path) == ("lag", 3, str(tmp_path / "run.lag.1.csv"))
    assert [
        tuple(row)
        for row in zip(
            *(table.columns[name] for name in ("shaft_rpm", "response_s", "drop_s")), strict=True
        )
    ] == pytest.approx([tuple(round(value, 3) for value in run) for run in view.runs])
    _, line = fit_lag(table, bench.machine)
    assert line.measured == "drop_s" and line.rows_used == 3


def test_letting_go_stops_the_shaft_and_the_run_begins_again_when_held_again(bench, tmp_path):
    bench.host.lag.begin_lag_test(tmp_path / "t.csv", LagTestPlan((40.0,), repeats=1, settle_s=1.0))
    bench.held = True
    bench.run(2.5)
    assert bench.plant.truth.shaft_rpm > 30.0
    bench.held = False
    frame = bench.run(0.6)
    assert (frame.row.state, frame.row.shaft_rpm_cmd, frame.lag_test.runs) == ("ready", 0.0, ())
    bench.run(3.0)
    bench.held = True
    assert len(bench.run(12.0).lag_test.runs) == 1


@pytest.mark.exam
def test_a_hopper_of_runs_needs_more_than_one_press_of_two_minutes(bench, tmp_path):
    bench.host.lag.begin_lag_test(
        tmp_path / "t.csv", LagTestPlan((40.0,), repeats=1, settle_s=125.0)
    )
    bench.held = True
    frame = bench.run(121.0)
    assert (frame.row.state, frame.why_state, frame.lag_test.runs) == (
        "ready",
        "calibration_time",
        (),
    )


def test_an_ended_test_stops_the_shaft_and_leaves_the_run_to_the_operator(bench, tmp_path):
    bench.host.lag.begin_lag_test(tmp_path / "t.csv", LagTestPlan((40.0,), repeats=1, settle_s=1.0))
    bench.held = True
    bench.run(2.5)
    assert bench.plant.truth.shaft_rpm > 30.0
    assert bench.ask(ClientQuestion.END_LAG_TEST).accepted
    frame = bench.run(1.0)
    assert (frame.row.state, frame.row.shaft_rpm_cmd, frame.lag_test) == ("calibrating", 0.0, None)
    assert bench.order(Do.CALIBRATE_SHAFT, 20.0).accepted
    assert bench.run(0.5).row.shaft_rpm_cmd == 20.0


def test_without_a_rig_there_is_no_test(rig):
    r = rig()
    said = []
    r.host.queue_request(ClientQuestion.LAG_TEST, lambda answer, extra: said.append(answer))
    r.host.run_one_tick(0.0)
    assert said == [Answer(False, "no_lag_rig")]
    assert r.host.newest_frame.lag_test is None and not r.bench.rig_orders


def test_side_files_are_written_in_order_and_can_be_begun_again(tmp_path):
    files = SideFiles()
    for number in range(50):
        files.queue_append(tmp_path / "a", b"%d " % number)
    files.close_files()
    files.queue_append(tmp_path / "a", b"end")
    files.close_files()
    assert (tmp_path / "a").read_bytes() == b"".join(b"%d " % n for n in range(50)) + b"end"
    assert files.trouble == ""


class Hand:
    """A keyboard whose space bar repeats 20 times a second while `down`."""

    def __init__(self):
        self.down = False

    def read_pressed(self):
        return " " if self.down else ""


def attend(bench, tmp_path, no_key=False, repeats=1):
    """The command's own attendant at the bench, `go(seconds)` with whatever its hand does."""
    hand = Hand()
    attended = LagOperator(
        hand,
        tmp_path / "table.csv",
        LagTestPlan((40.0,), repeats=repeats, settle_s=2.5),
        opening_mm=20.0,
        no_key=no_key,
        with_gnss=True,
        clock=lambda: bench.now_s,
        sleep=lambda _: None,
    )
    attended.host = bench.host

    def go(seconds):
        for _ in range(round(seconds / STEP_S)):
            bench.now_s += STEP_S
            bench.virtual.advance_to(bench.now_s)
            bench.host.run_one_tick(bench.now_s)
            attended.pause_between_ticks(0.0)
        return bench.host.newest_frame

    return hand, attended, go


@pytest.mark.exam
def test_the_command_turns_the_shaft_only_while_the_key_is_down(bench, tmp_path):
    hand, attended, go = attend(bench, tmp_path)
    assert go(5.0).row.state == "ready", "nobody touched the key"
    hand.down = True
    go(0.02)
    hand.down = False
    assert go(2.0).row.state == "ready", "a stray press turns nothing"
    hand.down = True
    frame = go(3.4)
    assert (frame.row.state, frame.row.shaft_rpm_cmd, frame.row.opening_mm_cmd) == (
        "calibrating",
        40.0,
        20.0,
    )
    hand.down = False
    assert go(0.5).row.shaft_rpm_cmd == 0.0, "commanded off within half a second of letting go"
    go(1.0)
    assert bench.plant.truth.shaft_rpm < 5.0
    hand.down = True
    go(12.0)
    assert (attended.measured, attended.trouble, attended.left_out) == (1, "", [])
    assert len((tmp_path / "table.csv").read_text().splitlines()) == 2


@pytest.mark.exam
def test_without_a_key_it_goes_on_in_runs_of_two_minutes(bench, tmp_path):
    _, attended, go = attend(bench, tmp_path, no_key=True, repeats=25)
    states = []
    for _ in range(40):
        states.append(go(5.0).bench)
    assert attended.measured == 25 and attended.trouble == ""
    assert max(run.elapsed_s for run in states if run) <= 120.0
    events = [event for row in bench.writer.rows for event in (row.events or "").split(";")]
    assert (
        events.count("calibrate") > 1 and events.count("release") == events.count("calibrate") - 1
    )


def test_a_fault_ends_the_test_with_its_reason(bench, tmp_path):
    _, attended, go = attend(bench, tmp_path, no_key=True)
    go(3.4)
    bench.virtual.board.driver_fault = True
    go(0.3)
    assert attended.trouble.startswith("A motor driver reports a fault")
    assert go(0.1).row.shaft_rpm_cmd == 0.0
