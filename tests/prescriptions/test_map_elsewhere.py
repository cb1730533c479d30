"""A map that lies elsewhere gives its outside rate everywhere: START is refused unless the operator wants that."""
from __future__ import annotations

import dataclasses
import datetime as dt

import numpy as np
import pytest

from control.geodesy import TangentPlane
from control.loop.map_near import NEAR_M
from control.loop.tick import Tick
from control.orders import Do, TargetSource
from control.safety import read_refusal
from control.simulation.assembly import with_simulated_field
from control.targets.map_profile import MapProfile
from control.targets.prescription import Fallbacks, MapData, Prescription, Zone, on_plane
from control.targets.rate_map import GridMap, ZoneMap, frame_deg
from drivers.files.setup import load_setup
from tests.control_loop.closed import Change, Closed

OUTSIDE = Fallbacks(default_kg_ha=180.0, outside_kg_ha=157.0)
PLANE = TangentPlane(34.28, 119.88)


def square(south_m: float, west_m: float, size_m: float = 400.0) -> MapData:
    corners = [(west_m, south_m), (west_m + size_m, south_m), (west_m + size_m, south_m + size_m),
               (west_m, south_m + size_m)]
    return MapData(zones=(Zone(250.0, (np.array([PLANE.to_deg(*corner) for corner in corners]),)),), fallbacks=OUTSIDE)


class Work(Closed):
    """The simulated machine, which starts at the field's south-western corner and works northwards; `seen`: by GNSS."""

    def __init__(self, data: MapData, with_field: bool = False, seen: bool = True) -> None:
        setup = load_setup("huanghai", "map_demo", dt.date(2026, 4, 1))
        job = with_simulated_field(setup.job, setup.machine)
        field = job.field.model_copy(update={} if with_field else {"boundary_m": ()})
        super().__init__(setup, known={"job": job.model_copy(update={"field": field})},
                         loop={"prescription": MapProfile(on_plane(data, PLANE), PLANE)})
        self.seen = seen
        self.run(1.0)
        assert self.order(Do.READY).accepted
        self.run(1.0)

    def run(self, seconds: float, change: Change | None = None) -> Tick:
        begun_kg = self.loop.totals.applied_kg
        tick = super().run(seconds, lambda m: m if self.seen else m._replace(gnss=None))
        self.kg = self.loop.totals.applied_kg - begun_kg
        return tick


@pytest.mark.parametrize("with_field", [False, True])
@pytest.mark.parametrize("away", [(50_000.0, 0.0), (0.0, 900.0)])
def test_start_is_refused_and_says_how_far_and_what_it_would_give(away, with_field):
    work = Work(square(*away), with_field)
    answer = work.order(Do.START)
    name, details = read_refusal(answer.why)
    assert not answer.accepted and name == "map_elsewhere"
    assert details["outside_kg_ha"] == "157" and float(details["away_m"]) == pytest.approx(max(away), abs=60.0)
    assert work.run(10.0).row.state == "ready" and work.kg == 0.0


def test_it_is_taken_where_the_outside_rate_is_wanted_until_stop():
    work = Work(square(50_000.0, 0.0))
    assert not work.order(Do.ALLOW_MAP_ELSEWHERE, "yes").accepted
    assert work.order(Do.ALLOW_MAP_ELSEWHERE, True).accepted
    assert work.order(Do.START).accepted
    tick = work.run(15.0)
    assert tick.allow.map_elsewhere and work.kg > 0.1 and tick.row.target_rate_kg_ha == 157.0
    assert work.order(Do.STOP).accepted and work.order(Do.READY).accepted
    assert not work.order(Do.START).accepted


def test_a_place_that_comes_after_start_stops_the_flow():
    work = Work(square(50_000.0, 0.0), seen=False)
    assert work.order(Do.START).accepted        # nobody knows where the machine is
    work.seen = True
    tick = work.run(10.0)
    assert work.kg == 0.0 and "map_elsewhere" in tick.why_no_flow


def test_changing_to_the_map_while_working_does_not_help():
    work = Work(square(50_000.0, 0.0))
    for do, value in ((Do.SOURCE, TargetSource.MANUAL.value), (Do.START, None)):
        assert work.order(do, value).accepted
    work.run(12.0)
    assert work.kg > 0.1
    assert work.order(Do.SOURCE, TargetSource.MAP.value).accepted
    tick = work.run(5.0)
    assert "map_elsewhere" in tick.why_no_flow and tick.command.shaft_rpm == 0.0


@pytest.mark.parametrize(("south_m", "west_m"), [(0.0, -10.0), (25.0, 0.0), (-420.0, 0.0)])
def test_a_machine_that_stands_beside_its_map_starts(south_m, west_m):
    """On it, on the headland before it, just beyond it."""
    assert Work(square(south_m, west_m)).order(Do.START).accepted


def test_in_a_field_that_the_map_covers_in_part_every_place_is_near():
    work = Work(square(100.0, 0.0, 30.0), with_field=True)
    assert work.order(Do.START).accepted
    assert work.order(Do.HOLD).accepted
    away = Work(square(100.0, 0.0, 30.0))
    assert not away.order(Do.START).accepted        # without a field the map alone says where


@pytest.mark.parametrize("place", [(50.0, 20.0), (250.0, 20.0), (-130.0, -70.0), (20_000.0, 9_000.0)])
def test_distances_to_cells_and_to_zones_are_the_same(place):
    """150 m by 90 m of cells of which every other has a rate, and the same cells as zones."""
    south, west = PLANE.to_deg(0.0, 0.0)
    cell_lat, cell_lon = 30.0 / 110_922.0, 30.0 / 92_070.0
    rates = np.where((np.arange(15) % 2 == 0).reshape(3, 5), 100.0, np.nan)
    grid = GridMap(frame_deg(PLANE, south, west, cell_lat, cell_lon, 3, 5), rates)
    rings = [[np.array([PLANE.to_m(south + (r + i) * cell_lat, west + (c + j) * cell_lon)
                        for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))])]
             for r in range(3) for c in range(5) if (5 * r + c) % 2 == 0]
    zones = ZoneMap(rings, np.full(len(rings), 100.0))
    assert grid.away_m(place) == pytest.approx(zones.away_m(place), rel=2e-3, abs=0.05)
    assert grid.away_m((15.0, 15.0)) == zones.away_m((15.0, 15.0)) == 0.0


def test_a_map_without_any_rate_is_nowhere():
    empty = GridMap(frame_deg(PLANE, 34.28, 119.88, 1e-4, 1e-4, 2, 2), np.full((2, 2), np.nan))
    assert empty.away_m((0.0, 0.0)) == np.inf > NEAR_M
    assert Prescription(empty, OUTSIDE).outside_kg_ha == 157.0


def test_a_field_of_the_map_itself_counts_as_the_map():
    data = square(300.0, 0.0)
    corners = ((-50.0, -50.0), (400.0, -50.0), (400.0, 800.0), (-50.0, 800.0))
    ring = np.array([PLANE.to_deg(*corner) for corner in corners])
    assert on_plane(dataclasses.replace(data, fields_deg=((ring,),)), PLANE).away_m((0.0, 0.0)) == 0.0
    assert on_plane(data, PLANE).away_m((0.0, 0.0)) == pytest.approx(300.0, abs=0.5)
