""""""

from __future__ import annotations

import json
import time
from dataclasses import replace

import pytest
from topdress.console.frame import (
    DeviceTest,
    DeviceView,
    Frame,
    JobCounts,
    LagTestView,
    parse_frame,
)
from topdress.console.worker import run_file, wire_format
from topdress.console.worker.limits import MOVING_FRAME_PERIOD_S, STANDING_FRAME_PERIOD_S
from topdress.console.worker.link_server import FrameSchedule
from topdress.control.agronomy.reference_strips import ReferenceStrips
from topdress.control.field.job_totals import Totals
from topdress.control.log_row import LogRow
from topdress.control.orders import Alarm, Answer, Severity
from topdress.control.safety import Allowances, BenchRun
from topdress.drivers.files.process_lock import take_lock


def test_a_frame_comes_back_as_it_was():
    frame = Frame(
        3,
        1.5,
        LogRow(1.5, state="working", ndvi_3=0.61),
        alarms=(
            Alarm("rate_off", Severity.AMBER, 1.0, details=(("percent", 12.0), ("word", "x"))),
        ),
        dropped_heads=(2,),
        place_m=(1.0, 2.0),
        notes=("n",),
        devices=(
            DeviceView(
                "gnss",
                "COM3",
                "nmea",
                True,
                0.1,
                10.0,
                5,
                1,
                "$GPGGA",
                2,
                5000,
                30,
                "late",
                (("bad_checksum", 1),),
                False,
                "run.gnss.1.capture",
                DeviceTest(False, "nmea0183", 9600, 12, 1, "$GPGGA"),
            ),
        ),
        lag_test=LagTestView(
            "running",
            40.0,
            3,
            0.25,
            ((10.0, 0.38, 1.7), (20.0, 0.38, 1.6)),
            1,
            "late",
            "x.lag.1.csv",
        ),
        why_no_flow=("low_speed", "reversing"),
        why_state="standstill",
        allow=Allowances(outside=True),
        no_double=False,
        threshold_m=0.04,
        strips=ReferenceStrips(0.66, None),
        ordered_source="map",
        manual_rate_kg_ha=90.0,
        sources=("canopy", "map"),
        source_rates=(310.0, None),
        totals=Totals(1.0, 300.0, 138.0, 310.0, 600.0, 300.0, 4.0, 96.0, None),
        head_ndvi=(0.5, None, 0.6),
        bench=BenchRun(50.0, 25.0, 3.2, 116.8),
    )
    assert parse_frame(json.loads(wire_format.format_frame(frame))) == frame


def test_an_older_workers_frame_lacks_nothing_that_the_console_needs():
    message = json.loads(wire_format.format_frame(Frame(3, 1.5, LogRow(1.5))))
    older = {name: message[name] for name in ("seq", "at_s", "row")} | {"of_tomorrow": 1}
    assert parse_frame(older) == Frame(3, 1.5, LogRow(1.5))


def test_one_value_that_is_not_finite_does_not_blind_the_console():
    frame = Frame(3, 1.5, LogRow(1.5, shaft_rpm=float("nan"), hopper_kg=float("inf"), ndvi=0.5))
    row = parse_frame(json.loads(wire_format.format_frame(frame))).row
    assert row == LogRow(1.5, shaft_rpm=None, hopper_kg=None, ndvi=0.5)
    with pytest.raises(ValueError):
        wire_format.format_frame(Frame(3, float("nan"), LogRow(1.5)))


def test_every_message_is_one_line():
    for line in (
        wire_format.format_greeting(7),
        wire_format.format_answer(1, Answer(False, "a\nb"), {"stats": {"x": 1}}),
        wire_format.format_frame(Frame(1, 0.0, LogRow(0.0, events="mark a\nb"))),
    ):
        assert line.endswith(b"\n") and line.count(b"\n") == 1


def test_what_a_newer_worker_adds_anywhere_is_passed_over():
    frame = Frame(
        3,
        1.5,
        LogRow(1.5),
        alarms=(Alarm("rate_off", Severity.AMBER, 1.0), Alarm("x", Severity.RED, 2.0)),
        devices=(DeviceView("gnss", "COM3", "nmea", True, 0.1, 10.0, 5, 1),),
        totals=None,
        strips=ReferenceStrips(0.6),
    )
    newer = json.loads(wire_format.format_frame(frame))
    for place in (newer, newer["row"], newer["alarms"][1], newer["devices"][0], newer["strips"]):
        place["of_tomorrow"] = {"a": 1}
    assert parse_frame(newer) == frame


def test_a_frame_that_is_none_is_one_line():
    broken = json.loads(wire_format.format_frame(Frame(3, 1.5, LogRow(1.5)))) | {"area_ha": "much"}
    with pytest.raises(ValueError, match=r"^area_ha: [^\n]*$"):
        parse_frame(broken)


# --- The right to be the worker of a run file: what a start waits for
# ------------------------------------------------


def waited(path, now_s=None):
    """Seconds that a start at such a time of the computer's clock waited."""
    slept: list[float] = []
    with run_file.hold_right(
        path, lambda: time.time() if now_s is None else now_s, slept.append
    ) as right:
        right.confirm_right()
    return slept


def test_the_first_start_waits_for_a_worker_whose_lock_was_removed(tmp_path):
    assert waited(tmp_path / "run" / "worker.json") == [
        pytest.approx(run_file.LOCK_SETTLING_S, abs=0.2)
    ]


def test_a_clean_start_waits_for_nobody(tmp_path):
    """No run file is there, as after every clean end, and the lock's file is an old one."""
    path = tmp_path / "worker.json"
    take_lock(path.with_suffix(".lock")).close()
    assert waited(path, time.time() + run_file.YOUNG_LOCK_AGE_S + 0.1) == []


@pytest.mark.parametrize(
    "later_s", [0.0, 1.5, -3600.0], ids=["at once", "a busy computer", "its clock was put back"]
)
def test_a_lock_that_somebody_just_made_anew_is_not_believed(tmp_path, later_s):
    """By a console that looked: the worker under which the lock was removed has not locked this
    one yet."""
    path = tmp_path / "worker.json"
    take_lock(path.with_suffix(".lock")).close()
    assert waited(path, time.time() + later_s) == [pytest.approx(run_file.LOCK_SETTLING_S, abs=0.2)]


# --- When frames are told: seldom while the machine stands, often while it moves, at once where
# a word changes -------

TICK_S = 0.05
STANDS = Frame(seq=0, at_s=0.0, row=LogRow(0.0, state="off", hopper_kg=300.0), tally=JobCounts())
LISTENS = DeviceView("gnss", "p", "nmea", True, 0.0, 10.0, 1, 0, test=DeviceTest(True))


def told_in_10_s(frame: Frame) -> int:
    telling = FrameSchedule()
    return sum(
        telling.is_frame_due(
            replace(
                frame,
                seq=k,
                at_s=k * TICK_S,
                row=frame.row._replace(time_s=k * TICK_S, hopper_kg=300.0 - 0.01 * (k % 7)),
            )
        )
        for k in range(200)
    )


def test_a_machine_that_stands_is_told_twice_a_second_whatever_its_sensors_noise():
    assert told_in_10_s(STANDS) == round(10.0 / STANDING_FRAME_PERIOD_S)


@pytest.mark.parametrize(
    "row",
    [{"state": "working"}, {"state": "calibrating"}, {"speed_used_mps": 0.2}, {"shaft_rpm": 12.0}],
)
def test_a_machine_that_moves_is_told_ten_times_a_second(row):
    assert told_in_10_s(replace(STANDS, row=STANDS.row._replace(**row))) == round(
        10.0 / MOVING_FRAME_PERIOD_S
    )


def test_a_device_that_is_listened_to_is_told_as_often():
    assert told_in_10_s(replace(STANDS, devices=(LISTENS,))) == round(10.0 / MOVING_FRAME_PERIOD_S)


@pytest.mark.parametrize(
    "changed",
    [
        {"alarms": (Alarm("gnss_silent", Severity.AMBER, 1.0, False),)},
        {"why_no_flow": ("standstill",)},
        {"allow": Allowances(reverse=True)},
        {"look_ahead": False},
        {"consoles": 2},
        {"log_path": "other.csv"},
        {"devices": (LISTENS,)},
        {"dropped_heads": (3,)},
        {"tally": JobCounts(moves=1)},
    ],
)
def test_what_changes_is_told_at_once(changed):
    telling = FrameSchedule()
    assert telling.is_frame_due(STANDS)
    assert not telling.is_frame_due(replace(STANDS, seq=1, at_s=TICK_S))
    assert telling.is_frame_due(replace(STANDS, seq=2, at_s=2.0 * TICK_S, **changed))


def test_an_event_and_a_state_are_told_at_once():
    telling = FrameSchedule()
    telling.is_frame_due(STANDS)
    assert telling.is_frame_due(
        replace(STANDS, seq=1, at_s=TICK_S, row=STANDS.row._replace(events="mark:x"))
    )
    assert telling.is_frame_due(
        replace(STANDS, seq=2, at_s=2.0 * TICK_S, row=STANDS.row._replace(state="ready"))
    )


def test_after_a_console_came_it_is_told_as_while_the_machine_moves_for_two_seconds():
    telling = FrameSchedule()
    telling.is_frame_due(STANDS)
    telling.greet_console()
    told = [
        k for k in range(1, 201) if telling.is_frame_due(replace(STANDS, seq=k, at_s=k * TICK_S))
    ]
    assert told[:20] == list(range(1, 40, 2)) and len(told) == 20 + round(
        8.0 / STANDING_FRAME_PERIOD_S
    )
    assert not telling.moves


def test_time_held_is_no_word_that_changes():
    telling = FrameSchedule()
    telling.is_frame_due(STANDS)
    assert not telling.is_frame_due(
        replace(STANDS, seq=1, at_s=TICK_S, tally=JobCounts(held_s=0.05))
    )


def test_who_comes_waits_for_no_frame_and_a_clock_that_goes_back_silences_nobody():
    telling = FrameSchedule()
    telling.is_frame_due(replace(STANDS, at_s=100.0))
    assert telling.is_frame_due(replace(STANDS, seq=1, at_s=99.0))
    telling.send_next_frame()
    assert telling.is_frame_due(replace(STANDS, seq=2, at_s=99.05))
    telling.greet_console()
    telling.is_frame_due(replace(STANDS, seq=3, at_s=99.1))
    telling.is_frame_due(replace(STANDS, seq=4, at_s=1.0))
    assert not telling.moves
