"""The farm record: sums by product and field, one line a log; the pass as GeoPackage by another reader."""
from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from drivers.files.exports.as_applied import AsApplied, as_applied
from drivers.files.exports.write import write_as_applied
from drivers.files.read_log import read_log


@pytest.fixture(scope="module")
def logs(topdress: Callable[..., Result], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("logs")
    for seed in (1, 2):
        done = topdress("simulate", "--seconds", "60", "--seed", seed, "--out", folder / f"run{seed}.csv")
        assert done.exit_code == 0, done.output
    return [folder / "run1.csv", folder / "run2.csv"]


def test_a_line_for_each_log(topdress: Callable[..., Result], logs: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "farm.csv"
    said = topdress("record", *logs, "--price", "0.5", "--currency", "USD", "--out", out)
    assert said.exit_code == 0 and "2 added, 0 replaced" in said.output, said.output
    rows = list(csv.DictReader(out.open(encoding="utf-8")))
    applied = [as_applied(read_log(log)) for log in logs]
    for row, one in zip(rows, applied, strict=True):
        kilograms = one.totals.applied_kg
        assert float(row["applied_kg"]) == pytest.approx(kilograms, abs=0.006)
        assert float(row["cost"]) == pytest.approx(0.5 * kilograms, abs=0.006) and row["currency"] == "USD"
        assert float(row["nitrogen_kg"]) == pytest.approx(one.totals.applied_n_kg, abs=0.006)
        assert float(row["worked_ha"]) == pytest.approx(one.worked_ha, abs=6e-5) and row["simulated"] == "yes"
    total = sum(one.totals.applied_kg for one in applied)
    assert f"{total:.2f}" in said.output and f"{0.5 * total:.2f} USD" in said.output
    again = topdress("record", logs[0], "--out", out)
    assert again.exit_code == 0 and "0 added, 1 replaced" in again.output
    rows = list(csv.DictReader(out.open(encoding="utf-8")))
    assert len(rows) == 2 and rows[0]["cost"] == "" and rows[1]["cost"] != ""


def test_what_is_no_record_stays(topdress: Callable[..., Result], logs: list[Path], tmp_path: Path) -> None:
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
    applied: AsApplied = as_applied(read_log(logs[0]))
    write_as_applied(applied, tmp_path / "a.gpkg", polygons)
    frame = geopandas.read_file(tmp_path / "a.gpkg")
    s = applied.stretches
    assert len(frame) == len(s.time_s) and str(frame.crs.to_epsg()) == "4326"
    assert float(frame.applied_kg.sum()) == pytest.approx(float(s.applied_kg.sum()), abs=1e-6)
    assert float(frame.area_m2.sum()) == pytest.approx(float(s.area_m2.sum()), abs=1e-3)
    if polygons:
        assert float(frame.to_crs("EPSG:32651").area.sum()) == pytest.approx(float(s.area_m2.sum()), rel=0.02)
