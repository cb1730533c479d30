"""Ten recordings of real receivers: what the decoder makes of each is pinned."""
from __future__ import annotations

import time
from itertools import pairwise
from math import atan2, cos, degrees, hypot, radians

import pytest

from drivers.devices.decode import decode
from drivers.devices.gnss import GnssDecoder

EXPECTED = {    # fixes, accepted sentences, rejected by kind
    "beidou-bd": (5, 10, {}),
    "bt451": (8, 24, {"time_backwards": 15}),
    "garmin-10x": (10, 19, {}),
    "gp-320fw-2019-04-07-coldboot": (2, 4, {"bad_checksum": 32, "garbage": 2, "malformed": 4, "missing_checksum": 8}),
    "hemi": (21, 42, {}),
    "nl2008u": (9, 27, {}),
    "nmea-rtk": (122, 244, {}),
    "quectel-l76k-nmea": (151, 450, {}),
    "rst39": (41, 44, {}),
    "sirfstarv-nmea": (59, 118, {}),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_what_each_recording_gives(recordings, name):
    data = next(path for path in recordings if path.stem == name).read_bytes()
    records, counts = decode("gnss", data)
    assert (len(records), counts.accepted, dict(counts.rejected)) == EXPECTED[name]
    assert counts.read == counts.accepted + sum(counts.rejected.values()) + sum(counts.ignored.values())
    times = [record["utc"] for record in records if record["utc"]]
    assert times == sorted(times)
    assert len(set(times)) == len(times)


def test_every_recording_is_expected(recordings):
    assert {path.stem for path in recordings} == set(EXPECTED)


def test_positions_are_where_the_recordings_say_they_were_made(recordings):
    places = {"bt451": (55.8, 23.6), "garmin-10x": (41.7, -83.6), "nl2008u": (48.2, 8.4),
              "sirfstarv-nmea": (44.06, -121.31), "quectel-l76k-nmea": (47.7, -122.3)}
    for path in recordings:
        if path.stem in places:
            for record in decode("gnss", path.read_bytes())[0]:
                assert (record["lat_deg"], record["lon_deg"]) == (
                    pytest.approx(places[path.stem][0], abs=0.08), pytest.approx(places[path.stem][1], abs=0.08))


def test_speed_agrees_with_the_way_between_positions(recordings):
    """The end of bt451 drives at 16 m/s: knots taken for km/h or m/s would not fit its positions."""
    data = next(path for path in recordings if path.stem == "bt451").read_bytes()
    fixes = decode("gnss", data[data.index(b"$GPGGA,143306.00"):])[0]
    ways = []
    for before, after in pairwise(fixes[1:]):
        north_m = (after["lat_deg"] - before["lat_deg"]) * 111_195.0
        east_m = (after["lon_deg"] - before["lon_deg"]) * 111_195.0 * cos(radians(55.78))
        assert hypot(north_m, east_m) / 0.5 == pytest.approx(0.5 * (before["speed_mps"] + after["speed_mps"]), rel=0.04)
        assert degrees(atan2(east_m, north_m)) % 360 == pytest.approx(after["heading_deg"], abs=2.0)
        ways.append(north_m)
    assert len(ways) == 4


def test_live_and_whole_decoding_agree_on_the_last_word_of_every_epoch(recordings):
    for path in recordings:
        data = path.read_bytes()
        live, found = GnssDecoder(), {}
        for start in range(0, len(data), 50):
            for fix in live.feed(data[start:start + 50], start / 960):
                found[fix.time_s, fix.lat_deg, fix.lon_deg] = fix
        for fix in live.flush(len(data) / 960):
            found[fix.time_s, fix.lat_deg, fix.lon_deg] = fix
        assert len(found) == EXPECTED[path.stem][0], path.stem


def test_keeps_up_with_twenty_thousand_sentences_a_second(recordings):
    data = b"".join(path.read_bytes() for path in recordings)
    best = 0.0
    for _ in range(3):
        decoder = GnssDecoder()
        begin = time.process_time()
        decoder.feed(data, 0.0)
        best = max(best, decoder.counts.read / (time.process_time() - begin))
    assert best > 20_000
