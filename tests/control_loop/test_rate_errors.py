"""Three rate errors: against what was held, the graded and the smooth need of the canopy."""
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from control.simulation.errors import errors, landing, needs


def test_held_is_what_the_machine_does_and_the_needs_are_what_the_crop_gets(simulated: Any) -> None:
    found = simulated(60.0).errors
    assert 0.0 < found.rate_error_percent < found.graded_error_percent < found.smooth_error_percent < 15.0
    assert found.smooth_error_kg_ha > found.graded_error_kg_ha > found.rate_error_kg_ha


def test_without_grades_both_needs_are_one(simulated: Any) -> None:
    run = simulated(60.0)
    smooth = replace(run.rule, crop=run.rule.crop.model_copy(update={"grades": False}))
    one = errors(run.record.columns(), run.record.fired, run.width_m, rule=smooth)
    assert one.graded_error_kg_ha == pytest.approx(one.smooth_error_kg_ha)
    assert one.smooth_error_kg_ha == pytest.approx(run.errors.smooth_error_kg_ha)


def test_without_a_rule_there_is_no_need(simulated: Any) -> None:
    run = simulated(60.0)
    one = errors(run.record.columns(), run.record.fired, run.width_m)
    assert one.rate_error_percent == run.errors.rate_error_percent
    assert one.graded_error_percent is None and one.smooth_error_percent is None


def test_what_lands_as_needed_has_no_error_against_the_need(simulated: Any) -> None:
    run = simulated(60.0)
    columns = run.record.columns()
    rows = columns["in_pass"] > 0.0
    graded = np.array([run.rule.decide(value).rate_kg_ha for value in columns["ndvi"].tolist()])
    columns |= {"drop_s": 0.0 * graded, "settled_drop_s": 0.0 * graded,
                "flow_kg_s": graded * run.width_m * np.abs(columns["speed_mps"]) / 10_000.0 * rows}
    inside = landing(columns, run.width_m).inside > 0.0
    again = errors(columns, [], run.width_m, rule=run.rule)
    assert inside.sum() > 50
    assert again.graded_error_percent < 0.3 * run.errors.graded_error_percent
    assert again.smooth_error_percent > 3.0 * again.graded_error_percent


def test_needs_are_the_crops_rule() -> None:
    from control.agronomy.noa import prepare
    from drivers.files.config import load
    from drivers.files.kinds import CROP
    rule = prepare(load("huanghai_wheat", CROP).model)
    found = needs(rule, np.array([0.2, 0.512, 0.55, 0.9]))
    assert found.graded_kg_ha[1] == rule.decide(0.512).rate_kg_ha
    assert found.smooth_kg_ha[1] > found.graded_kg_ha[1], "a grade's rate is taken at its upper edge: too low inside"
    assert found.smooth_kg_ha[2] == pytest.approx(found.graded_kg_ha[2])
    assert list(found.graded_kg_ha[[0, 3]]) == list(found.smooth_kg_ha[[0, 3]]) == [0.0, 0.0]
