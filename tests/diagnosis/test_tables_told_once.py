"""One quantity is named once, however many tables tell it and in whatever unit."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from console.reports.table_views import table_views
from control.calibration.bench_table import BenchTable
from control.diagnosis.result import Diagnosis
from control.diagnosis.tables import diagnose_tables
from control.diagnosis.tables.duplicate_rows import without_duplicates
from control.machine.machine import Machine
from drivers.files.bench_table import read_bench_table

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
RPM = np.repeat(np.arange(10.0, 71.0, 10.0), 3)
LAG_S = 2.2118 - 0.0083 * RPM
WRITTEN_MPS = np.full(len(RPM), 1.2)
IN_THE_FIELD = {"lag.speed_scale", "lag.offset", "shaft.dead_time", "place.latency", "place.lever_arm"}


def noise(seed: int, sd: float = 0.02) -> np.ndarray:
    return sd * np.random.default_rng(seed).standard_normal(len(RPM))


def rig_and_field(field_s: np.ndarray) -> BenchTable:
    return BenchTable("lag", {"shaft_rpm": np.tile(RPM, 2), "lag_s": np.concatenate([LAG_S + noise(1), field_s])},
                      "source", "both.csv", np.repeat(["rig", "field"], len(RPM)))


def missed(miss_m: np.ndarray) -> BenchTable:
    return BenchTable("place", {"shaft_rpm": RPM, "speed_mps": WRITTEN_MPS, "miss_m": miss_m}, path="missed.csv")


def of_the_field(found: Diagnosis) -> list[str]:
    return [cause.id for cause in found.causes if cause.id in IN_THE_FIELD]


def distances_and_times_worked_out_of_them(with_mps: float, digits: int = 3) -> tuple[BenchTable, BenchTable]:
    lag_m = np.round(1.24 * 1.2 * LAG_S + noise(2), 2)
    driven = BenchTable("lag", {"shaft_rpm": RPM, "lag_m": lag_m, "speed_mps": WRITTEN_MPS}, path="driven.csv")
    rpm = np.unique(RPM)
    means_m = np.array([lag_m[n == RPM].mean() for n in rpm])
    rig_s = np.round(2.2118 - 0.0083 * rpm + 0.01 * np.random.default_rng(3).standard_normal(len(rpm)), 3)
    times = BenchTable("lag", {"shaft_rpm": np.tile(rpm, 2),
                               "lag_s": np.concatenate([np.round(means_m / with_mps, digits), rig_s])},
                       "source", "times.csv", np.repeat(["field", "rig"], len(rpm)))
    return driven, times


@pytest.mark.parametrize("with_mps", [1.2, 1.27])
def test_times_worked_out_of_another_tables_distances_name_no_second_speed(with_mps: float) -> None:
    driven, times = distances_and_times_worked_out_of_them(with_mps)
    for order in ([driven, times], [times, driven]):
        found = diagnose_tables(order, Machine())
        assert of_the_field(found) == ["lag.speed_scale"]
        assert found.causes[0].size.low < 24.0 < found.causes[0].size.high
        assert any(f"worked out of the distances with {3.6 * with_mps:.2f} km/h; it counts once" in text
                   for text in found.findings)


def test_times_that_have_most_rows_become_the_distances_that_they_were() -> None:
    _, times = distances_and_times_worked_out_of_them(1.27)
    means = times.columns["lag_s"][:7] * 1.27
    before = BenchTable("place", {"shaft_rpm": np.unique(RPM)[:6], "speed_mps": np.full(6, 1.2),
                                  "miss_m": np.round(means[:6], 2)}, "stage", "gain.csv", np.full(6, "before"))
    once = without_duplicates([times, before], Machine())
    assert [(table.path, table.kind, table.rows) for table in once.tables] == [("times.csv", "lag", 7),
                                                                              ("times.csv", "lag", 7)]
    distances = next(table for table in once.tables if "lag_m" in table.columns)
    assert distances.columns["lag_m"] == pytest.approx(means, abs=0.01)
    assert set(distances.columns["speed_mps"]) == {1.2} and set(distances.label) == {"field"}
    views = table_views([times, before], Machine(), diagnose_tables([times, before], Machine()).causes)
    assert [view.name for view in views] == ["times.csv lag_m", "times.csv lag_s"]      # the rows that count


def test_times_of_their_own_are_not_taken_for_worked_out() -> None:
    driven, _ = distances_and_times_worked_out_of_them(1.2)
    own = BenchTable("lag", {"shaft_rpm": RPM, "lag_s": np.round(1.24 * LAG_S + noise(5), 3)}, path="own.csv")
    assert without_duplicates([driven, own], Machine()).retellings == ()
    driven, coarse = distances_and_times_worked_out_of_them(1.2, digits=1)       # a tenth of a second agrees by chance
    assert without_duplicates([driven, coarse], Machine()).retellings == ()


def test_one_speed_in_times_and_in_misses_is_one_cause() -> None:
    found = diagnose_tables([rig_and_field(1.2 * LAG_S + noise(6)), missed(0.2 * 1.2 * LAG_S + noise(7))], Machine())
    assert of_the_field(found) == ["lag.speed_scale"]
    assert found.causes[0].scope == "both.csv field and missed.csv"
    assert found.causes[0].size.value == pytest.approx(20.0, abs=1.5)
    views = {view.name: view for view in table_views(
        [rig_and_field(1.2 * LAG_S + noise(6)), missed(0.2 * 1.2 * LAG_S + noise(7))], Machine(), found.causes)}
    assert float(np.sqrt(np.mean(views["missed.csv miss_m"].after ** 2))) < 0.04
    assert float(np.sqrt(np.mean(views["both.csv lag_s"].after ** 2))) < 0.04


def test_one_delay_in_times_and_in_misses_is_one_cause() -> None:
    found = diagnose_tables([rig_and_field(LAG_S + 0.4 + noise(8)), missed(0.4 * 1.2 + noise(9))], Machine())
    (named,) = of_the_field(found)
    assert named in {"lag.offset", "shaft.dead_time"}
    assert found.causes[0].size.value == pytest.approx(0.4, abs=0.03)


def test_two_causes_in_the_field_are_still_two() -> None:
    """Times 20 % long, misses twice what that makes of them: something else lands late as well."""
    found = diagnose_tables([rig_and_field(1.2 * LAG_S + noise(6)), missed(0.2 * 1.2 * LAG_S + 0.5 + noise(7))],
                            Machine())
    assert len(of_the_field(found)) == 2 and "lag.speed_scale" in of_the_field(found)


@pytest.mark.skipif(not DATA.is_dir(), reason="the papers' tables are not in ../shared/data")
@pytest.mark.parametrize("names", [("1_distance", "4_total"), ("4_total", "6_gain"),
                                   ("1_distance", "4_total", "6_gain"),
                                   ("1_distance", "4_total", "5_corrected"), ("4_total", "5_corrected"),
                                   ("1_distance", "2_response", "3_drop_time", "4_total", "5_corrected", "6_gain")])
def test_what_the_papers_field_has_more_is_named_once(names: tuple[str, ...]) -> None:
    found = diagnose_tables([read_bench_table(DATA / f"lag_table{name}.csv") for name in names], Machine())
    assert of_the_field(found) == ["lag.speed_scale"]
    told = [text for text in found.findings if "km/h, which holds in" in text]
    assert all("table4_total.csv field" not in text or "of 4.50 " in text for text in told)     # L1's distances speak
    if names != ("4_total", "5_corrected"):         # L4's times alone do not say which speed they were worked out with
        assert found.verdict == "named"
        assert found.causes[0].size.value == pytest.approx(24.1, abs=0.5)
