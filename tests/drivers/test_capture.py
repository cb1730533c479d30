"""A capture is readable, timed, and gives back every byte that was received."""
from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from console.cli import app
from control.readings import GnssFix
from drivers.board.framing import seal
from drivers.devices.board_frames import StatusFrame, encode_status
from drivers.devices.canopy_heads import PROTOCOLS
from drivers.devices.capture import captured, header, is_capture, received
from drivers.devices.decode import decode
from drivers.devices.probe import probe, recognise, recognise_either, recognise_modules
from drivers.devices.rate_module_frames import Status
from drivers.devices.rate_module_frames import encode_status as encode_module
from drivers.ports import memory_pair
from drivers.virtual.faults import at_wrong_baud
from drivers.virtual.machine import gnss_sentences, head_line


def test_a_capture_reads_as_a_list_of_lines():
    assert header("gnss", "nmea0183", "COM3") == b"# topdress-capture/1 gnss nmea0183 COM3\n"
    assert captured(12.3456, "<", b"$GPGGA,1*47\r\n$GP\x80\\") == (
        b"12.346 < $GPGGA,1*47\\r\\n\n12.346 < $GP\\x80\\\\\n")
    assert captured(-0.5, ">", b"$T1\r\n") == b"-0.500 > $T1\\r\\n\n"


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.sampled_from("<>"), st.binary(max_size=40) | st.sampled_from(
    [b"\\r", b"\\x41", b"\r\n", b"\r", b"\n\n", b"\\\\n", "µ".encode()])), max_size=20))
def test_every_received_byte_comes_back(pieces):
    capture = header("x", "y", "\udcff") + b"".join(
        captured(number * 0.05, direction, data) for number, (direction, data) in enumerate(pieces))
    assert is_capture(capture)
    assert received(capture) == b"".join(data for direction, data in pieces if direction == "<")


def test_one_that_was_cut_off_is_read_to_its_last_whole_line():
    assert received(header("x", "y", "z") + captured(1.0, "<", b"a\n") + b"1.05 < hal") == b"a\n"


@pytest.mark.parametrize("line", [b"hello", b"1.0 < x", b"1.000 = x", b"nan < x"])
def test_a_line_that_is_none_is_named(line):
    with pytest.raises(ValueError, match=r"line 2: .* allowed is TIME_S < BYTES"):
        received(header("x", "y", "z") + line + b"\n")


def test_decode_reads_it_as_it_reads_the_bare_bytes():
    data = b"0,0.5,0.512,0.61,0\r\n" * 5
    capture = header("head_1", "greenseeker", "COM4") + b"".join(
        captured(number, "<", data[start:start + 7]) for number, start in enumerate(range(0, len(data), 7)))
    records, counts = decode("greenseeker", capture)
    assert (records, counts) == decode("greenseeker", data)
    assert records[0] == {"ndvi_1": 0.512}


# --- What `topdress devices` recognises, and that it never says anything to a device ---------------------------------

FIX = GnssFix(0.0, 34.28, 119.88, 4, 14, 0.8, 1.25, 12.0)
HEARD = {
    "nmea0183": b"".join(gnss_sentences(FIX._replace(time_s=t / 5)) for t in range(3)),
    "slave-board/1": b"".join(encode_status(StatusFrame(n, 0, n * 50000, 0, 0, 0.0, 25.0)) for n in range(5)),
    "greenseeker": b"345,0.5\r\n" + head_line(0.5, PROTOCOLS["greenseeker"]) * 4,
    "acs435": head_line(0.5, PROTOCOLS["acs435"]) * 4,
    "greenseeker (multiplexed)": b"".join(head_line(0.5, PROTOCOLS["greenseeker"], head) for head in (1, 2, 3)),
    "lag-rig/1": b"".join(seal(f"L1,{n},0,0,{n * 50000},0.000,500,,,0") for n in range(5)),
    "gpsd": b'{"class":"VERSION","release":"3.25"}\r\n'}


@pytest.mark.parametrize("protocol", HEARD)
def test_each_protocol_is_recognised(protocol):
    assert recognise(HEARD[protocol]).protocol == protocol


@pytest.mark.parametrize("noise", [b"", b"hello\r\n" * 9, bytes(range(256)) * 4, b"$GPGGA,1,2*00\r\n" * 9,
                                   at_wrong_baud(HEARD["nmea0183"]), b"1,2,3,4,5,6\r\n" * 9 + b"1,2,0.3,4,5\r\n" * 3])
def test_what_is_no_device_is_none(noise):
    assert recognise(noise).protocol == ""


class HandTime:
    now_s = 0.0

    def __call__(self):
        return self.now_s

    def sleep(self, seconds):
        self.now_s += seconds


def test_the_rate_is_found_and_nothing_is_sent():
    at = HandTime()
    ends = []

    def open_at(baud):
        host, device = memory_pair(str(baud), at)
        data = HEARD["greenseeker"]
        device.write(data if baud == 38400 else at_wrong_baud(data))
        ends.append(device)
        return host
    found = probe(open_at, (115200, 38400, 9600), at, at.sleep)
    assert (found.protocol, found.baud, found.said) == ("greenseeker", 38400, "0,0,0.500,0.500,0")
    assert len(ends) == 2 and all(end.read() == b"" for end in ends)


def test_modules_on_the_network_are_named():
    status = encode_module(Status(3, 0, 0.0, 0.0, 0, True, False, 0.0))
    assert recognise_modules([status, b"noise", status[:-1] + b"\0"]) == {3: ""}


def test_the_command_says_what_cannot_be_opened_and_goes_on():
    result = CliRunner().invoke(app, ["devices", "--seconds", "0.3", "socket://127.0.0.1:1", "/dev/no-such-port"])
    assert result.exit_code == 1
    first, second = result.output.splitlines()
    assert "cannot be opened" in first and "cannot be opened" in second


def test_a_port_that_cannot_be_read_is_one_plain_line():
    result = CliRunner().invoke(app, ["devices", "socket://nowhere"])
    assert result.exit_code == 2
    assert "allowed is socket://HOST:PORT" in result.output


def test_pieces_of_a_line_or_datagrams_are_told_with_the_last_of_them():
    found = recognise_either([HEARD["greenseeker"][:30], HEARD["greenseeker"][30:] + b"0,0.1"])
    assert (found.protocol, found.said) == ("greenseeker", "0,0,0.500,0.500,0")
    modules = recognise_either([encode_module(Status(3, 0, 0.0, 0.0, 0, True, False, 0.0))] * 2)
    assert (modules.protocol, modules.said) == ("rate-module/udp", "3")
    assert recognise_either([b"hello\r\n"]).protocol == ""
