"""What several tables say of one quantity: what makes one of the other, and one name however
many tell it."""

from __future__ import annotations

import numpy as np
import pytest
from topdress.console.reports.table_views import make_table_views
from topdress.control.calibration.bench_table import BenchTable
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.diagnosis.tables.cross_calibration import compare_lag_series, describe_pair
from topdress.control.diagnosis.tables.duplicate_rows import remove_duplicates

from tests.diagnosis.planted import check
from tests.diagnosis.tables import MACHINE, diagnosed, paper

RPM = np.repeat(np.arange(10.0, 71.0, 10.0), 4)
TIME_S = 2.2 - 0.008 * RPM


def table(path: str, scatter: float, seed: int, **columns: np.ndarray) -> BenchTable:
    rng = np.random.default_rng(seed)
    noisy = {
        name: value + scatter * rng.standard_normal(len(RPM)) if name != "speed_kmh" else value
        for name, value in columns.items()
    }
    return BenchTable("lag", {"shaft_rpm": RPM, **noisy}, path=path)


def test_distances_and_times_are_reconciled_by_a_speed_where_the_speed_was_wrong() -> None:
    driven = table("d.csv", 0.02, 1, lag_m=1.5 * TIME_S, speed_kmh=np.full(len(RPM), 4.0))
    timed = table("t.csv", 0.01, 2, lag_s=TIME_S)
    for order in ([driven, timed], [timed, driven]):
        (pair,) = compare_lag_series(order, MACHINE)
        assert (
            pair.kind == "speed"
            and pair.low <= 1.5 <= pair.high
            and pair.rows == 7
            and pair.holds >= 5
        )
        said = describe_pair(pair)
        assert said.startswith(
            (
                "d.csv (m) and t.csv (s) are reconciled by a speed of 5.3",
                "d.csv (m) and t.csv (s) are reconciled by a speed of 5.4",
            )
        )
        assert "4.00 km/h is written" in said and "a delay of" in said


def test_a_constant_delay_is_told_as_a_delay() -> None:
    slow = BenchTable("lag", {"shaft_rpm": RPM, "lag_s": TIME_S + 0.4}, path="field.csv")
    (pair,) = compare_lag_series(
        [slow, BenchTable("lag", {"shaft_rpm": RPM, "lag_s": TIME_S}, path="rig.csv")], MACHINE
    )
    assert (
        (pair.kind, pair.value) == ("delay", pytest.approx(0.4))
        and pair.holds == pair.rows
        and pair.other_worse
    )


def test_the_same_twice_is_said_to_be_the_same_and_scatter_to_be_none() -> None:
    (pair,) = compare_lag_series(
        [table("a.csv", 0.001, 1, lag_s=TIME_S), table("b.csv", 0.001, 2, lag_s=TIME_S)], MACHINE
    )
    assert "a.csv and b.csv say the same" in describe_pair(pair)
    wild = TIME_S + np.where(RPM % 20.0 == 0.0, 0.5, -0.5)
    (pair,) = compare_lag_series(
        [table("a.csv", 0.001, 1, lag_s=TIME_S), table("b.csv", 0.001, 2, lag_s=wild)], MACHINE
    )
    assert "no one quantity reconciles them" in describe_pair(pair)


def test_few_shared_speeds_say_nothing() -> None:
    short = BenchTable(
        "lag",
        {"shaft_rpm": np.array([10.0, 20.0, 30.0]), "lag_s": np.array([2.1, 2.0, 1.9])},
        path="s",
    )
    assert compare_lag_series([short, table("t.csv", 0.01, 2, lag_s=TIME_S)], MACHINE) == ()


@pytest.mark.exam
def test_the_papers_tables_across_each_other() -> None:
    found = diagnosed(paper("lag_table1_distance"), paper("lag_table4_total")).findings
    assert any(
        "4.50 (90 %: 4.50 to 4.50) km/h, which holds in 10 of 10 rows; 4.25 km/h is written" in text
        for text in found
    )
    every = diagnosed(
        *(
            paper(f"lag_table{name}")
            for name in ("1_distance", "2_response", "3_drop_time", "5_corrected")
        )
    )
    # once
    assert {cause.id for cause in every.causes} == {
        "lag.speed_scale",
        "lag.rebound",
        "lag.coarse_clock",
    }
    costs = {cause.id: cause.field_cost.place_error_m for cause in every.causes}
    assert costs["lag.rebound"] == 0.0  # the set-point is 70 r/min
    assert any(
        "lag_table3_drop_time.csv (s) are reconciled by a speed of 5.24" in text
        for text in every.findings
    )


def test_a_correction_made_at_the_written_speed_does_not_grow_with_the_true_one() -> None:
    """Driven 20 % faster than written: the lag goes 20 % farther, what was taken off stays."""
    rng = np.random.default_rng(3)
    lag = 2.2118 - 0.0083 * RPM
    driven = BenchTable(
        "lag",
        {
            "shaft_rpm": RPM,
            "lag_m": 1.2 * 1.2 * lag + 0.02 * rng.standard_normal(len(RPM)),
            "speed_mps": np.full(len(RPM), 1.2),
        },
        path="d.csv",
    )
    missed = BenchTable(
        "place",
        {
            "shaft_rpm": RPM,
            "speed_mps": np.full(len(RPM), 1.2),
            "miss_m": 0.2 * 1.2 * lag + 0.02 * rng.standard_normal(len(RPM)),
        },
        path="m.csv",
    )
    check(
        diagnosed(driven, missed),
        names=["lag.speed_scale"],
        sizes={"lag.speed_scale": pytest.approx(20.0, abs=1.5)},
    )


# --- One quantity is named once, however many tables tell it and in whatever unit
# ------------------------------------

THREE = np.repeat(np.arange(10.0, 71.0, 10.0), 3)
LAG_S = 2.2118 - 0.0083 * THREE
WRITTEN_MPS = np.full(len(THREE), 1.2)
IN_THE_FIELD = {
    "lag.speed_scale",
    "lag.offset",
    "shaft.dead_time",
    "place.latency",
    "place.lever_arm",
}


def noise(seed: int, sd: float = 0.02) -> np.ndarray:
    return sd * np.random.default_rng(seed).standard_normal(len(THREE))


def rig_and_field(field_s: np.ndarray) -> BenchTable:
    return BenchTable(
        "lag",
        {"shaft_rpm": np.tile(THREE, 2), "lag_s": np.concatenate([LAG_S + noise(1), field_s])},
        "source",
        "both.csv",
        np.repeat(["rig", "field"], len(THREE)),
    )


def missed(miss_m: np.ndarray) -> BenchTable:
    return BenchTable(
        "place", {"shaft_rpm": THREE, "speed_mps": WRITTEN_MPS, "miss_m": miss_m}, path="missed.csv"
    )


def of_the_field(found: Diagnosis) -> list[str]:
    return [cause.id for cause in found.causes if cause.id in IN_THE_FIELD]


def distances_and_times_worked_out_of_them(
    with_mps: float, digits: int = 3
) -> tuple[BenchTable, BenchTable]:
    lag_m = np.round(1.24 * 1.2 * LAG_S + noise(2), 2)
    driven = BenchTable(
        "lag", {"shaft_rpm": THREE, "lag_m": lag_m, "speed_mps": WRITTEN_MPS}, path="driven.csv"
    )
    rpm = np.unique(THREE)
    means_m = np.array([lag_m[n == THREE].mean() for n in rpm])
    rig_s = np.round(
        2.2118 - 0.0083 * rpm + 0.01 * np.random.default_rng(3).standard_normal(len(rpm)), 3
    )
    times = BenchTable(
        "lag",
        {
            "shaft_rpm": np.tile(rpm, 2),
            "lag_s": np.concatenate([np.round(means_m / with_mps, digits), rig_s]),
        },
        "source",
        "times.csv",
        np.repeat(["field", "rig"], len(rpm)),
    )
    return driven, times


@pytest.mark.parametrize("with_mps", [1.2, 1.27])
def test_times_worked_out_of_another_tables_distances_name_no_second_speed(with_mps: float) -> None:
    driven, times = distances_and_times_worked_out_of_them(with_mps)
    for order in ([driven, times], [times, driven]):
        found = diagnosed(*order)
        assert of_the_field(found) == ["lag.speed_scale"]
        assert found.causes[0].size.low < 24.0 < found.causes[0].size.high
        assert any(
            f"worked out of the distances with {3.6 * with_mps:.2f} km/h; it counts once" in text
            for text in found.findings
        )


def test_times_that_have_most_rows_become_the_distances_that_they_were() -> None:
    _, times = distances_and_times_worked_out_of_them(1.27)
    means = times.columns["lag_s"][:7] * 1.27
    before = BenchTable(
        "place",
        {
            "shaft_rpm": np.unique(THREE)[:6],
            "speed_mps": np.full(6, 1.2),
            "miss_m": np.round(means[:6], 2),
        },
        "stage",
        "gain.csv",
        np.full(6, "before"),
    )
    once = remove_duplicates([times, before], MACHINE)
    assert [(table.path, table.kind, table.rows) for table in once.tables] == [
        ("times.csv", "lag", 7),
        ("times.csv", "lag", 7),
    ]
    distances = next(table for table in once.tables if "lag_m" in table.columns)
    assert distances.columns["lag_m"] == pytest.approx(means, abs=0.01)
    assert set(distances.columns["speed_mps"]) == {1.2} and set(distances.label) == {"field"}
    views = make_table_views([times, before], MACHINE, diagnosed(times, before).causes)
    # the rows that count
    assert [view.name for view in views] == ["times.csv lag_m", "times.csv lag_s"]


def test_times_of_their_own_are_not_taken_for_worked_out() -> None:
    driven, _ = distances_and_times_worked_out_of_them(1.2)
    own = BenchTable(
        "lag", {"shaft_rpm": THREE, "lag_s": np.round(1.24 * LAG_S + noise(5), 3)}, path="own.csv"
    )
    assert remove_duplicates([driven, own], MACHINE).retellings == ()
    # a tenth of a second agrees by chance
    driven, coarse = distances_and_times_worked_out_of_them(1.2, digits=1)
    assert remove_duplicates([driven, coarse], MACHINE).retellings == ()


def test_one_speed_in_times_and_in_misses_is_one_cause() -> None:
    found = diagnosed(rig_and_field(1.2 * LAG_S + noise(6)), missed(0.2 * 1.2 * LAG_S + noise(7)))
    assert of_the_field(found) == ["lag.speed_scale"]
    assert found.causes[0].scope == "both.csv field and missed.csv"
    assert found.causes[0].size.value == pytest.approx(20.0, abs=1.5)
    views = {
        view.name: view
        for view in make_table_views(
            [rig_and_field(1.2 * LAG_S + noise(6)), missed(0.2 * 1.2 * LAG_S + noise(7))],
            MACHINE,
            found.causes,
        )
    }
    assert float(np.sqrt(np.mean(views["missed.csv miss_m"].after ** 2))) < 0.04
    assert float(np.sqrt(np.mean(views["both.csv lag_s"].after ** 2))) < 0.04


def test_one_delay_in_times_and_in_misses_is_one_cause() -> None:
    found = diagnosed(rig_and_field(LAG_S + 0.4 + noise(8)), missed(0.4 * 1.2 + noise(9)))
    (named,) = of_the_field(found)
    assert named in {"lag.offset", "shaft.dead_time"}
    assert found.causes[0].size.value == pytest.approx(0.4, abs=0.03)


def test_two_causes_in_the_field_are_still_two() -> None:
    """Times 20 % long, misses twice what that makes of them: something else lands late as well."""
    found = diagnosed(
        rig_and_field(1.2 * LAG_S + noise(6)), missed(0.2 * 1.2 * LAG_S + 0.5 + noise(7))
    )
    assert len(of_the_field(found)) == 2 and "lag.speed_scale" in of_the_field(found)


@pytest.mark.parametrize(
    "names",
    [
        ("1_distance", "4_total"),
        ("4_total", "6_gain"),
        ("4_total", "5_corrected"),
        *(
            pytest.param(("1_distance", "4_total", name), marks=pytest.mark.exam)
            for name in ("5_corrected", "6_gain")
        ),
        ("1_distance", "2_response", "3_drop_time", "4_total", "5_corrected", "6_gain"),
    ],
)
@pytest.mark.exam
def test_what_the_papers_field_has_more_is_named_once(names: tuple[str, ...]) -> None:
    found = diagnosed(*(paper(f"lag_table{name}") for name in names))
    assert of_the_field(found) == ["lag.speed_scale"]
    told = [text for text in found.findings if "km/h, which holds in" in text]
    # L1's distances speak
    assert all("table4_total.csv field" not in text or "of 4.50 " in text for text in told)
    # L4's times alone do not say which speed they were worked out with
    if names != ("4_total", "5_corrected"):
        assert found.verdict == "named"
        assert found.causes[0].size.value == pytest.approx(24.1, abs=0.5)
