"""Kinds of files beside text: the task log that we ourselves export, Excel sheets, points, a million rows."""
from __future__ import annotations

import datetime as dt
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import openpyxl
import polars as pl
import pytest
from click.testing import Result
from typer.testing import CliRunner

from console.cli import app
from console.services.logs import RunLogs
from drivers.files.any_log import open_log
from drivers.files.exports.as_applied import as_applied
from drivers.files.exports.time_log import Logged, TimeRecord, layout, records
from drivers.files.imports.trouble import ImportTrouble
from drivers.files.read_log import read_log
from drivers.files.what_it_is import holds_points

BEGIN = dt.datetime(2026, 3, 20, 8, 0, tzinfo=dt.UTC)
TASK = '<ISO11783_TaskData VersionMajor="4" VersionMinor="3"><TSK A="TSK1">{}</TSK></ISO11783_TaskData>'


def task_folder(folder: Path, logs: tuple[str, ...] = ("TLG00001",)) -> Path:
    """Target and applied rate, speed, a number that only the device knows; one value now and then not in the record."""
    folder.mkdir()
    root = TASK.format("".join(f'<TLG A="{name}"/>' for name in logs)).replace(
        "<TSK", '<DVC A="DVC1"><DPD A="1" B="ABCD" E="Fan pressure"/></DVC><TSK')
    (folder / "TASKDATA.XML").write_text(root)
    data = [Logged(6, "DET1"), Logged(7, "DET1"), Logged(397, "DET1"), Logged(0xABCD, "DET1"), Logged(141, "DET1")]
    moments = [TimeRecord(BEGIN + dt.timedelta(seconds=k), 48.0 + 2.0 * k / 111_200.0, 10.0, 4 if k else 15, 0.8, 12,
                          [30_000 + 100 * (k // 5), None if k % 4 == 2 else 29_000 + k, 2000, 55 + k, int(k > 2)])
               for k in range(50)]
    for name in logs:
        (folder / f"{name}.XML").write_bytes(layout(data))
        (folder / f"{name}.BIN").write_bytes(records(moments))
    return folder


def test_a_task_log(topdress: Callable[..., Result], tmp_path: Path) -> None:
    folder = task_folder(tmp_path / "TASKDATA")
    result = topdress("import", folder, "--out", tmp_path / "out.csv")
    assert result.exit_code == 0, result.output
    log = read_log(tmp_path / "out.csv")
    assert len(log) == 50 and log.texts("utc")[1] == "2026-03-20T08:00:01.000Z"
    assert log.numbers("target_rate_kg_ha")[[0, 5]].tolist() == [300.0, 301.0]
    assert log.numbers("applied_rate_kg_ha")[1:4].tolist() == [290.01, 290.01, 290.03]     # told on change
    assert set(log.numbers("speed_mps")) == {2.0} and log.numbers("x_fan_pressure")[3] == 58.0
    assert np.isnan(log.numbers("fix_quality")[0]) and log.numbers("fix_quality")[1] == 4.0
    assert log.numbers("satellites")[0] == 12.0 and log.numbers("hdop")[0] == 0.8
    assert log.numbers("lat_deg")[49] == pytest.approx(48.0 + 98.0 / 111_200.0, abs=1e-7)
    assert log.texts("state")[[0, 3]].tolist() == ["ready", "working"]


def test_a_cut_task_log_and_one_of_several(topdress: Callable[..., Result], tmp_path: Path) -> None:
    folder = task_folder(tmp_path / "a")
    data = (folder / "TLG00001.BIN").read_bytes()
    (folder / "TLG00001.BIN").write_bytes(data[:-7])
    result = topdress("import", folder, "--out", tmp_path / "out.csv")
    assert "no whole record: left out" in result.output and len(read_log(tmp_path / "out.csv")) == 49
    two = task_folder(tmp_path / "b", ("TLG00001", "TLG00002"))
    result = topdress("import", two, "--out", tmp_path / "two.csv")
    assert result.exit_code == 2
    assert "TLG00002 begins 2026-03-20 08:00:00, before TLG00001 ends 2026-03-20 08:00:49" in result.output
    assert topdress("import", two, "--log", "TLG00002", "--out", tmp_path / "two.csv").exit_code == 0
    (two / "TLG00001.BIN").unlink()
    (tmp_path / "two.csv").unlink()
    (tmp_path / "two.yaml").unlink()
    mapping = tmp_path / "m.yaml"
    mapping.write_text("format: topdress-import/1\nsource: {task_log: TLG00001}\ntime: {column: utc}\ncolumns: {}\n")
    result = topdress("import", two, "--mapping", mapping, "--out", tmp_path / "two.csv")
    assert result.exit_code == 2 and "TLG00001.bin, which the task names, is not there" in result.output


def test_our_own_task_export_comes_back(topdress: Callable[..., Result], tmp_path: Path) -> None:
    assert topdress("simulate", "--seconds", "60", "--seed", "3", "--out", tmp_path / "a.csv").exit_code == 0
    exported = topdress("map", tmp_path / "a.csv", "--out", tmp_path / "task.zip")
    assert exported.exit_code == 0, exported.output
    result = topdress("import", tmp_path / "task.zip", "--out", tmp_path / "b.csv")
    assert result.exit_code == 0, result.output
    stretches = as_applied(read_log(tmp_path / "a.csv")).stretches
    back = read_log(tmp_path / "b.csv")
    worked = back.texts("state") == "working"
    for name, want in (("target_rate_kg_ha", stretches.target_kg_ha), ("applied_rate_kg_ha", stretches.applied_kg_ha),
                       ("speed_mps", stretches.speed_mps), ("lat_deg", stretches.lat_deg)):
        known = np.isfinite(want)
        assert np.abs(back.numbers(name)[worked][known] - want[known]).max() < 0.006, name


def test_excel_with_times_of_its_own_and_two_sheets(topdress: Callable[..., Result], tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    first, second = book.active, book.create_sheet("Run 2")
    assert first is not None
    for sheet, base in ((first, 30.0), (second, 50.0)):
        sheet.append(["Shaft test"])
        sheet.append(["Time", "Shaft speed", "Note"])
        sheet.append([None, "rpm", None])
        for k in range(30):
            moment = dt.datetime(2026, 3, 20, 8, 0, 0) + dt.timedelta(seconds=0.5 * k)
            sheet.append([moment, base + k, "warm" if k else None])
    path = tmp_path / "bench.xlsx"
    book.save(path)
    refused = topdress("import", path, "--out", tmp_path / "out.csv")
    assert refused.exit_code == 2 and "2 sheets hold tables: say source.sheet" in refused.output
    mapping = tmp_path / "m.yaml"
    text = ("format: topdress-import/1\nsource: {sheet: %s}\ntime: {column: Time, zone: Asia/Shanghai}\n"
            "columns: {shaft_rpm: {from: Shaft speed}}\n")
    mapping.write_text(text % "Run 2")
    result = topdress("import", path, "--mapping", mapping, "--out", tmp_path / "out.csv")
    assert result.exit_code == 0, result.output
    log = read_log(tmp_path / "out.csv")
    assert log.time_s[1] == 0.5 and log.numbers("shaft_rpm")[0] == 50.0 and log.texts("x_note")[1] == "warm"
    assert log.texts("utc")[0] == "2026-03-20T00:00:00.000Z"
    mapping.write_text(text % "Run 3")
    gone = topdress("import", path, "--mapping", mapping, "--out", tmp_path / "out2.csv")
    assert gone.exit_code == 2 and "source.sheet Run 3: allowed Sheet, Run 2" in gone.output


@pytest.mark.parametrize(("content", "said"), [
    ("{", "not readable as JSON"), ("{}", "no features"),
    (json.dumps({"features": [{"geometry": {"type": "Polygon", "coordinates": []}}]}), "no feature is a point"),
    (json.dumps({"features": [{"geometry": {"type": "Point", "coordinates": ["a", 1]}}]}), "are no two numbers"),
])
def test_geojson_that_holds_no_points(content: str, said: str, written: Callable[..., Path],
                                      topdress: Callable[..., Result], tmp_path: Path) -> None:
    result = topdress("import", written(content, "p.geojson"), "--out", tmp_path / "out.csv")
    assert result.exit_code == 2 and said in result.output and len(result.output.splitlines()) == 1


def test_a_long_file_takes_no_loop_over_its_rows(topdress: Callable[..., Result], tmp_path: Path) -> None:
    """A hundred times as many rows, about as many calls: nothing is called for each row."""
    counts = []
    for rows in (1_000, 1_000, 100_000):            # the first time modules are loaded
        k = np.arange(rows)
        frame = pl.DataFrame({"Time [s]": k / 10.0, "Shaft command [rpm]": 20.0 + 10.0 * (k // 30 % 4),
                              "Shaft speed [rpm]": 20.0 + 10.0 * ((k - 1) // 30 % 4)})
        frame.write_csv(tmp_path / "long.csv", separator=";")
        lines = 0

        def counted(*_: object) -> None:
            nonlocal lines
            lines += 1
        sys.setprofile(counted)
        try:
            result = topdress("import", tmp_path / "long.csv", "--out", tmp_path / "o.csv", "--force")
        finally:
            sys.setprofile(None)
        assert result.exit_code == 0, result.output
        counts.append(lines)
    assert counts[2] < 2 * counts[1]


# --- As-applied files of other programs open where a run log does: replay, diagnosis, map; else they are aske... -----

UNITS = ("applied_rate_kg_ha", "target_rate_kg_ha", "speed_mps")


def points(path: Path, told: bool = True) -> Path:
    names = UNITS if told else ("AppRate", "TgtRate", "Speed")
    features = [{"type": "Feature", "geometry": {"type": "Point", "coordinates": [119.88, 34.28 + 1.35e-5 * k]},
                 "properties": {"utc": f"2026-03-17T06:{k // 60:02d}:{k % 60:02d}Z",
                                **dict(zip(names, (200.0 + k % 7, 205.0, 1.5), strict=True))}} for k in range(200)]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def run(*words: str) -> str:
    told = CliRunner().invoke(app, list(words))
    assert told.exit_code in (0, 3), told.output
    return told.output


def test_points_are_replayed_diagnosed_and_summed(tmp_path: Path) -> None:
    path = points(tmp_path / "applied.geojson")
    assert holds_points(path)
    assert "(run, 200 rows" in run("diagnose", str(path), "--machine", "huanghai")
    assert "200 rows" in run("replay", str(path), "--headless", "--out", str(tmp_path / "r.csv"))
    told = json.loads(run("map", str(path), "--machine", "huanghai", "--json"))
    assert told["area_ha"] == pytest.approx(199 * 1.5 * 2.4 / 1e4)
    assert told["mean_rate_kg_ha"] == pytest.approx(203.0, abs=0.2)
    assert RunLogs().open(str(path)).name == "applied.geojson"


def test_what_is_unsure_is_asked_and_nothing_is_left(tmp_path: Path) -> None:
    path = points(tmp_path / "applied.geojson", told=False)
    with pytest.raises(ImportTrouble, match="no unit in the header"):
        open_log(path)
    assert [file.name for file in tmp_path.iterdir()] == ["applied.geojson"]
