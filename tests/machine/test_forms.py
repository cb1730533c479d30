"""Each form of a term: what is fitted is what the machine file then holds, whatever the shape."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from control.machine.compiled import term_run
from control.machine.form import ANGLES, FORMS, FormSeries, Scaled, TriedForm, scaled
from control.machine.forms import Form, Lost, ProductForm
from control.machine.term_sums import over_log
from control.machine.terms import Term

ROWS = 1500
TIME_S = 0.2 * np.arange(ROWS)


def variable(name: str, seed: int = 3) -> Scaled:
    rng = np.random.default_rng(seed)
    x = {"heading_deg": rng.uniform(0.0, 360.0, ROWS), "shaft_angle_deg": 17.0 * TIME_S, "time_s": TIME_S}.get(
        name, 1.3 + np.sin(TIME_S / 7.0) + 0.3 * rng.standard_normal(ROWS))
    return scaled(name, x, np.ones(ROWS, bool), TIME_S, term_run)


def every() -> list[TriedForm]:
    found = [one for name in ("roll_deg", "heading_deg", "time_s") for kind in FORMS.values()
             for one in kind.tried(variable(name))]
    roll, pitch = variable("roll_deg"), variable("pitch_deg", 5)
    return found + [one for alone in (1, 2) for one in ProductForm.tried_with(roll, pitch, alone)]


def written(form: TriedForm, sizes: Any, level: float, by: dict[str, Scaled]) -> Term:
    file = form.written(sizes, level, by)
    over = [{"name": name, "valid": by[name].valid} for name in form.over]
    return Term.model_validate({"id": "shaft.one", "acts_on": "shaft_percent", "form": file.form, "over": over,
                                "coefficients": file.coefficients, "nodes": file.nodes, "values": file.values})


def values(term: Term, by: dict[str, Scaled]) -> Any:
    return over_log([term], {name: one.x for name, one in by.items()}, TIME_S, term_run)["shaft_percent"]


def test_every_form_has_a_class_that_says_all_of_it() -> None:
    assert set(FORMS) == set(Form)
    for kind in FORMS.values():
        assert kind.means and kind.sentences and len(set(kind.needs) & set(kind.may)) == 0


def test_every_form_is_looked_for() -> None:
    assert {form.kind for form in every()} == set(FORMS.values())


@pytest.mark.parametrize("name", list(Form))
def test_what_is_fitted_is_what_the_file_holds(name: str) -> None:
    """Columns times amplitudes, and a level, are the value of the term that is written: at each shape, and moved."""
    by = {one: variable(one) for one in ("roll_deg", "heading_deg", "time_s")} | {"pitch_deg": variable("pitch_deg", 5)}
    rng = np.random.default_rng(8)
    tried = [form for form in every() if form.kind.form == name]
    for form in tried[:: max(1, len(tried) // 20)]:
        for move in ("", *form.kind.movable):
            place = {move: form.kind.step(form.shape, move, 0.4, by[form.over[0]])} if move else {}
            shape = {**form.shape, **place}
            if not shape.get("low_end", -np.inf) < shape.get("high_end", np.inf):
                continue
            moved = form.moved(shape, by)
            sizes = rng.uniform(0.5, 2.0, len(moved.columns)).tolist()
            fitted = np.asarray(sizes) @ moved.rows(by) + 0.3
            there = values(written(moved, sizes, 0.3, by), by)
            assert there == pytest.approx(fitted, abs=1e-9), (form.shape, move)


def test_columns_of_many_shapes_share_few_series() -> None:
    """What a series does to a channel takes a run of the model: it is had once."""
    forms = [one for kind in FORMS.values() for one in kind.tried(variable("roll_deg"))]
    shared = {series for form in forms for column in form.columns for series in column}
    assert len(forms) > 100 and len(shared) < 50
    assert all(isinstance(series, FormSeries) for series in shared)


def test_a_products_square_is_taken_off_its_level() -> None:
    """It was fitted about the middle of its variables, with slopes of its own there."""
    x, y = (Scaled(name, np.zeros(3), middle, spread, -9.0, 9.0, np.ones(3, bool), np.arange(3.0), term_run)
            for name, middle, spread in (("roll_deg", -0.1, 2.0), ("speed_mps", 1.0, 0.2)))
    form = ProductForm.tried_with(x, y)[1]
    by, sizes = {"roll_deg": x, "speed_mps": y}, [-8.0, -0.4, 8.0]
    for level in (0.0, 0.7):
        assert form.written(sizes, level, by).coefficients == pytest.approx(
            {"slope": 20.0, "at": 0.0, "second_at": 1.2, "level": level - 0.4})


def field(axis_deg: float) -> Scaled:
    """Headings up and down a field."""
    ways = np.where(np.arange(ROWS) % 200 < 100, axis_deg, axis_deg + 180.0)
    headings = np.mod(ways + np.random.default_rng(1).normal(0.0, 1.0, ROWS), 360.0)
    return scaled("heading_deg", headings, np.ones(ROWS, bool), TIME_S, term_run)


def test_an_angle_driven_up_and_down_has_one_amplitude_along_its_axis() -> None:
    """Sine and cosine are not told apart there, and across the axis nothing is said; all round there are two."""
    [along] = FORMS["periodic"].tried(field(30.0))
    assert len(along.columns) == 1
    sine, cosine = along.shape["sine"], along.shape["cosine"]
    assert abs(sine * np.sin(np.radians(30.0)) + cosine * np.cos(np.radians(30.0))) > 0.999
    assert {len(form.columns) for form in FORMS["periodic"].tried(variable("heading_deg"))} == {2}
    assert ANGLES == FORMS["periodic"].only_over


@pytest.mark.parametrize("axis_deg", [4.0, 30.0, 90.0, 163.0, 178.0])
def test_what_was_seen_up_and_down_a_field_is_said_of_these_headings_alone(axis_deg: float) -> None:
    """The phase of a cycle is not known from one axis: across it a wave would be a guess."""
    heading = field(axis_deg)
    by = {"heading_deg": heading}
    [along] = FORMS["periodic"].tried(heading)
    sine, cosine = along.shape["sine"], along.shape["cosine"]
    ahead = sine * np.sin(np.radians(axis_deg)) + cosine * np.cos(np.radians(axis_deg))
    term = written(along, [0.5 * ahead], 0.1, by)
    assert (term.form, term.coefficients) == ("table", {})
    asked = np.mod(axis_deg + np.array([-10.0, 0.0, 10.0, 40.0, 90.0, 140.0, 170.0, 180.0, 190.0, 220.0, 270.0, 320.0]),
                   360.0)
    found = over_log([term], {"heading_deg": asked}, np.arange(12.0), term_run)["shaft_percent"]
    assert found == pytest.approx([0.6] * 3 + [0.1] * 3 + [-0.4] * 3 + [0.1] * 3)


@pytest.mark.parametrize(("low", "high"), [(-0.4, 0.3), (0.6, 1.4), (-2.0, -1.9)])
def test_a_saturation_is_reported_as_it_was_fitted_without_a_large_level(low: float, high: float) -> None:
    roll = variable("roll_deg")
    by = {"roll_deg": roll}
    form = FORMS["saturation"].tried(roll)[0].moved({"low_end": low, "high_end": high}, by)
    [series] = form.rows(by)
    term = written(form, [30.0], 0.2, by)
    assert values(term, by) == pytest.approx(0.2 + 30.0 * series)
    assert series.min() <= 0.0 <= series.max() and abs(term.coefficients["level"] - 0.2) <= 30.0 * (high - low)


def test_a_constant_that_is_lost_of_every_command_is_a_saturation_from_zero_on() -> None:
    commands = np.concatenate((np.zeros(500), np.linspace(12.0, 80.0, 1000)))
    x = Scaled("shaft_rpm", commands, 0.0, 1.0, -np.inf, np.inf, commands > 0.0, TIME_S, term_run)
    [form] = Lost.tried(x)
    file = form.written([-2.5], 0.0, {"shaft_rpm": x})
    assert file.form == "saturation" and file.coefficients == {"slope": -1.0, "low_end": 0.0, "high_end": 2.5}
    wide = form.written([-30.0], 0.0, {"shaft_rpm": x})      # more than the slowest command: the constant is the same
    assert wide.coefficients["slope"] * wide.coefficients["high_end"] == -30.0
