"""Terms found in run logs: stage, variables, form and size; names first; adopted, nothing is
left; nulls stay nulls."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from topdress.console.reports.diagnosis_text import summarise_terminal
from topdress.console.reports.term_words import describe_compensation, describe_term
from topdress.control.diagnosis import diagnose_run, extend
from topdress.control.diagnosis.extend import find_term_refusal, list_adoptable_terms
from topdress.control.diagnosis.result import Diagnosis, TermFound
from topdress.control.machine.compiled import run_term
from topdress.control.machine.machine import Machine
from topdress.control.machine.term_sums import average_commands_over_log, sum_over_log
from topdress.control.machine.terms import Term, parse_term

from tests.diagnosis.logs import Columns, shaft_answers, wandering
from tests.diagnosis.planted import forms, found_as_planted, planted

ROWS, STEP_S = 6000, 0.1
NOMINAL = Machine()


def slow(rng: np.random.Generator, tau_s: float) -> Any:
    """A wandering variable of spread 1."""
    return wandering(rng, ROWS, float(np.exp(-STEP_S / tau_s)))


def shaft_log(
    *texts: str, seed: int = 1, machine: Machine = NOMINAL, along: float = 0.0
) -> dict[str, Any]:
    """A log of the shaft alone, ten rows a second, of a machine that has terms. along : of the
    roll in the torque."""
    rng = np.random.default_rng(seed)
    time_s = STEP_S * np.arange(ROWS)
    command = np.repeat(rng.uniform(20.0, 90.0, ROWS // 60), 60).round(1)
    columns = {
        "time_s": time_s,
        "shaft_rpm_cmd": command,
        "supply_v": 13.5 + 0.4 * slow(rng, 25.0),
        "pitch_deg": 1.5 * slow(rng, 6.0),
        "roll_deg": 1.5 * slow(rng, 5.0),
        "engine_torque_nm": 300.0 + 40.0 * slow(rng, 12.0),
    }
    columns["engine_torque_nm"] = columns["engine_torque_nm"] + along * columns["roll_deg"]
    values = {
        **columns,
        "told_rpm": average_commands_over_log(command, time_s, machine.shaft.dead_time_s),
    }
    terms = [parse_term(text, Term.model_validate) for text in texts]
    more = sum_over_log(terms, values, time_s, run_term)
    out = shaft_answers(
        machine,
        time_s,
        float(command[0]),
        command_rpm=command,
        opening_mm=20.0,
        supply_v=columns["supply_v"],
        more_percent=more.get("shaft_percent", 0.0),
        more_rpm=more.get("shaft_rpm", 0.0),
    )
    return columns | {"shaft_rpm": out[:, 1] + 0.3 * rng.standard_normal(ROWS)}


@cache
def diagnosed(*texts: str, seed: int = 1) -> Diagnosis:
    """What several tests look at is diagnosed once."""
    return diagnose_run(shaft_log(*texts, seed=seed), Machine())


@pytest.mark.exam
@pytest.mark.parametrize(
    ("text", "form", "over"),
    [
        (
            "shaft_percent product supply_v,roll_deg slope=1 at=13.5",
            "product",
            ["roll_deg", "supply_v"],
        ),
        *(
            pytest.param(*one, marks=pytest.mark.exam)
            for one in (
                ("shaft_percent slope roll_deg slope=0.4", "slope", ["roll_deg"]),
                (
                    "shaft_percent hinge pitch_deg at=0.5 above=0.6 below=-0.3",
                    "hinge",
                    ["pitch_deg"],
                ),
                ("shaft_percent memory roll_deg bend=1 tau_s=12", "memory", ["roll_deg"]),
                (
                    "shaft_percent slope engine_torque_nm slope=-0.02 at=300",
                    "slope",
                    ["engine_torque_nm"],
                ),
            )
        ),
    ],
)
def test_a_term_is_found_with_its_variables_and_form(text: str, form: str, over: list[str]) -> None:
    columns = shaft_log(text)
    found = diagnose_run(columns, Machine())
    assert found.verdict == "unexplained"
    assert found.causes == ()
    assert forms(found)[0] == ("shaft_percent", form, over)
    assert {u.variable for u in found.unexplained} == set(over)
    assert found.unexplained[0].channel == "shaft"
    assert found.terms[0].held_out_gain is not None and found.terms[0].held_out_gain > 0.03
    json.dumps(found.to_json())
    adopted = extend(Machine(), found, date="2026-11-22", sha256="0" * 64)
    assert (adopted.terms[0].form, adopted.terms[0].source.date) == (form, "2026-11-22")
    again = diagnose_run(columns, adopted)
    assert (again.verdict, again.terms, again.unexplained) == ("none", (), ())
    # beyond what the first log held, a form is not known
    other = diagnose_run(shaft_log(text, seed=9), adopted)
    assert other.causes == () and all((one.dose_percent or 0.0) < 0.1 for one in other.unexplained)


def test_sizes_are_those_that_were_planted() -> None:
    found = diagnose_run(
        shaft_log("shaft_percent product supply_v,roll_deg slope=1.5 at=13.3 second_at=0.5"),
        Machine(),
    )
    c = found.terms[0].term["coefficients"]
    one, other = (v["name"] for v in found.terms[0].term["over"])
    at = {one: c["at"], other: c["second_at"]}
    assert c["slope"] == pytest.approx(1.5, rel=0.1)
    assert at["supply_v"] == pytest.approx(13.3, abs=0.1)
    assert at["roll_deg"] == pytest.approx(0.5, abs=0.3)


@pytest.mark.exam
def test_terms_that_are_alike_are_told_with_the_sizes_that_they_have_together() -> None:
    """The first is fitted before the second is known, and takes a part of it upon itself."""
    texts = (
        "shaft_percent slope roll_deg slope=0.6",
        "shaft_percent hinge engine_torque_nm at=330 above=-0.015",
    )
    columns = shaft_log(*texts, along=40.0)
    found = diagnose_run(columns, Machine())
    assert len(found.terms) == 2
    values = {**columns, "told_rpm": columns["shaft_rpm_cmd"]}
    true, told = (
        sum_over_log(terms, values, columns["time_s"], run_term)["shaft_percent"]
        for terms in (
            [parse_term(text, Term.model_validate) for text in texts],
            [
                Term.model_validate({k: v for k, v in one.term.items() if k != "source"})
                for one in found.terms
            ],
        )
    )
    assert np.std(told - true) < 0.3 * np.std(true)


@pytest.mark.exam
def test_where_the_shaft_stands_is_not_adopted() -> None:
    """Another run begins at another place of the shaft."""
    found = diagnosed("shaft_percent slope roll_deg slope=-0.5")
    term = found.terms[0]
    over = [{"name": "shaft_angle_deg", "valid": [0.0, 360.0]}]
    turned = replace(
        term,
        term={
            **term.term,
            "form": "periodic",
            "over": over,
            "coefficients": {"cycles": 1.0, "sine": 0.4, "cosine": 0.0},
        },
    )
    assert not find_term_refusal(term) and "not known" in find_term_refusal(turned)
    assert list_adoptable_terms(replace(found, terms=(turned,))) == ()


@pytest.mark.exam
def test_a_box_in_time_is_not_adopted() -> None:
    term = parse_term(
        "shaft_rpm span time_s low_end=200 high_end=290 above=0.8", Term.model_validate
    )
    found = diagnosed(seed=1)
    box = replace(
        found,
        terms=(TermFound(term.model_dump(mode="json"), "shaft", "r/min", 0.5, 0.1, 200.0, None),),
    )
    assert find_term_refusal(box.terms[0]).startswith("it holds for a span")
    assert list_adoptable_terms(box) == ()
    assert extend(Machine(), box) == Machine()


def test_it_is_said_in_a_sentence_with_range_and_what_control_does() -> None:
    found = diagnosed("shaft_percent slope roll_deg slope=-0.5")
    term = found.terms[0].term
    assert describe_term(term).startswith(
        "Shaft speed falls by 0.5 % for each deg of roll; seen between -"
    )
    assert describe_compensation(term) == "Control corrects for it"
    assert any(describe_term(term) in line for line in summarise_terminal(found))
    assert len(found.terms[0].seen) > 5
    _, seen, told = np.array(found.terms[0].seen).T
    assert np.max(np.abs(seen - told)) < 0.4


@pytest.mark.exam
def test_the_level_of_a_term_is_that_of_the_machine_tolerance_and_all() -> None:
    """What the term does on the mean and what a nominal value is off is not told apart: their
    sum is what it does."""
    by = 1.5 * NOMINAL.tolerance.shaft_percent
    off = NOMINAL.shaft._replace(gain_percent=NOMINAL.shaft.gain_percent + by)
    text = "shaft_percent hinge roll_deg at=0.5 above=0.4"
    found = diagnose_run(
        shaft_log(text, machine=NOMINAL.model_copy(update={"shaft": off})), NOMINAL
    )
    told = Term.model_validate({k: v for k, v in found.terms[0].term.items() if k != "source"})
    true = parse_term(text, Term.model_validate)
    roll = np.linspace(-2.0, 3.0, 50)
    one, other = (
        sum_over_log([term], {"roll_deg": roll}, np.arange(50.0), run_term)["shaft_percent"]
        for term in (told, true)
    )
    assert np.mean(one - other) == pytest.approx(by, rel=0.2)


@pytest.mark.exam
@pytest.mark.parametrize("seed", [1, 2])
def test_a_term_and_what_is_named_with_it_add_up_to_what_the_shaft_does(seed: int) -> None:
    """A form in r/min that no dictionary holds is made of a gain and so many r/min, or of two
    forms: their sum must be right, with no more of a name than the machine file takes up (the
    best straight line leaves 0.27 of it)."""
    text = "shaft_rpm saturation shaft_rpm slope=0.02 low_end=40 high_end=70 level=-0.4"
    true, columns = parse_term(text, Term.model_validate), shaft_log(text, seed=seed)
    found = diagnose_run(columns, NOMINAL)
    adopted, told_rpm = extend(NOMINAL, found), columns["shaft_rpm_cmd"]
    values = {**columns, "told_rpm": told_rpm}
    acts = sum_over_log(adopted.terms, values, columns["time_s"], run_term)
    percent = (
        acts.get("shaft_percent", 0.0) + adopted.shaft.gain_percent - NOMINAL.shaft.gain_percent
    )
    rpm = percent * told_rpm / 100.0 + acts.get("shaft_rpm", 0.0)
    hidden = sum_over_log([true], values, columns["time_s"], run_term)["shaft_rpm"]
    assert np.sqrt(np.mean((rpm - hidden) ** 2)) < 0.35 * np.std(hidden)


def wheel_log(term: Any, seed: int = 1) -> dict[str, Any]:
    """A log of the speeds alone, ten rows a second. term : share by which the wheel reads more,
    of (roll, speed)."""
    rng, time_s = np.random.default_rng(seed), STEP_S * np.arange(ROWS)
    roll, speed = 2.0 * slow(rng, 8.0), 1.4 + 0.2 * slow(rng, 20.0)
    # its noise lasts: a dependence of the difference on the speed read
    gnss = speed + 0.03 * slow(rng, 1.5)
    wheel = speed * (1.0 + term(roll, speed)) + 0.02 * rng.standard_normal(ROWS)
    return {
        "time_s": time_s,
        "speed_mps": gnss,
        "wheel_speed_mps": wheel,
        "roll_deg": roll,
        "pitch_deg": 1.5 * slow(rng, 6.0),
    }


def drifting() -> dict[str, Any]:
    columns = shaft_log("shaft_percent slope roll_deg slope=-0.5")
    return columns | {
        "shaft_rpm": columns["shaft_rpm"] + 0.4 * slow(np.random.default_rng(7), 150.0)
    }


SAGGING = NOMINAL.model_copy(update={"shaft": NOMINAL.shaft._replace(sag_percent_per_v=3.0)})


@pytest.mark.parametrize(
    ("log", "machine", "said"),
    [
        *(
            planted(
                f"nothing {seed}",
                partial(shaft_log, seed=seed),
                exam=seed > 1,
                verdict="none",
                terms=[],
            )
            for seed in (1, 2, 3)
        ),
        *(
            planted(
                f"the noise of the speed that the wheel is held against is no term {seed}",
                partial(wheel_log, lambda roll, speed: 0.0, seed),
                exam=seed > 1,
                terms=[],
            )
            for seed in (1, 2, 3)
        ),
        planted(
            "the wheel may depend on a product with the speed",
            partial(wheel_log, lambda roll, speed: 0.05 * roll / 2.0 * (speed - 1.4) / 0.2),
            exam=True,
            terms=[("wheel_percent", "product", ["roll_deg", "speed_mps"])],
        ),
        planted(
            "a constant that is lost of every command is no gain",
            partial(shaft_log, "shaft_rpm saturation shaft_rpm slope=-1 low_end=0 high_end=2.5"),
            exam=True,
            names=["shaft.dead_zone"],
            terms=[],
            covers={"shaft.dead_zone": 2.5},
        ),
        # What it does on the mean is its level; the shaft runs up at the drive's limit whatever
        # the term says.
        planted(
            "a term about another place is no gain along with it",
            partial(shaft_log, "shaft_percent slope roll_deg slope=-0.5 at=2"),
            exam=True,
            names=[],
            coefficients={
                "level": pytest.approx(1.0, abs=0.1),
                "slope": pytest.approx(-0.5, abs=0.03),
            },
        ),
        planted(
            "a drift of one log is no level of a term",
            drifting,
            exam=True,
            terms=[("shaft_percent", "slope", ["roll_deg"])],
            coefficients={"level": 0.0},
        ),
        planted(
            "a name that explains the same wins",
            partial(shaft_log, machine=SAGGING),
            names=["shaft.voltage_sag"],
            terms=[],
        ),
    ],
)
def test_what_is_planted_is_said(
    log: Callable[[], Columns], machine: Machine, said: Mapping[str, Any]
) -> None:
    found_as_planted(log, machine, said)
