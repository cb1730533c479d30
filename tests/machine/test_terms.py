"""Terms: one evaluator, interpreted equal to compiled; bad ones are refused in a line; old
tables become terms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from topdress.control.machine.compiled import run_term
from topdress.control.machine.machine import Machine
from topdress.control.machine.term_form import (
    ANGLES,
    FORMS,
    FormSeries,
    ScaledVariable,
    TermParams,
    TriedForm,
    scale_variable,
)
from topdress.control.machine.term_forms import Form, LostConstantForm, ProductForm
from topdress.control.machine.term_step import TermState, make_term_run, step_term
from topdress.control.machine.term_sums import (
    NO_TERMS,
    HeldCommands,
    TermSums,
    average_commands_over_log,
    calc_angle_over_log,
    sum_over_log,
)
from topdress.control.machine.terms import Term, list_needed_values, make_term_params, parse_term
from topdress.drivers.files.config import ConfigError, find_shipped_files, load_config, save_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

TEXTS = {
    Form.SLOPE: "flow_percent slope roll_deg slope=2.5 at=0.3 valid=-2:2",
    Form.BEND: "flow_percent bend speed_mps bend=-4.4 slope=1.5 at=1.2",
    Form.HINGE: "shaft_percent hinge supply_v at=13.1 below=2 above=-1 level=0.2",
    Form.SATURATION: "shaft_rpm saturation shaft_rpm slope=-1 low_end=0 high_end=3",
    Form.DEAD_ZONE: "gate_mm dead_zone roll_deg slope=0.2 low_end=-0.5 high_end=0.8",
    Form.THRESHOLD: "gate_mm threshold pitch_deg at=0.3 above=0.6 below=-0.1",
    Form.PRODUCT: "flow_percent product speed_mps,roll_deg slope=12 at=1.2 second_at=0.4 "
    "valid=0.8:1.6,-2:2",
    Form.MEMORY: "wheel_percent memory roll_deg bend=2 slope=-2 tau_s=7.5",
    Form.PERIODIC: "flow_percent periodic shaft_angle_deg cycles=3 sine=2 cosine=-1",
    Form.SIDE: "scale_kg side roll_deg high_end=0.3 above=0.4 below=-0.2 tau_s=1.5",
    Form.SPAN: "scale_kg_min span time_s low_end=40 high_end=90 above=0.5 grows=1",
    Form.TABLE: "flow_kg_min table hopper_kg nodes=50,120,200,260,300 values=0.4,0.1,-0.2,0,0.3",
}


def made(text: str) -> Term:
    return parse_term(text, Term.model_validate)


def drive(rows: int = 3000) -> tuple[dict[str, Any], Any]:
    rng = np.random.default_rng(4)
    time_s = np.cumsum(rng.uniform(0.03, 0.09, rows))
    wave = {
        name: middle + spread * np.sin(time_s / period) + 0.2 * spread * rng.standard_normal(rows)
        for name, middle, spread, period in (
            ("shaft_rpm", 50.0, 40.0, 9.0),
            ("opening_mm", 25.0, 12.0, 14.0),
            ("hopper_kg", 170.0, 140.0, 60.0),
            ("pitch_deg", 0.2, 1.5, 5.0),
            ("roll_deg", -0.1, 1.7, 4.0),
            ("supply_v", 13.2, 0.6, 17.0),
            ("speed_mps", 1.2, 0.4, 8.0),
            ("told_rpm", 50.0, 40.0, 9.0),
            ("told_mm", 25.0, 12.0, 14.0),
        )
    }
    return {
        **wave,
        "time_s": time_s,
        "shaft_angle_deg": calc_angle_over_log(wave["shaft_rpm"], time_s),
        "heading_deg": np.where(np.arange(rows) % 900 < 450, 10.0, 190.0),
    }, time_s


def test_every_form_has_a_case() -> None:
    assert set(TEXTS) == set(Form) == set(FORMS)


@pytest.mark.parametrize("form", Form)
def test_interpreted_equals_compiled(form: Form) -> None:
    values, time_s = drive()
    term = made(TEXTS[form])
    names = list_needed_values(term)
    given = (make_term_params(term), values[names[0]], values[names[-1]], time_s)
    interpreted = make_term_run(step_term)(*given)
    assert np.array_equal(interpreted, run_term(*given))
    assert np.ptp(interpreted) > 0.0


def test_tick_by_tick_equals_over_a_log() -> None:
    values, time_s = drive(800)
    terms = [made(text).model_copy(update={"id": form.value}) for form, text in TEXTS.items()]
    log = sum_over_log(terms, values, time_s, run_term)
    sums = TermSums(terms)
    for k in range(len(time_s)):
        more = sums.advance_terms(
            {name: float(series[k]) for name, series in values.items()},
            float(time_s[k] - time_s[max(0, k - 1)]),
        )
        for name, series in log.items():
            assert getattr(more, name) == series[k]


def test_the_values_are_those_of_the_formulas() -> None:
    """Against the formulas that `topdress effects` says, written here once more."""

    def value(text: str, x: float, y: float = 0.0) -> float:
        return step_term(make_term_params(made(text)), TermState(), x, y, 0.0)[1]

    assert value(
        "flow_percent bend speed_mps bend=-4.4 slope=1 at=1.2 level=0.5", 2.2
    ) == pytest.approx(-2.9)
    assert value(TEXTS[Form.HINGE], 12.1) == pytest.approx(0.2 - 2.0)
    assert value(TEXTS[Form.HINGE], 14.1) == pytest.approx(0.2 - 1.0)
    assert value(TEXTS[Form.SATURATION], 50.0) == pytest.approx(-3.0)
    assert value(TEXTS[Form.DEAD_ZONE], 1.8) == pytest.approx(0.2)
    assert value(TEXTS[Form.DEAD_ZONE], 0.1) == 0.0
    assert value(TEXTS[Form.PRODUCT], 1.5, 1.4) == pytest.approx(12.0 * 0.3)
    assert value("flow_percent periodic heading_deg cycles=2 sine=3", 45.0) == pytest.approx(3.0)
    assert value("flow_percent side roll_deg high_end=0.1 above=2 below=-1", -3.0) == pytest.approx(
        -1.0
    )
    assert value(
        "scale_kg span time_s low_end=10 high_end=20 above=4 grows=1", 15.0
    ) == pytest.approx(2.0)
    assert value("flow_percent table roll_deg nodes=-1,1 values=0,4", 0.5) == pytest.approx(3.0)


def test_outside_its_range_a_term_holds_its_edge_value() -> None:
    term = make_term_params(made(TEXTS[Form.SLOPE]))
    assert (
        step_term(term, TermState(), 9.0, 0.0, 0.0)[1]
        == step_term(term, TermState(), 2.0, 0.0, 0.0)[1]
        == 4.25
    )


def test_a_table_of_fewer_nodes_is_held_beyond_its_last() -> None:
    term = make_term_params(made("flow_percent table roll_deg nodes=0,1,3 values=1,2,8"))
    assert [step_term(term, TermState(), x, 0.0, 0.0)[1] for x in (-5.0, 2.0, 3.0, 3.5, 99.0)] == [
        1,
        5,
        8,
        8,
        8,
    ]


def test_memory_follows_with_its_time_constant_whatever_the_step() -> None:
    p = make_term_params(made("flow_percent memory roll_deg bend=1 tau_s=5"))
    for steps in (1, 10, 1000):
        state, _ = step_term(p, TermState(), 0.0, 0.0, 0.0)
        state, _ = step_term(p, state, 1.0, 0.0, 0.0)
        for _ in range(steps):
            state, value = step_term(p, state, 1.0, 0.0, 5.0 / steps)
        assert value == pytest.approx(1.0 - np.exp(-1.0))


def test_a_term_whose_variable_is_not_there_adds_nothing() -> None:
    terms = [made(TEXTS[Form.SLOPE])]
    assert TermSums(terms).advance_terms({"pitch_deg": 3.0}, 0.05) == NO_TERMS
    assert sum_over_log(terms, {"time_s": np.arange(5.0)}, np.arange(5.0), run_term) == {}


def test_told_is_the_mean_of_the_command_a_dead_time_ago() -> None:
    machine, rng = Machine(), np.random.default_rng(2)
    time_s = np.arange(400) * 0.05
    command = np.repeat(rng.uniform(0, 100, 40), 10)
    told, found = HeldCommands(machine, command[0], 20.0), []
    for now, value in zip(time_s, command, strict=True):
        found.append(told.average_commands(float(now), float(value), 20.0, 0.05)["told_rpm"])
    assert average_commands_over_log(command, time_s, machine.shaft.dead_time_s) == pytest.approx(
        np.array(found)
    )


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"acts_on": "flow"}, "terms[1].acts_on: value flow: allowed shaft_percent, shaft_rpm"),
        ({"form": "wiggle"}, "terms[1].form: value wiggle: allowed slope, bend"),
        (
            {"coefficients": {"slop": 1.0}},
            "terms[1].coefficients.slop: value 1.0: allowed: form bend has bend, slope",
        ),
        ({"coefficients": {"slope": 1.0}}, "terms[1].coefficients: bend is missing"),
        (
            {"over": [{"name": "speed_mps", "valid": [2, 1]}]},
            "terms[1].over[1].valid: allowed a lower end below",
        ),
        (
            {"over": [{"name": "speed_mps", "unit": "km/h"}]},
            "terms[1].over[1].unit: value km/h: allowed m/s",
        ),
        (
            {"over": [{"name": "speed_mps"}, {"name": "roll_deg"}]},
            "terms[1].over: allowed: form bend has 1 variable",
        ),
        (
            {"form": "periodic", "coefficients": {"cycles": 1.0}},
            "terms[1].over[1].name: value speed_mps: allowed",
        ),
        (
            {"form": "memory", "coefficients": {"bend": 1.0, "tau_s": 0.0}},
            "tau_s: value 0.0: allowed more than 0",
        ),
        (
            {"form": "table", "coefficients": {}, "nodes": [1, 2], "values": [1]},
            "terms[1].values: allowed as many",
        ),
    ],
)
def test_a_bad_term_is_refused_in_one_line(
    change: dict[str, Any], line: str, tmp_path: Path
) -> None:
    data = yaml.safe_load(find_shipped_files("machines")["huanghai"].read_text(encoding="utf-8"))
    data["terms"] = [
        {
            "id": "flow.travel",
            "acts_on": "flow_percent",
            "form": "bend",
            "over": [{"name": "speed_mps"}],
            "coefficients": {"bend": -4.4},
        }
        | change
    ]
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError) as wrong:
        load_config(path, MACHINE_KIND)
    assert (
        len(wrong.value.lines) == 1
        and line in wrong.value.lines[0]
        and "(line " in wrong.value.lines[0]
    )


def test_a_machine_with_terms_is_written_and_read_back(tmp_path: Path) -> None:
    terms = tuple(made(text).model_copy(update={"id": form.value}) for form, text in TEXTS.items())
    machine = Machine(terms=terms)
    save_config(tmp_path / "m.yaml", machine, MACHINE_KIND)
    assert load_config(tmp_path / "m.yaml", MACHINE_KIND).model == machine


def test_an_old_file_with_tables_over_becomes_a_term_with_a_note(tmp_path: Path) -> None:
    data = yaml.safe_load(find_shipped_files("machines")["huanghai"].read_text(encoding="utf-8"))
    nodes, values = [11 + 0.5 * k for k in range(8)], [float(k - 5) for k in range(8)]
    data |= {"tables_over": {"flow": "supply_v"}}
    data["flow"] |= {"table_x": nodes, "table_percent": values}
    data["gate"] |= {"table_x": list(range(8)), "table_mm": [0.0] * 8}
    (tmp_path / "old.yaml").write_text(yaml.safe_dump(data))
    machine = load_config(tmp_path / "old.yaml", MACHINE_KIND).model
    assert [(t.acts_on, t.form, t.variable_names, t.nodes, t.values) for t in machine.terms] == [
        ("flow_percent", "table", ("supply_v",), tuple(nodes), tuple(values))
    ]
    assert machine.warnings == (
        "term flow.table was a table in an older machine file (tables_over)",
    )


def test_a_machine_without_terms_has_none_to_step() -> None:
    assert not TermSums(Machine().terms)
    assert TermParams(0) == TermParams(0)._replace(level=0.0)


# --- Each form of a term: what is fitted is what the machine file then holds, whatever the
# shape ---------------------

ROWS = 1500
TIME_S = 0.2 * np.arange(ROWS)


def variable(name: str, seed: int = 3) -> ScaledVariable:
    rng = np.random.default_rng(seed)
    x = {
        "heading_deg": rng.uniform(0.0, 360.0, ROWS),
        "shaft_angle_deg": 17.0 * TIME_S,
        "time_s": TIME_S,
    }.get(name, 1.3 + np.sin(TIME_S / 7.0) + 0.3 * rng.standard_normal(ROWS))
    return scale_variable(name, x, np.ones(ROWS, bool), TIME_S, run_term)


def every() -> list[TriedForm]:
    found = [
        one
        for name in ("roll_deg", "heading_deg", "time_s")
        for kind in FORMS.values()
        for one in kind.list_candidates(variable(name))
    ]
    roll, pitch = variable("roll_deg"), variable("pitch_deg", 5)
    return found + [
        one for alone in (1, 2) for one in ProductForm.list_pair_candidates(roll, pitch, alone)
    ]


def written(form: TriedForm, sizes: Any, level: float, by: dict[str, ScaledVariable]) -> Term:
    file = form.write_form(sizes, level, by)
    over = [{"name": name, "valid": by[name].valid_range} for name in form.over]
    return Term.model_validate(
        {
            "id": "shaft.one",
            "acts_on": "shaft_percent",
            "form": file.form,
            "over": over,
            "coefficients": file.coefficients,
            "nodes": file.nodes,
            "values": file.values,
        }
    )


def values(term: Term, by: dict[str, ScaledVariable]) -> Any:
    return sum_over_log([term], {name: one.x for name, one in by.items()}, TIME_S, run_term)[
        "shaft_percent"
    ]


def test_every_form_has_a_class_that_says_all_of_it() -> None:
    assert set(FORMS) == set(Form)
    for kind in FORMS.values():
        assert kind.means and kind.sentences and len(set(kind.needs) & set(kind.may)) == 0


def test_every_form_is_looked_for() -> None:
    assert {form.kind for form in every()} == set(FORMS.values())


@pytest.mark.parametrize("name", list(Form))
def test_what_is_fitted_is_what_the_file_holds(name: str) -> None:
    """Columns times amplitudes, and a level, are the value of the term that is written: at each
    shape, and moved."""
    by = {one: variable(one) for one in ("roll_deg", "heading_deg", "time_s")} | {
        "pitch_deg": variable("pitch_deg", 5)
    }
    rng = np.random.default_rng(8)
    tried = [form for form in every() if form.kind.form == name]
    for form in tried[:: max(1, len(tried) // 20)]:
        for move in ("", *form.kind.movable):
            place = (
                {move: form.kind.step_shape(form.shape, move, 0.4, by[form.over[0]])}
                if move
                else {}
            )
            shape = {**form.shape, **place}
            if not shape.get("low_end", -np.inf) < shape.get("high_end", np.inf):
                continue
            moved = form.change_shape(shape, by)
            sizes = rng.uniform(0.5, 2.0, len(moved.columns)).tolist()
            fitted = np.asarray(sizes) @ moved.calc_rows(by) + 0.3
            there = values(written(moved, sizes, 0.3, by), by)
            assert there == pytest.approx(fitted, abs=1e-9), (form.shape, move)


def test_columns_of_many_shapes_share_few_series() -> None:
    """What a series does to a channel takes a run of the model: it is had once."""
    forms = [one for kind in FORMS.values() for one in kind.list_candidates(variable("roll_deg"))]
    shared = {series for form in forms for column in form.columns for series in column}
    assert len(forms) > 100 and len(shared) < 50
    assert all(isinstance(series, FormSeries) for series in shared)


def test_a_products_square_is_taken_off_its_level() -> None:
    """It was fitted about the middle of its variables, with slopes of its own there."""
    x, y = (
        ScaledVariable(
            name, np.zeros(3), middle, spread, -9.0, 9.0, np.ones(3, bool), np.arange(3.0), run_term
        )
        for name, middle, spread in (("roll_deg", -0.1, 2.0), ("speed_mps", 1.0, 0.2))
    )
    form = ProductForm.list_pair_candidates(x, y)[1]
    by, sizes = {"roll_deg": x, "speed_mps": y}, [-8.0, -0.4, 8.0]
    for level in (0.0, 0.7):
        assert form.write_form(sizes, level, by).coefficients == pytest.approx(
            {"slope": 20.0, "at": 0.0, "second_at": 1.2, "level": level - 0.4}
        )


def field(axis_deg: float) -> ScaledVariable:
    """Headings up and down a field."""
    ways = np.where(np.arange(ROWS) % 200 < 100, axis_deg, axis_deg + 180.0)
    headings = np.mod(ways + np.random.default_rng(1).normal(0.0, 1.0, ROWS), 360.0)
    return scale_variable("heading_deg", headings, np.ones(ROWS, bool), TIME_S, run_term)


def test_an_angle_driven_up_and_down_has_one_amplitude_along_its_axis() -> None:
    """Sine and cosine are not told apart there, and across the axis nothing is said; all round
    there are two."""
    [along] = FORMS["periodic"].list_candidates(field(30.0))
    assert len(along.columns) == 1
    sine, cosine = along.shape["sine"], along.shape["cosine"]
    assert abs(sine * np.sin(np.radians(30.0)) + cosine * np.cos(np.radians(30.0))) > 0.999
    assert {
        len(form.columns) for form in FORMS["periodic"].list_candidates(variable("heading_deg"))
    } == {2}
    assert ANGLES == FORMS["periodic"].only_over


@pytest.mark.parametrize("axis_deg", [4.0, 30.0, 90.0, 163.0, 178.0])
def test_what_was_seen_up_and_down_a_field_is_said_of_these_headings_alone(axis_deg: float) -> None:
    """The phase of a cycle is not known from one axis: across it a wave would be a guess."""
    heading = field(axis_deg)
    by = {"heading_deg": heading}
    [along] = FORMS["periodic"].list_candidates(heading)
    sine, cosine = along.shape["sine"], along.shape["cosine"]
    ahead = sine * np.sin(np.radians(axis_deg)) + cosine * np.cos(np.radians(axis_deg))
    term = written(along, [0.5 * ahead], 0.1, by)
    assert (term.form, term.coefficients) == ("table", {})
    asked = np.mod(
        axis_deg
        + np.array([-10.0, 0.0, 10.0, 40.0, 90.0, 140.0, 170.0, 180.0, 190.0, 220.0, 270.0, 320.0]),
        360.0,
    )
    found = sum_over_log([term], {"heading_deg": asked}, np.arange(12.0), run_term)["shaft_percent"]
    assert found == pytest.approx([0.6] * 3 + [0.1] * 3 + [-0.4] * 3 + [0.1] * 3)


@pytest.mark.parametrize(("low", "high"), [(-0.4, 0.3), (0.6, 1.4), (-2.0, -1.9)])
def test_a_saturation_is_reported_as_it_was_fitted_without_a_large_level(
    low: float, high: float
) -> None:
    roll = variable("roll_deg")
    by = {"roll_deg": roll}
    form = (
        FORMS["saturation"]
        .list_candidates(roll)[0]
        .change_shape({"low_end": low, "high_end": high}, by)
    )
    [series] = form.calc_rows(by)
    term = written(form, [30.0], 0.2, by)
    assert values(term, by) == pytest.approx(0.2 + 30.0 * series)
    assert series.min() <= 0.0 <= series.max() and abs(term.coefficients["level"] - 0.2) <= 30.0 * (
        high - low
    )


def test_a_constant_that_is_lost_of_every_command_is_a_saturation_from_zero_on() -> None:
    commands = np.concatenate((np.zeros(500), np.linspace(12.0, 80.0, 1000)))
    x = ScaledVariable(
        "shaft_rpm", commands, 0.0, 1.0, -np.inf, np.inf, commands > 0.0, TIME_S, run_term
    )
    [form] = LostConstantForm.list_candidates(x)
    file = form.write_form([-2.5], 0.0, {"shaft_rpm": x})
    assert file.form == "saturation" and file.coefficients == {
        "slope": -1.0,
        "low_end": 0.0,
        "high_end": 2.5,
    }
    # more than the slowest command: the constant is the same
    wide = form.write_form([-30.0], 0.0, {"shaft_rpm": x})
    assert wide.coefficients["slope"] * wide.coefficients["high_end"] == -30.0
