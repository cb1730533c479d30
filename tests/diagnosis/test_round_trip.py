"""What is fitted is what is written: a fit's own prediction, and that of the machine file read
back, are one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.extend import extend
from topdress.control.diagnosis.result import (
    Cause,
    Diagnosis,
    FieldCost,
    Size,
    SourceSummary,
    TermFound,
)
from topdress.control.diagnosis.runs.channels import make_channels
from topdress.control.diagnosis.runs.diagnose import prepare_log
from topdress.control.diagnosis.runs.hypothesis import EffectInstance, list_stages, make_schedule
from topdress.control.diagnosis.runs.model import CHANNEL_GROUPS, GroupModel
from topdress.control.diagnosis.runs.stages import make_run_data
from topdress.control.machine.compiled import run_term
from topdress.control.machine.machine import CATALOGUE, Machine, describe_unit, find_size_bounds
from topdress.control.machine.shaft import MIN_TIME_CONSTANT_S
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S
from topdress.control.machine.term_form import (
    ANGLES,
    FORMS,
    ScaledVariable,
    TriedForm,
    scale_variable,
)
from topdress.control.machine.term_forms import LostConstantForm, ProductForm
from topdress.control.machine.term_sums import sum_over_log
from topdress.control.machine.terms import Term
from topdress.drivers.files.config import load_config, save_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

Array = npt.NDArray[np.float64]
ROWS_OF_LOG, STEP_S = 3000, 0.1
BOTH_WAYS = Machine(shaft=Machine().shaft._replace(dead_time_s=0.35))


def log() -> dict[str, Array]:
    """Five minutes in which everything moves, both ways."""
    rng, time_s = np.random.default_rng(1), STEP_S * np.arange(ROWS_OF_LOG)
    opening, speed = 25.0 + 15.0 * np.sign(np.sin(time_s / 9.0)), 1.3 + 0.3 * np.sin(time_s / 7.0)
    command = 60.0 * np.sign(np.sin(time_s / 23.0)) + 25.0 * np.sign(np.sin(time_s / 5.0))
    found = {
        "time_s": time_s,
        "shaft_rpm_cmd": command,
        "shaft_rpm": command,
        "opening_mm_cmd": opening,
        "opening_mm": opening,
        "supply_v": 13.0 + 0.8 * np.sin(time_s / 11.0),
        "speed_mps": speed,
        "wheel_speed_mps": speed,
        "pitch_deg": 3.0 * np.sin(time_s / 13.0),
        "roll_deg": 2.0 * np.cos(time_s / 8.0),
        "heading_deg": np.where(np.sin(time_s / 40.0) > 0.0, 14.0, 194.0)
        + 2.0 * np.sin(time_s / 3.0),
        "hopper_kg": 500.0 - 0.3 * time_s,
    }
    for head in range(1, 7):
        found[f"ndvi_{head}"] = (
            0.6 + 0.1 * np.sin(time_s / 6.0) + 0.002 * rng.standard_normal(ROWS_OF_LOG)
        )
    return found


def written(machine: Machine, found: Diagnosis, place: Path) -> Machine:
    save_config(place / "file.yaml", extend(machine, found), MACHINE_KIND)
    read: Machine = load_config(str(place / "file.yaml"), MACHINE_KIND).model
    return read


def diagnosis(**of: Any) -> Diagnosis:
    return replace(
        Diagnosis(
            SourceSummary("log.csv", "run", ROWS_OF_LOG, 300.0, "huanghai"),
            (),
            "named",
            (),
            (),
            (),
            None,
            (),
            None,
        ),
        **of,
    )


ADOPTED = [name for name, entry in CATALOGUE.items() if not entry.effect.onset_only]


@pytest.fixture(scope="module")
def seen() -> Any:
    columns = {name: np.asarray(series) for name, series in log().items()}
    clean, data, _ = prepare_log(columns, BOTH_WAYS)
    return clean, data


@pytest.mark.parametrize("name", ADOPTED)
def test_an_effect_in_the_file_is_the_effect_of_the_fit(
    name: str, seen: Any, tmp_path: Path
) -> None:
    clean, data = seen
    low, high = find_size_bounds(name, BOTH_WAYS)
    member = 2 if CATALOGUE[name].effect.member_field else None
    every = make_channels(data, BOTH_WAYS)
    # a gain of -210 %: the other way round
    for size in {0.1 * low, 0.7 * low, 0.2 * high} - {0.0}:
        part = EffectInstance(name, float(size), member=member)
        cause = Cause(
            name,
            Size(part.size, None, None, describe_unit(name, BOTH_WAYS)),
            None,
            1.0,
            (),
            member,
            "",
            FieldCost(0.0, 0.0),
        )
        file = written(BOTH_WAYS, diagnosis(causes=(cause,)), tmp_path)
        again = make_channels(make_run_data(clean, file), file)
        names = next(
            (
                names
                for names in CHANNEL_GROUPS.values()
                if set(EFFECT_ROWS[name].channels) & set(names)
            ),
            (),
        )
        fit = GroupModel([every[one] for one in names if one in every], BOTH_WAYS, data).run_model(
            (part,)
        )
        for channel, predicted in fit.items():
            own = every[channel]._replace(predict=again[channel].predict)
            of_file = own.predict(make_schedule(list_stages(file), ()), MAX_MODEL_STEP_S)
            assert np.abs(of_file - predicted).max() < 1e-9 * max(1.0, np.abs(predicted).max()), (
                channel
            )


def variable(name: str, log_of: dict[str, Array]) -> ScaledVariable:
    work = np.ones(ROWS_OF_LOG, bool)
    return scale_variable(name, log_of[name], work, log_of["time_s"], run_term)


def forms() -> list[tuple[TriedForm, dict[str, ScaledVariable]]]:
    log_of = log()
    by = {
        name: variable(name, log_of) for name in ("supply_v", "roll_deg", "time_s", "heading_deg")
    }
    by["shaft_angle_deg"] = variable(
        "shaft_angle_deg", {**log_of, "shaft_angle_deg": 90.0 * log_of["time_s"]}
    )
    found = [
        (one, by)
        for kind in FORMS.values()
        for name in by
        for one in kind.list_candidates(by[name])[::7]
    ]
    found += [(one, by) for one in ProductForm.list_pair_candidates(by["supply_v"], by["roll_deg"])]
    found += [
        (one, by)
        for one in ProductForm.list_pair_candidates(by["supply_v"], by["roll_deg"], alone=1)
    ]
    command = log_of["shaft_rpm_cmd"]
    told = ScaledVariable(
        "shaft_rpm", command, 0.0, 1.0, -np.inf, np.inf, command > 0.1, log_of["time_s"], run_term
    )
    return [*found, *((one, {"shaft_rpm": told}) for one in LostConstantForm.list_candidates(told))]


def test_no_time_in_the_file_falls_below_nothing(tmp_path: Path) -> None:
    """What is off by more than a data sheet's time predicts the same, and no reader takes it
    for a dead time."""
    quick = Machine(shaft=Machine().shaft._replace(dead_time_s=0.02, time_constant_s=0.05))
    causes = tuple(
        Cause(name, Size(-0.25, None, None, "s"), None, 1.0, (), None, "", FieldCost(0.0, 0.0))
        for name in ("shaft.dead_time", "shaft.slow")
    )
    shaft = written(quick, diagnosis(causes=causes), tmp_path).shaft
    assert shaft.dead_time_s + shaft.extra_dead_time_s == 0.0
    assert shaft.time_constant_s + shaft.slow_s == pytest.approx(MIN_TIME_CONSTANT_S)


@pytest.mark.parametrize("level", [0.0, 1.7])
def test_a_term_in_the_file_is_the_form_of_the_fit(level: float, tmp_path: Path) -> None:
    tried, rng = forms(), np.random.default_rng(2)
    assert {one.kind.form for one, _ in tried} == set(FORMS)
    terms, fits = [], []
    for k, (form, by) in enumerate(tried):
        a = rng.uniform(0.3, 1.0, len(form.columns)) * rng.choice([-1.0, 1.0], len(form.columns))
        of = level if form.kind.has_level else 0.0
        said = form.write_form(a.tolist(), of, by)
        acts = "shaft_rpm" if form.kind is LostConstantForm else "shaft_percent"
        terms.append(
            Term.model_validate(
                {
                    "id": f"shaft.t{k}",
                    "acts_on": acts,
                    "form": said.form,
                    "nodes": said.nodes,
                    "values": said.values,
                    "coefficients": said.coefficients,
                    "over": [{"name": v, "valid": by[v].valid_range} for v in form.over],
                }
            )
        )
        fits.append(a @ form.calc_rows(by) + of)
    found = tuple(
        TermFound(one.model_dump(mode="json"), "shaft", one.unit, 0.5, 0.0, 9.0, 0.5)
        for one in terms
    )
    span = [k for k, one in enumerate(terms) if FORMS[one.form].one_run]
    angle = [k for k, one in enumerate(terms) if set(one.variable_names) & set(ANGLES)]
    values = {
        **log(),
        "shaft_angle_deg": 90.0 * log()["time_s"],
        "told_rpm": log()["shaft_rpm_cmd"],
    }
    kept = [k for k in range(len(terms)) if k not in (*span, *angle)]
    file = written(BOTH_WAYS, diagnosis(terms=tuple(found[k] for k in kept)), tmp_path)
    read = dict(zip(kept, file.terms, strict=True))
    for k, fit in enumerate(fits):
        of_file = sum_over_log([read.get(k, terms[k])], values, values["time_s"], run_term)[
            terms[k].acts_on.value
        ]
        assert np.abs(of_file - fit).max() < 1e-9 * max(1.0, np.abs(fit).max()), terms[k]
