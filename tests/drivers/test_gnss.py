"""NMEA to fixes: epochs, latency, units, and every kind of wrong sentence counted as what it is."""

from __future__ import annotations

import pytest
from topdress.control.readings import GnssFix
from topdress.drivers.devices.gnss import GnssDecoder


def gga(
    clock: str,
    lat: str = "3416.800000,N",
    lon: str = "11952.800000,E",
    quality: str = "4",
    talker: str = "GN",
    satellites: str = "14",
    hdop: str = "0.80",
) -> str:
    return f"{talker}GGA,{clock},{lat},{lon},{quality},{satellites},{hdop},30.0,M,0.0,M,,"


def rmc(
    clock: str,
    knots: str = "2.430",
    course: str = "90.50",
    date: str = "010426",
    status: str = "A",
    talker: str = "GN",
    mode: str = "R",
) -> str:
    return (
        f"{talker}RMC,{clock},{status},3416.800000,N,11952.800000,E,{knots},{course},{date},"
        f",,{mode}"
    )


def vtg(knots: str = "2.430", course: str = "90.50", kmh: str = "4.500", mode: str = "R") -> str:
    return f"GNVTG,{course},T,,M,{knots},N,{kmh},K,{mode}"


PLACE = "3416.800000,N,11952.800000,E"


def gns(clock: str, modes: str = "RRAN", place: str = PLACE) -> str:
    return f"GNGNS,{clock},{place},{modes},14,0.80,30.0,0.0,,"


def gll(clock: str, status: str = "A", mode: str = ",D", place: str = PLACE) -> str:
    return f"GPGLL,{place},{clock},{status}{mode}"


def zda(clock: str, day: str = "01,04,2026") -> str:
    return f"GPZDA,{clock},{day},00,00"


@pytest.fixture
def send(nmea):
    """Feed payloads to a decoder at a time."""

    def feed(decoder: GnssDecoder, time_s: float, *payloads: str) -> list[GnssFix]:
        return decoder.feed(b"".join(nmea(payload) for payload in payloads), time_s)

    return feed


@pytest.fixture
def settled(send) -> GnssDecoder:
    """A decoder that has seen two epochs GGA, RMC, VTG, at 06:00:00 and 06:00:01."""
    decoder = GnssDecoder()
    for second in range(2):
        send(decoder, float(second), gga(f"06000{second}.000"), rmc(f"06000{second}.000"), vtg())
    return decoder


def test_a_fix_in_si_units_with_date_and_time(send, settled):
    (fix,) = send(settled, 2.0, gga("060002.200"), rmc("060002.200"), vtg())
    assert fix.utc == "2026-04-01T06:00:02.200Z"
    assert fix.lat_deg == pytest.approx(34.28, abs=1e-9)
    assert fix.lon_deg == pytest.approx(119.88, abs=1e-9)
    assert (fix.fix_quality, fix.satellites, fix.hdop) == (4, 14, 0.8)
    assert fix.speed_mps == pytest.approx(2.43 * 1852 / 3600)
    assert fix.heading_deg == pytest.approx(90.5)


def test_south_and_west_are_negative(send, settled):
    place = send(
        settled,
        2.0,
        gga("060002.000", lat="3416.800000,S", lon="11952.800000,W"),
        rmc("060002.000"),
        vtg(),
    )
    assert (place[0].lat_deg, place[0].lon_deg) == (pytest.approx(-34.28), pytest.approx(-119.88))


def test_kmh_of_vtg_where_nothing_else_gives_a_speed(send):
    decoder = GnssDecoder(live=False)
    send(decoder, 0.0, gga("060000.000"), vtg(knots=""))
    (fix,) = decoder.flush(0.0)
    assert fix.speed_mps == pytest.approx(1.25)


def test_handed_over_with_the_sentence_that_ended_the_last_epochs(send, settled):
    assert send(settled, 2.00, gga("060002.000")) == []
    assert send(settled, 2.01, rmc("060002.000")) == []
    (fix,) = send(settled, 2.02, vtg())
    assert fix.time_s == 2.00, "the time is the arrival of the epoch's first sentence"
    assert send(settled, 3.00, gga("060003.000")) == [], "each epoch once"


def test_an_epoch_whose_ending_sentence_is_lost_comes_with_the_next(send, settled):
    assert send(settled, 2.0, gga("060002.000"), rmc("060002.000")) == []
    (fix,) = send(settled, 3.0, gga("060003.000"))
    assert (fix.utc, fix.time_s) == ("2026-04-01T06:00:02.000Z", 2.0)


def test_a_lost_sentence_in_the_middle_costs_no_latency(send, settled):
    (fix,) = send(settled, 2.0, gga("060002.000"), vtg())
    assert fix.speed_mps == pytest.approx(2.43 * 1852 / 3600)


def test_gga_at_ten_hertz_with_rmc_once_a_second_never_waits(send):
    decoder = GnssDecoder()
    late = []
    for tick in range(40):
        now = f"0600{tick // 10:02d}.{tick % 10}00"
        fixes = send(decoder, tick / 10, gga(now))
        if tick % 10 == 0:
            fixes += send(decoder, tick / 10 + 0.02, rmc(now))
        if tick >= 2 and not any(fix.time_s == tick / 10 for fix in fixes):
            late.append(tick)
        if tick >= 10 and tick % 10 == 0:
            assert [fix.speed_mps is None for fix in fixes] == [True, False], (
                "completed when RMC brings the speed"
            )
    assert late == []


def test_split_anywhere_gives_the_same_fixes(nmea):
    stream = b"".join(
        nmea(payload)
        for tick in range(6)
        for payload in (gga(f"06000{tick}.000"), rmc(f"06000{tick}.000"), vtg())
    )
    whole = GnssDecoder(live=False)
    expected = [fix._replace(time_s=0) for fix in whole.feed(stream, 0.0) + whole.flush(0.0)]
    for size in (1, 2, 7, 64):
        decoder = GnssDecoder(live=False)
        found = [
            fix
            for start in range(0, len(stream), size)
            for fix in decoder.feed(stream[start : start + size], 0.0)
        ]
        assert [fix._replace(time_s=0) for fix in found + decoder.flush(0.0)] == expected
    assert len(expected) == 6


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        (gga("060002.000", lat="9116.800000,N"), "impossible_value"),
        (gga("060002.000", lat="3460.800000,N"), "impossible_value"),
        (gga("060002.000", lon="18152.800000,E"), "impossible_value"),
        (gga("060002.000", lat="0000.000000,N", lon="00000.000000,E"), "impossible_value"),
        (gga("250002.000"), "impossible_value"),
        (gga("060062.000"), "impossible_value"),
        (gga("060002.000", hdop="-1.0"), "impossible_value"),
        (gga("060002.000", quality="12"), "impossible_value"),
        (gga("060002.000", quality="x"), "malformed"),
        (gga("060002.000", hdop="nan"), "malformed"),
        (gga("060002.000", lat="3416.800000,X"), "malformed"),
        (gga("060002.000", lat=",", lon=","), "malformed"),
        (gga("6:00"), "malformed"),
        (rmc("060002.000", knots="400.0"), "impossible_value"),
        (rmc("060002.000", knots="-1.0"), "impossible_value"),
        (rmc("060002.000", course="361.0"), "impossible_value"),
        (rmc("060002.000", date="320426"), "impossible_value"),
        (rmc("060002.000", status="Q"), "malformed"),
        ("GNRMC,060002.000,A", "malformed"),
        (vtg(knots="1e3"), "malformed"),
        (gns("060000.00", "RXA"), "malformed"),
        (gns("060000.00", ""), "malformed"),
        (gns("060000.00", place="9116.800000,N,11952.800000,E"), "impossible_value"),
        (gll("060000.00", status="Q"), "malformed"),
        (gll("250000.00"), "impossible_value"),
        (gll("060000.00", mode=",X"), "malformed"),
        (zda("060000.00", "32,01,2026"), "impossible_value"),
        (zda("060000.00", "01,01,1926"), "impossible_value"),
        (zda("060000.00", "01,xx,2026"), "malformed"),
        ("GPZDA,060000.00", "malformed"),
    ],
)
def test_what_cannot_be_is_rejected_and_named(send, settled, payload, kind):
    before = settled.counts.accepted
    assert send(settled, 2.0, payload) == []
    assert dict(settled.counts.rejected) == {kind: 1}
    assert settled.counts.accepted == before


def test_checksums(nmea, settled):
    good = nmea(gga("060002.000"))
    settled.feed(good.replace(b"3416.8", b"3416.9"), 2.0)
    settled.feed(good.partition(b"*")[0] + b"\r\n", 2.0)
    settled.feed(good.partition(b"*")[0] + b"*\r\n", 2.0)
    assert dict(settled.counts.rejected) == {"bad_checksum": 1, "missing_checksum": 2}


def test_time_running_backwards(send, settled):
    assert send(settled, 2.0, gga("055959.000"), rmc("055959.000"), vtg()) == []
    assert settled.counts.rejected == {"time_backwards": 3}
    (fix,) = send(settled, 2.1, gga("060002.000"), rmc("060002.000"), vtg())
    assert fix.utc == "2026-04-01T06:00:02.000Z"


def test_a_receiver_whose_clock_was_set_back_is_believed_after_five_seconds(send, settled):
    found = [
        fix
        for tick in range(80)
        for fix in send(settled, 2.0 + tick / 10, gga(f"0500{tick // 10:02d}.{tick % 10}00"))
    ]
    assert found[0].utc == "2026-04-01T05:00:05.000Z"
    assert settled.counts.rejected == {"time_backwards": 50}


def test_midnight_is_not_backwards_and_turns_the_date(send):
    decoder = GnssDecoder()
    send(decoder, 0.0, gga("235958.000"), rmc("235958.000", date="310326"))
    send(decoder, 1.0, gga("235959.000"), rmc("235959.000", date="310326"))
    send(decoder, 2.0, gga("000000.000"))
    fixes = send(decoder, 3.0, gga("000001.000"))
    assert [fix.utc for fix in fixes] == ["2026-04-01T00:00:00.000Z", "2026-04-01T00:00:01.000Z"]
    assert not decoder.counts.rejected


def test_duplicate_epoch(send, settled):
    epoch = gga("060002.000"), rmc("060002.000"), vtg()
    assert len(send(settled, 2.0, *epoch, *epoch)) == 1
    assert settled.counts.rejected == {"duplicate_epoch": 3}


def test_a_second_constellation_in_the_same_epoch_is_no_error(send, settled):
    second = gga("060002.000", talker="GL", satellites="03")
    (fix,) = send(settled, 2.0, gga("060002.000"), second, rmc("060002.000"), vtg())
    assert fix.satellites == 14
    assert not settled.counts.rejected
    assert settled.counts.ignored == {"other_talker": 1}


@pytest.mark.parametrize(
    "talker", ["GP", "GN", "GL", "GA", "GB", "BD", "GI", "GQ", "QZ", "IN", "EC", "II", "U3"]
)
def test_talkers(send, talker):
    decoder = GnssDecoder(live=False)
    send(decoder, 0.0, gga("060000.000", talker=talker))
    assert len(decoder.flush(0.0)) == 1


def test_other_types_and_talkers_are_ignored_by_name(send, settled):
    send(
        settled,
        2.0,
        "GPGSV,1,1,00",
        "GPZDA,060002.00,01,04,2026,00,00",
        gga("060002.000", talker="IN"),
        "PASHR,1,2",
    )
    assert settled.counts.ignored == {"GSV": 1, "ZDA": 1, "INGGA": 1, "PASHR": 1}


@pytest.mark.parametrize(
    "payload",
    [
        "GNGGA,060002.000,,,,,0,00,99.99,,,,,,",
        "GNGGA,,,,,,0,,,,M,,M,,",
        "GNRMC,,V,,,,,,,,,,N",
        "GNVTG,,T,,M,,N,,K,N",
    ],
)
def test_no_fix_is_no_error_and_no_position(send, settled, payload):
    assert send(settled, 2.0, payload) == []
    assert not settled.counts.rejected
    assert settled.counts.ignored == {"no_fix": 1}


def test_garbage_comments_and_glued_sentences(nmea, settled):
    good = nmea(gga("060002.000"))
    settled.feed(b"# a comment with $GPGGA in it\r\n" + b"\xff\x00noise" + good, 2.0)
    settled.feed(
        nmea(gga("060003.000"))[:-20] + nmea(rmc("060003.000")) + b"$" + vtg().encode() + b"\r\n",
        3.0,
    )
    assert settled.counts.ignored == {"comment": 1}
    assert settled.counts.rejected == {"garbage": 1, "missing_checksum": 2}
    assert settled.counts.accepted == 8


def test_a_flood_without_line_ends_is_dropped(nmea, settled):
    settled.feed(b"x" * 100_000, 2.0)
    settled.feed(b"yyy\r\n" + nmea(gga("060002.000")), 2.0)
    assert settled.counts.rejected == {"overlong": 1}
    assert settled.counts.accepted == 7


# -- receivers that send neither GGA nor RMC, and who stands before whom
# -----------------------------------------


@pytest.mark.parametrize(
    ("modes", "quality"), [("RRAN", 4), ("NNNA", 1), ("AF", 5), ("DA", 2), ("E", 6), ("PN", 3)]
)
def test_gns_alone_is_a_fix_of_its_best_constellation(send, modes, quality):
    decoder = GnssDecoder(live=False)
    send(decoder, 0.0, gns("060000.000", modes), vtg())
    (fix,) = decoder.flush(0.0)
    assert (fix.lat_deg, fix.lon_deg) == (pytest.approx(34.28), pytest.approx(119.88))
    assert (fix.fix_quality, fix.satellites, fix.hdop) == (quality, 14, 0.8)
    assert fix.speed_mps == pytest.approx(2.43 * 1852 / 3600)


def test_gll_alone_is_a_place_with_a_quality_and_no_more(send):
    decoder = GnssDecoder()
    fixes = [fix for k in range(4) for fix in send(decoder, float(k), gll(f"06000{k}.000"), vtg())]
    assert [fix.time_s for fix in fixes][-2:] == [2.0, 3.0], "handed over at once"
    assert (fixes[-1].fix_quality, fixes[-1].satellites, fixes[-1].hdop) == (2, None, None)
    old = GnssDecoder(live=False)
    send(old, 0.0, gll("060000.00", mode=""))
    assert old.flush(0.0)[0].fix_quality == 1, "before NMEA 2.3 it had no mode"


@pytest.mark.parametrize("order", [("gga", "zda"), ("zda", "gga")])
def test_zda_gives_the_date_to_a_receiver_without_rmc(send, order):
    decoder, said = GnssDecoder(), []
    for second, day in (
        (58, "31,12,2025"),
        (59, "31,12,2025"),
        (60, "01,01,2026"),
        (61, "01,01,2026"),
    ):
        clock = f"2359{second}.000" if second < 60 else f"0000{second - 60:02d}.000"
        sentences = {"gga": gga(clock), "zda": zda(clock, day)}
        said += send(decoder, float(second), *(sentences[name] for name in order))
    said += decoder.flush(62.0)
    times = [fix.utc for fix in said if fix.utc]
    assert (
        times[-4:]
        == [
            "2025-12-31T23:59:58.000Z",
            "2025-12-31T23:59:59.000Z",
            "2026-01-01T00:00:00.000Z",
            "2026-01-01T00:00:01.000Z",
        ][-len(times) :]
    )
    assert times[-1] == "2026-01-01T00:00:01.000Z"
    assert decoder.counts.ignored["ZDA"] == 4


@pytest.mark.parametrize(
    "payload",
    [
        gns("060000.00", "NN"),
        gll("060000.00", status="V"),
        gll("060000.00", mode=",N"),
        "GPZDA,,,,,00,00",
    ],
)
def test_what_these_do_not_know_is_no_error(send, payload):
    decoder = GnssDecoder(live=False)
    send(decoder, 0.0, payload)
    assert decoder.flush(0.0) == [] and not decoder.counts.rejected


def test_gns_and_gll_stand_behind_gga_until_it_is_silent(send, settled):
    elsewhere = "3516.800000,N,11952.800000,E"
    send(settled, 2.0, gns("060002.000", place=elsewhere), gll("060002.000", place=elsewhere))
    assert settled.counts.ignored == {"GNS": 1, "GLL": 1}
    send(settled, 2.5, "GNGGA,060002.500,,,,,0,00,99.99,,,,,,", gll("060002.500", place=elsewhere))
    assert settled.counts.ignored["GLL"] == 2, "a GGA without a fix speaks too"
    fixes = [
        fix
        for k in range(8, 12)
        for fix in send(settled, float(k), gll(f"0600{k:02d}.000", place=elsewhere), vtg())
    ]
    assert fixes[-1].lat_deg == pytest.approx(35.28)


def test_programs_stand_behind_receivers_until_these_are_silent(send, settled):
    send(settled, 2.0, gga("060002.000", talker="IN"), rmc("060002.000", talker="EC"))
    assert settled.counts.ignored == {"INGGA": 1, "ECRMC": 1}
    fixes = [
        fix
        for k in range(8, 12)
        for fix in send(settled, float(k), rmc(f"0600{k:02d}.000", talker="EC"))
    ]
    assert fixes and fixes[-1].utc == "2026-04-01T06:00:11.000Z"
