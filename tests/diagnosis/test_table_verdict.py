"""When a verdict on bench tables may be none, named, or not judged. Forms of this file's own."""
from __future__ import annotations

import ast
import doctest
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from control.calibration.bench_table import KINDS
from control.diagnosis import effects
from control.diagnosis.result import Diagnosis
from control.diagnosis.tables import Table, diagnose, diagnose_tables
from control.diagnosis.tables import __path__ as room
from control.diagnosis.tables.cost import field_cost
from control.diagnosis.tables.piece import Candidate, SizedEffect
from control.diagnosis.tables.problem import problem_of
from control.diagnosis.tables.rows import pieces_of
from control.diagnosis.tables.search import search
from control.diagnosis.tables.verdict import judged
from control.experiments.bench_tests import bench_tests
from control.machine.machine import CATALOGUE, Machine

MACHINE = Machine()
Rng = np.random.Generator


def lags(rpm: np.ndarray, off_s: np.ndarray | float, rng: Rng) -> Table:
    lag = 0.383 + 1.8288 - 0.0083 * rpm + off_s + 0.03 * rng.standard_normal(len(rpm))
    return Table("lag", {"shaft_rpm": rpm, "lag_s": np.round(lag, 3)}, "", "lag.csv")


def catches(rpm: np.ndarray, opening: np.ndarray, factor: np.ndarray | float, rng: Rng) -> Table:
    mass = 5.5e-3 * opening * rpm / 60.0 * 30.0 * factor * (1.0 + 0.004 * rng.standard_normal(len(rpm)))
    return Table("catch", {"shaft_rpm": rpm, "opening_mm": opening, "duration_s": np.full(len(rpm), 30.0),
                           "mass_kg": mass}, "", "catch.csv")


def fouled_head(rng: Rng) -> Table:
    head = np.repeat(np.arange(1.0, 7.0), 4)
    ndvi = 0.6 * np.where(head == 5, 0.9, 1.0) + 0.008 * rng.standard_normal(24)
    return Table("heads", {"head": head, "ndvi_reference": np.full(24, 0.6), "ndvi": np.round(ndvi, 4)})


def diagnosed(table: Table) -> Diagnosis:
    return diagnose_tables([table], MACHINE)


def wave_without_replicates(rng: Rng) -> Table:
    rpm = np.linspace(10.0, 70.0, 40)
    return lags(rpm, 0.1 * np.sin(rpm / 2.2), rng)


def settings_off_at_random(rng: Rng) -> Table:
    rpm = np.repeat(np.linspace(10.0, 70.0, 25), 4)
    return lags(rpm, np.repeat(0.08 * rng.standard_normal(25), 4), rng)


@pytest.mark.parametrize("make", [wave_without_replicates, settings_off_at_random])
def test_what_follows_no_smooth_curve_is_not_called_none(make: Callable[[Rng], Table]) -> None:
    for seed in range(3):
        found = diagnosed(make(np.random.default_rng(seed)))
        assert found.verdict == "unexplained" and not found.causes
        left, = found.unexplained
        assert left.channel == "lag" and left.variable in ("", "shaft_rpm") and 0.2 < left.explained_share <= 1.0
        assert found.channels[0].structure_p < 0.05


@pytest.mark.exam
def test_smooth_times_without_replicates_are_called_none() -> None:
    """The order of settings is judged with no more false alarms than its level allows."""
    rpm = np.linspace(10.0, 70.0, 40)
    said = [diagnosed(lags(rpm, 0.0, np.random.default_rng(seed))).verdict for seed in range(120)]
    assert sum(verdict != "none" for verdict in said) <= 3


def test_an_effect_that_predicts_no_other_setting_is_less_sure_and_gains_nothing() -> None:
    """One setting that is off may have been set wrongly as well."""
    rng = np.random.default_rng(10)
    rpm = np.tile(np.array([10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 100.0]), 6)
    found = diagnosed(lags(rpm, 0.4 * (rpm == 100.0), rng))
    cause, = found.causes
    assert cause.id == "lag.rebound" and cause.probability < 0.99 and found.gain[0].after > 0.9 * found.gain[0].before
    assert any("something that no effect describes" in text for text in found.findings)
    rpm = np.tile(np.array([10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0]), 6)
    rise = 0.4 * (np.maximum(0.0, rpm - 70.0) / 30.0)
    shown = diagnosed(lags(rpm, rise, rng))
    assert shown.verdict == "named" and shown.gain[0].after < 0.8 * shown.gain[0].before


def test_a_head_read_over_one_panel_is_named_by_rows_held_out() -> None:
    """One setting is all that can show a member's effect: that is no reason to suspect it."""
    found = diagnosed(fouled_head(np.random.default_rng(3)))
    assert found.verdict == "named" and found.causes[0].id == "canopy.head_fouled" and found.causes[0].member == 5
    assert found.gain[0].after < 0.6 * found.gain[0].before and "4 rows" in found.gain[0].held_out


@pytest.mark.parametrize(("table", "near"), [
    (lambda rng: catches(np.tile([20.0, 50.0, 80.0], 6), np.repeat([10.0, 30.0], 9), 2.5, rng), ("flow.gain",)),
    (lambda rng: lags(np.tile(np.arange(10.0, 71.0, 10.0), 3), 4.0, rng), ("lag.offset", "shaft.dead_time"))])
def test_a_size_out_of_its_bounds_is_a_hint_and_no_name(table: Callable[[Rng], Table], near: tuple[str, ...]) -> None:
    found = diagnosed(table(np.random.default_rng(1)))
    assert found.verdict == "unexplained" and not found.causes
    assert any(f"nearest effect: {one}, but its size would have to lie outside" in text for text in found.findings
               for one in near)
    assert found.channels[0].structure_p < 0.001


def test_what_fits_better_with_a_size_out_of_bounds_is_not_named_by_two_others() -> None:
    """An offset of 80 g/rev is beyond the catalogue; at two openings next to each other it looks like a gain."""
    rpm, opening = np.tile([20.0, 50.0, 80.0, 100.0], 4), np.repeat([20.0, 22.0], 8)
    found = diagnosed(catches(rpm, opening, 1.0 + 80.0 / (5.5 * opening), np.random.default_rng(1)))
    assert found.verdict == "unexplained" and not found.causes
    assert any("nearest effect: flow.zero_offset" in text for text in found.findings)


def test_what_a_refused_name_showed_is_not_forgotten() -> None:
    table = lags(np.tile(np.arange(10.0, 71.0, 10.0), 3), 4.0, np.random.default_rng(1))
    found = judged(search(problem_of(pieces_of(table, MACHINE), MACHINE)), True)
    assert not found.named and found.nearest is not None and found.nothing < 1e-6


def test_one_row_is_not_judged() -> None:
    one = np.array([40.0])
    found = diagnosed(catches(one, np.array([20.0]), 2.0, np.random.default_rng(1)))
    assert found.verdict == "not_judged" and not found.causes
    assert found.findings[0].startswith("catch.csv mass_kg: not judged")


def test_a_column_without_a_number_is_named_first() -> None:
    table = lags(np.tile([10.0, 30.0, 50.0, 70.0], 5), 0.0, np.random.default_rng(1))
    empty = Table("lag", {**table.columns, "response_s": np.full(20, np.nan)}, "", "lag.csv")
    found = diagnosed(empty)
    assert found.findings[0] == "lag.csv response_s: not judged: no row has a number"
    assert [channel.channel for channel in found.channels] == ["lag"]


# --- What a diagnosis of bench tables hands on as data, not in a sentence: scope, steps, minutes, facts of ef... -----

def labelled_lags(*, later_s: float, blue_s: float = 0.0) -> Diagnosis:
    """Whole lags by the nominal line, `later_s` later; half of the rows are labelled blue and `blue_s` later still."""
    rng = np.random.default_rng(3)
    rpm = np.tile(np.arange(10.0, 71.0, 10.0), 6)
    label = np.repeat(["blue", "green"], 21)
    lag = 0.383 + 1.8288 - 0.0083 * rpm + later_s + blue_s * (label == "blue") + 0.02 * rng.standard_normal(42)
    return diagnose_tables([Table("lag", {"shaft_rpm": rpm, "lag_s": np.round(lag, 3)}, "tractor", "two.csv", label)],
                           MACHINE)


@pytest.mark.parametrize(("later_s", "blue_s", "scope"), [(0.0, 0.3, "two.csv blue"), (0.3, 0.0, None)])
def test_where_an_effect_holds_is_a_field_of_its_cause(later_s: float, blue_s: float, scope: str | None) -> None:
    found = labelled_lags(later_s=later_s, blue_s=blue_s)
    assert [cause.scope for cause in found.causes] == [scope]
    assert found.to_json()["causes"][0]["scope"] == scope


def test_the_next_run_has_its_tests_and_minutes() -> None:
    found = labelled_lags(later_s=0.3).next_run
    assert found is not None
    tests = [one for one in bench_tests(Machine()) if one.id in found.id.split("+")]
    assert found.steps and set(found.steps) == {one.plan for one in tests}
    assert found.minutes == sum(one.minutes for one in tests)
    assert all(step in found.plan for step in found.steps)
    assert found.to_do() == tuple(f"{one} ({minutes:.0f} min)" for one, minutes in zip(
        found.steps, ({each.plan: each.minutes for each in tests}[one] for one in found.steps), strict=True))


def test_every_experiment_has_an_id_of_its_own() -> None:
    ids = [one.id for one in bench_tests(Machine())]
    assert len(set(ids)) == len(ids) and not any("+" in one for one in ids)


def test_bench_tests_are_at_settings_of_the_machines_own_ranges() -> None:
    """A large shaft is not asked for the nominal machine's speeds, and no shaft for less than its slowest."""
    nominal, ranges = Machine(), Machine().limits
    large = nominal.model_copy(update={"limits": ranges.model_copy(
        update={"shaft_high_rpm": 10.0 * ranges.shaft_high_rpm, "shaft_low_rpm": 150.0})})
    steps = {one.id: (one.plan, other.plan) for one, other in zip(bench_tests(nominal), bench_tests(large),
                                                                    strict=True)}
    assert "5 starts each at 10, 40 and 70 r/min" in steps["response_test"][0]
    assert "5 starts each at 150, 400 and 700 r/min" in steps["response_test"][1]
    assert steps["static_weigh"][0] == steps["static_weigh"][1]


def test_no_effect_stands_as_a_literal() -> None:
    """Facts of an effect have one home, control/diagnosis/effects.py: all else names it by its constant there."""
    for path in Path(next(iter(room))).rglob("*.py"):
        texts = {node.value for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
                 if isinstance(node, ast.Constant)}
        assert not texts & set(CATALOGUE), path


def test_the_facts_of_an_effect_name_other_effects_and_kinds_of_tables() -> None:
    for row in effects.ROWS.values():
        assert set(row.half_looks_like) <= set(CATALOGUE) and set(row.scoped_in) <= set(KINDS)


@pytest.mark.parametrize(("row", "size", "rate", "place"), [
    (effects.FLOW_GAIN, 5.0, 5.0, 0.0), (effects.FLOW_PULSATION, 30.0, 0.0, 0.0),
    (effects.LAG_COARSE_CLOCK, 0.1, 0.0, 0.0), (effects.LAG_OFFSET, 0.4, 0.0, 0.5),
    (effects.PLACE_LEVER_ARM, 0.4, 0.0, 0.4), (effects.CANOPY_HEAD_FOULED, -8.0, None, None)])
def test_the_field_cost_goes_through_the_model(row: effects.Row, size: float, rate: float | None,
                                               place: float | None) -> None:
    cost = field_cost(MACHINE, SizedEffect(Candidate(row.id, 1), size), 1.25)
    assert cost.rate_error_percent == (rate if rate is None else pytest.approx(rate, abs=1e-9))
    assert cost.place_error_m == (place if place is None else pytest.approx(place, abs=1e-9))


def test_a_lag_off_distances_at_a_wrong_speed_is_wrong_by_as_much() -> None:
    at_10, at_20 = (field_cost(MACHINE, SizedEffect(Candidate(effects.LAG_SPEED_SCALE.id), percent), 1.25)
                    for percent in (10.0, 20.0))
    lag_s = 0.383 + 1.8288 - 0.0083 * MACHINE.set_points.shaft_rpm
    assert at_10.place_error_m == pytest.approx(0.1 * 1.25 * lag_s, rel=0.02)
    assert at_20.place_error_m == pytest.approx(2.0 * at_10.place_error_m)


def test_the_example_of_diagnose_tables_holds() -> None:
    ran = doctest.testmod(diagnose)
    assert ran.attempted >= 9 and ran.failed == 0
