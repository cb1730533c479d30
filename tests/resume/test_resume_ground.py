"""Ground that is done: how it grows and is kept."""
from __future__ import annotations

import numpy as np
import pytest

from console.worker.resume_ground import NOTHING_DONE, TRACK_PLACES, Done, joined, packed, unpacked
from control.field.coverage import Coverage, Raster
from control.machine.fall import drop_s
from control.machine.machine import Machine

MACHINE = Machine()
WIDTH_M = MACHINE.geometry.working_width_m
STEP_S, SPEED_MPS = 0.05, 2.0
FALL_M = drop_s(MACHINE.fall, 60.0) * SPEED_MPS
NORTH_M = np.arange(0.0, 60.0, 0.1)


def drive(done: Done, north_m: tuple[float, float], east_m: float = 0.0, rpm: float = 60.0, at_s: float = 0.0) -> float:
    """Due north at 2 m/s; returns the time at the end."""
    for north in np.arange(*north_m, SPEED_MPS * STEP_S):
        done.pass_over(at_s, (east_m, float(north)), 0.0, rpm, 300.0)
        at_s += STEP_S
    return at_s


def done_at(ground: Raster, places: list[tuple[float, float]]) -> np.ndarray:
    """As a later run's bitmap knows it."""
    coverage = Coverage(WIDTH_M)
    coverage.seed(ground)
    return coverage.applied_earlier(places)


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
    landed = np.flatnonzero(done_at(ground, [(0.0, north) for north in NORTH_M]))
    fall_m = NORTH_M[landed[0]] - 10.0
    assert fall_m == pytest.approx(FALL_M, abs=0.3), "what is released at 10 m lands after its drop"
    assert NORTH_M[landed[-1]] - 40.0 == pytest.approx(fall_m, abs=0.3)


def test_a_pass_beside_it_is_not_done_but_the_same_way_is(one_pass):
    places = [(0.0, 25.0), (0.45 * WIDTH_M, 25.0), (WIDTH_M, 25.0), (0.0, 45.0)]
    assert done_at(one_pass.raster(), places).tolist() == [True, True, False, False]


def test_kept_and_read_back_it_is_the_same_and_two_parts_are_one(one_pass):
    first = one_pass.raster()
    again = unpacked(packed(first))
    assert again[:3] == first[:3] and (again.done == first.done).all()
    later = Done(MACHINE, again, tuple(one_pass.track))
    drive(later, (100.0, 130.0), east_m=-70.0)
    both = later.raster()
    assert done_at(both, [(0.0, 25.0), (-70.0, 115.0), (-35.0, 60.0)]).tolist() == [True, True, False]
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


def test_parts_too_far_apart_for_one_picture_give_the_newer_one():
    here = Raster(0.0, 0.0, 0.25, np.ones((4, 4), dtype=bool))
    assert joined(here, here._replace(west_m=80_000.0, south_m=80_000.0)).west_m == 80_000.0
