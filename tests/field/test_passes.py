"""Parallel passes: they cover the field, stay inside it, and are driven to and fro."""
from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from control.field.boundary import Boundary
from control.field.coverage import Coverage
from control.field.passes import Pass, headland_rounds, idle_m, plan_passes, skip_for, swath_middles_m
from control.geodesy import offset, turn_deg

SQUARE = Boundary([(0.0, 0.0), (48.0, 0.0), (48.0, 100.0), (0.0, 100.0)])
L_SHAPE = Boundary([(0.0, 0.0), (60.0, 0.0), (60.0, 20.0), (20.0, 20.0), (20.0, 80.0), (0.0, 80.0)])


def drive(coverage: Coverage, one: Pass, step_m: float = 0.1) -> None:
    coverage.lay(one.start, one.heading_deg, False)
    steps = math.ceil(one.length_m / step_m)
    for k in range(1, steps + 1):
        coverage.lay(offset(one.start, one.heading_deg, one.length_m * k / steps), one.heading_deg, True)


def test_north_and_south_from_the_left():
    passes = plan_passes(SQUARE, 2.4, 0.0)
    assert len(passes) == 20
    assert passes[0] == Pass(0, pytest.approx((1.2, 0.0)), pytest.approx((1.2, 100.0)), 0.0)
    assert passes[1] == Pass(1, pytest.approx((3.6, 100.0)), pytest.approx((3.6, 0.0)), 180.0)
    assert [one.swath for one in passes] == list(range(20))
    assert passes[-1].start[0] == pytest.approx(46.8)
    assert idle_m(passes) == pytest.approx(19 * 2.4)


def test_left_of_the_heading_comes_first():
    assert plan_passes(SQUARE, 2.4, 90.0)[0].start == pytest.approx((0.0, 98.8))
    assert plan_passes(SQUARE, 2.4, 180.0)[0].start == pytest.approx((46.8, 100.0))
    assert plan_passes(SQUARE, 2.4, 270.0)[0].start == pytest.approx((48.0, 1.2))


def test_the_last_swath_is_drawn_in():
    assert swath_middles_m(0.0, 6.0, 2.4) == pytest.approx([1.2, 3.6, 4.8])
    assert swath_middles_m(0.0, 4.8, 2.4) == pytest.approx([1.2, 3.6])
    assert swath_middles_m(10.0, 11.0, 2.4) == [10.5]


def test_headland_shortens_the_passes():
    passes = plan_passes(SQUARE, 2.4, 0.0, headland_m=10.0)
    assert passes[0].start == pytest.approx((11.2, 10.0)) and passes[0].end == pytest.approx((11.2, 90.0))
    assert plan_passes(SQUARE, 2.4, 0.0, headland_m=30.0) == ()


def test_concave_fields_and_holes_split_a_swath():
    north = plan_passes(L_SHAPE, 2.4, 90.0)
    assert all(one.length_m == pytest.approx(20.0) for one in north if one.start[1] > 20.0)
    ring = Boundary([(0, 0), (50, 0), (50, 50), (0, 50)], [[(20, 20), (30, 20), (30, 30), (20, 30)]])
    split = [one for one in plan_passes(ring, 2.4, 0.0) if one.swath == 10]
    assert [one.length_m for one in split] == pytest.approx([20.0, 20.0])
    assert split[0].end == pytest.approx((25.2, 20.0)) and split[1].start == pytest.approx((25.2, 30.0))
    back = [one for one in plan_passes(ring, 2.4, 0.0) if one.swath == 9]
    assert back[0].heading_deg == 180.0 and back[0].start[1] == 50.0 and back[1].end[1] == 0.0


def test_skipping_swaths_for_wide_turns():
    assert skip_for(5.0, 2.4) == 5 and skip_for(1.2, 2.4) == 1 and skip_for(0.0, 2.4) == 1
    passes = plan_passes(SQUARE, 2.4, 0.0, skip=5)
    assert [one.swath for one in passes[:5]] == [0, 5, 10, 15, 1]
    assert sorted(one.swath for one in passes) == list(range(20))
    assert all(abs(turn_deg(one.heading_deg, other.heading_deg)) == 180.0
               for one, other in itertools.pairwise(passes))


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 359.0), st.floats(1.5, 12.0), st.floats(0.0, 8.0), st.integers(1, 4))
def test_every_pass_lies_in_the_work_area_along_its_heading(heading, width, headland, skip):
    grown = Boundary(L_SHAPE.rings[0]).shape.buffer(1e-6)
    passes = plan_passes(L_SHAPE, width, heading, headland, skip)
    assert passes
    for one in passes:
        assert grown.contains(Boundary([one.start, one.end, offset(one.end, one.heading_deg + 90.0, 1e-9)]).shape)
        assert offset(one.start, one.heading_deg, one.length_m) == pytest.approx(one.end, abs=1e-6)
        assert abs(turn_deg(one.heading_deg, heading)) == pytest.approx(0.0 if abs(
            turn_deg(one.heading_deg, heading)) < 90.0 else 180.0, abs=1e-6)


def test_passes_and_headland_rounds_together_cover_the_field():
    coverage = Coverage(2.4, cell_m=0.4)
    for one in plan_passes(SQUARE, 2.4, 0.0, headland_m=4.8):
        drive(coverage, one, 0.2)
    inner = coverage.covered
    assert inner.area_ha == pytest.approx((48 - 9.6) * (100 - 9.6) / 1e4, rel=0.01)
    assert inner.overlap_ha == pytest.approx(0.0, abs=0.001)
    rounds = headland_rounds(SQUARE, 2.4, 4.8)
    assert len(rounds) == 2 and rounds[0][0] == rounds[0][-1]
    for line, inwards_m in zip(rounds, (1.2, 3.6), strict=True):
        assert {round(min(east, 48.0 - east), 6) for east, _ in line} == {inwards_m}
    assert len(headland_rounds(SQUARE, 2.4, 5.0)) == 3
    assert headland_rounds(SQUARE, 2.4, 0.0) == ()
    for line in rounds:
        for start, end in itertools.pairwise(line):
            length = math.dist(start, end)
            heading = math.degrees(math.atan2(end[0] - start[0], end[1] - start[1]))
            drive(coverage, Pass(0, start, end, heading), 0.2)
    assert coverage.covered.area_ha == pytest.approx(SQUARE.area_ha, rel=0.01)
    assert length > 0


def test_what_cannot_be_planned_is_refused():
    with pytest.raises(ValueError, match="width 0"):
        plan_passes(SQUARE, 0.0, 0.0)
    with pytest.raises(ValueError, match="skip 0"):
        plan_passes(SQUARE, 2.4, 0.0, skip=0)
    with pytest.raises(ValueError, match="width"):
        headland_rounds(SQUARE, -1.0, 5.0)
