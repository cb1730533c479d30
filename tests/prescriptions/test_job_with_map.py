"""A job with a map through the commands: simulated, replayed, refused in one line where the map is not there."""
from __future__ import annotations

import csv
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from console.cli import app
from console.worker.assemble import assemble
from console.worker.program import Options
from control.orders import Do, Order
from drivers.files.config import shipped
from drivers.files.read_log import read_log

runner = CliRunner()


def invoke(*words: Any) -> str:
    result = runner.invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.output


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """The shipped map job and its map in a folder of their own."""
    folder = tmp_path / "job"
    folder.mkdir()
    source = shipped("jobs")["map_demo"]
    for path in (source, source.with_suffix(".geojson")):
        shutil.copy(path, folder)
    return folder / "map_demo.yaml"


def test_the_shipped_job_is_right() -> None:
    assert "ok (topdress-job/1)" in invoke("check", "map_demo")


def test_a_run_follows_the_map_and_its_replay_finds_the_map_again(job: Path, tmp_path: Path) -> None:
    log, again = tmp_path / "logs" / "a.csv", tmp_path / "again.csv"
    invoke("simulate", "--job", job, "--seconds", 70, "--out", log)
    rows = rows_of(log)
    by_map = [row for row in rows if row["target_source"] == "map"]
    assert len(by_map) > 800
    assert {"360", "270"} <= {str(round(float(row["target_rate_kg_ha"]))) for row in by_map}
    assert str(job.with_suffix(".geojson")) in read_log(log).meta.sha256        # type: ignore[union-attr]
    invoke("replay", log, "--headless", "--out", again)
    sources = [row["target_source"] for row in rows_of(again)]
    assert sum(a == row["target_source"] for a, row in zip(sources, rows, strict=True)) > 0.99 * len(rows)
    shutil.move(job.with_suffix(".geojson"), log.parent)
    invoke("replay", log, "--headless", "--out", tmp_path / "beside.csv")
    (log.parent / "map_demo.geojson").unlink()
    result = runner.invoke(app, ["replay", str(log), "--headless", "--out", str(tmp_path / "none.csv")])
    assert result.exit_code == 2
    assert "map_demo.geojson: not there" in result.output and len(result.output.strip().splitlines()) == 1


def test_a_map_that_is_missing_is_one_line(job: Path, tmp_path: Path) -> None:
    job.with_suffix(".geojson").unlink()
    result = runner.invoke(app, ["simulate", "--job", str(job), "--seconds", "5"])
    assert result.exit_code == 2
    assert "map_demo.geojson: not there" in result.output and len(result.output.strip().splitlines()) == 1
    with pytest.raises(ValueError, match=r"map_demo\.geojson: not there"):
        assemble(Options((str(job),), tmp_path / "w.json", log=str(tmp_path / "run.csv")), lambda: 0.0)


def test_map_mode_without_a_map_is_said_by_check(job: Path) -> None:
    job.write_text(job.read_text().replace("  map: map_demo.geojson\n", ""))
    result = runner.invoke(app, ["check", str(job)])
    assert result.exit_code == 2
    assert "source map needs the key map" in result.output


def test_the_worker_takes_the_source_map_live_only_with_a_map(job: Path, tmp_path: Path) -> None:
    job.write_text(job.read_text().replace("  source: map ", "  source: canopy "))
    for name, accepted in ((str(job), True), ("demo", False)):
        config = (name,) if accepted else ()
        parts = assemble(Options(config, tmp_path / "w.json", log=str(tmp_path / f"{accepted}.csv")), lambda: 0.0)
        answer = parts.loop.order(Order(Do.SOURCE, "map"))
        assert answer.accepted == accepted
        assert answer.why == ("" if accepted else "source_not_ready")
        parts.bench.close()
        parts.writer.close()
