"""A capture is readable, timed, and gives back every byte that was received."""
from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.devices.capture import captured, header, is_capture, received
from drivers.devices.decode import decode


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
