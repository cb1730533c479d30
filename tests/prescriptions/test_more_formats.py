"""Prescriptions through every format and back; rasters; the pass as GeoPackage."""

from __future__ import annotations

import json
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapefile
import shapely
from topdress.control.targets.prescription import MapData, Zone, calc_rate_shares
from topdress.drivers.files.imports.import_errors import LogImportError
from topdress.drivers.files.imports.mapping import Source
from topdress.drivers.files.imports.table_reader import read_raw_table
from topdress.drivers.files.prescriptions import raster
from topdress.drivers.files.prescriptions.map_choices import LB_AC_KG_HA, RateChoice, RateQuestion
from topdress.drivers.files.prescriptions.map_reader import read_prescription
from topdress.drivers.files.prescriptions.map_writer import write_prescription
from topdress.drivers.plain_text import RefusedInput

from tests.command import topdress


def plan() -> MapData:
    """Zones of uneven rates, one with a hole."""
    lat, lon = 52.1234567891, 9.7654321987
    zones = []
    for k in range(12):
        south, west = lat + 0.0002 * (k // 4), lon + 0.0003 * (k % 4)
        north, east = south + 0.0002, west + 0.0003
        ring = np.array([(south, west), (south, east), (north, east), (north, west)])
        hole = np.array(
            [
                (south + 0.00005, west + 0.0001),
                (south + 0.0001, west + 0.0001),
                (south + 0.0001, west + 0.0002),
            ]
        )
        zones.append(Zone(83.41 + 17.23 * k, (ring, hole) if k == 5 else (ring,)))
    return MapData(tuple(zones), None)


def differences(one: MapData, other: MapData) -> tuple[float, float, float]:
    """Largest of a rate, kg/ha, of a corner, deg; and of the mass, a share."""
    rates = max(
        abs(a.rate_kg_ha - b.rate_kg_ha) for a, b in zip(one.zones, other.zones, strict=True)
    )
    corner = max(
        float(
            shapely.hausdorff_distance(
                shapely.Polygon(a.rings_deg[0]), shapely.Polygon(b.rings_deg[0])
            )
        )
        for a, b in zip(one.zones, other.zones, strict=True)
    )
    masses = [sum(share.mass_kg for share in calc_rate_shares(data)) for data in (one, other)]
    return rates, corner, abs(masses[1] / masses[0] - 1.0)


@pytest.mark.parametrize(
    ("name", "rate", "corner"),
    [
        ("a.geojson", 0.0, 0.0),
        ("a.shp", 1e-8, 1e-12),
        ("a.gpkg", 0.0, 0.0),
        ("a.kml", 1e-9, 1e-13),
        ("a.kmz", 1e-9, 1e-13),
        ("a.zip", 0.005, 1e-9),
        ("task", 0.005, 1e-9),
    ],
)
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
    ours = sum(share.mass_kg for share in calc_rate_shares(plan()))
    assert kilograms == pytest.approx(ours, rel=1e-3)  # UTM's scale


def test_a_geopackage_in_utm_and_one_of_several_layers(tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    frame = geopandas.GeoDataFrame(
        {"rate_kg_ha": [100.0]}, geometry=[shapely.box(9, 52, 9.001, 52.001)], crs=4326
    )
    frame.to_crs(32632).to_file(tmp_path / "utm.gpkg", layer="map")
    read = read_prescription(tmp_path / "utm.gpkg")
    assert np.abs(read.data.zones[0].rings_deg[0].max(axis=0) - (52.001, 9.001)).max() < 1e-8
    assert any("UTM zone 32N" in str(one) for one in read.findings)
    frame.to_file(tmp_path / "utm.gpkg", layer="other")
    with pytest.raises(RateQuestion, match="2 layers of polygons: allowed is one of map, other"):
        read_prescription(tmp_path / "utm.gpkg")
    assert read_prescription(tmp_path / "utm.gpkg", RateChoice(inside="other")).data.zones


# RD, Gauss-Krueger on DHDN, the British, the Swiss
@pytest.mark.parametrize("epsg", [28992, 31467, 27700, 2056])
@pytest.mark.parametrize("ending", ["gpkg", "shp"])
def test_a_national_grid_is_read_with_pyproj_and_refused_without(
    epsg: int, ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    lon, lat = {28992: (5.4, 52.1), 31467: (9.0, 50.0), 27700: (-1.5, 53.0), 2056: (7.4, 46.9)}[
        epsg
    ]
    frame = geopandas.GeoDataFrame(
        {"rate_kg_ha": [100.0]},
        geometry=[shapely.box(lon, lat, lon + 0.001, lat + 0.001)],
        crs=4326,
    ).to_crs(epsg)
    frame.to_file(path := tmp_path / f"map.{ending}")
    read = read_prescription(path)
    theirs = shapely.get_coordinates(frame.to_crs(4326).geometry[0])[:, ::-1]
    for place in read.data.zones[0].rings_deg[0]:
        # 0.1 m; the grid's own 1 to 3 m are said
        assert np.abs(theirs - place).sum(axis=1).min() < 1e-6
    assert any("taken to degrees, right to " in str(one) for one in read.findings)
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(RefusedInput, match="allowed are degrees on WGS84, or UTM"):
        read_prescription(path)


@pytest.mark.parametrize(
    ("crs", "described"),
    [
        ("EPSG:32632", "rate_kg_ha"),
        ("EPSG:4326", "rate_kg_ha"),
        ("EPSG:32632", "NDVI"),
        ("EPSG:28992", "rate_kg_ha"),
    ],
)
def test_a_raster(crs: str, described: str, tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    size = 10.0 if crs != "EPSG:4326" else 0.0001
    corner = {"EPSG:32632": (500_000.0, 5_760_000.0), "EPSG:28992": (155_000.0, 463_000.0)}.get(
        crs, (9.0, 52.0)
    )
    values = np.linspace(80.0, 200.0, 60, dtype=np.float32).reshape(6, 10)
    values[0, 0] = -9999.0
    with rasterio.open(
        tmp_path / "a.tif",
        "w",
        driver="GTiff",
        width=10,
        height=6,
        count=1,
        dtype="float32",
        crs=crs,
        nodata=-9999.0,
        transform=rasterio.transform.from_origin(*corner, size, size),
    ) as file:
        file.write(values, 1)
        file.set_band_description(1, described)
    if described == "NDVI":
        with pytest.raises(RateQuestion):
            read_prescription(tmp_path / "a.tif")
        return
    read = read_prescription(tmp_path / "a.tif")
    assert len(read.data.zones) == 59 and read.data.zones[0].rate_kg_ha == pytest.approx(
        float(values[0, 1])
    )
    area = sum(share.area_ha for share in calc_rate_shares(read.data))
    assert area == pytest.approx(
        59
        * {
            "EPSG:32632": 0.01 / 0.9996**2,
            "EPSG:4326": 0.0076466,
            "EPSG:28992": 0.01 / 0.9999079**2,
        }[crs],
        rel=2e-3,
    )


def test_a_fine_raster_is_averaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    monkeypatch.setattr(raster, "MAX_CELL_COUNT", 20)
    values = np.linspace(80.0, 200.0, 63, dtype=np.float32).reshape(7, 9)
    classes = np.repeat([[1.0], [3.0]], [4, 3], axis=0) * np.ones((7, 9))
    values[0, 0] = classes[0, 0] = -9999.0
    with rasterio.open(
        tmp_path / "a.tif",
        "w",
        driver="GTiff",
        width=9,
        height=7,
        count=2,
        dtype="float32",
        crs="EPSG:32632",
        nodata=-9999.0,
        transform=rasterio.transform.from_origin(500_000.0, 5_760_000.0, 10.0, 10.0),
    ) as file:
        file.write(values, 1)
        file.write(classes, 2)
        file.descriptions = ("rate_kg_ha", "factor")
    read = read_prescription(tmp_path / "a.tif")
    rates = [zone.rate_kg_ha for zone in read.data.zones]
    # of the last column and row half of each block is there, of the last block a quarter
    assert len(rates) == 19
    assert rates[0] == pytest.approx(values[0:2, 0:2].ravel()[1:].mean())
    assert rates[1] == pytest.approx(values[0:2, 2:4].mean())
    assert rates[4] == pytest.approx(values[0:2, 8].mean())
    assert str(read.findings[0]) == (
        "62 cells of 10 m, each 2 x 2 of them averaged to one: a map has at most 20 cells"
    )
    wide = read_prescription(tmp_path / "a.tif", RateChoice(width_m=36.0))
    # Of the last row a third of each block is there: less than half.
    assert len(wide.data.zones) == 6
    assert str(wide.findings[0]) == (
        "62 cells of 10 m, each 3 x 3 of them averaged to one: the working width is 36 m"
    )
    few = RateChoice(width_m=15.0)  # 62 cells of 10 m are too many
    assert len(read_prescription(tmp_path / "a.tif", few).data.zones) == 19
    levels = read_prescription(tmp_path / "a.tif", RateChoice(column="factor", unit="kg/ha"))
    assert {zone.rate_kg_ha for zone in levels.data.zones} == {1.0, 3.0}


def test_without_rasterio_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rasterio", None)
    (tmp_path / "a.tif").write_bytes(b"II*\0" + bytes(60))
    with pytest.raises(
        RefusedInput, match=r"this is a GeoTIFF, a raster: install the extra raster: .*pip "
    ):
        read_prescription(tmp_path / "a.tif")


def test_an_index_becomes_rates_by_the_crops_rule(tmp_path: Path) -> None:

    from topdress.control.agronomy.nitrogen_rate import decide_rate_kg_ha
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import CROP_KIND

    zones = tuple(zone._replace(rate_kg_ha=0.30 + 0.04 * k) for k, zone in enumerate(plan().zones))
    write_prescription(MapData(zones, None), tmp_path / "a.geojson")
    text = (tmp_path / "a.geojson").read_text().replace("rate_kg_ha", "NDVI")
    (tmp_path / "ndvi.geojson").write_text(text)

    def run(*words: object) -> str:
        result = topdress("map", tmp_path / "ndvi.geojson", *words)
        return f"{result.exit_code} {result.output}"

    assert run().startswith("2 ")
    done = run("--rule", "demo", "--out", tmp_path / "rates.geojson")
    assert done.startswith("0 ") and "NDVI taken to rates by the rule" in done, done
    crop = load_config("huanghai_wheat", CROP_KIND).model
    back = read_prescription(tmp_path / "rates.geojson").data.zones
    assert [zone.rate_kg_ha for zone in back] == [
        decide_rate_kg_ha(crop, zone.rate_kg_ha) for zone in zones
    ]
    assert len({zone.rate_kg_ha for zone in back}) > 3
    (tmp_path / "ndvi.geojson").write_text(text.replace('"NDVI": 0.', '"NDVI": 30.'))
    assert "allowed as NDVI is -1 to 1" in run("--rule", "demo")
    assert run("--rule", "demo", "--unit", "lb/ac").startswith("2 ")


@pytest.mark.parametrize("degrees", [0.0, 30.0, -75.0, 180.0])
def test_cells_of_a_turned_raster_lie_where_rasterio_has_them(
    degrees: float, tmp_path: Path
) -> None:
    """A drone's picture along the rows is no picture with north up."""
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    affine = rasterio.Affine
    transform = affine.translation(9.0, 52.0) @ affine.rotation(degrees) @ affine.scale(2e-4, -1e-4)
    with rasterio.open(
        tmp_path / "a.tif",
        "w",
        driver="GTiff",
        width=4,
        height=3,
        count=1,
        dtype="float32",
        crs="EPSG:4326",
        nodata=-1.0,
        transform=transform,
    ) as file:
        file.write(np.arange(12, dtype=np.float32).reshape(3, 4) + 90.0, 1)
        file.set_band_description(1, "rate_kg_ha")
    zones = read_prescription(tmp_path / "a.tif").data.zones
    assert len(zones) == 12
    for zone in zones:
        row, column = divmod(round(zone.rate_kg_ha) - 90, 4)
        wanted = [
            transform @ (column + right, row + down)
            for right, down in ((0, 0), (1, 0), (1, 1), (0, 1))
        ]
        assert zone.rings_deg[0][:, ::-1] == pytest.approx(np.array(wanted), abs=1e-12)


# --- Zips, folders and shapefiles as other programs leave them: what is read and asked, in
# which letters and units.

RATES = [120.0, 150.0, 180.0]
GERMAN: dict[str, list[Any]] = {"Güllegabe": RATES, "Schlag": ["Höhe", "Süd", "Café"]}
CHINESE: dict[str, list[Any]] = {"施肥量": RATES, "地块": ["北一号地", "北二号地", "南"]}
TASK = (
    '<ISO11783_TaskData VersionMajor="4" VersionMinor="3" DataTransferOrigin="1">'
    '<TSK A="TSK1" G="1" H="0" I="0" J="0">'
    '<TZN A="0"><PDV A="0006" B="9000"/></TZN><TZN A="1"><PLN A="2"><LSG A="1"><PNT A="2" '
    'C="40.0" D="116.0"/>'
    '<PNT A="2" C="40.0" D="116.001"/><PNT A="2" C="40.001" D="116.0"/></LSG></PLN><PDV '
    'A="0006" B="{rate}"/></TZN>'
    "</TSK></ISO11783_TaskData>"
)


def write(
    path: Path,
    columns: dict[str, list[Any]],
    encoding: str = "utf-8",
    cpg: str = "",
    driver: int | None = None,
    points: bool = False,
) -> Path:
    kind = shapefile.POINT if points else shapefile.POLYGON
    with shapefile.Writer(str(path), shapeType=kind, encoding=encoding) as writer:
        for name, values in columns.items():
            writer.field(name, *(("C", 20) if isinstance(values[0], str) else ("N", 12, 2)))
        for k in range(3):
            west = 116.0 + 0.001 * k
            if points:
                writer.point(west, 40.0)
            else:
                east = west + 0.001
                writer.poly(
                    [[(west, 40.0), (west, 40.001), (east, 40.001), (east, 40.0), (west, 40.0)]]
                )
            writer.record(*(values[k] for values in columns.values()))
    if cpg:
        path.with_suffix(".cpg").write_text(cpg)
    if driver is not None:
        table = bytearray(path.with_suffix(".dbf").read_bytes())
        table[29] = driver
        path.with_suffix(".dbf").write_bytes(table)
    return path.with_suffix(".shp")


def packed(path: Path, names: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in names.items():
            archive.writestr(name, data)
    return path


def parts(shp: Path, prefix: str = "") -> dict[str, bytes]:
    return {
        f"{prefix}{file.name}": file.read_bytes()
        for file in shp.parent.glob(f"{shp.stem}*")
        if file != shp.parent
    }


@pytest.mark.parametrize(
    ("columns", "encoding", "cpg", "driver"),
    [
        (CHINESE, "utf-8", "UTF-8", None),
        (CHINESE, "gb18030", "GBK", None),
        (CHINESE, "gb18030", "936", None),
        (CHINESE, "gb18030", "", 0x4D),
        (CHINESE, "gb18030", "", None),
        (CHINESE, "gb18030", "UTF-8", None),
        (CHINESE, "utf-8", "GBK", None),
        (GERMAN, "latin-1", "ISO-8859-1", None),
        (GERMAN, "cp1252", "ANSI 1252", None),
        (GERMAN, "latin-1", "", 0x57),
        (GERMAN, "latin-1", "", None),
        (GERMAN, "latin-1", "UTF-8", None),
        (GERMAN, "utf-8", "", None),
        (GERMAN, "cp850", "", 0x02),
    ],
)
def test_texts_of_a_table_are_read_in_their_letters(
    tmp_path: Path, columns: dict[str, list[Any]], encoding: str, cpg: str, driver: int | None
) -> None:
    path = write(tmp_path / "m", columns, encoding, cpg, driver)
    read = read_prescription(path)
    assert read.layers == (next(iter(columns)),)
    assert [zone.rate_kg_ha for zone in read.data.zones] == RATES
    points = write(tmp_path / "p", columns, encoding, cpg, driver, points=True)
    columns_read = read_raw_table(points).columns
    for name, values in columns.items():
        assert columns_read[name].tolist() == values


@pytest.mark.parametrize(
    ("name", "encoding", "taken"),
    [
        ("Target_Rate_kg", "utf-8", "Target_Rat"),
        ("推荐施肥量公斤", "utf-8", "推荐施"),
        ("APPLICATION_RATE", "utf-8", "APPLICATIO"),
    ],
)
def test_names_cut_to_ten_bytes_are_known(
    tmp_path: Path, name: str, encoding: str, taken: str
) -> None:
    raw = name.encode(encoding)[:10]
    path = write(tmp_path / "m", {"RATE000000": RATES}, "latin-1")
    table = path.with_suffix(".dbf").read_bytes().replace(b"RATE000000", raw.ljust(10, b"\0"))
    path.with_suffix(".dbf").write_bytes(table)
    assert read_prescription(path).layers == (taken,)


def test_two_columns_cut_to_one_name_are_both_there(tmp_path: Path) -> None:
    path = write(tmp_path / "m", {"TARGET_RA1": RATES, "TARGET_RA2": [9.0, 9.0, 9.0]}, "latin-1")
    table = path.with_suffix(".dbf").read_bytes()
    table = table.replace(b"TARGET_RA2", b"TARGET_RAT").replace(b"TARGET_RA1", b"TARGET_RAT")
    path.with_suffix(".dbf").write_bytes(table)
    with pytest.raises(RateQuestion, match=r"allowed TARGET_RAT, TARGET_RAT \(2\)"):
        read_prescription(path)


# -- units in the makers' side files
# ----------------------------------------------------------------------------------


def deere(unit: str) -> bytes:
    return json.dumps(
        {
            "Version": "1.0",
            "DataAttributes": [
                {"Name": "IsoTime"},
                {"Name": "TargetRate", "Description": "target", "Unit": unit},
            ],
        }
    ).encode()


@pytest.mark.parametrize(
    ("side", "data", "factor", "unit"),
    [
        ("m-Deere-Metadata.json", deere("lb1ac-1"), LB_AC_KG_HA, "lb/ac"),
        ("m-Deere-Metadata.json", deere("kg1ha-1"), 1.0, "kg/ha"),
        ("m-Metadata.json", deere("g1[m2]-1"), 10.0, "g/m2"),
        (
            "m.shp.xml",
            b"<metadata><attr><attrlabl>TARGETRATE</attrlabl><attrdomv>"
            b"<rdom><attrunit>lb/acre</attrunit></rdom>"
            b"</attrdomv></attr></metadata>",
            LB_AC_KG_HA,
            "lb/ac",
        ),
    ],
)
def test_the_unit_in_a_makers_side_file_holds(
    tmp_path: Path, side: str, data: bytes, factor: float, unit: str
) -> None:
    path = write(tmp_path / "m", {"TargetRate": RATES})
    (tmp_path / side).write_bytes(data)
    zipped = packed(tmp_path / "rx.zip", parts(path, "Rx/"))
    for place in (path, zipped):
        read = read_prescription(place)
        assert (read.unit, read.unit_from) == (unit, f"named in {side}")
        assert read.data.zones[0].rate_kg_ha == pytest.approx(120.0 * factor)
    assert read_prescription(path, RateChoice(unit="kg/ha")).data.zones[0].rate_kg_ha == 120.0, (
        "the operator's stands"
    )


@pytest.mark.parametrize(
    ("column", "unit", "why"),
    [
        ("TargetRate", "gal1ac-1", "density None"),
        ("TargetRate", "ton1ac-1", "unit ton/ac in m-Deere-Metadata.json"),
        ("TargetRate", "seeds1ac-1", "unit seeds/ac in"),
    ],
)
def test_a_side_files_unit_that_cannot_be_used_is_a_question(
    tmp_path: Path, column: str, unit: str, why: str
) -> None:
    path = write(tmp_path / "m", {column: RATES})
    (tmp_path / "m-Deere-Metadata.json").write_bytes(deere(unit))
    with pytest.raises(RateQuestion, match=why):
        read_prescription(path)


def test_a_name_and_a_side_file_that_disagree_are_a_question(tmp_path: Path) -> None:
    path = write(tmp_path / "m", {"Rate_kg_ha": RATES})
    (tmp_path / "m-Deere-Metadata.json").write_bytes(
        deere("lb1ac-1").replace(b"TargetRate", b"Rate_kg_ha")
    )
    with pytest.raises(
        RateQuestion, match=r"unit lb/ac in m-Deere-Metadata\.json, kg/ha by its own name"
    ):
        read_prescription(path)


# -- zips and folders
# -------------------------------------------------------------------------------------------------


@pytest.fixture
def rx(tmp_path: Path) -> dict[str, bytes]:
    return parts(write(tmp_path / "rx", {"Tgt_Rate": RATES}))


@pytest.fixture
def edge(tmp_path: Path) -> dict[str, bytes]:
    return parts(write(tmp_path / "edge", {"rate": [1.0, 5.0, 9.0]}))


def task(rate: int) -> bytes:
    return TASK.format(rate=rate).encode()


def test_what_a_macintosh_adds_does_not_count(tmp_path: Path, rx: dict[str, bytes]) -> None:
    junk = {f"__MACOSX/._{name}": b"\0\x05\x16\x07" for name in rx} | {
        "._rx.shp": b"\0",
        ".DS_Store": b"\0",
    }
    assert len(read_prescription(packed(tmp_path / "m.zip", rx | junk)).data.zones) == 3


def test_one_of_several_shapefiles_is_asked_for_and_named(
    tmp_path: Path, rx: dict[str, bytes], edge: dict[str, bytes]
) -> None:
    path = packed(
        tmp_path / "two.zip",
        {f"a/{n}": d for n, d in rx.items()} | {f"b/{n}": d for n, d in edge.items()},
    )
    with pytest.raises(
        RateQuestion, match=r"2 shapefiles: allowed is one of a/rx\.shp, b/edge\.shp"
    ):
        read_prescription(path)
    for name, first in (("rx", 120.0), ("b/edge.shp", 1.0), ("EDGE.SHP", 1.0), ("a", 120.0)):
        assert read_prescription(path, RateChoice(inside=name)).data.zones[0].rate_kg_ha == first
    with pytest.raises(RefusedInput, match="no prescription named c"):
        read_prescription(path, RateChoice(inside="c"))
    told = topdress("map", path, "--inside", "rx")
    assert told.exit_code == 0 and "3 zones" in told.stdout


def test_a_task_set_stands_before_shapefiles_and_says_so(
    tmp_path: Path, rx: dict[str, bytes]
) -> None:
    path = packed(tmp_path / "both.zip", rx | {"TASKDATA/TASKDATA.XML": task(31500)})
    read = read_prescription(path)
    assert (read.format, read.data.zones[0].rate_kg_ha) == ("isoxml", 315.0)
    assert "not used next to the task set: rx.shp" in read.findings[-1].text
    assert read_prescription(path, RateChoice(inside="rx.shp")).format == "shapefile"


def test_task_sets_however_deep_and_of_several_one(tmp_path: Path, rx: dict[str, bytes]) -> None:
    names = {
        "2024/TASKDATA/TASKDATA.XML": task(10000),
        "2025/export/TaskData/taskdata.xml": task(20000),
    }
    path = packed(tmp_path / "sets.zip", names)
    with pytest.raises(
        RateQuestion, match="2 task sets: allowed is one of 2024/TASKDATA, 2025/export/TaskData"
    ):
        read_prescription(path)
    assert read_prescription(path, RateChoice(inside="2025")).data.zones[0].rate_kg_ha == 200.0
    folder = tmp_path / "stick"
    for name, data in names.items():
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_bytes(data)
    with pytest.raises(RateQuestion, match="2 task sets"):
        read_prescription(folder)
    assert read_prescription(folder / "2024").data.zones[0].rate_kg_ha == 100.0


def test_a_zip_in_a_zip_is_said(tmp_path: Path, rx: dict[str, bytes]) -> None:
    inner = packed(tmp_path / "inner.zip", rx)
    with pytest.raises(RefusedInput, match=r"it holds inner\.zip: unpack that first"):
        read_prescription(packed(tmp_path / "outer.zip", {"inner.zip": inner.read_bytes()}))


def test_points_of_a_zip_with_areas_beside_are_imported(
    tmp_path: Path, rx: dict[str, bytes]
) -> None:
    points = parts(write(tmp_path / "applied", {"AppRate": RATES}, points=True))
    assert (
        read_raw_table(packed(tmp_path / "job.zip", rx | points)).columns["AppRate"].tolist()
        == RATES
    )
    more = {name.replace("applied", "second"): data for name, data in points.items()}
    both = packed(tmp_path / "two.zip", points | more)
    with pytest.raises(LogImportError, match=r"2 shapefiles of points: say source\.inside"):
        read_raw_table(both)
    assert read_raw_table(both, Source(inside="second")).columns["AppRate"].tolist() == RATES
