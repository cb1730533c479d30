"""Drives far from their data sheet: several names that are one curve, and a drive that no name fits, as a whole."""
from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from control.diagnosis.extend import extend, not_adoptable
from control.diagnosis.result import Diagnosis
from control.diagnosis.runs.adoption import adoptable_of
from control.diagnosis.runs.channels import channels, drive_rows
from control.diagnosis.runs.diagnose import diagnose_run, series_of_log
from control.diagnosis.runs.drives import whole_drives
from control.diagnosis.runs.hypothesis import EffectInstance, schedule, stages_of
from control.diagnosis.runs.log import gate
from control.diagnosis.runs.search import Search
from control.log_row import COMMANDS_HELD
from control.machine.machine import Flow, Limits, Machine, Noise, Tolerance
from control.machine.over_log import MOST_STEP_S
from control.machine.shaft import Shaft, lag_s

Array = npt.NDArray[np.float64]
FULL_RPM = 650.0
DRIVE = Machine(id="drive", shaft=Shaft(dead_time_s=0.02, time_constant_s=0.06, acceleration_rpm_s=1e6,
                                        full_rpm=FULL_RPM), flow=Flow(full_rpm=FULL_RPM),
                limits=Limits(shaft_low_rpm=0.0, shaft_high_rpm=FULL_RPM), noise=Noise(shaft_rpm=2.0),
                tolerance=Tolerance(shaft_percent=0.5, time_constant_s=0.015))


def staircase(seed: int) -> dict[str, Any]:
    """A settled answer a row: a motor that saturates and turns from 110 r/min of its command on."""
    rng = np.random.default_rng(seed)
    told = np.concatenate((np.arange(0.0, 640.0, 16.0), np.arange(632.0, 0.0, -16.0)))
    turns = 610.0 * (1.0 - np.exp(-np.maximum(0.0, told - 110.0) / 110.0))
    read = turns + 2.0 * rng.standard_normal(len(told)) * (turns > 0.0)
    events = np.full(len(told), "", dtype=object)
    events[0] = COMMANDS_HELD
    return {"time_s": 1.1 * np.arange(len(told) + 1), "shaft_rpm_cmd": np.append(told, told[-1]),
            "shaft_rpm": np.concatenate(([np.nan], read)), "events": np.append(events, "")}


def steps(seed: int) -> dict[str, Any]:
    """Random steps, rows of 20 ms: most of an answer comes at once, the rest with 1.2 s; it walks beside."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 120.0, 0.02)
    told = np.repeat(rng.uniform(60.0, 600.0, 150), 40)
    goal = 1.4 * np.maximum(0.0, told - 90.0)
    read = 0.85 * lagged(goal, 0.03, 0.02) + 0.15 * lagged(goal, 1.2, 0.02)
    walks = lagged(40.0 * rng.standard_normal(len(told)), 1.0, 0.02)
    return {"time_s": time_s, "shaft_rpm_cmd": told, "shaft_rpm": read + walks + 2.0 * rng.standard_normal(len(told))}


def lagged(goal: Array, tau_s: float, step_s: float) -> Array:
    found, share = np.empty(len(goal)), np.exp(-step_s / tau_s)
    found[0] = goal[0]
    for row in range(1, len(goal)):
        found[row] = goal[row - 1] + (found[row - 1] - goal[row - 1]) * share
    return found


def error_on(columns: dict[str, Any], machine: Machine) -> float:
    clean = gate({name: np.asarray(values) for name, values in columns.items()}, machine.has)
    drive = whole_drives(clean, machine)["shaft"]
    predicted = drive_rows(drive)(schedule(stages_of(machine), ()), MOST_STEP_S)[:, 1]
    return float(np.sqrt(np.nanmean(np.square(clean.columns["shaft_rpm"] - predicted)[1:])))


@pytest.fixture(scope="module")
def curve() -> Diagnosis:
    return diagnose_run(staircase(1), DRIVE)


def test_a_gain_a_zone_and_a_curve_that_only_fit_together_are_named(curve: Diagnosis) -> None:
    assert {"shaft.gain", "shaft.dead_zone", "shaft.saturation"} <= {cause.id for cause in curve.causes}
    zone = next(cause for cause in curve.causes if cause.id == "shaft.dead_zone")
    assert zone.size.value == pytest.approx(110.0, abs=8.0)


def test_the_file_with_them_predicts_the_next_staircase(curve: Diagnosis) -> None:
    other = staircase(2)
    assert error_on(other, extend(DRIVE, curve)) < 0.1 * error_on(other, DRIVE)


def test_a_drive_that_no_name_fits_is_adopted_as_a_whole() -> None:
    found, other = diagnose_run(steps(1), DRIVE), steps(2)
    assert found.fitted is not None
    assert found.fitted.after < 0.5 * found.fitted.before
    extended = extend(DRIVE, found)
    assert {one.id for one in extended.adopted} == {name for name, _ in found.fitted.sizes}
    assert error_on(other, extended) < 0.4 * error_on(other, DRIVE)
    assert "fitted" in found.to_json()


def test_two_speeds_are_a_line_and_no_curve() -> None:
    """A zone and a gain pass through both speeds and go on straight; what bends beyond them nobody saw."""
    columns = steps(1)
    columns["shaft_rpm_cmd"] = np.where(columns["shaft_rpm_cmd"] > 330.0, 450.0, 250.0)
    found = diagnose_run(columns, DRIVE)
    assert found.fitted is None or "shaft.saturation" not in {name for name, _ in found.fitted.sizes}
    assert not any(one.predicts_best and one.term["form"] == "dead_zone" for one in found.terms)


def test_freedom_of_form_moves_no_size() -> None:
    columns = {name: np.asarray(values) for name, values in staircase(1).items()}
    _, data, _ = series_of_log(columns, DRIVE)
    search = Search([channels(data, DRIVE)["shaft"]], DRIVE, data)
    parts = (EffectInstance("shaft.gain", 100.0), EffectInstance("shaft.dead_zone", 90.0))
    slopes = search.columns.slopes(parts)
    for form in search.columns.form_columns(parts, slopes):
        for slope in slopes:
            a, b = form.coefficients["shaft"], slope.coefficients["shaft"]
            assert abs(a @ b) < 1e-6 * np.linalg.norm(a) * np.linalg.norm(b) + 1e-9


def test_a_drive_may_be_quicker_than_its_data_sheet_and_never_ahead() -> None:
    assert lag_s(DRIVE.shaft._replace(slow_s=-0.04)) == pytest.approx(0.02)
    assert lag_s(DRIVE.shaft._replace(slow_s=-1.0)) > 0.0


def eight_duties(seed: int) -> dict[str, Any]:
    """A motor asked for eight duties by turns: it starts at 68 r/min of its command, lags it by 30, ends at 283. Rows
    of 50 ms, its encoder counts 3.3 r/min."""
    draws, duty, speed_rpm, rows = random.Random(seed), 0, 0.0, []
    for k in range(2400):
        if k % 60 == 0:
            duty = draws.choice([0, 30, 60, 90, 120, 160, 200, 255])
        goal_rpm = 0.0 if duty < 45 else min(1.5 * (duty - 20), 1700.0 / 6.0)
        speed_rpm -= (goal_rpm - speed_rpm) * math.expm1(-0.05 / 0.15)
        rows.append((0.05 * k, 1.5 * duty, round((speed_rpm + draws.gauss(0.0, 1.0)) * 0.3) / 0.3))
    return dict(zip(("time_s", "shaft_rpm_cmd", "shaft_rpm"), np.array(rows).T, strict=True))


def test_names_that_leave_something_are_adopted_together() -> None:
    """The judged curve bends where the motor ends, and a threshold is left: it predicts, its parts alone hardly do."""
    machine = DRIVE.model_copy(update={
        "shaft": DRIVE.shaft._replace(dead_time_s=0.0, time_constant_s=0.108, full_rpm=400.0),
        "limits": Limits(shaft_low_rpm=0.0, shaft_high_rpm=400.0)})
    found = diagnose_run(eight_duties(1), machine)
    new = extend(machine, adoptable_of(found, [one.id for one in found.causes if not not_adoptable(one)]).found)
    assert error_on(eight_duties(2), new) < 0.5 * error_on(eight_duties(2), machine)
