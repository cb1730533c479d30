"""A recorded variable is never overlooked: lone cells do not blind its column, and what a drift takes up is still seen
to go with it."""
from __future__ import annotations

import numpy as np
import pytest

from control.diagnosis import diagnose_run
from control.diagnosis.judgement.checks import by_chance_together
from control.machine.machine import Machine
from control.recordings.values import without_lone

NOISE_RPM = 10.0


def _machine(tau_s: float) -> Machine:
    return Machine.model_validate({
        "stages": ["shaft"], "noise": {"shaft_rpm": NOISE_RPM}, "limits": {"shaft_low_rpm": 0, "shaft_high_rpm": 1000},
        "shaft": {"full_rpm": 1000, "acceleration_rpm_s": 1e6, "time_constant_s": tau_s, "dead_time_s": 0},
        "tolerance": {"shaft_percent": 0.5, "dead_time_s": 0.01, "time_constant_s": 0.015}})


def _braked(rng: np.random.Generator, strays: bool) -> dict[str, np.ndarray]:
    """A drive at one command that a hand brakes, by hand in three grips, and a load cell with stray cells."""
    time_s = np.arange(0.0, 66.0, 0.091)
    load_g = np.zeros(len(time_s))
    for begin_s, end_s, grip_g in ((24.0, 38.0, 200.0), (38.0, 53.0, 390.0), (52.5, 53.5, 900.0)):
        load_g += grip_g * np.clip((time_s - begin_s) / 1.5, 0.0, 1.0) * (time_s < end_s)
    load_g += 15.0 * np.sin(time_s * 3.1) * (load_g > 0.0) + 3.0 * rng.standard_normal(len(time_s))
    speed = 860.0 - 0.09 * load_g + 7.0 * rng.standard_normal(len(time_s))
    if strays:
        at = rng.choice(len(time_s) - 2, 12, replace=False)
        load_g[at] = -960.0
        load_g[at[0]] = -383776.0
    return {"time_s": time_s, "shaft_rpm_cmd": np.full(len(time_s), 900.0), "shaft_rpm": speed, "load_g": load_g,
            "motor_c": 40.0 + 0.05 * np.cumsum(rng.standard_normal(len(time_s))) * 0.1}


@pytest.mark.parametrize("tau_s", [0.05, 5.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_load_of_a_hand_on_the_brake_is_said(tau_s: float, seed: int) -> None:
    found = diagnose_run(_braked(np.random.default_rng(seed), True), _machine(tau_s))
    assert found.verdict == "unexplained"
    assert {one.variable for one in found.unexplained} == {"load_g"}
    assert any("load_g" in text and "not used" in text for text in found.findings)


def test_lone_cells_lose_their_weight_and_nothing_else_does() -> None:
    rng = np.random.default_rng(3)
    quiet = np.cumsum(rng.standard_normal(2000)) * 0.02 + 13.0
    spoilt = quiet.copy()
    spoilt[[100, 700, 701, 1500]] = [0.0, 99.0, 98.0, -4000.0]
    findings: list = []
    mended = without_lone("supply_v", spoilt, findings)
    assert np.flatnonzero(np.isnan(mended)).tolist() == [100, 700, 701, 1500]
    assert [one.id for one in findings] == ["lone"] and findings[0].rows == 4
    steps = np.repeat(rng.integers(0, 2, 400), 5).astype(float)         # switches, and stays for five rows
    pulses = (rng.random(2000) < 0.02).astype(float)                    # of one row: all that the column ever says
    for real in (quiet, rng.standard_normal(2000), rng.standard_t(5, 2000), steps, pulses, np.round(quiet, 1)):
        kept = without_lone("x", real, [])
        assert np.isnan(kept).mean() < 0.002


def test_by_chance_as_often_as_it_says() -> None:
    """Of pairs that have nothing to do with each other, also where each remembers: one in a hundred at 0.01."""
    rng = np.random.default_rng(4)
    refused = 0
    for memory in (0.0, 0.5, 0.9):
        for _ in range(400):
            one, other = (np.convolve(rng.standard_normal(700), memory ** np.arange(60))[60:660] for _ in range(2))
            refused += by_chance_together(one, other) < 0.01
    assert 2 <= refused <= 30           # of 1200: 12 +- 3.4, and the pairs left are an estimate
    line = np.linspace(0.0, 1.0, 600)
    assert by_chance_together(line + 0.3 * rng.standard_normal(600), rng.standard_normal(600)) > 0.01
    white = rng.standard_normal(600)
    assert by_chance_together(white, np.exp(white) + rng.standard_normal(600)) < 1e-6


def _commands(rng: np.random.Generator, rows: int, held: int) -> np.ndarray:
    return np.repeat(rng.uniform(100.0, 950.0, rows // held + 1), held)[:rows].round()


@pytest.mark.parametrize("noise_rpm", [10.0, 30.0])
def test_a_converter_that_overshoots_is_no_coarse_encoder(noise_rpm: float) -> None:
    """Of second order, a third beyond each command, read in steps of 8: what it leaves comes after its moves."""
    rng, step_s, fine = np.random.default_rng(5), 0.02, 20
    command = _commands(rng, 3000, 50)
    speed, slope, read = command[0], 0.0, []
    for asked in command:
        read.append(speed)
        for _ in range(fine):
            slope += ((2.0 * np.pi / 0.25) ** 2 * (asked - speed) - 0.66 * 2.0 * np.pi / 0.25 * slope) * step_s / fine
            speed += slope * step_s / fine
    reading = 8.0 * np.round((np.array(read) + 2.0 * rng.standard_normal(3000)) / 8.0)
    machine = _machine(0.05)
    machine = machine.model_copy(update={"noise": machine.noise.model_copy(update={"shaft_rpm": noise_rpm})})
    found = diagnose_run({"time_s": step_s * np.arange(3000), "shaft_rpm_cmd": command, "shaft_rpm": reading}, machine)
    assert found.verdict == "unexplained"
    assert [one.variable for one in found.unexplained] == ["shaft_rpm"]


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_a_noise_that_the_file_does_not_allow_is_said(times: float) -> None:
    rng, rows = np.random.default_rng(6), 2000
    command = _commands(rng, rows, 20)
    before = np.concatenate((command[:1], command[:-1]))
    reading = before + times * NOISE_RPM * rng.standard_normal(rows)
    found = diagnose_run({"time_s": 0.5 * np.arange(rows), "shaft_rpm_cmd": command, "shaft_rpm": reading},
                         _machine(0.01))
    assert found.verdict == "none"
    assert any("times the machine file's noise" in text for text in found.findings) is (times > 1.0)


@pytest.mark.parametrize(("gear", "doubted"), [(25.0, True), (0.04, True), (1.3, False), (0.8, False)])
def test_a_wheel_behind_a_gear_raises_a_doubt_of_units(gear: float, doubted: bool) -> None:
    """Commands of the motor up to 950 r/min and the speed of the wheel: no fault of the drive is sure."""
    rng, rows = np.random.default_rng(7), 1500
    command = _commands(rng, rows, 15)
    before = np.concatenate((command[:1], command[:-1]))
    reading = before / gear * (1.0 + 0.01 * rng.standard_normal(rows))
    machine = _machine(0.01)
    machine = machine.model_copy(update={"noise": machine.noise.model_copy(update={"shaft_rpm": 10.0 / gear})})
    found = diagnose_run({"time_s": 0.5 * np.arange(rows), "shaft_rpm_cmd": command, "shaft_rpm": reading}, machine)
    assert any("are both in r/min" in text for text in found.findings) is doubted
    if doubted:
        assert found.verdict != "named" and all(one.probability < 0.2 for one in found.causes)
    else:
        assert found.verdict == "named" and {one.id for one in found.causes} & {"shaft.gain", "shaft.saturation"}
