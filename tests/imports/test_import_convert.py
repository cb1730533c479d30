"""From the file's words to the log's: units, signs, times, row conventions, extra columns,
several files."""

from __future__ import annotations

import re
import runpy
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest
import yaml
from click.testing import Result
from topdress.control.log_row import COMMANDS_HELD_EVENT
from topdress.drivers.files.any_log import open_any_log, read_with_mapping
from topdress.drivers.files.imports.convert import convert_table
from topdress.drivers.files.imports.log_file import write_imported_log
from topdress.drivers.files.imports.log_join import join_files
from topdress.drivers.files.imports.units import KNOWN_UNITS
from topdress.drivers.files.read_log import RunLog, read_log

from tests.imports import dialects, dresses

TIME: dict[str, Any] = {"column": "t", "counts": "s"}


@pytest.fixture
def imported(
    written: Callable[..., Path], topdress: Callable[..., Result], tmp_path: Path
) -> Callable[..., RunLog]:
    """Imports a text by an import file given as plain data."""

    def run(content: str, name: str = "in.csv", **mapping: Any) -> RunLog:
        source = written(content, name)
        place = written(
            yaml.safe_dump({"format": "topdress-import/1", "time": TIME} | mapping), "m.yaml"
        )
        result = topdress(
            "import", source, "--mapping", place, "--out", tmp_path / "out.csv", "--force"
        )
        assert result.exit_code == 0, result.output
        return read_log(tmp_path / "out.csv")

    return run


def table(header: str, *columns: Any) -> str:
    return (
        header
        + "\n"
        + "".join(",".join(str(cell) for cell in row) + "\n" for row in zip(*columns, strict=True))
    )


def test_scale_offset_sign_unit_range_and_missing(imported: Callable[..., RunLog]) -> None:
    log = imported(
        table("t,a,b", range(6), [1, 2, 3, -9999, 500, 6], [5, 7, "void", 9, 11, 13]),
        columns={
            "shaft_rpm": {
                "from": "a",
                "scale": 2.0,
                "offset": 1.0,
                "sign": -1,
                "unit": "r/s",
                "missing": [-9999],
                "valid": [0, 100],
            },
            "hopper_kg": {"from": "b", "missing": ["void"]},
            "opening_mm": {"constant": 21.5},
        },
    )
    assert log.numbers("shaft_rpm").tolist()[:3] == [-180.0, -300.0, -420.0]
    assert np.isnan(log.numbers("shaft_rpm")[3:5]).all()
    assert np.isnan(log.numbers("hopper_kg")[2]) and log.numbers("hopper_kg")[3] == 9.0
    assert set(log.numbers("opening_mm")) == {21.5}


def test_shares_slopes_and_flows(imported: Callable[..., RunLog]) -> None:
    log = imported(
        table(
            "t,gate,slope,flow,v",
            range(4),
            [0, 50, 100, 25],
            [0, 10, 100, -100],
            [60, 60, 60, 60],
            [1.0, 2.0, 0.0, 4.0],
        ),
        width_m=2.0,
        columns={
            "opening_mm": {"from": "gate", "unit": "%", "full": 60.0},
            "pitch_deg": {"from": "slope", "unit": "slope %"},
            "speed_mps": {"from": "v"},
            "applied_rate_kg_ha": {"from": "flow", "unit": "kg/min"},
        },
    )
    assert log.numbers("opening_mm").tolist() == [0.0, 30.0, 60.0, 15.0]
    assert log.numbers("pitch_deg").tolist() == [0.0, 5.711, 45.0, -45.0]
    rate = log.numbers("applied_rate_kg_ha")
    # standing is no rate
    assert rate[[0, 1, 3]].tolist() == [5000.0, 2500.0, 1250.0] and np.isnan(rate[2])


def test_a_row_that_holds_a_command_and_its_answer(imported: Callable[..., RunLog]) -> None:
    """Our row holds a reading and the command in force from there on: commands move one row up."""
    content = table("t,c,m", [10.0, 11.1, 12.2, 13.3], [20, 30, 40, 50], [21, 31, 41, 51])
    columns = {
        "shaft_rpm_cmd": {"from": "c"},
        "shaft_rpm": {"from": "m"},
        "opening_mm": {"constant": 20},
    }
    log = imported(content, rows="answer_in_row", columns=columns)
    assert log.time_s.tolist() == [0.0, 1.1, 2.2, 3.3, 4.4]
    assert log.numbers("shaft_rpm_cmd").tolist() == [20.0, 30.0, 40.0, 50.0, 50.0]
    assert np.isnan(log.numbers("shaft_rpm")[0]) and log.numbers("shaft_rpm").tolist()[1:] == [
        21.0,
        31.0,
        41.0,
        51.0,
    ]
    assert set(log.numbers("opening_mm")) == {20.0}
    assert log.texts("events").tolist() == [COMMANDS_HELD_EVENT, "", "", "", ""]
    plain = imported(content, columns=columns)
    assert plain.numbers("shaft_rpm_cmd").tolist() == [20.0, 30.0, 40.0, 50.0] and len(plain) == 4
    assert not plain.has("events")


@pytest.mark.parametrize(
    ("times", "how", "utc"),
    [
        (
            ["29.03.2026 01:59:59", "29.03.2026 03:00:00", "29.03.2026 03:00:01"],
            {"format": "%d.%m.%Y %H:%M:%S", "zone": "Europe/Berlin"},
            "2026-03-29T00:59:59.000Z",
        ),
        # the hour that comes twice
        (
            ["25.10.2026 02:59:59", "25.10.2026 02:00:00", "25.10.2026 02:00:01"],
            {"format": "%d.%m.%Y %H:%M:%S", "zone": "Europe/Berlin"},
            "2026-10-25T00:59:59.000Z",
        ),
        (
            ["2026-03-20 08:00:00+08:00", "2026-03-20 08:00:01+08:00", "2026-03-20 08:00:02+08:00"],
            {},
            "2026-03-20T00:00:00.000Z",
        ),
        (
            ["2026-03-20T08:00:00", "2026-03-20T08:00:01", "2026-03-20T08:00:02"],
            {"zone": "-05:30"},
            "2026-03-20T13:30:00.000Z",
        ),
        (
            ["1773993600", "1773993601", "1773993602"],
            {"counts": "unix_s"},
            "2026-03-20T08:00:00.000Z",
        ),
        (
            ["46101.3333333333", "46101.3333449074", "46101.3333564815"],
            {"counts": "excel_day", "zone": "UTC"},
            "2026-03-20T08:00:00.000Z",
        ),
        (["23:59:59.5", "00:00:00.5", "00:00:01.5"], {"format": "%H:%M:%S%.f"}, ""),
        (["11:59:59 PM", "12:00:00 AM", "12:00:01 AM"], {"format": "%I:%M:%S %p"}, ""),
    ],
)
def test_times_of_any_kind(
    times: list[str], how: dict[str, str], utc: str, imported: Callable[..., RunLog]
) -> None:
    log = imported(
        table("t,m", times, [1, 2, 3]),
        time={"column": "t", "counts": "text"} | how,
        columns={"shaft_rpm": {"from": "m"}},
    )
    assert log.time_s.tolist() == [0.0, 1.0, 2.0]
    assert str(log.texts("utc")[0]) == utc


def test_day_and_time_of_day_in_two_columns_and_rows_without_times(
    imported: Callable[..., RunLog],
) -> None:
    content = table("d,t,m", ["3/14/26", "3/14/26", "3/15/26"], ["23:59", "", "00:01"], [1, 2, 3])
    log = imported(
        content,
        columns={"shaft_rpm": {"from": "m"}},
        time={"column": "t", "date_column": "d", "format": "%m/%d/%y %H:%M"},
    )
    assert log.time_s.tolist() == [0.0, 120.0] and log.numbers("shaft_rpm").tolist() == [1.0, 3.0]
    counted = imported(
        content, columns={"shaft_rpm": {"from": "m"}}, time={"counts": "rows", "step_s": 0.02}
    )
    assert counted.time_s.tolist() == [0.0, 0.02, 0.04]


def test_columns_beyond_the_log_are_kept_and_carried(imported: Callable[..., RunLog]) -> None:
    content = table(
        "t,Eng Torque [Nm],Oil °C,Mode,Empty,m",
        range(3),
        [200, 210, 220],
        [80, 81, 82],
        ["a", "b", "b"],
        ["", "", ""],
        [1, 2, 3],
    )
    log = imported(content, columns={"shaft_rpm": {"from": "m"}})
    assert log.numbers("x_eng_torque_nm").tolist() == [200.0, 210.0, 220.0]
    assert log.numbers("x_oil_degc").tolist() == [80.0, 81.0, 82.0]
    assert log.texts("x_mode").tolist() == ["a", "b", "b"]
    assert set(log.columns) == {"time_s", "shaft_rpm", "x_eng_torque_nm", "x_oil_degc", "x_mode"}
    own = imported(
        content,
        extra="drop",
        columns={"shaft_rpm": {"from": "m"}, "x_load": {"from": "Eng Torque [Nm]", "scale": 0.5}},
    )
    assert (
        set(own.columns) == {"time_s", "shaft_rpm", "x_load"} and own.numbers("x_load")[0] == 100.0
    )


def test_what_counts_as_working(imported: Callable[..., RunLog]) -> None:
    content = table(
        "t,lift,word,m", range(4), [90, 10, "", 60], ["Transport", "Work", "", "Work"], [1, 2, 3, 4]
    )
    columns = {"shaft_rpm": {"from": "m"}}
    by_height = imported(content, columns=columns, working={"column": "lift", "below": 50})
    assert by_height.texts("state").tolist() == ["ready", "working", "", "ready"]
    assert "x_lift" in by_height.columns  # a height says more than the state
    by_word = imported(content, columns=columns, working={"column": "word", "equals": ["work"]})
    assert by_word.texts("state").tolist() == ["ready", "working", "", "working"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_a_byte_order_mark_is_no_part_of_a_name(
    encoding: str, imported: Callable[..., RunLog]
) -> None:
    log = imported(
        "\ufeff" + table("t,m", range(3), [1, 2, 3]),
        source={"encoding": encoding},
        columns={"shaft_rpm": {"from": "m"}},
    )
    assert log.numbers("shaft_rpm").tolist() == [1.0, 2.0, 3.0]


def test_a_file_without_a_header(imported: Callable[..., RunLog]) -> None:
    log = imported(
        "0,5\n1,6\n2,7\n", source={"names": ["t", "m"]}, columns={"shaft_rpm": {"from": "m"}}
    )
    assert log.numbers("shaft_rpm").tolist() == [5.0, 6.0, 7.0]


@pytest.mark.parametrize(
    ("delimiter", "cells", "want"),
    [
        (";", ["1.234,5", "999,5", "1 234,5", "0,25"], [1234.5, 999.5, 1234.5, 0.25]),
        (";", ["1,234.5", "999.5", "1'234.5", "0.25"], [1234.5, 999.5, 1234.5, 0.25]),
        ("\t", ["1,5", "2,5", "-3e1", ""], [1.5, 2.5, -30.0, np.nan]),
    ],
)
def test_numbers_with_groups_of_digits(
    delimiter: str, cells: list[str], want: list[float], imported: Callable[..., RunLog]
) -> None:
    content = f"t{delimiter}m\n" + "".join(
        f"{k}{delimiter}{cell}\n" for k, cell in enumerate(cells)
    )
    log = imported(content, columns={"hopper_kg": {"from": "m"}})
    assert np.array_equal(log.numbers("hopper_kg"), want, equal_nan=True)


def test_a_cut_last_row_and_rows_of_another_width(imported: Callable[..., RunLog]) -> None:
    log = imported(
        "t,m,k\n0,5,1\n1,6,1\n2,7,1,9,9\n3,8,1\n4,9", columns={"shaft_rpm": {"from": "m"}}
    )
    assert log.time_s.tolist() == [0.0, 1.0, 3.0] and log.numbers("shaft_rpm").tolist() == [
        5.0,
        6.0,
        8.0,
    ]


def test_files_are_joined_by_their_clock_or_as_runs(
    written: Callable[..., Path], topdress: Callable[..., Result], tmp_path: Path
) -> None:
    head = "Time,Shaft speed [rpm]\n"
    later = written(head + "".join(f"2026-03-01T09:00:{k:02d}Z,{k}\n" for k in range(40)), "a.csv")
    first = written(
        head + "".join(f"2026-03-01T08:59:{k:02d}Z,{k + 100}\n" for k in range(40)), "b.csv"
    )
    out = tmp_path / "out.csv"
    assert "2 files joined by their times" in topdress("import", later, first, "--out", out).output
    log = read_log(out)
    assert log.time_s[0] == 0.0 and log.time_s[40] == 60.0 and log.numbers("shaft_rpm")[0] == 100.0
    assert (
        log.texts("events")[0] == "mark file b.csv" and log.texts("events")[40] == "mark file a.csv"
    )
    assert log.meta is not None and [
        file["name"] for file in log.meta.extra["imported"]["files"]
    ] == ["b.csv", "a.csv"]
    again = written(later.read_text(), "c.csv")
    assert "begins before" in topdress("import", later, again, "--out", tmp_path / "o2.csv").output
    counted = [
        written(
            "Time [s],Shaft speed [rpm]\n" + "".join(f"{k},{k}\n" for k in range(30)), f"r{n}.csv"
        )
        for n in range(2)
    ]
    result = topdress("import", *counted, "--out", tmp_path / "o3.csv")
    assert "one after the other, 60 s between" in result.output
    assert read_log(tmp_path / "o3.csv").time_s[30] == 89.0


def test_the_sidecar_says_where_a_log_comes_from(
    imported: Callable[..., RunLog], tmp_path: Path
) -> None:
    import hashlib

    log = imported(
        table("t,m", range(3), [1, 2, 3]), columns={"shaft_rpm": {"from": "m", "unit": "r/s"}}
    )
    assert log.meta is not None and not [
        finding for finding in log.findings if finding.id == "sidecar"
    ]
    told = log.meta.extra["imported"]
    assert (
        told["files"][0]["sha256"] == hashlib.sha256((tmp_path / "in.csv").read_bytes()).hexdigest()
    )
    assert told["mapping"]["columns"]["shaft_rpm"]["unit"] == "r/s"
    assert (
        log.meta.sha256["m.yaml"] == hashlib.sha256((tmp_path / "m.yaml").read_bytes()).hexdigest()
    )


def test_a_log_of_our_own_comes_in_unchanged(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    topdress("simulate", "--seconds", "30", "--seed", "3", "--out", tmp_path / "a.csv")
    result = topdress("import", tmp_path / "a.csv", "--out", tmp_path / "b.csv")
    assert result.exit_code == 0, result.output
    a, b = read_log(tmp_path / "a.csv"), read_log(tmp_path / "b.csv")
    known = [name for name in a.columns if a.has(name)]
    assert [name for name in b.columns if b.has(name)] == known
    for name in known:
        if a.columns[name].dtype == object:
            assert a.texts(name).tolist() == b.texts(name).tolist(), name
        else:
            assert np.array_equal(a.numbers(name), b.numbers(name), equal_nan=True), name


# --- Dialects dealt at random over a known log: what comes in is the log
# -------------------------------------------

DEALS = 22


@pytest.mark.parametrize(
    "number",
    [
        number if number < DEALS // 2 else pytest.param(number, marks=pytest.mark.exam)
        for number in range(DEALS)
    ],
)
@pytest.mark.filterwarnings("ignore::shapefile.PossibleDataLoss")
def test_a_dialect_comes_in_as_the_truth(number: int, tmp_path: Path) -> None:
    assert dialects.problems(dialects.deal(number, seed=13), dialects.true_log(), tmp_path) == []


def test_the_deals_of_the_suite_meet_every_kind() -> None:
    deals = [dialects.deal(number, seed=13) for number in range(DEALS)]
    assert {of.kind for of in deals} == {"text", "excel", "parquet", "geojson", "shapefile"}
    assert {of.language for of in deals} == {"en", "de", "zh"}
    assert {of.told for of in deals} == {True, False}
    texts = [of for of in deals if of.kind == "text"]
    assert len({of.encoding for of in texts}) >= 4 and any(of.comma for of in texts)


# --- Tables in the dress that people and programs put on them: the truth, a question or a
# refusal, never anyt... -----

DRESSED = 24
SEED = 20261122


@pytest.mark.parametrize(
    "number",
    [
        number if number < DRESSED // 3 else pytest.param(number, marks=pytest.mark.exam)
        for number in range(DRESSED)
    ],
)
def test_a_dress_is_seen_through_or_asked_about(number: int, tmp_path: Path) -> None:
    what, lines = dresses.problems(dresses.dress(number, SEED), dresses.D.true_log(), tmp_path)
    assert what in ("imported", "asked", "refused"), lines


def test_the_deals_of_the_suite_meet_much() -> None:
    deals = [dresses.dress(number, SEED) for number in range(DRESSED)]
    assert {of.kind for of in deals} == {"text", "excel"} and {of.language for of in deals} == {
        "en",
        "de",
        "zh",
    }
    assert {of.between for of in deals} == set(dresses.BETWEEN) and {
        of.footer for of in deals
    } == set(dresses.FOOTERS)
    assert len({of.time for of in deals}) >= 9 and len({of.encoding for of in deals}) >= 5


def log_of(
    times: list[str], head: str = "Time,Speed [m/s],Shaft speed [r/min]", tail: str = ""
) -> str:
    rows = (
        f"{time},{1.5 + 0.01 * (k % 7):.2f},{40 + k % 5}.25{tail}" for k, time in enumerate(times)
    )
    return "\n".join([head, *rows])


@pytest.mark.parametrize("day", ["07-03-26", "17-03-26"])
def test_a_year_of_two_digits_is_no_year_7(
    topdress: Callable[..., Result], written: Callable[..., Path], tmp_path: Path, day: str
) -> None:
    source = written(log_of([f"{day} 08:{k // 60:02d}:{k % 60:02d}" for k in range(90)]))
    done = topdress("import", source, "--out", tmp_path / "out.csv")
    assert done.exit_code == 2 and "both read: which is the day?" in done.output, done.output
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize("tail", ["", ".250", ",250"])
def test_day_and_time_in_one_run_of_digits(
    topdress: Callable[..., Result], written: Callable[..., Path], tmp_path: Path, tail: str
) -> None:
    text = log_of([f"20260317{8:02d}{k // 60:02d}{k % 60:02d}{tail}" for k in range(90)])
    if "," in tail:
        text = text.replace(tail, "#").replace(",", ";").replace("#", tail)
    done = topdress("import", written(text), "--out", tmp_path / "out.csv")
    assert done.exit_code == 0, done.output
    assert read_log(tmp_path / "out.csv").duration_s == 89.0


def test_a_delimiter_after_the_last_cell_beside_quotes(
    topdress: Callable[..., Result], written: Callable[..., Path], tmp_path: Path
) -> None:
    lines = log_of(
        [str(k) for k in range(90)], "Time [s],Speed [m/s],Shaft speed [r/min]"
    ).splitlines()
    text = "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) + "," for line in lines)
    done = topdress("import", written(text), "--out", tmp_path / "out.csv")
    assert done.exit_code == 0, done.output
    log = read_log(tmp_path / "out.csv")
    assert len(log) == 90 and log.numbers("shaft_rpm")[3] == 43.25


def test_notes_of_a_few_rows_beside_the_log_s_sheet_are_left_out_and_said(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    book = openpyxl.Workbook()
    assert book.active is not None
    for row in (["Name", "Value"], ["Area", 12.5], ["Width", 2.4]):
        book.active.append(row)
    sheet = book.create_sheet("Data")
    sheet.append(["Time [s]", "Speed [m/s]", "Shaft speed [r/min]"])
    for k in range(90):
        sheet.append([k, 1.5 + 0.01 * (k % 7), 40.25 + k % 5])
    book.save(tmp_path / "log.xlsx")
    done = topdress("import", tmp_path / "log.xlsx", "--out", tmp_path / "out.csv")
    assert done.exit_code == 0, done.output
    assert (
        len(read_log(tmp_path / "out.csv")) == 90
        and "sheet Sheet left out: 3 rows next to a log" in done.output
    )


def test_what_is_opened_is_what_would_be_written_and_read_and_no_file_lies_between(
    written: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Texts, whole numbers, more decimals than a log keeps, sentinels, a rows' order that is
    mended, a UTC column."""
    text = table(
        "t;rpm;what;n;utc;x",
        [0.0, 0.1004, 0.2, 0.2, 0.3, 0.4],
        [60.123456, 61, -9999, 3, 62, ""],
        ["on", " off", "", "on", "on", "1"],
        [4, 4, 5, 5, "", 4],
        [f"2026-03-20T08:00:0{k}Z" for k in range(6)],
        [1, 2, 3, 4, 5, 1e300],
    )
    source = written(text.replace(",", ";"), "in.csv")
    place = written(
        yaml.safe_dump(
            {
                "format": "topdress-import/1",
                "time": TIME,
                "extra": "keep",
                "columns": {
                    "shaft_rpm": {"from": "rpm", "unit": "r/min"},
                    "fix_quality": {"from": "n"},
                    "utc": {"from": "utc"},
                },
            }
        ),
        "in.import.yaml",
    )
    raw, mapping, said_by = read_with_mapping(source)
    assert said_by == place
    write_imported_log(
        tmp_path / "out.csv",
        join_files([convert_table(raw, mapping)], mapping.join),
        mapping,
        said_by,
    )
    read = read_log(tmp_path / "out.csv")
    monkeypatch.setattr(tempfile, "mkdtemp", lambda *_, **__: pytest.fail("a file in between"))
    opened = open_any_log(source)
    assert list(opened.columns) == list(read.columns) and len(opened) == 5
    for name, array in read.columns.items():
        np.testing.assert_array_equal(opened.columns[name], array, err_msg=name)
        assert opened.columns[name].dtype == array.dtype
    assert (
        opened.meta is not None and read.meta is not None and opened.meta.extra == read.meta.extra
    )


# --- How hard a drive works, of a log of another machine: a column of the log's, not a nameless
# one ------------------


@pytest.mark.parametrize(
    ("header", "command", "scale", "column"),
    [
        ("motor current [mA]", "target rpm", 0.001, "shaft_effort"),
        ("motor_torque_nm", "target rpm", 1.0, "shaft_effort"),
        ("duty [%]", "target rpm", 1.0, "shaft_effort"),
        ("gate_current_a", "target rpm", 1.0, "gate_effort"),
    ],
)
def test_effort_of_another_machine_is_a_column_of_the_log(
    header: str,
    command: str,
    scale: float,
    column: str,
    topdress: Callable[..., Result],
    tmp_path: Path,
) -> None:
    rows = np.arange(200)
    wanted = 30.0 + 10.0 * (rows // 20 % 3)
    turned = np.concatenate((wanted[:1], wanted[:-1])) + 0.1 * np.sin(rows)
    effort = 400.0 + 3.0 * turned + np.cos(rows)
    path, out = tmp_path / "other.csv", tmp_path / "log.csv"
    path.write_text(
        f"time [s],{command},actual rpm,{header}\n"
        + "".join(
            f"{0.1 * k:.1f},{a:g},{b:.3f},{c:.3f}\n"
            for k, a, b, c in zip(rows, wanted, turned, effort, strict=True)
        )
    )
    result = topdress("import", path, "--out", out)
    assert result.exit_code == 0, result.output
    log = read_log(out)
    assert np.allclose(log.numbers(column)[:200], scale * effort, atol=6e-4)
    assert np.allclose(log.numbers("shaft_rpm_cmd")[:200], wanted)


# --- What the commands on docs/import.md make of its files; these are those of their script
# --------------------------

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")
EXAMPLES = ROOT / "docs" / "examples" / "import"


def test_what_its_commands_make(
    topdress: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That they say what the page shows is seen with those of the other pages (tests/docs)."""
    monkeypatch.chdir(tmp_path)
    for name, more in (
        ("planter.csv", ["--mapping", EXAMPLES / "planter.yaml"]),
        ("tractor.csv", []),
        ("applied.geojson", []),
    ):
        assert (
            topdress(
                "import", EXAMPLES / name, *more, "--out", f"{Path(name).stem}-log.csv"
            ).exit_code
            == 0
        )
    planter = read_log(tmp_path / "planter-log.csv")
    assert planter.texts("utc")[0] == "2026-04-14T07:30:00.000Z"
    assert set(planter.texts("state")) == {"ready", "working"}
    assert planter.numbers("opening_mm").max() <= 60.0
    assert "x_发动机扭矩_nm" in read_log(tmp_path / "tractor-log.csv").columns
    wanted = read_log(tmp_path / "applied-log.csv").numbers("target_rate_kg_ha")
    assert set(wanted.round(1)) <= {134.5, 168.1, 201.8, 235.4}


def test_the_example_files_are_those_of_their_script(tmp_path: Path) -> None:
    made = runpy.run_path(str(EXAMPLES / "make.py"))["FILES"]
    for name, write in made.items():
        assert (EXAMPLES / name).read_bytes() == write(), (
            f"{name}: run docs/examples/import/make.py"
        )


def test_the_shipped_import_file_is_the_guess_with_two_lines_by_hand(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    topdress("import", EXAMPLES / "planter.csv", "--guess", "--mapping", tmp_path / "planter.yaml")
    guessed = (tmp_path / "planter.yaml").read_text(encoding="utf-8").splitlines()
    shipped = (EXAMPLES / "planter.yaml").read_text(encoding="utf-8").splitlines()
    by_hand = [line for line in shipped if line not in guessed and not line.startswith("#")]
    assert [line.strip() for line in by_hand] == [
        "zone: Europe/Berlin",
        "opening_mm:",
        "from: Schieberöffnung",
        'unit: "%"',
        "full: 60",
    ]


def test_the_page_names_every_unit_that_a_column_can_be_in() -> None:
    listed = PAGE[PAGE.index("Units: ") : PAGE.index("Usual other spellings")]
    for unit in KNOWN_UNITS:
        # no column of a log is in those
        if unit.quantity not in ("other", "time", "nitrogen", "count"):
            assert re.search(rf"(?<![\w/]){re.escape(unit.name)}(?![\w/])", listed), unit.name
