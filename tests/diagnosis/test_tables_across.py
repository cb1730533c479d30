"""What two tables say of the same lag: the quantity that makes the one of the other, in its own unit."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from control.calibration.bench_table import BenchTable
from control.diagnosis.tables import diagnose_tables
from control.diagnosis.tables.across import across, sentence
from control.machine.machine import Machine
from drivers.files.bench_table import read_bench_table

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
RPM = np.repeat(np.arange(10.0, 71.0, 10.0), 4)
TIME_S = 2.2 - 0.008 * RPM


def table(path: str, scatter: float, seed: int, **columns: np.ndarray) -> BenchTable:
    rng = np.random.default_rng(seed)
    noisy = {name: value + scatter * rng.standard_normal(len(RPM)) if name != "speed_kmh" else value
             for name, value in columns.items()}
    return BenchTable("lag", {"shaft_rpm": RPM, **noisy}, path=path)


def test_distances_and_times_are_reconciled_by_a_speed_where_the_speed_was_wrong() -> None:
    driven = table("d.csv", 0.02, 1, lag_m=1.5 * TIME_S, speed_kmh=np.full(len(RPM), 4.0))
    timed = table("t.csv", 0.01, 2, lag_s=TIME_S)
    for order in ([driven, timed], [timed, driven]):
        (pair,) = across(order, Machine())
        assert pair.kind == "speed" and pair.low <= 1.5 <= pair.high and pair.rows == 7 and pair.holds >= 5
        said = sentence(pair)
        assert said.startswith(("d.csv (m) and t.csv (s) are reconciled by a speed of 5.3",
                                "d.csv (m) and t.csv (s) are reconciled by a speed of 5.4"))
        assert "4.00 km/h is written" in said and "a delay of" in said


def test_a_constant_delay_is_told_as_a_delay() -> None:
    slow = BenchTable("lag", {"shaft_rpm": RPM, "lag_s": TIME_S + 0.4}, path="field.csv")
    (pair,) = across([slow, BenchTable("lag", {"shaft_rpm": RPM, "lag_s": TIME_S}, path="rig.csv")], Machine())
    assert (pair.kind, pair.value) == ("delay", pytest.approx(0.4)) and pair.holds == pair.rows and pair.other_worse


def test_the_same_twice_is_said_to_be_the_same_and_scatter_to_be_none() -> None:
    (pair,) = across([table("a.csv", 0.001, 1, lag_s=TIME_S), table("b.csv", 0.001, 2, lag_s=TIME_S)], Machine())
    assert "a.csv and b.csv say the same" in sentence(pair)
    wild = TIME_S + np.where(RPM % 20.0 == 0.0, 0.5, -0.5)
    (pair,) = across([table("a.csv", 0.001, 1, lag_s=TIME_S), table("b.csv", 0.001, 2, lag_s=wild)], Machine())
    assert "no one quantity reconciles them" in sentence(pair)


def test_few_shared_speeds_say_nothing() -> None:
    short = BenchTable("lag", {"shaft_rpm": np.array([10.0, 20.0, 30.0]), "lag_s": np.array([2.1, 2.0, 1.9])}, path="s")
    assert across([short, table("t.csv", 0.01, 2, lag_s=TIME_S)], Machine()) == ()


@pytest.mark.skipif(not DATA.is_dir(), reason="the papers' tables are not in ../shared/data")
def test_the_papers_tables_across_each_other() -> None:
    def read(name: str) -> BenchTable:
        return read_bench_table(DATA / f"lag_{name}.csv")

    found = diagnose_tables([read("table1_distance"), read("table4_total")], Machine()).findings
    assert any("4.50 (90 %: 4.50 to 4.50) km/h, which holds in 10 of 10 rows; 4.25 km/h is written" in text
               for text in found)
    every = diagnose_tables([read("table1_distance"), read("table2_response"), read("table3_drop_time"),
                             read("table5_corrected")], Machine())
    assert {cause.id for cause in every.causes} == {"lag.speed_scale", "lag.rebound", "lag.coarse_clock"}   # once
    costs = {cause.id: cause.field_cost.place_error_m for cause in every.causes}
    assert costs["lag.rebound"] == 0.0                  # the set-point is 70 r/min
    assert any("lag_table3_drop_time.csv (s) are reconciled by a speed of 5.24" in text for text in every.findings)


def test_a_correction_made_at_the_written_speed_does_not_grow_with_the_true_one() -> None:
    """Driven 20 % faster than written: the lag goes 20 % farther, what was taken off stays."""
    rng = np.random.default_rng(3)
    lag = 2.2118 - 0.0083 * RPM
    driven = BenchTable("lag", {"shaft_rpm": RPM, "lag_m": 1.2 * 1.2 * lag + 0.02 * rng.standard_normal(len(RPM)),
                                "speed_mps": np.full(len(RPM), 1.2)}, path="d.csv")
    missed = BenchTable("place", {"shaft_rpm": RPM, "speed_mps": np.full(len(RPM), 1.2), "miss_m": 0.2 * 1.2 * lag
                                  + 0.02 * rng.standard_normal(len(RPM))}, path="m.csv")
    found = diagnose_tables([driven, missed], Machine())
    assert [cause.id for cause in found.causes] == ["lag.speed_scale"]
    assert found.causes[0].size.value == pytest.approx(20.0, abs=1.5)
