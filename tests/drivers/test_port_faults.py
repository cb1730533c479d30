"""Bad cables: each fault does what it says, and the cab keeps its head."""
from __future__ import annotations

import pytest

from control.readings import DriveCommand
from drivers.cab import Cab, CabConfig
from drivers.ports import memory_pair
from drivers.virtual.faults import FaultyPort, PortFaults
from drivers.virtual.machine import VirtualMachine


@pytest.fixture
def line(clock):
    """Device end, and a faulty host end."""
    host, device = memory_pair("line", clock)
    return device, FaultyPort(host, clock, seed=1)


def test_no_fault_changes_nothing(line):
    device, port = line
    device.write(b"one\ntwo\n")
    assert port.read() == b"one\ntwo\n"


def test_unplugged(line):
    device, port = line
    device.write(b"lost\n")
    port.faults = PortFaults(unplugged=True)
    port.write(b"lost too")
    assert (port.read(), device.read(), port.state().connected) == (b"", b"", False)
    port.faults = PortFaults()
    device.write(b"back\n")
    assert (port.read(), port.state().connected) == (b"back\n", True)


def test_frozen_repeats_the_last_line(line):
    device, port = line
    device.write(b"one\n")
    port.read()
    port.faults = PortFaults(frozen=True)
    device.write(b"two\nthree\n")
    assert port.read() == b"one\none\n"


def test_delayed(line, clock):
    device, port = line
    port.faults = PortFaults(delay_s=0.3)
    device.write(b"one\n")
    assert port.read() == b""
    clock.now_s += 0.29
    device.write(b"two\n")
    assert port.read() == b""
    clock.now_s += 0.02
    assert port.read() == b"one\n"


def test_half_double_and_dirty_lines(line):
    device, port = line
    for faults, expected in ((PortFaults(half_share=1.0), b"12345"),
                             (PortFaults(duplicate_share=1.0), b"123456789\n" * 2)):
        port.faults = faults
        device.write(b"123456789\n")
        assert port.read() == expected
    port.faults = PortFaults(garbage_share=1.0)
    device.write(b"123456789\n")
    assert (found := port.read()).endswith(b"123456789\n") and len(found) > 10
    port.faults = PortFaults(bit_flip_share=1.0)
    device.write(b"123456789\n")
    flipped = port.read()
    assert sum((a ^ b).bit_count() for a, b in zip(flipped, b"123456789\n", strict=True)) == 1


BAD = {"board": PortFaults(garbage_share=0.2, half_share=0.2, duplicate_share=0.2, bit_flip_share=0.2),
       "gnss": PortFaults(garbage_share=0.2, half_share=0.2, duplicate_share=0.2, bit_flip_share=0.2)}


@pytest.fixture
def bad_cab(clock, fake_plant):
    """Cab and machine joined by faulty ports, which are given by name."""
    pairs = {name: memory_pair(name, clock) for name in ("gnss", "heads", "board")}
    ports = {name: FaultyPort(pair[0], clock, seed=7) for name, pair in pairs.items()}
    machine = VirtualMachine(fake_plant, pairs["gnss"][1], [pairs["heads"][1]], pairs["board"][1], clock(),
                             multiplexed=True)
    config = CabConfig.model_validate({"gnss": {"port": "gnss"}, "board": {"port": "board"},
                                       "heads": {"ports": ["heads"], "multiplexed": True}})
    return Cab(config, clock, lambda url, _baud, _clock: ports[url]), machine, ports


def test_through_a_bad_line_nothing_wrong_is_accepted(bad_cab, clock, fake_plant):
    cab, machine, ports = bad_cab
    for name, faults in BAD.items():
        ports[name].faults = faults
    seen = 0
    for tick in range(2000):
        clock.now_s += 0.05
        machine.advance(clock.now_s)
        m = cab.measure(clock.now_s)
        cab.command(clock.now_s, DriveCommand(60.0, 30.0), tick > 4)
        if tick > 100:
            assert (m.hopper_kg.value, m.supply_v.value, m.work_switch) == (250.05, 13.5, True)
            assert m.shaft_rpm.value == 60.0
            assert m.gnss.lat_deg == pytest.approx(34.28 + fake_plant.way_m / 111_195.0, abs=2e-5)
            assert m.wheel_speed_mps.value == pytest.approx(1.25, abs=0.01)
            seen += m.shaft_rpm.time_s == clock.now_s
    assert seen > 800
    assert all(device.rejected > 100 for device in cab.status(clock.now_s) if device.name != "heads")


def test_an_unplugged_device_goes_stale_and_comes_back(bad_cab, clock):
    cab, machine, ports = bad_cab

    def run(seconds):
        for _ in range(round(seconds / 0.05)):
            clock.now_s += 0.05
            machine.advance(clock.now_s)
            m = cab.measure(clock.now_s)
            cab.command(clock.now_s, DriveCommand(60.0, 30.0), False)
        return m
    run(2.0)
    ports["board"].faults = PortFaults(unplugged=True)
    m = run(2.0)
    assert clock.now_s - m.shaft_rpm.time_s == pytest.approx(2.0)
    assert not cab.status(clock.now_s)[-1].connected
    ports["board"].faults = PortFaults()
    assert run(0.1).shaft_rpm.time_s == clock.now_s


def test_a_frozen_board_is_silent_not_steady(bad_cab, clock):
    """The same status line again and again is a repeated sequence number, so the drive goes stale."""
    cab, machine, ports = bad_cab
    for tick in range(80):
        ports["board"].faults = PortFaults(frozen=tick >= 40)
        clock.now_s += 0.05
        machine.advance(clock.now_s)
        m = cab.measure(clock.now_s)
    assert clock.now_s - m.shaft_rpm.time_s == pytest.approx(2.0)
