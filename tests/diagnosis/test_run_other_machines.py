"""Run logs of machines of other scale than the nominal one, made by the compiled model: what is hidden is found."""
from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from control.diagnosis.runs.diagnose import diagnose_run
from control.diagnosis.runs.hypothesis import EffectInstance
from control.diagnosis.runs.log import gate
from control.diagnosis.runs.next_run import separation
from control.diagnosis.runs.stages import run_data
from control.experiments.manoeuvres import manoeuvres
from control.machine.compiled import flow_run, gate_run, scale_run, shaft_run
from control.machine.elements import stepped
from control.machine.flow import FlowInput, FlowOutput, flow_start
from control.machine.gate import GateInput, GateOutput, gate_start
from control.machine.machine import Machine, with_effect
from control.machine.over_log import MOST_STEP_S, input_rows, no_switch
from control.machine.scale import ScaleInput
from control.machine.shaft import ShaftInput, ShaftOutput, shaft_start
from drivers.files.config import load
from drivers.files.kinds import MACHINE

Array = npt.NDArray[np.float64]


def of(name: str) -> Machine:
    return load(name, MACHINE).model


def held(rng: np.random.Generator, time: Array, low: float, high: float, hold_s: float) -> Array:
    return np.round(rng.uniform(low, high, int(time[-1] / hold_s) + 2)[(time / hold_s).astype(int)], 1)


def a_drive(machine: Machine, seed: int = 1, seconds: float = 300.0, step_s: float = 0.02) -> dict[str, Any]:
    """A shaft alone, over its whole range, stopped for 3 s of every 30."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, seconds, step_s)
    command = np.where(time % 30.0 < 3.0, 0.0, held(rng, time, 0.0, machine.limits.shaft_high_rpm, 1.5))
    inputs = input_rows(ShaftInput, len(time), command_rpm=command, opening_mm=0.0,
                        supply_v=machine.shaft.nominal_supply_v)
    turns = shaft_run((machine.shaft,), no_switch(), shaft_start(), ShaftOutput(0.0, 0.0), inputs, time, MOST_STEP_S)
    read = turns[:, 0] + machine.noise.shaft_rpm * rng.standard_normal(len(time))
    read = np.where(turns[:, 0] > 0.005 * machine.limits.shaft_high_rpm, read, 0.0)     # no counts while it stands
    return {"time_s": time, "shaft_rpm_cmd": command,
            "shaft_rpm": np.array([stepped(one, machine.shaft.encoder_step_rpm) for one in read])}


def a_run(machine: Machine, seed: int = 1, seconds: float = 900.0, stands_s: float = 12.0, of_s: float = 120.0,
          step_s: float = 0.1) -> dict[str, Any]:
    """Shaft, gate and hopper over the middle of their ranges; the shaft stands for `stands_s` of every `of_s`."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, seconds, step_s)
    n, sd, limits = len(time), machine.noise, machine.limits
    command = held(rng, time, max(limits.shaft_low_rpm, 0.3 * limits.shaft_high_rpm), 0.9 * limits.shaft_high_rpm, 4.0)
    command = np.where(time % of_s < stands_s, 0.0, command)
    asked = held(rng, time, 0.2 * limits.opening_high_mm, 0.6 * limits.opening_high_mm, 5.0)
    moved = gate_run((machine.gate,), no_switch(), gate_start(asked[0]), GateOutput(asked[0], asked[0]),
                     input_rows(GateInput, n, command_mm=asked), time, MOST_STEP_S)
    shaft = shaft_run((machine.shaft,), no_switch(), shaft_start(), ShaftOutput(0.0, 0.0),
                      input_rows(ShaftInput, n, command_rpm=command, opening_mm=moved[:, 0],
                                 supply_v=machine.shaft.nominal_supply_v), time, MOST_STEP_S)
    full = 0.98 * machine.flow.full_kg
    flow = flow_run((machine.flow,), no_switch(), flow_start(full), FlowOutput(0.0, full),
                    input_rows(FlowInput, n, shaft_rpm=shaft[:, 0], opening_mm=moved[:, 0]), time, MOST_STEP_S)
    assert flow[-1, 1] > 0.02 * full
    level = scale_run(machine.scale, input_rows(ScaleInput, n, hopper_kg=flow[:, 1], time_s=time))
    keep = np.exp(-step_s / sd.scale_correlation_s)
    kicks, slow = rng.standard_normal(n), np.zeros(n)
    for k in range(1, n):
        slow[k] = keep * slow[k - 1] + np.sqrt(1.0 - keep * keep) * kicks[k]
    step = machine.scale.resolution_kg
    return {"time_s": time, "shaft_rpm_cmd": command, "opening_mm_cmd": asked,
            "shaft_rpm": shaft[:, 1] + sd.shaft_rpm * rng.standard_normal(n),
            "opening_mm": moved[:, 1] + sd.opening_mm * rng.standard_normal(n),
            "hopper_kg": np.round((level + sd.scale_kg * slow) / step) * step}


LASTS_S = {"planter": 600.0, "spreader": 900.0}      # on one hopper


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.exam)])
@pytest.mark.parametrize("name", ["drive_alone", "planter", "spreader"])
def test_nothing_wrong_is_called_nothing(name: str, seed: int) -> None:
    machine = of(name)
    columns = a_drive(machine, seed) if name == "drive_alone" else a_run(machine, seed, LASTS_S[name])
    found = diagnose_run(columns, machine)
    assert found.verdict == "none", (found.causes, found.unexplained)
    assert {c.channel for c in found.channels} == ({"shaft"} if name == "drive_alone" else
                                                   {"shaft", "gate", "flow", "scale"})
    assert all(c.rmse < 1.2 * c.noise_floor for c in found.channels if c.channel in ("shaft", "gate"))


@pytest.mark.parametrize(("effect_id", "size"), [
    ("shaft.gain", -8.0), *(pytest.param(*one, marks=pytest.mark.exam) for one in (
        ("shaft.dead_band", 60.0), ("shaft.dead_band", 150.0), ("shaft.coarse_encoder", 16.7), ("shaft.slow", 0.15)))])
def test_what_a_drive_alone_gets_wrong(effect_id: str, size: float) -> None:
    machine = of("drive_alone")
    found = diagnose_run(a_drive(with_effect(machine, effect_id, size)), machine)
    assert found.verdict == "named" and [cause.id for cause in found.causes] == [effect_id]
    assert found.causes[0].size.value == pytest.approx(size, rel=0.1)


@pytest.mark.parametrize(("name", "effect_id", "size", "stands_s", "of_s"), [
    ("spreader", "gate.offset", 5.0, 12.0, 120.0), ("planter", "shaft.load_droop", 6.0, 12.0, 120.0),
    *(pytest.param(*one, marks=pytest.mark.exam) for one in (
        ("spreader", "gate.slow", 12.0, 12.0, 120.0), ("spreader", "shaft.dead_band", 450.0, 12.0, 120.0),
        ("spreader", "flow.leak", 20.0, 400.0, 600.0), ("spreader", "flow.fill_falloff", 8.0, 12.0, 120.0),
        ("planter", "gate.backlash", 0.4, 12.0, 120.0), ("planter", "flow.leak", 10.0, 100.0, 200.0)))])
def test_effects_of_natural_size_are_named(name: str, effect_id: str, size: float, stands_s: float,
                                           of_s: float) -> None:
    machine = of(name)
    seconds = LASTS_S[name] * (2.0 if effect_id == "flow.leak" else 1.0)
    columns = a_run(with_effect(machine, effect_id, size), 3, seconds, stands_s, of_s)
    found = diagnose_run(columns, machine)
    assert effect_id in [c.id for c in found.causes], (found.causes, found.unexplained)
    cause = next(c for c in found.causes if c.id == effect_id)
    assert len(found.causes) == 1
    assert cause.size.value == pytest.approx(size, rel=0.25) and cause.size.low < size < cause.size.high


@pytest.mark.exam
def test_steps_below_the_noise_are_sought_over_this_machines_range() -> None:
    """A step of 25 r/min with noise on top: the readings lie anywhere, and only the saw-tooth tells."""
    machine = of("drive_alone")
    columns = a_drive(with_effect(machine, "shaft.coarse_encoder", 25.0))
    turning = columns["shaft_rpm"] > 0.0
    columns["shaft_rpm"] += np.where(turning, 2.0 * np.random.default_rng(7).standard_normal(len(turning)), 0.0)
    found = diagnose_run(columns, machine)
    assert [cause.id for cause in found.causes] == ["shaft.coarse_encoder"], found.causes
    assert found.causes[0].size.value == pytest.approx(25.0, rel=0.02)


@pytest.mark.parametrize(("name", "knock_kg", "refilled"), [
    ("spreader", 20.0, False), ("spreader", 200.0, True), ("planter", 1.5, False), ("planter", 20.0, True)])
def test_a_refill_is_a_share_of_the_hopper(name: str, knock_kg: float, refilled: bool) -> None:
    machine = of(name)
    columns = a_run(machine, 1, 200.0, 200.0, 200.0)
    columns["hopper_kg"] = columns["hopper_kg"] - np.where(columns["time_s"] < 100.0, knock_kg, 0.0)
    hopper = run_data(gate(columns), machine).hopper
    assert hopper is not None and bool(hopper.jumps) == refilled


def test_a_manoeuvre_of_another_machine_is_within_its_ranges_and_separates() -> None:
    spreader = of("spreader")
    plans = {one.id: one for one in manoeuvres(spreader)}
    assert plans["stairs"].plan.startswith("Shaft staircase: 200, 400, 600, 800 r/min for a minute each")
    assert plans["stairs"].steps[:2] == ("200 r/min for 60 s", "400 r/min for 60 s")
    for one in plans.values():
        columns = one.reads(spreader)
        assert columns["hopper_kg"].min() > 0.5 * spreader.flow.full_kg
        assert columns["opening_mm"].max() <= spreader.limits.opening_high_mm
    assert separation(plans["openings"], spreader, EffectInstance("flow.gain", 5.0), "flow.zero_offset") > 3.0


