"""Nothing is said or written that prediction does not bear out."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from topdress.console.reports.diagnosis_text import describe_adoption, summarise_terminal
from topdress.console.reports.notebook import format_notebook_html
from topdress.control.diagnosis.extend import extend, find_cause_refusal
from topdress.control.diagnosis.prediction.block_errors import (
    BLOCK_COUNT,
    calc_block_errors,
    calc_errors_by_channel,
    cut_into_blocks,
    is_surely_positive,
    list_added_numbers,
)
from topdress.control.diagnosis.prediction.log_prediction import LogPredictor
from topdress.control.diagnosis.prediction.plain_rival import find_rival
from topdress.control.diagnosis.prediction.predictive_validation import (
    select_predictive_causes,
    validate_prediction,
)
from topdress.control.diagnosis.result import Cause, Diagnosis, FieldCost, Size
from topdress.control.diagnosis.runs.diagnose import diagnose_run, prepare_log
from topdress.control.machine.machine import Machine, add_effect

from tests.diagnosis.logs import DRIVE, lagged, steps
from tests.diagnosis.planted import error_on, shaft_predicted

Array = npt.NDArray[np.float64]


def seen(columns: dict[str, Any], machine: Machine) -> LogPredictor:
    log, data, _ = prepare_log({name: np.asarray(one) for name, one in columns.items()}, machine)
    return LogPredictor(log, data, machine)


def braked(seed: int, rpm_of_load: float = -0.09) -> dict[str, Any]:
    """A loop at one speed, 4 % below it; a brake is squeezed now and then, and a load cell,
    single cells of which are far out, reads how hard."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 60.0, 0.1)
    load = 0.0 * time_s
    for begin_s in rng.uniform(3.0, 57.0, 9):
        load += rng.uniform(300.0, 1500.0) * (
            (time_s > begin_s) & (time_s < begin_s + rng.uniform(0.5, 3.0))
        )
    load = lagged(load, 0.3, 0.1)
    cell = load + 5.0 * rng.standard_normal(len(load))
    cell[rng.integers(0, len(cell), 3)] = 1e5
    read = 0.96 * 500.0 + rpm_of_load * load + 2.0 * rng.standard_normal(len(load))
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": np.full(len(load), 500.0),
        "shaft_rpm": read,
        "x_load_g": cell,
    }


@cache
def of_the_brake() -> Diagnosis:
    return diagnose_run(braked(1), DRIVE)


def test_a_recorded_variable_that_predicts_is_said_and_taken_up() -> None:
    found, other = of_the_brake(), braked(2)
    assert found.verdict == "unexplained"
    assert "x_load_g" in {one.variable for one in found.unexplained}
    new = extend(DRIVE, found)
    assert error_on(other, new) < 0.3 * error_on(other, DRIVE)


def made(machine: Machine, seed: int) -> dict[str, Any]:
    """Random steps that a machine answers as its file says, with a sensor's noise."""
    columns = steps(seed)
    _, answers = shaft_predicted(columns, machine)
    return columns | {
        "shaft_rpm": answers + 2.0 * np.random.default_rng(seed).standard_normal(len(answers))
    }


def wrong_name(found: Diagnosis) -> Diagnosis:
    """A diagnosis that is sure of what is not there."""
    cause = Cause(
        "shaft.gain",
        Size(-12.0, -12.5, -11.5, "%"),
        None,
        0.999,
        (),
        None,
        "",
        FieldCost(-12.0, 0.0),
    )
    return replace(found, verdict="named", causes=(cause,), terms=(), unexplained=(), fitted=None)


@pytest.fixture(scope="module")
def sound() -> tuple[Diagnosis, LogPredictor]:
    columns = made(DRIVE, 4)
    return diagnose_run(columns, DRIVE), seen(columns, DRIVE)


def test_a_name_whose_file_predicts_worse_is_no_longer_sure_and_nothing_is_written(
    sound: tuple[Diagnosis, LogPredictor],
) -> None:
    found, on_log = wrong_name(sound[0]), sound[1]
    taken = select_predictive_causes(on_log, found, ["shaft.gain"], ())
    assert taken.found.causes == () and [name for name, _ in taken.refused] == ["shaft.gain"]
    after = validate_prediction(on_log, found, ())
    assert (
        after.verdict != "named"
        and after.causes[0].probability < 0.9
        and find_cause_refusal(after.causes[0])
    )
    assert extend(DRIVE, after) == DRIVE


def test_what_is_right_stays_as_it_is() -> None:
    found = diagnose_run(made(add_effect(DRIVE, "shaft.gain", -10.0), 5), DRIVE)
    assert found.verdict == "named" and [one.id for one in found.causes] == ["shaft.gain"]
    said = next(one for one in found.predicted if one.channel == "shaft")
    assert said.file == pytest.approx(2.0, rel=0.1) and said.before > 10.0
    assert said.rival is None, "nothing can be clearly ahead of noise"


def test_a_block_is_predicted_as_by_least_squares_without_it() -> None:
    """The one-step jackknife is exact for what is a straight line in its numbers."""
    columns = steps(2)
    on_log = seen(columns, DRIVE)
    file = add_effect(DRIVE, "shaft.gain", 30.0)
    (number,) = list_added_numbers(file, DRIVE)
    judged = calc_block_errors(on_log, file, ("shaft",), [number])
    left = calc_errors_by_channel(on_log, file, ("shaft",))["shaft"]
    column = (
        left
        - calc_errors_by_channel(on_log, add_effect(DRIVE, "shaft.gain", 31.0), ("shaft",))["shaft"]
    )
    best = float(column @ left) / float(column @ column)
    for k, block in enumerate(cut_into_blocks(len(left))):
        rest = np.ones(len(left), bool)
        rest[block] = False
        without = float(column[rest] @ left[rest]) / float(column[rest] @ column[rest])
        moved = add_effect(DRIVE, "shaft.gain", 30.0 + without - best)
        piece = calc_errors_by_channel(on_log, moved, ("shaft",))["shaft"][block]
        assert judged.blocks["shaft"][k] == pytest.approx(float(np.mean(piece**2)), rel=1e-6)
    assert len(judged.blocks["shaft"]) == BLOCK_COUNT


def test_the_rival_predicts_as_plain_least_squares_does() -> None:
    """By hand: gain and zone over a grid of lags and dead times, on another log."""
    columns, other = steps(1), steps(2)
    rival = find_rival(seen(columns, DRIVE), "shaft")
    assert rival is not None

    def plain(of: dict[str, Any], gain: float, zone: float, tau_s: float) -> Array:
        return lagged(gain * np.maximum(0.0, of["shaft_rpm_cmd"] - zone), tau_s, 0.02)

    tried = [
        (gain, zone, tau_s)
        for gain in (1.2, 1.3, 1.4, 1.5)
        for zone in (60.0, 90.0, 120.0)
        for tau_s in (0.02, 0.04, 0.08, 0.2)
    ]
    best = min(
        tried, key=lambda one: float(np.mean((columns["shaft_rpm"] - plain(columns, *one)) ** 2))
    )
    by_hand = float(np.sqrt(np.mean((other["shaft_rpm"] - plain(other, *best)) ** 2)))
    assert error_on(other, rival.machine) < 1.05 * by_hand


def test_report_and_notebook_say_the_rival_and_what_a_file_takes_up() -> None:
    found = of_the_brake()
    page = format_notebook_html(found)
    assert "plain least squares" in page and "x_load_g" in page
    assert (
        describe_adoption(found)[0].startswith("a machine file takes up: ")
        and describe_adoption(found)[0] in page
    )
    terms = [one for one in summarise_terminal(found) if one.startswith("term ")]
    assert terms and len(set(terms)) == len(terms)
    assert not any(" 0 r/min for each" in one or " 0 % for each" in one for one in terms)


@pytest.mark.parametrize("gain", [7.72460926, 0.1, 1.0 / 3.0, 49.9])
def test_one_block_that_has_anything_to_say_counts_whatever_its_last_bit(gain: float) -> None:
    """A shaft that starts once: its mean is one standard error exactly, and two kernels
    answered apart."""
    for moved in (-1e-14, 0.0, 1e-14):
        assert is_surely_positive(
            np.array([gain * (1.0 + moved), *np.full(BLOCK_COUNT - 1, moved)])
        )
        assert not is_surely_positive(
            -np.array([gain * (1.0 + moved), *np.full(BLOCK_COUNT - 1, moved)])
        )
