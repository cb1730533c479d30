"""Ports: memory, real sockets, pyserial URLs, reconnect; nothing blocks the caller."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import threading
import time

import pytest
import serial
from serial.rfc2217 import PortManager
from topdress.control.readings import DriveCommand
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.datagrams import UdpPort
from topdress.drivers.ports import (
    MAX_QUEUED_WRITES,
    MAX_RECEIVED_BYTES,
    SerialStream,
    ThreadedPort,
    make_memory_pair,
    open_port,
)
from topdress.drivers.virtual.faults import PortFaults, ServedLine
from topdress.drivers.virtual.machine import VirtualMachine
from topdress.drivers.virtual.served_machine import ListeningPort

from tests.waiting import wait_for


def read_all(port, length: int) -> bytes:
    data = bytearray()

    def enough() -> bool:
        data.extend(port.read())
        return len(data) >= length

    wait_for(enough)
    return bytes(data)


def test_memory_pair_both_ways_in_order(clock):
    host, device = make_memory_pair("memory:board", clock)
    device.write(b"one\r\n")
    device.write(b"two\r\nthr")
    assert host.read() == b"one\r\ntwo\r\nthr"
    assert host.read() == b""
    host.write(b"go")
    assert device.read() == b"go"
    state = host.state()
    assert (state.connected, state.bytes_in, state.bytes_out, state.last_byte_s) == (
        True,
        13,
        2,
        100.0,
    )
    assert state.format_last_lines(2) == ["one", "two"], "a line under way is not shown"


def test_memory_pair_closed_or_flooded(clock):
    host, device = make_memory_pair("x", clock)
    device.write(b"a" * (MAX_RECEIVED_BYTES - 1) + b"bc")
    assert host.state().dropped_in == 1
    assert host.read()[-3:] == b"abc"
    device.close()
    assert not host.state().connected
    host.write(b"late")
    assert host.state().dropped_out == 1


@pytest.fixture
def server(clock):
    port = ListeningPort("127.0.0.1", 0, clock)
    yield port
    port.close()


@pytest.fixture
def opened():
    """Ports to close at the end, whatever happens."""
    with contextlib.ExitStack() as stack:
        yield lambda port: stack.callback(port.close) and port


@pytest.fixture
def port(server, opened, clock):
    """The other end of the server's line."""
    port = opened(open_port(f"socket://127.0.0.1:{server.number}", 115200, clock))
    wait_for(lambda: port.state().connected and server.state().connected)
    return port


def test_socket_both_ways(server, port):
    port.write(b"hello")
    assert read_all(server, 5) == b"hello"
    server.write(b"$x\r\n" * 3000)
    assert read_all(port, 12_000) == b"$x\r\n" * 3000
    assert port.state().format_last_lines() == ["$x"]


def test_socket_latency_is_milliseconds(server, port):
    took = []
    for _ in range(20):
        begin = time.perf_counter()
        server.write(b"ping\r\n")
        while not port.read():
            time.sleep(0.0002)
        took.append(time.perf_counter() - begin)
    assert sorted(took)[5] < 0.02, "on a busy machine most of them wait for a processor"


def test_reconnects_when_the_device_comes_back_and_never_sends_late(opened, clock):
    server = ListeningPort("127.0.0.1", 0, clock)
    number = server.number
    port = opened(open_port(f"socket://127.0.0.1:{number}", 115200, clock))
    wait_for(lambda: port.state().connected and server.state().connected)
    server.close()
    wait_for(lambda: not port.state().connected)
    assert port.state().last_error
    port.write(b"stale set-point")
    server = opened(ListeningPort("127.0.0.1", number, clock))
    wait_for(lambda: port.state().connected)
    port.write(b"fresh")
    assert read_all(server, 5) == b"fresh"
    assert (port.state().connects, port.state().dropped_out) == (2, 1)


def test_a_device_that_is_not_there_is_said_and_blocks_nobody(opened, clock):
    with socket.create_server(("127.0.0.1", 0)) as free:
        number = free.getsockname()[1]
    for url in (f"socket://127.0.0.1:{number}", "/dev/no-such-port"):
        begin = time.perf_counter()
        port = opened(open_port(url, 9600, clock))
        for _ in range(1000):
            port.write(b"x")
            assert port.read() == b""
        assert time.perf_counter() - begin < 2.0
        wait_for(lambda port=port: port.state().last_error not in ("", "not yet opened"))
        assert not port.state().connected


@pytest.mark.parametrize(
    "scheme", ["spy", "SPY", "hwgrep", "alt", "loop", "cp2110", "http", "file"]
)
def test_no_other_kind_of_port_is_opened(tmp_path, clock, scheme):
    """pyserial's `spy://` empties the file that it names before it listens."""
    kept = tmp_path / "job.yaml"
    kept.write_text("mine")
    url = f"{scheme}://loop://?file={kept}"
    with pytest.raises(ValueError, match="allowed is a serial device"):
        open_port(url, 9600, clock)
    with pytest.raises(ValueError, match="allowed is a serial device"):
        SerialStream(url, 9600)
    assert kept.read_text() == "mine"


class Sent(socket.socket):
    """What pyserial's far end writes to."""

    write = socket.socket.sendall


def test_a_line_of_another_computer(opened, clock):
    """RFC 2217, its far end played by pyserial."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = opened(open_port(f"rfc2217://127.0.0.1:{server.getsockname()[1]}", 9600, clock))
        far = Sent(fileno=server.accept()[0].detach())
        with far:
            manager = PortManager(serial.serial_for_url("loop://"), far)
            far.settimeout(0.05)

            def heard() -> bytes:
                with contextlib.suppress(TimeoutError):
                    return b"".join(manager.filter(far.recv(100)))
                return b""

            wait_for(lambda: heard() == b"" and port.state().connected)
            port.write(b"go\n")
            wait_for(lambda: heard() == b"go\n")
            far.write(b"".join(manager.escape(b"there\r\n")))
            assert read_all(port, 7) == b"there\r\n"


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")
def test_a_serial_device(opened, clock):
    master, slave = os.openpty()
    try:
        port = opened(open_port(os.ttyname(slave), 115200, clock))
        wait_for(lambda: port.state().connected)
        os.write(master, b"$status\r\n")
        assert read_all(port, 9) == b"$status\r\n"
        port.write(b"$go\r\n")
        assert os.read(master, 100) == b"$go\r\n"
    finally:
        os.close(master)
        os.close(slave)


class StuckStream:
    """Takes no byte until it is released."""

    def __init__(self) -> None:
        self.release = threading.Event()
        self.written: list[bytes] = []

    def read(self) -> bytes:
        time.sleep(0.01)
        return b""

    def write(self, data: bytes) -> None:
        self.release.wait(30.0)
        self.written.append(data)

    def close(self) -> None:
        self.release.set()


def test_a_line_that_takes_nothing_keeps_the_newest_commands_and_never_blocks(opened, clock):
    stream = StuckStream()
    port = opened(ThreadedPort("stuck", lambda: stream, clock))
    wait_for(lambda: port.state().connected)
    begin = time.perf_counter()
    for number in range(500):
        port.write(b"%d" % number)
    assert time.perf_counter() - begin < 10.0
    stream.release.set()
    wait_for(lambda: stream.written and stream.written[-1] == b"499")
    assert len(stream.written) <= MAX_QUEUED_WRITES + 1
    assert port.state().dropped_out == 500 - len(stream.written)


def test_close_sends_the_last_word_first(server, clock):
    port = open_port(f"socket://127.0.0.1:{server.number}", 115200, clock)
    wait_for(lambda: port.state().connected and server.state().connected)
    port.write(b"stop")
    port.close()
    assert read_all(server, 4) == b"stop"
    assert not port.state().connected


class SlowStream(StuckStream):
    """Takes a tenth of a second for every write, and none once it is closed."""

    def write(self, data: bytes) -> None:
        time.sleep(0.1)
        if not self.release.is_set():
            self.written.append(data)


def test_close_waits_for_a_slow_line(clock):
    stream = SlowStream()
    port = ThreadedPort("slow", lambda: stream, clock)
    wait_for(lambda: port.state().connected)
    for word in (b"one", b"two", b"stop"):
        port.write(word)
    port.close()
    assert stream.written == [b"one", b"two", b"stop"]


@pytest.mark.parametrize(
    "url", ["socket://127.0.0.1", "socket://:5000", "socket://127.0.0.1:99999", "socket://h:0"]
)
def test_a_socket_without_host_or_port_is_refused_in_one_line(url, clock):
    with pytest.raises(ValueError, match="allowed is socket://HOST:PORT"):
        open_port(url, 9600, clock)
    with pytest.raises(ValueError, match="baud 0"):
        open_port("/dev/ttyUSB0", 0, clock)


def test_unplugged_by_order_it_is_left_alone_until_plugged_again(server, port):
    port.plug(False)
    wait_for(lambda: not server.state().connected)
    assert (port.state().connected, port.state().connects) == (False, 1)
    wait_for(lambda: port.state().last_error == "unplugged")
    time.sleep(0.6)
    assert port.state().connects == 1 and not server.state().connected
    begin = time.perf_counter()
    port.plug(True)
    wait_for(lambda: port.state().connected and server.state().connected)
    assert time.perf_counter() - begin < 0.5, "the operator does not wait for a back-off"
    assert port.state().connects == 2


def test_a_line_pulled_while_it_is_being_opened_stays_down(opened, clock):
    opening, go = threading.Event(), threading.Event()

    def opener() -> StuckStream:
        opening.set()
        go.wait(30.0)
        return StuckStream()

    port = opened(ThreadedPort("slow to open", opener, clock))
    assert opening.wait(30.0)
    port.plug(False)
    go.set()
    time.sleep(0.1)
    assert (port.state().connected, port.state().connects) == (False, 0)


def test_a_lost_device_is_looked_for_every_two_seconds_at_least(opened, clock):
    waits: list[float] = []

    def refuse() -> StuckStream:
        raise OSError("not there")

    class Hurried(ThreadedPort):
        def _wait_before_retry(self, seconds: float) -> None:
            waits.append(seconds)
            time.sleep(0.005)

    opened(Hurried("lost", refuse, clock))
    wait_for(lambda: len(waits) > 10)
    assert waits[:6] == [0.25, 0.5, 1.0, 2.0, 2.0, 2.0]


def test_a_memory_line_can_be_pulled_at_either_end(clock):
    host, device = make_memory_pair("line", clock)
    device.plug(False)
    device.write(b"lost")
    host.write(b"lost")
    assert not host.state().connected and host.read() == device.read() == b""
    device.plug(True)
    device.write(b"heard")
    assert host.read() == b"heard" and host.state().connected
    assert (device.state().connects, device.state().dropped_out, host.state().dropped_out) == (
        2,
        1,
        1,
    )


def test_a_udp_port_can_be_let_go_and_taken_again(clock):
    port = UdpPort("udp://127.0.0.1:0", clock)
    other = UdpPort(f"udp://127.0.0.1:0?to=127.0.0.1:{port.number}", clock)
    port.plug(False)
    assert port.number == 0 and port.state().last_error == "unplugged"
    other.write(b"lost")
    assert port.read_each() == [] and port.number == 0, "nor does using it bind it again"
    port.plug(True)
    port.read_each()
    other.close()
    other = UdpPort(f"udp://127.0.0.1:0?to=127.0.0.1:{port.number}", clock)
    other.write(b"heard")
    wait_for(lambda: port.read_each() == [b"heard"])
    port.close()
    other.close()


@pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
def test_a_serial_line_belongs_to_one_program() -> None:
    """A second one would take bytes from the first."""
    master, slave = os.openpty()
    try:
        first = SerialStream(os.ttyname(slave), 115200)
        with pytest.raises(OSError, match="exclusively lock"):
            SerialStream(os.ttyname(slave), 115200)
        first.close()
        SerialStream(os.ttyname(slave), 115200).close()
    finally:
        os.close(slave)
        os.close(master)


# --- Bad cables: each fault does what it says, and the cab keeps its head
# --------------------------------------------


@pytest.fixture
def line(clock):
    """A faulty device end, and the host's."""
    host, device = make_memory_pair("line", clock)
    return ServedLine((device,), clock, seed=1), host


def test_unplugged(line):
    device, port = line
    device.set_faults(PortFaults(unplugged=True))
    device.write(b"lost\n")
    port.write(b"lost too")
    assert (port.read(), device.read(), port.state().connected) == (b"", b"", False)
    device.set_faults(PortFaults())
    device.write(b"back\n")
    assert (port.read(), port.state().connected) == (b"back\n", True)


def test_delayed(line, clock):
    device, port = line
    device.set_faults(PortFaults(delay_s=0.3))
    device.write(b"one\n")
    assert port.read() == b""
    clock.now_s += 0.29
    device.write(b"two\n")
    assert port.read() == b""
    clock.now_s += 0.02
    device.send_due()
    assert port.read() == b"one\n"


def test_frozen_half_double_and_dirty_lines(line):
    device, port = line
    for faults, expected in (
        (PortFaults(), b"123456789\nx\n"),
        (PortFaults(frozen=True), b"x\nx\n"),
        (PortFaults(half_share=1.0), b"12345x"),
        (PortFaults(duplicate_share=1.0), b"123456789\n123456789\nx\nx\n"),
    ):
        device.set_faults(faults)
        device.write(b"123456789\nx\n")
        assert port.read() == expected
    device.set_faults(PortFaults(garbage_share=1.0))
    device.write(b"123456789\n")
    assert (found := port.read()).endswith(b"123456789\n") and len(found) > 10
    device.set_faults(PortFaults(bit_flip_share=1.0))
    device.write(b"123456789\n")
    flipped = port.read()
    assert sum((a ^ b).bit_count() for a, b in zip(flipped, b"123456789\n", strict=True)) == 1


BAD = {
    "board": PortFaults(garbage_share=0.2, half_share=0.2, duplicate_share=0.2, bit_flip_share=0.2),
    "gnss": PortFaults(garbage_share=0.2, half_share=0.2, duplicate_share=0.2, bit_flip_share=0.2),
}


@pytest.fixture
def bad_cab(clock, fake_plant):
    """Cab and machine joined by faulty lines, which are given by name."""
    pairs = {name: make_memory_pair(name, clock) for name in ("gnss", "heads", "board")}
    lines = {name: ServedLine((pair[1],), clock, seed=7) for name, pair in pairs.items()}
    machine = VirtualMachine(
        fake_plant, lines["gnss"], [lines["heads"]], lines["board"], clock(), multiplexed=True
    )
    config = CabConfig.model_validate(
        {
            "gnss": {"port": "gnss"},
            "board": {"port": "board"},
            "heads": {"ports": ["heads"], "multiplexed": True},
        }
    )
    return Cab(config, clock, lambda url, _baud, _clock: pairs[url][0]), machine, lines


def test_through_a_bad_line_nothing_wrong_is_accepted(bad_cab, clock, fake_plant):
    cab, machine, lines = bad_cab
    for name, faults in BAD.items():
        lines[name].set_faults(faults)
    seen = 0
    for tick in range(2000):
        clock.now_s += 0.05
        machine.advance_to(clock.now_s)
        m = cab.read_measurements(clock.now_s)
        cab.send_command(clock.now_s, DriveCommand(60.0, 30.0), tick > 4)
        if tick > 100:
            assert (m.hopper_kg.value, m.supply_v.value, m.work_switch) == (250.05, 13.5, True)
            assert m.shaft_rpm.value == 60.0
            assert m.gnss.lat_deg == pytest.approx(34.28 + fake_plant.way_m / 111_195.0, abs=2e-5)
            assert m.wheel_speed_mps.value == pytest.approx(1.25, abs=0.01)
            seen += m.shaft_rpm.time_s == clock.now_s
    assert seen > 800
    assert all(
        device.rejected > 100
        for device in cab.list_device_status(clock.now_s)
        if device.name != "heads"
    )


def test_an_unplugged_device_goes_stale_and_comes_back(bad_cab, clock):
    cab, machine, lines = bad_cab

    def run(seconds):
        for _ in range(round(seconds / 0.05)):
            clock.now_s += 0.05
            machine.advance_to(clock.now_s)
            m = cab.read_measurements(clock.now_s)
            cab.send_command(clock.now_s, DriveCommand(60.0, 30.0), False)
        return m

    run(2.0)
    lines["board"].set_faults(PortFaults(unplugged=True))
    m = run(2.0)
    assert clock.now_s - m.shaft_rpm.time_s == pytest.approx(2.0)
    assert not cab.list_device_status(clock.now_s)[-1].connected
    lines["board"].set_faults(PortFaults())
    assert run(0.1).shaft_rpm.time_s == clock.now_s


def test_a_frozen_board_is_silent_not_steady(bad_cab, clock):
    """The same status line again and again is a repeated sequence number, so the drive goes
    stale."""
    cab, machine, lines = bad_cab
    for tick in range(80):
        lines["board"].set_faults(PortFaults(frozen=tick >= 40))
        clock.now_s += 0.05
        machine.advance_to(clock.now_s)
        m = cab.read_measurements(clock.now_s)
    assert clock.now_s - m.shaft_rpm.time_s == pytest.approx(2.0)
