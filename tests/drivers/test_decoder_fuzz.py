"""Spoilt bytes of every protocol: no decoder falls over, and nothing outside its range comes
through."""

from __future__ import annotations

import json
import math
import random

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from topdress.control.readings import MAX_ANNOUNCED_MPS, GnssFix
from topdress.control.signals import SIGNALS
from topdress.drivers.devices import protocol_probe
from topdress.drivers.devices.board_frames import STATUS_RANGES, CommandFrame, encode_command
from topdress.drivers.devices.canopy_heads import FIELDS_OF_PROTOCOL as HEAD_PROTOCOLS
from topdress.drivers.devices.canopy_heads import HeadDecoder
from topdress.drivers.devices.capture import (
    extract_received,
    is_capture,
    make_capture_header,
    make_capture_lines,
)
from topdress.drivers.devices.decode import DECODER_OF_PROTOCOL, decode_capture
from topdress.drivers.devices.gnss import GnssDecoder
from topdress.drivers.devices.nmea import seal_sentence
from topdress.drivers.devices.protocol_probe import (
    make_decoders,
    probe_port,
    recognise_either,
    recognise_modules,
    recognise_protocol,
)
from topdress.drivers.devices.rate_line import MAX_RATE_KG_HA
from topdress.drivers.devices.rate_module_frames import ModuleStatus
from topdress.drivers.devices.rate_module_frames import encode_status as encode_module
from topdress.drivers.devices.registry import list_line_devices
from topdress.drivers.devices.slave_board import SlaveBoard
from topdress.drivers.ports import make_memory_pair
from topdress.drivers.virtual.board import VirtualBoard
from topdress.drivers.virtual.faults import read_at_wrong_baud
from topdress.drivers.virtual.machine import make_gnss_sentences, make_head_line
from topdress.drivers.virtual.virtual_devices import make_agopengps_frames

from tests.command import topdress

SHORT = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
RANGES = {
    **{name: one.possible for name, one in SIGNALS.items() if one.possible is not None},
    "lat_deg": (-90, 90),
    "lon_deg": (-180, 180),
    "fix_quality": (1, 9),
    "satellites": (0, 200),
    "hdop": (0, 100),
    "speed_mps": (0, 100),
    "heading_deg": (0, 360),
    "wheel_speed_mps": (0, 30),
    "work_switch": (0, 1),
    "target_rate_kg_ha": (0, MAX_RATE_KG_HA),
    "applied_rate_kg_ha": (0, MAX_RATE_KG_HA),
    "acceleration_mps2": (0, 10),
    "speed_mps_in": (-MAX_ANNOUNCED_MPS, MAX_ANNOUNCED_MPS),
    **{f"ndvi_{head}": (-1, 1) for head in range(1, 7)},
    **STATUS_RANGES,
}


def clean(protocol: str) -> bytes:
    if protocol == "gnss":
        return b"".join(
            make_gnss_sentences(
                GnssFix(tick / 5, 34.28, 119.88 + tick * 1e-6, 4, 14, 0.8, 1.25, 12.0)
            )
            for tick in range(40)
        )
    if protocol == "agopengps":
        return b"".join(
            frame
            for tick in range(40)
            for frame in make_agopengps_frames(
                GnssFix(tick / 5, 34.28, 119.88 + tick * 1e-6, 1, speed_mps=1.25, heading_deg=12.0)
            )
        )
    if protocol == "gpsd":
        return b"".join(
            json.dumps(
                {
                    "class": "TPV",
                    "device": "/dev/ttyS0",
                    "mode": 3,
                    "status": 3,
                    "time": f"2026-04-01T06:00:{tick:02d}.000Z",
                    "lat": 34.28,
                    "lon": 119.88 + tick * 1e-6,
                    "track": 12.0,
                    "speed": 1.25,
                }
            ).encode()
            + b"\n"
            for tick in range(40)
        )
    for device in list_line_devices():
        if device.section == protocol:
            return device.make_example()
    name, _, multiplexed = protocol.partition("-")
    return b"".join(
        make_head_line(
            0.3 + 0.01 * tick, HEAD_PROTOCOLS[name], tick % 6 + 1 if multiplexed else None
        )
        for tick in range(40)
    )


@st.composite
def spoilt(draw, protocol: str) -> bytes:
    """A clean stream with bits turned over, stretches cut out, doubled or replaced by noise."""
    data = bytearray(clean(protocol))
    for _ in range(draw(st.integers(1, 25))):
        place = draw(st.integers(0, len(data) - 1)) if data else 0
        stretch = draw(st.integers(1, 60))
        match draw(st.sampled_from(("flip", "cut", "double", "noise", "truncate"))):
            case "flip" if data:
                data[place] ^= 1 << draw(st.integers(0, 7))
            case "cut":
                del data[place : place + stretch]
            case "double":
                data[place:place] = data[place : place + stretch]
            case "noise":
                data[place:place] = draw(st.binary(max_size=stretch))
            case _:
                del data[max(place, len(data) // 2) :]
    return bytes(data)


@pytest.mark.parametrize("protocol", sorted(DECODER_OF_PROTOCOL))
def test_a_clean_stream_is_accepted_whole(protocol):
    records, counts = decode_capture(protocol, clean(protocol))
    assert not counts.rejected and not counts.ignored
    assert len(records) == 40


@pytest.mark.parametrize("protocol", sorted(DECODER_OF_PROTOCOL))
@SHORT
@given(data=st.data())
def test_spoilt_streams(protocol, data):
    stream = data.draw(spoilt(protocol))
    # noise that begins as a capture is refused as a broken one
    assume(not is_capture(stream))
    records, counts = decode_capture(protocol, stream)
    assert counts.read == counts.accepted + counts.rejected_total + sum(counts.ignored.values())
    for record in records:
        for name, value in record.items():
            if name != "utc" and value is not None:
                low, high = RANGES["speed_mps_in" if name.startswith("speed_mps_in_") else name]
                assert math.isfinite(value) and low <= value <= high, (name, value)


@SHORT
@given(data=st.data())
def test_a_spoilt_board_line_says_nothing_that_was_not_sent(data):
    for record in decode_capture("board", data.draw(spoilt("board")))[0]:
        assert (record["shaft_rpm"], record["hopper_kg"], record["roll_deg"]) == (60.0, 250.0, 0.0)


def test_no_single_bit_of_an_epoch_can_move_the_fix():
    """All 1,500 of them. (Two flips can cancel in NMEA's checksum: more is not to be had from
    it.)"""
    epoch = make_gnss_sentences(GnssFix(0.0, 34.28, 119.88, 4, 14, 0.8, 1.25, 12.0))
    (true,) = decode_capture("gnss", epoch)[0]
    for place in range(len(epoch)):
        for bit in range(8):
            flipped = bytearray(epoch)
            flipped[place] ^= 1 << bit
            for record in decode_capture("gnss", bytes(flipped))[0]:
                assert record["lat_deg"] == true["lat_deg"]
                assert record["speed_mps"] in (
                    None,
                    true["speed_mps"],
                    pytest.approx(true["speed_mps"], abs=3e-4),
                )


@pytest.mark.parametrize(
    "make",
    [
        GnssDecoder,
        SlaveBoard,
        lambda: HeadDecoder(HEAD_PROTOCOLS["greenseeker"]),
        lambda: HeadDecoder(HEAD_PROTOCOLS["acs430"], head=None),
    ],
)
@SHORT
@given(pieces=st.lists(st.binary(max_size=300), max_size=20))
def test_pure_noise_gives_nothing(make, pieces):
    decoder = make()
    found = [reading for piece in pieces for reading in decoder.feed(piece, 0.0)]
    assert found == [] or isinstance(decoder, HeadDecoder)


@SHORT
@given(seed=st.integers(0, 2**32), word=st.sampled_from([None, 0, 2**32 - 1]))
def test_the_board_obeys_only_what_was_sent(seed, word):
    """Bit flips and cuts in the command stream: the drives never get a set-point that nobody
    sent."""
    chance = random.Random(seed)
    board = VirtualBoard(20.0, lambda: word)
    sent = {0.0}
    for tick in range(60):
        rpm = float(chance.randrange(10, 100))
        sent.add(rpm)
        line = bytearray(
            encode_command(CommandFrame(tick, rpm if tick else 0.0, 20.0, tick > 0, word=word))
        )
        for _ in range(chance.randrange(3)):
            line[chance.randrange(len(line))] ^= 1 << chance.randrange(8)
        board.feed_commands(
            bytes(line[: chance.randrange(5, len(line) + 1)] if chance.random() < 0.2 else line),
            tick * 0.05,
        )
        command, _ = board.find_set_points(tick * 0.05)
        assert command.shaft_rpm in sent
        assert command.opening_mm == 20.0


# --- A capture is readable, timed, and gives back every byte that was received
# ---------------------------------------


def test_a_capture_reads_as_a_list_of_lines():
    assert (
        make_capture_header("gnss", "nmea0183", "COM3")
        == b"# topdress-capture/1 gnss nmea0183 COM3\n"
    )
    assert make_capture_lines(12.3456, "<", b"$GPGGA,1*47\r\n$GP\x80\\") == (
        b"12.346 < $GPGGA,1*47\\r\\n\n12.346 < $GP\\x80\\\\\n"
    )
    assert make_capture_lines(-0.5, ">", b"$T1\r\n") == b"-0.500 > $T1\\r\\n\n"


@settings(max_examples=300, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from("<>"),
            st.binary(max_size=40)
            | st.sampled_from([b"\\r", b"\\x41", b"\r\n", b"\r", b"\n\n", b"\\\\n", "µ".encode()]),
        ),
        max_size=20,
    )
)
def test_every_received_byte_comes_back(pieces):
    capture = make_capture_header("x", "y", "\udcff") + b"".join(
        make_capture_lines(number * 0.05, direction, data)
        for number, (direction, data) in enumerate(pieces)
    )
    assert is_capture(capture)
    assert extract_received(capture) == b"".join(
        data for direction, data in pieces if direction == "<"
    )


def test_one_that_was_cut_off_is_read_to_its_last_whole_line():
    assert (
        extract_received(
            make_capture_header("x", "y", "z")
            + make_capture_lines(1.0, "<", b"a\n")
            + b"1.05 < hal"
        )
        == b"a\n"
    )


@pytest.mark.parametrize("line", [b"hello", b"1.0 < x", b"1.000 = x", b"nan < x"])
def test_a_line_that_is_none_is_named(line):
    with pytest.raises(ValueError, match=r"line 2: .* allowed is TIME_S < BYTES"):
        extract_received(make_capture_header("x", "y", "z") + line + b"\n")


def test_decode_reads_it_as_it_reads_the_bare_bytes():
    data = b"0,0.5,0.512,0.61,0\r\n" * 5
    capture = make_capture_header("head_1", "greenseeker", "COM4") + b"".join(
        make_capture_lines(number, "<", data[start : start + 7])
        for number, start in enumerate(range(0, len(data), 7))
    )
    records, counts = decode_capture("greenseeker", capture)
    assert (records, counts) == decode_capture("greenseeker", data)
    assert records[0] == {"ndvi_1": 0.512}


# --- What `topdress devices` recognises, and that it never says anything to a device
# ---------------------------------

FIX = GnssFix(0.0, 34.28, 119.88, 4, 14, 0.8, 1.25, 12.0)
HEARD = {
    "nmea0183": b"".join(make_gnss_sentences(FIX._replace(time_s=t / 5)) for t in range(3)),
    **{one.heard_as or one.section: one.make_example() for one in list_line_devices()},
    "greenseeker": b"345,0.5\r\n" + make_head_line(0.5, HEAD_PROTOCOLS["greenseeker"]) * 4,
    "acs435": make_head_line(0.5, HEAD_PROTOCOLS["acs435"]) * 4,
    "greenseeker (multiplexed)": b"".join(
        make_head_line(0.5, HEAD_PROTOCOLS["greenseeker"], head) for head in (1, 2, 3)
    ),
    "gpsd": b'{"class":"VERSION","release":"3.25"}\r\n',
}


@pytest.mark.parametrize("protocol", HEARD)
def test_each_protocol_is_recognised(protocol):
    assert recognise_protocol(HEARD[protocol]).protocol == protocol


NAME_OF_CAPTURE = {"gnss": "nmea0183", "board": "slave-board/1"}
NO_FIX = b"".join(
    seal_sentence(f"GPGGA,06000{n},,,,,0,00,99.9,,,,,,") + seal_sentence("GPGSV,1,1,00")
    for n in range(5)
)


@pytest.mark.parametrize("first", make_decoders())
def test_every_shipped_decoder_is_named_in_any_order(first, monkeypatch):
    """Lines of a decoder are called by its name, whichever decoder hears them first."""
    monkeypatch.setattr(
        protocol_probe, "make_decoders", lambda: {first: make_decoders()[first], **make_decoders()}
    )
    heard = {
        NAME_OF_CAPTURE.get(name, name.replace("-multi", " (multiplexed)")): clean(name)
        for name in DECODER_OF_PROTOCOL
    }
    heard |= HEARD
    assert {*heard} == {*make_decoders()}, "a decoder without lines in this test"
    for name, data in heard.items():
        assert recognise_protocol(data).protocol == name
    assert recognise_protocol(NO_FIX).protocol == "nmea0183"


def test_reflectances_separate_two_heads_with_as_many_fields():
    """A GreenSeeker whose fields fit an ACS-430 and the reverse, in shares and in percent."""
    assert recognise_protocol(b"12.5,0,0.612,0.745,1\r\n" * 4).protocol == "greenseeker"
    for line in (b"0.25,0.667,0.30,0.50,0.10\r\n", b"0.25,0.667,30.0,50.0,10.0\r\n"):
        assert recognise_protocol(line * 4).protocol == "acs430"


@pytest.mark.parametrize(
    "noise",
    [
        b"",
        b"hello\r\n" * 9,
        bytes(range(256)) * 4,
        b"$GPGGA,1,2*00\r\n" * 9,
        read_at_wrong_baud(HEARD["nmea0183"]),
        b"1,2,3,4,5,6\r\n" * 9 + b"1,2,0.3,4,5\r\n" * 3,
    ],
)
def test_what_is_no_device_is_none(noise):
    assert recognise_protocol(noise).protocol == ""


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
        host, device = make_memory_pair(str(baud), at)
        data = HEARD["greenseeker"]
        device.write(data if baud == 38400 else read_at_wrong_baud(data))
        ends.append(device)
        return host

    found = probe_port(open_at, (115200, 38400, 9600), at, at.sleep)
    assert (found.protocol, found.baud, found.detail) == ("greenseeker", 38400, "0,0,0.500,0.500,0")
    assert len(ends) == 2 and all(end.read() == b"" for end in ends)


def test_modules_on_the_network_are_named():
    status = encode_module(ModuleStatus(3, 0, 0.0, 0.0, 0, True, False, 0.0))
    assert recognise_modules([status, b"noise", status[:-1] + b"\0"]) == {3: ""}


def test_the_command_says_what_cannot_be_opened_and_goes_on():
    result = topdress("devices", "--seconds", "0.3", "socket://127.0.0.1:1", "/dev/no-such-port")
    assert result.exit_code == 1
    first, second = result.output.splitlines()
    assert "cannot be opened" in first and "cannot be opened" in second


def test_a_port_that_cannot_be_read_is_one_plain_line():
    result = topdress("devices", "socket://nowhere")
    assert result.exit_code == 2
    assert "allowed is socket://HOST:PORT" in result.output


def test_pieces_of_a_line_or_datagrams_are_told_with_the_last_of_them():
    found = recognise_either([HEARD["greenseeker"][:30], HEARD["greenseeker"][30:] + b"0,0.1"])
    assert (found.protocol, found.detail) == ("greenseeker", "0,0,0.500,0.500,0")
    modules = recognise_either(
        [encode_module(ModuleStatus(3, 0, 0.0, 0.0, 0, True, False, 0.0))] * 2
    )
    assert (modules.protocol, modules.detail) == ("rate-module/udp", "3")
    assert recognise_either([b"hello\r\n"]).protocol == ""
