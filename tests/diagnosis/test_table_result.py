"""What a diagnosis of bench tables hands on as data, not in a sentence: scope, steps, minutes, facts of effects."""
from __future__ import annotations

import ast
import doctest
from pathlib import Path

import numpy as np
import pytest

from control.calibration.bench_table import KINDS
from control.diagnosis import effects
from control.diagnosis.result import Diagnosis
from control.diagnosis.tables import Table, diagnose, diagnose_tables
from control.diagnosis.tables import __path__ as room
from control.diagnosis.tables.cost import field_cost
from control.diagnosis.tables.experiments import EXPERIMENTS
from control.diagnosis.tables.piece import Candidate, SizedEffect
from control.machine.machine import CATALOGUE, Machine

MACHINE = Machine()


def lags(*, later_s: float, blue_s: float = 0.0) -> Diagnosis:
    """Whole lags by the nominal line, `later_s` later; half of the rows are labelled blue and `blue_s` later still."""
    rng = np.random.default_rng(3)
    rpm = np.tile(np.arange(10.0, 71.0, 10.0), 6)
    label = np.repeat(["blue", "green"], 21)
    lag = 0.383 + 1.8288 - 0.0083 * rpm + later_s + blue_s * (label == "blue") + 0.02 * rng.standard_normal(42)
    return diagnose_tables([Table("lag", {"shaft_rpm": rpm, "lag_s": np.round(lag, 3)}, "tractor", "two.csv", label)],
                           MACHINE)


@pytest.mark.parametrize(("later_s", "blue_s", "scope"), [(0.0, 0.3, "two.csv blue"), (0.3, 0.0, None)])
def test_where_an_effect_holds_is_a_field_of_its_cause(later_s: float, blue_s: float, scope: str | None) -> None:
    found = lags(later_s=later_s, blue_s=blue_s)
    assert [cause.scope for cause in found.causes] == [scope]
    assert found.to_json()["causes"][0]["scope"] == scope


def test_the_next_run_has_its_tests_and_minutes() -> None:
    found = lags(later_s=0.3).next_run
    assert found is not None
    tests = [one for one in EXPERIMENTS if one.id in found.id.split("+")]
    assert found.steps and set(found.steps) == {one.steps for one in tests}
    assert found.minutes == sum(one.minutes for one in tests)
    assert all(step in found.plan for step in found.steps)


def test_every_experiment_has_an_id_of_its_own() -> None:
    ids = [one.id for one in EXPERIMENTS]
    assert len(set(ids)) == len(ids) and not any("+" in one for one in ids)


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
