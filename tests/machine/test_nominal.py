"""The nominal machine's figures, each from its source."""
from __future__ import annotations

import pytest

from control.machine.fall import Fall, lag_paper_s, start_drop_s
from control.machine.flow import Flow, FlowInput, flow_start, flow_step
from control.machine.gate import Gate, GateInput, gate_start, gate_step
from control.machine.shaft import Shaft, ShaftInput, shaft_start, shaft_step

STEP_S = 0.001


def time_to(rpm: float, set_point_rpm: float) -> float:
    state, time_s = shaft_start(0.0), 0.0
    while time_s < 3.0:
        state, out = shaft_step(Shaft(), state, ShaftInput(set_point_rpm, 25.0, 13.5), STEP_S)
        time_s += STEP_S
        if out.rpm >= rpm:
            return time_s
    raise AssertionError("never reached")


@pytest.mark.parametrize("set_point_rpm", [10.0, 20.0, 40.0, 70.0, 100.0])
def test_two_rpm_after_0_383_s_at_any_set_point(set_point_rpm: float) -> None:
    """Lag paper, table 2: the mean system response."""
    assert time_to(2.0, set_point_rpm) == pytest.approx(0.383, abs=0.004)


@pytest.mark.parametrize("shaft_rpm", range(10, 71, 10))
def test_response_and_drop_make_eq_6(shaft_rpm: float) -> None:
    assert 0.383 + start_drop_s(Fall(), shaft_rpm) == pytest.approx(lag_paper_s(shaft_rpm), abs=1e-9)


def test_gate_waits_then_slews() -> None:
    state, openings = gate_start(10.0), []
    for _ in range(1000):
        state, out = gate_step(Gate(), state, GateInput(20.0), STEP_S)
        openings.append(out.opening_mm)
    assert openings[98] == pytest.approx(10.0, abs=1e-9)
    assert openings[349] == pytest.approx(15.0, abs=0.05)
    assert openings[-1] == pytest.approx(20.0)
    assert openings[599] == pytest.approx(20.0, abs=0.05)


@pytest.mark.parametrize(("shaft_rpm", "opening_mm"), [(70.0, 14.0), (38.0, 25.0), (10.0, 60.0)])
def test_flow_formula(shaft_rpm: float, opening_mm: float) -> None:
    _, out = flow_step(Flow(), flow_start(300.0), FlowInput(shaft_rpm, opening_mm), 0.05)
    assert out.flow_kg_s == pytest.approx(0.0055 * opening_mm * shaft_rpm / 60.0, rel=1e-12)


def test_an_empty_hopper_gives_what_is_left_and_no_more() -> None:
    state, total = flow_start(0.003), 0.0
    for _ in range(100):
        state, out = flow_step(Flow(), state, FlowInput(70.0, 20.0), 0.05)
        total += out.flow_kg_s * 0.05
    assert total == pytest.approx(0.003)
    assert state.hopper_kg == pytest.approx(0.0, abs=1e-12)
