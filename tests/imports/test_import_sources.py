"""Kinds of files beside text: the task log that we ourselves export, Excel sheets, points, a
million rows."""

from __future__ import annotations

import datetime as dt
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import polars as pl
import pytest
from click.testing import Result
from topdress.console.services.run_logs import RunLogs
from topdress.drivers.files.any_log import open_any_log
from topdress.drivers.files.columns import count_rows
from topdress.drivers.files.config import load_config
from topdress.drivers.files.exports.as_applied import build_as_applied
from topdress.drivers.files.exports.time_log import (
    LoggedData,
    TimeRecord,
    encode_layout,
    encode_records,
)
from topdress.drivers.files.file_sniffer import has_worked_points
from topdress.drivers.files.imports.convert import convert_table
from topdress.drivers.files.imports.device_description import NumberMeaning
from topdress.drivers.files.imports.guess import guess_import_file
from topdress.drivers.files.imports.import_errors import LogImportError
from topdress.drivers.files.imports.log_file import build_log_columns
from topdress.drivers.files.imports.log_join import join_files
from topdress.drivers.files.imports.mapping import IMPORT_KIND, Source
from topdress.drivers.files.imports.table_reader import read_raw_table
from topdress.drivers.files.imports.time_logs import (
    TOTAL_AREA_DDI,
    WIDTH_DDI,
    WORK_STATE_DDI,
    LoggedValue,
    TimeLog,
    calc_worked_ha,
    find_log_width,
)
from topdress.drivers.files.read_log import read_log

from tests.command import topdress
from tests.geojson import feature, geojson
from tests.imports import task_sets

BEGIN = dt.datetime(2026, 3, 20, 8, 0, tzinfo=dt.UTC)
TASK = (
    '<ISO11783_TaskData VersionMajor="4" VersionMinor="3"><TSK '
    'A="TSK1">{}</TSK></ISO11783_TaskData>'
)


def task_folder(folder: Path, logs: tuple[str, ...] = ("TLG00001",)) -> Path:
    """Target and applied rate, speed, a number that only the device knows; one value now and
    then not in the record."""
    folder.mkdir()
    root = TASK.format("".join(f'<TLG A="{name}"/>' for name in logs)).replace(
        "<TSK", '<DVC A="DVC1"><DPD A="1" B="ABCD" E="Fan pressure"/></DVC><TSK'
    )
    (folder / "TASKDATA.XML").write_text(root)
    data = [
        LoggedData(6, "DET1"),
        LoggedData(7, "DET1"),
        LoggedData(397, "DET1"),
        LoggedData(0xABCD, "DET1"),
        LoggedData(141, "DET1"),
    ]
    moments = [
        TimeRecord(
            BEGIN + dt.timedelta(seconds=k),
            48.0 + 2.0 * k / 111_200.0,
            10.0,
            4 if k else 15,
            0.8,
            12,
            [30_000 + 100 * (k // 5), None if k % 4 == 2 else 29_000 + k, 2000, 55 + k, int(k > 2)],
        )
        for k in range(50)
    ]
    for name in logs:
        (folder / f"{name}.XML").write_bytes(encode_layout(data))
        (folder / f"{name}.BIN").write_bytes(encode_records(moments))
    return folder


def test_a_task_log(topdress: Callable[..., Result], tmp_path: Path) -> None:
    folder = task_folder(tmp_path / "TASKDATA")
    result = topdress("import", folder, "--out", tmp_path / "out.csv")
    assert result.exit_code == 0, result.output
    log = read_log(tmp_path / "out.csv")
    assert len(log) == 50 and log.texts("utc")[1] == "2026-03-20T08:00:01.000Z"
    assert log.numbers("target_rate_kg_ha")[[0, 5]].tolist() == [300.0, 301.0]
    # told on change
    assert log.numbers("applied_rate_kg_ha")[1:4].tolist() == [290.01, 290.01, 290.03]
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
    assert (
        "no whole record: left out" in result.output and len(read_log(tmp_path / "out.csv")) == 49
    )
    two = task_folder(tmp_path / "b", ("TLG00001", "TLG00002"))
    result = topdress("import", two, "--out", tmp_path / "two.csv")
    assert result.exit_code == 2
    assert (
        "TLG00002 begins 2026-03-20 08:00:00, before TLG00001 ends 2026-03-20 08:00:49"
        in result.output
    )
    assert (
        topdress("import", two, "--log", "TLG00002", "--out", tmp_path / "two.csv").exit_code == 0
    )
    (two / "TLG00001.BIN").unlink()
    (tmp_path / "two.csv").unlink()
    (tmp_path / "two.yaml").unlink()
    mapping = tmp_path / "m.yaml"
    mapping.write_text(
        "format: topdress-import/1\nsource: {task_log: TLG00001}\ntime: {column: "
        "utc}\ncolumns: {}\n"
    )
    result = topdress("import", two, "--mapping", mapping, "--out", tmp_path / "two.csv")
    assert (
        result.exit_code == 2
        and "TLG00001.bin, which the task names, is not there" in result.output
    )


@pytest.mark.exam
def test_our_own_task_export_comes_back(topdress: Callable[..., Result], tmp_path: Path) -> None:
    assert (
        topdress(
            "simulate", "--seconds", "60", "--seed", "3", "--out", tmp_path / "a.csv"
        ).exit_code
        == 0
    )
    exported = topdress("map", tmp_path / "a.csv", "--out", tmp_path / "task.zip")
    assert exported.exit_code == 0, exported.output
    result = topdress("import", tmp_path / "task.zip", "--out", tmp_path / "b.csv")
    assert result.exit_code == 0, result.output
    stretches = build_as_applied(read_log(tmp_path / "a.csv")).stretches
    back = read_log(tmp_path / "b.csv")
    worked = back.texts("state") == "working"
    for name, want in (
        ("target_rate_kg_ha", stretches.target_kg_ha),
        ("applied_rate_kg_ha", stretches.applied_kg_ha),
        ("speed_mps", stretches.speed_mps),
        ("lat_deg", stretches.lat_deg),
    ):
        known = np.isfinite(want)
        assert np.abs(back.numbers(name)[worked][known] - want[known]).max() < 0.006, name


def test_excel_with_times_of_its_own_and_two_sheets(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
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
    text = (
        "format: topdress-import/1\nsource: {sheet: %s}\ntime: {column: Time, zone: "
        "Asia/Shanghai}\n"
        "columns: {shaft_rpm: {from: Shaft speed}}\n"
    )
    mapping.write_text(text % "Run 2")
    result = topdress("import", path, "--mapping", mapping, "--out", tmp_path / "out.csv")
    assert result.exit_code == 0, result.output
    log = read_log(tmp_path / "out.csv")
    assert (
        log.time_s[1] == 0.5
        and log.numbers("shaft_rpm")[0] == 50.0
        and log.texts("x_note")[1] == "warm"
    )
    assert log.texts("utc")[0] == "2026-03-20T00:00:00.000Z"
    mapping.write_text(text % "Run 3")
    gone = topdress("import", path, "--mapping", mapping, "--out", tmp_path / "out2.csv")
    assert gone.exit_code == 2 and "source.sheet Run 3: allowed Sheet, Run 2" in gone.output


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "not readable as JSON"),
        ("{}", "no features"),
        (
            json.dumps({"features": [{"geometry": {"type": "Polygon", "coordinates": []}}]}),
            "no feature is a point",
        ),
        (
            json.dumps({"features": [{"geometry": {"type": "Point", "coordinates": ["a", 1]}}]}),
            "are no two numbers",
        ),
    ],
)
def test_geojson_that_holds_no_points(
    content: str,
    said: str,
    written: Callable[..., Path],
    topdress: Callable[..., Result],
    tmp_path: Path,
) -> None:
    result = topdress("import", written(content, "p.geojson"), "--out", tmp_path / "out.csv")
    assert result.exit_code == 2 and said in result.output and len(result.output.splitlines()) == 1


def test_a_long_file_takes_no_more_for_a_row_than_a_short_one(
    topdress: Callable[..., Result], tmp_path: Path
) -> None:
    """Of three numbers each: some calls for a row, and a loop within it would be hundreds."""
    counts = []
    for rows in (1_000, 1_000, 41_000):  # the first time modules are loaded
        k = np.arange(rows)
        frame = pl.DataFrame(
            {
                "Time [s]": k / 10.0,
                "Shaft command [rpm]": 20.0 + 10.0 * (k // 30 % 4),
                "Shaft speed [rpm]": 20.0 + 10.0 * ((k - 1) // 30 % 4),
            }
        )
        frame.write_csv(tmp_path / "long.csv", separator=";")
        lines = 0

        def counted(*_: object) -> None:
            nonlocal lines
            lines += 1

        sys.setprofile(counted)
        try:
            result = topdress(
                "import", tmp_path / "long.csv", "--out", tmp_path / "o.csv", "--force"
            )
        finally:
            sys.setprofile(None)
        assert result.exit_code == 0, result.output
        counts.append(lines)
    assert counts[2] - counts[1] < 25 * 40_000


# --- As-applied files of other programs open where a run log does: replay, diagnosis, map; else
# they are aske... -----

UNITS = ("applied_rate_kg_ha", "target_rate_kg_ha", "speed_mps")


def points(path: Path, told: bool = True) -> Path:
    names = UNITS if told else ("AppRate", "TgtRate", "Speed")
    return geojson(
        path,
        *(
            feature(
                [119.88, 34.28 + 1.35e-5 * k],
                "Point",
                utc=f"2026-03-17T06:{k // 60:02d}:{k % 60:02d}Z",
                **dict(zip(names, (200.0 + k % 7, 205.0, 1.5), strict=True)),
            )
            for k in range(200)
        ),
    )


def run(*words: str) -> str:
    told = topdress(*words)
    assert told.exit_code in (0, 3), told.output
    return told.output


def test_points_are_replayed_diagnosed_and_summed(tmp_path: Path) -> None:
    path = points(tmp_path / "applied.geojson")
    assert has_worked_points(path)
    assert "(run, 200 rows" in run("diagnose", str(path), "--machine", "huanghai")
    assert "200 rows" in run("replay", str(path), "--headless", "--out", str(tmp_path / "r.csv"))
    told = json.loads(run("map", str(path), "--machine", "huanghai", "--json"))
    assert told["area_ha"] == pytest.approx(199 * 1.5 * 2.4 / 1e4)
    assert told["mean_rate_kg_ha"] == pytest.approx(203.0, abs=0.2)
    assert RunLogs().open_log(str(path)).name == "applied.geojson"


def test_what_is_unsure_is_asked_and_nothing_is_left(tmp_path: Path) -> None:
    path = points(tmp_path / "applied.geojson", told=False)
    with pytest.raises(LogImportError, match="no unit in the header"):
        open_any_log(path)
    assert [file.name for file in tmp_path.iterdir()] == ["applied.geojson"]


# --- Task sets with one to thirty time logs: what is imported, asked and refused; areas, rates,
# kilograms and rows against what the generator knows, geopandas, and isoxml.

SPEED_MPS = 2.5  # of every set
Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def said_of(made: Any, task: str, plain: bool) -> Source:
    """What a user would say after the questions; plain: before them."""
    held = "ddi" if made.odd == "contradiction" and not plain else None
    return Source(task=None if plain else task, values_from=held)  # type: ignore[arg-type]


def questions(made: Any, task: str) -> str:
    """What has to be asked of a task though the task is named; empty: nothing."""
    logs = [log for log in made.logs if log.task == task]
    first = task == made.logs[0].task
    if made.odd == "gone" and made.logs[-1].task == task:
        return "is not there"
    if made.odd == "overlap" and first and len(logs) > 1:
        return "allowed are logs that follow one another"
    if made.kind in ("two bins", "volume"):
        return (
            "would fit as well" if made.kind == "two bins" else "is a volume: the product's density"
        )
    return "which says that the machine works" if made.kind == "sections" and len(logs) > 0 else ""


def hectares_by_geopandas(lat: Floats, lon: Floats, utc_s: Floats, width_m: float) -> float:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    there = np.isfinite(lat)
    places = geopandas.GeoSeries.from_xy(lon[there], lat[there], crs="EPSG:4326").to_crs(
        "EPSG:32632"
    )
    steps = (
        places[1:].reset_index(drop=True).distance(places[:-1].reset_index(drop=True)).to_numpy()
    )
    near = np.diff(utc_s[there]) < 1.5
    # UTM's scale on its central meridian
    return float(steps[near].sum()) * width_m / 10_000.0 / 0.9996


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(
            number, marks=() if number in (0, 1, 5, 7, 13, 16, 28, 43) else pytest.mark.exam
        )
        for number in range(60)
    ],
)
def test_a_set(number: int, tmp_path: Path) -> None:
    made = task_sets.task_set(number, tmp_path)
    if len(made.tasks) > 1:
        with pytest.raises(LogImportError) as several:
            read_raw_table(made.path)
        assert f"{len(made.logs)} time logs of {len(made.tasks)} tasks" in several.value.lines[0]
        assert len(several.value.lines) == 1 + len(made.logs)
    if made.odd == "contradiction" and made.kind == "mass":
        with pytest.raises(LogImportError, match="--values-from ddi or presentation"):
            read_raw_table(made.path, Source(task=made.tasks[0]))
    for task in made.tasks:
        wanted = questions(made, task)
        try:
            raw = read_raw_table(made.path, said_of(made, task, plain=False))
        except LogImportError as trouble:
            assert wanted and wanted in str(trouble), trouble
            continue
        found = guess_import_file(raw)
        if wanted:
            assert any(wanted in doubt.text for doubt in found.doubts), found.doubts
            continue
        assert found.is_sure, found.doubts
        columns = build_log_columns(
            join_files([convert_table(raw, found.mapping)], found.mapping.join)
        )
        rows, hectares, kilograms = made.truth(task)
        lost = 1 if made.odd == "cut" and made.logs[-1].task == task else 0
        assert (
            count_rows(columns) == rows
            and sum("no whole record" in str(one) for one in raw.findings) == lost
        )
        time_s = columns["time_s"].astype(float)
        at_work = np.diff(time_s, prepend=-9.0) < 1.5
        rate = columns["applied_rate_kg_ha"]
        area = np.where(at_work, columns["speed_mps"] * made.width_m / 10_000.0, 0.0)
        assert float(area.sum()) == pytest.approx(hectares, abs=1e-9)
        places = hectares_by_geopandas(columns["lat_deg"], columns["lon_deg"], time_s, made.width_m)
        without = (
            sum(3 for log in made.logs if log.task == task and log.rates_kg_ha)
            if made.odd == "no place"
            else 0
        )
        assert places == pytest.approx(
            hectares - without * SPEED_MPS * made.width_m / 10_000.0, rel=1e-4
        )
        assert float((area * rate).sum()) == pytest.approx(kilograms, rel=1e-4)


def test_as_isoxml_sees_it(tmp_path: Path) -> None:
    """The library's tasks, logs, devices and bytes are ours; a time log's numbers it does not
    read."""
    pytest.importorskip("isoxml", reason="isoxml is not installed")
    from isoxml.models.ddi_entities import DDEntity
    from isoxml.util.isoxml_io import isoxml_from_path
    from topdress.drivers.files.imports.device_description import DATA_DICTIONARY
    from topdress.drivers.files.imports.task_log import find_task_logs
    from topdress.drivers.files.imports.units import find_named_unit

    made = task_sets.task_set(20, tmp_path)
    theirs, files = isoxml_from_path(made.path / "TASKDATA.XML")
    ours = find_task_logs(made.path)
    assert ours is not None
    assert [(log.task, log.name) for log in ours.logs] == [
        (task.id, log.filename) for task in theirs.tasks for log in task.time_logs
    ]
    assert all(len(files[log.name]) > 20 * log.rows for log in ours.logs)
    assert sorted(ours.parts) == sorted(
        element.id for device in theirs.devices for element in device.elements
    )
    for ddi, meaning in DATA_DICTIONARY.items():
        book = DDEntity.from_id(ddi)
        if (
            meaning.unit in ("mg/m2", "mg/s", "mm", "mm/s", "g", "kg", "m2", "s")
            and book.unit != "n.a."
        ):
            assert (
                book.unit.replace("²", "2") == meaning.unit and book.bit_resolution == meaning.step
            ), (ddi, book)
        assert not meaning.unit or find_named_unit(meaning.unit) is not None


def test_the_commands(topdress: Callable[..., Result], tmp_path: Path) -> None:
    """Asked with a line for each log; chosen by task, device and log; and by what --guess
    writes."""
    made = task_sets.task_set(31, tmp_path)
    asked = topdress("import", made.path, "--out", tmp_path / "a.csv")
    lines = asked.output.splitlines()
    assert asked.exit_code == 2 and "say which with --task, --device and --log" in lines[0]
    assert (
        "task TSK1 (Field 1), log TLG00001, device DVC1 (Spreader), DVC2 (Tractor): "
        "2024-04-01 07:00:00" in lines[1]
    )
    assert (
        " rows, " in lines[1]
        and " ha (way x width); target rate, applied rate, speed, work state" in lines[1]
    )
    nobody = topdress("import", made.path, "--task", "North", "--out", tmp_path / "a.csv")
    assert nobody.exit_code == 2 and "task North: no such time log" in nobody.output
    guessed = topdress(
        "import", made.path, "--task", "Field 2", "--guess", "--mapping", tmp_path / "m.yaml"
    )
    assert guessed.exit_code == 0 and "DET3 is Bin 2 of Spreader" in guessed.output
    mapping = load_config(tmp_path / "m.yaml", IMPORT_KIND).model
    assert mapping.source.task == "Field 2" and mapping.source.task_log is None
    done = topdress(
        "import", made.path, "--mapping", tmp_path / "m.yaml", "--out", tmp_path / "a.csv"
    )
    assert done.exit_code == 0 and f"{len(made.logs[1].rates_kg_ha)} rows" in done.output
    tractor = topdress(
        "import", made.path, "--task", "TSK1", "--device", "Tractor", "--out", tmp_path / "t.csv"
    )
    assert (
        tractor.exit_code == 0
        and "applied_rate" not in tractor.output
        and "speed_mps" in tractor.output
    )
    one = task_sets.task_set(21, tmp_path)
    single = topdress("import", one.path, "--log", "TLG00003", "--out", tmp_path / "s.csv")
    assert single.exit_code == 0 and f"{len(one.logs[2].rates_kg_ha)} rows" in single.output


def logged(**numbers: tuple[int, list[float]]) -> TimeLog:
    """A log of twenty records, a metre and a bit apart, with these numbers: identifier and raw
    values."""
    count = 20
    heads = {"lat_deg": 52.0 + np.arange(count) * 1e-5, "lon_deg": np.full(count, 9.0)}
    values = [
        LoggedValue(ddi, "DET1", None, NumberMeaning(name), None)
        for name, (ddi, _) in numbers.items()
    ]
    return TimeLog(
        "TLG00001",
        "TSK1",
        "",
        tuple(values),
        heads,
        np.array([np.resize(np.array(raw, np.float64), count) for _, raw in numbers.values()]),
    )


def test_the_hectares_of_a_log_are_its_devices_count_else_way_times_logged_width() -> None:
    """Widths are logged in mm, areas in m2; a width that changes is none; what is driven lifted
    does not count."""
    way_m = 19 * 1e-5 * 111_267.0  # of latitude at 52 degrees, m
    wide = logged(width=(WIDTH_DDI, [18_000.0]))
    assert find_log_width(wide, {}) == 18.0
    area = calc_worked_ha(wide, {})
    assert (
        area is not None
        and area[1] == "way x width"
        and area[0] == pytest.approx(way_m * 18.0 / 1e4, rel=2e-3)
    )
    half = calc_worked_ha(
        logged(width=(WIDTH_DDI, [18_000.0]), work=(WORK_STATE_DDI, [1.0, 0.0])), {}
    )
    assert half is not None and half[0] == pytest.approx(area[0] * 9 / 19, rel=1e-3)
    counted = calc_worked_ha(
        logged(
            width=(WIDTH_DDI, [18_000.0]), area=(TOTAL_AREA_DDI, list(5e4 + 250.0 * np.arange(20)))
        ),
        {},
    )
    assert counted == (pytest.approx(19 * 250.0 / 1e4), "counted")
    assert find_log_width(logged(width=(WIDTH_DDI, [18_000.0, 9_000.0])), {}) is None
    assert calc_worked_ha(logged(work=(WORK_STATE_DDI, [1.0])), {}) is None
