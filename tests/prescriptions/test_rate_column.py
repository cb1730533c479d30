"""The rate column of a map is taken where its name says so, and said; else it is asked for. All formats alike."""
from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import shapefile
from typer.testing import CliRunner

from console.cli import app
from drivers.files.prescriptions.read import read_prescription
from drivers.files.prescriptions.words import LB_AC_KG_HA, Choice, RateQuestion
from drivers.plain_text import Refused

Columns = dict[str, list[Any]]
RINGS = [[(116.0 + 0.001 * k, 40.0), (116.0 + 0.001 * k, 40.001), (116.001 + 0.001 * k, 40.001),
          (116.001 + 0.001 * k, 40.0), (116.0 + 0.001 * k, 40.0)] for k in range(4)]


def as_geojson(folder: Path, columns: Columns) -> Path:
    features = [{"type": "Feature", "properties": {name: values[k] for name, values in columns.items()},
                 "geometry": {"type": "Polygon", "coordinates": [RINGS[k]]}} for k in range(4)]
    path = folder / "map.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8")
    return path


def as_shapefile(folder: Path, columns: Columns) -> Path:
    with shapefile.Writer(str(folder / "map"), shapeType=shapefile.POLYGON, encoding="utf-8") as writer:
        for name, values in columns.items():
            if isinstance(values[0], str):
                writer.field(name, "C", 40)
            else:
                writer.field(name, "N", 14, 4)
        for k in range(4):
            writer.poly([RINGS[k]])
            writer.record(*(values[k] for values in columns.values()))
    return folder / "map.shp"


def as_csv(folder: Path, columns: Columns) -> Path:
    path = folder / "map.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, delimiter=";")
        writer.writerow(["WKT", *columns])
        for k in range(4):
            corners = ", ".join(f"{lon} {lat}" for lon, lat in RINGS[k])
            writer.writerow([f"POLYGON (({corners}))", *(values[k] for values in columns.values())])
    return path


@pytest.fixture(params=[as_geojson, as_shapefile, as_csv], ids=["geojson", "shapefile", "csv"])
def write(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[Columns], Path]:
    return lambda columns: request.param(tmp_path, columns)


RATES = [120.5, 150.0, 180.25, 210.0]
IDS = [1, 2, 3, 4]

ASKED: list[tuple[Columns, str]] = [
    ({"ID": IDS}, "number or a class"), ({"CLASS": [1, 2, 3, 3]}, "number or a class"),
    ({"AREA_HA": [0.25, 0.3, 0.3, 0.2]}, "a size"), ({"EC_SH": [35.1, 40.2, 28.8, 33.0]}, "a measurement"),
    ({"NDVI": [0.4, 0.5, 0.6, 0.7]}, "a measurement"), ({"RATE_ID": IDS}, "none is named as a rate"),
    ({"Yield_rate": RATES}, "a measurement"), ({"NITRATE": RATES}, "none is named"),
    ({"Soil_K": RATES}, "none is named"),
    ({"rate": RATES, "dose": [9.0, 8.0, 7.0, 6.0]}, "2 are named as rates"), ({"Rate": IDS}, "counts 0, 1, 2"),
    ({"rate": [0.1, 0.2, 0.25, 0.3]}, "nothing above 1"), ({"N_RATE": RATES}, "nitrogen or of the product"),
    ({"gridcode": IDS, "Shape_Area": RATES}, "none is named"), ({"面积": RATES}, "none is named"),
    ({"TGT_KG": RATES}, "none is named")]


@pytest.mark.parametrize(("columns", "why"), ASKED, ids=lambda value: "-".join(value) if isinstance(
    value, dict) else "")
def test_what_may_be_something_else_is_asked(write: Callable[[Columns], Path], columns: Columns, why: str) -> None:
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
    ({"ZONE_RATE": RATES, "ZONE": IDS}, "ZONE_RATE", "kg/ha"), ({"TARGET_RAT": RATES}, "TARGET_RAT", "kg/ha"),
    ({"PRESCRIPTI": RATES}, "PRESCRIPTI", "kg/ha"), ({"Sollmenge": RATES}, "Sollmenge", "kg/ha"),
    ({"施肥量": RATES, "编号": IDS}, "施肥量", "kg/ha"), ({"rate_kg_mu": RATES}, "rate_kg_mu", "kg/mu")]


@pytest.mark.parametrize(("columns", "name", "unit"), TAKEN, ids=lambda value: "-".join(value) if isinstance(
    value, dict) else "")
def test_what_its_name_says_is_taken_and_said(write: Callable[[Columns], Path], columns: Columns, name: str,
                                              unit: str) -> None:
    path = write(columns)
    read = read_prescription(path)
    assert (read.layers, read.unit) == ((name,), unit)
    assert read.data.zones[0].rate_kg_ha == pytest.approx(
        120.5 * {"kg/ha": 1.0, "lb/ac": LB_AC_KG_HA, "kg/mu": 15.0}[unit])
    told = CliRunner().invoke(app, ["map", str(path)])
    assert f"rates        {name} (by its name" in told.stdout
    assert f"{unit} {'named in the file' if unit in ('lb/ac', 'kg/mu') or 'kg/ha' in str(columns) else 'as the file'}" \
        in told.stdout


def test_the_operators_choice_stands(write: Callable[[Columns], Path]) -> None:
    path = write({"ID": IDS, "EC_SH": RATES, "N_RATE": RATES})
    assert read_prescription(path, Choice(column="EC_SH")).data.zones[0].rate_kg_ha == 120.5
    assert read_prescription(path, Choice(column="N_RATE", n_fraction=0.5)).data.zones[0].rate_kg_ha == 241.0
    assert read_prescription(path, Choice(column="N_RATE", unit="kg/ha")).data.zones[0].rate_kg_ha == 120.5


@pytest.mark.parametrize(("text", "why"), [
    ("WKT,rate\n\"POLYGON ((1 2, 3 4\",5\n", "row 2: not readable as WKT"),
    ("WKT,rate\n\"POLYGON ((1 2", "not readable as CSV"),
    ("WKT,rate\n\"POLYGON ((1 2,1 3,2 3,1 2))\"\n", "row 2: 1 cells: allowed 2"),
    ("WKT,rate\n\"SRID=3857;POLYGON ((1 2,1 3,2 3,1 2))\",3\n", "SRID 3857: allowed 4326"),
    ("WKT,rate\n\"POLYGON ((1 200,1 300,2 300,1 200))\",3\n", "allowed are degrees")])
def test_csv_that_cannot_be_used(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "m.csv"
    path.write_text(text)
    with pytest.raises(Refused, match=why):
        read_prescription(path)
