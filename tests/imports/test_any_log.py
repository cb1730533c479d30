"""As-applied files of other programs open where a run log does: replay, diagnosis, map; else they are asked about."""
from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from console.cli import app
from console.services.logs import RunLogs
from drivers.files.any_log import open_log
from drivers.files.imports.trouble import ImportTrouble
from drivers.files.point_files import holds_points

UNITS = ("applied_rate_kg_ha", "target_rate_kg_ha", "speed_mps")


def points(path: Path, told: bool = True) -> Path:
    names = UNITS if told else ("AppRate", "TgtRate", "Speed")
    features = [{"type": "Feature", "geometry": {"type": "Point", "coordinates": [119.88, 34.28 + 1.35e-5 * k]},
                 "properties": {"utc": f"2026-03-17T06:{k // 60:02d}:{k % 60:02d}Z",
                                **dict(zip(names, (200.0 + k % 7, 205.0, 1.5), strict=True))}} for k in range(200)]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def run(*words: str) -> str:
    told = CliRunner().invoke(app, list(words))
    assert told.exit_code in (0, 3), told.output
    return told.output


def test_points_are_replayed_diagnosed_and_summed(tmp_path: Path) -> None:
    path = points(tmp_path / "applied.geojson")
    assert holds_points(path)
    assert "(run, 200 rows" in run("diagnose", str(path), "--machine", "huanghai")
    assert "200 rows" in run("replay", str(path), "--headless", "--out", str(tmp_path / "r.csv"))
    told = json.loads(run("map", str(path), "--machine", "huanghai", "--json"))
    assert told["area_ha"] == pytest.approx(199 * 1.5 * 2.4 / 1e4)
    assert told["mean_rate_kg_ha"] == pytest.approx(203.0, abs=0.2)
    assert RunLogs().open(str(path)).name == "applied.geojson"


def test_what_is_unsure_is_asked_and_nothing_is_left(tmp_path: Path) -> None:
    path = points(tmp_path / "applied.geojson", told=False)
    with pytest.raises(ImportTrouble, match="no unit in the header"):
        open_log(path)
    assert [file.name for file in tmp_path.iterdir()] == ["applied.geojson"]
