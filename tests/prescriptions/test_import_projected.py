"""Shapefiles in metres of a transverse Mercator projection, against an independent library."""
from __future__ import annotations

import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import shapefile

from control.targets.prescription import statistics
from drivers.files.prescriptions.projected import TransverseMercator, projection_of
from drivers.files.prescriptions.read import read_prescription

pyproj = pytest.importorskip("pyproj", reason="pyproj, the independent reader, is not installed")

CORNERS_DEG = [(119.880, 34.280), (119.883, 34.281), (119.884, 34.284), (119.879, 34.283)]      # lon, lat
HOLE_DEG = [(119.8810, 34.2815), (119.8812, 34.2820), (119.8816, 34.2816)]


@pytest.mark.parametrize(("epsg", "places"), [
    (32650, [(34.28, 119.88), (0.0, 117.0), (60.0, 114.5)]), (32750, [(-33.9, 118.6), (-0.001, 120.0)]),
    (4549, [(34.28, 119.88), (45.0, 121.4)]), (4527, [(35.0, 117.5)]), (25832, [(52.1, 8.9), (70.0, 12.0)]),
    (26914, [(41.0, -98.0)]), (27700, None), (2326, None), (28992, None)])
def test_degrees_are_those_of_the_library(epsg: int, places: list[tuple[float, float]] | None) -> None:
    crs = pyproj.CRS.from_epsg(epsg)
    text = crs.to_wkt("WKT1_ESRI")
    if places is None:
        with pytest.raises(ValueError, match=r"spheroid|projection"):
            projection_of(text)
        return
    forward = pyproj.Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)
    lat, lon = np.array(places).T
    east, north = forward.transform(lon, lat)
    projection = projection_of(text)
    assert projection is not None
    found = projection.to_deg(np.asarray(east), np.asarray(north))
    assert np.abs(np.array(found) - np.array([lat, lon])).max() < 1e-9, "0.1 mm"


def test_an_origin_off_the_equator_and_another_unit() -> None:
    text = ("+proj=tmerc +lat_0=38.5 +lon_0=-96 +k=0.9999 +x_0=500000 +y_0=100000 +ellps=GRS80 +units=us-ft +no_defs")
    forward = pyproj.Transformer.from_crs(4269, pyproj.CRS.from_proj4(text), always_xy=True)
    east, north = forward.transform(np.array([-96.4]), np.array([39.2]))
    foot = 1200.0 / 3937.0
    ours = TransverseMercator("feet", -96.0, 38.5, 0.9999, 500000 / foot, 100000 / foot, foot, 1.0 / 298.257222101)
    lat, lon = ours.to_deg(np.asarray(east), np.asarray(north))
    assert (lat[0], lon[0]) == pytest.approx((39.2, -96.4), abs=1e-9)


@pytest.fixture
def projected(tmp_path: Path) -> Path:
    forward = pyproj.Transformer.from_crs(4326, 32650, always_xy=True)
    path = tmp_path / "utm.shp"
    with shapefile.Writer(str(path), shapeType=shapefile.POLYGON) as writer:
        writer.field("rate", "N", 10, 2)
        writer.poly([[forward.transform(*corner) for corner in reversed(CORNERS_DEG)],
                     [forward.transform(*corner) for corner in reversed(HOLE_DEG)]])
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
    assert any("WGS_1984_UTM_Zone_50N taken to degrees" in finding.text for finding in read.findings)
    geod = pyproj.Geod(ellps="WGS84")
    area = abs(geod.polygon_area_perimeter(*zip(*CORNERS_DEG, strict=True))[0])
    hole = abs(geod.polygon_area_perimeter(*zip(*HOLE_DEG, strict=True))[0])
    assert sum(s.area_ha for s in statistics(read.data)) == pytest.approx((area - hole) / 1e4, rel=1e-5)
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
