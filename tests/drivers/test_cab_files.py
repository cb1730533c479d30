"""Cab files: what is shipped, what is said about them, and what they change in the worker: work switch, fixed gate."""
from __future__ import annotations

import datetime as dt

import pytest

from control.orders import Do, Order, Strategy
from control.readings import Measurements
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.closed_loop import Record, simulated_run
from drivers.cab import Cab, CabConfig
from drivers.files.config import ConfigError, load, load_any, schema, shipped
from drivers.files.kinds import CAB, KINDS
from drivers.files.setup import load_setup
from drivers.ports import memory_pair


def test_three_cabs_are_shipped():
    assert set(shipped("cabs")) == {"virtual", "virtual_module", "huanghai_cab"}
    real = load("huanghai_cab", CAB).model
    assert isinstance(real, CabConfig) and real.heads is not None and real.heads.count == 6
    assert real.gnss is not None and real.board is not None and real.has_work_switch and not real.virtual
    assert load("virtual", CAB).model.virtual


def test_the_schema_is_published_for_editors():
    body = schema(CAB)
    assert {"gnss", "heads", "board", "rate_module", "lag_rig"} <= set(body["properties"])


@pytest.mark.parametrize(("text", "said"), [
    ("board: {port: COM3, baud: 1}", "board.baud: value 1"),
    ("board: {port: COM3, work_switch: 1}", "board.work_switch"),
    ("board: {port: 'spy://loop://?file=job.yaml'}", "board.port: .*allowed is a serial device"),
    ("heads: {ports: [COM3, 'hwgrep://x']}", "heads.ports.2.: .*allowed is a serial device"),
    ("tractor: {port: 'socket://127.0.0.1'}", "tractor.port: .*allowed is socket://HOST:PORT"),
    ("lag_rig: {port: 'udp://127.0.0.1'}", "lag_rig.port: .*allowed is udp://HOST:PORT"),
    ("gnss: {port: COM3, protocol: ubx}", "gnss.protocol: value ubx"),
    ("heads: {ports: [a, b], protocol: psychic}", "allowed is one of greenseeker"),
    ("rate_module: {pulses_per_turn: 360.0, listen: 0.0.0.0}", "fixed_opening_mm is missing")])
def test_what_is_wrong_is_said_with_file_key_and_line(tmp_path, text, said):
    path = tmp_path / "cab.yaml"
    path.write_text(f"format: topdress-cab/1\n{text}\n")
    with pytest.raises(ConfigError, match=said) as error:
        load_any(path, KINDS)
    assert str(error.value).startswith(str(path)) and "(line " in str(error.value)


@pytest.fixture
def switched(clock):
    def make(fitted: bool):
        host, device = memory_pair("board", clock)
        return Cab(CabConfig.model_validate({"board": {"port": "b", "work_switch": fitted}}), clock,
                   lambda *_: host), device
    return make


def test_a_fitted_work_switch_that_falls_silent_is_not_known(switched, board_line, clock):
    cab, device = switched(True)
    assert cab.measure(100.0).work_switch is None
    device.write(board_line("S1,0,0,1000000,0,0,60.0,25.0,,,,,1,1"))
    assert cab.measure(100.0).work_switch is True
    assert cab.measure(100.5).work_switch is True
    assert cab.measure(100.6).work_switch is None
    device.write(board_line("S1,1,0,1600000,0,0,60.0,25.0,,,,,0,1"))
    assert cab.measure(100.6).work_switch is False
    device.write(board_line("S1,2,0,1700000,0,0,60.0,25.0,,,,,,1"))
    assert cab.measure(101.2).work_switch is None, "the board speaks, but not of its switch"


def test_without_one_silence_means_nothing(switched, board_line):
    cab, device = switched(False)
    device.write(board_line("S1,0,0,1000000,0,0,60.0,25.0,,,,,1,1"))
    assert cab.measure(100.0).work_switch is True
    assert cab.measure(110.0).work_switch is True


@pytest.mark.parametrize("fitted", [True, False])
def test_the_worker_tells_its_loop_of_the_switch(tmp_path, fitted):
    """Only a switch that is fitted counts as up where nothing is heard of it."""
    from console.worker import assemble as assembling
    from console.worker.options import Options
    path = tmp_path / f"{fitted}.yaml"
    path.write_text("format: topdress-cab/1\nboard: {port: 'socket://127.0.0.1:9', work_switch: "
                    f"{str(fitted).lower()}}}\n")
    parts = assembling.assemble(Options((str(path),), tmp_path / "w.json", log=str(tmp_path / f"{fitted}.csv")),
                                lambda: 0.0)
    assert not parts.names.simulated
    parts.bench.close()
    parts.writer.close()
    for now_s, do in ((0.0, Do.READY), (0.05, Do.START)):
        parts.loop.tick(Measurements(now_s))
        assert parts.loop.order(Order(do)).accepted
    assert ("work_switch_up" in parts.loop.tick(Measurements(0.1)).why_no_flow) is fitted


@pytest.mark.parametrize("strategy", list(Strategy))
def test_a_gate_set_by_hand_is_never_told_to_move_and_the_rate_still_holds(strategy):
    from console.worker.assemble import with_fixed_gate
    setup = load_setup("huanghai", "demo", dt.date(2026, 4, 1))
    job = with_simulated_field(setup.job.model_copy(update={"strategy": strategy}), setup.machine)
    machine = with_fixed_gate(setup.machine, 30.0)
    plant = simulated_machine(machine, job, 3, 0.05)
    loop = control_loop(machine, setup.crop, setup.rule, job)
    record, openings, errors = Record(), set(), []
    for step in simulated_run(plant, loop, 30.0):
        record.add(step)
        row = step.tick.row
        if row.state == "working":
            openings.add(row.opening_mm_cmd)
            if row.time_s > 18.0 and row.applied_rate_kg_ha and row.target_rate_kg_ha > 50.0:
                errors.append(row.applied_rate_kg_ha / row.target_rate_kg_ha - 1.0)
    assert openings and min(openings) >= 29.7 and max(openings) <= 30.3, "30 mm and the trim of a tenth"
    assert abs(sum(errors) / len(errors)) < 0.05


def test_two_figures_for_one_wheel_are_said_by_check_and_refused_by_a_run(tmp_path):
    from typer.testing import CliRunner

    from console.cli import app
    from console.worker.assemble import assemble
    from console.worker.options import Options
    from drivers.files.config import save
    from drivers.files.kinds import MACHINE
    cab, machine = tmp_path / "cab.yaml", tmp_path / "machine.yaml"
    cab.write_text("format: topdress-cab/1\nboard: {port: 'socket://127.0.0.1:9', wheel_circumference_m: 2.45}\n")
    nominal = load("huanghai", MACHINE).model
    said = "key board.wheel_circumference_m: value 2.45: allowed 2.5, as"
    for circumference, wrong in ((2.5, True), (2.45, False)):
        machine.unlink(missing_ok=True)
        save(machine, nominal.model_copy(update={"speed": nominal.speed._replace(
            wheel_circumference_m=circumference)}), MACHINE)
        result = CliRunner().invoke(app, ["check", str(cab), str(machine)])
        assert (result.exit_code == 2) == wrong and (said in result.output) == wrong
    with pytest.raises(ValueError, match="as the shipped machine huanghai has it"):
        assemble(Options((str(cab),), tmp_path / "w.json", log=str(tmp_path / "a.csv")), lambda: 0.0)
    parts = assemble(Options((str(cab), str(machine)), tmp_path / "w.json", log=str(tmp_path / "b.csv")), lambda: 0.0)
    parts.bench.close()
    parts.writer.close()


def test_valves_are_reached_through_the_bytes_of_the_virtual_machine():
    """A pass of a machine with sections, the middle one closed by hand from 25 s on; then the host falls silent."""
    from control.field.job import Wanted
    from control.orders import Do, Order, TargetSource
    from drivers.virtual.machine import virtual_cab
    setup = load_setup("huanghai_sections", "demo", dt.date(2026, 4, 1))
    target = Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=300.0)
    job = with_simulated_field(setup.job.model_copy(update={"target": target}), setup.machine)
    truths, now = [], [0.0]
    plant = simulated_machine(setup.machine, job, 3, 0.05, keep=truths.append)
    loop = control_loop(setup.machine, setup.crop, setup.rule, job)
    cab, machine = virtual_cab(plant, lambda: now[0])
    orders = {1.0: Order(Do.READY), 8.0: Order(Do.START), 25.0: Order(Do.SECTION, "2 off")}
    for k in range(800):
        now[0] = round(0.05 * k, 3)
        machine.advance(now[0])
        if now[0] in orders:
            loop.order(orders[now[0]])
        if now[0] < 35.0:
            tick = loop.tick(cab.measure(now[0]))
            cab.command(now[0], tick.command, tick.enabled)

    def passed(low_s, high_s):
        return [sum(t.section_kg[section] for t in truths if low_s < t.time_s < high_s) for section in range(3)]

    before, after, silent = passed(18.0, 24.9), passed(26.0, 34.9), passed(36.5, 40.0)
    assert before == pytest.approx([before[0]] * 3) and before[0] > 0.1
    assert after[1] == 0.0 and after[0] == pytest.approx(after[2]) and after[0] > 0.1
    assert silent == [0.0] * 3, "the board closes them a second after the last word"


def test_valves_that_no_device_drives_are_said(tmp_path):
    from typer.testing import CliRunner

    from console.cli import app
    from drivers.files.config import shipped
    machine = str(shipped("machines")["huanghai_sections"])
    module = "rate_module: {pulses_per_turn: 360.0, fixed_opening_mm: 25.0, address: 127.0.0.1"
    for devices, wrong in ((module + "}", True), (module + ", valves: true}", False),
                           ("board: {port: 'socket://127.0.0.1:9'}", False)):
        cab = tmp_path / "cab.yaml"
        cab.write_text(f"format: topdress-cab/1\n{devices}\n")
        result = CliRunner().invoke(app, ["check", str(cab), machine])
        assert (result.exit_code != 0) == wrong, result.output
        assert ("key board: missing: allowed a board, or a rate module with valves" in result.output) == wrong
