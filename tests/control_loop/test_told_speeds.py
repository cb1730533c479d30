"""Speeds told by the tractor are in the log, so that a rerun has them; the job's planned speed
may differ by pass."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from topdress.console.services.replay_rerun import rerun_loop
from topdress.control.field.job import Ground, Job
from topdress.control.field.planned_speed import find_pass_number, find_planned_mps
from topdress.control.readings import AnnouncedSpeeds, describe_announcement, parse_announcement
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.replay import iter_measurements
from topdress.drivers.files.run_log import write_whole_log
from topdress.drivers.files.run_meta import make_run_meta
from topdress.drivers.files.run_setup import Setup

from tests.control_loop.closed import SETUP, Closed

FIELD = Ground(boundary_m=((0, 0), (24, 0), (24, 100), (0, 100)))


@pytest.mark.parametrize(
    "announced",
    [
        AnnouncedSpeeds(10.0, ((0.0, 1.25),), 0.5),
        AnnouncedSpeeds(9.93, ((0.0, 1.25), (0.7, 1.1), (2.2, 0.30000000000000004)), 1.0 / 3.0),
    ],
)
def test_a_told_speed_comes_back_to_the_last_digit(announced):
    found = parse_announcement(describe_announcement(announced, 10.0), 10.0)
    assert (
        found.points == announced.points and found.acceleration_mps2 == announced.acceleration_mps2
    )
    assert found.time_s == pytest.approx(announced.time_s, abs=1e-12)


def test_points_that_say_nothing_new_are_left_out():
    announced = AnnouncedSpeeds(0.0, ((0.0, 1.0), (0.1, 1.0), (0.2, 1.5), (0.3, 1.5)), 0.5)
    assert describe_announcement(announced, 0.0) == "0.0 0.5 0.0 1.0 0.2 1.5"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "x",
        "0.0 0.5",
        "0.0 0.5 1.0",
        "0.0 0.5 0.1 1.0",
        "0.0 -1.0 0.0 1.0",
        "0.0 0.5 0.0 1e9",
        "nan 0.5 0.0 1.0",
    ],
)
def test_what_is_no_told_speed(text):
    assert parse_announcement(text, 10.0) is None


@pytest.mark.exam
def test_a_rerun_of_the_log_meters_as_the_run_did(tmp_path):
    """A tractor that tells its plan, and brakes: without the column the rerun forecasts
    otherwise."""
    changes = [{"at_s": 25.0, "speed_kmh": 3.0}, {"at_s": 32.0, "speed_kmh": 5.5}]
    closed = Closed(sim={"begin_m": 30.0, "speed_told": "plan", "speed_changes": changes})
    rows = [step.tick.row for step in closed.through(45.0)]
    log = read_log(
        write_whole_log(
            tmp_path / "run.csv", make_run_meta(SETUP.machine, SETUP.crop, closed.job), rows
        )
    )
    announced = [m.speed_told for m in iter_measurements(log)]
    assert (
        all(one is not None for one in announced[1:])
        and len({one.points for one in announced[1:]}) > 50
    )
    replace = Setup(SETUP.machine, SETUP.crop, SETUP.rule, closed.job, {}, tmp_path, None)
    with_it = off(rows, log, replace)
    assert with_it < 0.1
    log.columns["speed_told"] = np.full(len(log), "", object)
    assert off(rows, log, replace) > 5.0 * max(with_it, 0.02)


def off(rows, log, setup) -> float:
    """Mean |opening as ordered again - as it was ordered|, mm, from 20 s on."""
    again = [tick.row for tick in rerun_loop(log, setup)]
    return float(
        np.mean(
            [
                abs(a.opening_mm_cmd - b.opening_mm_cmd)
                for a, b in zip(again, rows, strict=True)
                if b.time_s > 20.0
            ]
        )
    )


def test_a_log_without_the_column_is_read_as_before(tmp_path):
    (tmp_path / "old.csv").write_text("time_s,speed_mps\n0.0,1.25\n0.5,1.27\n")
    assert [m.speed_told for m in iter_measurements(read_log(tmp_path / "old.csv"))] == [None, None]


def test_passes_are_counted_from_the_origin_to_the_right():
    job = Job(field=FIELD)
    assert [find_pass_number(job, 2.4, east, 50.0, 1.0) for east in (0.1, 1.2, 2.3, 2.5, 23.9)] == [
        1,
        1,
        1,
        2,
        10,
    ]
    assert (
        find_pass_number(job, 2.4, 3.6, 50.0, 181.0) == 2
        and find_pass_number(job, 2.4, 3.6, 50.0, 90.0) is None
    )
    assert find_pass_number(job, 2.4, -0.1, 50.0, 0.0) is None
    east = Job(field=FIELD.model_copy(update={"pass_heading_deg": 90.0}))
    assert find_pass_number(east, 2.4, 50.0, -3.6, 88.0) == 2, "heading east, the right is south"


def test_the_planned_speed_of_the_pass():
    by_pass = Job(field=FIELD, planned_speed_kmh=(3.6, 7.2))
    found = [
        find_planned_mps(by_pass, 2.4, place, heading)
        for place, heading in (
            ((1.2, 5.0), 0.0),
            ((3.6, 5.0), 180.0),
            ((20.0, 5.0), 0.0),
            ((1.2, 5.0), 90.0),
            (None, 0.0),
            ((1.2, 5.0), None),
        )
    ]
    assert found == [1.0, 2.0, 2.0, None, None, None], "the last one holds for all beyond"
    assert find_planned_mps(Job(planned_speed_kmh=3.6), 2.4, None, None) == 1.0
    assert find_planned_mps(Job(), 2.4, None, 0.0) is None
    assert find_planned_mps(Job(planned_speed_kmh=(3.6,)), 2.4, (1.2, 5.0), 0.0) is None, (
        "no field, no pass"
    )
    for wrong in ((), (0.0,), (3.0, 31.0)):
        with pytest.raises(ValidationError):
            Job(planned_speed_kmh=wrong)


def test_the_loop_is_told_the_speed_of_its_pass():
    closed, asked = Closed(sim={"begin_m": 30.0}, planned_speed_kmh=(4.5, 6.0)), []
    inner = closed.loop._forecaster.forecast_speed
    closed.loop._forecaster.forecast_speed = lambda *a: (asked.append(a[-1]), inner(*a))[1]
    closed.through(10.0)
    assert asked[-1].points == ((0.0, 4.5 / 3.6),)
