"""Every format read back by somebody else's reader: the sums are the log's, the places and rates the stretches'."""
from __future__ import annotations

import csv
import dataclasses
import datetime as dt
import itertools
import json
import struct
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapefile
from shapely.geometry import Polygon, shape

from drivers.files.exports.as_applied import AsApplied
from drivers.files.exports.write import write_as_applied


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
    for one, lon, lat in zip(shapes, applied.stretches.lon_deg, applied.stretches.lat_deg, strict=True):
        assert (one.centroid.x, one.centroid.y) == pytest.approx((lon, lat), abs=2e-8)
    if polygons:
        assert all(s.exterior.is_ccw for s in shapes)          # RFC 7946: outlines run counterclockwise
        assert np.mean([s.area for s in shapes[3:30]]) == pytest.approx(3.0 / (110_920 * 92_100), rel=2e-3)


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
            assert not any(Polygon(s.points).exterior.is_ccw for s in reader.shapes())     # outlines run clockwise


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
    task_data, _ = isoxml_from_path(tmp_path / "task" / "TASKDATA.XML", "ignore", read_bin_files=False)
    task = task_data.tasks[0]
    totals = {}
    for value in task.times[0].data_log_values:
        entity = DDEntity.from_bytes(value.process_data_ddi)
        totals[entity.name] = (value.process_data_value * entity.bit_resolution, entity.unit)
    grams, area = totals["Application Total Mass in gram [g]"], totals["Total Area"]
    assert grams == (pytest.approx(1000 * applied.totals.applied_kg, abs=0.5), "g")
    assert area == (pytest.approx(10_000 * applied.totals.area_ha, abs=0.5), "m²")
    assert totals["Total Application of Nitrogen"][0] == pytest.approx(1000 * applied.totals.applied_n_kg, abs=0.5)
    assert task.time_logs[0].filename == "TLG00001"
    assert task_data.partfields[0].polygons and task_data.products[0].designator == "urea"
    described = {DDEntity.from_bytes(d.ddi).name for d in task_data.devices[0].process_data}
    assert "Actual Mass Per Area Application Rate" in described


def test_the_time_logs_bytes_by_the_layout_beside_them(applied: AsApplied, tmp_path: Path) -> None:
    """Decoded from the XML alone, as a farm program does: which attributes are empty, which data are named."""
    write_as_applied(applied, tmp_path / "a.zip")
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        layout = ElementTree.fromstring(archive.read("TASKDATA/TLG00001.xml"))
        data = archive.read("TASKDATA/TLG00001.bin")
    position = layout.find("PTN")
    assert position is not None and layout.get("A") == ""
    sizes = {"A": "i", "B": "i", "C": "i", "D": "B", "E": "H", "F": "H", "G": "B", "H": "I", "I": "H"}
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
        moments.append((dt.datetime(1980, 1, 1, tzinfo=dt.UTC) + dt.timedelta(days, 0, 0, ms), place, values))
    assert moments[0][0].isoformat().startswith("2026-03-07T23:59:5")
    assert moments[30][0].isoformat().startswith("2026-03-08T00:00:2")      # the day turns on the way
    assert all(b[0] > a[0] for a, b in itertools.pairwise(moments))
    working = [m for m in moments if m[2].get(141) == 1]
    assert len(working) == len(applied.stretches.time_s)
    assert [m[2][141] for m in moments].count(0) == 2                       # at the pause and at the end
    assert working[-1][2][352] == round(1000 * applied.totals.applied_kg)
    assert working[-1][2][116] == round(10_000 * applied.totals.area_ha)
    assert working[5][1]["A"] == round(1e7 * applied.stretches.lat_deg[5])
    assert working[5][1]["B"] == round(1e7 * applied.stretches.lon_deg[5])
    assert (working[5][1]["D"], working[5][1]["F"], working[5][1]["G"]) == (4, 8, 14)
    assert working[5][2][7] == round(100 * applied.stretches.applied_kg_ha[5])
    assert working[5][2][6] == 20_000 and working[20][2][6] == 32_000
    assert working[5][2][67] == 2400 and working[5][2][397] == 1250


@pytest.mark.parametrize(("pause_s", "breaks"), [(0.3, 0), (0.7, 1)])
def test_a_pause_of_half_a_second_ends_the_work_for_the_record(applied: AsApplied, pause_s: float, breaks: int) -> None:
    """The log's own pause and its end are two; a stop is a record more, a millisecond later, of no rate."""
    from drivers.files.exports.isoxml import _moments
    s = applied.stretches
    later = s._replace(time_s=s.time_s + np.where(np.arange(s.time_s.size) < 10, 0.0, pause_s))
    moments = list(_moments(dataclasses.replace(applied, stretches=later)))
    assert len(moments) == s.time_s.size + 2 + breaks


def test_what_is_not_known_is_left_out(applied: AsApplied, tmp_path: Path) -> None:
    unknown = applied.stretches._replace(target_kg_ha=np.full_like(applied.stretches.time_s, np.nan))
    import dataclasses
    write_as_applied(dataclasses.replace(applied, stretches=unknown), tmp_path / "u.geojson")
    write_as_applied(dataclasses.replace(applied, stretches=unknown), tmp_path / "u.shp")
    assert json.loads((tmp_path / "u.geojson").read_text())["features"][0]["properties"]["target_rate_kg_ha"] is None
    with shapefile.Reader(str(tmp_path / "u.shp")) as reader:
        assert reader.record(0)["TARGETRATE"] is None
