"""Run logs as Parquet: read back equal, whole or refused in one line, and taken by every command that reads a log."""
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from console.cli import app
from control.log_row import LogRow
from drivers.files.any_log import open_log
from drivers.files.imports.trouble import TableError
from drivers.files.log_store import is_store, write_store
from drivers.files.opened import Opened
from drivers.files.read_log import RunLog, meta_of, read_log, read_rows
from drivers.files.run_log import write_log
from drivers.files.run_meta import run_meta


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
    rows = [LogRow(round(0.05 * k, 3), shaft_rpm_cmd=0.1 + k / 3.0, hopper_kg=None if k % 3 else 250.5,
                   shaft_rpm=30.123, state="working", work_switch=k % 2, events="refill 20; a, b" if k == 7 else None)
            for k in range(40)]
    path = write_log(tmp_path / "run.csv", run_meta(seed=3, extra={"note": "ß 播"}), rows)
    with path.open("a", encoding="utf-8") as file:
        file.write("2.0,cut")                            # power loss: the finding must be kept
    return path


def test_a_log_is_read_back_equal_from_its_store(text_log: Path, tmp_path: Path) -> None:
    log = read_log(text_log)
    place = tmp_path / "store" / "run.parquet"
    write_store(place, log.columns, log.meta, log.findings)
    assert log.findings
    same(read_log(place), log)
    assert meta_of(place) == log.meta
    assert is_store(place) and not Opened(place).foreign
    same(open_log(place), log)
    assert pl.read_parquet(place)["hopper_kg"].null_count() == 26          # not NaN: others must see it too


def test_only_some_columns(text_log: Path, tmp_path: Path) -> None:
    log = read_log(text_log)
    write_store(tmp_path / "run.parquet", log.columns, log.meta)
    assert list(read_log(tmp_path / "run.parquet", only=["state"]).columns) == ["time_s", "state"]


def test_the_command_makes_it_and_takes_it_back(text_log: Path, tmp_path: Path) -> None:
    store, again = tmp_path / "kept.parquet", tmp_path / "again.csv"
    told = CliRunner().invoke(app, ["import", str(text_log), "--out", str(store)])
    assert told.exit_code == 0 and "40 rows" in told.output, told.output
    same(read_rows(store), read_rows(text_log))
    assert CliRunner().invoke(app, ["import", str(store), "--out", str(again)]).exit_code == 0
    whole, back = read_rows(text_log), read_rows(again)
    same(replace(back, findings=()), replace(whole, findings=()))
    twice = CliRunner().invoke(app, ["import", str(text_log), "--out", str(store)])
    assert twice.exit_code != 0 and "exists already" in twice.output
    wrong = CliRunner().invoke(app, ["import", str(text_log), "--out", str(tmp_path / "kept.json")])
    assert wrong.exit_code != 0


def test_a_foreign_log_becomes_a_store_at_once(tmp_path: Path) -> None:
    source = Path(__file__).parents[2] / "docs/examples/import/tractor.csv"
    for name in ("log.csv", "log.parquet", "log.parquet"):                  # made anew of the same file
        told = CliRunner().invoke(app, ["import", str(source), "--out", str(tmp_path / name)])
        assert told.exit_code == 0, told.output
    same(read_log(tmp_path / "log.parquet"), read_log(tmp_path / "log.csv"))


@pytest.mark.parametrize("spoil", ["cut", "version", "times"])
def test_a_spoilt_store_is_refused_in_one_line(text_log: Path, tmp_path: Path, spoil: str) -> None:
    log = read_log(text_log)
    place = tmp_path / "run.parquet"
    columns = dict(log.columns)
    if spoil == "times":
        columns["time_s"] = columns["time_s"][::-1].copy()
    write_store(place, columns, log.meta)
    data = place.read_bytes()
    if spoil == "cut":                                  # the footer stands, a column is torn
        place.write_bytes(data[:4] + b"\0" * 400 + data[404:])
    if spoil == "version":
        place.write_bytes(data.replace(b"topdress-log-store/1", b"topdress-log-store/9"))
    with pytest.raises(TableError) as refused:
        read_log(place)
    assert str(place) in str(refused.value) and "\n" not in str(refused.value)


def test_parquet_of_another_program_is_foreign(tmp_path: Path) -> None:
    pl.DataFrame({"time_s": [0.0, 1.0], "speed": [1.0, 1.1]}).write_parquet(tmp_path / "other.parquet")
    assert not is_store(tmp_path / "other.parquet") and Opened(tmp_path / "other.parquet").foreign


def test_a_log_of_ours_comes_back_from_its_store_to_the_byte(tmp_path: Path) -> None:
    rows = [LogRow(round(0.0503 * k, 4), utc="2026-11-23T07:12:00.000Z", lat_deg=34.1 + k * 1e-7, satellites=14,
                   fix_quality=4, hdop=0.8, heading_deg=k % 360 + 0.5, shaft_rpm_cmd=k / 3.0, nudge_percent=5.0,
                   hopper_kg=None if k % 3 else 250.5, shaft_rpm=-0.0, ndvi=0.5, flow_trim=1e-7 if k == 3 else 1.0,
                   state="working", work_switch=k % 2, events='refill 20; "a", b' if k == 7 else None)
            for k in range(60)] + [LogRow(3.1), LogRow(3.1001)]
    first = write_log(tmp_path / "run.csv", run_meta(seed=3, extra={"note": "ß 播"}), rows)
    for source, out in ((first, tmp_path / "run.parquet"), (tmp_path / "run.parquet", tmp_path / "back" / "run.csv")):
        result = CliRunner().invoke(app, ["import", str(source), "--out", str(out)])
        assert result.exit_code == 0, result.output
    assert (tmp_path / "back" / "run.csv").read_bytes() == first.read_bytes()
    assert (tmp_path / "back" / "run.yaml").read_bytes() == first.with_suffix(".yaml").read_bytes()


def test_of_another_program_s_text_every_number_comes_back_the_same(tmp_path: Path) -> None:
    first = tmp_path / "run.csv"
    first.write_text("time_s,hopper_kg,load\r\n" + "".join(
        f"{k / 7:.12f},{100 - k / 3:.17g},{k / 10:.3f}\r\n" for k in range(50)), encoding="utf-8")
    for source, out in ((first, tmp_path / "run.parquet"), (tmp_path / "run.parquet", tmp_path / "back" / "run.csv")):
        assert CliRunner().invoke(app, ["import", str(source), "--out", str(out)]).exit_code == 0
    log, back = read_rows(first), read_rows(tmp_path / "back" / "run.csv")
    for name in ("time_s", "hopper_kg", "load"):
        np.testing.assert_array_equal(log.columns[name], back.columns[name])
