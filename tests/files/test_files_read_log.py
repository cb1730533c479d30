from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from topdress.control.log_row import (
    COLUMNS,
    DECIMALS,
    EXACT_COLUMNS,
    TEXT_COLUMNS,
    WHOLE_COLUMNS,
    LogRow,
)
from topdress.control.loop.events import EventQueue
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.limits import BeyondLimits
from topdress.drivers.files.log_text import LOG_HEADER, RowText
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.run_log import write_whole_log
from topdress.drivers.files.run_meta import RunMeta

MakeRow = Callable[[float], LogRow]
Written = Callable[..., Path]

LIMITS = {
    "lat_deg": (1.0, 80.0),
    "lon_deg": (-180.0, 180.0),
    "hdop": (0.5, 50.0),
    "heading_deg": (0.0, 360.0),
    "pitch_deg": (-50.0, 50.0),
    "roll_deg": (-50.0, 50.0),
    "speed_mps": (0.0, 5.0),
    "wheel_speed_mps": (0.0, 5.0),
    "speed_used_mps": (0.0, 5.0),
    "hopper_kg": (-5.0, 300.0),
    "supply_v": (0.0, 30.0),
    "target_rate_kg_ha": (0.0, 900.0),
    "nudge_percent": (-30.0, 30.0),
    "flow_trim": (0.5, 2.0),
    "shaft_rpm_cmd": (0.0, 98.0),
    "shaft_rpm": (0.0, 98.0),
    "opening_mm_cmd": (0.0, 60.0),
    "opening_mm": (0.0, 60.0),
    "applied_rate_kg_ha": (0.0, 900.0),
    "lag_s": (0.0, 9.0),
    "lag_m": (0.0, 90.0),
}
QUIETLY: Any = {
    "deadline": None,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
}
printable = st.text(st.characters(blacklist_categories=("Cs", "Cc")), min_size=1, max_size=12)


def cell(column: str) -> st.SearchStrategy[Any]:
    if column in TEXT_COLUMNS:
        values: st.SearchStrategy[Any] = printable
    elif column in WHOLE_COLUMNS:
        values = st.integers(0, 1 if column == "work_switch" else 8)
    else:
        values = st.floats(*LIMITS.get(column, (0.01, 0.99)))
    return st.none() | values


rows_of_any_kind = st.lists(
    st.tuples(*(cell(column) for column in COLUMNS[1:])), min_size=1, max_size=8
).map(lambda cells: [LogRow(round(k * 0.05, 3), *rest) for k, rest in enumerate(cells)])


def as_logged(row: LogRow) -> LogRow:
    """The row with the digits that the format keeps."""

    def kept(column: str, value: Any) -> Any:
        if column in TEXT_COLUMNS:
            return (value or "").strip() or None
        if value is None or column in WHOLE_COLUMNS or column in EXACT_COLUMNS:
            return value
        return float(f"{value:.{DECIMALS[column]}f}")

    return LogRow(
        *(kept(column, value) for column, value in zip(COLUMNS, row[: len(COLUMNS)], strict=True))
    )


@given(rows_of_any_kind)
@settings(max_examples=60, **QUIETLY)
def test_what_is_written_is_read_back(tmp_path: Path, rows: list[LogRow]) -> None:
    path = write_whole_log(tmp_path / "run.csv", RunMeta(software="t"), rows, overwrite=True)
    log = read_log(path)
    assert list(log.rows()) == [as_logged(row) for row in rows]
    assert log.meta == RunMeta(software="t")
    assert [
        f for f in log.findings if f.id not in ("missing", "speed_unit_likely", "zero_position")
    ] == []


@pytest.mark.parametrize("text", [",", '"', "a,b", "mm"])
def test_one_row_with_a_text_is_a_row_and_no_row_of_units(tmp_path: Path, text: str) -> None:
    """A comma alone, split at commas, looked like two inch marks."""
    rows = [LogRow(0.0, **{name: text}) for name in ("events", "alarms")]
    for row in rows:
        path = write_whole_log(tmp_path / "run.csv", RunMeta(software="t"), [row], overwrite=True)
        assert list(read_log(path).rows()) == [as_logged(row)]


@pytest.mark.exam
@given(
    rows_of_any_kind,
    st.randoms(use_true_random=False),
    st.sampled_from(["\n", "\r\n"]),
    st.booleans(),
)
@settings(max_examples=40, **QUIETLY)
def test_column_order_line_ends_and_extra_columns_do_not_matter(
    tmp_path: Path, rows: list[LogRow], random: Any, line_end: str, odd: bool
) -> None:
    text = RowText()
    table = [LOG_HEADER.rstrip("\n").split(","), *(_fields(text.line(row)) for row in rows)]
    table = [[*fields, "density_g_l" if k == 0 else f"{k}.5"] for k, fields in enumerate(table)]
    order = list(range(len(table[0])))
    random.shuffle(order)
    lines = [",".join(fields[i] for i in order) for fields in table]
    if odd:
        lines.insert(2, "")  # a blank line takes the reader its careful way
    path = tmp_path / "mixed.csv"
    path.write_bytes((line_end.join(lines) + line_end).encode())
    log = read_log(path)
    assert list(log.rows()) == [as_logged(row) for row in rows]
    assert log.columns["density_g_l"].tolist() == [k + 1.5 for k in range(len(rows))]


def _fields(line: str) -> list[str]:
    """Splits a line of ours, leaving quotes where they are."""
    fields, quoted, start = [], False, 0
    line = line.rstrip("\n")
    for place, letter in enumerate(line):
        if letter == '"':
            quoted = not quoted
        elif letter == "," and not quoted:
            fields.append(line[start:place])
            start = place + 1
    return [*fields, line[start:]]


@pytest.mark.parametrize("beside", [True, False], ids=["with sidecar", "without sidecar"])
def test_a_log_cut_anywhere_opens_up_to_its_last_whole_row(
    tmp_path: Path, full_row: MakeRow, beside: bool
) -> None:
    rows = [full_row(0.0), LogRow(0.05, lat_deg=34.1, events='雨 mark, "so"')]
    path = write_whole_log(tmp_path / "run.csv", RunMeta(software="t"), rows)
    whole = path.read_bytes()
    expected = [as_logged(row) for row in rows]
    if not beside:
        path.with_suffix(".yaml").unlink()
    for cut in range(len(whole) + 1) if beside else range(1, len(whole) + 1, 5):
        path.write_bytes(whole[:cut])
        kept = max(whole[:cut].count(b"\n") - 1, 0)
        log = read_log(path)
        assert list(log.rows()) == expected[:kept], cut
        ids = {finding.id for finding in log.findings}
        at_an_end = whole[:cut].endswith(b"\n")
        assert bool(ids & {"cut_row", "cut_header"}) is not at_an_end, (cut, log.findings)


def test_zeros_left_by_a_power_loss_are_no_row(tmp_path: Path, full_row: MakeRow) -> None:
    path = write_whole_log(tmp_path / "run.csv", RunMeta(), [full_row(0.0), full_row(0.05)])
    with path.open("ab") as file:
        file.write(b"0.1" + b"\0" * 4000)
    log = read_log(path)
    assert len(log) == 2
    assert {"cut_row", "zero_bytes"} <= {finding.id for finding in log.findings}


def test_rows_hold_plain_python_values(tmp_path: Path, full_row: MakeRow) -> None:
    (row,) = read_log(write_whole_log(tmp_path / "run.csv", RunMeta(), [full_row(0.0)])).rows()
    for column, value in zip(COLUMNS, row, strict=False):
        wanted = str if column in TEXT_COLUMNS else int if column in WHOLE_COLUMNS else float
        assert type(value) is wanted, column


def test_an_empty_file_is_refused_unless_it_is_ours(written: Written) -> None:
    with pytest.raises(TableError, match=r"log\.csv: the file is empty$"):
        read_log(written(""))
    written("format: topdress-run-log/1\n", "log.yaml")
    assert len(read_log(written(""))) == 0


def test_a_log_knows_its_columns(written: Written) -> None:
    log = read_log(
        written("time_s,speed_mps,state,soil\n0.5,1.0,working,clay\n1.0,,held,\n1.5,1.2,,loam\n")
    )
    assert log.time_s.tolist() == [0.5, 1.0, 1.5]
    assert (log.duration_s, log.step_s, len(log)) == (1.0, 0.5, 3)
    assert np.isnan(log.numbers("speed_mps")[1]) and np.isnan(log.numbers("hopper_kg")).all()
    assert log.texts("state").tolist() == ["working", "held", ""]
    assert log.columns["soil"].tolist() == ["clay", "", "loam"]
    assert log.has("speed_mps") and not log.has("hopper_kg")
    with pytest.raises(KeyError):
        log.numbers("state")
    assert list(log.rows())[1] == LogRow(1.0, state="held")


def test_a_part_of_the_columns_is_as_in_the_whole(written: Written) -> None:
    lines = ["time_s,lat_deg,lon_deg,speed_mps,shaft_rpm,state"]
    lines += [f"{k},{30 + k * 1e-5:.7f},100,{1.112 * 3.6:.3f},70,working" for k in range(100)]
    path = written("\n".join(lines) + "\n")
    part, whole = read_log(path, only=["speed_mps", "state"]), read_log(path)
    assert set(part.columns) == {"time_s", "speed_mps", "state"}
    assert part.columns["speed_mps"].tolist() == whole.columns["speed_mps"].tolist()
    assert part.columns["speed_mps"][0] == pytest.approx(1.112, rel=1e-3)


def test_a_sidecar_that_is_none_is_said(written: Written) -> None:
    written("format: topdress-job/1\n", "log.yaml")
    log = read_log(written("time_s\n0\n1\n"))
    assert log.meta is None
    assert (
        "log.yaml next to the log was not used: key format: value topdress-job/1: allowed "
        "topdress-run-log/1" in [str(finding) for finding in log.findings]
    )


def test_the_quick_and_the_careful_way_agree(tmp_path: Path, full_row: MakeRow) -> None:
    rows = [full_row(k * 0.05)._replace(hopper_kg=None if k % 3 else 200.0 + k) for k in range(50)]
    path = write_whole_log(tmp_path / "run.csv", RunMeta(), rows)
    quick = list(read_log(path).rows())
    # such a table is taken apart row by row
    path.write_text(path.read_text() + "9,short\n")
    careful = read_log(path)
    assert "wrong_fields" in [one.id for one in careful.findings]
    assert list(careful.rows()) == quick == [as_logged(row) for row in rows]


@pytest.mark.exam
def test_a_large_log_is_read_quickly(tmp_path: Path, full_row: MakeRow) -> None:
    """Reading takes some seven times as long as the division of the lines into cells; twice as
    long would be seen."""
    import time

    line = RowText().line(full_row(0.0)).split(",", 1)[1]
    path = tmp_path / "large.csv"
    with path.open("w") as file:
        file.write(LOG_HEADER)
        file.writelines(f"{k * 0.05:.3f},{line}" for k in range(60_000))
    read_log(path, only=["shaft_rpm"])  # loads the library
    started = time.process_time()
    with path.open() as file:
        cells = [row.split(",") for row in file]
    divided = time.process_time()
    assert len(read_log(path)) == len(cells) - 1 == 60_000
    assert time.process_time() - divided < 15.0 * (divided - started)


def test_a_machine_with_valves_has_their_column_and_no_other_has(tmp_path: Path) -> None:
    rows = [
        LogRow(0.05 * k, shaft_rpm=70.0, sections_cmd=told)
        for k, told in enumerate(("0;1;1", None, "0;0;0"))
    ]
    machine = {"sections": [{"outlets": 2, "valve": {"open_s": 0.2, "close_s": 0.2}}] * 3}
    path = write_whole_log(tmp_path / "run.csv", RunMeta(machine=machine), rows)
    assert (
        path.read_text(encoding="utf-8").splitlines()[0]
        == LOG_HEADER.rstrip("\n") + ",sections_cmd"
    )
    log = read_log(path)
    assert [row.sections_cmd for row in log.rows()] == ["0;1;1", None, "0;0;0"]
    path.write_bytes(path.read_bytes()[:-3])  # the power goes in the last row
    assert len(read_log(path)) == 2
    for other in (
        None,
        {},
        {"sections": []},
        {"sections": [{"outlets": 6, "valve": None}]},
        {"sections": 3},
    ):
        plain = write_whole_log(
            tmp_path / "plain.csv", RunMeta(machine=other), rows, overwrite=True
        )
        assert plain.read_text(encoding="utf-8").splitlines()[0] == LOG_HEADER.rstrip("\n")


def with_long_row(tmp_path: Path, at: int, size: int, rows: int = 40, quoted: bool = False) -> Path:
    """A log of which one row has that many bytes of events, as 232 marks in one tick left it."""
    path = write_whole_log(
        tmp_path / "run.csv",
        RunMeta(software="t"),
        [LogRow(0.05 * k, state="working", speed_mps=1.0, events="mark here") for k in range(rows)],
    )
    lines = path.read_bytes().split(b"\n")
    marks = b";".join([b"mark " + b"x" * 990] * (size // 996 + 1))[:size]
    lines[1 + at] = lines[1 + at].replace(b"mark here", b'"a,' + marks + b'"' if quoted else marks)
    path.write_bytes(b"\n".join(lines))
    return path


@pytest.mark.parametrize(
    ("at", "size"), [(0, 131_072), (1, 132_000), (20, 200_000), (39, 262_144), (20, 1_000_000)]
)
@pytest.mark.parametrize("quoted", [False, True])
def test_a_row_that_is_too_long_is_left_out_and_said(
    tmp_path: Path, at: int, size: int, quoted: bool
) -> None:
    log = read_log(with_long_row(tmp_path, at, size, quoted=quoted))
    assert log.time_s.tolist() == pytest.approx([0.05 * k for k in range(40) if k != at])
    found = next(one for one in log.findings if one.id == "long_row")
    assert (
        found.rows == 1
        and f"line {2 + at} with " in found.text
        and "allowed up to 131,072" in found.text
    )


def test_the_same_far_behind_in_a_large_log_and_several_of_them(tmp_path: Path) -> None:
    path = with_long_row(tmp_path, 15_000, 232_000, rows=20_000)
    lines = path.read_bytes().split(b"\n")
    lines[3], lines[19_000] = lines[15_001], lines[15_001]
    path.write_bytes(b"\n".join(lines))
    log = read_log(path)
    assert len(log) == 20_000 - 3
    assert next(one for one in log.findings if one.id == "long_row").rows == 3


def test_rows_just_below_the_limit_and_zero_bytes_are_no_long_rows(tmp_path: Path) -> None:
    path = with_long_row(tmp_path, 5, 130_000)
    assert len(read_log(path)) == 40
    path.write_bytes(path.read_bytes() + b"\0" * 400_000)
    log = read_log(path)
    assert len(log) == 40 and "long_row" not in {one.id for one in log.findings}


def test_a_cell_over_many_lines_that_is_too_long_costs_its_row_only(tmp_path: Path) -> None:
    path = with_long_row(tmp_path, 5, 10)
    path.write_bytes(path.read_bytes().replace(b"mark xxxxx", b"x" * 10))
    lines = path.read_bytes().split(b"\n")
    lines[6] = lines[6].replace(b"x" * 10, b'"' + b"\n".join([b"y" * 60_000] * 3) + b'"')
    lines[20] += b",7"  # such a table is read row by row
    path.write_bytes(b"\n".join(lines))
    log = read_log(path)
    assert (
        len(log) == 38 and next(one for one in log.findings if one.id == "wrong_fields").rows == 2
    )


def test_a_file_of_nothing_but_one_long_line_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(b"x" * 400_000)
    with pytest.raises(BeyondLimits, match="allowed up to"):
        read_log(path)


@pytest.mark.parametrize("sign", [",", "|", "\t", '"', ";"])
def test_events_full_of_signs_that_part_columns_are_no_columns(tmp_path: Path, sign: str) -> None:
    """2,000 commas in an operator's marks made a log of 2,001 columns, which nobody may have."""
    events = EventQueue()
    events.add_events(*(["mark " + sign * 990] * 8))
    rows = [
        LogRow(
            0.05 * k,
            state="working",
            speed_mps=1.0,
            events=";".join(events.take_row_events()) or None,
        )
        for k in range(20)
    ]
    log = read_log(write_whole_log(tmp_path / "run.csv", RunMeta(software="t"), rows))
    assert len(log) == 20 and log.columns["events"][7] == rows[7].events.strip()
