"""Cells and zones: what holds at a place, and the crossings along oblique lines, against
walking the line in steps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
from topdress.control.field.boundary import Boundary
from topdress.control.geodesy import TangentPlane, find_unit_vector, offset_place
from topdress.control.machine.change_lag import LagParts
from topdress.control.orders import TargetSource
from topdress.control.targets.lag_correction import ChangeQueue, FiredChange
from topdress.control.targets.map_profile import MapProfile
from topdress.control.targets.prescription import (
    MIN_GAP_M,
    MIN_STRETCH_M,
    Fallbacks,
    GridDeg,
    MapData,
    Prescription,
    Zone,
    calc_rate_shares,
    project_prescription,
)
from topdress.control.targets.rate_map import GridMap, ZoneMap, make_frame_deg, make_frame_m
from topdress.control.targets.target_profile import Target, TargetChange

STEP_M = 0.02


def walked(
    prescription: Prescription, start: tuple[float, float], heading: float, far: float
) -> list[Target]:
    ways = np.arange(STEP_M / 2, far, STEP_M)
    return prescription.find_targets(
        np.asarray(start) + ways[:, None] * np.asarray(find_unit_vector(heading))
    )


def agree(
    prescription: Prescription, start: tuple[float, float], heading: float, far: float = 40.0
) -> None:
    """Every walked step has the target of its stretch, but for slivers, shared between their
    neighbours."""
    stretches = prescription.find_targets_ahead(start, heading, far)
    begins = [s.distance_m for s in stretches]
    targets = walked(prescription, start, heading, far)
    lengths = {k: sum(1 for _ in run) for k, run in _runs(targets)}
    wrong = []
    for first, length in lengths.items():
        gap = targets[first].source is TargetSource.FALLBACK
        if length * STEP_M > (MIN_GAP_M if gap else MIN_STRETCH_M) + STEP_M:
            for way in ((first + 1) * STEP_M, (first + length - 1) * STEP_M):
                held = stretches[int(np.searchsorted(begins, way, side="right")) - 1].target
                if held != targets[first]:
                    wrong.append(way)
    assert wrong == []
    assert len(stretches) > 1
    assert all(one.target != other.target for one, other in itertools.pairwise(stretches))


def _runs(targets: list[Target]) -> Iterator[tuple[int, list[Target]]]:
    first = 0
    for _, run in itertools.groupby(targets):
        members = list(run)
        yield first, members
        first += len(members)


@pytest.mark.parametrize(
    "heading", [0.0, 90.0, 180.0, 270.0, 7.0, 33.3, 45.0, 91.0, 146.0, 200.5, 300.0, 359.0]
)
def test_stretches_of_a_grid_are_those_walked(chequered: Prescription, heading: float) -> None:
    rng = np.random.default_rng(int(heading))
    for _ in range(6):
        agree(chequered, tuple(rng.uniform(10.0, 100.0, 2)), heading)


def test_border_cells_end_at_the_fields_edge(chequered: Prescription) -> None:
    """Northwards at 50.5 m east: the last change is where the line meets the field's edge, in
    the middle of a cell."""
    out = [
        s
        for s in chequered.find_targets_ahead((50.5, 80.0), 0.0, 40.0)
        if s.target.rate_kg_ha == 5.0
    ]
    edge = (
        Boundary([(61.0, 116.0), (7.0, 88.0), (61.0, 88.0)]).find_crossings_m(50.5, 100.0, 0.0)[0]
        + 100.0
    )
    assert len(out) == 1
    assert out[0].distance_m + 80.0 == pytest.approx(edge, abs=1e-6)
    assert edge % 10.0 > 0.5


def test_inside_without_a_value_outside_and_lost_have_their_own_rates(
    chequered: Prescription,
) -> None:
    hole = np.full((12, 12), np.nan)
    bare = Prescription(
        GridMap(make_frame_m((0, 0), 10, 10), hole),
        Fallbacks(80.0, 5.0, 60.0),
        [Boundary([(4.0, 3.0), (113.0, 8.0), (61.0, 116.0)])],
    )
    assert bare.find_target((50.0, 50.0)) == Target(80.0, TargetSource.FALLBACK)
    assert chequered.find_target((1.0, 1.0)) == Target(5.0, TargetSource.FALLBACK)
    assert chequered.find_target((math.nan, 1.0)) == Target(60.0, TargetSource.FALLBACK)
    fieldless = Prescription(
        GridMap(make_frame_m((0, 0), 10, 10), hole), Fallbacks(80.0, 5.0, 60.0)
    )
    assert fieldless.find_target((50.0, 50.0)).rate_kg_ha == 5.0


def test_a_turned_metre_grid_has_rows_along_its_heading() -> None:
    grid = GridMap(
        make_frame_m((100.0, 200.0), 4.0, 2.0, heading_deg=30.0), np.arange(6.0).reshape(3, 2)
    )
    for row in range(3):
        for column in range(2):
            place = offset_place((100.0, 200.0), 30.0, 2.0 * row + 0.1, 4.0 * column + 3.9)
            assert grid.find_rates([place])[0] == 2 * row + column


def test_a_grid_in_degrees_keeps_its_cells_in_degrees() -> None:
    """Far from the plane's origin, near cell edges: the cell is the one that latitude and
    longitude say."""
    plane = TangentPlane(48.1436, 15.1421)
    south, west, lat_step, lon_step, rows, columns = (
        48.1333,
        15.1313,
        1.1178e-4,
        1.1184e-4,
        178,
        236,
    )
    rates = np.arange(float(rows * columns)).reshape(rows, columns)
    grid = GridMap(make_frame_deg(plane, south, west, lat_step, lon_step, rows, columns), rates)
    rng = np.random.default_rng(1)
    row, column = rng.integers(0, rows, 400), rng.integers(0, columns, 400)
    inset_m = 0.002
    lat = south + (row + inset_m / (lat_step * 111_200)) * lat_step
    lon = west + (column + inset_m / (lon_step * 74_300)) * lon_step
    assert np.array_equal(grid.find_rates(plane.project_many_to_m(lat, lon)), rates[row, column])
    lat = south + (row + 1 - inset_m / (lat_step * 111_200)) * lat_step
    lon = west + (column + 1 - inset_m / (lon_step * 74_300)) * lon_step
    assert np.array_equal(grid.find_rates(plane.project_many_to_m(lat, lon)), rates[row, column])


@pytest.fixture
def patchwork() -> Prescription:
    """Triangles with slivers of 2 cm between them, one with a hole, one over another."""
    rings, rates = [], []
    rng = np.random.default_rng(3)
    for i in range(10):
        for j in range(10):
            w, s, e, n = (
                12.0 * i + 0.01,
                12.0 * j + 0.01,
                12.0 * (i + 1) - 0.01,
                12.0 * (j + 1) - 0.01,
            )
            rings += [[np.array([(w, s), (e, s), (w, n)])], [np.array([(e, s), (e, n), (w, n)])]]
            rates += rng.uniform(100, 400, 2).round(1).tolist()
    rings[0].append(np.array([(2.0, 2.0), (5.0, 2.0), (2.0, 5.0)]))
    rings.append([np.array([(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0)])])
    rates.append(999.0)
    return Prescription(ZoneMap(rings, rates), Fallbacks(1.0, 0.0, 0.0))


@pytest.mark.parametrize("heading", [0.0, 12.0, 45.0, 135.0, 250.0])
def test_stretches_of_zones_are_those_walked(patchwork: Prescription, heading: float) -> None:
    rng = np.random.default_rng(int(heading))
    for _ in range(4):
        agree(patchwork, tuple(rng.uniform(10.0, 80.0, 2)), heading)


def test_slivers_between_zones_are_no_change_of_rate(patchwork: Prescription) -> None:
    rates = [s.target.rate_kg_ha for s in patchwork.find_targets_ahead((66.0, 66.5), 10.0, 40.0)]
    assert len(rates) > 3 and 0.0 not in rates and 1.0 not in rates


def test_the_first_zone_wins_and_holes_are_not_in_it(patchwork: Prescription) -> None:
    assert patchwork.find_target((3.0, 3.0)).rate_kg_ha == 999.0
    assert patchwork.find_target((1.0, 1.0)).rate_kg_ha != 999.0


def test_an_outline_that_crosses_itself_is_what_it_encloses() -> None:
    bow = ZoneMap([[np.array([(0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0)])]], [7.0])
    assert bow.find_rates([(1.0, 5.0), (9.0, 5.0)]).tolist() == [7.0, 7.0]
    assert np.isnan(bow.find_rates([(5.0, 1.0)])[0])


def test_statistics_of_a_grid_and_of_the_same_ground_as_zones() -> None:
    south, west, step = 40.0, 116.0, 1e-4
    grid = GridDeg(south, west, step, step, np.array([[100.0, 200.0], [np.nan, 100.0]]))
    cells = [
        Zone(rate, (np.array([(a, b), (a + step, b), (a + step, b + step), (a, b + step)]),))
        for a, b, rate in [
            (south, west, 100.0),
            (south, west + step, 200.0),
            (south + step, west + step, 100.0),
        ]
    ]
    as_grid, as_zones = (
        calc_rate_shares(MapData(grid=grid)),
        calc_rate_shares(MapData(zones=tuple(cells))),
    )
    cell_ha = step * 111_035 * step * 85_394 / 1e4
    assert [s.rate_kg_ha for s in as_grid] == [100.0, 200.0]
    assert as_grid[0].area_ha == pytest.approx(2 * cell_ha, rel=1e-3)
    assert as_grid[1].mass_kg == pytest.approx(200.0 * cell_ha, rel=1e-3)
    for one, other in zip(as_grid, as_zones, strict=True):
        assert one.area_ha == pytest.approx(other.area_ha, rel=1e-9)
    half = np.array(
        [
            (south, west),
            (south + step, west),
            (south + step, west + step / 2),
            (south, west + step / 2),
        ]
    )
    clipped = calc_rate_shares(MapData(grid=grid, fields_deg=((half,),)))
    assert [s.area_ha for s in clipped] == [pytest.approx(0.5 * cell_ha, rel=1e-3)]


def test_a_map_is_zones_or_a_grid() -> None:
    with pytest.raises(ValueError, match="zones or a grid"):
        MapData()


def test_on_plane_carries_field_and_fallbacks() -> None:
    ring = np.array([(40.0, 116.0), (40.001, 116.0), (40.001, 116.001), (40.0, 116.001)])
    data = MapData(
        zones=(Zone(150.0, (ring[:3],)),),
        fallbacks=Fallbacks(90.0, 3.0, 0.0),
        fields_deg=((ring,),),
    )
    prescription = project_prescription(data, TangentPlane(40.0, 116.0))
    plane = data.make_plane()
    assert plane.lat_deg == pytest.approx(40.0005)
    inside_zone = TangentPlane(40.0, 116.0).project_to_m(40.0009, 116.0001)
    inside_field = TangentPlane(40.0, 116.0).project_to_m(40.0001, 116.0009)
    assert [
        prescription.find_target(p).rate_kg_ha for p in (inside_zone, inside_field, (-5.0, 0.0))
    ] == [
        150.0,
        90.0,
        3.0,
    ]


# --- Map mode along the track: changes made stay, the rest is seen anew; edges, jitter, turns
# and lost positions.

START = Target(0.0, TargetSource.NONE)


class Fixed:
    """A reach of so many metres."""

    max_reach_m = 12.0

    def __init__(self, lag_m: float) -> None:
        self.lag_m = lag_m

    def find_lag(self, before: Target, change: TargetChange) -> LagParts:
        return LagParts(0.0, 0.0, self.lag_m)

    def find_distance_m(self, lag: LagParts) -> float:
        return self.lag_m


@pytest.fixture
def profile(chequered: Prescription) -> MapProfile:
    return MapProfile(chequered, TangentPlane(34.0, 119.0))


def drive(
    profile: MapProfile,
    start: tuple[float, float],
    heading: float,
    way_m: float,
    lag_m: float = 2.6,
    jitter: tuple[float, float] = (0.0, 0.0),
    step_m: float = 0.06,
) -> list[FiredChange]:
    rng = np.random.default_rng(5)
    queue = ChangeQueue(START)
    fired = []
    for track in np.arange(0.0, way_m, step_m):
        aside, turned = jitter[0] * rng.standard_normal(), jitter[1] * rng.standard_normal()
        place = offset_place(start, heading, float(track), aside)
        profile.look_ahead(float(track), *place, heading + turned, queue.fired_to_m)
        fired += queue.fire_changes(profile, float(track), float(track), Fixed(lag_m))
    return fired


@pytest.mark.parametrize("heading", [0.0, 17.0, 45.0, 78.0])
def test_each_edge_fires_once_a_lag_distance_before_it(profile: MapProfile, heading: float) -> None:
    start = (15.0, 15.0)
    fired = drive(profile, start, heading, 60.0)[1:]
    wanted = [
        s
        for s in profile.prescription.find_targets_ahead(start, heading, 62.6)
        if s.distance_m > 0.0
    ]
    for change, stretch in zip(fired, wanted, strict=False):
        assert change.place_m == pytest.approx(stretch.distance_m, abs=1e-6)
        assert change.after == stretch.target
        assert (
            change.place_m - change.track_m == pytest.approx(2.6, abs=0.061)
            or len([f for f in fired if f.track_m == change.track_m]) > 1
        )
    assert abs(len(fired) - len(wanted)) <= 1


@pytest.mark.parametrize("heading", [0.0, 17.0, 45.0])
def test_a_jitter_of_place_and_heading_adds_no_change(profile: MapProfile, heading: float) -> None:
    calm = [f.after for f in drive(profile, (15.0, 15.0), heading, 60.0)]
    shaken = [f.after for f in drive(profile, (15.0, 15.0), heading, 60.0, jitter=(0.02, 0.7))]
    assert shaken == calm


def test_driving_along_an_edge_does_not_chatter(profile: MapProfile) -> None:
    fired = drive(profile, (40.0, 15.0), 0.0, 60.0, jitter=(0.03, 0.0))
    assert len(fired) <= 8


def test_what_holds_after_a_sharp_turn_is_taken_over(profile: MapProfile) -> None:
    queue = ChangeQueue(START)
    profile.look_ahead(0.0, 35.0, 35.0, 0.0, queue.fired_to_m)
    queue.fire_changes(profile, 0.0, 0.0, Fixed(2.6))
    profile.look_ahead(4.0, 35.0, 39.0, 0.0, queue.fired_to_m)
    queue.fire_changes(profile, 0.0, 4.0, Fixed(2.6))
    held = profile.prescription.find_target((35.0, 45.0))
    assert queue.holding == held  # made for the cell to the north
    # turned away from it before reaching it
    profile.look_ahead(4.5, 35.0, 39.4, 90.0, queue.fired_to_m)
    queue.fire_changes(profile, 0.0, 4.5, Fixed(2.6))
    assert queue.holding == profile.prescription.find_target((36.0, 39.4))


def test_the_way_ahead_bends_with_the_turn(profile: MapProfile) -> None:
    """On a right turn of 8 m radius the edge to the east is met along the arc, the one straight
    ahead never."""
    radius = 8.0
    turn = math.degrees(1.0) / radius
    profile.look_ahead(0.0, 22.0, 25.0, 0.0, float("-inf"), turn_deg_m=turn)
    angle = math.acos((radius - 8.0) / radius) if radius >= 8.0 else 0.0
    changes, holding, after = [], profile.find_target(0.0), 0.0
    while (change := profile.find_next_change(after, 14.0, holding)) is not None:
        changes.append(change)
        holding, after = change.target, change.place_m
    arc = [
        (22.0 + radius * (1 - math.cos(s / radius)), 25.0 + radius * math.sin(s / radius))
        for s in np.arange(0.0, 14.0, 0.01)
    ]
    on_arc = profile.prescription.find_targets(arc)
    true = [0.01 * k for k in range(1, len(arc)) if on_arc[k] != on_arc[k - 1]]
    assert angle > 0.0
    assert [c.place_m for c in changes] == pytest.approx(true, abs=0.15)


def test_a_lost_position_has_its_rate_and_is_found_again(profile: MapProfile) -> None:
    profile.look_ahead(0.0, 35.0, 35.0, 0.0, float("-inf"))
    here = profile.find_target(1.0)
    profile.forget_place()
    assert profile.find_target(1.0) == Target(60.0, TargetSource.FALLBACK)
    assert profile.find_next_change(1.0, 10.0, here) == TargetChange(
        1.0, Target(60.0, TargetSource.FALLBACK)
    )
    profile.look_ahead(1.0, 35.0, 36.0, 0.0, 1.0)
    assert profile.find_target(1.5) == here


def test_what_was_passed_stays_known_behind(profile: MapProfile) -> None:
    drive(profile, (15.0, 15.0), 0.0, 30.0)
    assert profile.find_target(2.0) == profile.prescription.find_target((15.0, 17.0))
    assert profile.find_target(12.0) == profile.prescription.find_target((15.0, 27.0))


def test_a_map_without_changes_needs_none() -> None:
    flat = Prescription(
        GridMap(make_frame_m((-500.0, -500.0), 10.0, 10.0), np.full((100, 100), 250.0)), Fallbacks()
    )
    fired = drive(MapProfile(flat, TangentPlane(34.0, 119.0)), (0.0, 0.0), 33.0, 100.0)
    assert [f.after for f in fired] == [Target(250.0, TargetSource.MAP)]
