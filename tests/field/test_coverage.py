"""The bitmap under the outlets: nothing counted twice, nothing left out."""

from __future__ import annotations

import datetime as dt
import math
import timeit
import tracemalloc

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from shapely.geometry import Point
from topdress.control.field.boundary import Boundary
from topdress.control.field.coverage import Coverage
from topdress.control.field.job_totals import Totaliser
from topdress.control.field.width_error import describe_width_error, measure_width_error
from topdress.control.geodesy import find_unit_vector, offset_place
from topdress.drivers.files.run_setup import load_setup


def straight(coverage, start, heading, metres, step_m=0.0625, flowing=True):
    coverage.extend_to(start, heading, False)
    for k in range(1, round(metres / step_m) + 1):
        coverage.extend_to(offset_place(start, heading, k * step_m), heading, flowing)


@settings(max_examples=30, deadline=None)
@given(
    st.floats(0, 360),
    st.floats(-300, 300),
    st.floats(-300, 300),
    st.sampled_from([0.02, 0.0625, 0.5]),
)
@example(0.0, 1.5, 1.5, 0.0625)
def test_a_pass_is_length_times_width_in_any_direction(heading, east, north, step_m):
    coverage = Coverage(2.4)
    straight(coverage, (east, north), heading, 40.0, step_m)
    exact_m2 = 40.0 * 2.4
    # A row of cells and a column too many where all edges run through middles of cells.
    assert coverage.covered_area.area_ha * 1e4 == pytest.approx(
        exact_m2, abs=0.2 * (40.0 + 2.4 + 0.2) + 1e-6
    )
    assert coverage.covered_area.overlap_ha == 0.0
    assert coverage.covered_area.travelled_m == pytest.approx(40.0)


def test_right_in_the_mean_over_headings():
    areas = []
    for heading in range(0, 360, 15):
        coverage = Coverage(2.4)
        straight(coverage, (0.07 * heading, 0.0), float(heading) + 3.3, 40.0, 0.2)
        areas.append(coverage.covered_area.area_ha * 1e4)
    assert np.mean(areas) == pytest.approx(96.0, rel=0.003)


def test_neighbouring_passes_neither_overlap_nor_gape():
    coverage = Coverage(2.4)
    for k in range(4):
        straight(coverage, (1.2 + 2.4 * k, 0.0), 0.0, 30.0)
    assert coverage.covered_area.area_ha * 1e4 == pytest.approx(4 * 2.4 * 30.0, rel=1e-6)
    assert coverage.covered_area.overlap_ha == pytest.approx(0.0, abs=1e-9)


def test_the_same_pass_again_is_overlap_and_no_area():
    coverage = Coverage(2.4)
    straight(coverage, (1.2, 0.0), 0.0, 30.0)
    straight(coverage, (1.2, 30.0), 180.0, 30.0)
    assert coverage.covered_area.area_ha * 1e4 == pytest.approx(72.0, rel=1e-6)
    # ground within revisit_m of the turning point was passed over less than that ago
    assert coverage.covered_area.overlap_ha * 1e4 == pytest.approx(
        72.0 - 2.4 * 0.5 * coverage.revisit_m, rel=0.03
    )
    half = Coverage(2.4)
    straight(half, (1.2, 0.0), 0.0, 60.0)
    straight(half, (2.4, 60.0), 180.0, 60.0)
    assert half.covered_area.area_ha * 1e4 == pytest.approx(3.6 * 60.0, rel=1e-3)


def test_a_tight_turn_is_not_its_own_overlap():
    coverage = Coverage(2.4)
    coverage.extend_to((5.0, 0.0), 0.0, False)
    for degree in range(1, 181):
        angle = math.radians(degree)
        coverage.extend_to((5.0 * math.cos(angle), 5.0 * math.sin(angle)), -float(degree), True)
    assert coverage.covered_area.overlap_ha == 0.0
    assert coverage.covered_area.area_ha * 1e4 == pytest.approx(
        math.pi / 2 * (6.2**2 - 3.8**2), rel=0.01
    )


def test_only_what_flowed_counts_to_the_last_tick():
    coverage = Coverage(2.4)
    straight(coverage, (1.2, 0.0), 0.0, 20.0, flowing=False)
    assert coverage.covered_area.area_ha == 0.0
    coverage.extend_to((1.2, 20.0), 0.0, False)
    for k in range(1, 20):
        # the last tick is less than half a cell after the 18th
        coverage.extend_to((1.2, 20.0 + 0.06 * k), 0.0, True)
    coverage.extend_to((1.2, 21.2), 0.0, False)
    assert coverage.covered_area.area_ha * 1e4 == pytest.approx(6 * 0.2 * 2.4)


def test_already_applied_is_about_earlier_passes():
    coverage = Coverage(2.4)
    straight(coverage, (1.2, 0.0), 0.0, 40.0)
    assert coverage.find_covered([(1.2, 10.0)])[0]
    # just passed over: this pass's own ground
    assert not coverage.find_covered([(1.2, 39.0)])[0]
    assert not coverage.find_covered([(1.2, 41.0)])[0]
    assert not coverage.find_covered([(3.6, 10.0)])[0]
    assert not coverage.find_covered([(-500.0, 900.0)])[0]
    assert not coverage.find_covered([(math.nan, 0.0)])[0]
    straight(coverage, (3.6, 40.0), 180.0, 20.0)
    assert coverage.find_covered([(1.2, 39.0)])[0]


def test_a_lost_position_breaks_the_stretch():
    coverage = Coverage(2.4)
    straight(coverage, (1.2, 0.0), 0.0, 10.0)
    coverage.extend_to((math.nan, 10.5), 0.0, True)
    coverage.extend_to((1.2, 30.0), 0.0, True)
    assert coverage.covered_area.area_ha * 1e4 == pytest.approx(24.0, rel=1e-6)
    coverage.extend_to((1.2, 31.0), 0.0, True)
    assert coverage.covered_area.area_ha * 1e4 == pytest.approx(26.4, rel=1e-6)


def test_the_picture_shows_what_is_done_across_tiles():
    coverage = Coverage(2.4)
    assert not coverage.make_raster().done.any()
    straight(coverage, (-30.0, -60.0), 20.0, 150.0)
    west, south, cell, done = coverage.make_raster()
    assert done.sum() * cell * cell == pytest.approx(coverage.covered_area.area_ha * 1e4)
    for far in (1.0, 75.0, 149.0):
        east, north = offset_place((-30.0, -60.0), 20.0, far)
        assert done[int((north - south) / cell), int((east - west) / cell)]
    assert not done[int((0 - south) / cell), int((-40 - west) / cell)]


def test_standing_still_does_nothing():
    coverage = Coverage(2.4)
    for heading in range(0, 720, 7):
        coverage.extend_to((3.0, 4.0), float(heading), True)
    assert coverage.covered_area == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("width", "cell"), [(2.4, 0.0), (2.4, 1.3), (0.0, 0.2), (2.4, math.nan)])
def test_cells_that_do_not_fit_are_refused(width, cell):
    with pytest.raises(ValueError, match="allowed is a cell"):
        Coverage(width, cell)


@pytest.mark.parametrize("cell_m", [0.2, 0.25, 0.4])
def test_what_an_earlier_run_has_done_is_done_and_done_again_is_overlap(cell_m):
    earlier = Coverage(2.4, cell_m)
    straight(earlier, (-31.3, 7.1), 20.0, 60.0)
    coverage = Coverage(2.4)
    coverage.add_earlier_ground(earlier.make_raster())
    assert coverage.covered_area.area_ha == pytest.approx(earlier.covered_area.area_ha, rel=0.02)
    assert coverage.covered_area.overlap_ha == 0.0
    along = [
        offset_place((-31.3, 7.1), 20.0, ahead, aside)
        for ahead in (1.0, 35.0, 59.0)
        for aside in (-0.9, 0.0, 0.9)
    ]
    beside = [
        offset_place((-31.3, 7.1), 20.0, ahead, aside)
        for ahead, aside in ((-1.0, 0.0), (30.0, 1.8), (61.0, 0.0))
    ]
    assert coverage.find_covered(along).all() and coverage.find_covered_earlier(along).all()
    assert (
        not coverage.find_covered(beside).any() and not coverage.find_covered_earlier(beside).any()
    )
    assert coverage.make_raster().done.sum() * 0.04 == pytest.approx(144.0, rel=0.03)
    straight(coverage, offset_place((-31.3, 7.1), 20.0, 20.0), 20.0, 10.0)
    assert coverage.covered_area.overlap_ha * 1e4 == pytest.approx(24.0, rel=0.06)
    assert coverage.find_covered_earlier(along).tolist() == [True] * 9
    assert not coverage.find_covered_earlier([offset_place((-31.3, 7.1), 20.0, 25.0)])[0], (
        "now this run has done it"
    )


@pytest.mark.parametrize("far_m", [40.0, 1e3, 5e4, 5e6, 1e300, math.inf])
def test_a_jump_is_not_swept_and_costs_next_to_nothing(far_m):
    coverage = Coverage(2.4)
    straight(coverage, (0.0, 0.0), 0.0, 20.0)
    done = coverage.covered_area
    for _ in range(3):
        coverage.extend_to((far_m, far_m), 0.0, True)
        coverage.extend_to((0.0, 20.0), 0.0, True)
    assert coverage.covered_area == done, "nothing between, and no way made"
    tracemalloc.start()
    straight(coverage, (far_m, 0.0), 90.0, 20.0)
    coverage.find_covered([(0.0, 10.0), (far_m, 10.0), (-far_m, far_m)])
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()
    assert not coverage.find_covered([(0.5 * far_m, 0.5 * far_m)])[0]


def test_ground_far_apart_makes_a_picture_of_bounded_size():
    coverage = Coverage(2.4)
    straight(coverage, (0.0, 0.0), 0.0, 20.0)
    straight(coverage, (60_000.0, 60_000.0), 0.0, 20.0)
    west, south, _, done = coverage.make_raster()
    assert done.size < 1e6 and 59_000.0 < west and 59_000.0 < south
    assert done.sum() * 0.04 == pytest.approx(48.0, rel=0.1)


# --- What one rate across the width costs: none on an even crop, the known spread on a known
# one ---------------------


@pytest.fixture(scope="module")
def setup():
    return load_setup("huanghai_sections", "demo", dt.date(2014, 3, 7))


def test_an_even_crop_costs_nothing(setup):
    found = measure_width_error(setup.rule, setup.machine, np.full((10, 6), 0.5))
    assert found is not None and found.by_head_kg_ha == 0.0 and found.by_section_kg_ha == 0.0


def test_the_spread_is_that_of_the_need_and_a_section_evens_out_its_own_heads(setup):
    heads = np.tile([0.48, 0.52] * 3, (20, 1))
    found = measure_width_error(setup.rule, setup.machine, heads)
    smooth = setup.rule.crop.model_copy(update={"grades": False})
    rule = type(setup.rule)(smooth, setup.rule.days, setup.rule.ndvi_nrich)
    low, mid, high = (rule.decide_rate(value).rate_kg_ha for value in (0.48, 0.5, 0.52))
    wanted = np.sqrt(0.5 * ((low - mid) ** 2 + (high - mid) ** 2))
    assert found is not None and found.by_head_kg_ha == pytest.approx(wanted, rel=1e-3)
    assert found.by_section_kg_ha == pytest.approx(abs(0.5 * (low + high) - mid), abs=0.01)
    assert found.noise_kg_ha == pytest.approx(0.01 * (low - high) / 0.04, rel=0.02)
    assert (
        "r.m.s. between the need under each head and the one rate, by section"
        in describe_width_error(found)
    )


def test_a_silent_head_is_left_out_and_one_alone_says_nothing(setup):
    some = np.array([[0.48, np.nan, 0.52, 0.5, 0.5, 0.5], [0.5] + [np.nan] * 5])
    found = measure_width_error(setup.rule, setup.machine, some)
    assert found is not None and found.samples == 1
    assert measure_width_error(setup.rule, setup.machine, np.full((3, 6), np.nan)) is None


# --- Totals against numpy on whole arrays
# ----------------------------------------------------------------------------


def test_by_hand():
    totals = Totaliser(2.4, 0.45)
    for _ in range(4000):
        totals.add_tick(0.05, 1.25, 300.0, 290.0)
    done = totals.make_totals()
    assert done.area_ha == pytest.approx(0.06)
    assert done.applied_kg == pytest.approx(18.0)
    assert done.applied_n_kg == pytest.approx(8.1)
    assert done.target_kg == pytest.approx(17.4)
    assert done.worked_s == pytest.approx(200.0)
    assert done.mean_rate_kg_ha == pytest.approx(300.0)
    assert done.cv_percent == pytest.approx(0.0, abs=1e-4)
    assert done.cuc_percent == pytest.approx(100.0, abs=1e-4)
    assert done.error_percent == pytest.approx(100 * (300 / 290 - 1))


def test_nothing_worked_is_not_zero_percent():
    done = Totaliser(2.4, 0.45).make_totals()
    assert done.area_ha == 0.0
    assert done.mean_rate_kg_ha is done.cv_percent is done.cuc_percent is done.error_percent is None


def test_weighted_by_area_not_by_time():
    totals = Totaliser(2.0, 0.45)
    totals.add_tick(10.0, 1.0, 100.0)
    totals.add_tick(10.0, 3.0, 300.0)
    done = totals.make_totals()
    assert done.mean_rate_kg_ha == pytest.approx(250.0)
    assert done.cv_percent == pytest.approx(100 * math.sqrt(0.25 * 150**2 + 0.75 * 50**2) / 250)
    assert done.cuc_percent == pytest.approx(100 * (1 - (0.25 * 150 + 0.75 * 50) / 250))


@settings(deadline=None)
@given(st.integers(0, 2**32), st.floats(20.0, 400.0), st.floats(0.0, 0.4))
def test_the_same_as_on_whole_arrays(seed, level, spread):
    rng = np.random.default_rng(seed)
    rate = np.abs(level * (1.0 + spread * rng.standard_normal(300)))
    speed = rng.uniform(0.5, 3.0, 300)
    totals = Totaliser(2.4, 0.45)
    for v, r in zip(speed, rate, strict=True):
        totals.add_tick(0.05, float(v), float(r))
    area = 2.4 * speed * 0.05 / 1e4
    mean = np.average(rate, weights=area)
    done = totals.make_totals()
    assert done.mean_rate_kg_ha == pytest.approx(mean)
    assert done.cv_percent == pytest.approx(
        100 * math.sqrt(np.average((rate - mean) ** 2, weights=area)) / mean, abs=1e-3
    )
    assert done.cuc_percent == pytest.approx(
        100 * (1 - np.average(np.abs(rate - mean), weights=area) / mean), abs=100 * 0.25 / level
    )


@pytest.mark.parametrize(
    ("step", "speed", "rate"),
    [
        (0.05, None, 300.0),
        (0.05, 1.0, None),
        (0.05, 0.0, 300.0),
        (0.05, -1.0, 300.0),
        (0.05, math.nan, 300.0),
        (0.05, math.inf, 300.0),
        (0.05, 1.0, math.nan),
        (0.05, 1.0, math.inf),
        (0.05, 1.0, -5.0),
        (-0.05, 1.0, 300.0),
    ],
)
def test_what_is_not_known_adds_nothing(step, speed, rate):
    totals = Totaliser(2.4, 0.45)
    totals.add_tick(step, speed, rate, 300.0)
    assert totals.make_totals() == Totaliser(2.4, 0.45).make_totals()


def test_zero_rate_is_worked_area():
    totals = Totaliser(2.4, 0.45)
    totals.add_tick(1.0, 1.0, 0.0, 0.0)
    done = totals.make_totals()
    assert done.area_ha == pytest.approx(2.4e-4) and done.mean_rate_kg_ha == 0.0
    assert done.cv_percent is None and done.error_percent is None


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="width"):
        Totaliser(0.0, 0.45)
    with pytest.raises(ValueError, match="product_n_fraction"):
        Totaliser(2.4, 46.0)


def test_a_pass_is_as_long_as_its_ground():
    """Dead time at its begin, run-out at its end: counted both, each pass is longer by one of
    them."""
    totals = Totaliser(2.4, 0.45)
    for _ in range(2):
        for _ in range(8):
            assert not totals.add_tick(0.05, 1.25, 2.0, 300.0)
        for _ in range(1912):
            assert totals.add_tick(0.05, 1.25, 300.0, 300.0)
        for _ in range(8):
            assert totals.add_tick(0.05, 1.25, 300.0, 0.0)
        totals.stop_work()
    done = totals.make_totals()
    assert done.area_ha == pytest.approx(0.0576) and done.mean_rate_kg_ha == pytest.approx(300.0)
    assert totals.add_tick(0.05, 1.25, 0.0, 0.0) and not Totaliser(2.4, 0.45).add_tick(
        0.05, 1.25, 0.0, 300.0
    )
    assert Totaliser(2.4, 0.45).add_tick(0.05, 1.25, 0.0), (
        "where no target is known, all work counts"
    )


# --- The edge of a field: inside, outside, and how far ahead
# ---------------------------------------------------------

SQUARE = [(0.0, 0.0), (100.0, 0.0), (100.0, 50.0), (0.0, 50.0)]
HOLE = [(40.0, 20.0), (60.0, 20.0), (60.0, 30.0), (40.0, 30.0)]
L_SHAPE = [(0.0, 0.0), (60.0, 0.0), (60.0, 20.0), (20.0, 20.0), (20.0, 80.0), (0.0, 80.0)]


def test_inside_outside_edge_and_hole():
    field = Boundary(SQUARE, [HOLE])
    assert (
        field.contains_place(10, 10)
        and field.contains_place(0, 0)
        and field.contains_place(100, 25)
    )
    assert (
        not field.contains_place(50, 25)
        and not field.contains_place(-0.001, 10)
        and not field.contains_place(10, 50.001)
    )
    assert field.contains_place(40, 25)
    assert not field.contains_place(math.nan, 10) and not field.contains_place(math.inf, 10)
    assert field.area_ha == pytest.approx((5000 - 200) / 10_000)
    assert list(field.contains_places([(10, 10), (50, 25), (-5, 0)])) == [True, False, False]
    assert {len(ring) for ring in field.rings} == {4} and len(field.rings) == 2


@pytest.mark.parametrize(
    ("heading", "metres"),
    [
        (0, 40.0),
        (90, 90.0),
        (180, 10.0),
        (270, 10.0),
        (45, 40 * math.sqrt(2)),
        (360, 40.0),
        (-90, 10.0),
    ],
)
def test_way_to_the_edge_in_every_direction_north_included(heading, metres):
    assert Boundary(SQUARE).find_crossings_m(10, 10, heading) == pytest.approx([metres])


def test_crossings_go_through_holes_and_arms():
    field = Boundary(SQUARE, [HOLE])
    assert field.find_crossings_m(10, 25, 90.0) == pytest.approx([30, 50, 90])
    assert field.find_crossings_m(10, 25, 90.0, farthest_m=49.0) == pytest.approx([30])
    assert field.find_crossings_m(-10, 25, 270.0) == []
    assert field.find_crossings_m(-10, 25, 270.0) == []
    assert (
        field.find_crossings_m(math.nan, 25, 90.0) == [] == field.find_crossings_m(0, 25, math.nan)
    )
    assert Boundary(L_SHAPE).find_crossings_m(-5, 10, 90.0) == pytest.approx([5, 65])


def test_through_a_corner_and_along_an_edge():
    diamond = Boundary([(0, -10), (10, 0), (0, 10), (-10, 0)])
    assert diamond.find_crossings_m(-20, 0, 90.0) == pytest.approx([10, 30])
    assert diamond.find_crossings_m(0, 0, 0.0) == pytest.approx([10])
    assert len(diamond.find_crossings_m(-20, 10, 90.0)) % 2 == 0  # touches one corner only
    assert len(Boundary(SQUARE).find_crossings_m(-10, 0, 90.0)) % 2 == 0  # runs along an edge
    # as good as along an edge
    assert len(Boundary(L_SHAPE).find_crossings_m(0, -1, 1e-38)) % 2 == 0


@settings(deadline=None)
@given(st.floats(-150, 150), st.floats(-150, 150), st.floats(0, 360), st.floats(0.1, 300))
def test_counting_crossings_tells_inside_from_outside(east, north, heading, far):
    """Between here and there the line crosses the edge an odd number of times when one of them
    is outside."""
    field = Boundary(L_SHAPE, [[(5, 5), (15, 5), (15, 15), (5, 15)]])
    there = offset_place((east, north), heading, far)
    ways = field.find_crossings_m(east, north, heading, far)
    assume(
        min(field.shape.boundary.distance(Point(place)) for place in ((east, north), there)) > 1e-6
    )
    assert (len(ways) % 2 == 1) == (
        field.contains_place(east, north) != field.contains_place(*there)
    )


@given(st.floats(-150, 150), st.floats(-150, 150), st.floats(0, 360))
def test_few_corners_one_by_one_give_what_many_at_once_give_to_the_last_bit(east, north, heading):
    field = Boundary(L_SHAPE, [[(5, 5), (15, 5), (15, 15), (5, 15)]])
    line = (east, north, *find_unit_vector(heading))
    assert field._few and field._cross_few_edges(*line) == field._cross_many_edges(*line)


def test_inset_leaves_the_headland_out():
    field = Boundary(SQUARE, [HOLE]).inset_margin(5.0)
    assert field.area_ha == pytest.approx((90 * 40 - 30 * 20) / 10_000)
    assert (
        not field.contains_place(4, 25)
        and field.contains_place(6, 25)
        and not field.contains_place(36, 25)
    )
    assert Boundary(SQUARE).inset_margin(26.0).is_empty
    assert Boundary(SQUARE).inset_margin(26.0).find_crossings_m(1, 1, 0.0) == []
    assert not Boundary(SQUARE).inset_margin(26.0).contains_place(50, 25)
    assert (
        Boundary(SQUARE).inset_margin(0.0).area_ha
        == Boundary(SQUARE).inset_margin(5e-324).area_ha
        == Boundary(SQUARE).area_ha
    )
    with pytest.raises(ValueError, match="0 or more"):
        Boundary(SQUARE).inset_margin(-1.0)


@pytest.mark.parametrize(
    ("outline", "holes", "part"),
    [
        ([(0, 0), (1, 1)], [], "2 corners; allowed is 3"),
        ([(0, 0), (10, 10), (10, 0), (0, 10)], [], "outline: Self-intersection"),
        ([(0, 0), (1, 1), (2, 2)], [], "outline"),
        ([(0, 0), (1, math.nan), (2, 2)], [], "corner 2"),
        (SQUARE, [[(200, 200), (210, 200), (210, 210)]], "inside the outline"),
        (SQUARE, [[(1, 1), (2, 2)]], "hole 1: 2 corners"),
    ],
)
def test_what_is_no_field_is_refused(outline, holes, part):
    with pytest.raises(ValueError, match=part):
        Boundary(outline, holes)


def test_quick_enough_for_every_tick():
    angles = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    field = Boundary([(300 * math.cos(a), 200 * math.sin(a)) for a in angles])
    inside = (
        min(timeit.repeat(lambda: field.contains_place(50.0, 40.0), number=200, repeat=5)) / 200
    )
    ahead = (
        min(timeit.repeat(lambda: field.find_crossings_m(50.0, 40.0, 30.0), number=200, repeat=5))
        / 200
    )
    assert inside < 20e-6
    assert ahead < 100e-6
