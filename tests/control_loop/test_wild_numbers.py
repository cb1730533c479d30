"""What cannot be never gets into the loop: numbers that are none, places not on earth, a clock
that stands.

By the thousand, at random: `test_random_steps.py`.
"""

from __future__ import annotations

from math import inf, isfinite, nan
from typing import Any

import pytest
from topdress.console.frame import Frame
from topdress.console.worker.run_interfaces import FRAME_FIELDS
from topdress.console.worker.wire_format import format_frame
from topdress.control.field.job import Wanted
from topdress.control.orders import Do, TargetSource
from topdress.control.readings import POSSIBLE_RANGES, Measurements, Reading, drop_impossible

from tests.control_loop.closed import Closed

WILD = (nan, inf, -inf, 1e308, -1e308)


@pytest.fixture
def work() -> Closed:
    """The demo machine, 10 s at work in manual mode."""
    work = Closed(target=Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=300.0))
    assert work.order(Do.READY).accepted
    work.run(1.05)
    assert work.order(Do.START).accepted
    assert work.run(8.95).command.shaft_rpm > 0.0
    return work


@pytest.mark.parametrize("name", POSSIBLE_RANGES)
@pytest.mark.parametrize("value", WILD)
def test_a_reading_that_cannot_be_counts_as_never_received(name: str, value: float) -> None:
    good = Measurements(1.0, **{name: Reading(1.0, 1.0)})
    assert drop_impossible(good) is good
    assert getattr(drop_impossible(good._replace(**{name: Reading(value, 1.0)})), name) is None
    assert getattr(drop_impossible(good._replace(**{name: Reading(1.0, nan)})), name) is None


@pytest.mark.parametrize("value", WILD)
def test_the_console_is_told_of_every_tick(work: Closed, value: float) -> None:
    """A head, a scale and a receiver's time that are no numbers: the frame is one still, and so
    is the row."""

    def wild(m: Measurements) -> Measurements:
        assert m.gnss is not None
        said = Reading(value, m.time_s)
        return m._replace(ndvi=(said,) * 6, hopper_kg=said, gnss=m.gnss._replace(time_s=value))

    newest = work.tick(wild)
    told: dict[str, Any] = {name: getattr(newest, name) for name in FRAME_FIELDS}
    assert format_frame(Frame(seq=1, at_s=0.0, totals=work.loop.totals, **told))
    assert all(isfinite(value) for value in newest.row if isinstance(value, float))


@pytest.mark.parametrize("value", WILD)
def test_a_gate_that_is_nowhere_at_the_start_spoils_nothing(value: float) -> None:
    """The loop takes from the first tick where the gate stands."""
    loop = Closed().loop
    for number in range(5):
        loop.run_tick(
            Measurements(
                0.05 * number, opening_mm=Reading(value, 0.0), supply_v=Reading(value, 0.0)
            )
        )


@pytest.mark.parametrize("time_s", [nan, inf, -inf, -5.0])
def test_with_a_clock_that_stands_nothing_flows_for_long(work: Closed, time_s: float) -> None:
    """Its readings do not grow old then, and the field's edge does not come nearer."""
    m = work.measured()
    work.loop.run_tick(m)
    for _ in range(30):
        newest = work.loop.run_tick(m._replace(time_s=time_s))
    assert newest.command.shaft_rpm == 0.0 and "drive_silent" in newest.why_no_flow
    assert isfinite(newest.row.time_s)


def test_a_first_tick_of_no_time_is_the_beginning() -> None:
    for first in (nan, inf, -inf):
        loop = Closed().loop
        loop.run_tick(Measurements(first))
        assert loop.run_tick(Measurements(1.0)).row.time_s == 1.0


@pytest.mark.parametrize("value", [None, nan, 1e308, 400.0])
def test_a_wheel_that_says_what_cannot_be_stands(work: Closed, value: float | None) -> None:
    """It was heard once, so it is fitted: no pulse for 0.8 s is standstill, whatever GNSS says."""
    newest = work.run(
        1.0,
        lambda m: m._replace(wheel_speed_mps=None if value is None else Reading(value, m.time_s)),
    )
    assert newest.command.shaft_rpm == 0.0 and "standstill" in newest.why_no_flow
