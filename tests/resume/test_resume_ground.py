"""Ground that is done: how it grows, is kept, and is seen ahead."""
from __future__ import annotations

import numpy as np
import pytest

from console.worker.resume_ground import NOTHING_DONE, TRACK_PLACES, Done, Undone, joined, packed, unpacked
from control.field.boundary import Boundary
from control.field.coverage import Raster
from control.machine.fall import drop_s
from control.machine.machine import Machine

MACHINE = Machine()
WIDTH_M = MACHINE.geometry.working_width_m
STEP_S, SPEED_MPS = 0.05, 2.0
FALL_M = drop_s(MACHINE.fall, 60.0) * SPEED_MPS


def drive(done: Done, north_m: tuple[float, float], east_m: float = 0.0, rpm: float = 60.0, at_s: float = 0.0) -> float:
    """Due north at 2 m/s; returns the time at the end."""
    for north in np.arange(*north_m, SPEED_MPS * STEP_S):
        done.pass_over(at_s, (east_m, float(north)), 0.0, rpm, 300.0)
        at_s += STEP_S
    return at_s


@pytest.fixture
def one_pass():
    """From 0 to 50 m north, 10 to 40 of it with flow."""
    done = Done(MACHINE)
    at_s = drive(done, (0.0, 10.0), rpm=0.0)
    at_s = drive(done, (10.0, 40.0), at_s=at_s)
    drive(done, (40.0, 50.0), rpm=0.0, at_s=at_s)
    return done


def test_only_where_something_landed_is_done_and_it_lands_later(one_pass):
    ground = one_pass.raster()
    area_m2 = ground.done.sum() * ground.cell_m ** 2
    assert area_m2 == pytest.approx(30.0 * WIDTH_M, rel=0.06)
    undone = Undone(ground, None)
    crossed = undone.crossings_m(0.0, 0.0, 0.0, 60.0)
    assert len(crossed) == 2
    fall_m = crossed[0] - 10.0
    assert fall_m == pytest.approx(FALL_M, abs=0.3), "what is released at 10 m lands after its drop"
    assert crossed[1] - 40.0 == pytest.approx(fall_m, abs=0.3)


def test_a_pass_beside_it_is_not_done_but_the_same_way_is(one_pass):
    undone = Undone(one_pass.raster(), None)
    assert not undone.contains(0.0, 25.0) and not undone.contains(0.45 * WIDTH_M, 25.0)
    assert undone.contains(WIDTH_M, 25.0) and undone.contains(0.0, 45.0)
    assert undone.crossings_m(WIDTH_M, 0.0, 0.0, 60.0) == []
    assert len(undone.crossings_m(-20.0, 25.0, 90.0, 40.0)) == 2, "across it, in and out"
    assert undone.crossings_m(float("nan"), 0.0, 0.0, 10.0) == []


def test_the_fields_edge_and_what_is_done_are_one_edge(one_pass):
    field = Boundary(((-30.0, 5.0), (30.0, 5.0), (30.0, 30.0), (-30.0, 30.0)))
    undone = Undone(one_pass.raster(), field)
    crossed = undone.crossings_m(0.0, 0.0, 0.0, 60.0)
    assert crossed[0] == pytest.approx(5.0, abs=0.01) and crossed[1] == pytest.approx(10.0 + FALL_M, abs=0.3)
    assert len(crossed) == 2, "the field ends inside what is done: nothing opens again"
    assert undone.contains(0.0, 7.0) and not undone.contains(0.0, 20.0) and not undone.contains(0.0, 2.0)
    assert Undone(NOTHING_DONE, field).crossings_m(0.0, 0.0, 0.0, 60.0) == field.crossings_m(0.0, 0.0, 0.0, 60.0)


def test_every_crossing_agrees_with_contains(one_pass):
    field = Boundary(((-30.0, 5.0), (30.0, 5.0), (30.0, 44.0), (-30.0, 44.0)))
    undone = Undone(one_pass.raster(), field)
    rng = np.random.default_rng(5)
    for _ in range(60):
        east, north, heading = rng.uniform(-15, 15), rng.uniform(-5, 50), rng.uniform(0, 360)
        crossed = undone.crossings_m(east, north, heading, 30.0)
        for ahead in rng.uniform(0.0, 30.0, 20):
            if min((abs(ahead - c) for c in crossed), default=1.0) < 0.3:
                continue
            angle = np.radians(heading)
            inside = undone.contains(east + ahead * np.sin(angle), north + ahead * np.cos(angle))
            changed = sum(c <= ahead for c in crossed) % 2 == 1
            assert inside == (undone.contains(east, north) != changed), (east, north, heading, ahead)


def test_kept_and_read_back_it_is_the_same_and_two_parts_are_one(one_pass):
    first = one_pass.raster()
    again = unpacked(packed(first))
    assert again[:3] == first[:3] and (again.done == first.done).all()
    later = Done(MACHINE, again, tuple(one_pass.track))
    drive(later, (100.0, 130.0), east_m=-70.0)
    both = later.raster()
    undone = Undone(both, None)
    assert not undone.contains(0.0, 25.0) and not undone.contains(-70.0, 115.0) and undone.contains(-35.0, 60.0)
    assert both.done.sum() > 1.8 * first.done.sum()
    assert len(later.track) > len(one_pass.track)


@pytest.mark.parametrize("change", [{"bits": "AAAA"}, {"rows": 0}, {"cell_m": -1.0}, {"columns": 7}])
def test_ground_that_was_not_kept_whole_is_refused(one_pass, change):
    with pytest.raises((ValueError, KeyError)):
        unpacked(packed(one_pass.raster()) | change)


def test_a_long_day_is_thinned_not_forgotten():
    done = Done(MACHINE)
    for k in range(int(TRACK_PLACES * 1.5)):
        done.pass_over(0.5 * k, (0.0, 1.0 * k), 0.0, 60.0, 300.0)
    norths = [spot[1] for spot in done.track]
    assert len(norths) <= TRACK_PLACES and norths[0] < 5.0 and norths[-1] > TRACK_PLACES * 1.5 - 10.0


def test_an_empty_raster_joins_with_anything():
    some = Raster(0.0, 0.0, 0.25, np.ones((4, 4), dtype=np.bool_))
    assert joined(NOTHING_DONE, some) is some and joined(some, NOTHING_DONE) is some
