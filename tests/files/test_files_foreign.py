from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drivers.files.imports.trouble import TableError
from drivers.files.read_log import RunLog, read_log

Written = Callable[..., Path]


def ids(log: RunLog) -> set[str]:
    return {finding.id for finding in log.findings if finding.id != "missing"}


def said(log: RunLog, id: str) -> str:
    return next(str(finding) for finding in log.findings if finding.id == id)


def table(header: str, rows: list[str], line_end: str = "\n") -> str:
    return line_end.join([header, *rows]) + line_end


def track(speed: float, written_speed: float, rows: int = 100, swap: bool = False, lat: float = 34.0,
          lon: float = 119.5) -> str:
    """North-east at `speed` m/s, one row a second, and what the speed column says."""
    lines = []
    for k in range(rows):
        north = lat + k * speed * np.cos(np.pi / 6) / 111_000
        east = lon + k * speed * np.sin(np.pi / 6) / 111_300 / np.cos(np.radians(lat))
        place = f"{east:.9f},{north:.9f}" if swap else f"{north:.9f},{east:.9f}"
        lines.append(f"{k},{place},{written_speed},30.0")
    return table("time_s,lat_deg,lon_deg,speed_mps,heading_deg", lines)


# Text: handled and said

@pytest.mark.parametrize(("content", "found"), [
    (b"\xef\xbb\xbftime_s,speed_mps\n0,1.5\n1,1.25\n", {"byte_order_mark"}),
    (b"time_s,speed_mps\r\n0,1.5\r\n1,1.25\r\n", {"crlf"}),
    (b"time_s,speed_mps\r0,1.5\r1,1.25\r", {"carriage_returns"}),
    (b"time_s;speed_mps\n0;1.5\n1;1.25\n", {"separator"}),
    (b"time_s\tspeed_mps\n0\t1.5\n1\t1.25\n", {"separator"}),
    (b"sep=;\ntime_s;speed_mps\n0;1,5\n1;1,25\n", {"separator", "decimal_comma", "preamble"}),
    (b"time_s;speed_mps\n0,0;1,5\n1,0;1,25\n", {"separator", "decimal_comma"}),
    (b'time_s,speed_mps\n"0","1,5"\n"1","1,25"\n', set()),
    (b"# exported\n# twice\ntime_s,speed_mps\n0,1.5\n1,1.25\n", {"preamble"}),
    (b" Time_S , speed_mps \n0, 1.5\n1, 1.25\n", {"other_name"}),
    (b"time_s,speed_mps,\n0,1.5,\n1,1.25,\n", set()),
    (b"time_s,speed_mps\n0,1.5\n\n1,1.25\n\n", set()),
    (b"time_s,speed_mps\n0,1.5\n1,1.25", {"no_last_line_end"}),
    ("time_s,speed_mps\n0,1.5\n1,1.25\n".encode("utf-16"), {"utf16"}),
    ("time_s,speed_mps,note\n0,1.5,地块\n1,1.25,\n".encode("gb18030"), {"encoding"}),
    (b"time_s,speed_mps\n0,1.5\n0.5,1.4,7\n1,1.25\n", {"wrong_fields"}),
    (b"time_s,speed_mps\n0,1.5\n0.5\n1,1.25\n", {"wrong_fields"}),
    (b"time_s,speed_mps\n0,1.5\n\0\0\0\0001,1.25\n", {"zero_bytes"}),
])
def test_tables_of_other_programs(written: Written, content: bytes, found: set[str]) -> None:
    log = read_log(written(content))
    assert log.time_s.tolist() == [0.0, 1.0]
    assert log.columns["speed_mps"].tolist() == [1.5, 1.25]
    assert ids(log) == found


def test_chinese_notes_survive_their_encoding(written: Written) -> None:
    log = read_log(written("time_s,note\n0,地块\n1,雨\n".encode("gb18030")))
    assert log.columns["note"].tolist() == ["地块", "雨"]


def test_cells_that_are_no_numbers_are_counted(written: Written) -> None:
    log = read_log(written("time_s,speed_mps\n0,1.5\n1,fast\n2,NA\n3,err\n4,-\n"))
    assert log.columns["speed_mps"][0] == 1.5 and np.isnan(log.columns["speed_mps"][1:]).all()
    assert said(log, "not_a_number") == "column speed_mps: 2 cells such as 'fast' emptied: not a number"


# Text: refused in one line

@pytest.mark.parametrize(("content", "line"), [
    (b"", "the file is empty"), (b"\n\n  \n", "the file is empty"), (b"# only\n# comments\n", "holds comments only"),
    (b"0.0,1.5,2\n0.1,1.4,2\n", "no header row: the first line is 0.0,1.5,2"),
    (b"time_s,speed_mps,speed_mps\n0,1,2\n", "column speed_mps stands 2 times in the header: allowed once"),
    (b"time_s,speed_mps\n0,0,1,5\n1,0,1,25\n", "is the decimal sign a comma?"),
    (b"tme_s,speed_mps\n0,1\n", r"no column time_s .*columns found: tme_s, speed_mps \(is it tme_s\?\)"),
    (b"time_s,speed_mps\nx,1\ny,2\n", "column time_s: no number in it"),
    (b"time_s,speed_mps\n3,1\n2,2\n3,1\n2,1\n3,1\n2,1\n", "sort the log by time_s"),
])
def test_what_cannot_be_used_is_refused_in_one_line(written: Written, content: bytes, line: str) -> None:
    path = written(content)
    with pytest.raises(TableError, match=line) as caught:
        read_log(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(TableError, match=r"none\.csv: no such file"):
        read_log(tmp_path / "none.csv")
    with pytest.raises(TableError, match="cannot be read"):
        read_log(tmp_path)


# Times

def times_of(written: Written, times: list[object], more: str = "") -> RunLog:
    return read_log(written(table("time_s,hopper_kg", [f"{time},{k}{more}" for k, time in enumerate(times)])))


def test_repeated_and_backward_times_are_left_out(written: Written) -> None:
    log = times_of(written, [0, 1, 2, 2, 3, 2.5, 4, 5])
    assert log.time_s.tolist() == [0, 1, 2, 3, 4, 5]
    assert log.columns["hopper_kg"].tolist() == [0, 1, 2, 4, 6, 7]
    assert said(log, "repeated_time").startswith("1 row left out")
    assert said(log, "backward_time").startswith("1 row left out: earlier than a row before, first at 2.500 s")


def test_a_log_that_stands_newest_first_is_read(written: Written) -> None:
    log = times_of(written, [3, 2, 1, 0])
    assert log.time_s.tolist() == [0, 1, 2, 3] and log.columns["hopper_kg"].tolist() == [3, 2, 1, 0]
    assert said(log, "row_order") == "rows do not stand in order of time (4 of 4): taken in order of time"


def test_one_wrong_time_costs_one_row(written: Written) -> None:
    """Before, every row after it was earlier than a row before, and the log was refused."""
    log = times_of(written, [0, 1, 2, 86400, 4, 5, 6, 7, 8, 9])
    assert log.columns["hopper_kg"].tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9]
    assert said(log, "forward_time") == "1 row left out: later than a row after, first at 86400.000 s"


def test_rows_lost_here_and_there_are_no_mixed_sample_time(written: Written) -> None:
    log = times_of(written, [round(0.1 * k, 1) for k in range(200) if k % 11])
    assert ids(log) == {"skipped_times"} and "about 18 rows missing (9.0 %)" in said(log, "skipped_times")


def test_rows_without_a_time_are_left_out(written: Written) -> None:
    log = times_of(written, [0, "", 2, "x", 4])
    assert log.columns["hopper_kg"].tolist() == [0, 2, 4]
    assert said(log, "no_time") == "2 rows without a time left out"


def test_gaps_are_said(written: Written) -> None:
    log = times_of(written, [*np.arange(0, 2, 0.1).round(3), *np.arange(5, 7, 0.1).round(3)])
    assert len(log) == 40
    assert said(log, "skipped_times") == ("1 gap in the times, the longest 3.1 s after 1.900 s (sample time 0.1 s): "
                                          "about 30 rows missing (42.9 %)")


@pytest.mark.parametrize("mark", ["mark file b.csv", "fault valve;mark log TLG002"])
def test_no_rows_are_missing_where_another_file_begins(written: Written, mark: str) -> None:
    times = [*np.arange(0, 2, 0.1).round(3), *np.arange(5, 7, 0.1).round(3)]
    rows = [f"{time_s},100,{mark if number == 20 else ''}" for number, time_s in enumerate(times)]
    log = read_log(written(table("time_s,hopper_kg,events", rows)))
    assert said(log, "joined") == "2 files in one log, 3.1 s from one to the next: no rows are missing there"
    assert "skipped_times" not in ids(log)


def test_a_mixed_sample_time_is_said(written: Written) -> None:
    assert "mixed_steps" in ids(times_of(written, np.cumsum([0.05, 0.2] * 20).round(3).tolist()))


def test_an_even_log_has_nothing_to_say_about_times(written: Written) -> None:
    jitter = np.random.default_rng(1).normal(0, 0.004, 200)
    assert ids(times_of(written, (np.arange(200) * 0.05 + jitter).clip(0).round(3).tolist())) == set()


def test_epochs_and_milliseconds(written: Written) -> None:
    log = times_of(written, [1_700_000_000, 1_700_000_000.5, 1_700_000_001])
    assert log.time_s.tolist() == [0, 0.5, 1.0] and ids(log) == {"epoch"}
    log = times_of(written, [1_700_000_000_000, 1_700_000_000_500, 1_700_000_001_000])
    assert log.time_s.tolist() == [0, 0.5, 1.0] and ids(log) == {"milliseconds"}
    rows = [f"{k * 100},2026-03-20T08:00:{k // 10:02d}.{k % 10}00Z" for k in range(50)]
    log = read_log(written(table("time_s,utc", rows)))
    assert log.step_s == pytest.approx(0.1) and ids(log) == {"milliseconds"}


def test_whole_seconds_at_ten_rows_a_second_are_spread(written: Written) -> None:
    log = times_of(written, [k // 10 for k in range(100)])
    assert len(log) == 100 and log.step_s == pytest.approx(0.1)
    assert said(log, "coarse_times") == "about 10 rows share each time: spread evenly over 1 s"


def test_time_is_computed_from_utc_where_need_be(written: Written) -> None:
    log = read_log(written("utc,speed_mps\n2026-03-20T08:00:00.000Z,1\n2026-03-20T08:00:00.500Z,1\n"))
    assert log.time_s.tolist() == [0.0, 0.5] and "time_from_utc" in ids(log)


# Values

@pytest.mark.parametrize(("column", "value"), [("speed_mps", -999), ("ndvi", 9999), ("hopper_kg", -9999),
                                               ("shaft_rpm", 32767), ("heading_deg", 999.9), ("hopper_kg", 9999)])
def test_sentinels_are_emptied_and_said(written: Written, column: str, value: float) -> None:
    log = read_log(written(table(f"time_s,{column}", [f"{k},{value if k == 3 else 0.5}" for k in range(10)])))
    assert np.flatnonzero(np.isnan(log.columns[column])).tolist() == [3]
    assert said(log, "sentinel") == f"column {column}: 1 value {value:g} emptied: not known"


def test_a_longitude_of_minus_99_is_a_place_where_the_latitude_is_one(written: Written) -> None:
    mexico = read_log(written(b"time_s,lat_deg,lon_deg\n0,19.4,-99\n1,19.4,0\n2,19.4,-99\n"))
    assert mexico.numbers("lon_deg").tolist() == [-99.0, 0.0, -99.0] and "sentinel" not in ids(mexico)
    china = read_log(written(b"time_s,lat_deg,lon_deg\n0,34.28,119.88\n1,-99,-99\n2,34.28,119.88\n"))
    assert np.isnan(china.numbers("lat_deg")[1]) and np.isnan(china.numbers("lon_deg")[1])


def test_honest_values_that_look_like_sentinels_stay(written: Written) -> None:
    log = read_log(written(table("time_s,hopper_kg", [f"{k},{995 + k}" for k in range(10)])))
    assert log.columns["hopper_kg"].tolist() == [995 + k for k in range(10)] and ids(log) == set()


def test_place_zero_zero_is_no_place(written: Written) -> None:
    log = read_log(written(table("time_s,lat_deg,lon_deg", ["0,0,0", "1,34.1,119.5", "2,0.0,0.0", "3,34.1,119.5"])))
    assert np.isnan(log.columns["lat_deg"]).tolist() == [True, False, True, False]
    assert said(log, "zero_position").startswith("2 rows with latitude and longitude 0")


def test_exchanged_places_are_put_right_where_that_is_certain(written: Written) -> None:
    log = read_log(written(track(1.25, 1.25, swap=True)))
    assert log.columns["lat_deg"][0] == pytest.approx(34.0) and log.columns["lon_deg"][0] == pytest.approx(119.5)
    assert "swapped_position" in ids(log)


def test_exchanged_places_are_said_where_only_headings_tell(written: Written) -> None:
    log = read_log(written(track(1.25, 1.25, swap=True, lat=52.0, lon=10.0)))
    assert log.columns["lat_deg"][0] == pytest.approx(10.0)
    assert "swapped_position_likely" in ids(log)
    assert ids(read_log(written(track(1.25, 1.25, lat=52.0, lon=10.0)))) == set()


def test_places_outside_the_globe_are_emptied(written: Written) -> None:
    log = read_log(written(table("time_s,lat_deg,lon_deg", ["0,34,119", "1,34,400", "2,34,119", "3,91,119"])))
    assert np.isnan(log.columns["lon_deg"]).tolist() == [False, True, False, False]
    assert np.isnan(log.columns["lat_deg"]).tolist() == [False, False, False, True]


@pytest.mark.parametrize(("unit", "factor"), [("km/h", 3.6), ("knots", 1.9438), ("mph", 2.2369)])
def test_speeds_in_other_units_are_found_by_the_places(written: Written, unit: str, factor: float) -> None:
    log = read_log(written(track(1.25, round(1.25 * factor, 3))))
    assert log.columns["speed_mps"] == pytest.approx(1.25, rel=2e-3)
    assert f"is in {unit}" in said(log, "speed_unit")


def test_a_speed_in_km_h_is_found_by_the_other_one(written: Written) -> None:
    """Before, the reader of files had places alone to tell by, and a diagnosis the other speed alone."""
    log = read_log(written(table("time_s,speed_mps,wheel_speed_mps", [f"{k},4.5,1.25" for k in range(60)])))
    assert log.columns["speed_mps"].tolist() == [1.25] * 60 and log.columns["wheel_speed_mps"].tolist() == [1.25] * 60
    assert said(log, "speed_unit") == ("column speed_mps is in km/h (it is 3.60 times wheel_speed_mps): divided")


def test_a_wheel_that_slips_is_not_another_unit(written: Written) -> None:
    assert ids(read_log(written(track(1.25, 1.25 * 1.2)))) == set()


def test_fast_speeds_without_places_are_doubted_and_left(written: Written) -> None:
    log = read_log(written(table("time_s,speed_mps", [f"{k},12.6" for k in range(20)])))
    assert log.columns["speed_mps"][0] == 12.6
    assert said(log, "speed_unit_likely").startswith("column speed_mps looks like km/h (median 12.6)")


def test_well_known_other_names_are_understood(written: Written) -> None:
    log = read_log(written(table("Time,Latitude,Longitude,speed_kmh,Shaft_RPM", ["0,34,119,4.5,70", "1,34,119,9,70"])))
    assert log.columns["speed_mps"].tolist() == [1.25, 2.5]
    assert log.columns["speed_kmh"].tolist() == [4.5, 9.0]
    assert {"lat_deg", "lon_deg", "shaft_rpm", "time_s"} <= set(log.columns)
    assert "column Latitude taken for lat_deg" in [str(f) for f in log.findings]


def test_ndvi_out_of_range(written: Written) -> None:
    log = read_log(written(table("time_s,ndvi_1,ndvi_2", [f"{k},{1.7 if k == 2 else 0.6},{60 + k}" for k in range(9)])))
    assert np.flatnonzero(np.isnan(log.columns["ndvi_1"])).tolist() == [2]
    assert log.columns["ndvi_2"][1] == pytest.approx(0.61)
    assert said(log, "ndvi_percent") == "column ndvi_2 is in percent: divided by 100"
    assert said(log, "outside") == "column ndvi_1: 1 value such as 1.7 emptied: allowed -1 to 1"


def test_implausible_values_are_said_and_left(written: Written) -> None:
    log = read_log(written(table("time_s,supply_v", ["0,13.5", "1,135", "2,13.5"])))
    assert log.columns["supply_v"].tolist() == [13.5, 135, 13.5]
    assert said(log, "implausible") == "column supply_v: 1 value such as 135, allowed 0 to 60: left as read"


def test_missing_columns_say_what_cannot_be_done(written: Written) -> None:
    log = read_log(written(table("time_s,shaft_rpm,hopper_kg", ["0,70,", "1,70,", "2,70,"])))
    missing = [str(finding) for finding in log.findings if finding.id == "missing"]
    assert "no lat_deg and no lon_deg: no map and no place; map and point mode cannot be replayed" in missing
    assert "no shaft_rpm_cmd: the shaft stage cannot be diagnosed" in missing
    assert "no hopper_kg: the flow and scale stages cannot be diagnosed" in missing
    assert not any("no shaft_rpm:" in text for text in missing)
