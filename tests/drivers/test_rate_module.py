"""Rate modules on UDP: datagrams byte by byte, the traps, and the virtual module on a datagram
line."""

from __future__ import annotations

import itertools
import math
import socket
import struct

import pytest
from topdress.control.readings import DriveCommand
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.datagrams import (
    MAX_DATAGRAMS_PER_READ,
    UdpPort,
    make_datagram_pair,
    parse_udp_address,
)
from topdress.drivers.devices.protocol_probe import recognise_modules
from topdress.drivers.devices.rate_module import ModuleAddress, RateModule
from topdress.drivers.devices.rate_module_frames import (
    FlowTarget,
    RelayStates,
    decode_command,
    encode_target,
)
from topdress.drivers.ports import make_memory_pair
from topdress.drivers.virtual.virtual_devices import VirtualRateModule

WITH_BOARD = {"pulses_per_turn": 360.0, "listen": "0.0.0.0"}
MODULE = WITH_BOARD | {"fixed_opening_mm": 25.0}


def sealed(body: bytes) -> bytes:
    """The checksum is computed here, not by the code under test."""
    return body + bytes([sum(body) % 256])


def status(
    rpm: float = 60.0, module: int = 0, sensor: int = 0, flags: int = 1, quantity: int = 0
) -> bytes:
    """32400 by hand."""
    return sealed(
        struct.pack("<HB", 32400, module << 4 | sensor)
        + int(rpm * 1000).to_bytes(3, "little")
        + quantity.to_bytes(3, "little")
        + struct.pack("<hBH", 120, flags, 3600)
    )


def module() -> RateModule:
    return RateModule(ModuleAddress(0, 0), 360.0, 100.0)


def test_a_target_is_these_fourteen_bytes():
    """60 units a minute, 360 pulses a unit, motor, master on, auto, module 2 sensor 1."""
    data = encode_target(FlowTarget(2, 1, 60.0, 360.0, "motor", master_on=True))
    by_hand = bytes([0xF4, 0x7E, 0x21, 0x60, 0xEA, 0x00, 0x40, 0x7E, 0x05, 0b0101_0100, 0, 0, 0])
    assert data == sealed(by_hand)
    assert len(data) == 14


def test_the_first_command_brings_relays_and_target():
    """32501 is mandatory: without a relay bit the module neither controls nor counts."""
    told = [decode_command(data) for data in module().make_datagrams(60.0, True, 0.0)]
    assert told == [RelayStates(0, 0, 1), FlowTarget(0, 0, 60.0, 360.0, "motor", True, True)]


def test_commands_go_on_change_and_as_often_as_the_module_needs():
    driver, sent = module(), []
    for tick in range(200):
        rpm = 60.0 if tick < 60 else 61.0
        sent += [
            (tick, decode_command(data)) for data in driver.make_datagrams(rpm, True, tick * 0.05)
        ]
    targets = [(tick, told.units_per_min) for tick, told in sent if isinstance(told, FlowTarget)]
    assert (60, 61.0) in targets, "a change at once"
    gaps = [(after - before) * 0.05 for (before, _), (after, _) in itertools.pairwise(targets)]
    assert max(gaps) <= 0.55, "far from the 4 s after which the module stops"
    relays = [tick for tick, told in sent if isinstance(told, RelayStates)]
    assert max(b - a for a, b in itertools.pairwise(relays)) <= 21


def test_a_stop_is_sent_in_the_same_tick_and_the_relay_stays_for_the_run_down():
    driver = module()
    driver.make_datagrams(60.0, True, 0.0)
    assert driver.make_datagrams(61.0, True, 0.05) == [], "changes are spaced ..."
    (stop,) = [decode_command(data) for data in driver.make_datagrams(60.0, False, 0.06)]
    assert (stop.units_per_min, stop.master_on) == (0.0, False), "... a stop is not"
    later = [
        decode_command(data)
        for tick in range(100)
        for data in driver.make_datagrams(None, False, 0.1 + tick * 0.05)
    ]
    assert all(told.units_per_min == 0.0 for told in later if isinstance(told, FlowTarget))
    assert [told.relays for told in later if isinstance(told, RelayStates)][:3] == [1, 1, 0]


@pytest.mark.parametrize(
    ("asked", "sent"), [(250.0, 100.0), (-5.0, 0.0), (16777.3, 100.0), (1e12, 100.0)]
)
def test_set_points_are_cut_and_never_wrap(asked, sent):
    told = [decode_command(data) for data in module().make_datagrams(asked, True, 0.0)]
    assert told[1].units_per_min == sent


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_set_point_that_is_not_finite_is_refused(bad):
    with pytest.raises(ValueError, match="finite"):
        module().make_datagrams(bad, True, 0.0)


@pytest.mark.parametrize("value", [16777.216, -0.001, math.nan])
def test_what_does_not_fit_into_24_bits_is_refused_not_wrapped(value):
    with pytest.raises(ValueError, match=r"allowed is 0 to 16777\.215"):
        encode_target(FlowTarget(0, 0, 60.0, value))


def test_a_status_is_a_reading():
    (readings,) = module().feed([status(59.9)], 5.0)
    assert (
        readings.shaft_rpm.value,
        readings.shaft_rpm.time_s,
        readings.pwm,
        readings.hears_us,
    ) == (pytest.approx(59.9), 5.0, 120, True)


@pytest.mark.parametrize(
    ("data", "counted"),
    [
        (status()[:-1], ({"wrong_length": 1}, {})),
        (status() + b"\0", ({"wrong_length": 1}, {})),
        (status() * 2, ({"wrong_length": 1}, {})),
        (status(rpm=500.0), ({"out_of_range": 1}, {})),
        (status()[:-1] + bytes([status()[-1] ^ 1]), ({"bad_checksum": 1}, {})),
        (status(module=1), ({}, {"other_module": 1})),
        (status(sensor=1), ({}, {"other_module": 1})),
        (b"", ({}, {"unknown_message": 1})),
        (b"hello", ({}, {"unknown_message": 1})),
    ],
)
def test_what_is_wrong_is_rejected_what_is_not_for_us_ignored_and_neither_says_anything(
    data, counted
):
    driver = module()
    assert (
        driver.feed([data], 0.0) == []
        and (driver.counts.rejected, driver.counts.ignored) == counted
    )


def test_turns_run_on_over_the_wrap_of_the_quantity():
    driver = module()
    turns = [
        driver.feed([status(quantity=quantity)], 0.0)[0].turns
        for quantity in (2**24 - 20, 2**24 - 10, 5, 25, 0)
    ]
    assert turns == pytest.approx([0.0, 1.0, 2.5, 4.5, 4.5]), "back to 0 is a restarted module"


def test_a_module_that_does_not_hear_us_is_no_drive():
    """It is set to another comm mode, or another console has it: it reports, and its report
    must not look fresh."""
    driver = module()
    found = [driver.feed([status(flags=0)], tick * 0.2)[0].shaft_rpm is None for tick in range(15)]
    assert found == [False] * 10 + [True] * 5
    assert driver.feed([status(flags=1)], 3.2)[0].shaft_rpm is not None


@pytest.fixture
def plugged(clock):
    """A cab with a rate module and a gate set by hand, and the virtual module."""
    host, device = make_datagram_pair("module", clock)
    cab = Cab(
        CabConfig.model_validate({"rate_module": MODULE}),
        clock,
        datagram_opener=lambda url, _clock: host,
    )
    return cab, VirtualRateModule(device, 360.0), device


def steps(plugged, clock, seconds, command=None, enabled=False, silent=False):
    """Plant and cab, 20 a second; the shaft follows at once. The last measurement, and the
    commanded speeds."""
    cab, virtual, _ = plugged
    speeds = []
    for _ in range(round(seconds / 0.05)):
        begin_s = clock.now_s - 100.0
        command_now, _ = virtual.alter_command(begin_s, DriveCommand(0.0, 25.0), False)
        speeds.append(command_now.shaft_rpm)
        clock.now_s += 0.05
        from types import SimpleNamespace

        virtual.take_readings(
            SimpleNamespace(
                time_s=begin_s + 0.05, shaft_rpm=speeds[-1], wheel_pulses=0, work_switch=True
            ),
            begin_s,
        )
        m = cab.read_measurements(clock.now_s)
        if not silent:
            cab.send_command(clock.now_s, command, enabled)
    return m, speeds


def test_the_module_turns_the_shaft_and_tells_it(plugged, clock):
    m, speeds = steps(plugged, clock, 2.0, DriveCommand(60.0, 25.0), True)
    assert speeds[-1] == 60.0
    assert (
        m.shaft_rpm.value == pytest.approx(60.0, abs=0.01)
        and clock.now_s - m.shaft_rpm.time_s <= 0.2
    )
    assert (m.opening_mm.value, m.opening_mm.time_s) == (25.0, m.shaft_rpm.time_s), (
        "as fresh as the module's news"
    )
    assert m.shaft_effort == (pytest.approx(100.0 * 150 / 255), m.shaft_rpm.time_s), (
        "% of full duty"
    )
    _, speeds = steps(plugged, clock, 0.1, DriveCommand(60.0, 25.0), False)
    assert speeds[-1] == 0.0


def test_the_module_stops_by_itself_only_after_four_seconds(plugged, clock):
    steps(plugged, clock, 2.0, DriveCommand(60.0, 25.0), True)
    _, speeds = steps(plugged, clock, 6.0, silent=True)
    stopped_s = speeds.index(0.0) * 0.05
    assert 3.4 < stopped_s <= 4.05, "4 s after the last target, which was half a second old at most"


def test_a_silent_module_leaves_no_fresh_reading(plugged, clock):
    cab, _, device = plugged
    steps(plugged, clock, 2.0, DriveCommand(60.0, 25.0), True)
    device.close()
    clock.now_s += 0.6
    m = cab.read_measurements(clock.now_s)
    assert clock.now_s - m.shaft_rpm.time_s > 0.5 and clock.now_s - m.opening_mm.time_s > 0.5
    clock.now_s += 2.0
    assert not cab.list_device_status(clock.now_s)[0].connected


def test_without_a_relay_bit_the_module_does_nothing():
    line = make_datagram_pair("m", lambda: 0.0)
    virtual = VirtualRateModule(line[1], 360.0)
    line[0].write(encode_target(FlowTarget(0, 0, 60.0, 360.0, "motor", True)))
    assert virtual.alter_command(0.0, DriveCommand(0.0, 25.0), False)[0].shaft_rpm == 0.0
    for data in itertools.islice(module().make_datagrams(60.0, True, 0.0), 1):
        line[0].write(data)
    assert virtual.alter_command(0.1, DriveCommand(0.0, 25.0), False)[0].shaft_rpm == 60.0


def test_a_wrong_number_of_pulses_shows_as_a_wrong_speed(clock):
    line = make_datagram_pair("m", lambda: 0.0)
    virtual = VirtualRateModule(line[1], 400.0)
    for data in module().make_datagrams(60.0, True, 0.0):
        line[0].write(data)
    assert virtual.alter_command(0.0, DriveCommand(0.0, 25.0), False)[0].shaft_rpm == pytest.approx(
        54.0
    )


def test_with_a_board_it_moves_the_gate_and_the_module_the_shaft(clock, board_line):
    host, device = make_datagram_pair("module", clock)
    lines = make_memory_pair("board", clock)
    cab = Cab(
        CabConfig.model_validate({"board": {"port": "b"}, "rate_module": WITH_BOARD}),
        clock,
        lambda url, baud, _clock: lines[0],
        lambda url, _clock: host,
    )
    cab.send_command(100.0, DriveCommand(60.0, 33.0), True)
    assert lines[1].read() == board_line("T1,0,0.000,33.000,1")
    assert [decode_command(data) for data in device.read_each()][1].units_per_min == 60.0
    lines[1].write(board_line("S1,0,0,1000000,0,0,1.0,33.0,250.0,13.5,,,,1"))
    device.write(status(59.0))
    m = cab.read_measurements(100.05)
    assert (m.shaft_rpm.value, m.opening_mm.value) == (59.0, 33.0)
    cab.send_command(100.1, DriveCommand(math.nan, 33.0), True)
    assert lines[1].read() == board_line("T1,1,0.000,33.000,0"), (
        "a number refused by one drive stops both"
    )
    assert [decode_command(data) for data in device.read_each()][-1] == FlowTarget(
        0, 0, 0.0, 360.0, "motor", False, True
    )
    assert cab.refused_commands == 1


def test_the_operator_is_told_of_the_four_seconds():
    config = CabConfig.model_validate({"rate_module": MODULE})
    assert any("only after 4 s" in line for line in config.warnings)
    assert config.rate_module.url == "udp://0.0.0.0:29999?to=192.168.1.50:28888"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rate_module": WITH_BOARD}, "fixed_opening_mm is missing"),
        ({"rate_module": MODULE, "board": {"port": "b"}}, "leave one"),
        ({"rate_module": MODULE | {"pulses_per_turn": 20000.0}}, "16777"),
        ({"gnss": {"protocol": "agopengps", "port": "COM3"}}, "udp://127.0.0.1:17777"),
        ({"gnss": {"port": "udp://127.0.0.1:17777"}}, "serial port"),
        (
            {"gnss": {"protocol": "agopengps", "port": "udp://0.0.0.0:17777"}},
            "anybody on that network",
        ),
        (
            {"rate_module": MODULE | {"listen": "127.0.0.1"}},
            "listen 127.0.0.1: a module at 192.168.1.50 cannot be heard",
        ),
        (
            {"rate_module": MODULE | {"address": "127.0.0.1"}},
            "listen 0.0.0.0: a module at 127.0.0.1 cannot be heard",
        ),
        ({"rate_module": MODULE | {"address": "192.168.1.255"}}, "subnet is missing"),
        ({"rate_module": MODULE | {"address": "module.local"}}, "subnet is missing"),
        (
            {"rate_module": MODULE | {"subnet": "192.168.1.7/24"}},
            "subnet 192.168.1.7/24: allowed is a network",
        ),
    ],
)
def test_configuration_mistakes_are_said(change, said):
    with pytest.raises(ValueError, match=said):
        CabConfig.model_validate(change)


@pytest.mark.parametrize(
    "url",
    ["udp://nowhere", "tcp://a:1", "udp://a:1?to=b", "udp://a:99999999", "udp://1.2.3.4:1?from=x"],
)
def test_an_address_that_cannot_be_read_is_said(url):
    with pytest.raises(ValueError, match=r"allowed is udp://HOST:PORT"):
        parse_udp_address(url)


def test_a_taken_port_is_tried_again(clock):
    first = UdpPort("udp://127.0.0.1:0", clock)
    second = UdpPort(f"udp://127.0.0.1:{first.number}", clock)
    assert second.number == 0 and second.state().last_error
    number = first.number
    first.close()
    clock.now_s += 1.1
    assert second.read_each() == [] and second.number == number
    second.close()


@pytest.mark.parametrize(
    ("url", "senders"),
    [
        ("udp://127.0.0.1:0", "127.0.0.0/8"),
        ("udp://localhost:0", "127.0.0.0/8"),
        ("udp://0.0.0.0:29999?to=192.168.1.50:28888", "192.168.1.50/32"),
        ("udp://0.0.0.0:29999?to=192.168.1.255:28888&from=192.168.1.0/24", "192.168.1.0/24"),
        ("udp://192.168.1.9:17777?from=192.168.1.20", "192.168.1.20/32"),
        ("udp://0.0.0.0:29999", "None"),
    ],
)
def test_who_is_believed(url, senders):
    assert str(parse_udp_address(url).senders) == senders


def test_a_stranger_is_not_heard(clock):
    """He sits at another address of this computer; a flood of his costs a bounded number of
    looks."""
    port = UdpPort("udp://127.0.0.1:0?from=127.0.0.2", clock)
    module, stranger = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    try:
        module.bind(("127.0.0.2", 0))
        stranger.bind(("127.0.0.3", 0))
    except OSError:
        pytest.skip("one loopback address only")
    for _ in range(100):
        stranger.sendto(b"stranger", ("127.0.0.1", port.number))
    module.sendto(b"module", ("127.0.0.1", port.number))
    assert port.read_each() == [b"module"]
    assert (
        port.state().dropped_in == 800
        and port.state().last_error == "a datagram from 127.0.0.3 was refused"
    )
    for _ in range(100):
        module.sendto(b"again", ("127.0.0.1", port.number))
    assert len(port.read_each()) == MAX_DATAGRAMS_PER_READ, "of a flood the newest are given"
    for one in (port, module, stranger):
        one.close()


def trace(module_id: int = 0, sensor: int = 0) -> bytes:
    """32402 by hand: 70 000 ms, target 60, applied 58.5, error 1.5 (s24), integral -12.3,
    change -4, PWM 120."""
    return sealed(
        struct.pack("<HBI", 32402, module_id << 4 | sensor, 70_000)
        + (60_000).to_bytes(3, "little")
        + (58_500).to_bytes(3, "little")
        + (1_500).to_bytes(3, "little", signed=True)
        + struct.pack("<hhhBH", -123, -4, 120, 7, 2_410)
    )


def test_the_label_and_the_trace_of_a_module_are_read():
    driver = module()
    label = sealed(struct.pack("<HB", 32403, 0) + b"Left spreader\0\0\0")
    assert driver.feed([label, trace()], 0.0) == []
    assert driver.label == "Left spreader"
    t = driver.trace
    assert (
        t.millis,
        t.target,
        t.applied,
        t.error,
        t.integral,
        t.change,
        t.pwm,
        t.samples,
        t.firmware,
    ) == (70_000, 60.0, 58.5, 1.5, -12.3, -4, 120, 7, 2_410)
    assert driver.counts.accepted == 2 and not driver.counts.rejected and not driver.counts.ignored
    driver.feed([trace(sensor=1), trace(module_id=3), trace()[:-1], trace()[:-1] + b"\0"], 0.0)
    assert driver.counts.ignored == {"other_module": 2}
    assert driver.counts.rejected == {"wrong_length": 1, "bad_checksum": 1}


def test_probing_names_a_module_by_its_label_and_its_trace():
    label = sealed(struct.pack("<HB", 32403, 2) + b"Boom".ljust(16, b"\0"))
    assert recognise_modules([trace(module_id=2), label]) == {2: "Boom"}
    assert recognise_modules([trace(module_id=5)]) == {5: ""}


def test_the_virtual_module_says_who_it_is_and_traces_when_told(clock, fake_plant):
    host, device = make_datagram_pair("module", clock)
    virtual = VirtualRateModule(device, 360.0, label="Rechts 右")
    heard = []

    def steps(count: int) -> None:
        for _ in range(count):
            virtual.alter_command(clock.now_s, DriveCommand(0.0, 25.0), False)
            virtual.take_readings(
                fake_plant.advance_plant(DriveCommand(0.0, 25.0), False), clock.now_s
            )
            clock.now_s += 0.05
            heard.extend(host.read_each())

    steps(100)
    kinds = [int.from_bytes(data[:2], "little") for data in heard]
    assert 2 <= kinds.count(32403) <= 3 and 32402 not in kinds
    driver = module()
    driver.feed(heard, 0.0)
    assert driver.label == "Rechts ?" and not driver.counts.rejected
    host.write(encode_target(FlowTarget(0, 0, 60.0, 360.0, log_pid=True)))
    heard.clear()
    steps(10)
    driver.feed(heard, 1.0)
    assert driver.trace is not None and driver.trace.pwm == 0
    assert not driver.counts.rejected


def test_valves_hang_on_the_relays_from_the_second_on_and_close_with_the_drive():
    near, far = make_datagram_pair("m", lambda: 0.0)
    virtual, driver = VirtualRateModule(far, 360.0), module()
    for data in driver.make_datagrams(60.0, True, 0.0, (True, False, True)):
        near.write(data)
    assert virtual.alter_command(0.0, DriveCommand(0.0, 25.0), True)[0].valves[:4] == (
        True,
        False,
        True,
        False,
    )
    closed = [
        decode_command(data)
        for data in driver.make_datagrams(60.0, True, 0.2, (False, False, True))
    ]
    assert [told.relays for told in closed if isinstance(told, RelayStates)] == [0b1001], (
        "at once, on change"
    )
    stopped = [
        decode_command(data) for data in driver.make_datagrams(60.0, False, 0.4, (True, True, True))
    ]
    assert [told.relays for told in stopped if isinstance(told, RelayStates)] == [0b0001]
    for data in driver.make_datagrams(60.0, True, 0.6, (True, True, True)):
        near.write(data)
    assert any(virtual.alter_command(0.6, DriveCommand(0.0, 25.0), True)[0].valves)
    assert not any(virtual.alter_command(9.0, DriveCommand(0.0, 25.0), True)[0].valves), (
        "the console is silent"
    )


def test_relays_without_valves_are_as_they_were():
    told = [decode_command(data) for data in module().make_datagrams(60.0, True, 0.0)]
    assert [one.relays for one in told if isinstance(one, RelayStates)] == [1]
