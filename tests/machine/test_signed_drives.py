"""A shaft that turns both ways: gain and zone of each side, a curve, and one that says that it turns one way only."""
from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from control.diagnosis.runs.compared import compared
from control.diagnosis.runs.diagnose import diagnose_run
from control.machine.compiled import shaft_run
from control.machine.machine import Machine
from control.machine.over_log import MOST_STEP_S, input_rows, no_switch
from control.machine.shaft import Shaft, ShaftInput, ShaftOutput, asked_rpm, shaft_start, shaft_step
from control.machine.term_step import TermState, term_step
from control.machine.terms import Term, params_of
from control.metering.inverse import shaft_command
from drivers.files.config import load
from drivers.files.kinds import MACHINE

Array = npt.NDArray[np.float64]
DRIVE = load("drive_alone", MACHINE).model


def settled(shaft: Shaft, command_rpm: float) -> float:
    state = shaft_start(0.0)
    for _ in range(400):
        state, out = shaft_step(shaft, state, ShaftInput(command_rpm, 0.0, shaft.nominal_supply_v), 0.01)
    return out.rpm


def turned(machine: Machine, command: Array, time_s: Array) -> Array:
    inputs = input_rows(ShaftInput, len(time_s), command_rpm=command, supply_v=machine.shaft.nominal_supply_v)
    return np.asarray(shaft_run((machine.shaft,), no_switch(), shaft_start(), ShaftOutput(0.0, 0.0), inputs, time_s,
                                MOST_STEP_S)[:, 0])


@pytest.mark.parametrize(("change", "command", "rpm"), [
    ({}, -300.0, -300.0), ({"one_way": 1.0}, -300.0, 0.0), ({"one_way": 1.0}, 300.0, 300.0),
    ({"dead_zone_rpm": 40.0}, 300.0, 260.0), ({"dead_zone_rpm": 40.0}, -300.0, -260.0),
    ({"dead_zone_rpm": 40.0}, 39.0, 0.0), ({"dead_zone_rpm": 40.0, "back_zone_rpm": -10.0}, -300.0, -270.0),
    ({"back_gain_percent": 10.0}, -300.0, -330.0), ({"back_gain_percent": 10.0}, 300.0, 300.0),
    ({"dead_band_rpm": 40.0}, -39.0, 0.0), ({"dead_band_rpm": 40.0}, -300.0, -300.0),
    ({"saturation_percent": 20.0}, 650.0, 520.0), ({"saturation_percent": 20.0}, -650.0, -520.0),
])
def test_each_side_of_the_command(change: dict[str, float], command: float, rpm: float) -> None:
    assert settled(DRIVE.shaft._replace(**change), command) == pytest.approx(rpm, abs=0.01)


def test_what_is_known_of_the_curve_is_taken_back_by_metering() -> None:
    shaft = DRIVE.shaft._replace(dead_zone_rpm=40.0, saturation_percent=20.0, gain_percent=5.0)
    machine = DRIVE.model_copy(update={"shaft": shaft})
    for wanted in (0.0, 50.0, 200.0, 450.0):
        command = shaft_command(machine, wanted, 0.0)
        assert 1.05 * asked_rpm(shaft, command) == pytest.approx(wanted, abs=1e-9)


@pytest.fixture(scope="module")
def both_ways() -> dict[str, Array]:
    """Five minutes over both sides, a row every 0.02 s; nothing is wrong with the drive."""
    rng, time_s = np.random.default_rng(3), np.arange(0.0, 300.0, 0.02)
    command = np.repeat(rng.uniform(-600.0, 600.0, 200).round(1), 75)
    return {"time_s": time_s, "shaft_rpm_cmd": command,
            "shaft_rpm": turned(DRIVE, command, time_s) + 2.0 * rng.standard_normal(len(time_s))}


def test_a_healthy_drive_that_turns_both_ways_is_none(both_ways: dict[str, Array]) -> None:
    found = diagnose_run(both_ways, DRIVE)
    assert found.verdict == "none" and found.channels[0].rmse < 2.5
    assert any("commands are below 0: it turned backwards" in one for one in found.findings)


def test_of_a_drive_that_turns_one_way_rows_against_it_are_counted_and_left_out(both_ways: dict[str, Array]) -> None:
    one_way = DRIVE.model_copy(update={"shaft": DRIVE.shaft._replace(one_way=1.0)})
    found = diagnose_run(both_ways, one_way)
    back = int(np.sum(both_ways["shaft_rpm_cmd"] < 0.0))
    said = [one for one in found.findings if "shaft.one_way" in one]
    assert len(said) == 1 and f"{back} of 15000 commands" in said[0]
    assert found.channels[0].rmse < 2.5, "what stands against the file is no error of the model"
    told = compared(both_ways, DRIVE, one_way).channels[0]
    assert told.old == pytest.approx(2.0, abs=0.1) and told.new > 100.0 and told.high < 0.0


def test_a_dead_zone_is_also_a_term_over_the_command() -> None:
    """Form saturation with slope -1 between -D and D takes D from every command, either way: the same to the shaft."""
    term = Term.model_validate({"id": "shaft.zone", "acts_on": "shaft_rpm", "form": "saturation",
                                "over": [{"name": "shaft_rpm"}],
                                "coefficients": {"slope": -1.0, "low_end": -40.0, "high_end": 40.0, "level": 40.0}})
    for command in (-300.0, -41.0, -20.0, 20.0, 41.0, 300.0):
        _, more_rpm = term_step(params_of(term), TermState(), command, 0.0, 0.01)
        state = shaft_start(0.0)
        for _ in range(400):
            state, out = shaft_step(DRIVE.shaft, state, ShaftInput(command, 0.0, 7.4, 0.0, more_rpm), 0.01)
        assert out.rpm == pytest.approx(settled(DRIVE.shaft._replace(dead_zone_rpm=40.0), command), abs=0.01)
