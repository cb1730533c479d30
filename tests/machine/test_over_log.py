"""Interpreted and compiled run the same source: equal to the bit; the step is small enough; rows line up with time."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from control.machine import compiled
from control.machine.flow import Flow, FlowInput, FlowOutput, flow_start, flow_step
from control.machine.gate import Gate, GateInput, GateOutput, gate_start, gate_step
from control.machine.over_log import MOST_STEP_S, filling, input_rows, no_switch, over_log
from control.machine.shaft import Shaft, ShaftInput, ShaftOutput, shaft_start, shaft_step
from control.machine.speed import Speed, SpeedInput, SpeedOutput, speed_start, speed_step

N = 3000


def drive(step_s: float = 0.05, jitter: float = 0.0) -> tuple[Any, Any, Any, Any]:
    rng = np.random.default_rng(5)
    time_s = np.arange(N) * step_s + jitter * rng.uniform(0.0, step_s, N)
    command = np.repeat(rng.uniform(0, 100, N // 20), 20).round(1)
    opening = np.repeat(rng.uniform(5, 60, N // 30), 30).round(1)
    return time_s, command, opening, 13.5 + rng.normal(0, 0.4, N)


CASES: list[tuple[str, Any, Any, Any]] = [
    ("shaft", Shaft(extra_dead_time_s=0.07, dead_band_rpm=15.0, sag_percent_per_v=3.0, encoder_step_rpm=1.0),
     shaft_step, compiled.shaft_run),
    ("shaft", Shaft(second_order_s=0.3, time_constant_s=0.12), shaft_step, compiled.shaft_run),
    ("shaft", Shaft(second_order_s=0.02, time_constant_s=0.3, one_way=1.0), shaft_step, compiled.shaft_run),
    ("shaft", Shaft(second_order_s=0.4, acceleration_rpm_s=1e6, one_way=1.0), shaft_step, compiled.shaft_run),
    ("gate", Gate(backlash_mm=0.7, lost_mm_per_100mm=0.05, offset_mm=0.4), gate_step, compiled.gate_run),
    ("flow", Flow(fill_falloff_percent=6.0, bridging_percent=10.0, pulsation_percent=5.0, hopper_head_percent=2.0),
     flow_step, compiled.flow_run),
    ("speed", Speed(gnss_latency_s=0.33, slip_percent=6.0), speed_step, compiled.speed_run)]


EXACT = ("shaft", "gate")       # their steps are exact however long a command is held


def arguments(stage: str, params: Any, step_s: float, jitter: float, most: float = MOST_STEP_S) -> tuple[Any, ...]:
    time_s, command, opening, supply = drive(step_s, jitter)
    if stage == "shaft":
        rows = input_rows(ShaftInput, N, command_rpm=command, opening_mm=opening, supply_v=supply)
        return (params,), no_switch(), shaft_start(), ShaftOutput(0.0, 0.0), rows, time_s, most
    if stage == "gate":
        rows = input_rows(GateInput, N, command_mm=opening)
        return (params,), no_switch(), gate_start(20.0), GateOutput(20.0, 20.0), rows, time_s, most
    if stage == "flow":
        rows = input_rows(FlowInput, N, shaft_rpm=command, opening_mm=opening)
        return (params,), no_switch(), flow_start(300.0), FlowOutput(0.0, 300.0), rows, time_s, most
    rows = input_rows(SpeedInput, N, speed_mps=command / 50.0, working=1.0)
    return (params,), no_switch(), speed_start(), SpeedOutput(0.0, 0.0), rows, time_s, most


@pytest.mark.parametrize("jitter", [0.0, 0.5])
@pytest.mark.parametrize(("stage", "params", "step", "run"), CASES, ids=[c[0] for c in CASES])
def test_interpreted_equals_compiled(stage: str, params: Any, step: Any, run: Any, jitter: float) -> None:
    interpreted = over_log(step, exact=stage in EXACT)(*arguments(stage, params, 0.05, jitter))
    assert np.array_equal(interpreted, run(*arguments(stage, params, 0.05, jitter)))
    assert np.ptp(interpreted[:, 0]) > 0.0


@pytest.mark.parametrize("row_s", [0.02, 0.05, 1.0])
@pytest.mark.parametrize(("stage", "params", "step", "run"), [c for c in CASES if c[0] in EXACT])
def test_one_step_a_row_is_as_good_as_many(stage: str, params: Any, step: Any, run: Any, row_s: float) -> None:
    at_once = run(*arguments(stage, params, row_s, 0.5))
    cut = compiled.stage_run(step)(*arguments(stage, params, row_s, 0.5))
    off = np.abs(at_once - cut).max(axis=1)
    if stage == "shaft":        # a speed half-way between two counts of the encoder may be read as either
        off = np.where(np.abs(off - params.encoder_step_rpm) < 1e-6, 0.0, off)
    assert off.max() < 1e-6
    assert np.ptp(at_once[:, 0]) > 10.0


def test_a_command_cannot_show_in_its_own_row() -> None:
    time_s = np.arange(100) * 0.05
    rows = input_rows(GateInput, 100, command_mm=np.where(np.arange(100) >= 50, 30.0, 20.0))
    p = Gate(dead_time_s=0.0)
    out = compiled.gate_run((p,), no_switch(), gate_start(20.0), GateOutput(20.0, 20.0), rows, time_s, MOST_STEP_S)
    assert out[50, 0] == 20.0
    assert out[51, 0] == pytest.approx(21.0)


def test_an_effect_may_begin_mid_run() -> None:
    sets, _, *rest = arguments("shaft", Shaft(), 0.05, 0.0)
    late = compiled.shaft_run((sets[0], Shaft(gain_percent=10.0)), np.array([1500]), *rest)
    never = compiled.shaft_run(sets, no_switch(), *rest)
    assert np.array_equal(late[:1501], never[:1501])
    assert not np.array_equal(late[1510:1600], never[1510:1600])


def test_the_cache_folder_is_named_by_the_sources() -> None:
    assert len(compiled.CACHE_DIR.name) == 12


def test_a_stage_compiles_without_counting_references(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Counting those of its line's arrays at each step took four fifths of a diagnosis' runs of the model."""
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))        # code that comes from the disk shows no listing
    fill = compiled.compiled(filling(gate_step, exact=True), makes_arrays=False)
    given = arguments("gate", Gate(), 0.05, 0.0)
    out = np.empty((N, 2))
    fill(out, *given)
    assert np.array_equal(out, compiled.gate_run(*arguments("gate", Gate(), 0.05, 0.0)))
    listing = "".join(fill.inspect_llvm().values())
    assert "gate_step" in listing and "NRT_incref" not in listing
