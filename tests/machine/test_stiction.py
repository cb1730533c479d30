"""A drive that sticks stands, then jumps; its longest answers are those of its file and log."""

from __future__ import annotations

import numpy as np
import pytest
from topdress.control.diagnosis.extend import extend
from topdress.control.diagnosis.result import Cause, Diagnosis, FieldCost, Size, SourceSummary
from topdress.control.diagnosis.runs.log import fit_answers_to_log
from topdress.control.machine.gate import Gate, GateInput, make_gate_start, step_gate
from topdress.control.machine.machine import Machine, add_effect
from topdress.control.machine.shaft import (
    Shaft,
    ShaftInput,
    find_held_command_rpm,
    make_shaft_start,
    step_shaft,
)

ALONE = Machine(stages=("shaft",))


@pytest.mark.parametrize("dt_s", [0.01, 0.05, 0.25])
def test_a_gate_sticks_and_jumps_to_its_command(dt_s: float) -> None:
    state, stood = make_gate_start(10.0), []
    for command in (12.0, 12.9, 13.5, 11.5, 10.4):
        for _ in range(round(1.0 / dt_s)):
            state, out = step_gate(Gate(stiction_mm=3.0), state, GateInput(command), dt_s)
        stood.append(out.opening_mm)
    assert stood == pytest.approx([10.0, 10.0, 13.5, 13.5, 10.4])


def test_a_shaft_sticks_follows_until_its_command_returns_and_stops_at_zero() -> None:
    p = Shaft(stiction_rpm=3.0, dead_time_s=0.0)
    state, turned = make_shaft_start(50.0), []
    for command in (52.0, 54.0, 55.0, 53.0, 51.5, 2.0, 0.0):
        for _ in range(20):
            state, out = step_shaft(p, state, ShaftInput(command, 25.0, 13.5), 0.1)
        turned.append(out.rpm)
    # 55 continues what 54 began; 53 returns, and sticks.
    assert turned == pytest.approx([50.0, 54.0, 55.0, 55.0, 51.5, 2.0, 0.0], abs=1e-3)


@pytest.mark.parametrize(("gain", "reading", "held"), [(0.0, 51.0, 51.0), (10.0, 57.2, 52.0)])
def test_the_reading_tells_where_a_drive_sticks_at_first(
    gain: float, reading: float, held: float
) -> None:
    p = Shaft(stiction_rpm=4.0, gain_percent=gain)
    found = find_held_command_rpm(p, ShaftInput(50.0, 25.0, 13.5), reading)
    assert found == pytest.approx(held, abs=0.01)


def test_a_log_of_a_drive_alone_allows_answers_of_a_quarter_of_its_length() -> None:
    log = {"time_s": np.linspace(0.0, 4000.0, 400)}
    assert fit_answers_to_log(ALONE, log).limits.longest_answer_s == 1000.0
    assert fit_answers_to_log(Machine(), log) == Machine()
    with pytest.raises(ValueError, match="size 200"):
        add_effect(ALONE, "shaft.slow", 200.0)
    slow = Cause(
        "shaft.slow",
        Size(200.0, 190.0, 210.0, "s"),
        None,
        0.99,
        (),
        None,
        "Small and large steps.",
        FieldCost(0.0, 0.0),
    )
    data = SourceSummary("run.csv", "run", 600, 60.0, "heater")
    adopted = extend(ALONE, Diagnosis(data, (), "named", (slow,), (), (), None, (), None))
    assert adopted.shaft.slow_s == 200.0
    assert Machine.model_validate(adopted.model_dump()) == adopted
