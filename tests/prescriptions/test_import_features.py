"""Shapefile and GeoJSON prescriptions: columns, units, scales, holes, round trips, and broken
ones."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapefile
from topdress.control.targets.prescription import (
    Fallbacks,
    GridDeg,
    MapData,
    Zone,
    calc_rate_shares,
)
from topdress.drivers.files.prescriptions.map_choices import GAL_AC_L_HA, LB_AC_KG_HA, RateChoice
from topdress.drivers.files.prescriptions.map_projection import TransverseMercator, parse_projection
from topdress.drivers.files.prescriptions.map_reader import read_prescription
from topdress.drivers.files.prescriptions.map_writer import write_prescription
from topdress.drivers.plain_text import RefusedInput

from tests.geojson import collection, feature

SQUARE = [[116.0, 40.0], [116.001, 40.0], [116.001, 40.001], [116.0, 40.001], [116.0, 40.0]]
HOLE = [[116.0002, 40.0002], [116.0002, 40.0004], [116.0004, 40.0004], [116.0002, 40.0002]]
EAST = [[lon + 0.001, lat] for lon, lat in SQUARE]


@pytest.fixture
def geojson(tmp_path: Path) -> Path:
    file = tmp_path / "map.geojson"
    file.write_text(
        collection(feature([SQUARE, HOLE], rate=120.0, id=1), feature([EAST], rate=80, id=2))
    )
    return file


@pytest.fixture
def shape(tmp_path: Path) -> Path:
    with shapefile.Writer(str(tmp_path / "map"), shapeType=shapefile.POLYGON) as writer:
        writer.field("Zone", "C", 20)
        writer.field("TgtRate", "N", 12, 3)
        writer.field("Count", "N", 8, 0)
        writer.poly([SQUARE[::-1], HOLE[::-1]])
        writer.record("a", 120.5, 3)
        writer.poly([EAST[::-1]])
        writer.record("b", 80.0, 4)
    return tmp_path / "map.shp"


def rates(path: Path, **choice: Any) -> list[float]:
    return [zone.rate_kg_ha for zone in read_prescription(path, RateChoice(**choice)).data.zones]


def test_geojson_by_name_with_holes(geojson: Path) -> None:
    data = read_prescription(geojson).data
    assert [(z.rate_kg_ha, len(z.rings_deg)) for z in data.zones] == [(120.0, 2), (80.0, 1)]
    assert data.zones[0].rings_deg[0][0].tolist() == [40.0, 116.0]


@pytest.mark.parametrize(
    ("choice", "wanted"),
    [
        ({"unit": "lb/ac"}, 120.0 * LB_AC_KG_HA),
        ({"unit": "g/m2"}, 1200.0),
        ({"scale": 1.5}, 180.0),
        ({"unit": "l/ha", "density_kg_l": 1.28}, 153.6),
        ({"unit": "gal/ac", "density_kg_l": 1.0}, 120.0 * GAL_AC_L_HA),
        ({"unit": "kg N/ha", "n_fraction": 0.46}, 120.0 / 0.46),
        ({"column": "id"}, 1.0),
    ],
)
def test_units_scale_and_column(geojson: Path, choice: dict[str, Any], wanted: float) -> None:
    assert rates(geojson, **choice)[0] == pytest.approx(wanted)


def test_pounds_and_gallons() -> None:
    assert pytest.approx(1.12085, rel=1e-5) == LB_AC_KG_HA
    assert pytest.approx(9.35396, rel=1e-5) == GAL_AC_L_HA


def test_multipolygons_and_what_is_no_polygon(tmp_path: Path) -> None:
    file = tmp_path / "m.json"
    file.write_text(
        collection(
            feature([[SQUARE], [EAST]], "MultiPolygon", dose=50.0),
            feature([116.0, 40.0], "Point", dose=1.0),
            feature([EAST], dose=None),
        )
    )
    read = read_prescription(file)
    assert [zone.rate_kg_ha for zone in read.data.zones] == [50.0, 50.0]
    assert [f.id for f in read.findings] == ["not_polygons", "empty_rates"]


def test_shapefile_and_its_zip(shape: Path, tmp_path: Path) -> None:
    assert rates(shape) == [120.5, 80.0]
    assert [len(zone.rings_deg) for zone in read_prescription(shape).data.zones] == [2, 1]
    with zipfile.ZipFile(tmp_path / "z.zip", "w") as archive:
        for ending in (".shp", ".shx", ".dbf"):
            archive.write(shape.with_suffix(ending), f"map{ending}")
    assert rates(tmp_path / "z.zip") == [120.5, 80.0]
    assert rates(shape, column="Count", scale=10.0) == [30.0, 40.0]


def test_a_column_must_be_chosen_where_none_speaks_for_itself(tmp_path: Path) -> None:
    file = tmp_path / "m.geojson"
    file.write_text(collection(feature([SQUARE], a=1.0, b=2.0, name="x")))
    with pytest.raises(RefusedInput, match="rate column not chosen: allowed a, b"):
        read_prescription(file)
    with pytest.raises(RefusedInput, match="column c: allowed a, b, name"):
        read_prescription(file, RateChoice(column="c"))


@pytest.mark.parametrize("ending", [".geojson", ".shp"])
def test_what_is_written_reads_equal(tmp_path: Path, ending: str) -> None:
    rng = np.random.default_rng(4)
    zones = tuple(
        Zone(
            float(rate),
            (np.array(SQUARE)[:-1, ::-1] + k * 0.002, np.array(HOLE)[:-1, ::-1] + k * 0.002),
        )
        for k, rate in enumerate(rng.uniform(0, 400, 5).round(2))
    )
    data = MapData(
        zones, None, Fallbacks(10.0, 20.0, 30.0), ((zones[0].rings_deg[0],),), "north", "urea"
    )
    write_prescription(data, tmp_path / f"out{ending}")
    again = read_prescription(tmp_path / f"out{ending}").data
    assert [z.rate_kg_ha for z in again.zones] == [z.rate_kg_ha for z in zones]
    for one, other in zip(zones, again.zones, strict=True):
        assert [sorted(map(tuple, ring.tolist())) for ring in one.rings_deg] == [
            sorted(map(tuple, ring.tolist())) for ring in other.rings_deg
        ]
    if ending == ".geojson":
        assert (again.fallbacks, again.title, again.product) == (data.fallbacks, "north", "urea")
        assert np.array_equal(again.fields_deg[0][0], data.fields_deg[0][0])


def test_a_grid_becomes_one_polygon_a_cell(tmp_path: Path) -> None:
    grid = GridDeg(40.0, 116.0, 1e-4, 1e-4, np.array([[100.0, np.nan], [50.0, 75.0]]))
    write_prescription(MapData(grid=grid), tmp_path / "g.shp")
    again = read_prescription(tmp_path / "g.shp").data
    assert [z.rate_kg_ha for z in again.zones] == [100.0, 50.0, 75.0]
    mass = [sum(s.mass_kg for s in calc_rate_shares(data)) for data in (MapData(grid=grid), again)]
    assert mass[0] == pytest.approx(mass[1], rel=1e-9)


def test_an_independent_reader_sees_the_same_shapefile(tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    zones = (Zone(123.45, (np.array(SQUARE)[:-1, ::-1], np.array(HOLE)[:-1, ::-1])),)
    write_prescription(MapData(zones), tmp_path / "o.shp")
    frame = geopandas.read_file(tmp_path / "o.shp")
    assert frame.crs.to_epsg() == 4326
    assert frame["rate_kg_ha"].tolist() == [123.45]
    assert frame.geometry[0].area == pytest.approx(1e-6 - 0.5 * 2e-4 * 2e-4, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not readable as JSON"),
        ('{"type": "Feature"}', "type Feature: allowed FeatureCollection"),
        ("[]", "type list"),
        (collection(), "no polygons"),
        (collection(feature([SQUARE], rate="x")), "not chosen"),
        (collection(feature([SQUARE], rate=-1.0)), "row 1: rate: rate -1 kg/ha: allowed 0 to"),
        (collection(feature([SQUARE], rate=1e9)), "is the unit right"),
        (
            collection(
                feature(
                    [[[500000.0, 4400000.0], [500010.0, 4400000.0], [500010.0, 4400010.0]]],
                    rate=1.0,
                )
            ),
            "allowed are degrees",
        ),
        (collection(feature([[["a", "b"]]], rate=1.0)), "feature 1: coordinates are not rings"),
        (collection(feature([[[1.0, 2.0]]], rate=1.0)), "ring of less than 3 corners"),
        (collection(feature([SQUARE], rate=None)), "not chosen"),
        (
            collection(feature([SQUARE], rate=1.0), crs={"properties": {"name": "EPSG:25833"}}),
            "allowed is WGS84",
        ),
    ],
)
def test_broken_geojson_is_said_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "broken.geojson"
    file.write_text(text)
    with pytest.raises(RefusedInput, match=words) as caught:
        read_prescription(file)
    assert "\n" not in str(caught.value) and "broken.geojson" in str(caught.value)


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        ({"unit": "bags"}, "unit bags: allowed kg/ha"),
        ({"scale": 0.0}, "scale 0: allowed is above 0"),
        ({"unit": "l/ha"}, "density None: allowed"),
        ({"unit": "kg N/ha", "n_fraction": 1.4}, "nitrogen 1.4"),
        ({"default_kg_ha": -3.0}, "default_kg_ha: rate -3"),
        ({"outside_kg_ha": float("nan")}, "outside_kg_ha"),
    ],
)
def test_impossible_choices_are_said_in_one_line(
    geojson: Path, choice: dict[str, Any], words: str
) -> None:
    with pytest.raises(RefusedInput, match=words):
        read_prescription(geojson, RateChoice(**choice))


BEIJING = (
    'GEOGCS["GCS_Beijing_1954",DATUM["D_Beijing_1954",SPHEROID["Krasovsky_1940",6378245.0,298.3]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]'
)
WGS84 = (
    'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]'
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('PROJCS["Zone",GEOGCS["x"]]', "coordinates in Zone: without GEOGCS and PROJECTION"),
        (
            f'PROJCS["Albers",{WGS84},PROJECTION["Albers"],UNIT["Meter",1.0]]',
            "Albers: projection Albers",
        ),
        (
            f'PROJCS["GK20",{BEIJING},PROJECTION["Gauss_Kruger"],'
            'PARAMETER["Central_Meridian",117.0]]',
            "GK20: datum D_Beijing_1954 on spheroid Krasovsky_1940 may lie 100 m off WGS84",
        ),
        (
            f'PROJCS["TM",{WGS84},PROJECTION["Transverse_Mercator"]]',
            "TM: without a central meridian",
        ),
        ("nonsense", "not well-known text"),
        ('PROJCRS["new",BASEGEOGCRS["x"]]', "new: PROJCRS is not understood"),
        ("PROJCS[", "not well-known text"),
    ],
)
def test_coordinates_that_cannot_be_used_are_said_in_one_line(
    shape: Path, text: str, words: str
) -> None:
    shape.with_suffix(".prj").write_text(text)
    with pytest.raises(RefusedInput, match=words) as caught:
        read_prescription(shape)
    assert "allowed are degrees on WGS84" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("ending", [".shp", ".dbf"])
@pytest.mark.parametrize("keep", [0, 50, 110, 0.6])
def test_a_cut_shapefile_is_said_in_one_line(shape: Path, ending: str, keep: float) -> None:
    file = shape.with_suffix(ending)
    data = file.read_bytes()
    file.write_bytes(data[: keep if isinstance(keep, int) else int(keep * len(data))])
    with pytest.raises(RefusedInput) as caught:
        read_prescription(shape)
    assert "\n" not in str(caught.value) and "map.shp" in str(caught.value)


def test_what_is_not_there_and_what_is_no_prescription(tmp_path: Path) -> None:
    (tmp_path / "x.txt").write_text("hello")
    (tmp_path / "x.zip").write_bytes(b"PK no")
    for name, words in (
        ("no.shp", "not there"),
        ("x.txt", "no prescription"),
        ("x.zip", "x.zip: "),
    ):
        with pytest.raises(RefusedInput, match=words):
            read_prescription(tmp_path / name)
    (tmp_path / "empty").mkdir()
    with pytest.raises(RefusedInput, match="no prescription: allowed is GeoJSON, shapefile"):
        read_prescription(tmp_path / "empty")


# --- Shapefiles in metres of a transverse Mercator projection, against an independent library
# ------------------------

pyproj = pytest.importorskip("pyproj", reason="pyproj, the independent reader, is not installed")

# lon, lat
CORNERS_DEG = [(119.880, 34.280), (119.883, 34.281), (119.884, 34.284), (119.879, 34.283)]
HOLE_DEG = [(119.8810, 34.2815), (119.8812, 34.2820), (119.8816, 34.2816)]


@pytest.mark.parametrize(
    ("epsg", "places"),
    [
        (32650, [(34.28, 119.88), (0.0, 117.0), (60.0, 114.5)]),
        (32750, [(-33.9, 118.6), (-0.001, 120.0)]),
        (4549, [(34.28, 119.88), (45.0, 121.4)]),
        (4527, [(35.0, 117.5)]),
        (25832, [(52.1, 8.9), (70.0, 12.0)]),
        (26914, [(41.0, -98.0)]),
        (27700, None),
        (2326, None),
        (28992, None),
    ],
)
def test_degrees_are_those_of_the_library(
    epsg: int, places: list[tuple[float, float]] | None
) -> None:
    crs = pyproj.CRS.from_epsg(epsg)
    text = crs.to_wkt("WKT1_ESRI")
    if places is None:
        with pytest.raises(ValueError, match=r"spheroid|projection"):
            parse_projection(text)
        return
    forward = pyproj.Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)
    lat, lon = np.array(places).T
    east, north = forward.transform(lon, lat)
    projection = parse_projection(text)
    assert projection is not None
    found = projection.to_deg(np.asarray(east), np.asarray(north))
    assert np.abs(np.array(found) - np.array([lat, lon])).max() < 1e-9, "0.1 mm"


def test_an_origin_off_the_equator_and_another_unit() -> None:
    text = (
        "+proj=tmerc +lat_0=38.5 +lon_0=-96 +k=0.9999 +x_0=500000 +y_0=100000 +ellps=GRS80 "
        "+units=us-ft +no_defs"
    )
    forward = pyproj.Transformer.from_crs(4269, pyproj.CRS.from_proj4(text), always_xy=True)
    east, north = forward.transform(np.array([-96.4]), np.array([39.2]))
    foot = 1200.0 / 3937.0
    ours = TransverseMercator(
        "feet", -96.0, 38.5, 0.9999, 500000 / foot, 100000 / foot, foot, 1.0 / 298.257222101
    )
    lat, lon = ours.to_deg(np.asarray(east), np.asarray(north))
    assert (lat[0], lon[0]) == pytest.approx((39.2, -96.4), abs=1e-9)


@pytest.fixture
def projected(tmp_path: Path) -> Path:
    forward = pyproj.Transformer.from_crs(4326, 32650, always_xy=True)
    path = tmp_path / "utm.shp"
    with shapefile.Writer(str(path), shapeType=shapefile.POLYGON) as writer:
        writer.field("rate", "N", 10, 2)
        writer.poly(
            [
                [forward.transform(*corner) for corner in reversed(CORNERS_DEG)],
                [forward.transform(*corner) for corner in reversed(HOLE_DEG)],
            ]
        )
        writer.record(210.0)
        writer.null()
        writer.record(99.0)
    path.with_suffix(".prj").write_text(pyproj.CRS.from_epsg(32650).to_wkt("WKT1_ESRI"))
    return path


def test_a_shapefile_in_utm_lies_where_it_belongs(projected: Path, tmp_path: Path) -> None:
    read = read_prescription(projected)
    (zone,) = read.data.zones
    assert len(zone.rings_deg) == 2
    got = {(round(lon, 8), round(lat, 8)) for ring in zone.rings_deg for lat, lon in ring}
    assert got == {(round(lon, 8), round(lat, 8)) for lon, lat in CORNERS_DEG + HOLE_DEG}
    assert any(
        "WGS_1984_UTM_Zone_50N taken to degrees" in finding.text for finding in read.findings
    )
    geod = pyproj.Geod(ellps="WGS84")
    area = abs(geod.polygon_area_perimeter(*zip(*CORNERS_DEG, strict=True))[0])
    hole = abs(geod.polygon_area_perimeter(*zip(*HOLE_DEG, strict=True))[0])
    assert sum(s.area_ha for s in calc_rate_shares(read.data)) == pytest.approx(
        (area - hole) / 1e4, rel=1e-5
    )
    packed = tmp_path / "utm.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        for ending in (".shp", ".shx", ".dbf", ".prj"):
            archive.write(projected.with_suffix(ending), f"utm{ending}")
    again = read_prescription(packed)
    assert np.array_equal(again.data.zones[0].rings_deg[0], zone.rings_deg[0])


def test_without_a_prj_metres_are_still_refused(projected: Path, tmp_path: Path) -> None:
    for ending in (".shp", ".shx", ".dbf"):
        shutil.copy(projected.with_suffix(ending), tmp_path / f"bare{ending}")
    with pytest.raises(ValueError, match="allowed are degrees"):
        read_prescription(tmp_path / "bare.shp")
