"""A shaft of second order against its differential equation, in all steppers; it starts and stops as a shaft does."""
from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from control.machine.compiled_tick import CompiledDrives
from control.machine.elements import in_lists
from control.machine.gate import Gate, gate_start
from control.machine.machine import Machine, with_effect
from control.machine.shaft import Shaft, ShaftInput, lag_s, shaft_start, shaft_step, swing, swung
from control.machine.start import response_s

Array = npt.NDArray[np.float64]
DRIVE = Shaft(dead_time_s=0.05, time_constant_s=0.1, acceleration_rpm_s=1e6)
RINGS, GRADUAL = DRIVE._replace(second_order_s=0.4), DRIVE._replace(second_order_s=0.02)


def answered(shaft: Shaft, goals: list[float], hold_s: float, step_s: float) -> Array:
    state, found = shaft_start(0.0), []
    for goal in goals:
        for _ in range(round(hold_s / step_s)):
            state, out = shaft_step(shaft, state, ShaftInput(goal, 0.0, shaft.nominal_supply_v), step_s)
            found.append(out.rpm)
    return np.array(found)


@pytest.mark.parametrize("shaft", [RINGS, GRADUAL, DRIVE._replace(second_order_s=0.025)])
def test_a_step_is_that_of_the_equation(shaft: Shaft) -> None:
    second, tau = shaft.second_order_s, shaft.time_constant_s
    time_s = np.arange(1, 101) * 0.01
    exact = solve_ivp(lambda t, y: [y[1], (60.0 - y[0] - tau * y[1]) / (tau * second)], (0.0, 1.0), [0.0, 0.0],
                      dense_output=True, rtol=1e-10, atol=1e-10)
    assert answered(shaft, [60.0], 1.0, 0.01) == pytest.approx(exact.sol(np.maximum(0.0, time_s - 0.05))[0], abs=1e-5)


@pytest.mark.parametrize(("tau", "second", "fastest"), [(0.1, 0.4, 150.0), (0.3, 0.02, 100.0), (0.1, 0.025, 200.0)])
def test_the_acceleration_limit_holds_and_the_way_is_that_of_small_steps(tau: float, second: float, fastest: float
                                                                         ) -> None:
    x, v, step_s = 0.0, 0.0, 1e-5
    for _ in range(100_000):
        faster = min(fastest, max(-fastest, v + step_s * (90.0 - x - tau * v) / (tau * second)))
        x, v = x + 0.5 * step_s * (v + faster), faster
    assert swung(0.0, 0.0, 90.0, tau, second, fastest, -1e100, 1.0)[0] == pytest.approx(x, abs=0.02)
    speeds = [swung(0.0, 0.0, 90.0, tau, second, fastest, -1e100, t)[0] for t in np.arange(0.0, 2.0, 0.01)]
    assert np.abs(np.diff(speeds)).max() <= 0.01 * fastest * (1.0 + 1e-9)


def test_a_shaft_that_turns_one_way_stops_where_it_would_swing_back() -> None:
    one_way = RINGS._replace(one_way=1.0)
    assert answered(RINGS, [80.0, 0.0], 2.0, 0.01).min() < -10.0
    stopped = answered(one_way, [80.0, 0.0], 2.0, 0.01)
    assert stopped.min() == 0.0
    assert stopped[-150:].max() == 0.0


def test_overshoot_and_period_are_those_of_the_step() -> None:
    rpm, answer = answered(RINGS, [100.0], 3.0, 0.001), swing(RINGS)
    assert rpm.max() - 100.0 == pytest.approx(answer.overshoot_percent, abs=0.01)
    tops = np.flatnonzero(np.diff(np.sign(np.diff(rpm))) < 0)
    assert 0.001 * (tops[1] - tops[0]) == pytest.approx(answer.period_s, abs=0.002)
    quiet = swing(GRADUAL)
    assert answered(GRADUAL, [100.0], 3.0, 0.01).max() <= 100.0
    assert (quiet.overshoot_percent, sum(quiet.lags_s)) == (0.0, pytest.approx(lag_s(GRADUAL)))
    assert quiet.lags_s[0] * quiet.lags_s[1] == pytest.approx(0.1 * 0.02)


def test_compiled_ticks_are_the_steps() -> None:
    shaft, gate = RINGS._replace(acceleration_rpm_s=300.0), Gate()
    begun = shaft_start(0.0)
    drives, state = CompiledDrives(begun, gate_start(20.0)), begun._replace(line=in_lists(begun.line))
    drives.of(shaft, gate)
    for k in range(400):
        goal = 70.0 if k % 100 < 60 else 15.0
        rpm, _ = drives.step(goal, 20.0, 13.5, 0.0125)
        state, out = shaft_step(shaft, state, ShaftInput(goal, 20.0, 13.5), 0.0125)
        assert rpm == out.rpm


def test_a_start_takes_longer() -> None:
    first = [response_s(with_effect(Machine(), "shaft.second_order", size), 50.0) for size in (1e-6, 0.05, 0.2)]
    assert first[0] == pytest.approx(response_s(Machine(), 50.0), abs=1e-3)
    assert first[0] < first[1] < first[2]
