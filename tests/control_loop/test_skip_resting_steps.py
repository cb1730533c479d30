"""Drives that rest are not stepped again within a tick: what comes of it is the same to the
last bit."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable

import pytest
from topdress.control.loop.unintended_flow import UnintendedFlow, make_standing_limits
from topdress.control.machine.fault_injection import parse_planted
from topdress.control.readings import DriveCommand, Measurements, Reading
from topdress.control.safety import SafetyLimits
from topdress.control.simulation import plant as plants
from topdress.control.simulation.plant import Plant, PlantTruth
from topdress.drivers.files.run_setup import load_setup

STANDS, WORKS, FASTER = DriveCommand(0.0, 25.0), DriveCommand(40.0, 25.0), DriveCommand(55.0, 31.0)
TODAY = dt.date(2026, 4, 1)
COURSE = [STANDS] * 100 + [WORKS] * 200 + [FASTER] * 200 + [WORKS] * 200 + [STANDS] * 100


def truths(name: str, effects: tuple[str, ...]) -> list[PlantTruth]:
    setup = load_setup(
        name,
        {"planter": "points_demo", "huanghai_sections": "sections_demo"}.get(name, "demo"),
        TODAY,
    )
    kept: list[PlantTruth] = []
    plant = Plant(
        setup.machine,
        setup.job,
        3,
        planted=[parse_planted(one) for one in effects],
        keep=lambda truth: kept.append(truth._replace(canopy=None)),
    )
    for command in COURSE:
        valves = (True,) * len(setup.machine.switched_strips)
        plant.advance_plant(command._replace(valves=valves), True)
    return kept


@pytest.mark.parametrize(
    ("machine", "effects"),
    [
        ("huanghai", ()),
        ("huanghai", ("gate.backlash=1@4", "flow.pulsation=5")),
        ("huanghai", ("shaft.load_droop=20",)),
        ("huanghai", ("shaft.stall=1@8", "gate.stuck=1@9")),
        ("huanghai_sections", ()),
        ("spreader", ("flow.gain=5",)),
    ],
)
def test_the_same_to_the_last_bit(
    machine: str, effects: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[int] = []
    stepped: Callable[..., tuple[object, object]] = plants.step_gate

    def counted(*given: object) -> tuple[object, object]:
        steps.append(1)
        return stepped(*given)

    monkeypatch.setattr(plants, "step_gate", counted)
    rested, few = truths(machine, effects), len(steps)
    monkeypatch.setattr(plants, "is_drive_resting", lambda *_: False)
    assert truths(machine, effects) == rested
    assert few < 0.95 * (len(steps) - few), "a tick in which nothing moves takes one step of four"


@pytest.mark.parametrize(("age_s", "turning_rpm"), [(0.0, 40.0), (0.5, 40.0), (0.6, 0.0)])
def test_an_old_reading_of_the_shaft_does_not_say_that_it_turns(age_s, turning_rpm):
    stopped = UnintendedFlow(load_setup("huanghai", "demo", TODAY).machine, SafetyLimits())
    read = Measurements(100.0, shaft_rpm=Reading(40.0, 100.0 - age_s))
    assert stopped.find_turning_rpm(read) == turning_rpm


def test_a_valve_may_close_as_late_as_its_file_and_its_line_say():
    machine = load_setup("huanghai_sections", "sections_demo", TODAY).machine
    closes_s = max(section.valve.close_s for section in machine.sections if section.valve)
    # The status of the board comes ten times a second, and a switch bounces.
    assert make_standing_limits(machine, SafetyLimits()).valve_closes_s >= closes_s + 0.5
