"""Rows of a shaft that turned before: the settled drop of a running shaft, not the line of starts."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from control.calibration.bench_table import BenchTable
from control.calibration.lag_fit import fit_lag
from control.diagnosis.tables import diagnose_tables
from control.diagnosis.tables.across import across
from control.diagnosis.tables.rows import pieces_of
from control.machine.fall import drop_s, start_drop_s
from control.machine.machine import Machine
from control.machine.start import response_s
from drivers.files.bench_table import read_bench_table

MACHINE = Machine()
RPM = np.tile([30.0, 40.0, 50.0, 60.0, 70.0], 8)
BEFORE = np.repeat([20.0, 25.0], 20)
DEAD_S = MACHINE.shaft.dead_time_s
SETTLED_S = np.array([drop_s(MACHINE.fall, n) for n in RPM.tolist()])
START_S = np.array([start_drop_s(MACHINE.fall, n) for n in RPM.tolist()])
RESPONSE_S = np.array([response_s(MACHINE, n) for n in RPM.tolist()])


def noise(seed: int, sd: float = 0.01) -> np.ndarray:
    return sd * np.random.default_rng(seed).standard_normal(len(RPM))


def table(lag_s: np.ndarray, before: np.ndarray | None = BEFORE) -> BenchTable:
    columns = {"shaft_rpm": RPM, "lag_s": lag_s}
    return BenchTable("lag", columns if before is None else {**columns, "before_rpm": before}, path="lags.csv")


def test_a_running_shaft_is_predicted_with_its_settled_drop() -> None:
    (piece,) = pieces_of(table(DEAD_S + SETTLED_S), MACHINE)
    assert piece.predict(MACHINE) == pytest.approx(DEAD_S + SETTLED_S)
    standing = np.where(BEFORE > 20.0, BEFORE, np.where(RPM > 40.0, 0.0, np.nan))       # 0 or not known: it stood
    (piece,) = pieces_of(table(DEAD_S + SETTLED_S, standing), MACHINE)
    assert piece.predict(MACHINE) == pytest.approx(np.where(BEFORE > 20.0, DEAD_S + SETTLED_S, RESPONSE_S + START_S))


@pytest.mark.parametrize("seed", range(5))
def test_a_nominal_machine_that_runs_shows_nothing(seed: int) -> None:
    found = diagnose_tables([table(DEAD_S + SETTLED_S + noise(seed))], MACHINE)
    assert found.verdict == "none", [cause.id for cause in found.causes]
    said = diagnose_tables([table(DEAD_S + SETTLED_S + noise(seed), before=None)], MACHINE)
    assert said.verdict != "none"                           # taken for starts, the same times are too short


def test_misses_of_a_running_shaft_are_predicted_with_its_settled_drop() -> None:
    missed = BenchTable("place", {"shaft_rpm": RPM, "before_rpm": BEFORE, "speed_mps": np.full(len(RPM), 1.2),
                                  "corrected_lag_s": np.zeros(len(RPM)),
                                  "miss_m": 1.2 * (DEAD_S + SETTLED_S) + noise(3)}, path="missed.csv")
    assert diagnose_tables([missed], MACHINE).verdict == "none"


def test_starts_beside_a_running_shaft_show_first_fill_alone() -> None:
    stands = np.arange(len(RPM)) % 2 == 0
    times = np.where(stands, RESPONSE_S + START_S + 0.3, DEAD_S + SETTLED_S) + noise(4)
    found = diagnose_tables([table(times, np.where(stands, 0.0, BEFORE))], MACHINE)
    assert [cause.id for cause in found.causes] == ["lag.first_fill"]
    assert found.causes[0].size.low < 0.3 < found.causes[0].size.high


def test_rises_and_falls_of_a_running_shaft_show_asymmetry() -> None:
    before = np.where(np.arange(len(RPM)) % 2 == 0, 5.0, 90.0)
    times = DEAD_S + SETTLED_S - 0.5 * 0.4 * np.sign(RPM - before) + noise(5)
    found = diagnose_tables([table(times, before)], MACHINE)
    assert [cause.id for cause in found.causes] == ["lag.asymmetry"]
    assert found.causes[0].size.low < 0.4 < found.causes[0].size.high


def test_the_line_of_starts_leaves_a_running_shaft_out() -> None:
    stands = np.arange(len(RPM)) % 2 == 0
    times = np.where(stands, RESPONSE_S + START_S, DEAD_S + SETTLED_S)
    mixed = table(times, np.where(stands, 0.0, BEFORE))
    _, line = fit_lag(mixed, MACHINE)
    assert line.slope_s_per_rpm.value == pytest.approx(-0.0083, abs=1e-4)
    assert any("20 rows of a shaft that turned before are not used" in note for note in line.notes)
    with pytest.raises(ValueError, match="0 different shaft speeds"):
        fit_lag(table(times), MACHINE)
    assert across([table(times), BenchTable("lag", {"shaft_rpm": RPM, "lag_s": times}, path="b")], MACHINE) == ()


def test_a_file_may_carry_the_speed_before(tmp_path: Path) -> None:
    path = tmp_path / "lags.csv"
    path.write_text("before_rpm,shaft_rpm,lag_s\n20,50,1.8\n,50,1.85\n0,60,1.7\n")
    assert read_bench_table(path).running().tolist() == [True, False, False]
    path.write_text("before_rpm,shaft_rpm,lag_s\n20,50,1.8\n-3,50,1.85\n")
    with pytest.raises(ValueError, match="column before_rpm: -3: allowed 0 to 1000"):
        read_bench_table(path)
