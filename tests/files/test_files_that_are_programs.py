"""A file that tells its reader what to do (GDAL's virtual data sources, views of SQLite) does
nothing."""

from __future__ import annotations

import os
import signal
import sqlite3
import threading
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from topdress.drivers.files import geopackage
from topdress.drivers.files.fields.shapes import read_field_shapes
from topdress.drivers.files.imports.table_reader import read_raw_table
from topdress.drivers.files.prescriptions.map_reader import read_prescription
from topdress.drivers.plain_text import RefusedInput

ENDINGS = (
    "gpkg",
    "kml",
    "kmz",
    "tif",
    "tiff",
    "geojson",
    "json",
    "shp",
    "csv",
    "xlsx",
    "xml",
    "zip",
    "parquet",
)
# anything else is a text table to the import
OF_LOGS = ("geojson", "json", "shp", "xlsx", "xml", "zip", "parquet")
BEFORE = {
    "plain": b"",
    "mark": b"\xef\xbb\xbf",
    "braces": b"{}",
    "blank": b" \n",
    "tiff": b"II*\0",
    "sqlite": b"SQLite format 3\0",
}
RATE = 333.0
BOX = shapely.box(9.0, 52.0, 9.001, 52.001)


def as_geopackage(path: Path, more: str = "") -> Path:
    """One zone, by the letter of the standard (OGC 12-128r19) and by no library. more: SQL of
    whoever made it."""
    shape = b"GP\0\1" + (4326).to_bytes(4, "little") + shapely.to_wkb(BOX, byte_order=1)
    with sqlite3.connect(path) as base:
        base.executescript(f"""
            CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT, srs_id INTEGER PRIMARY KEY,
            organization TEXT,
                organization_coordsys_id INTEGER, definition TEXT);
            INSERT INTO gpkg_spatial_ref_sys VALUES ('WGS 84', 4326, 'EPSG', 4326, 'undefined');
            CREATE TABLE gpkg_contents (table_name TEXT PRIMARY KEY, data_type TEXT, identifier
            TEXT,
                description TEXT, last_change TEXT, min_x, min_y, max_x, max_y, srs_id INTEGER);
            CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT,
            geometry_type_name TEXT,
                srs_id INTEGER, z TINYINT, m TINYINT);
            CREATE TABLE zones (fid INTEGER PRIMARY KEY, geom BLOB, rate_kg_ha REAL);
            INSERT INTO gpkg_contents VALUES ('zones', 'features', 'zones', '',
            '2026-01-01T00:00:00Z', 9, 52, 9.001,
                52.001, 4326);
            INSERT INTO gpkg_geometry_columns VALUES ('zones', 'geom', 'POLYGON', 4326, 0, 0);
            PRAGMA application_id = 1196444487;
            PRAGMA user_version = 10300;
            {more}""")
        base.execute("INSERT INTO zones (geom, rate_kg_ha) VALUES (?, ?)", (shape, RATE))
    base.close()
    return path


def program(kind: str, folder: Path) -> bytes:
    """A virtual data source of GDAL: reads another file, has SQLite write one, or reads another
    raster."""
    other = as_geopackage(folder / "other" / "mine.gpkg")
    if kind == "raster":
        return f"""<VRTDataset rasterXSize="10" rasterYSize="6"><SRS>EPSG:4326</SRS>
            <GeoTransform>9,1e-4,0,52,0,-1e-4</GeoTransform><VRTRasterBand dataType="Float32"
            band="1"><Description>
            rate_kg_ha</Description><SimpleSource>
            <SourceFilename>{other}</SourceFilename></SimpleSource>
            </VRTRasterBand></VRTDataset>""".encode()
    sql = (
        f"<SrcSQL>VACUUM INTO '{folder / 'other' / 'written.db'}'</SrcSQL>"
        if kind == "writes"
        else ""
    )
    return (
        "<OGRVRTDataSource><OGRVRTLayer "
        f'name="zones"><SrcDataSource>{other}</SrcDataSource>{sql}</OGRVRTLayer>'
        "</OGRVRTDataSource>"
    ).encode()


@pytest.mark.parametrize("before", BEFORE)
@pytest.mark.parametrize("kind", ["reads", "writes", "raster"])
def test_a_virtual_data_source_is_refused_under_every_ending(
    tmp_path: Path, kind: str, before: str
) -> None:
    (tmp_path / "other").mkdir()
    data = BEFORE[before] + program(kind, tmp_path)
    for ending in ENDINGS:
        path = tmp_path / f"map.{ending}"
        if ending in ("kmz", "zip"):
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr("doc.kml" if ending == "kmz" else "TASKDATA.XML", data)
        else:
            path.write_bytes(data)
        for read in (
            read_prescription,
            read_field_shapes,
            *((read_raw_table,) if ending in OF_LOGS else ()),
        ):
            with pytest.raises(ValueError):
                read(path)
        path.unlink()
    assert [file.name for file in (tmp_path / "other").iterdir()] == ["mine.gpkg"]


def test_gdal_itself_would_do_as_they_say(tmp_path: Path) -> None:
    """So the test above is of programs that work."""
    pyogrio = pytest.importorskip("pyogrio", reason="pyogrio is not installed")
    (tmp_path / "other").mkdir()
    path = tmp_path / "map.gpkg"
    path.write_bytes(program("reads", tmp_path))
    assert pyogrio.raw.read(path)[3][0][0] == RATE
    (tmp_path / "other" / "mine.gpkg").unlink()
    path.write_bytes(program("writes", tmp_path))
    with pytest.raises(Exception):  # noqa: B017  it writes first, and then fails
        pyogrio.raw.read(path)
    assert (tmp_path / "other" / "written.db").exists()


def test_a_virtual_mask_next_to_a_raster_is_not_opened(tmp_path: Path) -> None:
    """GDAL opens NAME.tif.msk as whatever it is when the mask is asked for."""
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    place = rasterio.transform.from_origin(9.0, 52.0, 1e-4, 1e-4)
    for name, value in (("a.tif", 90.0), ("mask.tif", 0.0)):
        with rasterio.open(
            tmp_path / name,
            "w",
            driver="GTiff",
            width=4,
            height=3,
            count=1,
            dtype="float32",
            crs="EPSG:4326",
            transform=place,
        ) as file:
            file.write(np.full((3, 4), value, dtype=np.float32), 1)
            file.set_band_description(1, "rate_kg_ha")
    (tmp_path / "a.tif.msk").write_text(f"""<VRTDataset rasterXSize="4" rasterYSize="3"><Metadata>
        <MDI key="INTERNAL_MASK_FLAGS_1">2</MDI></Metadata><VRTRasterBand dataType="Byte"
        band="1"><SimpleSource>
        <SourceFilename>{
        tmp_path / "mask.tif"
    }</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>""")
    with rasterio.open(tmp_path / "a.tif") as file:
        assert file.read(1, masked=True).mask.all(), "GDAL goes by it"
    assert len(read_prescription(tmp_path / "a.tif").data.zones) == 12


# -- views of a GeoPackage
# ---------------------------------------------------------------------------------------------

VIEW = """CREATE VIEW endless AS WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n)
SELECT {};
    INSERT INTO gpkg_contents VALUES ('endless', 'features', 'endless', '', '', 9, 52, 9.001,
    52.001, 4326);
    INSERT INTO gpkg_geometry_columns VALUES ('endless', 'geom', 'POLYGON', 4326, 0, 0);"""
COUNTS = VIEW.format("max(k) AS geom FROM n")
SORTS = VIEW.format("NULL AS geom, hex(k) AS text FROM n ORDER BY text DESC")
FLOODS = VIEW.format("NULL AS geom, 1.0 AS rate_kg_ha FROM n")
GROWS = VIEW.format("NULL AS geom, zeroblob(1000000000) AS rate FROM n LIMIT 3")


def test_a_geopackage_is_read_without_gdal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "pyogrio", None)
    [zone] = read_prescription(as_geopackage(tmp_path / "map.gpkg")).data.zones
    assert zone.rate_kg_ha == RATE
    assert shapely.Polygon(zone.rings_deg[0][:, ::-1]).equals(BOX)
    assert read_field_shapes(tmp_path / "map.gpkg").outline_deg is not None


@pytest.mark.parametrize(
    ("view", "said"),
    [
        (COUNTS, "takes longer than 1 s"),
        (SORTS, "takes longer than 1 s|out of memory"),
        (FLOODS, "takes longer than 1 s|allowed up to"),
        (GROWS, "too big|out of memory|takes longer"),
    ],
)
def test_a_view_without_an_end_has_one(tmp_path: Path, view: str, said: str) -> None:
    began_s = time.monotonic()
    with pytest.raises(RefusedInput, match=said):
        geopackage.read_geopackage(as_geopackage(tmp_path / "map.gpkg", view), longest_s=1.0)
    assert time.monotonic() - began_s < 30.0


def test_an_interrupt_ends_a_view_at_once(tmp_path: Path) -> None:
    path = as_geopackage(tmp_path / "map.gpkg", COUNTS)
    timer = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))
    began_s = time.monotonic()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        read_prescription(path)
    assert time.monotonic() - began_s < 0.5 * geopackage.MAX_READ_S


@pytest.mark.parametrize(
    "sql",
    [
        "load_extension('x')",
        "writefile('x', 'y')",
        "fts3_tokenizer('simple')",
        "(SELECT sql FROM pragma_database_list)",
    ],
)
def test_a_view_reaches_nothing_but_tables(tmp_path: Path, sql: str) -> None:
    with pytest.raises(RefusedInput, match="not readable as GeoPackage"):
        read_prescription(
            as_geopackage(tmp_path / "map.gpkg", VIEW.format(f"{sql} AS geom FROM n LIMIT 1"))
        )


def test_a_geopackage_that_is_still_written_is_not_read_by_half(tmp_path: Path) -> None:
    path = as_geopackage(tmp_path / "map.gpkg")
    (tmp_path / "map.gpkg-wal").write_bytes(b"rows")
    with pytest.raises(RefusedInput, match="open in another program"):
        read_prescription(path)


def _cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


def _spoilt(data: bytes) -> bytes:
    return data.replace(b"GP\0\1", b"PG\0\1")


def _short(data: bytes) -> bytes:
    at = data.index(b"GP\0\1")
    return data[: at + 20] + bytes(60) + data[at + 80 :]


@pytest.mark.parametrize("change", [_cut, _spoilt, _short], ids=["cut", "no shape", "zeros"])
def test_a_damaged_geopackage_is_one_line(tmp_path: Path, change: Callable[[bytes], bytes]) -> None:
    path = as_geopackage(tmp_path / "map.gpkg")
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(RefusedInput) as said:
        read_prescription(path)
    assert len(str(said.value).splitlines()) == 1


# -- KML
# --------------------------------------------------------------------------------------------------

RING = "9,52,0 9.001,52,0 9.001,52.001,0 9,52.001,0{}"


def kml(inside: str, rate: str = "333", end: str = " 9,52,0") -> str:
    return (
        f'<?xml version="1.0"?>{inside}<kml '
        'xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>A</name>'
        "<ExtendedData><Data "
        f'name="rate"><value>{rate}</value></Data></ExtendedData><Polygon><outerBoundaryIs>'
        f"<LinearRing><coordinates>{RING.format(end)}</coordinates></LinearRing>"
        "</outerBoundaryIs></Polygon>"
        "</Placemark></Document></kml>"
    )


def test_a_kml_is_read_without_gdal_and_its_rings_are_closed(tmp_path: Path) -> None:
    path = tmp_path / "map.kml"
    for end, closed in ((" 9,52,0", False), ("", True)):
        path.write_text(kml("", end=end))
        read = read_prescription(path)
        assert read.data.zones[0].rate_kg_ha == RATE
        assert shapely.Polygon(read.data.zones[0].rings_deg[0][:, ::-1]).equals(BOX)
        assert any(finding.id == "closed_rings" for finding in read.findings) is closed


@pytest.mark.parametrize(
    "text",
    [
        kml('<!DOCTYPE kml [<!ENTITY a "333">]>', "&a;"),
        kml("", end=" x,y"),
        kml("", end=" 9"),
        kml("", end=" nan,52"),
        "<kml>" + "<Folder>" * 100_000,
        "<gpx><Placemark/></gpx>",
        "<kml><Placemark><Polygon><outerBoundaryIs><LinearRing>"
        "<coordinates>1,2 "
        "3,4</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>",
    ],
    ids=["entity", "no numbers", "one number", "nan", "deep", "gpx", "two corners"],
)
def test_a_kml_that_is_none_is_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "map.kml"
    path.write_text(text)
    for read in (read_prescription, read_field_shapes):
        with pytest.raises(ValueError) as said:
            read(path)
        assert len(str(said.value).splitlines()) == 1


@pytest.mark.parametrize("name", ["a.gpkg", "a.kml"])
def test_what_gdal_reads_we_read(tmp_path: Path, name: str) -> None:
    """Layers, columns, numbers, texts in Chinese, holes, several parts, nothing; in metres
    where the format can."""
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    shapes = [
        BOX.difference(BOX.buffer(-0.0003)),
        shapely.MultiPolygon([BOX, shapely.box(9.01, 52, 9.02, 52.01)]),
        shapely.LineString([(9, 52), (9.1, 52.1)]),
        shapely.Point(9, 52),
        None,
    ]
    frame = geopandas.GeoDataFrame(
        {"Name": list("abcde"), "施肥量": [1.5, 2.0, None, 4.0, 5.0], "k": [1, 2, 3, 4, 5]},
        geometry=shapes,
        crs=4326,
    )
    for layer, crs in (("one", 4326), ("two", 32632)):
        frame.to_crs(crs if name == "a.gpkg" else 4326).to_file(
            tmp_path / name, layer=layer, driver="GPKG" if name == "a.gpkg" else "KML"
        )
        if name == "a.kml":
            break
    from topdress.drivers.files.shape_layers import read_layers

    for layer in read_layers(tmp_path / name):
        theirs = geopandas.read_file(tmp_path / name, layer=layer.name).to_crs(4326)
        assert len(theirs) == len(layer.rows)
        for mine, row, other in zip(layer.shapes, layer.rows, theirs.itertuples(), strict=True):
            assert (mine is None) == (other.geometry is None)
            assert mine is None or shapely.equals_exact(
                mine, shapely.force_2d(other.geometry), 1e-9
            )
            assert (row.get("Name"), row.get("k") and int(row["k"])) == (other.Name, int(other.k))
            assert float(row.get("施肥量") or "nan") == pytest.approx(other.施肥量, nan_ok=True)
