"""Logs of the closed loop, where control follows the very sensors that are judged; and the gain
in the closed loop."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from topdress.console.cli import app
from topdress.control.diagnosis.runs.closed_loop import measure_loop_gain
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.log_row import COLUMNS, TEXT_COLUMNS
from topdress.control.machine.fault_injection import InjectedEffect
from topdress.control.machine.machine import Machine, add_effect
from topdress.control.orders import Strategy
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import simulate_run
from topdress.drivers.files.run_setup import Setup, load_setup
from typer.testing import CliRunner

# four times the shipped machine's: its noise is plain in every command
NOISY_WHEEL_MPS = 0.08


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_setup("huanghai", "demo", dt.date(2026, 1, 1))


def logged(
    setup: Setup, machine: Machine, strategy: Strategy, seconds: float, seed: int
) -> dict[str, Any]:
    """Columns of the log of a simulated run, as the console writes them."""
    job = add_simulated_field(setup.job.model_copy(update={"strategy": strategy}), machine)
    plant = make_plant(machine, job, seed, 0.05)
    rows = [
        step.tick.row
        for step in simulate_run(
            plant, make_control_loop(machine, setup.crop, setup.rule, job), seconds
        )
    ]
    columns: dict[str, Any] = {}
    for name in COLUMNS:
        cells = [getattr(row, name) for row in rows]
        columns[name] = (
            np.array(["" if c is None else c for c in cells], object)
            if name in TEXT_COLUMNS
            else np.array([np.nan if c is None else c for c in cells], np.float64)
        )
    return columns


def noisy(machine: Machine) -> Machine:
    return machine.model_copy(
        update={"noise": machine.noise.model_copy(update={"wheel_mps": NOISY_WHEEL_MPS})}
    )


@pytest.mark.exam
@pytest.mark.parametrize("strategy", [Strategy.SPEED_FIRST, Strategy.OPENING_FIRST])
def test_a_speed_sensors_own_noise_is_no_finding(setup: Setup, strategy: Strategy) -> None:
    machine = noisy(setup.machine)
    found = diagnose_run(logged(setup, machine, strategy, 600.0, 12), machine)
    assert found.verdict == "none", (found.causes, found.unexplained)


@pytest.mark.exam
def test_knowing_the_effects_takes_the_bias_out_of_the_closed_loop(setup: Setup) -> None:
    effects = (InjectedEffect("flow.fill_falloff", 12.0), InjectedEffect("shaft.voltage_sag", 3.0))
    known = setup.machine
    for effect in effects:
        known = add_effect(known, effect.id, effect.size)
    job = setup.job.model_copy(update={"strategy": Strategy.SPEED_FIRST, "flow_trim": False})
    gain = measure_loop_gain(
        setup.machine, known, effects, setup.crop, setup.rule, job, seconds=240.0, seed=1
    )
    before, after = gain.before, gain.after
    assert before.bias_kg_ha / before.mean_target_kg_ha < -0.007
    assert abs(after.bias_kg_ha) < 0.5 * abs(before.bias_kg_ha)
    assert after.place_error_m < before.place_error_m + 0.02


@pytest.mark.exam
def test_the_command_line_tells_the_gain_in_the_closed_loop(tmp_path: Path) -> None:
    log = str(tmp_path / "a.csv")
    runner = CliRunner()
    made = runner.invoke(
        app,
        ["simulate", "--seconds", "200", "--seed", "3", "--effect", "shaft.gain=4", "--out", log],
    )
    assert made.exit_code == 0, made.output
    plain = runner.invoke(app, ["diagnose", log])
    assert "shaft.gain" in plain.output and "closed loop" not in plain.output
    asked = runner.invoke(app, ["diagnose", log, "--closed-loop", "60"])
    assert asked.exit_code == 0, asked.output
    told = asked.output[asked.output.index("closed loop, simulated 60 s") :].splitlines()
    assert told[1].split()[:2] == ["not", "known"] and told[2].split()[0] == "known"
    assert told[1].split("landed")[1] != told[2].split("landed")[1]


@pytest.mark.exam
def test_a_known_shift_of_the_opening_s_sensor_is_taken_off_its_reading(setup: Setup) -> None:
    shifted = (InjectedEffect("gate.offset", 1.5),)
    known = add_effect(setup.machine, "gate.offset", 1.5)
    job = setup.job.model_copy(update={"strategy": Strategy.OPENING_FIRST, "flow_trim": False})
    gain = measure_loop_gain(
        setup.machine, known, shifted, setup.crop, setup.rule, job, seconds=200.0, seed=1
    )
    before, after = gain.before, gain.after
    assert before.bias_kg_ha / before.mean_target_kg_ha < -0.05
    assert abs(after.bias_kg_ha) < 0.1 * abs(before.bias_kg_ha)
