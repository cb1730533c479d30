"""From a planned pair to what goes on the wire: trims, the drives' resolution, moves too small
to be sent."""

from __future__ import annotations

import pytest
from topdress.control.machine.machine import Machine
from topdress.control.metering.inverse_model import Conditions
from topdress.control.metering.pair_planner import COMMAND_BAND_MM, COMMAND_BAND_RPM, PairPlanner
from topdress.control.metering.strategies import DrivePair
from topdress.control.metering.trims import DriveTrim, TrimLimits
from topdress.control.orders import Strategy
from topdress.control.readings import DriveCommand
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

C = Conditions()
RPM, OPENING_MM = 50.0, 20.0


@pytest.fixture
def machine() -> Machine:
    """A drive that takes any set-point, so that a move is seen as it is."""
    given = load_config("huanghai", MACHINE_KIND).model
    return given.model_copy(
        update={
            "limits": given.limits.model_copy(
                update={"shaft_resolution_rpm": 1e-6, "opening_resolution_mm": 1e-6}
            )
        }
    )


def sent(
    machine: Machine,
    shaft_rpm: float,
    opening_mm: float,
    last: DriveCommand | None,
    share: float = 0.0,
    gate_mm: float = 0.0,
) -> DriveCommand:
    setting, trim = PairPlanner(machine, Strategy.OPENING_FIRST), DriveTrim(TrimLimits(), still=1.0)
    trim.shaft_share, trim.gate_mm = share, gate_mm
    return setting.make_command(DrivePair(shaft_rpm, opening_mm, ""), C, trim, last)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("bands", "moves"), [(0.9, False), (1.1, True), (1.9, True)])
def test_a_move_is_sent_from_its_band_on_and_left_out_below(
    machine: Machine, way: float, bands: float, moves: bool
) -> None:
    at = sent(machine, RPM, OPENING_MM, None)
    last = DriveCommand(at.shaft_rpm - way * bands * COMMAND_BAND_RPM, at.opening_mm)
    assert (
        sent(machine, RPM, OPENING_MM, last).shaft_rpm == pytest.approx(at.shaft_rpm, abs=1e-5)
    ) is moves
    last = DriveCommand(at.shaft_rpm, at.opening_mm - way * bands * COMMAND_BAND_MM)
    assert (
        sent(machine, RPM, OPENING_MM, last).opening_mm == pytest.approx(at.opening_mm, abs=1e-5)
    ) is moves


def test_trims_go_the_way_they_say(machine: Machine) -> None:
    """A share more of the shaft, millimetres more of the gate."""
    bare, trimmed = (
        sent(machine, RPM, OPENING_MM, None),
        sent(machine, RPM, OPENING_MM, None, 0.04, 0.7),
    )
    assert trimmed.shaft_rpm == pytest.approx(1.04 * bare.shaft_rpm, abs=1e-5)
    assert trimmed.opening_mm == pytest.approx(bare.opening_mm + 0.7, abs=1e-5)


def test_after_a_stop_no_move_is_too_small(machine: Machine) -> None:
    at = sent(machine, RPM, OPENING_MM, None)
    stopped = DriveCommand(0.0, at.opening_mm - 0.5 * COMMAND_BAND_MM)
    assert sent(machine, RPM, OPENING_MM, stopped).opening_mm == pytest.approx(
        at.opening_mm, abs=1e-5
    )
    assert sent(machine, 0.0, OPENING_MM, at) == DriveCommand(0.0, at.opening_mm), (
        "the gate stays where it is"
    )
