"""Prescriptions through every format and back; rasters; the pass as GeoPackage."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

from control.targets.prescription import MapData, Zone, statistics
from drivers.files.prescriptions.read import read_prescription
from drivers.files.prescriptions.words import RateChoice, RateQuestion
from drivers.files.prescriptions.write import write_prescription
from drivers.plain_text import Refused


def plan() -> MapData:
    """Zones of uneven rates, one with a hole."""
    lat, lon = 52.1234567891, 9.7654321987
    zones = []
    for k in range(12):
        south, west = lat + 0.0002 * (k // 4), lon + 0.0003 * (k % 4)
        north, east = south + 0.0002, west + 0.0003
        ring = np.array([(south, west), (south, east), (north, east), (north, west)])
        hole = np.array([(south + 0.00005, west + 0.0001), (south + 0.0001, west + 0.0001),
                         (south + 0.0001, west + 0.0002)])
        zones.append(Zone(83.41 + 17.23 * k, (ring, hole) if k == 5 else (ring,)))
    return MapData(tuple(zones), None)


def differences(one: MapData, other: MapData) -> tuple[float, float, float]:
    """Largest of a rate, kg/ha, of a corner, deg; and of the mass, a share."""
    rates = max(abs(a.rate_kg_ha - b.rate_kg_ha) for a, b in zip(one.zones, other.zones, strict=True))
    corner = max(float(shapely.hausdorff_distance(shapely.Polygon(a.rings_deg[0]), shapely.Polygon(b.rings_deg[0])))
                 for a, b in zip(one.zones, other.zones, strict=True))
    masses = [sum(share.mass_kg for share in statistics(data)) for data in (one, other)]
    return rates, corner, abs(masses[1] / masses[0] - 1.0)


@pytest.mark.parametrize(("name", "rate", "corner"), [
    ("a.geojson", 0.0, 0.0), ("a.shp", 1e-8, 1e-12), ("a.gpkg", 0.0, 0.0), ("a.kml", 1e-9, 1e-13),
    ("a.kmz", 1e-9, 1e-13), ("a.zip", 0.005, 1e-9), ("task", 0.005, 1e-9)])
def test_there_and_back(name: str, rate: float, corner: float, tmp_path: Path) -> None:
    if name[-4:] in ("gpkg", ".kml", ".kmz"):
        pytest.importorskip("pyogrio", reason="pyogrio is not installed")
    write_prescription(plan(), tmp_path / name)
    back = read_prescription(tmp_path / name)
    found = differences(plan(), back.data)
    print(name, found)
    assert found[0] <= rate and found[1] <= corner and found[2] < 1e-6


def test_geopandas_sees_the_same_areas(tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    write_prescription(plan(), tmp_path / "a.gpkg")
    frame = geopandas.read_file(tmp_path / "a.gpkg").to_crs("EPSG:32632")
    kilograms = float((frame.area * frame.rate_kg_ha).sum()) / 10_000.0
    ours = sum(share.mass_kg for share in statistics(plan()))
    assert kilograms == pytest.approx(ours, rel=1e-3)       # UTM's scale


def test_a_geopackage_in_utm_and_one_of_several_layers(tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    frame = geopandas.GeoDataFrame({"rate_kg_ha": [100.0]}, geometry=[shapely.box(9, 52, 9.001, 52.001)], crs=4326)
    frame.to_crs(32632).to_file(tmp_path / "utm.gpkg", layer="map")
    read = read_prescription(tmp_path / "utm.gpkg")
    assert np.abs(read.data.zones[0].rings_deg[0].max(axis=0) - (52.001, 9.001)).max() < 1e-8
    assert any("UTM zone 32N" in str(one) for one in read.findings)
    frame.to_file(tmp_path / "utm.gpkg", layer="other")
    with pytest.raises(RateQuestion, match="2 layers of polygons: allowed is one of map, other"):
        read_prescription(tmp_path / "utm.gpkg")
    assert read_prescription(tmp_path / "utm.gpkg", RateChoice(inside="other")).data.zones


@pytest.mark.parametrize("epsg", [28992, 31467, 27700, 2056])        # RD, Gauss-Krueger on DHDN, the British, the Swiss
@pytest.mark.parametrize("ending", ["gpkg", "shp"])
def test_a_national_grid_is_read_with_pyproj_and_refused_without(epsg: int, ending: str, tmp_path: Path,
                                                                 monkeypatch: pytest.MonkeyPatch) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    lon, lat = {28992: (5.4, 52.1), 31467: (9.0, 50.0), 27700: (-1.5, 53.0), 2056: (7.4, 46.9)}[epsg]
    frame = geopandas.GeoDataFrame({"rate_kg_ha": [100.0]}, geometry=[shapely.box(lon, lat, lon + 0.001, lat + 0.001)],
                                   crs=4326).to_crs(epsg)
    frame.to_file(path := tmp_path / f"map.{ending}")
    read = read_prescription(path)
    theirs = shapely.get_coordinates(frame.to_crs(4326).geometry[0])[:, ::-1]
    for place in read.data.zones[0].rings_deg[0]:
        assert np.abs(theirs - place).sum(axis=1).min() < 1e-6      # 0.1 m; the grid's own 1 to 3 m are said
    assert any("taken to degrees, right to " in str(one) for one in read.findings)
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(Refused, match="allowed are degrees on WGS84, or UTM"):
        read_prescription(path)


@pytest.mark.parametrize(("crs", "described"), [("EPSG:32632", "rate_kg_ha"), ("EPSG:4326", "rate_kg_ha"),
                                                ("EPSG:32632", "NDVI"), ("EPSG:28992", "rate_kg_ha")])
def test_a_raster(crs: str, described: str, tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    size = 10.0 if crs != "EPSG:4326" else 0.0001
    corner = {"EPSG:32632": (500_000.0, 5_760_000.0), "EPSG:28992": (155_000.0, 463_000.0)}.get(crs, (9.0, 52.0))
    values = np.linspace(80.0, 200.0, 60, dtype=np.float32).reshape(6, 10)
    values[0, 0] = -9999.0
    with rasterio.open(tmp_path / "a.tif", "w", driver="GTiff", width=10, height=6, count=1, dtype="float32", crs=crs,
                       nodata=-9999.0, transform=rasterio.transform.from_origin(*corner, size, size)) as file:
        file.write(values, 1)
        file.set_band_description(1, described)
    if described == "NDVI":
        with pytest.raises(RateQuestion):
            read_prescription(tmp_path / "a.tif")
        return
    read = read_prescription(tmp_path / "a.tif")
    assert len(read.data.zones) == 59 and read.data.zones[0].rate_kg_ha == pytest.approx(float(values[0, 1]))
    area = sum(share.area_ha for share in statistics(read.data))
    assert area == pytest.approx(59 * {"EPSG:32632": 0.01 / 0.9996 ** 2, "EPSG:4326": 0.0076466,
                                     "EPSG:28992": 0.01 / 0.9999079 ** 2}[crs], rel=2e-3)


def test_without_rasterio_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rasterio", None)
    (tmp_path / "a.tif").write_bytes(b"II*\0" + bytes(60))
    with pytest.raises(Refused, match=r"this is a GeoTIFF, a raster: install the extra raster: .*pip "):
        read_prescription(tmp_path / "a.tif")


def test_an_index_becomes_rates_by_the_crops_rule(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from console.cli import app
    from control.agronomy.noa import rate_kg_ha
    from drivers.files.config import load
    from drivers.files.kinds import CROP
    zones = tuple(zone._replace(rate_kg_ha=0.30 + 0.04 * k) for k, zone in enumerate(plan().zones))
    write_prescription(MapData(zones, None), tmp_path / "a.geojson")
    text = (tmp_path / "a.geojson").read_text().replace("rate_kg_ha", "NDVI")
    (tmp_path / "ndvi.geojson").write_text(text)

    def run(*words: object) -> str:
        result = CliRunner().invoke(app, ["map", str(tmp_path / "ndvi.geojson"), *map(str, words)])
        return f"{result.exit_code} {result.output}"
    assert run().startswith("2 ")
    done = run("--rule", "demo", "--out", tmp_path / "rates.geojson")
    assert done.startswith("0 ") and "NDVI taken to rates by the rule" in done, done
    crop = load("huanghai_wheat", CROP).model
    back = read_prescription(tmp_path / "rates.geojson").data.zones
    assert [zone.rate_kg_ha for zone in back] == [rate_kg_ha(crop, zone.rate_kg_ha) for zone in zones]
    assert len({zone.rate_kg_ha for zone in back}) > 3
    (tmp_path / "ndvi.geojson").write_text(text.replace('"NDVI": 0.', '"NDVI": 30.'))
    assert "allowed as NDVI is -1 to 1" in run("--rule", "demo")
    assert run("--rule", "demo", "--unit", "lb/ac").startswith("2 ")


@pytest.mark.parametrize("degrees", [0.0, 30.0, -75.0, 180.0])
def test_cells_of_a_turned_raster_lie_where_rasterio_has_them(degrees: float, tmp_path: Path) -> None:
    """A drone's picture along the rows is no picture with north up."""
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    affine = rasterio.Affine
    transform = affine.translation(9.0, 52.0) @ affine.rotation(degrees) @ affine.scale(2e-4, -1e-4)
    with rasterio.open(tmp_path / "a.tif", "w", driver="GTiff", width=4, height=3, count=1, dtype="float32",
                       crs="EPSG:4326", nodata=-1.0, transform=transform) as file:
        file.write(np.arange(12, dtype=np.float32).reshape(3, 4) + 90.0, 1)
        file.set_band_description(1, "rate_kg_ha")
    zones = read_prescription(tmp_path / "a.tif").data.zones
    assert len(zones) == 12
    for zone in zones:
        row, column = divmod(round(zone.rate_kg_ha) - 90, 4)
        wanted = [transform @ (column + right, row + down) for right, down in ((0, 0), (1, 0), (1, 1), (0, 1))]
        assert zone.rings_deg[0][:, ::-1] == pytest.approx(np.array(wanted), abs=1e-12)
