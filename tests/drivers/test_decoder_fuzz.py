"""Spoilt bytes of every protocol: no decoder falls over, and nothing outside its range comes through."""
from __future__ import annotations

import json
import math
import random

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from control.readings import FASTEST_ANNOUNCED_MPS, GnssFix, SpeedPlan
from drivers.devices.board_frames import STATUS_RANGES, CommandFrame, StatusFrame, encode_command, encode_status
from drivers.devices.canopy_heads import PROTOCOLS as HEAD_PROTOCOLS
from drivers.devices.canopy_heads import HeadDecoder
from drivers.devices.capture import is_capture
from drivers.devices.decode import PROTOCOLS, decode
from drivers.devices.gnss import GnssDecoder
from drivers.devices.rate_line import MOST_KG_HA, target_sentence
from drivers.devices.slave_board import SlaveBoard
from drivers.devices.tractor_speed import sentence
from drivers.virtual.board import VirtualBoard
from drivers.virtual.extras import agopengps_frames
from drivers.virtual.machine import gnss_sentences, head_line

SHORT = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
RANGES = {"lat_deg": (-90, 90), "lon_deg": (-180, 180), "fix_quality": (1, 9), "satellites": (0, 200), "hdop": (0, 100),
          "speed_mps": (0, 100), "heading_deg": (0, 360), "wheel_speed_mps": (0, 30), "work_switch": (0, 1),
          "target_rate_kg_ha": (0, MOST_KG_HA), "applied_rate_kg_ha": (0, MOST_KG_HA),
          "acceleration_mps2": (0, 10), "speed_mps_in": (-FASTEST_ANNOUNCED_MPS, FASTEST_ANNOUNCED_MPS),
          **{f"ndvi_{head}": (-1, 1) for head in range(1, 7)}, **STATUS_RANGES}


def clean(protocol: str) -> bytes:
    if protocol == "gnss":
        return b"".join(gnss_sentences(GnssFix(tick / 5, 34.28, 119.88 + tick * 1e-6, 4, 14, 0.8, 1.25, 12.0))
                        for tick in range(40))
    if protocol == "agopengps":
        return b"".join(frame for tick in range(40) for frame in agopengps_frames(
            GnssFix(tick / 5, 34.28, 119.88 + tick * 1e-6, 1, speed_mps=1.25, heading_deg=12.0)))
    if protocol == "gpsd":
        return b"".join(json.dumps({
            "class": "TPV", "device": "/dev/ttyS0", "mode": 3, "status": 3, "time": f"2026-04-01T06:00:{tick:02d}.000Z",
            "lat": 34.28, "lon": 119.88 + tick * 1e-6, "track": 12.0, "speed": 1.25}).encode() + b"\n"
            for tick in range(40))
    if protocol == "board":
        return b"".join(encode_status(StatusFrame(
            tick, tick, tick * 50_000, tick // 3, tick * 50_000, 60.0, 25.0, 250.0, 13.5, 1.0, 0.0, True, 1))
            for tick in range(40))
    if protocol == "tractor":
        return b"".join(sentence(SpeedPlan(0.0, ((0.0, 1.2 + tick / 100.0), (1.5, 2.0)), 0.5)) for tick in range(40))
    if protocol == "rate_line":
        return b"".join(target_sentence(100.0 + tick) for tick in range(40))
    name, _, multiplexed = protocol.partition("-")
    return b"".join(head_line(0.3 + 0.01 * tick, HEAD_PROTOCOLS[name], tick % 6 + 1 if multiplexed else None)
                    for tick in range(40))


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
                del data[place:place + stretch]
            case "double":
                data[place:place] = data[place:place + stretch]
            case "noise":
                data[place:place] = draw(st.binary(max_size=stretch))
            case _:
                del data[max(place, len(data) // 2):]
    return bytes(data)


@pytest.mark.parametrize("protocol", sorted(PROTOCOLS))
def test_a_clean_stream_is_accepted_whole(protocol):
    records, counts = decode(protocol, clean(protocol))
    assert not counts.rejected and not counts.ignored
    assert len(records) == 40


@pytest.mark.parametrize("protocol", sorted(PROTOCOLS))
@SHORT
@given(data=st.data())
def test_spoilt_streams(protocol, data):
    stream = data.draw(spoilt(protocol))
    assume(not is_capture(stream))                # noise that begins as a capture is refused as a broken one
    records, counts = decode(protocol, stream)
    assert counts.read == counts.accepted + counts.rejected_total + sum(counts.ignored.values())
    for record in records:
        for name, value in record.items():
            if name != "utc" and value is not None:
                low, high = RANGES["speed_mps_in" if name.startswith("speed_mps_in_") else name]
                assert math.isfinite(value) and low <= value <= high, (name, value)


@SHORT
@given(data=st.data())
def test_a_spoilt_board_line_says_nothing_that_was_not_sent(data):
    for record in decode("board", data.draw(spoilt("board")))[0]:
        assert (record["shaft_rpm"], record["hopper_kg"], record["roll_deg"]) == (60.0, 250.0, 0.0)


def test_no_single_bit_of_an_epoch_can_move_the_fix():
    """All 1,500 of them. (Two flips can cancel in NMEA's checksum: more is not to be had from it.)"""
    epoch = gnss_sentences(GnssFix(0.0, 34.28, 119.88, 4, 14, 0.8, 1.25, 12.0))
    true, = decode("gnss", epoch)[0]
    for place in range(len(epoch)):
        for bit in range(8):
            flipped = bytearray(epoch)
            flipped[place] ^= 1 << bit
            for record in decode("gnss", bytes(flipped))[0]:
                assert record["lat_deg"] == true["lat_deg"]
                assert record["speed_mps"] in (None, true["speed_mps"], pytest.approx(true["speed_mps"], abs=3e-4))


@pytest.mark.parametrize("make", [GnssDecoder, SlaveBoard, lambda: HeadDecoder(HEAD_PROTOCOLS["greenseeker"]),
                                  lambda: HeadDecoder(HEAD_PROTOCOLS["acs430"], head=None)])
@SHORT
@given(pieces=st.lists(st.binary(max_size=300), max_size=20))
def test_pure_noise_gives_nothing(make, pieces):
    decoder = make()
    found = [reading for piece in pieces for reading in decoder.feed(piece, 0.0)]
    assert found == [] or isinstance(decoder, HeadDecoder)


@SHORT
@given(seed=st.integers(0, 2**32), word=st.sampled_from([None, 0, 2**32 - 1]))
def test_the_board_obeys_only_what_was_sent(seed, word):
    """Bit flips and cuts in the command stream: the drives never get a set-point that nobody sent."""
    chance = random.Random(seed)
    board = VirtualBoard(20.0, lambda: word)
    sent = {0.0}
    for tick in range(60):
        rpm = float(chance.randrange(10, 100))
        sent.add(rpm)
        line = bytearray(encode_command(CommandFrame(tick, rpm if tick else 0.0, 20.0, tick > 0, word=word)))
        for _ in range(chance.randrange(3)):
            line[chance.randrange(len(line))] ^= 1 << chance.randrange(8)
        board.feed(bytes(line[:chance.randrange(5, len(line) + 1)] if chance.random() < 0.2 else line), tick * 0.05)
        command, _ = board.set_points(tick * 0.05)
        assert command.shaft_rpm in sent
        assert command.opening_mm == 20.0
