"""What a stranger's file does not say is asked: headers, units of another scale, rows that cannot be so far apart."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import Result

from drivers.files.read_log import read_log

Topdress = Callable[..., Result]
RNG = np.random.default_rng(4)


def driven(rows: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Duty cycle in %, held for 40 rows, both directions, and the speed in rad/s a row later."""
    duty = np.repeat(RNG.uniform(-80.0, 80.0, rows // 40).round(1), 40)
    return duty, np.concatenate(([0.0], 1.8 * duty[:-1])) + 0.2 * RNG.standard_normal(rows)


def written(path: Path, head: str, *columns: np.ndarray) -> Path:
    lines = [",".join(f"{value:g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*([head] if head else []), *lines]) + "\n")
    return path


def test_a_file_without_a_header_is_guessed_with_names_to_fill_in(topdress: Topdress, tmp_path: Path) -> None:
    raw, place, out = written(tmp_path / "raw.csv", "", *driven()), tmp_path / "m.yaml", tmp_path / "log.csv"
    refused = topdress("diagnose", raw)
    assert refused.exit_code == 2 and "no header row" in refused.output and not out.exists()
    assert topdress("import", raw, "--guess", "--mapping", place, "--machine", "drive_alone").exit_code == 0
    text = place.read_text(encoding="utf-8")
    assert yaml.safe_load(text)["source"]["names"] == ["c1", "c2"]
    assert "c2 follows c1: is that the command of a drive" in text
    for line in ('shaft_rpm_cmd: {from: "c1", scale: 6.5}', 'shaft_rpm: {from: "c2", unit: rad/s}'):
        assert f"# {line}" in text
        text = text.replace(f"# {line}", line)
    place.write_text(text.replace("step_s: 1.0", "step_s: 0.005"), encoding="utf-8")
    done = topdress("import", raw, "--mapping", place, "--out", out)
    assert done.exit_code == 0, done.output
    log = read_log(out)
    assert log.time_s[-1] == pytest.approx(0.005 * 399)
    assert np.nanmax(np.abs(log.numbers("shaft_rpm"))) > 1000.0


def test_what_a_full_command_is_comes_from_the_machine_file(topdress: Topdress, tmp_path: Path) -> None:
    duty, speed = driven()
    raw = written(tmp_path / "raw.csv", "time [s],motor command [%],motor speed actual [rad/s]",
                  0.01 * np.arange(400), duty, speed)
    out = tmp_path / "log.csv"
    asked = topdress("import", raw, "--out", out)
    assert asked.exit_code == 2 and "100 % is in r/min" in asked.output
    done = topdress("import", raw, "--out", out, "--machine", "drive_alone")
    assert done.exit_code == 0, done.output
    assert np.allclose(read_log(out).numbers("shaft_rpm_cmd"), 6.5 * duty, atol=0.06)


def test_rates_as_a_volume_ask_for_the_density(topdress: Topdress, tmp_path: Path) -> None:
    target = np.repeat([150.0, 200.0, 120.0, 180.0], 50)
    raw = written(tmp_path / "spray.csv", "time [s],Target rate (L/ha),Applied rate (L/ha)", np.arange(200.0), target,
                  0.97 * target)
    place, out = tmp_path / "m.yaml", tmp_path / "log.csv"
    asked = topdress("import", raw, "--guess", "--mapping", place)
    assert asked.output.count("density_kg_l") == 2
    said = yaml.safe_load(place.read_text(encoding="utf-8"))
    said["columns"] = {"target_rate_kg_ha": {"from": "Target rate (L/ha)", "unit": "l/ha"},
                       "applied_rate_kg_ha": {"from": "Applied rate (L/ha)", "unit": "l/ha"}}
    place.write_text(yaml.safe_dump(said), encoding="utf-8")
    refused = topdress("import", raw, "--mapping", place, "--out", out)
    assert refused.exit_code == 2 and "allowed with density_kg_l" in refused.output and not out.exists()
    place.write_text(yaml.safe_dump(said | {"density_kg_l": 1.28}), encoding="utf-8")
    assert topdress("import", raw, "--mapping", place, "--out", out).exit_code == 0
    assert np.allclose(read_log(out).numbers("target_rate_kg_ha"), 1.28 * target)


@pytest.mark.parametrize(("step", "asked"), [(1000.0, True), (1.0, False), (1e-6, True)])
def test_rows_that_cannot_be_so_far_apart_are_asked(topdress: Topdress, tmp_path: Path, step: float,
                                                    asked: bool) -> None:
    raw = written(tmp_path / "raw.csv", "time [s],shaft speed [rpm],opening [mm]", step * np.arange(103.0),
                  50.0 + np.arange(103.0) % 7, 20.0 + np.arange(103.0) % 3)
    done = topdress("import", raw, "--out", tmp_path / "log.csv")
    assert ("are the times in another unit?" in done.output) == asked
    assert not asked or "for 103 rows" in done.output


def test_points_without_times_are_not_timed_by_their_longitude(topdress: Topdress, tmp_path: Path) -> None:
    raw = written(tmp_path / "points.csv", "lat_deg,lon_deg,Target rate (kg/ha),Applied rate (kg/ha)",
                  np.full(100, 50.0), 10.0 + 1e-4 * np.arange(100.0), 100.0 + np.arange(100.0) % 9,
                  98.0 + np.arange(100.0) % 9)
    asked = topdress("import", raw, "--out", tmp_path / "log.csv")
    assert "lon_deg alone grows" not in asked.output and "no column tells the time" in asked.output
