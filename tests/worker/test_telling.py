"""When frames are told: seldom while the machine stands, often while it moves, at once where a word changes."""
from __future__ import annotations

from dataclasses import replace

import pytest

from console.frame import DeviceTest, DeviceView, Frame, Tally
from console.worker.limits import MOVES_S, STANDS_S
from console.worker.telling import Telling
from control.log_row import LogRow
from control.orders import Alarm, Severity
from control.safety import Allowances

TICK_S = 0.05
STANDS = Frame(seq=0, at_s=0.0, row=LogRow(0.0, state="off", hopper_kg=300.0), tally=Tally())
LISTENS = DeviceView("gnss", "p", "nmea", True, 0.0, 10.0, 1, 0, test=DeviceTest(True))


def told_in_10_s(frame: Frame) -> int:
    telling = Telling()
    return sum(telling.due(replace(frame, seq=k, at_s=k * TICK_S, row=frame.row._replace(
        time_s=k * TICK_S, hopper_kg=300.0 - 0.01 * (k % 7)))) for k in range(200))


def test_a_machine_that_stands_is_told_twice_a_second_whatever_its_sensors_noise():
    assert told_in_10_s(STANDS) == round(10.0 / STANDS_S)


@pytest.mark.parametrize("row", [{"state": "working"}, {"state": "calibrating"}, {"speed_used_mps": 0.2},
                                 {"shaft_rpm": 12.0}])
def test_a_machine_that_moves_is_told_ten_times_a_second(row):
    assert told_in_10_s(replace(STANDS, row=STANDS.row._replace(**row))) == round(10.0 / MOVES_S)


def test_a_device_that_is_listened_to_is_told_as_often():
    assert told_in_10_s(replace(STANDS, devices=(LISTENS,))) == round(10.0 / MOVES_S)


@pytest.mark.parametrize("changed", [
    {"alarms": (Alarm("gnss_silent", Severity.AMBER, 1.0, False),)}, {"why_no_flow": ("standstill",)},
    {"allow": Allowances(reverse=True)}, {"look_ahead": False}, {"consoles": 2}, {"log_path": "other.csv"},
    {"devices": (LISTENS,)}, {"dropped_heads": (3,)}, {"tally": Tally(moves=1)}])
def test_what_changes_is_told_at_once(changed):
    telling = Telling()
    assert telling.due(STANDS)
    assert not telling.due(replace(STANDS, seq=1, at_s=TICK_S))
    assert telling.due(replace(STANDS, seq=2, at_s=2.0 * TICK_S, **changed))


def test_an_event_and_a_state_are_told_at_once():
    telling = Telling()
    telling.due(STANDS)
    assert telling.due(replace(STANDS, seq=1, at_s=TICK_S, row=STANDS.row._replace(events="mark:x")))
    assert telling.due(replace(STANDS, seq=2, at_s=2.0 * TICK_S, row=STANDS.row._replace(state="ready")))


def test_time_held_is_no_word_that_changes():
    telling = Telling()
    telling.due(STANDS)
    assert not telling.due(replace(STANDS, seq=1, at_s=TICK_S, tally=Tally(held_s=0.05)))


def test_who_comes_waits_for_no_frame_and_a_clock_that_goes_back_silences_nobody():
    telling = Telling()
    telling.due(replace(STANDS, at_s=100.0))
    assert telling.due(replace(STANDS, seq=1, at_s=99.0))
    telling.hurry()
    assert telling.due(replace(STANDS, seq=2, at_s=99.05))
