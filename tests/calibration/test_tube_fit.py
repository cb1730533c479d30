"""A step between two rates at the rig says what starts cannot: whether the stream carries what falls."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from console.cli import app
from control.calibration.bench_table import BenchTable
from control.calibration.tube_fit import settle_tube
from control.machine.machine import Machine
from drivers.files.config import load
from drivers.files.kinds import MACHINE

SHIPPED = Machine()


def half_way_s(singly: bool) -> float:
    """A rig of our own: granules leave a shaft that goes from 40 to 80 r/min, the plate counts them. Drop times of the
    referee's line where each falls singly, else of the lag paper's running shaft."""
    step_s = 0.002
    lands: list[float] = []
    weights: list[float] = []
    times = np.arange(-3.0, 4.0, step_s)
    rise = np.where(times < 0.15, 200.0 * np.maximum(0.0, times), 40.0 - 10.0 * np.exp(-(times - 0.15) / 0.05))
    rpm = 40.0 + rise           # at most 200 r/min per s, and to the end with a time constant of 0.05 s
    drop = 1.7916 - 0.01331 * rpm if singly else 1.8288 - 0.0083 * rpm - 1.69e-3 * 0.0083 * rpm ** 2
    way = np.concatenate([[0.0], np.cumsum(step_s / drop[:-1])])
    for k, t in enumerate(times):
        at = t + drop[k] if singly else float(np.interp(way[k] + 1.0, way, times, right=np.nan))
        if np.isfinite(at):
            lands.append(at)
            weights.append(rpm[k])
    counted, edges = np.histogram(lands, np.arange(-1.0, 2.6, 0.01), weights=weights)
    level = counted / np.median(counted[edges[:-1] < -0.2]) * 40.0
    best = np.argmin(np.cumsum(level - 60.0))
    return float(edges[best + 1])


def table(drop_s: float, rows: int = 10, scatter_s: float = 0.03) -> BenchTable:
    drops = drop_s + scatter_s * np.random.default_rng(3).standard_normal(rows)
    return BenchTable("lag", {"before_rpm": np.full(rows, 40.0), "shaft_rpm": np.full(rows, 80.0), "drop_s": drops},
                      path="steps.csv")


def test_ten_steps_tell_the_two_apart() -> None:
    carried, _ = settle_tube(table(half_way_s(singly=False)), SHIPPED)
    singly, fit = settle_tube(table(half_way_s(singly=True)), SHIPPED)
    assert not SHIPPED.tube_is_settled, "what ships was measured by starts alone"
    assert carried.tube_is_settled and carried.fall.carried_share >= 0.8
    assert singly.tube_is_settled and singly.fall.carried_share <= 0.4
    assert fit.rows_used == 10 and fit.sd < 0.2 and fit.settles
    assert singly.adopted[-1].id == "fall.carried_share" and singly.adopted[-1].high <= 0.7


def test_few_or_foreign_rows_settle_nothing() -> None:
    with pytest.raises(ValueError, match=r"steps.csv: 2 rows of a change between two rates .* at least 3"):
        settle_tube(table(0.9, rows=2), SHIPPED)
    with pytest.raises(ValueError, match=r"steps.csv: column drop_s: .* off the nearest that any tube gives"):
        settle_tube(table(2.6), SHIPPED)
    wide, fit = settle_tube(table(0.95, rows=3, scatter_s=0.4), SHIPPED)
    assert not fit.settles and not wide.tube_is_settled


def test_calibrate_lag_takes_a_table_of_steps(tmp_path: Path) -> None:
    drop = half_way_s(singly=True)
    rows = "".join(f"40,80,{k},{drop + 0.01 * (k % 3 - 1):.3f}\n" for k in range(10))
    (tmp_path / "steps.csv").write_text("before_rpm,shaft_rpm,replicate,drop_s\n" + rows, encoding="utf-8")
    out = tmp_path / "mine.yaml"
    result = CliRunner().invoke(app, ["calibrate", "lag", str(tmp_path / "steps.csv"), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "tube: 10 changes between two rates" in result.output
    mine = load(str(out), MACHINE).model
    assert mine.tube_is_settled and mine.fall.carried_share <= 0.4 and mine.fall.intercept_s == pytest.approx(1.8288)


def test_a_table_of_starts_says_what_is_missing(tmp_path: Path) -> None:
    rows = "".join(f"{n},{1.8288 - 0.0083 * n + 0.01 * k:.3f}\n" for n in (10, 30, 50, 70) for k in (-1, 0, 1))
    (tmp_path / "starts.csv").write_text("shaft_rpm,drop_s\n" + rows, encoding="utf-8")
    result = CliRunner().invoke(app, ["calibrate", "lag", str(tmp_path / "starts.csv"), "--out",
                                      str(tmp_path / "mine.yaml")])
    assert result.exit_code == 0 and "a step from 40 to 80 r/min at the rig, ten times" in result.output
    result = CliRunner().invoke(app, ["diagnose", str(tmp_path / "starts.csv")])
    assert "a step from 40 to 80 r/min at the rig, ten times" in result.output, result.output
