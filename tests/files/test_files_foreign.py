"""Logs of other programs: a table of bytes, and what becomes of them. What is odd is put right or left, and said."""
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from drivers.files.imports.trouble import TableError
from drivers.files.read_log import read_log

Written = Callable[..., Path]


class Case(NamedTuple):
    """content: of the file. columns: as read, None: not known. ids: of all that is said but what is missing; None: as
    `said`. said: how a sentence begins, by its id. rel: within which the columns hold."""

    content: bytes | str
    columns: dict[str, Any]
    ids: set[str] | None = None
    said: dict[str, str] = {}
    rel: float = 1e-9


def table(header: str, rows: Iterable[object]) -> str:
    return "".join(f"{line}\n" for line in (header, *rows))


def times(*given: object) -> str:
    return table("time_s,hopper_kg", (f"{time_s},{k}" for k, time_s in enumerate(given)))


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


def gap(mark: str = "") -> str:
    moments = [*np.arange(0, 2, 0.1).round(3), *np.arange(5, 7, 0.1).round(3)]
    return table("time_s,hopper_kg,events", (f"{s},100,{mark if k == 20 else ''}" for k, s in enumerate(moments)))


def one_odd(column: str, value: float) -> Case:
    return Case(table(f"time_s,{column}", (f"{k},{value if k == 3 else 0.5}" for k in range(10))),
                {column: [0.5] * 3 + [None] + [0.5] * 6}, None,
                {"sentinel": f"column {column}: 1 value {value:g} emptied: not known"})


READ = {"time_s": [0.0, 1.0], "speed_mps": [1.5, 1.25]}
UTC = [f"{k * 100},2026-03-20T08:00:{k // 10:02d}.{k % 10}00Z" for k in range(50)]
JITTER = (np.arange(200) * 0.05 + np.random.default_rng(1).normal(0, 0.004, 200)).clip(0).round(3)

CASES = {
    # How a text is written.
    "byte order mark": Case(b"\xef\xbb\xbftime_s,speed_mps\n0,1.5\n1,1.25\n", READ, {"byte_order_mark"}),
    "line ends of Windows": Case(b"time_s,speed_mps\r\n0,1.5\r\n1,1.25\r\n", READ, {"crlf"}),
    "carriage returns": Case(b"time_s,speed_mps\r0,1.5\r1,1.25\r", READ, {"carriage_returns"}),
    "semicolons": Case(b"time_s;speed_mps\n0;1.5\n1;1.25\n", READ, {"separator"}),
    "tabs": Case(b"time_s\tspeed_mps\n0\t1.5\n1\t1.25\n", READ, {"separator"}),
    "sep= and decimal commas": Case(b"sep=;\ntime_s;speed_mps\n0;1,5\n1;1,25\n", READ,
                                    {"separator", "decimal_comma", "preamble"}),
    "decimal commas": Case(b"time_s;speed_mps\n0,0;1,5\n1,0;1,25\n", READ, {"separator", "decimal_comma"}),
    "decimal commas in quotes": Case(b'time_s,speed_mps\n"0","1,5"\n"1","1,25"\n', READ, set()),
    "comments": Case(b"# exported\n# twice\ntime_s,speed_mps\n0,1.5\n1,1.25\n", READ, {"preamble"}),
    "blanks about names": Case(b" Time_S , speed_mps \n0, 1.5\n1, 1.25\n", READ, {"other_name"}),
    "a comma at each end": Case(b"time_s,speed_mps,\n0,1.5,\n1,1.25,\n", READ, set()),
    "empty lines": Case(b"time_s,speed_mps\n0,1.5\n\n1,1.25\n\n", READ, set()),
    "no last line end": Case(b"time_s,speed_mps\n0,1.5\n1,1.25", READ, {"no_last_line_end"}),
    "UTF-16": Case("time_s,speed_mps\n0,1.5\n1,1.25\n".encode("utf-16"), READ, {"utf16"}),
    "GB 18030": Case("time_s,speed_mps,note\n0,1.5,地块\n1,1.25,雨\n".encode("gb18030"),
                     READ | {"note": ["地块", "雨"]}, {"encoding"}),
    "a row too long": Case(b"time_s,speed_mps\n0,1.5\n0.5,1.4,7\n1,1.25\n", READ, {"wrong_fields"}),
    "a row too short": Case(b"time_s,speed_mps\n0,1.5\n0.5\n1,1.25\n", READ, {"wrong_fields"}),
    "zero bytes": Case(b"time_s,speed_mps\n0,1.5\n\0\0\0\0001,1.25\n", READ, {"zero_bytes"}),
    "cells that are no numbers": Case("time_s,speed_mps\n0,1.5\n1,fast\n2,NA\n3,err\n4,-\n",
                                      {"speed_mps": [1.5, None, None, None, None]}, None,
                                      {"not_a_number": "column speed_mps: 2 cells such as 'fast' emptied: not a "
                                       "number"}),
    "well-known names": Case("Time,Latitude,Longitude,speed_kmh,Shaft_RPM\n0,34,119,4.5,70\n1,34,119,9,70\n",
                             {"speed_mps": [1.25, 2.5], "speed_kmh": [4.5, 9.0], "lat_deg": [34, 34],
                              "lon_deg": [119, 119], "shaft_rpm": [70, 70], "time_s": [0, 1]},
                             {"other_name", "speed_from_kmh"}, {"other_name": "column Latitude taken for lat_deg"}),
    # Times.
    "repeated and backward": Case(times(0, 1, 2, 2, 3, 2.5, 4, 5), {
        "time_s": [0, 1, 2, 3, 4, 5], "hopper_kg": [0, 1, 2, 4, 6, 7]}, None, {
            "repeated_time": "1 row left out",
            "backward_time": "1 row left out: earlier than a row before, first at 2.500 s"}),
    "newest first": Case(times(3, 2, 1, 0), {"time_s": [0, 1, 2, 3], "hopper_kg": [3, 2, 1, 0]}, None, {
        "row_order": "rows do not stand in order of time (4 of 4): taken in order of time"}),
    # before, every row after it was earlier than a row before, and the log was refused
    "one wrong time": Case(times(0, 1, 2, 86400, 4, 5, 6, 7, 8, 9), {"hopper_kg": [0, 1, 2, 4, 5, 6, 7, 8, 9]}, None, {
        "forward_time": "1 row left out: later than a row after, first at 86400.000 s"}),
    "rows lost here and there": Case(times(*(round(0.1 * k, 1) for k in range(200) if k % 11)), {}, {"skipped_times"}, {
        "skipped_times": "18 gaps in the times, the longest 0.2 s after 16.400 s (sample time 0.1 s): about 18 rows "
        "missing (9.0 %)"}),
    "no time": Case(times(0, "", 2, "x", 4), {"hopper_kg": [0, 2, 4]}, None, {
        "no_time": "2 rows without a time left out"}),
    "a gap": Case(gap(), {"hopper_kg": [100] * 40}, None, {
        "skipped_times": "1 gap in the times, the longest 3.1 s after 1.900 s (sample time 0.1 s): about 30 rows "
        "missing (42.9 %)"}),
    "another file": Case(gap("mark file b.csv"), {}, {"joined"}, {
        "joined": "2 files in one log, 3.1 s from one to the next: no rows are missing there"}),
    "another time log": Case(gap("fault valve;mark log TLG002"), {}, {"joined"}, {"joined": "2 files in one log, 3.1"}),
    "mixed steps": Case(times(*np.cumsum([0.05, 0.2] * 20).round(3)), {}, None, {"mixed_steps": ""}),
    "even": Case(times(*JITTER), {}, set()),
    "epoch": Case(times(1_700_000_000, 1_700_000_000.5, 1_700_000_001), {"time_s": [0, 0.5, 1]}, {"epoch"}),
    "milliseconds": Case(times(1_700_000_000_000, 1_700_000_000_500, 1_700_000_001_000), {"time_s": [0, 0.5, 1]},
                         {"milliseconds"}),
    "milliseconds by utc": Case(table("time_s,utc", UTC), {"time_s": [0.1 * k for k in range(50)]}, {"milliseconds"}),
    "whole seconds": Case(times(*(k // 10 for k in range(100))), {"time_s": [0.1 * k for k in range(100)]}, None, {
        "coarse_times": "about 10 rows share each time: spread evenly over 1 s"}),
    "utc alone": Case("utc,speed_mps\n2026-03-20T08:00:00.000Z,1\n2026-03-20T08:00:00.500Z,1\n",
                      {"time_s": [0, 0.5]}, None, {"time_from_utc": ""}),
    # Values.
    **{f"{column} {value:g}": one_odd(column, value) for column, value in (
        ("speed_mps", -999), ("ndvi", 9999), ("hopper_kg", -9999), ("shaft_rpm", 32767), ("heading_deg", 999.9),
        ("hopper_kg", 9999))},
    "a longitude of -99 in Mexico": Case(b"time_s,lat_deg,lon_deg\n0,19.4,-99\n1,19.4,0\n2,19.4,-99\n",
                                         {"lon_deg": [-99, 0, -99]}, set()),
    "a longitude of -99 in China": Case(b"time_s,lat_deg,lon_deg\n0,34.28,119.88\n1,-99,-99\n2,34.28,119.88\n",
                                        {"lat_deg": [34.28, None, 34.28], "lon_deg": [119.88, None, 119.88]}),
    "honest values": Case(table("time_s,hopper_kg", (f"{k},{995 + k}" for k in range(10))),
                          {"hopper_kg": [995 + k for k in range(10)]}, set()),
    "place 0 0": Case(table("time_s,lat_deg,lon_deg", ["0,0,0", "1,34.1,119.5", "2,0.0,0.0", "3,34.1,119.5"]),
                      {"lat_deg": [None, 34.1, None, 34.1]}, None, {
                          "zero_position": "2 rows with latitude and longitude 0"}),
    "places exchanged": Case(track(1.25, 1.25, swap=True), {"lat_deg": [34.0, ...], "lon_deg": [119.5, ...]}, None, {
        "swapped_position": ""}),
    "places that headings say are exchanged": Case(track(1.25, 1.25, swap=True, lat=52.0, lon=10.0),
                                                   {"lat_deg": [10.0, ...]}, None, {"swapped_position_likely": ""}),
    "places as they are": Case(track(1.25, 1.25, lat=52.0, lon=10.0), {}, set()),
    "places off the globe": Case(table("time_s,lat_deg,lon_deg", ["0,34,119", "1,34,400", "2,34,119", "3,91,119"]),
                                 {"lon_deg": [119, None, 119, 119], "lat_deg": [34, 34, 34, None]}),
    **{f"speed in {unit}": Case(track(1.25, round(1.25 * factor, 3)), {"speed_mps": [1.25] * 100}, None, {
        "speed_unit": f"column speed_mps is in {unit}"}, 2e-3)
       for unit, factor in (("km/h", 3.6), ("knots", 1.9438), ("mph", 2.2369))},
    # before, the reader of files had places alone to tell by, and a diagnosis the other speed alone
    "a speed by the other one": Case(table("time_s,speed_mps,wheel_speed_mps", (f"{k},4.5,1.25" for k in range(60))), {
        "speed_mps": [1.25] * 60, "wheel_speed_mps": [1.25] * 60}, None, {
            "speed_unit": "column speed_mps is in km/h (it is 3.60 times wheel_speed_mps): divided"}),
    "a wheel that slips": Case(track(1.25, 1.25 * 1.2), {}, set()),
    "fast without places": Case(table("time_s,speed_mps", (f"{k},12.6" for k in range(20))), {"speed_mps": [12.6, ...]},
                                None, {"speed_unit_likely": "column speed_mps looks like km/h (median 12.6)"}),
    "NDVI": Case(table("time_s,ndvi_1,ndvi_2", (f"{k},{1.7 if k == 2 else 0.6},{60 + k}" for k in range(9))), {
        "ndvi_1": [0.6, 0.6, None, *[0.6] * 6], "ndvi_2": [0.60, 0.61, ...]}, None, {
            "ndvi_percent": "column ndvi_2 is in percent: divided by 100",
            "outside": "column ndvi_1: 1 value such as 1.7 emptied: allowed -1 to 1"}),
    "implausible": Case(table("time_s,supply_v", ["0,13.5", "1,135", "2,13.5"]), {
        "supply_v": [13.5, 135, 13.5]}, None, {
            "implausible": "column supply_v: 1 value such as 135, allowed 0 to 60: left as read"}),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_odd_is_put_right_or_left_and_said(written: Written, name: str) -> None:
    case = CASES[name]
    log = read_log(written(case.content))
    for column, expected in case.columns.items():
        found = [value if isinstance(value, str) else None if np.isnan(value) else value
                 for value in log.columns[column].tolist()]
        if expected[-1] is ...:
            expected, found = expected[:-1], found[:len(expected) - 1]
        assert found == (expected if isinstance(expected[0], str) else pytest.approx(expected, rel=case.rel))
    said = [(one.id, str(one)) for one in log.findings if one.id != "missing"]
    if case.ids is not None:
        assert {id for id, _ in said} == case.ids
    for id, begin in case.said.items():
        assert any(one == id and text.startswith(begin) for one, text in said), said


def test_missing_columns_say_what_cannot_be_done(written: Written) -> None:
    log = read_log(written(table("time_s,shaft_rpm,hopper_kg", ["0,70,", "1,70,", "2,70,"])))
    missing = [str(finding) for finding in log.findings if finding.id == "missing"]
    assert "no lat_deg and no lon_deg: no map and no place; map and point mode cannot be replayed" in missing
    assert "no shaft_rpm_cmd: the shaft stage cannot be diagnosed" in missing
    assert "no hopper_kg: the flow and scale stages cannot be diagnosed" in missing
    assert not any("no shaft_rpm:" in text for text in missing)


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
