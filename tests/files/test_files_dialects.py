"""Logs and bench tables as people have them: other letters, units, titles, dates, sheets; half
a file is refused."""

from __future__ import annotations

import csv
import datetime as dt
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import openpyxl
import polars as pl
import pytest
from topdress.control.log_row import COLUMNS, LogRow
from topdress.drivers.files.any_log import open_any_log
from topdress.drivers.files.bench_table import read_bench_table
from topdress.drivers.files.file_content import FileContent
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.log_store import is_log_store, write_log_store
from topdress.drivers.files.read_log import RunLog, read_log, read_log_meta, read_nonempty_log
from topdress.drivers.files.run_log import write_whole_log
from topdress.drivers.files.run_meta import make_run_meta

from tests.command import topdress

T = np.arange(50) * 0.1
SHAFT = 40.0 + np.sin(T)
BEGIN = dt.datetime(2026, 3, 17, 6, 30, tzinfo=dt.UTC)
MOMENTS = [BEGIN + dt.timedelta(seconds=float(s)) for s in T]
EPOCH = dt.datetime(1899, 12, 30, tzinfo=dt.UTC)
LAGS = [
    (rpm, 0.9 - 0.008 * rpm + more)
    for rpm in (10.0, 30.0, 50.0, 70.0)
    for more in (0.0, 0.01, -0.01)
]
Write = Callable[..., Path]


def write_text(
    path: Path,
    names: Sequence[str],
    rows: Sequence[Sequence[Any]],
    titles: Sequence[str] = (),
    units: Sequence[str] = (),
    delimiter: str = ",",
) -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"{title}\n" for title in titles)
        writer = csv.writer(file, delimiter=delimiter, lineterminator="\n")
        writer.writerow(names)
        if units:
            writer.writerow(units)
        writer.writerows(
            [
                [cell.isoformat() if isinstance(cell, dt.datetime) else cell for cell in row]
                for row in rows
            ]
        )
    return path


def write_sheet(
    path: Path,
    names: Sequence[str],
    rows: Sequence[Sequence[Any]],
    titles: Sequence[str] = (),
    units: Sequence[str] = (),
    delimiter: str = "",
) -> Path:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for row in [*([title] for title in titles), names, *([units] if units else []), *rows]:
        sheet.append(
            [cell.replace(tzinfo=None) if isinstance(cell, dt.datetime) else cell for cell in row]
        )
    path = path.with_suffix(".xlsx")
    book.save(path)
    return path


@pytest.fixture(params=[write_text, write_sheet], ids=["csv", "xlsx"])
def write(request: pytest.FixtureRequest, tmp_path: Path) -> Write:
    return lambda *words, **more: request.param(tmp_path / "file.csv", *words, **more)


def logged(times: Sequence[Any]) -> list[tuple[Any, float]]:
    return list(zip(times, SHAFT.round(3).tolist(), strict=True))


TIMES: list[tuple[str, Sequence[Any]]] = [
    ("time_s", T.round(3).tolist()),
    ("Time_S", T.round(3).tolist()),
    ("TIME [s]", T.round(3).tolist()),
    ("Time (ms)", (1000 * T).round().tolist()),
    ("timestamp", MOMENTS),
    ("Timestamp", [m.timestamp() for m in MOMENTS]),
    ("time", [(m - EPOCH).total_seconds() / 86_400.0 for m in MOMENTS]),
    ("DateTime", MOMENTS),
    ("utc", MOMENTS),
    ("utc", [(m - EPOCH).total_seconds() / 86_400.0 for m in MOMENTS]),
    ("utc", [m.astimezone(dt.timezone(dt.timedelta(hours=8))).isoformat() for m in MOMENTS]),
    ("time_utc", [m.isoformat().replace("+00:00", "Z") for m in MOMENTS]),
]


@pytest.mark.parametrize(
    ("name", "times"), TIMES, ids=lambda value: value if isinstance(value, str) else ""
)
@pytest.mark.parametrize("titles", [(), ("Log of 17 March", "Field: north")], ids=["", "titles"])
def test_times_of_any_kind_come_out_as_seconds(
    write: Write, name: str, times: Sequence[Any], titles: Sequence[str]
) -> None:
    path = write([name, "Shaft_RPM"], logged(times), titles=titles)
    log = read_log(path)
    assert log.time_s - log.time_s[0] == pytest.approx(T, abs=2e-3)
    assert log.numbers("shaft_rpm") == pytest.approx(SHAFT, abs=1e-3)


@pytest.mark.parametrize(
    "begin", [BEGIN, dt.datetime(1970, 1, 1, 0, 20, tzinfo=dt.UTC)], ids=["", "clock not set"]
)
def test_dates_count_from_the_first_row_and_are_said_once(write: Write, begin: dt.datetime) -> None:
    log = read_log(
        write(["time_s", "shaft_rpm"], logged([begin + (one - BEGIN) for one in MOMENTS]))
    )
    assert log.time_s == pytest.approx(T, abs=2e-3)
    assert [finding.id for finding in log.findings if finding.column == "time_s"] == ["dates"]


@pytest.mark.parametrize(
    ("name", "column", "factor"),
    [
        ("SHAFT_RPM", "shaft_rpm", 1.0),
        ("shaft_rpm [r/min]", "shaft_rpm", 1.0),
        ("shaft_rpm (rpm)", "shaft_rpm", 1.0),
        ("Shaft [r/min]", "shaft_rpm", 1.0),
        ("shaft_rpm [r/s]", "shaft_rpm", 60.0),
        ("Speed [km/h]", "speed_mps", 1 / 3.6),
        ("Speed [mph]", "speed_mps", 0.44704),
        ("Opening_MM [cm]", "opening_mm", 10.0),
        ("hopper [t]", "hopper_kg", 1000.0),
        ("Supply_V [mV]", "supply_v", 0.001),
    ],
)
def test_a_unit_in_the_header_holds(write: Write, name: str, column: str, factor: float) -> None:
    values = [2.0 + 0.01 * k for k in range(50)]
    log = read_log(write(["time_s", name], list(zip(T.round(3).tolist(), values, strict=True))))
    assert log.numbers(column) == pytest.approx(factor * np.array(values), rel=1e-9)


def test_a_unit_that_cannot_be_the_columns_is_refused(write: Write) -> None:
    path = write(["time_s", "shaft_rpm [kg]"], logged(T.tolist()))
    with pytest.raises(TableError, match=r"column shaft_rpm \[kg\]: unit kg: allowed r/min"):
        read_log(path)


def test_a_row_of_units_is_passed_over(write: Write) -> None:
    log = read_log(
        write(["time_s", "shaft_rpm"], logged(T.round(3).tolist()), units=["s", "r/min"])
    )
    assert len(log) == 50 and "unit_row" in [finding.id for finding in log.findings]


def test_a_comma_of_the_times_is_read(tmp_path: Path) -> None:
    rows = [
        (f"{s:.1f}".replace(".", ","), f"{x:.3f}".replace(".", ","))
        for s, x in zip(T, SHAFT, strict=True)
    ]
    log = read_log(write_text(tmp_path / "a.csv", ["Time", "extra"], rows, delimiter=";"))
    assert log.time_s == pytest.approx(T) and log.numbers("extra") == pytest.approx(SHAFT, abs=1e-3)


@pytest.mark.parametrize(
    ("names", "titles", "units"),
    [
        (["shaft_rpm", "lag_s"], (), ()),
        (["Shaft_RPM", "LAG_S"], (), ()),
        (["shaft [r/min]", "lag [s]"], (), ()),
        (["shaft_rpm (r/min)", "Lag_s (s)"], (), ()),
        (["shaft_rpm", "lag_s"], ("Lag test, 17 March",), ()),
        (["shaft_rpm", "lag_s"], (), ["r/min", "s"]),
    ],
)
def test_bench_tables_alike(
    write: Write, names: list[str], titles: Sequence[str], units: Sequence[str]
) -> None:
    table = read_bench_table(write(names, LAGS, titles=titles, units=units))
    assert table.kind == "lag"
    assert table.columns["shaft_rpm"].tolist() == [rpm for rpm, _ in LAGS]
    assert table.columns["lag_s"] == pytest.approx([lag for _, lag in LAGS])


def test_milliseconds_of_a_bench_table_are_milliseconds(write: Write) -> None:
    table = read_bench_table(
        write(["shaft_rpm", "lag_s [ms]"], [(rpm, 1000.0 * lag) for rpm, lag in LAGS])
    )
    assert table.columns["lag_s"] == pytest.approx([lag for _, lag in LAGS])


@pytest.mark.parametrize(
    "command",
    [
        ["diagnose", "--machine", "huanghai"],
        ["import", "--out", "out.csv"],
        ["calibrate", "wheel", "--out", "m.yaml"],
        ["replay", "--headless", "--out", "n.csv"],
    ],
    ids=lambda words: words[0],
)
def test_an_unclosed_quote_is_refused_and_not_half_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = write_text(tmp_path / "q.csv", ["time_s", "shaft_rpm"], logged(T.round(3).tolist()))
    lines = path.read_text().splitlines()
    lines[20] = lines[20].replace(",", ',"')
    path.write_text("\n".join(lines) + "\n")
    at = 2 if command[0] == "calibrate" else 1
    told = topdress(*command[:at], path, *command[at:])
    assert told.exit_code == 2
    assert (
        told.output.strip()
        == f"{path}: line 21: a quote is opened and not closed: allowed are pairs of quotes"
    )
    assert sorted(file.name for file in tmp_path.iterdir()) == ["q.csv"]


def test_quotes_that_are_closed_are_no_trouble(tmp_path: Path) -> None:
    path = tmp_path / "q.csv"
    path.write_text('time_s,"Pipe 5""",events\n0,1,"a, b"\n0.1,2,"two\nlines"\n0.2,3,5" pipe\n')
    assert len(read_log(path)) == 3


def test_a_workbook_of_two_tables_is_a_question(tmp_path: Path) -> None:
    path = write_sheet(tmp_path / "a", ["shaft_rpm", "lag_s"], LAGS)
    book = openpyxl.load_workbook(path)
    book.create_sheet("more").append(["x"])
    book.save(path)
    with pytest.raises(
        TableError, match=r"2 sheets hold something \(Sheet, more\): allowed is one"
    ):
        read_bench_table(path)
    path.write_bytes(b"PK\3\4 not a workbook")
    with pytest.raises(TableError, match="not readable as a workbook"):
        read_bench_table(path)


POINT = (
    '{"type": "Feature", "properties": {PROPERTIES}, "geometry": {"type": "Point", '
    '"coordinates": [9, 5CORNER]}}'
)
POINTS = (
    '{"type": "FeatureCollection", "features": ['
    + ", ".join(POINT.replace("CORNER", corner) for corner in ("1", "2"))
    + "]}"
)
# name, text, what it holds, whether the import reads it (None: it has no columns to be asked
# about)
HELD = {
    "ours": ("a.csv", f"{','.join(COLUMNS)}\n", "log", False),
    "time_s": ("a.csv", "time_s,shaft_rpm,lag_s\n", "log", False),
    "dates": ("a.csv", "Timestamp,shaft_rpm_cmd,shaft_rpm\n", "log", False),
    "utc": ("a.csv", "UTC,lat,lon\n", "log", False),
    "a command of another's": ("a.csv", "time_s,commanded_rpm,actual_rpm\n", "log", True),
    "another's words": ("a.csv", "Zeit;Drehzahl Soll;Drehzahl Ist\n1;2;3\n", "log", True),
    "no names": ("a.csv", "0,1,2\n1,2,3\n", "", True),
    "words": ("a.txt", "Dear all,\n", "", True),
    "nothing": ("a.csv", "", "", None),
    "a time of a table": ("a.csv", "timestamp,shaft_rpm,lag_s\n", "table", False),
    "a date of a table": ("a.csv", "shaft_rpm,lag_s,date\n", "table", True),
    "another suffix": ("a.bench", "shaft [r/min];lag [s]\n10;0,5\n", "table", True),
    "polygons": ("a.csv", 'WKT,rate\n"POLYGON ((1 2, 3 4, 1 4, 1 2))",5\n', "map", True),
    "places": ("a.csv", "lat,lon,rate\n1,2,3\n", "map", True),
    "places in time": ("a.csv", "t;lat;lon;rate\n", "log", False),
    "points": ("a.geojson", POINTS.replace("PROPERTIES", '"rate": 1'), "map", True),
    "points in time": ("a.json", POINTS.replace("PROPERTIES", '"rate": 1, "time": 3'), "log", True),
    "areas": ("a.geojson", POINTS.replace("Point", "Polygon"), "map", True),
    "no JSON": ("a.json", "{", "map", True),
    "a package": ("a.gpkg", "SQLite format 3", "map", True),
    "another's Parquet": ("a.pq", "PAR1", "log", True),
}


@pytest.mark.parametrize("case", HELD)
def test_what_a_file_holds_is_asked_in_one_place(written: Write, tmp_path: Path, case: str) -> None:
    name, text, holds, foreign = HELD[case]
    file = FileContent(written(text, name))
    assert file.content_kind == holds
    if foreign is None:
        with pytest.raises(TableError, match="the file is empty"):
            assert file.foreign
    else:
        assert file.foreign is foreign


def test_stores_and_folders_are_asked_there_too(tmp_path: Path) -> None:
    write_log_store(tmp_path / "a.parquet", {"time_s": T}, None)
    assert (
        FileContent(tmp_path / "a.parquet").content_kind == "log"
        and not FileContent(tmp_path / "a.parquet").foreign
    )
    assert FileContent(tmp_path).content_kind == "map" and FileContent(tmp_path).foreign
    (tmp_path / "Field.txt").write_text("x")
    assert FileContent(tmp_path).content_kind == "field"


# --- Run logs as Parquet: read back equal, whole or refused in one line, and taken by every
# command that reads a log.


def same(one: RunLog, other: RunLog) -> None:
    assert list(one.columns) == list(other.columns)
    for name, array in one.columns.items():
        assert array.dtype == other.columns[name].dtype
        if array.dtype == object:
            assert array.tolist() == other.columns[name].tolist(), name
        else:
            np.testing.assert_array_equal(array, other.columns[name], err_msg=name)
    assert one.meta == other.meta
    assert one.findings == other.findings


@pytest.fixture
def text_log(tmp_path: Path) -> Path:
    rows = [
        LogRow(
            round(0.05 * k, 3),
            shaft_rpm_cmd=0.1 + k / 3.0,
            hopper_kg=None if k % 3 else 250.5,
            shaft_rpm=30.123,
            state="working",
            work_switch=k % 2,
            events="refill 20; a, b" if k == 7 else None,
        )
        for k in range(40)
    ]
    path = write_whole_log(
        tmp_path / "run.csv", make_run_meta(seed=3, extra={"note": "ß 播"}), rows
    )
    with path.open("a", encoding="utf-8") as file:
        file.write("2.0,cut")  # power loss: the finding must be kept
    return path


def test_a_log_is_read_back_equal_from_its_store(text_log: Path, tmp_path: Path) -> None:
    log = read_log(text_log)
    place = tmp_path / "store" / "run.parquet"
    write_log_store(place, log.columns, log.meta, log.findings)
    assert log.findings
    same(read_log(place), log)
    assert read_log_meta(place) == log.meta
    assert is_log_store(place) and not FileContent(place).foreign
    same(open_any_log(place), log)
    # not NaN: others must see it too
    assert pl.read_parquet(place)["hopper_kg"].null_count() == 26


def test_only_some_columns(text_log: Path, tmp_path: Path) -> None:
    log = read_log(text_log)
    write_log_store(tmp_path / "run.parquet", log.columns, log.meta)
    assert list(read_log(tmp_path / "run.parquet", only=["state"]).columns) == ["time_s", "state"]


def test_the_command_makes_it_and_takes_it_back(text_log: Path, tmp_path: Path) -> None:
    store, again = tmp_path / "kept.parquet", tmp_path / "again.csv"
    told = topdress("import", text_log, "--out", store)
    assert told.exit_code == 0 and "40 rows" in told.output, told.output
    same(read_nonempty_log(store), read_nonempty_log(text_log))
    assert topdress("import", store, "--out", again).exit_code == 0
    whole, back = read_nonempty_log(text_log), read_nonempty_log(again)
    same(replace(back, findings=()), replace(whole, findings=()))
    twice = topdress("import", text_log, "--out", store)
    assert twice.exit_code != 0 and "exists already" in twice.output
    wrong = topdress("import", text_log, "--out", tmp_path / "kept.json")
    assert wrong.exit_code != 0


def test_a_foreign_log_becomes_a_store_at_once(tmp_path: Path) -> None:
    source = Path(__file__).parents[2] / "docs/examples/import/tractor.csv"
    for name in ("log.csv", "log.parquet", "log.parquet"):  # made anew of the same file
        told = topdress("import", source, "--out", tmp_path / name)
        assert told.exit_code == 0, told.output
    same(read_log(tmp_path / "log.parquet"), read_log(tmp_path / "log.csv"))


@pytest.mark.parametrize("spoil", ["cut", "version", "times"])
def test_a_spoilt_store_is_refused_in_one_line(text_log: Path, tmp_path: Path, spoil: str) -> None:
    log = read_log(text_log)
    place = tmp_path / "run.parquet"
    columns = dict(log.columns)
    if spoil == "times":
        columns["time_s"] = columns["time_s"][::-1].copy()
    write_log_store(place, columns, log.meta)
    data = place.read_bytes()
    if spoil == "cut":  # the footer stands, a column is torn
        place.write_bytes(data[:4] + b"\0" * 400 + data[404:])
    if spoil == "version":
        place.write_bytes(data.replace(b"topdress-log-store/1", b"topdress-log-store/9"))
    with pytest.raises(TableError) as refused:
        read_log(place)
    assert str(place) in str(refused.value) and "\n" not in str(refused.value)


def test_parquet_of_another_program_is_foreign(tmp_path: Path) -> None:
    pl.DataFrame({"time_s": [0.0, 1.0], "speed": [1.0, 1.1]}).write_parquet(
        tmp_path / "other.parquet"
    )
    assert (
        not is_log_store(tmp_path / "other.parquet")
        and FileContent(tmp_path / "other.parquet").foreign
    )


def test_a_log_of_ours_comes_back_from_its_store_to_the_byte(tmp_path: Path) -> None:
    rows = [
        LogRow(
            round(0.0503 * k, 4),
            utc="2026-11-23T07:12:00.000Z",
            lat_deg=34.1 + k * 1e-7,
            satellites=14,
            fix_quality=4,
            hdop=0.8,
            heading_deg=k % 360 + 0.5,
            shaft_rpm_cmd=k / 3.0,
            nudge_percent=5.0,
            hopper_kg=None if k % 3 else 250.5,
            shaft_rpm=-0.0,
            ndvi=0.5,
            flow_trim=1e-7 if k == 3 else 1.0,
            state="working",
            work_switch=k % 2,
            events='refill 20; "a", b' if k == 7 else None,
        )
        for k in range(60)
    ] + [LogRow(3.1), LogRow(3.1001)]
    first = write_whole_log(
        tmp_path / "run.csv", make_run_meta(seed=3, extra={"note": "ß 播"}), rows
    )
    for source, out in (
        (first, tmp_path / "run.parquet"),
        (tmp_path / "run.parquet", tmp_path / "back" / "run.csv"),
    ):
        result = topdress("import", source, "--out", out)
        assert result.exit_code == 0, result.output
    assert (tmp_path / "back" / "run.csv").read_bytes() == first.read_bytes()
    assert (tmp_path / "back" / "run.yaml").read_bytes() == first.with_suffix(".yaml").read_bytes()


def test_of_another_program_s_text_every_number_comes_back_the_same(tmp_path: Path) -> None:
    first = tmp_path / "run.csv"
    first.write_text(
        "time_s,hopper_kg,load\r\n"
        + "".join(f"{k / 7:.12f},{100 - k / 3:.17g},{k / 10:.3f}\r\n" for k in range(50)),
        encoding="utf-8",
    )
    for source, out in (
        (first, tmp_path / "run.parquet"),
        (tmp_path / "run.parquet", tmp_path / "back" / "run.csv"),
    ):
        assert topdress("import", source, "--out", out).exit_code == 0
    log, back = read_nonempty_log(first), read_nonempty_log(tmp_path / "back" / "run.csv")
    for name in ("time_s", "hopper_kg", "load"):
        np.testing.assert_array_equal(log.columns[name], back.columns[name])


# --- Logs of other programs: a table of bytes, and what becomes of them. What is odd is put
# right or left, and said.

Written = Callable[..., Path]


class Case(NamedTuple):
    """content: of the file. columns: as read, None: not known. ids: of all that is said but
    what is missing; None: as `said`. said: how a sentence begins, by its id. rel: within which
    the columns hold."""

    content: bytes | str
    columns: dict[str, Any]
    ids: set[str] | None = None
    said: dict[str, str] = {}
    rel: float = 1e-9


def table(header: str, rows: Iterable[object]) -> str:
    return "".join(f"{line}\n" for line in (header, *rows))


def at_s(*given: object) -> str:
    return table("time_s,hopper_kg", (f"{time_s},{k}" for k, time_s in enumerate(given)))


def track(
    speed: float,
    written_speed: float,
    rows: int = 100,
    swap: bool = False,
    lat: float = 34.0,
    lon: float = 119.5,
) -> str:
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
    return table(
        "time_s,hopper_kg,events",
        (f"{s},100,{mark if k == 20 else ''}" for k, s in enumerate(moments)),
    )


def one_odd(column: str, value: float) -> Case:
    return Case(
        table(f"time_s,{column}", (f"{k},{value if k == 3 else 0.5}" for k in range(10))),
        {column: [0.5] * 3 + [None] + [0.5] * 6},
        None,
        {"sentinel": f"column {column}: 1 value {value:g} emptied: not known"},
    )


READ = {"time_s": [0.0, 1.0], "speed_mps": [1.5, 1.25]}
UTC = [f"{k * 100},2026-03-20T08:00:{k // 10:02d}.{k % 10}00Z" for k in range(50)]
JITTER = (np.arange(200) * 0.05 + np.random.default_rng(1).normal(0, 0.004, 200)).clip(0).round(3)

CASES = {
    # How a text is written.
    "byte order mark": Case(
        b"\xef\xbb\xbftime_s,speed_mps\n0,1.5\n1,1.25\n", READ, {"byte_order_mark"}
    ),
    "line ends of Windows": Case(b"time_s,speed_mps\r\n0,1.5\r\n1,1.25\r\n", READ, {"crlf"}),
    "carriage returns": Case(b"time_s,speed_mps\r0,1.5\r1,1.25\r", READ, {"carriage_returns"}),
    "semicolons": Case(b"time_s;speed_mps\n0;1.5\n1;1.25\n", READ, {"separator"}),
    "tabs": Case(b"time_s\tspeed_mps\n0\t1.5\n1\t1.25\n", READ, {"separator"}),
    "sep= and decimal commas": Case(
        b"sep=;\ntime_s;speed_mps\n0;1,5\n1;1,25\n",
        READ,
        {"separator", "decimal_comma", "preamble"},
    ),
    "decimal commas": Case(
        b"time_s;speed_mps\n0,0;1,5\n1,0;1,25\n", READ, {"separator", "decimal_comma"}
    ),
    "decimal commas in quotes": Case(b'time_s,speed_mps\n"0","1,5"\n"1","1,25"\n', READ, set()),
    "comments": Case(b"# exported\n# twice\ntime_s,speed_mps\n0,1.5\n1,1.25\n", READ, {"preamble"}),
    "blanks about names": Case(b" Time_S , speed_mps \n0, 1.5\n1, 1.25\n", READ, {"other_name"}),
    "a comma at each end": Case(b"time_s,speed_mps,\n0,1.5,\n1,1.25,\n", READ, set()),
    "empty lines": Case(b"time_s,speed_mps\n0,1.5\n\n1,1.25\n\n", READ, set()),
    "no last line end": Case(b"time_s,speed_mps\n0,1.5\n1,1.25", READ, {"no_last_line_end"}),
    "UTF-16": Case("time_s,speed_mps\n0,1.5\n1,1.25\n".encode("utf-16"), READ, {"utf16"}),
    "GB 18030": Case(
        "time_s,speed_mps,note\n0,1.5,地块\n1,1.25,雨\n".encode("gb18030"),
        READ | {"note": ["地块", "雨"]},
        {"encoding"},
    ),
    "a row too long": Case(b"time_s,speed_mps\n0,1.5\n0.5,1.4,7\n1,1.25\n", READ, {"wrong_fields"}),
    "a row too short": Case(b"time_s,speed_mps\n0,1.5\n0.5\n1,1.25\n", READ, {"wrong_fields"}),
    "zero bytes": Case(b"time_s,speed_mps\n0,1.5\n\0\0\0\0001,1.25\n", READ, {"zero_bytes"}),
    "cells that are no numbers": Case(
        "time_s,speed_mps\n0,1.5\n1,fast\n2,NA\n3,err\n4,-\n",
        {"speed_mps": [1.5, None, None, None, None]},
        None,
        {"not_a_number": "column speed_mps: 2 cells such as 'fast' emptied: not a number"},
    ),
    "well-known names": Case(
        "Time,Latitude,Longitude,speed_kmh,Shaft_RPM\n0,34,119,4.5,70\n1,34,119,9,70\n",
        {
            "speed_mps": [1.25, 2.5],
            "speed_kmh": [4.5, 9.0],
            "lat_deg": [34, 34],
            "lon_deg": [119, 119],
            "shaft_rpm": [70, 70],
            "time_s": [0, 1],
        },
        {"other_name", "speed_from_kmh"},
        {"other_name": "column Latitude taken for lat_deg"},
    ),
    # Times.
    "repeated and backward": Case(
        at_s(0, 1, 2, 2, 3, 2.5, 4, 5),
        {"time_s": [0, 1, 2, 3, 4, 5], "hopper_kg": [0, 1, 2, 4, 6, 7]},
        None,
        {
            "repeated_time": "1 row left out",
            "backward_time": "1 row left out: earlier than a row before, first at 2.500 s",
        },
    ),
    "newest first": Case(
        at_s(3, 2, 1, 0),
        {"time_s": [0, 1, 2, 3], "hopper_kg": [3, 2, 1, 0]},
        None,
        {"row_order": "rows do not stand in order of time (4 of 4): taken in order of time"},
    ),
    # before, every row after it was earlier than a row before, and the log was refused
    "one wrong time": Case(
        at_s(0, 1, 2, 86400, 4, 5, 6, 7, 8, 9),
        {"hopper_kg": [0, 1, 2, 4, 5, 6, 7, 8, 9]},
        None,
        {"forward_time": "1 row left out: later than a row after, first at 86400.000 s"},
    ),
    "rows lost here and there": Case(
        at_s(*(round(0.1 * k, 1) for k in range(200) if k % 11)),
        {},
        {"skipped_times"},
        {
            "skipped_times": "18 gaps in the times, the longest 0.2 s after 16.400 s "
            "(sample time 0.1 s): about 18 rows "
            "missing (9.0 %)"
        },
    ),
    "no time": Case(
        at_s(0, "", 2, "x", 4),
        {"hopper_kg": [0, 2, 4]},
        None,
        {"no_time": "2 rows without a time left out"},
    ),
    "a gap": Case(
        gap(),
        {"hopper_kg": [100] * 40},
        None,
        {
            "skipped_times": "1 gap in the times, the longest 3.1 s after 1.900 s "
            "(sample time 0.1 s): about 30 rows "
            "missing (42.9 %)"
        },
    ),
    "another file": Case(
        gap("mark file b.csv"),
        {},
        {"joined"},
        {"joined": "2 files in one log, 3.1 s from one to the next: no rows are missing there"},
    ),
    "another time log": Case(
        gap("fault valve;mark log TLG002"), {}, {"joined"}, {"joined": "2 files in one log, 3.1"}
    ),
    "mixed steps": Case(at_s(*np.cumsum([0.05, 0.2] * 20).round(3)), {}, None, {"mixed_steps": ""}),
    "even": Case(at_s(*JITTER), {}, set()),
    "epoch": Case(
        at_s(1_700_000_000, 1_700_000_000.5, 1_700_000_001), {"time_s": [0, 0.5, 1]}, {"epoch"}
    ),
    "milliseconds": Case(
        at_s(1_700_000_000_000, 1_700_000_000_500, 1_700_000_001_000),
        {"time_s": [0, 0.5, 1]},
        {"milliseconds"},
    ),
    "milliseconds by utc": Case(
        table("time_s,utc", UTC), {"time_s": [0.1 * k for k in range(50)]}, {"milliseconds"}
    ),
    "whole seconds": Case(
        at_s(*(k // 10 for k in range(100))),
        {"time_s": [0.1 * k for k in range(100)]},
        None,
        {"coarse_times": "about 10 rows share each time: spread evenly over 1 s"},
    ),
    "utc alone": Case(
        "utc,speed_mps\n2026-03-20T08:00:00.000Z,1\n2026-03-20T08:00:00.500Z,1\n",
        {"time_s": [0, 0.5]},
        None,
        {"time_from_utc": ""},
    ),
    # Values.
    **{
        f"{column} {value:g}": one_odd(column, value)
        for column, value in (
            ("speed_mps", -999),
            ("ndvi", 9999),
            ("hopper_kg", -9999),
            ("shaft_rpm", 32767),
            ("heading_deg", 999.9),
            ("hopper_kg", 9999),
        )
    },
    "a longitude of -99 in Mexico": Case(
        b"time_s,lat_deg,lon_deg\n0,19.4,-99\n1,19.4,0\n2,19.4,-99\n",
        {"lon_deg": [-99, 0, -99]},
        set(),
    ),
    "a longitude of -99 in China": Case(
        b"time_s,lat_deg,lon_deg\n0,34.28,119.88\n1,-99,-99\n2,34.28,119.88\n",
        {"lat_deg": [34.28, None, 34.28], "lon_deg": [119.88, None, 119.88]},
    ),
    "honest values": Case(
        table("time_s,hopper_kg", (f"{k},{995 + k}" for k in range(10))),
        {"hopper_kg": [995 + k for k in range(10)]},
        set(),
    ),
    "place 0 0": Case(
        table("time_s,lat_deg,lon_deg", ["0,0,0", "1,34.1,119.5", "2,0.0,0.0", "3,34.1,119.5"]),
        {"lat_deg": [None, 34.1, None, 34.1]},
        None,
        {"zero_position": "2 rows with latitude and longitude 0"},
    ),
    "places exchanged": Case(
        track(1.25, 1.25, swap=True),
        {"lat_deg": [34.0, ...], "lon_deg": [119.5, ...]},
        None,
        {"swapped_position": ""},
    ),
    "places that headings say are exchanged": Case(
        track(1.25, 1.25, swap=True, lat=52.0, lon=10.0),
        {"lat_deg": [10.0, ...]},
        None,
        {"swapped_position_likely": ""},
    ),
    "places as they are": Case(track(1.25, 1.25, lat=52.0, lon=10.0), {}, set()),
    "places off the globe": Case(
        table("time_s,lat_deg,lon_deg", ["0,34,119", "1,34,400", "2,34,119", "3,91,119"]),
        {"lon_deg": [119, None, 119, 119], "lat_deg": [34, 34, 34, None]},
    ),
    **{
        f"speed in {unit}": Case(
            track(1.25, round(1.25 * factor, 3)),
            {"speed_mps": [1.25] * 100},
            None,
            {"speed_unit": f"column speed_mps is in {unit}"},
            2e-3,
        )
        for unit, factor in (("km/h", 3.6), ("knots", 1.9438), ("mph", 2.2369))
    },
    # before, the reader of files had places alone to tell by, and a diagnosis the other speed alone
    "a speed by the other one": Case(
        table("time_s,speed_mps,wheel_speed_mps", (f"{k},4.5,1.25" for k in range(60))),
        {"speed_mps": [1.25] * 60, "wheel_speed_mps": [1.25] * 60},
        None,
        {"speed_unit": "column speed_mps is in km/h (it is 3.60 times wheel_speed_mps): divided"},
    ),
    "a wheel that slips": Case(track(1.25, 1.25 * 1.2), {}, set()),
    "fast without places": Case(
        table("time_s,speed_mps", (f"{k},12.6" for k in range(20))),
        {"speed_mps": [12.6, ...]},
        None,
        {"speed_unit_likely": "column speed_mps looks like km/h (median 12.6)"},
    ),
    "NDVI": Case(
        table("time_s,ndvi_1,ndvi_2", (f"{k},{1.7 if k == 2 else 0.6},{60 + k}" for k in range(9))),
        {"ndvi_1": [0.6, 0.6, None, *[0.6] * 6], "ndvi_2": [0.60, 0.61, ...]},
        None,
        {
            "ndvi_percent": "column ndvi_2 is in percent: divided by 100",
            "outside": "column ndvi_1: 1 value such as 1.7 emptied: allowed -1 to 1",
        },
    ),
    "implausible": Case(
        table("time_s,supply_v", ["0,13.5", "1,135", "2,13.5"]),
        {"supply_v": [13.5, 135, 13.5]},
        None,
        {"implausible": "column supply_v: 1 value such as 135, allowed 0 to 60: left as read"},
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_odd_is_put_right_or_left_and_said(written: Written, name: str) -> None:
    case = CASES[name]
    log = read_log(written(case.content))
    for column, expected in case.columns.items():
        found = [
            value if isinstance(value, str) else None if np.isnan(value) else value
            for value in log.columns[column].tolist()
        ]
        if expected[-1] is ...:
            expected, found = expected[:-1], found[: len(expected) - 1]
        assert found == (
            expected if isinstance(expected[0], str) else pytest.approx(expected, rel=case.rel)
        )
    said = [(one.id, str(one)) for one in log.findings if one.id != "missing"]
    if case.ids is not None:
        assert {id for id, _ in said} == case.ids
    for id, begin in case.said.items():
        assert any(one == id and text.startswith(begin) for one, text in said), said


def test_missing_columns_say_what_cannot_be_done(written: Written) -> None:
    log = read_log(written(table("time_s,shaft_rpm,hopper_kg", ["0,70,", "1,70,", "2,70,"])))
    missing = [str(finding) for finding in log.findings if finding.id == "missing"]
    assert (
        "no lat_deg and no lon_deg: no map and no place; map and point mode cannot be replayed"
        in missing
    )
    assert "no shaft_rpm_cmd: the shaft stage cannot be diagnosed" in missing
    assert "no hopper_kg: the flow and scale stages cannot be diagnosed" in missing
    assert not any("no shaft_rpm:" in text for text in missing)


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", "the file is empty"),
        (b"\n\n  \n", "the file is empty"),
        (b"# only\n# comments\n", "holds comments only"),
        (b"0.0,1.5,2\n0.1,1.4,2\n", "no header row: the first line is 0.0,1.5,2"),
        (
            b"time_s,speed_mps,speed_mps\n0,1,2\n",
            "column speed_mps stands 2 times in the header: allowed once",
        ),
        (b"time_s,speed_mps\n0,0,1,5\n1,0,1,25\n", "is the decimal sign a comma?"),
        (
            b"tme_s,speed_mps\n0,1\n",
            r"no column time_s .*columns found: tme_s, speed_mps \(is it tme_s\?\)",
        ),
        (b"time_s,speed_mps\nx,1\ny,2\n", "column time_s: no number in it"),
        (b"time_s,speed_mps\n3,1\n2,2\n3,1\n2,1\n3,1\n2,1\n", "sort the log by time_s"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(
    written: Written, content: bytes, line: str
) -> None:
    path = written(content)
    with pytest.raises(TableError, match=line) as caught:
        read_log(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(TableError, match=r"none\.csv: no such file"):
        read_log(tmp_path / "none.csv")
    with pytest.raises(TableError, match="cannot be read"):
        read_log(tmp_path)
