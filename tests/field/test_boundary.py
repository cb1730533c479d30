"""The edge of a field: inside, outside, and how far ahead."""
from __future__ import annotations

import math
import timeit

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import Point

from control.field.boundary import Boundary
from control.geodesy import direction, offset

SQUARE = [(0.0, 0.0), (100.0, 0.0), (100.0, 50.0), (0.0, 50.0)]
HOLE = [(40.0, 20.0), (60.0, 20.0), (60.0, 30.0), (40.0, 30.0)]
L_SHAPE = [(0.0, 0.0), (60.0, 0.0), (60.0, 20.0), (20.0, 20.0), (20.0, 80.0), (0.0, 80.0)]


def test_inside_outside_edge_and_hole():
    field = Boundary(SQUARE, [HOLE])
    assert field.contains(10, 10) and field.contains(0, 0) and field.contains(100, 25)
    assert not field.contains(50, 25) and not field.contains(-0.001, 10) and not field.contains(10, 50.001)
    assert field.contains(40, 25)
    assert not field.contains(math.nan, 10) and not field.contains(math.inf, 10)
    assert field.area_ha == pytest.approx((5000 - 200) / 10_000)
    assert list(field.many_inside([(10, 10), (50, 25), (-5, 0)])) == [True, False, False]
    assert {len(ring) for ring in field.rings} == {4} and len(field.rings) == 2


@pytest.mark.parametrize(("heading", "metres"), [(0, 40.0), (90, 90.0), (180, 10.0), (270, 10.0),
                                                 (45, 40 * math.sqrt(2)), (360, 40.0), (-90, 10.0)])
def test_way_to_the_edge_in_every_direction_north_included(heading, metres):
    assert Boundary(SQUARE).crossings_m(10, 10, heading) == pytest.approx([metres])


def test_crossings_go_through_holes_and_arms():
    field = Boundary(SQUARE, [HOLE])
    assert field.crossings_m(10, 25, 90.0) == pytest.approx([30, 50, 90])
    assert field.crossings_m(10, 25, 90.0, farthest_m=49.0) == pytest.approx([30])
    assert field.crossings_m(-10, 25, 270.0) == []
    assert field.crossings_m(-10, 25, 270.0) == []
    assert field.crossings_m(math.nan, 25, 90.0) == [] == field.crossings_m(0, 25, math.nan)
    assert Boundary(L_SHAPE).crossings_m(-5, 10, 90.0) == pytest.approx([5, 65])


def test_through_a_corner_and_along_an_edge():
    diamond = Boundary([(0, -10), (10, 0), (0, 10), (-10, 0)])
    assert diamond.crossings_m(-20, 0, 90.0) == pytest.approx([10, 30])
    assert diamond.crossings_m(0, 0, 0.0) == pytest.approx([10])
    assert len(diamond.crossings_m(-20, 10, 90.0)) % 2 == 0            # touches one corner only
    assert len(Boundary(SQUARE).crossings_m(-10, 0, 90.0)) % 2 == 0    # runs along an edge
    assert len(Boundary(L_SHAPE).crossings_m(0, -1, 1e-38)) % 2 == 0   # as good as along an edge


@settings(deadline=None)
@given(st.floats(-150, 150), st.floats(-150, 150), st.floats(0, 360), st.floats(0.1, 300))
def test_counting_crossings_tells_inside_from_outside(east, north, heading, far):
    """Between here and there the line crosses the edge an odd number of times when one of them is outside."""
    field = Boundary(L_SHAPE, [[(5, 5), (15, 5), (15, 15), (5, 15)]])
    there = offset((east, north), heading, far)
    ways = field.crossings_m(east, north, heading, far)
    assume(min(field.shape.boundary.distance(Point(place)) for place in ((east, north), there)) > 1e-6)
    assert (len(ways) % 2 == 1) == (field.contains(east, north) != field.contains(*there))


@given(st.floats(-150, 150), st.floats(-150, 150), st.floats(0, 360))
def test_few_corners_one_by_one_give_what_many_at_once_give_to_the_last_bit(east, north, heading):
    field = Boundary(L_SHAPE, [[(5, 5), (15, 5), (15, 15), (5, 15)]])
    line = (east, north, *direction(heading))
    assert field._few and field._crossed_of_few(*line) == field._crossed_of_many(*line)


def test_inset_leaves_the_headland_out():
    field = Boundary(SQUARE, [HOLE]).inset(5.0)
    assert field.area_ha == pytest.approx((90 * 40 - 30 * 20) / 10_000)
    assert not field.contains(4, 25) and field.contains(6, 25) and not field.contains(36, 25)
    assert Boundary(SQUARE).inset(26.0).is_empty
    assert Boundary(SQUARE).inset(26.0).crossings_m(1, 1, 0.0) == []
    assert not Boundary(SQUARE).inset(26.0).contains(50, 25)
    assert Boundary(SQUARE).inset(0.0).area_ha == Boundary(SQUARE).inset(5e-324).area_ha == Boundary(SQUARE).area_ha
    with pytest.raises(ValueError, match="0 or more"):
        Boundary(SQUARE).inset(-1.0)


@pytest.mark.parametrize(("outline", "holes", "part"), [
    ([(0, 0), (1, 1)], [], "2 corners; allowed is 3"),
    ([(0, 0), (10, 10), (10, 0), (0, 10)], [], "outline: Self-intersection"),
    ([(0, 0), (1, 1), (2, 2)], [], "outline"),
    ([(0, 0), (1, math.nan), (2, 2)], [], "corner 2"),
    (SQUARE, [[(200, 200), (210, 200), (210, 210)]], "inside the outline"),
    (SQUARE, [[(1, 1), (2, 2)]], "hole 1: 2 corners"),
])
def test_what_is_no_field_is_refused(outline, holes, part):
    with pytest.raises(ValueError, match=part):
        Boundary(outline, holes)


def test_quick_enough_for_every_tick():
    angles = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    field = Boundary([(300 * math.cos(a), 200 * math.sin(a)) for a in angles])
    inside = min(timeit.repeat(lambda: field.contains(50.0, 40.0), number=200, repeat=5)) / 200
    ahead = min(timeit.repeat(lambda: field.crossings_m(50.0, 40.0, 30.0), number=200, repeat=5)) / 200
    assert inside < 20e-6
    assert ahead < 100e-6
