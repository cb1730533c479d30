"""Wheel speed from pulses and the board's clock."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from topdress.control.readings import AnnouncedSpeeds
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.canopy_heads import FIELDS_OF_PROTOCOL, HeadDecoder, HeadFields
from topdress.drivers.devices.decode import decode_capture
from topdress.drivers.devices.nmea import calc_checksum
from topdress.drivers.devices.tractor_speed import TractorSpeedDecoder, make_speed_sentence
from topdress.drivers.devices.wheel import WheelGeometry, WheelSpeed
from topdress.drivers.ports import make_memory_pair

WAY_M = 0.15625


def drive(
    wheel: WheelSpeed,
    speed_mps: float,
    seconds: float,
    start_us: int = 1_000_000,
    pulses: int = 1,
    status_hz: int = 20,
) -> list[float | None]:
    """Exact pulses at a constant speed, told at the status rate; the first one falls at
    `start_us`."""
    found = []
    for tick in range(int(seconds * status_hz)):
        now_s = tick / status_hz
        done = int(now_s * speed_mps / WAY_M + 1e-9)
        at_us = start_us + round(done * WAY_M / speed_mps * 1e6) if speed_mps else start_us
        found.append(
            wheel.update_speed(
                (start_us + round(now_s * 1e6)) % 2**32, (pulses + done) % 2**32, at_us % 2**32
            )
        )
    return found


@pytest.mark.parametrize("speed_mps", [0.3, 1.25, 5.0, 12.0])
def test_constant_speed_is_met_once_two_pulses_have_come(speed_mps):
    found = drive(WheelSpeed(WheelGeometry(2.50, 16)), speed_mps, 4.0)
    assert found[20:] == [pytest.approx(speed_mps, rel=1e-4)] * 60


def test_circumference_and_pulses_per_turn_count():
    assert drive(WheelSpeed(WheelGeometry(5.0, 8)), 1.25, 4.0)[-1] == pytest.approx(5.0, rel=1e-4)


def test_no_pulse_for_eight_tenths_of_a_second_is_standstill_and_the_speed_falls_before():
    wheel = WheelSpeed(WheelGeometry())
    drive(wheel, 1.25, 2.0)  # last pulse: number 16, at 2.875 s
    after = [
        wheel.update_speed(2_875_000 + ms * 1000, 16, 2_875_000) for ms in (100, 200, 400, 799, 800)
    ]
    assert after == [
        pytest.approx(1.25),
        pytest.approx(WAY_M / 0.2),
        pytest.approx(WAY_M / 0.4),
        pytest.approx(WAY_M / 0.799),
        0.0,
    ]


def test_both_counters_wrap():
    found = drive(
        WheelSpeed(WheelGeometry()), 1.25, 4.0, start_us=2**32 - 2_000_000, pulses=2**32 - 5
    )
    assert found[20:] == [pytest.approx(1.25, rel=1e-4)] * 60


def test_a_restarted_board_begins_anew():
    wheel = WheelSpeed(WheelGeometry())
    drive(wheel, 1.25, 4.0, pulses=5000)
    found = drive(wheel, 1.25, 4.0, start_us=200_000)
    assert all(speed is not None and 0.0 <= speed <= 1.2501 for speed in found)
    assert found[-1] == pytest.approx(1.25, rel=1e-4)


def test_impossible_counts_are_no_speed():
    wheel = WheelSpeed(WheelGeometry())
    drive(wheel, 1.25, 2.0)
    assert wheel.update_speed(3_050_000, 5000, 3_049_000) is None


def test_a_wheel_that_never_turned_stands():
    assert WheelSpeed(WheelGeometry()).update_speed(100_000, 0, 0) == 0.0


# --- Told speeds in bytes: what is taken, what is refused and counted, and the way from a cab's
# port to control ------

PLAN = AnnouncedSpeeds(3.0, ((0.0, 1.25), (1.2, 2.0)), 0.5)


def framed(body: bytes) -> bytes:
    return b"$%s*%02X\r\n" % (body, calc_checksum(body))


def test_a_plan_comes_through_in_any_pieces() -> None:
    for size in (1, 3, 7, 100):
        decoder, found = TractorSpeedDecoder(), []
        data = make_speed_sentence(PLAN) * 3
        for k in range(0, len(data), size):
            found += decoder.feed(data[k : k + size], 3.0)
        assert [one.points[1] for one in found] == [pytest.approx((1.2, 2.0))] * 3
        assert decoder.counts.accepted == decoder.counts.read == 3


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        (b"$PTDSP,0.50,0.0,4.5*00\r\n", "bad_checksum"),
        (b"nonsense\r\n", "garbage"),
        (framed(b"PTDSP,0.50,0.0"), "wrong_fields"),
        (framed(b"PTDSP,0.50,0.0,nan"), "wrong_fields"),
        (framed(b"PTDSP,0.50,0.0,1e9"), "wrong_fields"),
        (framed(b"PTDSP,0.50,1.0,4.5"), "impossible_value"),
        (framed(b"PTDSP,0.00,0.0,4.5"), "impossible_value"),
        (framed(b"PTDSP,0.50,0.0,400"), "impossible_value"),
        (framed(b"PTDSP,0.50,0.0,4.5,2.0,5,1.0,6"), "impossible_value"),
    ],
)
def test_what_is_wrong_is_counted_and_told_to_nobody(line: bytes, kind: str) -> None:
    decoder = TractorSpeedDecoder()
    assert decoder.feed(line, 0.0) == []
    assert dict(decoder.counts.rejected) == {kind: 1}


@settings(max_examples=200, deadline=None)
@given(st.lists(st.one_of(st.binary(max_size=60), st.just(make_speed_sentence(PLAN))), max_size=8))
def test_no_bytes_break_it(pieces: list[bytes]) -> None:
    decoder = TractorSpeedDecoder()
    for k, piece in enumerate(pieces):
        for told in decoder.feed(piece, float(k)):
            assert told.points[0][0] == 0.0 and all(abs(mps) <= 30.0 for _, mps in told.points)
    counts = decoder.counts
    assert counts.read == counts.accepted + counts.rejected_total + sum(counts.ignored.values())


def test_from_the_cabs_port_to_control() -> None:
    host, line = make_memory_pair("line", lambda: 0.0)
    cab = Cab(
        CabConfig.model_validate({"tractor": {"port": "socket://x:1"}}),
        lambda: 0.0,
        lambda *_: host,
    )
    assert cab.read_measurements(0.0).speed_told is None
    line.write(make_speed_sentence(PLAN))
    told = cab.read_measurements(1.0).speed_told
    assert (
        told is not None
        and told.time_s == 1.0
        and told.points[0][1] == pytest.approx(1.25, abs=1e-3)
    )
    assert cab.read_measurements(5.0).speed_told == told, (
        "however old: who uses it looks at its time"
    )


def test_a_capture_is_decoded() -> None:
    records, counts = decode_capture("tractor", make_speed_sentence(PLAN))
    assert counts.accepted == 1 and records[0]["speed_mps_in_1.2_s"] == pytest.approx(2.0)


# --- Canopy heads: layouts, ranges, partial first lines, six heads on one line
# ---------------------------------------


@pytest.mark.parametrize(
    ("layout", "line", "ndvi", "index_2"),
    [
        pytest.param(
            FIELDS_OF_PROTOCOL["greenseeker"],
            b"12.500,7,0.612,0.745,1\r\n",
            0.612,
            0.745,
            id="greenseeker: 3rd and 4th",
        ),
        pytest.param(
            FIELDS_OF_PROTOCOL["acs430"],
            b"0.210,0.655,18.1,27.7,5.8\r\n",
            0.655,
            0.21,
            id="crop circle 430: 2nd and 1st",
        ),
        pytest.param(
            FIELDS_OF_PROTOCOL["acs435"],
            b"0.210,0.655,18.1,27.7,5.8,0,0,0\r\n",
            0.655,
            0.21,
            id="435: 2nd and 1st",
        ),
        pytest.param(HeadFields(fields=3, ndvi=3), b"a,b,0.5\n", 0.5, None, id="own layout"),
    ],
)
def test_which_field_is_which(layout, line, ndvi, index_2):
    (sample,) = HeadDecoder(layout, head=4).feed(line, 3.5)
    assert sample == (3.5, 4, ndvi, index_2)


def test_rates_and_lengths_of_crop_circle():
    assert (FIELDS_OF_PROTOCOL["acs430"].baud, FIELDS_OF_PROTOCOL["acs435"].fields) == (38400, 8)


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        (b"12.5,7,0.612,0.745", "wrong_field_count"),
        (b"12.5,7,0.612,0.745,1,9", "wrong_field_count"),
        (b"12.5,7,,0.745,1", "not_a_number"),
        (b"12.5,7,nan,0.745,1", "not_a_number"),
        (b"12.5,7,0.6.2,0.745,1", "not_a_number"),
        (b"12.5,7,1e-1,0.745,1", "not_a_number"),
        (b"12.5,7,612,0.745,1", "out_of_range"),
        (b"12.5,7,-1.01,0.745,1", "out_of_range"),
        (b"12.5,7,0.5,745,1", "out_of_range"),
    ],
)
def test_wrong_lines_are_named(line, kind):
    decoder = HeadDecoder(FIELDS_OF_PROTOCOL["greenseeker"])
    assert decoder.feed(b"1,1,0.5,0.5,1\r\n" + line + b"\r\n", 0.0)[1:] == []
    assert dict(decoder.counts.rejected) == {kind: 1}


def test_the_line_under_way_when_the_port_opens_is_no_error():
    decoder = HeadDecoder(FIELDS_OF_PROTOCOL["greenseeker"])
    assert len(decoder.feed(b".612,0.745,1\r\n1,1,0.5,0.5,1\r\n", 0.0)) == 1
    assert not decoder.counts.rejected
    assert decoder.counts.ignored == {"partial_first": 1}


def test_a_whole_first_line_counts():
    assert len(HeadDecoder(FIELDS_OF_PROTOCOL["greenseeker"]).feed(b"1,1,0.5,0.5,1\r\n", 0.0)) == 1


def test_multiplexed_lines_keep_their_heads_apart():
    decoder = HeadDecoder(FIELDS_OF_PROTOCOL["greenseeker"], head=None, heads=6)
    samples = decoder.feed(
        b"H1,1,1,0.5,0.5,1\nH6,1,1,0.6,0.5,1\nH7,1,1,0.7,0.5,1\n1,1,0.8,0.5,1\nH2,1,1,0.9\n", 0.0
    )
    assert [(sample.head, sample.ndvi) for sample in samples] == [(1, 0.5), (6, 0.6)]
    assert decoder.counts.rejected == {"unknown_head": 2, "wrong_field_count": 1}


@pytest.mark.parametrize("layout", [HeadFields(5, 6), HeadFields(5, 0), HeadFields(5, 3, 6)])
def test_a_layout_that_points_outside_the_line_is_refused(layout):
    with pytest.raises(ValueError, match=r"field map: .* allowed is"):
        HeadDecoder(layout)
