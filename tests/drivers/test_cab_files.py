"""Cab files: what is shipped, what is said about them, and what they change in the worker: work
switch, fixed gate."""

from __future__ import annotations

import datetime as dt
import math
import time

import pytest
from pydantic import ValidationError
from topdress.control.orders import Do, Order, Strategy
from topdress.control.readings import DriveCommand, Measurements, Reading
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import RunRecord, simulate_run
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.files.config import (
    ConfigError,
    find_shipped_files,
    load_any_config,
    load_config,
    make_json_schema,
)
from topdress.drivers.files.config_kinds import CAB_KIND, CONFIG_KINDS
from topdress.drivers.files.run_setup import load_setup
from topdress.drivers.ports import make_memory_pair
from topdress.drivers.virtual.machine import make_virtual_cab

from tests.command import topdress


def test_three_cabs_are_shipped():
    assert set(find_shipped_files("cabs")) == {"virtual", "virtual_module", "huanghai_cab"}
    real = load_config("huanghai_cab", CAB_KIND).model
    assert isinstance(real, CabConfig) and real.heads is not None and real.heads.count == 6
    assert (
        real.gnss is not None
        and real.board is not None
        and real.has_work_switch
        and not real.virtual
    )
    assert load_config("virtual", CAB_KIND).model.virtual


def test_the_schema_is_published_for_editors():
    body = make_json_schema(CAB_KIND)
    assert {"gnss", "heads", "board", "rate_module", "lag_rig"} <= set(body["properties"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("board: {port: COM3, baud: 1}", "board.baud: value 1"),
        ("board: {port: COM3, work_switch: 1}", "board.work_switch"),
        (
            "board: {port: 'spy://loop://?file=job.yaml'}",
            "board.port: .*allowed is a serial device",
        ),
        ("heads: {ports: [COM3, 'hwgrep://x']}", "heads.ports.2.: .*allowed is a serial device"),
        ("tractor: {port: 'socket://127.0.0.1'}", "tractor.port: .*allowed is socket://HOST:PORT"),
        ("lag_rig: {port: 'udp://127.0.0.1'}", "lag_rig.port: .*allowed is udp://HOST:PORT"),
        ("gnss: {port: COM3, protocol: ubx}", "gnss.protocol: value ubx"),
        ("heads: {ports: [a, b], protocol: psychic}", "allowed is one of greenseeker"),
        ("rate_module: {pulses_per_turn: 360.0, listen: 0.0.0.0}", "fixed_opening_mm is missing"),
    ],
)
def test_what_is_wrong_is_said_with_file_key_and_line(tmp_path, text, said):
    path = tmp_path / "cab.yaml"
    path.write_text(f"format: topdress-cab/1\n{text}\n")
    with pytest.raises(ConfigError, match=said) as error:
        load_any_config(path, CONFIG_KINDS)
    assert str(error.value).startswith(str(path)) and "(line " in str(error.value)


@pytest.fixture
def switched(clock):
    def make(fitted: bool):
        host, device = make_memory_pair("board", clock)
        return Cab(
            CabConfig.model_validate({"board": {"port": "b", "work_switch": fitted}}),
            clock,
            lambda *_: host,
        ), device

    return make


def test_a_fitted_work_switch_that_falls_silent_is_not_known(switched, board_line, clock):
    cab, device = switched(True)
    assert cab.read_measurements(100.0).work_switch is None
    device.write(board_line("S1,0,0,1000000,0,0,60.0,25.0,,,,,1,1"))
    assert cab.read_measurements(100.0).work_switch is True
    assert cab.read_measurements(100.5).work_switch is True
    assert cab.read_measurements(100.6).work_switch is None
    device.write(board_line("S1,1,0,1600000,0,0,60.0,25.0,,,,,0,1"))
    assert cab.read_measurements(100.6).work_switch is False
    device.write(board_line("S1,2,0,1700000,0,0,60.0,25.0,,,,,,1"))
    assert cab.read_measurements(101.2).work_switch is None, (
        "the board speaks, but not of its switch"
    )


def test_without_one_silence_means_nothing(switched, board_line):
    cab, device = switched(False)
    device.write(board_line("S1,0,0,1000000,0,0,60.0,25.0,,,,,1,1"))
    assert cab.read_measurements(100.0).work_switch is True
    assert cab.read_measurements(110.0).work_switch is True


@pytest.mark.parametrize("fitted", [True, False])
def test_the_worker_tells_its_loop_of_the_switch(tmp_path, fitted):
    """Only a switch that is fitted counts as up where nothing is heard of it."""
    from topdress.console.worker import assemble as assembling
    from topdress.console.worker.options import Options

    path = tmp_path / f"{fitted}.yaml"
    path.write_text(
        "format: topdress-cab/1\nboard: {port: 'socket://127.0.0.1:9', work_switch: "
        f"{str(fitted).lower()}}}\n"
    )
    parts = assembling.assemble_run(
        Options((str(path),), tmp_path / "w.json", log=str(tmp_path / f"{fitted}.csv")), lambda: 0.0
    )
    assert not parts.names.simulated
    parts.bench.close_devices()
    parts.writer.close()
    for now_s, do in ((0.0, Do.READY), (0.05, Do.START)):
        parts.loop.run_tick(Measurements(now_s))
        assert parts.loop.handle_order(Order(do)).accepted
    assert ("work_switch_up" in parts.loop.run_tick(Measurements(0.1)).why_no_flow) is fitted


@pytest.mark.parametrize("strategy", list(Strategy))
def test_a_gate_set_by_hand_is_never_told_to_move_and_the_rate_still_holds(strategy):
    from topdress.console.worker.assemble import fix_gate_opening

    setup = load_setup("huanghai", "demo", dt.date(2026, 4, 1))
    job = add_simulated_field(setup.job.model_copy(update={"strategy": strategy}), setup.machine)
    machine = fix_gate_opening(setup.machine, 30.0)
    plant = make_plant(machine, job, 3, 0.05)
    loop = make_control_loop(machine, setup.crop, setup.rule, job)
    record, openings, errors = RunRecord(), set(), []
    for step in simulate_run(plant, loop, 30.0):
        record.add_tick(step)
        row = step.tick.row
        if row.state == "working":
            openings.add(row.opening_mm_cmd)
            if row.time_s > 18.0 and row.applied_rate_kg_ha and row.target_rate_kg_ha > 50.0:
                errors.append(row.applied_rate_kg_ha / row.target_rate_kg_ha - 1.0)
    assert openings and min(openings) >= 29.7 and max(openings) <= 30.3, (
        "30 mm and the trim of a tenth"
    )
    assert abs(sum(errors) / len(errors)) < 0.05


def test_two_figures_for_one_wheel_are_said_by_check_and_refused_by_a_run(tmp_path):

    from topdress.console.worker.assemble import assemble_run
    from topdress.console.worker.options import Options
    from topdress.drivers.files.config import save_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    cab, machine = tmp_path / "cab.yaml", tmp_path / "machine.yaml"
    cab.write_text(
        "format: topdress-cab/1\nboard: {port: 'socket://127.0.0.1:9', "
        "wheel_circumference_m: 2.45}\n"
    )
    nominal = load_config("huanghai", MACHINE_KIND).model
    said = "key board.wheel_circumference_m: value 2.45: allowed 2.5, as"
    for circumference, wrong in ((2.5, True), (2.45, False)):
        machine.unlink(missing_ok=True)
        save_config(
            machine,
            nominal.model_copy(
                update={"speed": nominal.speed._replace(wheel_circumference_m=circumference)}
            ),
            MACHINE_KIND,
        )
        result = topdress("check", cab, machine)
        assert (result.exit_code == 2) == wrong and (said in result.output) == wrong
    with pytest.raises(ValueError, match="as the shipped machine huanghai has it"):
        assemble_run(
            Options((str(cab),), tmp_path / "w.json", log=str(tmp_path / "a.csv")), lambda: 0.0
        )
    parts = assemble_run(
        Options((str(cab), str(machine)), tmp_path / "w.json", log=str(tmp_path / "b.csv")),
        lambda: 0.0,
    )
    parts.bench.close_devices()
    parts.writer.close()


def test_valves_are_reached_through_the_bytes_of_the_virtual_machine():
    """A pass of a machine with sections, the middle one closed by hand from 25 s on; then the
    host falls silent."""
    from topdress.control.field.job import Wanted
    from topdress.control.orders import Do, Order, TargetSource

    setup = load_setup("huanghai_sections", "demo", dt.date(2026, 4, 1))
    target = Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=300.0)
    job = add_simulated_field(setup.job.model_copy(update={"target": target}), setup.machine)
    truths, now = [], [0.0]
    plant = make_plant(setup.machine, job, 3, 0.05, keep=truths.append)
    loop = make_control_loop(setup.machine, setup.crop, setup.rule, job)
    cab, machine = make_virtual_cab(plant, lambda: now[0])
    orders = {1.0: Order(Do.READY), 8.0: Order(Do.START), 25.0: Order(Do.SECTION, "2 off")}
    for k in range(800):
        now[0] = round(0.05 * k, 3)
        machine.advance_to(now[0])
        if now[0] in orders:
            loop.handle_order(orders[now[0]])
        if now[0] < 35.0:
            tick = loop.run_tick(cab.read_measurements(now[0]))
            cab.send_command(now[0], tick.command, tick.is_enabled)

    def passed(low_s, high_s):
        return [
            sum(t.section_kg[section] for t in truths if low_s < t.time_s < high_s)
            for section in range(3)
        ]

    before, after, silent = passed(18.0, 24.9), passed(26.0, 34.9), passed(36.5, 40.0)
    assert before == pytest.approx([before[0]] * 3) and before[0] > 0.1
    assert after[1] == 0.0 and after[0] == pytest.approx(after[2]) and after[0] > 0.1
    assert silent == [0.0] * 3, "the board closes them a second after the last word"


def test_valves_that_no_device_drives_are_said(tmp_path):

    machine = str(find_shipped_files("machines")["huanghai_sections"])
    module = "rate_module: {pulses_per_turn: 360.0, fixed_opening_mm: 25.0, address: 127.0.0.1"
    for devices, wrong in (
        (module + "}", True),
        (module + ", valves: true}", False),
        ("board: {port: 'socket://127.0.0.1:9'}", False),
    ):
        cab = tmp_path / "cab.yaml"
        cab.write_text(f"format: topdress-cab/1\n{devices}\n")
        result = topdress("check", cab, machine)
        assert (result.exit_code != 0) == wrong, result.output
        assert (
            "key board: missing: allowed a board, or a rate module with valves" in result.output
        ) == wrong


# --- The cab: configuration, measurements from bytes, commands, device list, cost of a tick
# --------------------------

CONFIG = {
    "gnss": {"port": "gnss"},
    "board": {"port": "board", "max_shaft_rpm": 90},
    "heads": {"protocol": "acs430", "ports": ["h1", "h2"]},
}


@pytest.fixture
def plugged(clock):
    """A cab, and the device ends of its lines by port name."""
    pairs = {name: make_memory_pair(name, clock) for name in ("gnss", "board", "h1", "h2")}
    bauds = {}

    def opener(url, baud, _clock):
        bauds[url] = baud
        return pairs[url][0]

    cab = Cab(CabConfig.model_validate(CONFIG), clock, opener)
    assert bauds == {"gnss": 115200, "board": 115200, "h1": 38400, "h2": 38400}
    return cab, {name: pair[1] for name, pair in pairs.items()}


def test_nothing_received_is_nothing_known(plugged):
    m = plugged[0].read_measurements(100.0)
    assert (m.time_s, m.gnss, m.ndvi, m.shaft_rpm, m.wheel_speed_mps, m.work_switch) == (
        100.0,
        None,
        (None, None),
        None,
        None,
        None,
    )


def test_each_head_on_its_own_port_is_its_own_reading(plugged):
    cab, lines = plugged
    lines["h2"].write(b"0.2,0.65,1,2,3\r\n")
    assert cab.read_measurements(100.0).ndvi == (None, Reading(0.65, 100.0))
    lines["h1"].write(b"0.2,0.45,1,2,3\r\n0.2,0.46,1,2,3\r\n")
    assert cab.read_measurements(100.05).ndvi == (Reading(0.46, 100.05), Reading(0.65, 100.0)), (
        "held with its own time"
    )


def test_board_values_are_held_with_their_times(plugged, board_line):
    cab, lines = plugged
    lines["board"].write(board_line("S1,0,0,1000000,0,0,60.0,25.0,250.0,13.5,,,1,1"))
    cab.read_measurements(100.0)
    lines["board"].write(board_line("S1,1,0,1050000,0,0,61.0,25.5,,13.5,,,,1"))
    m = cab.read_measurements(100.05)
    assert (m.shaft_rpm, m.hopper_kg, m.pitch_deg) == (
        Reading(61.0, 100.05),
        Reading(250.0, 100.0),
        None,
    )
    assert cab.board is not None and cab.board.enabled


def test_commands_reach_the_board_and_are_cut_to_the_machines_limits(plugged, board_line):
    cab, lines = plugged
    cab.send_command(100.0, DriveCommand(200.0, 30.0), True)
    assert lines["board"].read() == board_line("T1,0,90.000,30.000,1")


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_set_point_that_is_not_finite_becomes_a_stop(plugged, bad, board_line):
    cab, lines = plugged
    cab.send_command(100.0, DriveCommand(60.0, 30.0), True)
    lines["board"].read()
    cab.send_command(100.05, DriveCommand(bad, 30.0), True)
    assert lines["board"].read() == board_line("T1,1,0.000,30.000,0")
    assert cab.refused_commands == 1


def test_closing_stops_the_drives(plugged, board_line):
    cab, lines = plugged
    cab.close_devices()
    assert lines["board"].read() == board_line("T1,0,0.000,0.000,0")
    assert not lines["gnss"].state().connected


def test_status_lists_every_device(plugged, board_line):
    cab, lines = plugged
    for tick in range(40):
        lines["board"].write(
            board_line(f"S1,{tick},0,1000000,0,0,60.0,25.0,250.0,13.5,,,1,1") + b"noise\r\n"
        )
        cab.read_measurements(100.0 + tick * 0.05)
    gnss, head, _, board = cab.list_device_status(102.0)
    assert (gnss.name, gnss.connected, gnss.age_s, gnss.rate_hz, gnss.accepted) == (
        "gnss",
        True,
        None,
        0.0,
        0,
    )
    assert (head.name, head.protocol, head.port) == ("head_1", "acs430", "h1:host")
    assert (board.accepted, board.rejected, board.last_raw) == (40, 40, "noise")
    assert board.rate_hz == pytest.approx(20.0)
    assert board.age_s == pytest.approx(0.05)
    assert cab.list_device_status(110.0)[3].rate_hz == 0.0, "a silent device has no rate"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"heads": {"ports": []}}, "heads.ports"),
        ({"heads": {"ports": ["a", "b"], "multiplexed": True}}, "a multiplexed line has 1"),
        ({"heads": {"ports": ["a"], "protocol": "psychic"}}, "allowed is one of greenseeker"),
        ({"heads": {"ports": ["a"], "layout": {"fields": 3, "ndvi": 4}}}, "at most fields 3"),
        ({"gnss": {"port": "a", "baud": 1}}, "gnss.baud"),
        ({"board": {"port": "a", "max_shaft_rpm": -1}}, "board.max_shaft_rpm"),
        ({"gpss": {"port": "a"}}, "gpss"),
    ],
)
def test_configuration_errors_name_what_is_wrong(change, words):
    with pytest.raises(ValidationError, match=words):
        CabConfig.model_validate(change)


def test_a_tick_costs_no_more_after_a_minute_than_at_first(clock, fake_plant):
    """Twenty milliseconds a tick, six heads, GNSS at 5 Hz: the median of 300 late ticks over that
    of 300 early ones, in the thread's own time. What it costs: `python -m benchmarks speed --only
    work`."""
    fake_plant.dt_s = 0.02
    cab, machine = make_virtual_cab(fake_plant, clock)
    took_s = []
    for _ in range(3300):
        clock.now_s += 0.02
        machine.advance_to(clock.now_s)
        begin_s = time.thread_time()
        cab.read_measurements(clock.now_s)
        took_s.append(time.thread_time() - begin_s)
    early_s, late_s = (sorted(some)[150] for some in (took_s[50:350], took_s[3000:]))
    assert late_s < 3.0 * early_s


def test_a_board_that_does_not_follow_is_told(plugged, board_line):
    cab, lines = plugged
    seq = iter(range(100))

    def measured(now_s, flags):
        lines["board"].write(
            board_line(f"S1,{next(seq)},0,1000000,0,0,60.0,25.0,250.0,13.5,,,1,{flags}")
        )
        m = cab.read_measurements(now_s)
        return m.drive_fault, m.drive_stopped

    def told(now_s, enabled):
        cab.send_command(now_s, DriveCommand(60.0, 25.0), enabled)

    assert measured(100.0, 2) == (False, False), "not told to turn: it may stand"
    told(100.0, True)
    assert measured(100.25, 0) == (False, False), "it may take its time"
    assert measured(100.35, 1) == (False, False)
    assert measured(105.0, 2) == (False, True), "heartbeat lost"
    assert measured(105.05, 0) == (False, True), (
        "restarted: it has lost nothing that it knows of, and stands"
    )
    told(105.1, False)
    assert measured(105.15, 0) == (False, False)
    told(105.2, True)
    assert measured(105.25, 0) == (False, False), "the time begins anew"
    assert measured(105.6, 4) == (True, False), "a driver's fault is its own alarm"


def test_a_device_whose_driver_raises_is_put_aside_until_it_is_plugged_again(
    plugged, board_line, monkeypatch
):
    """The others are read in the same tick; the console is told; a board goes on being told to
    stop."""
    cab, lines = plugged
    good = board_line("S1,0,0,1000000,0,0,60.0,25.0,250.0,13.5,,,1,1")
    monkeypatch.setattr("topdress.drivers.devices.slave_board.decode_status", lambda frame: 1 / 0)
    lines["board"].write(good)
    lines["h2"].write(b"0.2,0.65,1,2,3\r\n")
    m = cab.read_measurements(100.0)
    assert m.ndvi == (None, Reading(0.65, 100.0)) and m.put_aside == ("board",)
    assert (
        cab.find_device_line("board").make_status(100.0).last_error
        == "put aside: ZeroDivisionError: division by zero"
    )
    monkeypatch.undo()
    lines["board"].write(good)
    assert cab.read_measurements(100.05).shaft_rpm is None
    cab.send_command(100.05, None, False)
    assert lines["board"].read() == board_line("T1,0,0.000,0.000,0")
    cab.find_device_line("board").set_plugged(False)
    cab.find_device_line("board").set_plugged(True)
    lines["board"].write(good)
    m = cab.read_measurements(100.1)
    assert m.shaft_rpm == Reading(60.0, 100.1) and m.put_aside == ()


def test_who_listens_in_and_raises_is_left_out(plugged):
    cab, lines = plugged
    heard = []
    cab.find_device_line("head_1").add_tap(lambda *_: 1 / 0)
    cab.find_device_line("head_1").add_tap(lambda *said: heard.append(said))
    for _ in range(2):
        lines["h1"].write(b"0.2,0.45,1,2,3\r\n")
        assert cab.read_measurements(100.0).put_aside == ()
    assert len(heard) == 2
