"""The rate column of a map is taken where its name says so, else asked for; a unit that a file
states anywhere is read: litres are never kilograms. By format and by place."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest
import shapefile
import shapely
from topdress.drivers.files.imports.guess import guess_import_file
from topdress.drivers.files.imports.table_reader import read_raw_table
from topdress.drivers.files.imports.units import find_named_unit
from topdress.drivers.files.prescriptions.map_choices import (
    ACRE_HA,
    LB_AC_KG_HA,
    UNIT_NOT_NAMED,
    RateChoice,
    RateQuestion,
)
from topdress.drivers.files.prescriptions.map_reader import read_prescription
from topdress.drivers.plain_text import RefusedInput

from tests.command import topdress
from tests.geojson import feature, geojson

RATES = [120.5, 150.0, 180.25, 210.0]
BOXES = [shapely.box(116.0 + 0.001 * k, 40.0, 116.001 + 0.001 * k, 40.001) for k in range(4)]
Columns = dict[str, list[Any]]
Write = Callable[[Path, Columns], Path]


def as_geojson(folder: Path, columns: Columns, **members: Any) -> Path:
    return geojson(
        folder / "map.geojson",
        *(
            feature(
                [list(box.exterior.coords)], **{name: values[k] for name, values in columns.items()}
            )
            for k, box in enumerate(BOXES)
        ),
        **members,
    )


def as_shapefile(folder: Path, columns: Columns) -> Path:
    with shapefile.Writer(
        str(folder / "map"), shapeType=shapefile.POLYGON, encoding="utf-8"
    ) as writer:
        for name, values in columns.items():
            writer.field(
                name,
                "C" if isinstance(values[0], str) else "N",
                40,
                0 if isinstance(values[0], str) else 4,
            )
        for k, box in enumerate(BOXES):
            writer.poly([list(box.exterior.coords)])
            writer.record(*(values[k] for values in columns.values()))
    return folder / "map.shp"


def as_csv(folder: Path, columns: Columns, row: str = "") -> Path:
    rows = [
        f'"{box.wkt}";' + ";".join(str(values[k]) for values in columns.values())
        for k, box in enumerate(BOXES)
    ]
    path = folder / "map.csv"
    path.write_text(
        "\n".join([";".join(["WKT", *columns]), *([row] if row else []), *rows]) + "\n",
        encoding="utf-8",
    )
    return path


def _points(columns: Columns) -> list[list[Any]]:
    return [
        [
            40.0 + 1e-4 * (k // 2),
            116.0 + 1e-4 * (k % 2),
            *(values[k] for values in columns.values()),
        ]
        for k in range(4)
    ]


def as_points(folder: Path, columns: Columns, above: str = "", row: str = "") -> Path:
    lines = [",".join(map(str, cells)) for cells in _points(columns)]
    path = folder / "points.csv"
    path.write_text(
        "\n".join(
            [
                *([above] if above else []),
                ",".join(["latitude", "longitude", *columns]),
                *([row] if row else []),
                *lines,
            ]
        )
        + "\n",
        encoding="utf-8",
    )
    return path


def as_sheet(
    folder: Path, columns: Columns, above: list[Any] | None = None, row: list[Any] | None = None
) -> Path:
    book = openpyxl.Workbook()
    for cells in (above, ["latitude", "longitude", *columns], row, *_points(columns)):
        if cells is not None:
            book.active.append(cells)
    book.save(folder / "points.xlsx")
    return folder / "points.xlsx"


def as_geopackage(folder: Path, columns: Columns) -> Path:
    geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
    geopandas.GeoDataFrame(columns, geometry=BOXES, crs=4326).to_file(
        folder / "map.gpkg", layer="map"
    )
    return folder / "map.gpkg"


def as_kml(folder: Path, columns: Columns, shown: str = "") -> Path:
    marks = "".join(
        "<Placemark><ExtendedData>"
        + "".join(
            f'<Data name="{name}">{shown}<value>{values[k]}</value></Data>'
            for name, values in columns.items()
        )
        + "</ExtendedData><Polygon><outerBoundaryIs><LinearRing><coordinates>"
        + " ".join(f"{lon},{lat}" for lon, lat in box.exterior.coords)
        + "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"
        for k, box in enumerate(BOXES)
    )
    (folder / "map.kml").write_text(f"<kml><Document>{marks}</Document></kml>", encoding="utf-8")
    return folder / "map.kml"


def as_raster(
    folder: Path,
    name: str = "rate",
    unit: str = "",
    tags: dict[str, str] | None = None,
    band_tags: dict[str, str] | None = None,
) -> Path:
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    with rasterio.open(
        folder / "map.tif",
        "w",
        driver="GTiff",
        width=2,
        height=2,
        count=1,
        dtype="float64",
        crs="EPSG:4326",
        transform=rasterio.transform.from_origin(116.0, 40.0, 1e-4, 1e-4),
    ) as file:
        file.write(np.array(RATES).reshape(2, 2), 1)
        file.set_band_description(1, name)
        if unit:
            file.set_band_unit(1, unit)
        file.update_tags(**(tags or {}))
        file.update_tags(1, **(band_tags or {}))
    return folder / "map.tif"


FORMATS: dict[str, Write] = {
    "shapefile": as_shapefile,
    "geojson": as_geojson,
    "csv": as_csv,
    "points": as_points,
    "sheet": as_sheet,
    "geopackage": as_geopackage,
    "kml": as_kml,
}


def litres_are_asked_for(path: Path) -> None:
    """Without a density it is a question; with one the mass."""
    with pytest.raises(RateQuestion, match="rates in l/ha, density None"):
        read_prescription(path)
    assert highest(read_prescription(path, RateChoice(density_kg_l=1.25))) == pytest.approx(
        210.0 * 1.25
    )


def highest(read: Any) -> float:
    return max(zone.rate_kg_ha for zone in read.data.zones)


# -- in the table
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "column", ["unit", "UNITS", "rate_unit", "RateUnit", "uom", "Einheit", "单位", "what"]
)
@pytest.mark.parametrize("form", FORMATS)
def test_a_column_of_units_is_read(tmp_path: Path, form: str, column: str) -> None:
    litres_are_asked_for(
        FORMATS[form](tmp_path, {"rate": RATES, column: ["l/ha"] * 4, "zone": [1, 2, 3, 4]})
    )


@pytest.mark.parametrize("form", FORMATS)
def test_a_unit_in_the_name_or_in_the_cells_is_read(tmp_path: Path, form: str) -> None:
    for k, columns in enumerate(
        ({"rate_l_ha": RATES}, {"rate": [f"{rate} l/ha" for rate in RATES]})
    ):
        (tmp_path / str(k)).mkdir()
        litres_are_asked_for(FORMATS[form](tmp_path / str(k), columns))


@pytest.mark.parametrize(
    ("text", "kg_ha"),
    [
        ("kg/ha", 1.0),
        ("KG HA-1", 1.0),
        ("kilograms per hectare", 1.0),
        ("lb/ac", LB_AC_KG_HA),
        ("lbs per acre", LB_AC_KG_HA),
        ("kg/acre", 1.0 / ACRE_HA),
        ("t/ha", 1000.0),
        ("g/m²", 10.0),
        ("公斤/亩", 15.0),
    ],
)
@pytest.mark.parametrize("form", ["shapefile", "geojson"])
def test_units_of_mass_count_as_what_they_are(
    tmp_path: Path, form: str, text: str, kg_ha: float
) -> None:
    read = read_prescription(
        FORMATS[form](tmp_path, {"rate": [0.5, 1.5, 2.25, 3.0], "unit": [text] * 4})
    )
    assert highest(read) == pytest.approx(3.0 * kg_ha)
    assert read.unit_from == "named in column unit"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gal/ac", "rates in gal/ac, density None"),
        ("gallons per acre", "rates in gal/ac, density None"),
        ("GPA", "rates in gal/ac, density None"),
        ("L/acre", "rates in l/ac, density None"),
        ("kg N/ha", "rates in kg N/ha, nitrogen None"),
        ("lb N/ac", "rates in lb N/ac, nitrogen None"),
        ("seeds/ha", "unit seeds/ha in column unit: say"),
        ("bags/ac", "unit bags/ac in column unit: say"),
        ("ml/ha", "unit ml/ha in column unit: say"),
        ("oz", "unit oz in column unit: say"),
    ],
)
@pytest.mark.parametrize("form", ["shapefile", "geojson"])
def test_units_of_anything_else_are_asked(tmp_path: Path, form: str, text: str, said: str) -> None:
    path = FORMATS[form](tmp_path, {"rate": RATES, "unit": [text] * 4})
    with pytest.raises(RateQuestion, match=said):
        read_prescription(path)
    assert highest(read_prescription(path, RateChoice(unit="kg/ha"))) == 210.0, (
        "the operator's word stands"
    )


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (
            {"rate": RATES, "unit": ["l/ha", "kg/ha", "l/ha", "l/ha"]},
            "unit kg/ha, l/ha in column unit",
        ),
        (
            {"rate_kg_ha": RATES, "unit": ["l/ha"] * 4},
            "unit l/ha in column unit, kg/ha by its own name",
        ),
        ({"N_rate": RATES, "unit": ["kg/ha"] * 4}, "kg of nitrogen or of the product"),
        ({"rate": ["120 kg/ha", "120 l/ha", "3 kg/ha", "4 kg/ha"]}, "in kg/ha, l/ha"),
        ({"rate": ["120 bags", "3 bags", "3 bags", "4 bags"]}, "bags"),
        ({"Rate_L": RATES}, "in L"),
        ({"dose_lb": RATES}, "in lb"),
        ({"Rate (ml/ha)": RATES}, "none is named|ml/ha"),
        ({"rate_oz_ac": RATES}, "oz_ac"),
    ],
)
def test_what_says_two_things_is_asked_chosen_or_not(
    tmp_path: Path, columns: Columns, said: str
) -> None:
    path = as_geojson(tmp_path, columns)
    with pytest.raises(RateQuestion, match=said):
        read_prescription(path)
    with pytest.raises(RateQuestion):
        read_prescription(path, RateChoice(column=next(iter(columns))))


def test_a_column_of_units_is_of_the_rate_that_it_names(tmp_path: Path) -> None:
    path = as_geojson(
        tmp_path, {"Rate1": RATES, "Unit1": ["kg/ha"] * 4, "Rate2": RATES, "Unit2": ["l/ha"] * 4}
    )
    assert highest(read_prescription(path, RateChoice(column="Rate1"))) == 210.0
    with pytest.raises(RateQuestion, match="rates in l/ha"):
        read_prescription(path, RateChoice(column="Rate2"))


@pytest.mark.parametrize(
    "columns",
    [
        {"rate": RATES, "Mgmt_Unit": ["North", "South", "East", "West"]},
        {"rate": RATES, "unit": [1, 2, 3, 4]},
        {"rate": RATES, "yield": RATES, "yield_unit": ["t/ha"] * 4},
        {"rate": RATES, "soil_unit": ["Lw"] * 4},
        {"rate": RATES, "Area": RATES, "Area_Unit": ["ha"] * 4},
        {"rate": RATES, "product": ["urea"] * 4},
    ],
)
def test_other_units_are_none_of_the_rate(tmp_path: Path, columns: Columns) -> None:
    read = read_prescription(as_geojson(tmp_path, columns))
    assert (highest(read), read.unit_from) == (210.0, UNIT_NOT_NAMED)


# -- next to the table
# -------------------------------------------------------------------------------------------------


def _data_columns(path: Path) -> None:
    with sqlite3.connect(path) as base:
        base.execute(
            "CREATE TABLE gpkg_data_columns (table_name TEXT, column_name TEXT, name TEXT, "
            "title TEXT, "
            "description TEXT)"
        )
        base.execute(
            "INSERT INTO gpkg_data_columns VALUES ('map', 'rate', NULL, 'Target rate (l/ha)', NULL)"
        )
    base.close()


def _style(path: Path) -> None:
    with sqlite3.connect(path) as base:
        base.execute("CREATE TABLE layer_styles (f_table_name TEXT, styleQML TEXT)")
        base.execute("INSERT INTO layer_styles VALUES ('map', ?)", (QML,))
    base.close()


QML = '<qgis><aliases><alias name="Rate (l/ha)" field="rate" index="0"/></aliases></qgis>'
ESRI = (
    "<metadata><attr><attrlabl>rate</attrlabl><attrdomv><rdom><attrunit>l/ha</attrunit>"
    "</rdom></attrdomv></attr>"
    "</metadata>"
)
DEERE = json.dumps(
    {"DataAttributes": [{"Name": "rate", "Unit": "l1ha-1"}, {"Name": "zone", "Unit": "m"}]}
)
PLAIN: Columns = {"rate": RATES, "zone": [1, 2, 3, 4]}
PLACES: dict[str, Callable[[Path], Path | tuple[Path, str, str]]] = {
    "shapefile: .shp.xml": lambda folder: (as_shapefile(folder, PLAIN), "map.shp.xml", ESRI),
    "shapefile: .xml": lambda folder: (as_shapefile(folder, PLAIN), "MAP.XML", ESRI),
    "shapefile: -Deere-Metadata.json": lambda folder: (
        as_shapefile(folder, PLAIN),
        "map-Deere-Metadata.json",
        DEERE,
    ),
    "shapefile: .qml": lambda folder: (as_shapefile(folder, PLAIN), "map.qml", QML),
    "geojson: .qml": lambda folder: (as_geojson(folder, PLAIN), "map.qml", QML),
    "geojson: -Metadata.json": lambda folder: (
        as_geojson(folder, PLAIN),
        "map-Metadata.json",
        DEERE,
    ),
    "geojson: member unit": lambda folder: as_geojson(folder, PLAIN, unit="l/ha"),
    "geojson: member rateUnit": lambda folder: as_geojson(
        folder, PLAIN, metadata={"products": [{"rateUnit": "L/ha"}]}
    ),
    "geojson: member units": lambda folder: as_geojson(
        folder, PLAIN, units={"rate": "l/ha", "zone": "m"}
    ),
    "geojson: member fields": lambda folder: as_geojson(
        folder, PLAIN, fields=[{"name": "rate", "uom": "l/ha"}]
    ),
    "csv: row of units": lambda folder: as_csv(folder, PLAIN, ";l/ha;"),
    "csv: .qml": lambda folder: (as_csv(folder, PLAIN), "map.qml", QML),
    "points: row of units": lambda folder: as_points(folder, {"rate": RATES}, row="deg,deg,l/ha"),
    "points: line above": lambda folder: as_points(folder, {"rate": RATES}, above="# unit: l/ha"),
    "sheet: row of units": lambda folder: as_sheet(
        folder, {"rate": RATES}, row=["deg", "deg", "l/ha"]
    ),
    "sheet: row above": lambda folder: as_sheet(folder, {"rate": RATES}, above=["Unit:", "l/ha"]),
    "kml: displayName": lambda folder: as_kml(
        folder, {"rate": RATES}, "<displayName>Rate (l/ha)</displayName>"
    ),
    "kml: .qml": lambda folder: (as_kml(folder, {"rate": RATES}), "map.qml", QML),
    "geotiff: unit of the band": lambda folder: as_raster(folder, unit="l/ha"),
    "geotiff: name of the band": lambda folder: as_raster(folder, name="rate_l_ha"),
    "geotiff: tag": lambda folder: as_raster(folder, tags={"UNITS": "l/ha"}),
    "geotiff: tag of the band": lambda folder: as_raster(folder, band_tags={"unit": "l/ha"}),
    "geotiff: .tif.aux.xml": lambda folder: (
        as_raster(folder),
        "map.tif.aux.xml",
        "<PAMDataset><PAMRasterBand band='1'><UnitType>l/ha</UnitType>"
        "</PAMRasterBand></PAMDataset>",
    ),
}


@pytest.mark.parametrize("place", PLACES)
def test_a_unit_next_to_the_table_is_read(tmp_path: Path, place: str) -> None:
    made = PLACES[place](tmp_path)
    path, name, text = made if isinstance(made, tuple) else (made, "", "")
    if name:
        assert highest(read_prescription(path)) == 210.0
        (tmp_path / name).write_text(text, encoding="utf-8")
    litres_are_asked_for(path)


@pytest.mark.parametrize("say", [_data_columns, _style])
def test_a_unit_in_a_geopackages_own_tables_is_read(
    tmp_path: Path, say: Callable[[Path], None]
) -> None:
    path = as_geopackage(tmp_path, PLAIN)
    assert highest(read_prescription(path)) == 210.0
    say(path)
    litres_are_asked_for(path)


def test_a_unit_that_is_not_the_rates_next_to_the_table_is_passed_over(tmp_path: Path) -> None:
    path = as_geojson(
        tmp_path, PLAIN, unit="m", metadata={"units": "metric", "area": {"unit": "ha"}}
    )
    (tmp_path / "map.xml").write_text("<metadata><spref><unit>degrees</unit></spref></metadata>")
    assert highest(read_prescription(path)) == 210.0


@pytest.mark.parametrize("shown", ["seeds/ha", "bags", ""])
def test_a_task_files_numbers_are_by_its_identifier(tmp_path: Path, shown: str) -> None:
    """DDI 0001 is a volume whatever it is shown in."""
    corners = "".join(f'<PNT A="2" C="{lat}" D="{lon}"/>' for lon, lat in BOXES[0].exterior.coords)
    (tmp_path / "TASKDATA.XML").write_text(
        '<ISO11783_TaskData VersionMajor="4" VersionMinor="0" DataTransferOrigin="1"><VPN '
        'A="VPN1" B="0" C="0.01" '
        f'D="1" E="{shown}"/><TSK A="TSK1" G="1"><TZN A="1"><PLN A="2"><LSG '
        f'A="1">{corners}</LSG></PLN>'
        '<PDV A="0001" B="12000" E="VPN1"/></TZN></TSK></ISO11783_TaskData>'
    )
    with pytest.raises(RateQuestion, match="density None"):
        read_prescription(tmp_path / "TASKDATA.XML")


# -- the commands, and logs
# --------------------------------------------------------------------------------------------


def test_nothing_is_exported_as_kilograms(tmp_path: Path) -> None:
    path = as_shapefile(tmp_path, {"rate": RATES, "unit": ["l/ha"] * 4})
    out = tmp_path / "out.geojson"
    said = topdress("map", path, "--out", out)
    assert said.exit_code == 2 and "rates in l/ha, density None" in said.output and not out.exists()
    said = topdress("map", path, "--out", out, "--density", "1.3")
    assert said.exit_code == 0 and "l/ha named in column unit" in said.output
    assert highest(read_prescription(out)) == pytest.approx(210.0 * 1.3)


def test_a_log_in_litres_is_none_in_kilograms(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{k},40.0,{116 + 1e-5 * k},{150 + k % 7},l/ha" for k in range(200)]
    path.write_text("\n".join(["time_s,lat,lon,applied_rate,unit", *rows]) + "\n")
    raw = read_raw_table(path)
    assert raw.units["applied_rate"] == "l/ha"
    found = guess_import_file(raw)
    assert (
        "applied_rate_kg_ha" not in found.mapping.columns
        and "density_kg_l" in found.open["applied_rate_kg_ha"]
    )


@pytest.mark.parametrize("text", ["m/s", "ha", "t", "10", "", "low", "l/h", "lac", "kg/h"])
def test_no_rate_is_made_of_other_words(text: str) -> None:
    found = find_named_unit(text)
    assert found is None or found.quantity not in ("rate", "volume", "nitrogen", "count")


def test_a_damaged_file_next_to_a_map_is_no_trouble(tmp_path: Path) -> None:
    path = as_geojson(tmp_path, PLAIN)
    for name, text in (("map.xml", "<a"), ("map.qml", "[" * 100_000), ("map-Metadata.json", "{")):
        (tmp_path / name).write_text(text)
    assert highest(read_prescription(path)) == 210.0
    (tmp_path / "map.xml").write_bytes(b" " * (2 << 20))
    with pytest.raises(RefusedInput, match="allowed up to 1048576"):
        read_prescription(path)


# -- which column is the rate
# ------------------------------------------------------------------------------------------

IDS = [1, 2, 3, 4]


@pytest.fixture(params=[as_geojson, as_shapefile, as_csv], ids=["geojson", "shapefile", "csv"])
def write(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[Columns], Path]:
    return lambda columns: request.param(tmp_path, columns)


ASKED: list[tuple[Columns, str]] = [
    ({"ID": IDS}, "number or a class"),
    ({"CLASS": [1, 2, 3, 3]}, "number or a class"),
    ({"AREA_HA": [0.25, 0.3, 0.3, 0.2]}, "a size"),
    ({"EC_SH": [35.1, 40.2, 28.8, 33.0]}, "a measurement"),
    ({"NDVI": [0.4, 0.5, 0.6, 0.7]}, "a measurement"),
    ({"RATE_ID": IDS}, "none is named as a rate"),
    ({"Yield_rate": RATES}, "a measurement"),
    ({"NITRATE": RATES}, "none is named"),
    ({"Soil_K": RATES}, "none is named"),
    ({"rate": RATES, "dose": [9.0, 8.0, 7.0, 6.0]}, "2 are named as rates"),
    ({"Rate": IDS}, "counts 0, 1, 2"),
    ({"rate": [0.1, 0.2, 0.25, 0.3]}, "nothing above 1"),
    ({"N_RATE": RATES}, "nitrogen or of the product"),
    ({"gridcode": IDS, "Shape_Area": RATES}, "none is named"),
    ({"面积": RATES}, "none is named"),
    ({"TGT_KG": RATES}, "none is named"),
]


@pytest.mark.parametrize(
    ("columns", "why"), ASKED, ids=lambda value: "-".join(value) if isinstance(value, dict) else ""
)
def test_what_may_be_something_else_is_asked(
    write: Callable[[Columns], Path], columns: Columns, why: str
) -> None:
    with pytest.raises(RateQuestion, match=why) as asked:
        read_prescription(write(columns))
    assert len(str(asked.value).splitlines()) == 1
    assert all(name in str(asked.value) for name in columns)


TAKEN: list[tuple[Columns, str, str]] = [
    ({"ID": IDS, "Tgt_Rate": RATES}, "Tgt_Rate", "kg/ha"),
    ({"OBJECTID": IDS, "dose": RATES, "Shape_Area": RATES}, "dose", "kg/ha"),
    ({"ID": IDS, "DOSE_TXT": ["120,5", "150,0", "180,25", "210,0"]}, "DOSE_TXT", "kg/ha"),
    ({"rate": ["120,5", "1.150,0", "180,25", "210"]}, "rate", "kg/ha"),
    ({"rate": ["120.5 kg/ha", "150 kg/ha", "180.25 kg/ha", ""]}, "rate", "kg/ha"),
    ({"Rate_lb_ac": RATES}, "Rate_lb_ac", "lb/ac"),
    ({"TARGETRATE": RATES, "APPLIEDRAT": RATES[::-1]}, "TARGETRATE", "kg/ha"),
    ({"ZONE_RATE": RATES, "ZONE": IDS}, "ZONE_RATE", "kg/ha"),
    ({"TARGET_RAT": RATES}, "TARGET_RAT", "kg/ha"),
    ({"PRESCRIPTI": RATES}, "PRESCRIPTI", "kg/ha"),
    ({"Sollmenge": RATES}, "Sollmenge", "kg/ha"),
    ({"施肥量": RATES, "编号": IDS}, "施肥量", "kg/ha"),
    ({"rate_kg_mu": RATES}, "rate_kg_mu", "kg/mu"),
]


@pytest.mark.parametrize(
    ("columns", "name", "unit"),
    TAKEN,
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_what_its_name_says_is_taken_and_said(
    write: Callable[[Columns], Path], columns: Columns, name: str, unit: str
) -> None:
    path = write(columns)
    read = read_prescription(path)
    assert (read.layers, read.unit) == ((name,), unit)
    assert read.data.zones[0].rate_kg_ha == pytest.approx(
        120.5 * {"kg/ha": 1.0, "lb/ac": LB_AC_KG_HA, "kg/mu": 15.0}[unit]
    )
    told = topdress("map", path)
    assert f"rates        {name} (by its name" in told.stdout
    named = unit in ("lb/ac", "kg/mu") or "kg/ha" in str(columns)
    assert f"{unit} {'named in the file' if named else 'as the file'}" in told.stdout


def test_the_operators_choice_stands(write: Callable[[Columns], Path]) -> None:
    path = write({"ID": IDS, "EC_SH": RATES, "N_RATE": RATES})
    assert read_prescription(path, RateChoice(column="EC_SH")).data.zones[0].rate_kg_ha == 120.5
    assert (
        read_prescription(path, RateChoice(column="N_RATE", n_fraction=0.5))
        .data.zones[0]
        .rate_kg_ha
        == 241.0
    )
    assert (
        read_prescription(path, RateChoice(column="N_RATE", unit="kg/ha")).data.zones[0].rate_kg_ha
        == 120.5
    )


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('WKT,rate\n"POLYGON ((1 2, 3 4",5\n', "row 2: not readable as WKT"),
        ('WKT,rate\n"POLYGON ((1 2', "not readable as CSV"),
        ('WKT,rate\n"POLYGON ((1 2,1 3,2 3,1 2))"\n', "row 2: 1 cells: allowed 2"),
        ('WKT,rate\n"SRID=3857;POLYGON ((1 2,1 3,2 3,1 2))",3\n', "SRID 3857: allowed 4326"),
        ('WKT,rate\n"POLYGON ((1 200,1 300,2 300,1 200))",3\n', "allowed are degrees"),
    ],
)
def test_csv_that_cannot_be_used(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "m.csv"
    path.write_text(text)
    with pytest.raises(RefusedInput, match=why):
        read_prescription(path)
