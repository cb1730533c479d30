"""The nominal machine's figures, each from its source."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from topdress.control.diagnosis.runs.compared import compared
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.machine.compiled import run_shaft
from topdress.control.machine.compiled_tick import CompiledDrives
from topdress.control.machine.fall import Fall, find_paper_lag_s, find_start_drop_s
from topdress.control.machine.flow import Flow, FlowInput, make_flow_start, step_flow
from topdress.control.machine.gate import Gate, GateInput, make_gate_start, step_gate
from topdress.control.machine.landing import bin_landings
from topdress.control.machine.machine import Machine, add_effect
from topdress.control.machine.model_elements import convert_to_lists
from topdress.control.machine.shaft import (
    Shaft,
    ShaftInput,
    ShaftOutput,
    calc_step_response,
    calc_time_constant_s,
    make_shaft_start,
    step_second_order,
    step_shaft,
)
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S, make_input_rows, make_no_switch
from topdress.control.machine.start_lag import calc_response_s
from topdress.control.machine.term_step import TermState, step_term
from topdress.control.machine.terms import Term, make_term_params
from topdress.control.metering.inverse_model import find_shaft_command
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

STEP_S = 0.001


def time_to(rpm: float, set_point_rpm: float) -> float:
    state, time_s = make_shaft_start(0.0), 0.0
    while time_s < 3.0:
        state, out = step_shaft(Shaft(), state, ShaftInput(set_point_rpm, 25.0, 13.5), STEP_S)
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
    assert 0.383 + find_start_drop_s(Fall(), shaft_rpm) == pytest.approx(
        find_paper_lag_s(shaft_rpm), abs=1e-9
    )


def test_gate_waits_then_slews() -> None:
    state, openings = make_gate_start(10.0), []
    for _ in range(1000):
        state, out = step_gate(Gate(), state, GateInput(20.0), STEP_S)
        openings.append(out.opening_mm)
    assert openings[98] == pytest.approx(10.0, abs=1e-9)
    assert openings[349] == pytest.approx(15.0, abs=0.05)
    assert openings[-1] == pytest.approx(20.0)
    assert openings[599] == pytest.approx(20.0, abs=0.05)


@pytest.mark.parametrize(("shaft_rpm", "opening_mm"), [(70.0, 14.0), (38.0, 25.0), (10.0, 60.0)])
def test_flow_formula(shaft_rpm: float, opening_mm: float) -> None:
    _, out = step_flow(Flow(), make_flow_start(300.0), FlowInput(shaft_rpm, opening_mm), 0.05)
    assert out.flow_kg_s == pytest.approx(0.0055 * opening_mm * shaft_rpm / 60.0, rel=1e-12)


def test_an_empty_hopper_gives_what_is_left_and_no_more() -> None:
    state, total = make_flow_start(0.003), 0.0
    for _ in range(100):
        state, out = step_flow(Flow(), state, FlowInput(70.0, 20.0), 0.05)
        total += out.flow_kg_s * 0.05
    assert total == pytest.approx(0.003)
    assert state.hopper_kg == pytest.approx(0.0, abs=1e-12)


# --- Landing conserves mass, whatever the drop times do; a sound delay comes out where it
# should ---------------------


@settings(max_examples=60, deadline=None)
@given(
    st.integers(3, 200),
    st.integers(0, 10_000),
    st.floats(0.0, 3.0),
    st.sampled_from([0.05, 0.1, 0.25, 1.0]),
)
def test_kg_landed_equal_kg_released(count: int, seed: int, spread_s: float, bin_m: float) -> None:
    rng = np.random.default_rng(seed)
    time_s = np.arange(count) * 0.05
    track = np.cumsum(rng.uniform(0.0, 0.15, count))
    mass = rng.uniform(0.0, 0.01, count)
    drop = rng.uniform(0.0, spread_s + 0.01, count)
    ground, place = bin_landings(time_s, track, mass, drop, bin_m)
    assert ground.mass_kg.sum() == pytest.approx(mass.sum(), rel=1e-9)
    assert (ground.mass_kg >= -1e-15).all()
    assert len(place) == count


def test_a_step_lands_one_lag_distance_later() -> None:
    time_s = np.arange(2000) * 0.05
    track = 1.25 * time_s
    mass = np.where(time_s >= 50.0, 0.01, 0.0)
    ground, _ = bin_landings(time_s, track, mass, np.full(2000, 1.6), 0.05)
    first = ground.calc_centres_m()[np.flatnonzero(ground.mass_kg > 0)[0]]
    assert first == pytest.approx(1.25 * (50.0 + 1.6), abs=0.06)


def test_a_lever_arm_moves_everything() -> None:
    time_s = np.arange(100) * 0.05
    _, near = bin_landings(time_s, time_s, np.ones(100), np.ones(100), 0.1)
    _, far = bin_landings(time_s, time_s, np.ones(100), np.ones(100), 0.1, lever_arm_m=0.7)
    assert far - near == pytest.approx(0.7)


def test_steady_flow_lies_evenly() -> None:
    """No comb where bins are finer than a tick's travel."""
    time_s = np.arange(4000) * 0.05
    ground, _ = bin_landings(time_s, 1.25 * time_s, np.full(4000, 0.004), np.full(4000, 1.3), 0.05)
    inner = ground.mass_kg[50:-50]
    assert inner == pytest.approx(np.full(len(inner), inner.mean()), rel=1e-9)


# --- A shaft that turns both ways: gain and zone of each side, a curve, and one that says that
# it turns one w... -----

Array = npt.NDArray[np.float64]
DRIVE = load_config("drive_alone", MACHINE_KIND).model


def settled(shaft: Shaft, command_rpm: float) -> float:
    state = make_shaft_start(0.0)
    for _ in range(400):
        state, out = step_shaft(
            shaft, state, ShaftInput(command_rpm, 0.0, shaft.nominal_supply_v), 0.01
        )
    return out.rpm


def turned(machine: Machine, command: Array, time_s: Array) -> Array:
    inputs = make_input_rows(
        ShaftInput, len(time_s), command_rpm=command, supply_v=machine.shaft.nominal_supply_v
    )
    return np.asarray(
        run_shaft(
            (machine.shaft,),
            make_no_switch(),
            make_shaft_start(),
            ShaftOutput(0.0, 0.0),
            inputs,
            time_s,
            MAX_MODEL_STEP_S,
        )[:, 0]
    )


@pytest.mark.parametrize(
    ("change", "command", "rpm"),
    [
        ({}, -300.0, -300.0),
        ({"one_way": 1.0}, -300.0, 0.0),
        ({"one_way": 1.0}, 300.0, 300.0),
        ({"dead_zone_rpm": 40.0}, 300.0, 260.0),
        ({"dead_zone_rpm": 40.0}, -300.0, -260.0),
        ({"dead_zone_rpm": 40.0}, 39.0, 0.0),
        ({"dead_zone_rpm": 40.0, "back_zone_rpm": -10.0}, -300.0, -270.0),
        ({"back_gain_percent": 10.0}, -300.0, -330.0),
        ({"back_gain_percent": 10.0}, 300.0, 300.0),
        ({"dead_band_rpm": 40.0}, -39.0, 0.0),
        ({"dead_band_rpm": 40.0}, -300.0, -300.0),
        ({"neutral_rpm": 150.0}, 400.0, 250.0),
        ({"neutral_rpm": 150.0}, 100.0, -50.0),
        ({"neutral_rpm": 150.0, "one_way": 1.0}, 100.0, 0.0),
        ({"neutral_rpm": -30.0}, 0.0, 0.0),
        ({"neutral_rpm": -30.0, "zero_stops": 0.0}, 0.0, 30.0),
        ({"neutral_rpm": -30.0}, 300.0, 330.0),
        ({"neutral_rpm": 150.0, "dead_zone_rpm": 40.0}, 100.0, -10.0),
        ({"neutral_rpm": 150.0, "dead_band_rpm": 60.0}, 100.0, 0.0),
        ({"neutral_rpm": 500.0, "gain_percent": -210.0}, 400.0, 110.0),
        ({"neutral_rpm": 500.0, "gain_percent": -210.0}, 600.0, -110.0),
        ({"neutral_rpm": 500.0, "gain_percent": -200.0, "one_way": 1.0}, 600.0, 0.0),
        ({"neutral_rpm": 500.0, "gain_percent": -200.0}, 0.0, 0.0),
        ({"saturation_percent": 20.0}, 650.0, 520.0),
        ({"saturation_percent": 20.0}, -650.0, -520.0),
    ],
)
def test_each_side_of_the_command(change: dict[str, float], command: float, rpm: float) -> None:
    assert settled(DRIVE.shaft._replace(**change), command) == pytest.approx(rpm, abs=0.01)


@pytest.mark.parametrize(
    "off",
    [
        {"gain_percent": 5.0},
        {"gain_percent": 5.0, "neutral_rpm": 150.0},
        {"neutral_rpm": -25.0},
        {"gain_percent": -190.0, "neutral_rpm": 800.0},
    ],
)
def test_what_is_known_of_the_curve_is_taken_back_by_metering(off: dict[str, float]) -> None:
    shaft = DRIVE.shaft._replace(dead_zone_rpm=40.0, saturation_percent=20.0, **off)
    machine = DRIVE.model_copy(update={"shaft": shaft})
    assert find_shaft_command(machine, 0.0, 0.0) == 0.0
    for wanted in (0.0, 50.0, 200.0, 450.0):
        assert settled(shaft, find_shaft_command(machine, wanted, 0.0)) == pytest.approx(
            wanted, abs=0.01
        )


@pytest.fixture(scope="module")
def both_ways() -> dict[str, Array]:
    """Five minutes over both sides, a row every 0.02 s; nothing is wrong with the drive."""
    rng, time_s = np.random.default_rng(3), np.arange(0.0, 300.0, 0.02)
    command = np.repeat(rng.uniform(-600.0, 600.0, 200).round(1), 75)
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": command,
        "shaft_rpm": turned(DRIVE, command, time_s) + 2.0 * rng.standard_normal(len(time_s)),
    }


def test_a_healthy_drive_that_turns_both_ways_is_none(both_ways: dict[str, Array]) -> None:
    found = diagnose_run(both_ways, DRIVE)
    assert found.verdict == "none" and found.channels[0].rmse < 2.5
    assert any("commands are below 0: it turned backwards" in one for one in found.findings)


@pytest.mark.exam
def test_of_a_drive_that_turns_one_way_rows_against_it_are_counted_and_left_out(
    both_ways: dict[str, Array],
) -> None:
    one_way = DRIVE.model_copy(update={"shaft": DRIVE.shaft._replace(one_way=1.0)})
    found = diagnose_run(both_ways, one_way)
    back = int(np.sum(both_ways["shaft_rpm_cmd"] < 0.0))
    said = [one for one in found.findings if "shaft.one_way" in one]
    assert len(said) == 1 and f"{back} of 15000 commands" in said[0]
    assert found.channels[0].rmse < 2.5, "what stands against the file is no error of the model"
    told = compared(both_ways, DRIVE, one_way).channels[0]
    assert told.old == pytest.approx(2.0, abs=0.1) and told.new > 100.0 and told.high < 0.0


def test_a_dead_zone_is_also_a_term_over_the_command() -> None:
    """Form saturation with slope -1 between -D and D takes D from every command, either way:
    the same to the shaft."""
    term = Term.model_validate(
        {
            "id": "shaft.zone",
            "acts_on": "shaft_rpm",
            "form": "saturation",
            "over": [{"name": "shaft_rpm"}],
            "coefficients": {"slope": -1.0, "low_end": -40.0, "high_end": 40.0, "level": 40.0},
        }
    )
    for command in (-300.0, -41.0, -20.0, 20.0, 41.0, 300.0):
        _, more_rpm = step_term(make_term_params(term), TermState(), command, 0.0, 0.01)
        state = make_shaft_start(0.0)
        for _ in range(400):
            state, out = step_shaft(
                DRIVE.shaft, state, ShaftInput(command, 0.0, 7.4, 0.0, more_rpm), 0.01
            )
        assert out.rpm == pytest.approx(
            settled(DRIVE.shaft._replace(dead_zone_rpm=40.0), command), abs=0.01
        )


# --- A shaft of second order against its differential equation, in all steppers; it starts and
# stops as a shaft does.

SPRUNG = Shaft(dead_time_s=0.05, time_constant_s=0.1, acceleration_rpm_s=1e6)
RINGS, GRADUAL = SPRUNG._replace(second_order_s=0.4), SPRUNG._replace(second_order_s=0.02)


def answered(shaft: Shaft, goals: list[float], hold_s: float, step_s: float) -> Array:
    state, found = make_shaft_start(0.0), []
    for goal in goals:
        for _ in range(round(hold_s / step_s)):
            state, out = step_shaft(
                shaft, state, ShaftInput(goal, 0.0, shaft.nominal_supply_v), step_s
            )
            found.append(out.rpm)
    return np.array(found)


@pytest.mark.parametrize("shaft", [RINGS, GRADUAL, SPRUNG._replace(second_order_s=0.025)])
def test_a_step_is_that_of_the_equation(shaft: Shaft) -> None:
    second, tau = shaft.second_order_s, shaft.time_constant_s
    time_s = np.arange(1, 101) * 0.01
    exact = solve_ivp(
        lambda t, y: [y[1], (60.0 - y[0] - tau * y[1]) / (tau * second)],
        (0.0, 1.0),
        [0.0, 0.0],
        dense_output=True,
        rtol=1e-10,
        atol=1e-10,
    )
    assert answered(shaft, [60.0], 1.0, 0.01) == pytest.approx(
        exact.sol(np.maximum(0.0, time_s - 0.05))[0], abs=1e-5
    )


@pytest.mark.parametrize(
    ("tau", "second", "fastest"), [(0.1, 0.4, 150.0), (0.3, 0.02, 100.0), (0.1, 0.025, 200.0)]
)
def test_the_acceleration_limit_holds_and_the_way_is_that_of_small_steps(
    tau: float, second: float, fastest: float
) -> None:
    x, v, step_s = 0.0, 0.0, 1e-5
    for _ in range(100_000):
        faster = min(fastest, max(-fastest, v + step_s * (90.0 - x - tau * v) / (tau * second)))
        x, v = x + 0.5 * step_s * (v + faster), faster
    assert step_second_order(0.0, 0.0, 90.0, tau, second, fastest, -1e100, 1.0)[0] == pytest.approx(
        x, abs=0.02
    )
    speeds = [
        step_second_order(0.0, 0.0, 90.0, tau, second, fastest, -1e100, t)[0]
        for t in np.arange(0.0, 2.0, 0.01)
    ]
    assert np.abs(np.diff(speeds)).max() <= 0.01 * fastest * (1.0 + 1e-9)


def test_a_shaft_that_turns_one_way_stops_where_it_would_swing_back() -> None:
    one_way = RINGS._replace(one_way=1.0)
    assert answered(RINGS, [80.0, 0.0], 2.0, 0.01).min() < -10.0
    stopped = answered(one_way, [80.0, 0.0], 2.0, 0.01)
    assert stopped.min() == 0.0
    assert stopped[-150:].max() == 0.0


def test_overshoot_and_period_are_those_of_the_step() -> None:
    rpm, answer = answered(RINGS, [100.0], 3.0, 0.001), calc_step_response(RINGS)
    assert rpm.max() - 100.0 == pytest.approx(answer.overshoot_percent, abs=0.01)
    tops = np.flatnonzero(np.diff(np.sign(np.diff(rpm))) < 0)
    assert 0.001 * (tops[1] - tops[0]) == pytest.approx(answer.period_s, abs=0.002)
    quiet = calc_step_response(GRADUAL)
    assert answered(GRADUAL, [100.0], 3.0, 0.01).max() <= 100.0
    assert (quiet.overshoot_percent, sum(quiet.lags_s)) == (
        0.0,
        pytest.approx(calc_time_constant_s(GRADUAL)),
    )
    assert quiet.lags_s[0] * quiet.lags_s[1] == pytest.approx(0.1 * 0.02)


def test_compiled_ticks_are_the_steps() -> None:
    shaft, gate = RINGS._replace(acceleration_rpm_s=300.0), Gate()
    begun = make_shaft_start(0.0)
    drives, state = (
        CompiledDrives(begun, make_gate_start(20.0)),
        begun._replace(line=convert_to_lists(begun.line)),
    )
    drives.set_stages(shaft, gate)
    for k in range(400):
        goal = 70.0 if k % 100 < 60 else 15.0
        rpm, _ = drives.step_drives(goal, 20.0, 13.5, 0.0125)
        state, out = step_shaft(shaft, state, ShaftInput(goal, 20.0, 13.5), 0.0125)
        assert rpm == out.rpm


def test_a_start_takes_longer() -> None:
    first = [
        calc_response_s(add_effect(Machine(), "shaft.second_order", size), 50.0)
        for size in (1e-6, 0.05, 0.2)
    ]
    assert first[0] == pytest.approx(calc_response_s(Machine(), 50.0), abs=1e-3)
    assert first[0] < first[1] < first[2]
