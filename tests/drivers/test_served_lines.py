"""What is served: every device on its own line, faults on a time line, plugs pulled and put
back."""

from __future__ import annotations

import socket
import statistics
import sys
import time

import pytest
from topdress.control.field.job import Job
from topdress.control.machine.machine import Machine
from topdress.control.readings import DriveCommand, GnssFix
from topdress.control.simulation.plant import Plant
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.gnss import GnssDecoder
from topdress.drivers.ports import open_port, parse_socket_address
from topdress.drivers.virtual.faults import (
    PortFaults,
    ServedLine,
    TimedFault,
    find_faults,
    parse_fault,
    read_at_wrong_baud,
)
from topdress.drivers.virtual.machine import VirtualMachine, make_gnss_sentences, make_virtual_cab
from topdress.drivers.virtual.served_machine import ListeningPort, ServedMachine, ServeOptions

from tests.waiting import wait_for

DEVICES = ("gnss", "head_1", "head_2", "board")


def refuses(url: str) -> bool:
    """Nobody listens there. (A full queue of connections that nobody takes is something else.)"""
    try:
        socket.create_connection(parse_socket_address(url), 0.2).close()
    except OSError as error:
        return isinstance(error, ConnectionRefusedError)
    return False


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("unplug:gnss@60+10", TimedFault("unplug", "gnss", 60.0, 70.0)),
        ("frozen:heads@2.5", TimedFault("frozen", "heads", 2.5)),
        ("wrong_baud:head_2@0+1", TimedFault("wrong_baud", "head_2", 0.0, 1.0)),
    ],
)
def test_the_grammar_of_a_fault(text, fault):
    assert parse_fault(text, DEVICES) == fault


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("unplug gnss", "not understood"),
        ("melt:gnss@1", "unknown kind melt: allowed unplug"),
        ("unplug:gps@1", "unknown device gps: allowed gnss"),
        ("unplug:gnss@1.2.3", "must be numbers"),
    ],
)
def test_what_is_wrong_with_a_fault_is_said(text, said):
    with pytest.raises(ValueError, match=said):
        parse_fault(text, DEVICES)


def test_faults_add_up_and_end():
    timeline = [
        parse_fault(text, DEVICES)
        for text in ("garbage:heads@10+5", "delayed:head_2@12+5", "unplug:gnss@1+1")
    ]
    assert find_faults(timeline, "head_1", 9.9) == PortFaults()
    assert find_faults(timeline, "head_1", 12.0) == PortFaults(garbage_share=0.5)
    assert find_faults(timeline, "head_2", 12.0) == PortFaults(garbage_share=0.5, delay_s=1.0)
    assert find_faults(timeline, "head_2", 15.0) == PortFaults(delay_s=1.0)
    assert find_faults(timeline, "board", 12.0) == PortFaults()
    assert find_faults(timeline, "gnss", 2.0) == PortFaults()


def test_the_wrong_baud_gives_other_bytes_but_no_more_than_were_sent():
    sent = b"$GNGGA,060005.20,3416.8*5C\r\n" * 20
    heard = read_at_wrong_baud(sent)
    assert 0.3 * len(sent) < len(heard) < 0.7 * len(sent)
    assert b"GGA" not in heard
    assert read_at_wrong_baud(sent, 1.0) == sent, "at the right rate it is what was sent"


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        ("garbage", None),
        ("half_lines", None),
        ("duplicated", "repeated_sequence"),
        ("frozen", "repeated_sequence"),
        ("bit_flips", "bad_crc"),
        ("wrong_baud", None),
    ],
)
def test_each_fault_shows_in_the_counts_and_never_in_the_readings(clock, fake_plant, fault, kind):
    from topdress.drivers.virtual.faults import LINE_FAULTS

    cab, machine = make_virtual_cab(fake_plant, clock)
    board, line = cab._drives.decoder, ServedLine((machine._board_port,), clock, seed=0)
    line.set_faults(LINE_FAULTS[fault])
    machine._board_port = line
    for _ in range(200):
        clock.now_s += 0.05
        machine.advance_to(clock.now_s)
        measured = cab.read_measurements(clock.now_s)
        for reading, true in ((measured.opening_mm, 25.0), (measured.supply_v, 13.5)):
            assert reading is None or reading.value == true
    assert board.counts.rejected_total > 0
    assert kind is None or board.counts.rejected[kind] > 0


@pytest.fixture
def machine_at(fake_plant):
    """A served machine on free ports and the real clock; ended after the test."""
    made = []

    def make(**options):
        served = ServedMachine(fake_plant, ServeOptions(first_port=0, **options), time.monotonic)
        made.append(served)
        urls: dict[str, list[str]] = {}
        for address in served.addresses:
            urls.setdefault(address.device, []).append(address.url)
        return served, urls

    yield make
    for served in made:
        served.close()


def test_a_pulled_plug_ends_the_line_and_a_plugged_one_is_found_again(machine_at, fake_plant):
    served, urls = machine_at(faults=[TimedFault("unplug", "board", 2.0, 3.0)])
    port = open_port(urls["board"][0], 115200, time.monotonic)
    try:
        wait_for(lambda: served.advance_plant() == ["board: unplugged"])
        wait_for(lambda: not port.state().connected)
        heard = port.state().bytes_in
        assert heard > 0
        wait_for(lambda: refuses(urls["board"][0]))
        wait_for(lambda: served.advance_plant() == ["board: as it should be"])
        wait_for(lambda: served.advance_plant() or port.state().bytes_in > heard)
        assert port.state().connects == 2
    finally:
        port.close()


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on this system")
def test_a_pseudo_terminal_is_a_serial_port_that_can_be_pulled(machine_at, tmp_path):
    served, urls = machine_at(terminals=tmp_path, faults=[TimedFault("unplug", "gnss", 2.0, 3.0)])
    name = urls["gnss"][1]
    port = open_port(name, 115200, time.monotonic)
    try:
        wait_for(lambda: served.advance_plant() == ["gnss: unplugged"])
        wait_for(lambda: not port.state().connected)
        heard = port.state().bytes_in
        assert heard > 100 and port.state().format_last_lines()[0].startswith("$GN")
        wait_for(lambda: served.advance_plant() == ["gnss: as it should be"])
        wait_for(lambda: served.advance_plant() or port.state().bytes_in > heard)
    finally:
        port.close()
    served.close()
    assert not list(tmp_path.iterdir()), "no name is left behind"


def test_gpsd_rate_module_and_agopengps_are_served_too(machine_at, fake_plant):
    from topdress.drivers.datagrams import UdpPort

    module, pilot = (UdpPort("udp://127.0.0.1:0", time.monotonic) for _ in range(2))
    number = module.number
    module.close()
    console = UdpPort(f"udp://127.0.0.1:0?to=127.0.0.1:{number}", time.monotonic)
    served, urls = machine_at(
        rate_module=("127.0.0.1", number),
        console=("127.0.0.1", console.number),
        agopengps=("127.0.0.1", pilot.number),
    )
    heads = tuple(urls[f"head_{n}"][0] for n in range(1, 7))
    common = {
        "heads": {"ports": heads},
        "board": {"port": urls["board"][0]},
        "rate_module": {"pulses_per_turn": 360.0, "address": "127.0.0.1"},
    }
    cabs = [
        Cab(
            CabConfig.model_validate(
                common | {"gnss": {"protocol": "gpsd", "port": urls["gpsd"][0]}}
            ),
            time.monotonic,
            datagram_opener=lambda url, clock: console,
        ),
        Cab(
            CabConfig.model_validate(
                {"gnss": {"protocol": "agopengps", "port": "udp://127.0.0.1:17777"}}
            ),
            time.monotonic,
            opener=lambda url, baud, clock: pilot,
        ),
    ]

    def told() -> bool:
        served.advance_plant()
        now_s = time.monotonic()
        m, other = (cab.read_measurements(now_s) for cab in cabs)
        cabs[0].send_command(now_s, DriveCommand(60.0, 30.0), now_s - began_s > 0.3)
        return bool(
            m.gnss
            and other.gnss
            and other.gnss.speed_mps
            and m.shaft_rpm
            and m.shaft_rpm.value == 60.0
            and m.opening_mm
            and m.opening_mm.value == 30.0
            and m.ndvi[5]
        )

    began_s = time.monotonic()
    try:
        wait_for(told)
    finally:
        for cab in cabs:
            cab.close_devices()


# --- The virtual machine: sensors arrive through bytes, commands move the plant, silence stops
# it --------------------

RUN = DriveCommand(60.0, 30.0)


@pytest.fixture
def drive(clock):
    """Run cab and machine for a while; a command of None sends nothing at all."""

    def go(cab, machine, seconds, command=None, enabled=False, tick_s=0.05):
        for _ in range(round(seconds / tick_s)):
            clock.now_s += tick_s
            machine.advance_to(clock.now_s)
            measured = cab.read_measurements(clock.now_s)
            if command is not None:
                cab.send_command(clock.now_s, command, enabled)
        return measured

    return go


@pytest.mark.parametrize("multiplexed", [False, True])
@pytest.mark.parametrize("protocol", ["greenseeker", "acs430", "acs435"])
def test_what_the_plant_senses_is_measured(clock, drive, fake_plant, protocol, multiplexed):
    cab, machine = make_virtual_cab(fake_plant, clock, protocol=protocol, multiplexed=multiplexed)
    drive(cab, machine, 0.2, RUN, False)
    m = drive(cab, machine, 5.0, RUN, True)
    assert m.gnss is not None
    assert m.gnss.lat_deg == pytest.approx(34.28 + fake_plant.way_m / 111_195.0, abs=2e-9)
    assert m.gnss.lon_deg == pytest.approx(119.88, abs=2e-9)
    assert (m.gnss.fix_quality, m.gnss.satellites, m.gnss.hdop) == (4, 14, 0.8)
    assert m.gnss.speed_mps == pytest.approx(1.25, abs=3e-4)
    assert m.gnss.heading_deg == pytest.approx(359.9)
    assert m.gnss.utc == "2026-04-01T06:00:05.200Z"
    assert [reading.value for reading in m.ndvi] == pytest.approx(
        [0.40, 0.41, 0.42, 0.43, 0.44, 0.45]
    )
    assert m.ndvi[0].time_s == pytest.approx(clock.now_s, abs=0.5)
    assert m.wheel_speed_mps.value == pytest.approx(1.25, abs=0.001)
    assert (m.shaft_rpm.value, m.opening_mm.value, m.hopper_kg.value) == (60.0, 30.0, 250.05)
    assert (m.supply_v.value, m.pitch_deg.value, m.roll_deg.value, m.work_switch) == (
        13.5,
        1.5,
        -0.5,
        True,
    )
    assert {reading.time_s for reading in (m.shaft_rpm, m.opening_mm, m.wheel_speed_mps)} == {
        clock.now_s
    }


def test_no_sentence_was_rejected_on_a_clean_line(clock, drive, fake_plant):
    cab, machine = make_virtual_cab(fake_plant, clock)
    drive(cab, machine, 10.0, RUN, False)
    assert [device.rejected for device in cab.list_device_status(clock.now_s)] == [0] * 8
    assert cab.list_device_status(clock.now_s)[0].rate_hz == pytest.approx(5.0, rel=0.01)
    assert cab.list_device_status(clock.now_s)[-1].rate_hz == pytest.approx(20.0, rel=0.01)


def test_a_command_acts_from_the_next_step(clock, drive, fake_plant):
    cab, machine = make_virtual_cab(fake_plant, clock)
    drive(cab, machine, 0.2, RUN, False)
    fake_plant.commands.clear()
    cab.send_command(clock.now_s, RUN, True)
    drive(cab, machine, 0.05)
    assert fake_plant.commands == [(RUN, True)]


def test_standing_still_keeps_the_gate_where_it_is(clock, drive, fake_plant):
    cab, machine = make_virtual_cab(fake_plant, clock, opening_mm=17.0)
    drive(cab, machine, 0.5, RUN, False)
    assert set(fake_plant.commands) == {(DriveCommand(0.0, 17.0), False)}
    drive(cab, machine, 0.5, RUN, True)
    drive(cab, machine, 0.5, DriveCommand(60.0, 40.0), False)
    assert fake_plant.commands[-1] == (DriveCommand(0.0, 30.0), False)


def test_a_silent_host_stops_the_drives_within_a_second_until_told_to_start_again(
    clock, drive, fake_plant
):
    cab, machine = make_virtual_cab(fake_plant, clock)
    drive(cab, machine, 0.2, RUN, False)
    drive(cab, machine, 1.0, RUN, True)
    fake_plant.commands.clear()
    drive(cab, machine, 2.0)
    running = [enabled for _, enabled in fake_plant.commands]
    assert running.index(False) in (20, 21), "one second, to the tick"
    assert not any(running[21:])
    assert cab.board.heartbeat_lost and not cab.board.enabled
    m = drive(cab, machine, 1.0, RUN, True)
    assert m.shaft_rpm.value == 0.0, "the same command again does not start it"
    drive(cab, machine, 0.1, RUN, False)
    m = drive(cab, machine, 0.2, RUN, True)
    assert m.shaft_rpm.value == 60.0
    assert not cab.board.heartbeat_lost


def test_a_driver_fault_stops_and_is_told(clock, drive, fake_plant):
    cab, machine = make_virtual_cab(fake_plant, clock)
    drive(cab, machine, 0.2, RUN, False)
    drive(cab, machine, 0.5, RUN, True)
    machine.board.driver_fault = True
    m = drive(cab, machine, 0.2, RUN, True)
    assert m.shaft_rpm.value == 0.0
    assert cab.board.driver_fault


def test_advance_steps_exactly_up_to_now_and_skips_a_long_pause(clock, fake_plant):
    _, machine = make_virtual_cab(fake_plant, clock)
    assert machine.advance_to(100.049) == 0
    assert machine.advance_to(100.05) == 1
    assert machine.advance_to(101.0) == 19
    assert machine.advance_to(10_000.0) == 100
    assert machine.advance_to(10_000.05) == 1


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg"),
    [
        (34.28, 119.88),
        (-0.0000001, -179.9999999),
        (89.9999999, 0.5),
        (12.99999999999, -7.99999999999),
        (0.25, 1e-7),
    ],
)
def test_positions_survive_degrees_and_minutes(lat_deg, lon_deg):
    decoder = GnssDecoder(live=False)
    decoder.feed(make_gnss_sentences(GnssFix(0.0, lat_deg, lon_deg, 5)), 0.0)
    (fix,) = decoder.flush(0.0)
    assert not decoder.counts.rejected
    assert (fix.lat_deg, fix.lon_deg) == (
        pytest.approx(lat_deg, abs=2e-9),
        pytest.approx(lon_deg, abs=2e-9),
    )


def test_a_plant_without_a_fix_gives_no_position():
    decoder = GnssDecoder(live=False)
    decoder.feed(make_gnss_sentences(GnssFix(0.0, 34.28, 119.88, 0)), 0.0)
    assert decoder.flush(0.0) == []
    assert decoder.counts.ignored == {"no_fix": 3}


def test_the_same_ends_on_tcp(clock, fake_plant):
    """The real cab on real sockets against the listening virtual machine."""
    ends = [ListeningPort("127.0.0.1", 0, clock) for _ in range(3)]
    machine = VirtualMachine(fake_plant, ends[0], [ends[1]], ends[2], clock(), multiplexed=True)
    cab = Cab(
        CabConfig.model_validate(
            {
                "gnss": {"port": ends[0].name},
                "heads": {"ports": [ends[1].name], "multiplexed": True},
                "board": {"port": ends[2].name},
            }
        ),
        clock,
    )
    try:
        deadline = time.monotonic() + 30.0
        while True:
            clock.now_s += 0.05
            machine.advance_to(clock.now_s)
            m = cab.read_measurements(clock.now_s)
            cab.send_command(clock.now_s, RUN, clock.now_s > 101.0)
            if m.gnss and m.ndvi[5] and m.shaft_rpm and m.shaft_rpm.value == 60.0:
                break
            assert time.monotonic() < deadline
            time.sleep(0.005)
    finally:
        cab.close_devices()
        machine.close()


# --- The simulated machine of `control.simulation` behind the bytes: what the cab measures is
# what the plant ... -----


def test_thirty_seconds_of_the_real_plant(clock):
    plant = Plant(Machine(), Job(), seed=3)
    sensed = []
    step = plant.advance_plant
    plant.advance_plant = lambda command, enabled: (
        sensed.append(step(command, enabled)) or sensed[-1]
    )
    cab, machine = make_virtual_cab(plant, clock)
    wheel_errors = []
    for tick in range(600):
        clock.now_s += 0.05
        machine.advance_to(clock.now_s)
        m = cab.read_measurements(clock.now_s)
        cab.send_command(clock.now_s, DriveCommand(60.0, 30.0), tick > 20)
        last = sensed[-1]
        assert m.shaft_rpm.value == pytest.approx(last.shaft_rpm, abs=5e-4)
        assert m.opening_mm.value == pytest.approx(last.opening_mm, abs=5e-4)
        assert m.hopper_kg.value == pytest.approx(last.hopper_kg, abs=5e-4)
        if last.gnss is not None and tick > 5:
            assert m.gnss.time_s == clock.now_s, "no tick of latency"
            assert m.gnss._replace(time_s=0) == last.gnss._replace(
                time_s=0,
                lat_deg=pytest.approx(last.gnss.lat_deg, abs=2e-9),
                lon_deg=pytest.approx(last.gnss.lon_deg, abs=2e-9),
                speed_mps=pytest.approx(last.gnss.speed_mps, abs=3e-4),
                heading_deg=pytest.approx(last.gnss.heading_deg, abs=6e-4),
            )
        if last.ndvi is not None:
            assert [reading.value for reading in m.ndvi] == pytest.approx(last.ndvi, abs=6e-4)
        if tick > 300:
            wheel_errors.append(m.wheel_speed_mps.value - plant.truth.speed_mps)
    assert m.shaft_rpm.value == pytest.approx(60.0, abs=2.0)
    assert all(device.rejected == 0 for device in cab.list_device_status(clock.now_s))
    assert abs(statistics.mean(wheel_errors)) < 0.01
    assert statistics.pstdev(wheel_errors) < 0.06
