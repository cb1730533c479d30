"""What cannot be never gets into the loop: numbers that are none, places not on earth, a clock that stands.

By the thousand, at random: `test_random_steps.py`.
"""
from __future__ import annotations

import datetime as dt
from math import inf, isfinite, nan
from typing import Any

import pytest

from console.frame import Frame
from console.worker.parts import FRAME_FIELDS
from console.worker.wire import framed
from control.field.job import Wanted
from control.orders import Do, Order, TargetSource
from control.readings import POSSIBLE, DriveCommand, Measurements, Reading, possible
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.closed_loop import Measuring
from drivers.files.setup import load_setup

WILD = (nan, inf, -inf, 1e308, -1e308)


class Work:
    """The demo machine, 10 s at work in manual mode."""

    def __init__(self) -> None:
        setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
        target = Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=300.0)
        job = with_simulated_field(setup.job.model_copy(update={"target": target}), setup.machine)
        self.plant = simulated_machine(setup.machine, job, 1, 0.05)
        self.loop = control_loop(setup.machine, setup.crop, setup.rule, job)
        self.measuring, self.sensed = Measuring(6), self.plant.step(DriveCommand(0.0, 25.0), False)
        self.loop.order(Order(Do.READY))
        for number in range(200):
            self.tick()
            if number == 20:
                assert self.loop.order(Order(Do.START)).accepted
        assert self.newest.command.shaft_rpm > 0.0

    def tick(self, **changes: Any) -> Measurements:
        m = self.measuring.take(self.sensed)._replace(**changes)
        self.newest = self.loop.tick(m)
        self.sensed = self.plant.step(self.newest.command, self.newest.enabled)
        return m


@pytest.fixture
def work() -> Work:
    return Work()


@pytest.mark.parametrize("name", POSSIBLE)
@pytest.mark.parametrize("value", WILD)
def test_a_reading_that_cannot_be_counts_as_never_received(name: str, value: float) -> None:
    good = Measurements(1.0, **{name: Reading(1.0, 1.0)})
    assert possible(good) is good
    assert getattr(possible(good._replace(**{name: Reading(value, 1.0)})), name) is None
    assert getattr(possible(good._replace(**{name: Reading(1.0, nan)})), name) is None


@pytest.mark.parametrize("value", WILD)
def test_the_console_is_told_of_every_tick(work: Work, value: float) -> None:
    """A head, a scale and a receiver's time that are no numbers: the frame is one still, and so is the row."""
    m = work.measuring.take(work.sensed)
    assert m.gnss is not None
    work.tick(ndvi=(Reading(value, m.time_s),) * 6, hopper_kg=Reading(value, m.time_s),
              gnss=m.gnss._replace(time_s=value))
    told: dict[str, Any] = {name: getattr(work.newest, name) for name in FRAME_FIELDS}
    assert framed(Frame(seq=1, at_s=0.0, totals=work.loop.totals, **told))
    assert all(isfinite(value) for value in work.newest.row if isinstance(value, float))


@pytest.mark.parametrize("value", WILD)
def test_a_gate_that_is_nowhere_at_the_start_spoils_nothing(value: float) -> None:
    """The loop takes from the first tick where the gate stands."""
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    loop = control_loop(setup.machine, setup.crop, setup.rule, setup.job)
    for number in range(5):
        loop.tick(Measurements(0.05 * number, opening_mm=Reading(value, 0.0), supply_v=Reading(value, 0.0)))


@pytest.mark.parametrize("time_s", [nan, inf, -inf, -5.0])
def test_with_a_clock_that_stands_nothing_flows_for_long(work: Work, time_s: float) -> None:
    """Its readings do not grow old then, and the field's edge does not come nearer."""
    m = work.tick()
    for _ in range(30):
        work.newest = work.loop.tick(m._replace(time_s=time_s))
    assert work.newest.command.shaft_rpm == 0.0 and "drive_silent" in work.newest.why_no_flow
    assert isfinite(work.newest.row.time_s)


def test_a_first_tick_of_no_time_is_the_beginning() -> None:
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    for first in (nan, inf, -inf):
        loop = control_loop(setup.machine, setup.crop, setup.rule, setup.job)
        loop.tick(Measurements(first))
        assert loop.tick(Measurements(1.0)).row.time_s == 1.0


@pytest.mark.parametrize("value", [None, nan, 1e308, 400.0])
def test_a_wheel_that_says_what_cannot_be_stands(work: Work, value: float | None) -> None:
    """It was heard once, so it is fitted: no pulse for 0.8 s is standstill, whatever GNSS says."""
    for _ in range(20):
        m = work.measuring.take(work.sensed)
        work.tick(wheel_speed_mps=None if value is None else Reading(value, m.time_s))
    assert work.newest.command.shaft_rpm == 0.0 and "standstill" in work.newest.why_no_flow
