"""The bitmap under the outlets: nothing counted twice, nothing left out."""
from __future__ import annotations

import datetime as dt
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from control.field.across import across, across_words
from control.field.coverage import Coverage
from control.geodesy import offset
from drivers.files.setup import load_setup


def straight(coverage, start, heading, metres, step_m=0.0625, flowing=True):
    coverage.lay(start, heading, False)
    for k in range(1, round(metres / step_m) + 1):
        coverage.lay(offset(start, heading, k * step_m), heading, flowing)


@settings(max_examples=30, deadline=None)
@given(st.floats(0, 360), st.floats(-300, 300), st.floats(-300, 300), st.sampled_from([0.02, 0.0625, 0.5]))
@example(0.0, 1.5, 1.5, 0.0625)
def test_a_pass_is_length_times_width_in_any_direction(heading, east, north, step_m):
    coverage = Coverage(2.4)
    straight(coverage, (east, north), heading, 40.0, step_m)
    exact_m2 = 40.0 * 2.4
    # A row of cells and a column too many where all edges run through middles of cells.
    assert coverage.covered.area_ha * 1e4 == pytest.approx(exact_m2, abs=0.2 * (40.0 + 2.4 + 0.2) + 1e-6)
    assert coverage.covered.overlap_ha == 0.0
    assert coverage.covered.travelled_m == pytest.approx(40.0)


def test_right_in_the_mean_over_headings():
    areas = []
    for heading in range(0, 360, 15):
        coverage = Coverage(2.4)
        straight(coverage, (0.07 * heading, 0.0), float(heading) + 3.3, 40.0, 0.2)
        areas.append(coverage.covered.area_ha * 1e4)
    assert np.mean(areas) == pytest.approx(96.0, rel=0.003)


def test_neighbouring_passes_neither_overlap_nor_gape():
    coverage = Coverage(2.4)
    for k in range(4):
        straight(coverage, (1.2 + 2.4 * k, 0.0), 0.0, 30.0)
    assert coverage.covered.area_ha * 1e4 == pytest.approx(4 * 2.4 * 30.0, rel=1e-6)
    assert coverage.covered.overlap_ha == pytest.approx(0.0, abs=1e-9)


def test_the_same_pass_again_is_overlap_and_no_area():
    coverage = Coverage(2.4)
    straight(coverage, (1.2, 0.0), 0.0, 30.0)
    straight(coverage, (1.2, 30.0), 180.0, 30.0)
    assert coverage.covered.area_ha * 1e4 == pytest.approx(72.0, rel=1e-6)
    # ground within revisit_m of the turning point was passed over less than that ago
    assert coverage.covered.overlap_ha * 1e4 == pytest.approx(72.0 - 2.4 * 0.5 * coverage.revisit_m, rel=0.03)
    half = Coverage(2.4)
    straight(half, (1.2, 0.0), 0.0, 60.0)
    straight(half, (2.4, 60.0), 180.0, 60.0)
    assert half.covered.area_ha * 1e4 == pytest.approx(3.6 * 60.0, rel=1e-3)


def test_a_tight_turn_is_not_its_own_overlap():
    coverage = Coverage(2.4)
    coverage.lay((5.0, 0.0), 0.0, False)
    for degree in range(1, 181):
        angle = math.radians(degree)
        coverage.lay((5.0 * math.cos(angle), 5.0 * math.sin(angle)), -float(degree), True)
    assert coverage.covered.overlap_ha == 0.0
    assert coverage.covered.area_ha * 1e4 == pytest.approx(math.pi / 2 * (6.2 ** 2 - 3.8 ** 2), rel=0.01)


def test_only_what_flowed_counts_to_the_last_tick():
    coverage = Coverage(2.4)
    straight(coverage, (1.2, 0.0), 0.0, 20.0, flowing=False)
    assert coverage.covered.area_ha == 0.0
    coverage.lay((1.2, 20.0), 0.0, False)
    for k in range(1, 20):
        coverage.lay((1.2, 20.0 + 0.06 * k), 0.0, True)       # the last tick is less than half a cell after the 18th
    coverage.lay((1.2, 21.2), 0.0, False)
    assert coverage.covered.area_ha * 1e4 == pytest.approx(6 * 0.2 * 2.4)


def test_already_applied_is_about_earlier_passes():
    coverage = Coverage(2.4)
    straight(coverage, (1.2, 0.0), 0.0, 40.0)
    assert coverage.applied([(1.2, 10.0)])[0]
    assert not coverage.applied([(1.2, 39.0)])[0]          # just passed over: this pass's own ground
    assert not coverage.applied([(1.2, 41.0)])[0]
    assert not coverage.applied([(3.6, 10.0)])[0]
    assert not coverage.applied([(-500.0, 900.0)])[0]
    assert not coverage.applied([(math.nan, 0.0)])[0]
    straight(coverage, (3.6, 40.0), 180.0, 20.0)
    assert coverage.applied([(1.2, 39.0)])[0]


def test_a_lost_position_breaks_the_stretch():
    coverage = Coverage(2.4)
    straight(coverage, (1.2, 0.0), 0.0, 10.0)
    coverage.lay((math.nan, 10.5), 0.0, True)
    coverage.lay((1.2, 30.0), 0.0, True)
    assert coverage.covered.area_ha * 1e4 == pytest.approx(24.0, rel=1e-6)
    coverage.lay((1.2, 31.0), 0.0, True)
    assert coverage.covered.area_ha * 1e4 == pytest.approx(26.4, rel=1e-6)


def test_the_picture_shows_what_is_done_across_tiles():
    coverage = Coverage(2.4)
    assert not coverage.raster().done.any()
    straight(coverage, (-30.0, -60.0), 20.0, 150.0)
    west, south, cell, done = coverage.raster()
    assert done.sum() * cell * cell == pytest.approx(coverage.covered.area_ha * 1e4)
    for far in (1.0, 75.0, 149.0):
        east, north = offset((-30.0, -60.0), 20.0, far)
        assert done[int((north - south) / cell), int((east - west) / cell)]
    assert not done[int((0 - south) / cell), int((-40 - west) / cell)]


def test_standing_still_does_nothing():
    coverage = Coverage(2.4)
    for heading in range(0, 720, 7):
        coverage.lay((3.0, 4.0), float(heading), True)
    assert coverage.covered == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("width", "cell"), [(2.4, 0.0), (2.4, 1.3), (0.0, 0.2), (2.4, math.nan)])
def test_cells_that_do_not_fit_are_refused(width, cell):
    with pytest.raises(ValueError, match="allowed is a cell"):
        Coverage(width, cell)


@pytest.mark.parametrize("cell_m", [0.2, 0.25, 0.4])
def test_what_an_earlier_run_has_done_is_done_and_done_again_is_overlap(cell_m):
    earlier = Coverage(2.4, cell_m)
    straight(earlier, (-31.3, 7.1), 20.0, 60.0)
    coverage = Coverage(2.4)
    coverage.seed(earlier.raster())
    assert coverage.covered.area_ha == pytest.approx(earlier.covered.area_ha, rel=0.02)
    assert coverage.covered.overlap_ha == 0.0
    along = [offset((-31.3, 7.1), 20.0, ahead, aside) for ahead in (1.0, 35.0, 59.0) for aside in (-0.9, 0.0, 0.9)]
    beside = [offset((-31.3, 7.1), 20.0, ahead, aside) for ahead, aside in ((-1.0, 0.0), (30.0, 1.8), (61.0, 0.0))]
    assert coverage.applied(along).all() and coverage.applied_earlier(along).all()
    assert not coverage.applied(beside).any() and not coverage.applied_earlier(beside).any()
    assert coverage.raster().done.sum() * 0.04 == pytest.approx(144.0, rel=0.03)
    straight(coverage, offset((-31.3, 7.1), 20.0, 20.0), 20.0, 10.0)
    assert coverage.covered.overlap_ha * 1e4 == pytest.approx(24.0, rel=0.06)
    assert coverage.applied_earlier(along).tolist() == [True] * 9
    assert not coverage.applied_earlier([offset((-31.3, 7.1), 20.0, 25.0)])[0], "now this run has done it"


@pytest.mark.parametrize("far_m", [40.0, 1e3, 5e4, 5e6, 1e300, math.inf])
def test_a_jump_is_not_swept_and_costs_next_to_nothing(far_m):
    coverage = Coverage(2.4)
    straight(coverage, (0.0, 0.0), 0.0, 20.0)
    done = coverage.covered
    for _ in range(3):
        coverage.lay((far_m, far_m), 0.0, True)
        coverage.lay((0.0, 20.0), 0.0, True)
    assert coverage.covered == done, "nothing between, and no way made"
    tracemalloc.start()
    straight(coverage, (far_m, 0.0), 90.0, 20.0)
    coverage.applied([(0.0, 10.0), (far_m, 10.0), (-far_m, far_m)])
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()
    assert not coverage.applied([(0.5 * far_m, 0.5 * far_m)])[0]


def test_ground_far_apart_makes_a_picture_of_bounded_size():
    coverage = Coverage(2.4)
    straight(coverage, (0.0, 0.0), 0.0, 20.0)
    straight(coverage, (60_000.0, 60_000.0), 0.0, 20.0)
    west, south, _, done = coverage.raster()
    assert done.size < 1e6 and 59_000.0 < west and 59_000.0 < south
    assert done.sum() * 0.04 == pytest.approx(48.0, rel=0.1)


# --- What one rate across the width costs: none on an even crop, the known spread on a known one ---------------------

@pytest.fixture(scope="module")
def setup():
    return load_setup("huanghai_sections", "demo", dt.date(2014, 3, 7))


def test_an_even_crop_costs_nothing(setup):
    found = across(setup.rule, setup.machine, np.full((10, 6), 0.5))
    assert found is not None and found.by_head_kg_ha == 0.0 and found.by_section_kg_ha == 0.0


def test_the_spread_is_that_of_the_need_and_a_section_evens_out_its_own_heads(setup):
    heads = np.tile([0.48, 0.52] * 3, (20, 1))
    found = across(setup.rule, setup.machine, heads)
    smooth = setup.rule.crop.model_copy(update={"grades": False})
    rule = type(setup.rule)(smooth, setup.rule.days, setup.rule.ndvi_nrich)
    low, mid, high = (rule.decide(value).rate_kg_ha for value in (0.48, 0.5, 0.52))
    wanted = np.sqrt(0.5 * ((low - mid) ** 2 + (high - mid) ** 2))
    assert found is not None and found.by_head_kg_ha == pytest.approx(wanted, rel=1e-3)
    assert found.by_section_kg_ha == pytest.approx(abs(0.5 * (low + high) - mid), abs=0.01)
    assert found.noise_kg_ha == pytest.approx(0.01 * (low - high) / 0.04, rel=0.02)
    assert "r.m.s. between the need under each head and the one rate, by section" in across_words(found)


def test_a_silent_head_is_left_out_and_one_alone_says_nothing(setup):
    some = np.array([[0.48, np.nan, 0.52, 0.5, 0.5, 0.5], [0.5] + [np.nan] * 5])
    found = across(setup.rule, setup.machine, some)
    assert found is not None and found.samples == 1
    assert across(setup.rule, setup.machine, np.full((3, 6), np.nan)) is None
