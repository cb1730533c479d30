"""The same terms in the plant, in control's inverse and in the next diagnosis."""

from __future__ import annotations

import datetime as dt
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from topdress.control.diagnosis import diagnose_run
from topdress.control.log_row import COLUMNS
from topdress.control.loop.known_terms import KnownTerms
from topdress.control.machine.machine import Machine
from topdress.control.machine.term_sums import TermSums, explain_not_compensated
from topdress.control.machine.terms import Term, parse_term
from topdress.control.metering.inverse_model import (
    Conditions,
    calc_flow_kg_s,
    find_gate_command,
    find_opening_mm,
    find_shaft_command,
    find_shaft_rpm,
)
from topdress.control.orders import Strategy
from topdress.control.readings import Measurements, Reading
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import RunRecord, simulate_run
from topdress.control.simulation.error_metrics import RunErrors, judge_run
from topdress.drivers.files.run_setup import load_setup

SETUP = load_setup("huanghai", "demo", dt.date(2026, 3, 1))


def made(text: str) -> Term:
    return parse_term(text, Term.model_validate)


def with_terms(*terms: Term) -> Machine:
    return SETUP.machine.model_copy(update={"terms": terms})


def run(
    known: Machine, terms: list[Term], seconds: float = 300.0
) -> tuple[dict[str, Any], RunErrors]:
    job = add_simulated_field(
        SETUP.job.model_copy(
            update={
                "strategy": Strategy.OPENING_FIRST,
                "flow_trim": False,
                "simulated": SETUP.job.simulated.model_copy(
                    update={"roughness_deg": 1.5, "speed_wander_percent": 12.0}
                ),
            }
        ),
        SETUP.machine,
    )
    plant = make_plant(SETUP.machine, job, 3, 0.05, terms=terms)
    record, rows = RunRecord(), []
    for step in simulate_run(plant, make_control_loop(known, SETUP.crop, SETUP.rule, job), seconds):
        record.add_tick(step)
        rows.append(step.tick.row)
    columns = {name: _column([getattr(row, name, None) for row in rows]) for name in COLUMNS}
    return columns, judge_run(
        record.make_columns(), record.fired, SETUP.machine.geometry.working_width_m
    )


def _column(values: list[Any]) -> Any:
    if any(isinstance(value, str) for value in values):
        return np.array(["" if value is None else str(value) for value in values], object)
    return np.array([np.nan if value is None else float(value) for value in values])


@pytest.mark.exam
@pytest.mark.parametrize(
    "text",
    [
        "flow_percent slope roll_deg slope=4",
        "flow_percent product speed_mps,roll_deg slope=12 at=1.2",
    ],
)
def test_what_the_machine_file_knows_is_compensated_and_no_longer_found(text: str) -> None:
    term = made(text)
    columns, before = run(SETUP.machine, [term])
    _, after = run(with_terms(term), [term])
    assert after.rate_error_percent < before.rate_error_percent - 0.3
    found = diagnose_run(columns, with_terms(term))
    assert (found.verdict, found.causes, found.unexplained) == ("none", (), ())


@pytest.mark.exam
def test_a_term_of_the_shaft_is_no_longer_found_either() -> None:
    term = made("shaft_rpm saturation shaft_rpm slope=-1 low_end=0 high_end=3")
    columns, _ = run(SETUP.machine, [term])
    assert diagnose_run(columns, SETUP.machine).verdict != "none"
    assert diagnose_run(columns, with_terms(term)).verdict == "none"


def conditions(machine: Machine, **values: float) -> Conditions:
    sums = TermSums(machine.terms)
    sums.advance_terms(values, 0.0)
    return Conditions(terms=sums.freeze_terms(values))


@pytest.mark.parametrize(
    "text",
    [
        "flow_percent slope roll_deg slope=4",
        "flow_percent hinge opening_mm at=20 below=0.5 above=-0.8",
        "flow_percent bend shaft_rpm bend=-0.002 at=30",
        "flow_kg_min slope roll_deg slope=0.3",
        "flow_percent product opening_mm,roll_deg slope=0.4 at=10",
    ],
)
@pytest.mark.parametrize("wanted", [0.06, 0.12, 0.2])
def test_the_inverse_gives_the_flow_that_was_asked_for(text: str, wanted: float) -> None:
    machine = with_terms(made(text))
    c = conditions(machine, roll_deg=1.5, shaft_rpm=60.0, opening_mm=30.0)
    assert calc_flow_kg_s(
        machine, 60.0, find_opening_mm(machine, wanted, 60.0, c), c
    ) == pytest.approx(wanted, rel=1e-4)
    assert calc_flow_kg_s(
        machine, find_shaft_rpm(machine, wanted, 25.0, c), 25.0, c
    ) == pytest.approx(wanted, rel=1e-4)


def test_drives_are_told_what_makes_them_go_where_they_should() -> None:
    machine = with_terms(
        made("shaft_rpm saturation shaft_rpm slope=-1 low_end=0 high_end=3"),
        made("shaft_percent slope opening_mm slope=-0.1 at=20"),
        made("gate_mm slope opening_mm slope=0.02 at=10"),
    )
    c = conditions(machine, told_rpm=50.0, told_mm=25.0, opening_mm=30.0)
    told = find_shaft_command(machine, 50.0, 30.0, c)
    assert told * (1.0 - 0.1 * 10.0 / 100.0) - 3.0 == pytest.approx(50.0, abs=0.01)
    told = find_gate_command(machine, 25.0, c)
    assert told + 0.02 * (told - 10.0) == pytest.approx(25.0, abs=0.001)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("flow_percent slope roll_deg slope=4", ""),
        ("wheel_percent slope roll_deg slope=4", "wheel"),
        ("flow_percent periodic shaft_angle_deg cycles=6 sine=3", "angle"),
        ("scale_kg span time_s low_end=1 high_end=9 above=1", "span"),
        ("flow_percent slope torque slope=4", "torque"),
    ],
)
def test_what_control_cannot_take_back_is_said(text: str, why: str) -> None:
    said = explain_not_compensated(made(text))
    assert (said == "") if not why else (why in said)


def test_a_scale_that_runs_away_is_taken_back_by_its_rate_and_time() -> None:
    """Half a kilogram a minute for each degree of roll, at two degrees for a minute and a half."""
    known = KnownTerms(with_terms(made("scale_kg_min slope roll_deg slope=0.5")))
    for k in range(901):
        m = Measurements(0.1 * k, roll_deg=Reading(2.0, 0.1 * k))
        known.advance_terms(m, SimpleNamespace(speed_mps=1.0, heading_deg=0.0), 0.1 * k, None, 0.1)
    weighed = known.correct_weighing(Reading(100.0, 90.0))
    assert weighed is not None and weighed.value == pytest.approx(98.5, abs=0.01)
