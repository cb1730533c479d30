"""What is served: every device on its own line, faults on a time line, plugs pulled and put back."""
from __future__ import annotations

import socket
import sys
import time

import pytest

from drivers.cab import Cab, CabConfig
from drivers.ports import open_port, socket_address
from drivers.virtual.faults import FaultyPort, PortFaults, TimedFault, at_wrong_baud, faults_at, parse_fault
from drivers.virtual.served import Serve, ServedMachine

DEVICES = ("gnss", "head_1", "head_2", "board")


def within(what, seconds=30.0):
    deadline = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def refuses(url: str) -> bool:
    """Nobody listens there. (A full queue of connections that nobody takes is something else.)"""
    try:
        socket.create_connection(socket_address(url), 0.2).close()
    except OSError as error:
        return isinstance(error, ConnectionRefusedError)
    return False


@pytest.mark.parametrize(("text", "fault"), [
    ("unplug:gnss@60+10", TimedFault("unplug", "gnss", 60.0, 70.0)),
    ("frozen:heads@2.5", TimedFault("frozen", "heads", 2.5)),
    ("wrong_baud:head_2@0+1", TimedFault("wrong_baud", "head_2", 0.0, 1.0))])
def test_the_grammar_of_a_fault(text, fault):
    assert parse_fault(text, DEVICES) == fault


@pytest.mark.parametrize(("text", "said"), [
    ("unplug gnss", "not understood"), ("melt:gnss@1", "unknown kind melt: allowed unplug"),
    ("unplug:gps@1", "unknown device gps: allowed gnss"), ("unplug:gnss@1.2.3", "must be numbers")])
def test_what_is_wrong_with_a_fault_is_said(text, said):
    with pytest.raises(ValueError, match=said):
        parse_fault(text, DEVICES)


def test_faults_add_up_and_end():
    timeline = [parse_fault(text, DEVICES) for text in ("garbage:heads@10+5", "delayed:head_2@12+5", "unplug:gnss@1+1")]
    assert faults_at(timeline, "head_1", 9.9) == PortFaults()
    assert faults_at(timeline, "head_1", 12.0) == PortFaults(garbage_share=0.5)
    assert faults_at(timeline, "head_2", 12.0) == PortFaults(garbage_share=0.5, delay_s=1.0)
    assert faults_at(timeline, "head_2", 15.0) == PortFaults(delay_s=1.0)
    assert faults_at(timeline, "board", 12.0) == PortFaults()
    assert faults_at(timeline, "gnss", 2.0) == PortFaults()


def test_the_wrong_baud_gives_other_bytes_but_no_more_than_were_sent():
    sent = b"$GNGGA,060005.20,3416.8*5C\r\n" * 20
    heard = at_wrong_baud(sent)
    assert 0.3 * len(sent) < len(heard) < 0.7 * len(sent)
    assert b"GGA" not in heard
    assert at_wrong_baud(sent, 1.0) == sent, "at the right rate it is what was sent"


@pytest.mark.parametrize(("fault", "kind"), [
    ("garbage", None), ("half_lines", None), ("duplicated", "repeated_sequence"), ("frozen", "repeated_sequence"),
    ("bit_flips", "bad_crc"), ("wrong_baud", None)])
def test_each_fault_shows_in_the_counts_and_never_in_the_readings(clock, fake_plant, fault, kind):
    from drivers.virtual.faults import KINDS
    from drivers.virtual.machine import virtual_cab
    cab, machine = virtual_cab(fake_plant, clock)
    line, board = cab._drives
    line.port = FaultyPort(line.port, clock, KINDS[fault])
    for _ in range(200):
        clock.now_s += 0.05
        machine.advance(clock.now_s)
        measured = cab.measure(clock.now_s)
        for reading, true in ((measured.opening_mm, 25.0), (measured.supply_v, 13.5)):
            assert reading is None or reading.value == true
    assert board.counts.rejected_total > 0
    assert kind is None or board.counts.rejected[kind] > 0


@pytest.fixture
def machine_at(fake_plant):
    """A served machine on free ports and the real clock; ended after the test."""
    made = []

    def make(**options):
        served = ServedMachine(fake_plant, Serve(first_port=0, **options), time.monotonic)
        made.append(served)
        urls: dict[str, list[str]] = {}
        for address in served.addresses:
            urls.setdefault(address.device, []).append(address.url)
        return served, urls
    yield make
    for served in made:
        served.close()


def test_a_pulled_plug_ends_the_line_and_a_plugged_one_is_found_again(machine_at, fake_plant):
    served, urls = machine_at(faults=[TimedFault("unplug", "board", 0.3, 0.8)])
    port = open_port(urls["board"][0], 115200, time.monotonic)
    try:
        within(lambda: served.advance() == ["board: unplugged"])
        within(lambda: not port.state().connected)
        heard = port.state().bytes_in
        assert heard > 0
        within(lambda: refuses(urls["board"][0]))
        within(lambda: served.advance() == ["board: as it should be"])
        within(lambda: served.advance() or port.state().bytes_in > heard)
        assert port.state().connects == 2
    finally:
        port.close()


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on this system")
def test_a_pseudo_terminal_is_a_serial_port_that_can_be_pulled(machine_at, tmp_path):
    served, urls = machine_at(terminals=tmp_path, faults=[TimedFault("unplug", "gnss", 0.5, 1.0)])
    name = urls["gnss"][1]
    port = open_port(name, 115200, time.monotonic)
    try:
        within(lambda: served.advance() == ["gnss: unplugged"])
        within(lambda: not port.state().connected)
        heard = port.state().bytes_in
        assert heard > 100 and port.state().last_lines()[0].startswith("$GN")
        within(lambda: served.advance() == ["gnss: as it should be"])
        within(lambda: served.advance() or port.state().bytes_in > heard)
    finally:
        port.close()
    served.close()
    assert not list(tmp_path.iterdir()), "no name is left behind"


def test_gpsd_rate_module_and_agopengps_are_served_too(machine_at, fake_plant):
    from drivers.datagrams import UdpPort
    module, pilot = (UdpPort("udp://127.0.0.1:0", time.monotonic) for _ in range(2))
    number = module.number
    module.close()
    console = UdpPort(f"udp://127.0.0.1:0?to=127.0.0.1:{number}", time.monotonic)
    served, urls = machine_at(rate_module=("127.0.0.1", number), console=("127.0.0.1", console.number),
                              agopengps=("127.0.0.1", pilot.number))
    heads = tuple(urls[f"head_{n}"][0] for n in range(1, 7))
    common = {"heads": {"ports": heads}, "board": {"port": urls["board"][0]},
              "rate_module": {"pulses_per_turn": 360.0, "address": "127.0.0.1"}}
    cabs = [Cab(CabConfig.model_validate(common | {"gnss": {"protocol": "gpsd", "port": urls["gpsd"][0]}}),
                time.monotonic, datagram_opener=lambda url, clock: console),
            Cab(CabConfig.model_validate({"gnss": {"protocol": "agopengps", "port": "udp://127.0.0.1:17777"}}),
                time.monotonic, opener=lambda url, baud, clock: pilot)]
    from control.readings import DriveCommand

    def told() -> bool:
        served.advance()
        now_s = time.monotonic()
        m, other = (cab.measure(now_s) for cab in cabs)
        cabs[0].command(now_s, DriveCommand(60.0, 30.0), now_s - began_s > 0.3)
        return bool(m.gnss and other.gnss and other.gnss.speed_mps and m.shaft_rpm and m.shaft_rpm.value == 60.0
                    and m.opening_mm and m.opening_mm.value == 30.0 and m.ndvi[5])

    began_s = time.monotonic()
    try:
        within(told)
    finally:
        for cab in cabs:
            cab.close()
