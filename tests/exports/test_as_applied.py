"""Stretches and sums of a known log: where the material lies, how much of it, and what breaks a
stretch."""

from __future__ import annotations

import csv
import dataclasses
import datetime as dt
import itertools
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapefile
from click.testing import Result
from shapely.geometry import Polygon, shape
from topdress.control.field.job import Wanted
from topdress.control.geodesy import TangentPlane
from topdress.control.machine.machine import Machine
from topdress.control.orders import Do, Order, TargetSource
from topdress.drivers.files.exports.as_applied import (
    AsApplied,
    ExportError,
    SpreadProduct,
    build_as_applied,
)
from topdress.drivers.files.exports.export_columns import EXPORT_COLUMNS
from topdress.drivers.files.exports.export_writer import write_as_applied
from topdress.drivers.files.read_log import RunLog, read_log
from topdress.drivers.files.run_log import write_whole_log
from topdress.drivers.files.run_meta import make_run_meta
from topdress.drivers.files.run_setup import load_setup

from tests.control_loop.closed import Closed

PLANE = TangentPlane(34.28, 119.88)
SPEED_MPS, WIDTH_M, DROP_S = 1.25, 2.4, 1.8288 - 0.0083 * 70.0 - 1.69e-3 * 0.0083 * 70.0**2


def test_sums_are_the_logs_own(applied: AsApplied) -> None:
    s, totals = applied.stretches, applied.totals
    area_ha = 60.0 * SPEED_MPS * WIDTH_M / 10_000.0
    assert totals.area_ha == pytest.approx(area_ha, rel=1e-9)
    assert totals.target_kg == pytest.approx(
        (12.0 * 200.0 + 48.0 * 320.0) / 60.0 * area_ha, rel=1e-3
    )
    # trim and rate cancel
    assert totals.applied_kg == pytest.approx(totals.target_kg, rel=1e-3)
    assert s.applied_kg.sum() == pytest.approx(totals.applied_kg, rel=1e-12)
    assert s.target_kg.sum() == pytest.approx(totals.target_kg, rel=1e-12)
    assert s.area_m2.sum() == pytest.approx(10_000.0 * totals.area_ha, rel=1e-12)
    assert totals.applied_n_kg == pytest.approx(0.46 * totals.applied_kg)


def test_each_stretch_lies_where_its_material_landed(applied: AsApplied) -> None:
    """Released in the middle of the stretch, behind the antenna, landed a drop time later."""
    s = applied.stretches
    east, north = PLANE.project_many_to_m(s.lat_deg, s.lon_deg).T
    inner = slice(2, 38)
    assert east[inner] == pytest.approx(np.full(36, 5.0), abs=1e-3)
    assert north[inner] == pytest.approx(SPEED_MPS * (s.time_s[inner] + DROP_S), abs=1e-3)


def test_the_step_of_the_rate_lies_at_its_landing_place(applied: AsApplied) -> None:
    s = applied.stretches
    north = PLANE.project_many_to_m(s.lat_deg, s.lon_deg)[:, 1]
    last_low = north[s.applied_kg_ha < 260.0].max() + 0.5 * SPEED_MPS
    assert last_low == pytest.approx(SPEED_MPS * (12.0 + DROP_S), abs=0.07)


def test_polygons_touch_and_have_the_width(applied: AsApplied) -> None:
    s = applied.stretches
    corners = PLANE.project_many_to_m(
        s.corners_deg[..., 0].ravel(), s.corners_deg[..., 1].ravel()
    ).reshape(-1, 4, 2)
    assert np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1) == pytest.approx(
        np.full(len(corners), 2.4), abs=1e-6
    )
    assert corners[3:30, 3] == pytest.approx(corners[4:31, 0], abs=2e-3)
    # left is west when heading north
    assert (corners[5:30, 0, 0] < corners[5:30, 1, 0]).all()


def test_no_stretch_spans_the_pause(applied: AsApplied) -> None:
    s = applied.stretches
    assert not ((s.time_s > 40.0) & (s.time_s < 44.9)).any()
    assert s.duration_s.max() <= 1.0 + 1e-9
    assert s.duration_s.sum() == pytest.approx(60.0, abs=0.051)


def test_off_field_rows_in_which_nothing_turns_are_no_work(known_log: RunLog) -> None:
    columns = dict(known_log.columns)
    off = known_log.time_s > 50.0
    columns["target_source"] = np.where(off, "none", columns["target_source"])
    still_turning = build_as_applied(dataclasses.replace(known_log, columns=columns)).totals.area_ha
    columns["shaft_rpm_cmd"] = np.where(off, 0.0, columns["shaft_rpm_cmd"])
    columns["shaft_rpm"] = np.where(off, 0.2, columns["shaft_rpm"])
    stopped = build_as_applied(dataclasses.replace(known_log, columns=columns)).totals.area_ha
    assert stopped == pytest.approx(45.0 / 60.0 * still_turning, rel=1e-2)


def test_machine_and_product_can_be_given_where_the_log_names_none(known_log: RunLog) -> None:
    bare = dataclasses.replace(known_log, meta=None)
    with pytest.raises(
        ExportError, match=r"known.csv: no machine file next to the log: allowed is a log with its"
    ):
        build_as_applied(bare)
    wide = Machine().model_copy(
        update={"geometry": Machine().geometry.model_copy(update={"working_width_m": 4.8})}
    )
    given = build_as_applied(bare, wide, SpreadProduct("CAN", 0.27))
    assert given.totals.area_ha == pytest.approx(2 * build_as_applied(known_log).totals.area_ha)
    assert given.totals.applied_n_kg == pytest.approx(0.27 * given.totals.applied_kg)


@pytest.mark.parametrize("column", ["lat_deg", "speed_used_mps", "applied_rate_kg_ha"])
def test_a_log_without_what_is_needed_is_refused_in_one_line(
    known_log: RunLog, column: str
) -> None:
    columns = {name: array for name, array in known_log.columns.items() if name != column}
    with pytest.raises(
        ExportError, match=f"known.csv: column {column}: empty: allowed is a log that has it"
    ):
        build_as_applied(dataclasses.replace(known_log, columns=columns))


def test_a_log_without_work_is_refused(known_log: RunLog) -> None:
    columns = {**known_log.columns, "state": np.full(len(known_log), "ready", object)}
    with pytest.raises(ExportError, match="no row of work"):
        build_as_applied(dataclasses.replace(known_log, columns=columns))


def test_course_over_ground_serves_where_no_heading_was_logged(
    known_log: RunLog, applied: AsApplied
) -> None:
    columns = {name: array for name, array in known_log.columns.items() if name != "heading_deg"}
    found = build_as_applied(dataclasses.replace(known_log, columns=columns)).stretches
    assert found.lat_deg[3:30] == pytest.approx(applied.stretches.lat_deg[3:30], abs=1e-7)


def test_an_unknown_ending_is_refused(applied: AsApplied, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match=r"ending .kml: allowed .geojson"):
        write_as_applied(applied, tmp_path / "x.kml")


def test_isoxml_needs_a_time(known_log: RunLog, tmp_path: Path) -> None:
    columns = {name: array for name, array in known_log.columns.items() if name != "utc"}
    timeless = build_as_applied(dataclasses.replace(known_log, columns=columns))
    with pytest.raises(ExportError, match="no UTC in the log"):
        write_as_applied(timeless, tmp_path / "x.zip")
    write_as_applied(timeless, tmp_path / "x.csv")
    assert (tmp_path / "x.csv").read_text().splitlines()[1].startswith(",0.4")


def test_ground_is_covered_once_and_again_where_the_machine_comes_back(known_log: RunLog) -> None:
    totals = build_as_applied(known_log).totals
    assert totals.covered_ha == pytest.approx(totals.area_ha, rel=0.02) and totals.overlap_ha == 0.0
    assert totals.doses is None
    lat = known_log.numbers("lat_deg").copy()
    half = len(lat) // 2
    lat[half:] = lat[: len(lat) - half]  # the same way once more
    state = known_log.texts("state").copy()
    state[half - 40 : half + 40] = "held"
    twice = dataclasses.replace(
        known_log, columns=known_log.columns | {"lat_deg": lat, "state": state}
    )
    again = build_as_applied(twice).totals
    assert again.overlap_ha is not None and again.covered_ha is not None
    assert again.overlap_ha > 0.3 * again.area_ha
    assert again.covered_ha + again.overlap_ha == pytest.approx(again.area_ha, rel=0.05)


def test_doses_are_counted_from_the_logs_events(known_log: RunLog) -> None:
    events = known_log.texts("events").copy()
    events[100], events[120], events[140] = "dose 120", "mark x;dose 120", "dose_missed busy"
    counted = build_as_applied(
        dataclasses.replace(known_log, columns=known_log.columns | {"events": events})
    ).totals
    assert (counted.doses, counted.doses_missed) == (2, 1)


def _changed(log: RunLog, **columns: np.ndarray) -> RunLog:
    return dataclasses.replace(log, columns=dict(log.columns) | columns)


def test_area_worked_is_one_of_places(known_log: RunLog, applied: AsApplied) -> None:
    """A wheel that reads 1 % fast makes a way longer, not the ground; the mean is what fell
    over the ground."""
    true_ha = 60.0 * SPEED_MPS * WIDTH_M / 10_000.0
    fast = build_as_applied(
        _changed(
            known_log,
            speed_used_mps=1.0104 * known_log.numbers("speed_used_mps"),
            applied_rate_kg_ha=known_log.numbers("applied_rate_kg_ha") / 1.0104,
        )
    )
    for found in (applied, fast):
        assert found.worked_ha == pytest.approx(true_ha, rel=0.004)
        assert found.mean_kg_ha == pytest.approx(296.0, rel=0.005)
    assert fast.totals.area_ha == pytest.approx(1.0104 * true_ha), (
        "the log's own sum goes by its speed"
    )


def test_a_pass_begins_where_material_comes(known_log: RunLog) -> None:
    """0.4 s of dead time at the begin of work: wanted, the shaft stands and reads a little; no
    ground yet."""
    early = known_log.time_s < 0.4
    applied_kg_ha = np.where(early, 1.5, known_log.numbers("applied_rate_kg_ha"))
    found = build_as_applied(_changed(known_log, applied_rate_kg_ha=applied_kg_ha))
    assert found.totals.worked_s == pytest.approx(60.0 - 0.35, abs=0.051)
    nothing_wanted = _changed(
        known_log,
        applied_rate_kg_ha=np.where(early, 0.0, applied_kg_ha),
        target_rate_kg_ha=np.where(early, 0.0, known_log.numbers("target_rate_kg_ha")),
    )
    assert build_as_applied(nothing_wanted).totals.worked_s == pytest.approx(60.0, abs=0.01), (
        "ground with a rate of 0 counts"
    )


# --- As-applied of a machine whose sections have valves: polygons by section, areas of what was
# open -----------------

SECTION_WIDTH_M = 2.4


@pytest.fixture(scope="module")
def by_section(tmp_path_factory: pytest.TempPathFactory):
    """40 s on a pass; from 25 s on the middle section is closed by hand."""
    setup = load_setup("huanghai_sections", "demo", dt.date(2014, 3, 7))
    closed = Closed(setup, target=Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=300.0))
    steps = closed.through(
        40.0, [(1.0, Order(Do.READY)), (5.0, Order(Do.START)), (25.0, Order(Do.SECTION, "2 off"))]
    )
    path = tmp_path_factory.mktemp("log") / "run.csv"
    log = read_log(
        write_whole_log(
            path,
            make_run_meta(setup.machine, setup.crop, closed.job),
            [step.tick.row for step in steps],
        )
    )
    return build_as_applied(log), closed.loop.totals, steps


def test_totals_of_the_log_are_the_loops(by_section):
    found, totals, steps = by_section
    assert found.totals.area_ha == pytest.approx(totals.area_ha, rel=0.01)
    assert found.totals.applied_kg == pytest.approx(totals.applied_kg, rel=0.01)
    assert found.totals.applied_kg == pytest.approx(
        sum(sum(s.truth.section_kg) for s in steps), rel=0.02
    )
    way_m = sum(
        s.truth.speed_mps * 0.05
        for s in steps
        if s.tick.row.state == "working" and s.truth.open_share > 0.0
    )
    assert 10_000.0 * found.totals.area_ha < 0.9 * way_m * SECTION_WIDTH_M, (
        "what was closed is not counted"
    )
    assert found.totals.covered_ha == pytest.approx(found.totals.area_ha, rel=0.03)


def test_every_section_has_stretches_of_its_own(by_section):
    found, _totals, _steps = by_section
    s = found.stretches
    assert s.width_m.tolist() == pytest.approx([SECTION_WIDTH_M / 3.0] * len(s.width_m))
    assert s.area_m2.sum() / 10_000.0 == pytest.approx(found.totals.area_ha, rel=1e-3)
    assert s.applied_kg.sum() == pytest.approx(found.totals.applied_kg, rel=1e-3)
    late = s.time_s > 27.0
    plane = TangentPlane(float(s.lat_deg[0]), float(s.lon_deg[0]))
    east_m = [
        plane.project_to_m(lat, lon)[0]
        for lat, lon in zip(s.lat_deg[late], s.lon_deg[late], strict=True)
    ]
    apart_m = [right - left for left, right in zip(east_m[::2], east_m[1::2], strict=True)]
    assert apart_m == pytest.approx([1.6] * len(apart_m), abs=0.02), "left and right alone"
    places = [
        Polygon(plane.project_many_to_m(corners[:, 0], corners[:, 1]))
        for corners in s.corners_deg[late][:6]
    ]
    left, right = places[::2], places[1::2]
    assert all(one.intersection(other).area < 1e-6 for one in left for other in right)
    assert [one.area for one in places] == pytest.approx(s.area_m2[late][:6].tolist(), rel=0.1)
    widths = {column.name: column for column in EXPORT_COLUMNS}["swath_width_m"].find_values(found)
    assert widths.tolist() == s.width_m.tolist()


def test_it_goes_out_by_section(by_section, tmp_path: Path):
    found, _totals, _steps = by_section
    for name in ("out.geojson", "out.shp", "task"):
        write_as_applied(found, tmp_path / name, polygons=True)
    assert (tmp_path / "out.geojson").read_text(encoding="utf-8").count("Polygon") == len(
        found.stretches.time_s
    )


@pytest.mark.parametrize(("limit_kg_ha", "seconds"), [(300.0, 48.0), (250.0, 48.0), (400.0, 0.0)])
def test_ground_above_the_crops_limit_is_told_in_hectares_and_kilograms(
    known_log: RunLog, limit_kg_ha: float, seconds: float
) -> None:
    """320 kg/ha were wanted for 48 s of work at 1.25 m/s, on the width of the machine."""
    assert known_log.meta is not None and known_log.meta.crop is not None
    meta = dataclasses.replace(
        known_log.meta, crop={**known_log.meta.crop, "max_rate_kg_ha": limit_kg_ha}
    )
    cut = build_as_applied(dataclasses.replace(known_log, meta=meta)).cut
    if not seconds:
        assert cut is None
        return
    assert cut is not None and (cut.limit_kg_ha, cut.highest_kg_ha) == (limit_kg_ha, 320.0)
    assert cut.area_ha == pytest.approx(
        seconds * 1.25 * Machine().geometry.working_width_m / 1e4, rel=0.02
    )
    assert cut.less_kg == pytest.approx(cut.area_ha * (320.0 - limit_kg_ha))


# --- The farm record: sums by product and field, one line a log; the pass as GeoPackage by
# another reader ------------


@pytest.fixture(scope="module")
def logs(topdress: Callable[..., Result], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("logs")
    for seed in (1, 2):
        done = topdress(
            "simulate", "--seconds", "60", "--seed", seed, "--out", folder / f"run{seed}.csv"
        )
        assert done.exit_code == 0, done.output
    return [folder / "run1.csv", folder / "run2.csv"]


@pytest.mark.exam
def test_a_line_for_each_log(
    topdress: Callable[..., Result], logs: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "farm.csv"
    said = topdress("record", *logs, "--price", "0.5", "--currency", "USD", "--out", out)
    assert said.exit_code == 0 and "2 added, 0 replaced" in said.output, said.output
    rows = list(csv.DictReader(out.open(encoding="utf-8")))
    applied = [build_as_applied(read_log(log)) for log in logs]
    for row, one in zip(rows, applied, strict=True):
        kilograms = one.totals.applied_kg
        assert float(row["applied_kg"]) == pytest.approx(kilograms, abs=0.006)
        assert (
            float(row["cost"]) == pytest.approx(0.5 * kilograms, abs=0.006)
            and row["currency"] == "USD"
        )
        assert float(row["nitrogen_kg"]) == pytest.approx(one.totals.applied_n_kg, abs=0.006)
        assert (
            float(row["worked_ha"]) == pytest.approx(one.worked_ha, abs=6e-5)
            and row["simulated"] == "yes"
        )
    total = sum(one.totals.applied_kg for one in applied)
    assert f"{total:.2f}" in said.output and f"{0.5 * total:.2f} USD" in said.output
    again = topdress("record", logs[0], "--out", out)
    assert again.exit_code == 0 and "0 added, 1 replaced" in again.output
    rows = list(csv.DictReader(out.open(encoding="utf-8")))
    assert len(rows) == 2 and rows[0]["cost"] == "" and rows[1]["cost"] != ""


def test_what_is_no_record_stays(
    topdress: Callable[..., Result], logs: list[Path], tmp_path: Path
) -> None:
    mine = tmp_path / "mine.csv"
    mine.write_text("a,b\n1,2\n")
    for words in ((), ("--force",)):
        said = topdress("record", logs[0], "--out", mine, *words)
        assert said.exit_code == 2 and mine.read_text() == "a,b\n1,2\n", said.output
    wrong = topdress("record", logs[0], "--price", "potash=0.4")
    assert wrong.exit_code == 2 and "no log spread that" in wrong.output
    assert topdress("record", logs[0], "--price", "x=-1").exit_code == 2


@pytest.mark.parametrize("polygons", [False, True])
def test_geopackage_by_geopandas(logs: list[Path], polygons: bool, tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    pytest.importorskip("pyogrio", reason="pyogrio is not installed")
    applied: AsApplied = build_as_applied(read_log(logs[0]))
    write_as_applied(applied, tmp_path / "a.gpkg", polygons)
    frame = geopandas.read_file(tmp_path / "a.gpkg")
    s = applied.stretches
    assert len(frame) == len(s.time_s) and str(frame.crs.to_epsg()) == "4326"
    assert float(frame.applied_kg.sum()) == pytest.approx(float(s.applied_kg.sum()), abs=1e-6)
    assert float(frame.area_m2.sum()) == pytest.approx(float(s.area_m2.sum()), abs=1e-3)
    if polygons:
        assert float(frame.to_crs("EPSG:32651").area.sum()) == pytest.approx(
            float(s.area_m2.sum()), rel=0.02
        )


# --- Every format read back by somebody else's reader: the sums are the log's, the places and
# rates the stretches'.


def close(found: float, wanted: float) -> bool:
    return abs(found - wanted) <= 1e-6 * max(1.0, abs(wanted))


def test_csv(applied: AsApplied, tmp_path: Path) -> None:
    write_as_applied(applied, tmp_path / "a.csv")
    with (tmp_path / "a.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(applied.stretches.time_s)
    assert close(sum(float(row["applied_kg"]) for row in rows), applied.totals.applied_kg)
    assert close(sum(float(row["target_kg"]) for row in rows), applied.totals.target_kg)
    assert close(sum(float(row["area_m2"]) for row in rows), 10_000 * applied.totals.area_ha)
    assert rows[0]["utc"].startswith("2026-03-07T23:59:50")
    assert float(rows[20]["applied_rate_kg_ha"]) == pytest.approx(320.0, abs=4.0)


@pytest.mark.parametrize("polygons", [False, True])
def test_geojson_by_shapely(applied: AsApplied, tmp_path: Path, polygons: bool) -> None:
    write_as_applied(applied, tmp_path / "a.geojson", polygons)
    root = json.loads((tmp_path / "a.geojson").read_text())
    features = root["features"]
    assert close(sum(f["properties"]["applied_kg"] for f in features), applied.totals.applied_kg)
    assert close(root["topdress"]["applied_kg"], applied.totals.applied_kg)
    shapes = [shape(f["geometry"]) for f in features]
    assert all(s.is_valid for s in shapes)
    for one, lon, lat in zip(
        shapes, applied.stretches.lon_deg, applied.stretches.lat_deg, strict=True
    ):
        assert (one.centroid.x, one.centroid.y) == pytest.approx((lon, lat), abs=2e-8)
    if polygons:
        # RFC 7946: outlines run counterclockwise
        assert all(s.exterior.is_ccw for s in shapes)
        assert np.mean([s.area for s in shapes[3:30]]) == pytest.approx(
            3.0 / (110_920 * 92_100), rel=2e-3
        )


@pytest.mark.parametrize("polygons", [False, True])
def test_shapefile_by_pyshp(applied: AsApplied, tmp_path: Path, polygons: bool) -> None:
    write_as_applied(applied, tmp_path / "a.shp", polygons)
    with shapefile.Reader(str(tmp_path / "a.shp")) as reader:
        names = [field[0] for field in reader.fields if field[0] != "DeletionFlag"]
        assert all(len(name) <= 10 for name in names)
        records = reader.records()
        assert close(sum(r["APPLIED_KG"] for r in records), applied.totals.applied_kg)
        assert close(sum(r["TARGET_KG"] for r in records), applied.totals.target_kg)
        assert close(sum(r["AREA_M2"] for r in records), 10_000 * applied.totals.area_ha)
        assert records[25]["ISOTIME"].endswith("Z") and records[25]["PRODUCT"] == "urea"
        assert reader.shapeType == (shapefile.POLYGON if polygons else shapefile.POINT)
        if polygons:
            # outlines run clockwise
            assert not any(Polygon(s.points).exterior.is_ccw for s in reader.shapes())


def test_shapefile_and_geojson_by_geopandas(applied: AsApplied, tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    for name in ("a.shp", "a.geojson"):
        write_as_applied(applied, tmp_path / name, polygons=True)
        frame = geopandas.read_file(tmp_path / name)
        column = "APPLIED_KG" if name == "a.shp" else "applied_kg"
        assert frame.crs.to_epsg() == 4326
        assert close(float(frame[column].sum()), applied.totals.applied_kg)
        ground_m2 = frame.to_crs(frame.estimate_utm_crs()).geometry.area.sum()
        assert ground_m2 == pytest.approx(10_000 * applied.totals.area_ha, rel=0.05)


def test_isoxml_by_an_independent_reader(applied: AsApplied, tmp_path: Path) -> None:
    pytest.importorskip("isoxml", reason="isoxml is not installed")
    from isoxml.models.ddi_entities import DDEntity
    from isoxml.util.isoxml_io import isoxml_from_path

    write_as_applied(applied, tmp_path / "task")
    task_data, _ = isoxml_from_path(
        tmp_path / "task" / "TASKDATA.XML", "ignore", read_bin_files=False
    )
    task = task_data.tasks[0]
    totals = {}
    for value in task.times[0].data_log_values:
        entity = DDEntity.from_bytes(value.process_data_ddi)
        totals[entity.name] = (value.process_data_value * entity.bit_resolution, entity.unit)
    grams, area = totals["Application Total Mass in gram [g]"], totals["Total Area"]
    assert grams == (pytest.approx(1000 * applied.totals.applied_kg, abs=0.5), "g")
    assert area == (pytest.approx(10_000 * applied.totals.area_ha, abs=0.5), "m²")
    assert totals["Total Application of Nitrogen"][0] == pytest.approx(
        1000 * applied.totals.applied_n_kg, abs=0.5
    )
    assert task.time_logs[0].filename == "TLG00001"
    assert task_data.partfields[0].polygons and task_data.products[0].designator == "urea"
    described = {DDEntity.from_bytes(d.ddi).name for d in task_data.devices[0].process_data}
    assert "Actual Mass Per Area Application Rate" in described


def test_the_time_logs_bytes_by_the_layout_beside_them(applied: AsApplied, tmp_path: Path) -> None:
    """Decoded from the XML alone, as a farm program does: which attributes are empty, which
    data are named."""
    write_as_applied(applied, tmp_path / "a.zip")
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        layout = ElementTree.fromstring(archive.read("TASKDATA/TLG00001.xml"))
        data = archive.read("TASKDATA/TLG00001.bin")
    position = layout.find("PTN")
    assert position is not None and layout.get("A") == ""
    sizes = {
        "A": "i",
        "B": "i",
        "C": "i",
        "D": "B",
        "E": "H",
        "F": "H",
        "G": "B",
        "H": "I",
        "I": "H",
    }
    held = [key for key in "ABCDEFGHI" if position.get(key) == ""]
    ddis = [int(value.get("A", ""), 16) for value in layout.findall("DLV")]
    at, moments = 0, []
    while at < len(data):
        ms, days = struct.unpack_from("<IH", data, at)
        at += 6
        place = {}
        for key in held:
            (place[key],) = struct.unpack_from("<" + sizes[key], data, at)
            at += struct.calcsize("<" + sizes[key])
        count = data[at]
        at += 1
        values = {}
        for _ in range(count):
            which, value = struct.unpack_from("<Bi", data, at)
            values[ddis[which]] = value
            at += 5
        moments.append(
            (dt.datetime(1980, 1, 1, tzinfo=dt.UTC) + dt.timedelta(days, 0, 0, ms), place, values)
        )
    assert moments[0][0].isoformat().startswith("2026-03-07T23:59:5")
    # the day turns on the way
    assert moments[30][0].isoformat().startswith("2026-03-08T00:00:2")
    assert all(b[0] > a[0] for a, b in itertools.pairwise(moments))
    working = [m for m in moments if m[2].get(141) == 1]
    assert len(working) == len(applied.stretches.time_s)
    assert [m[2][141] for m in moments].count(0) == 2  # at the pause and at the end
    assert working[-1][2][352] == round(1000 * applied.totals.applied_kg)
    assert working[-1][2][116] == round(10_000 * applied.totals.area_ha)
    assert working[5][1]["A"] == round(1e7 * applied.stretches.lat_deg[5])
    assert working[5][1]["B"] == round(1e7 * applied.stretches.lon_deg[5])
    assert (working[5][1]["D"], working[5][1]["F"], working[5][1]["G"]) == (4, 8, 14)
    assert working[5][2][7] == round(100 * applied.stretches.applied_kg_ha[5])
    assert working[5][2][6] == 20_000 and working[20][2][6] == 32_000
    assert working[5][2][67] == 2400 and working[5][2][397] == 1250


@pytest.mark.parametrize(("pause_s", "breaks"), [(0.3, 0), (0.7, 1)])
def test_a_pause_of_half_a_second_ends_the_work_for_the_record(
    applied: AsApplied, pause_s: float, breaks: int
) -> None:
    """The log's own pause and its end are two; a stop is a record more, a millisecond later, of
    no rate."""
    from topdress.drivers.files.exports.isoxml import _iter_time_records

    s = applied.stretches
    later = s._replace(time_s=s.time_s + np.where(np.arange(s.time_s.size) < 10, 0.0, pause_s))
    moments = list(_iter_time_records(dataclasses.replace(applied, stretches=later)))
    assert len(moments) == s.time_s.size + 2 + breaks


def test_what_is_not_known_is_left_out(applied: AsApplied, tmp_path: Path) -> None:
    unknown = applied.stretches._replace(
        target_kg_ha=np.full_like(applied.stretches.time_s, np.nan)
    )
    write_as_applied(dataclasses.replace(applied, stretches=unknown), tmp_path / "u.geojson")
    write_as_applied(dataclasses.replace(applied, stretches=unknown), tmp_path / "u.shp")
    assert (
        json.loads((tmp_path / "u.geojson").read_text())["features"][0]["properties"][
            "target_rate_kg_ha"
        ]
        is None
    )
    with shapefile.Reader(str(tmp_path / "u.shp")) as reader:
        assert reader.record(0)["TARGETRATE"] is None
