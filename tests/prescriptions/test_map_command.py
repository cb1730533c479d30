"""`topdress map` as a person types it."""
from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from console.cli import app
from drivers.files.prescriptions.read import read_prescription


def topdress(*words: object) -> Result:
    return CliRunner().invoke(app, ["map", *map(str, words)])


@pytest.fixture
def square(tmp_path: Path) -> Path:
    ring = [[116.0, 40.0], [116.001, 40.0], [116.001, 40.001], [116.0, 40.001], [116.0, 40.0]]
    file = tmp_path / "square.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": [
        {"type": "Feature", "properties": {"rate": 200.0},
         "geometry": {"type": "Polygon", "coordinates": [ring]}}]}))
    return file


def test_a_map_is_told(square: Path) -> None:
    told = topdress(square)
    assert told.exit_code == 0
    assert "1 zone, numbers in kg/ha" in told.stdout
    assert "altogether   0.9482 ha, 189.63 kg, mean 200.00 kg/ha" in told.stdout


@pytest.mark.parametrize("out", ["o.geojson", "o.shp", "o.zip", "task"])
def test_a_map_is_converted(square: Path, tmp_path: Path, out: str) -> None:
    told = topdress(square, "--out", tmp_path / "new" / out, "--unit", "g/m2", "--scale", "0.1", "--json")
    assert told.exit_code == 0
    assert json.loads(told.stdout)["mass_kg"] == pytest.approx(189.63, abs=0.01)
    again = read_prescription(tmp_path / "new" / out)
    assert [zone.rate_kg_ha for zone in again.data.zones] == [200.0]


def test_fallbacks_go_along_to_a_task(square: Path, tmp_path: Path) -> None:
    topdress(square, "--out", tmp_path / "o.zip", "--default", "90", "--outside", "1", "--lost", "45")
    assert tuple(read_prescription(tmp_path / "o.zip").data.fallbacks) == (90.0, 1.0, 45.0)


@pytest.mark.parametrize("words", [("--unit", "bags"), ("--column", "dose"), ("--rate-from", "guess"),
                                   ("--out", "x.pdf")])
def test_what_cannot_be_is_one_line_and_no_success(square: Path, words: tuple[str, str]) -> None:
    told = topdress(square, *words)
    assert told.exit_code != 0
    assert told.stdout == ""
    assert len(told.stderr.strip().splitlines()) == 1 and "allowed" in told.stderr


def test_the_source_is_never_written_over(square: Path) -> None:
    before = square.read_bytes()
    told = topdress(square, "--out", square)
    assert told.exit_code != 0
    assert square.read_bytes() == before
