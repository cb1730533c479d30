"""The map's rate as base, the heads' around it within limits; both seen ahead."""
from __future__ import annotations

import datetime as dt

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from control.field.job import Job, Wanted
from control.geodesy import TangentPlane
from control.orders import Do, Order, TargetSource
from control.simulation.assembly import control_loop, simulated_machine
from control.simulation.closed_loop import Record, simulated_run
from control.targets.map_and_canopy import Around, MapAndCanopy
from control.targets.map_profile import MapProfile
from control.targets.prescription import Fallbacks, Prescription
from control.targets.profile import Change, Stretches, Target
from control.targets.rate_map import GridMap, frame_m
from drivers.files.setup import load_setup

MAP, BOTH = TargetSource.MAP, TargetSource.MAP_AND_CANOPY


class Base:
    """A map along the track: rates from places on."""

    def __init__(self, *steps: tuple[float, float]) -> None:
        self.steps = [(place, Target(rate, MAP if rate >= 0.0 else TargetSource.FALLBACK)) for place, rate in steps]

    def at(self, place_m: float) -> Target:
        return [target for place, target in self.steps if place <= place_m][-1]

    def next_change(self, after_m: float, before_m: float, holding: Target) -> Change | None:
        for place in (after_m, *(place for place, _ in self.steps if after_m < place <= before_m)):
            if self.at(place) != holding:
                return Change(place, self.at(place))
        return None


def seen(*stretches: tuple[float, float, float]) -> Stretches:
    found = Stretches(99.0)
    for one in stretches:
        found.append(*one)
    return found


def test_the_heads_move_the_rate_within_the_limits():
    for around, rates in ((Around(20.0), (160.0, 190.0, 240.0)), (Around(20.0, 30.0), (170.0, 190.0, 230.0)),
                          (Around(0.0), (200.0, 200.0, 200.0)), (Around(100.0), (0.0, 190.0, 400.0))):
        both = MapAndCanopy(Base((-1e9, 200.0)), seen((0.0, 2.0, 0.0), (2.0, 4.0, 190.0), (4.0, 6.0, 999.0)), around)
        assert tuple(both.at(place).rate_kg_ha for place in (1.0, 3.0, 5.0)) == rates
        assert both.at(1.0).source is BOTH


def test_without_a_reading_the_map_without_a_map_nothing_changed():
    both = MapAndCanopy(Base((-1e9, 200.0), (10.0, 0.0), (20.0, -1.0)), seen((0.0, 2.0, 190.0), (11.0, 22.0, 190.0)),
                        Around())
    assert both.at(1.0) == Target(190.0, BOTH) and both.at(6.0) == Target(200.0, MAP)
    assert both.at(15.0) == Target(0.0, MAP), "where the map says nothing is to fall nothing falls"
    assert both.at(21.0).source is TargetSource.FALLBACK


def test_changes_of_either_are_seen_ahead():
    both = MapAndCanopy(Base((-1e9, 200.0), (3.0, 300.0)), seen((0.0, 2.0, 190.0), (2.0, 8.0, 280.0)), Around())
    found, place, holding = [], 0.5, both.at(0.5)
    while (change := both.next_change(place, 12.0, holding)) is not None:
        found.append((change.place_m, round(change.target.rate_kg_ha, 6)))
        place, holding = change.place_m, change.target
    assert found == [(2.0, 240.0), (3.0, 280.0), (9.5, 300.0)], "canopy, map, end of what the heads have seen"


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0.5, 4.0), st.sampled_from([0.0, 100.0, 150.0, 300.0])), min_size=1, max_size=6),
       st.lists(st.tuples(st.floats(0.5, 4.0), st.floats(0.0, 400.0)), min_size=1, max_size=6))
@example([(1.25, 0.0), (3.0, 100.0)], [(2.772422720644507, 0.0)])   # two changes 2 cm apart
def test_following_the_changes_is_being_at_the_places(base, canopy):
    """Property: from change to change one holds what `at` says in between; at the end of what the heads have seen at
    the latest with the next look, as by the canopy alone."""
    places = np.cumsum([way for way, _ in base])
    steps = Base((-1e9, 50.0), *((float(place), rate) for place, (_, rate) in zip(places, base, strict=True)))
    stretches, at = Stretches(99.0), 0.0
    for way, rate in canopy:
        stretches.append(at, at + way, rate)
        at += way
    both, place, holding = MapAndCanopy(steps, stretches, Around()), 0.0, None
    holding, before = both.at(0.0), 0.0
    for probe in np.linspace(0.05, 30.0, 120):
        while (change := both.next_change(place, probe, holding)) is not None:
            place, holding = change.place_m, change.target
            before = place + 1e-9
        assert holding == both.at(probe) or (both.at(probe).source is MAP and holding == both.at(before))
        place = before = probe


@pytest.fixture(scope="module")
def driven():
    """A pass over 10 m cells of 200 and 300 kg/ha, heads around them within 20 %; 300 m."""
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    job = setup.job.model_copy(update={"target": Wanted(source=BOTH, map="made here")})
    rates = np.where(np.arange(40)[:, None] % 2 == 0, 200.0, 300.0) * np.ones((1, 4))
    grid = Prescription(GridMap(frame_m((-20.0, -20.0), 10.0, 10.0), rates), Fallbacks())
    plane = TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
    plant = simulated_machine(setup.machine, job, 1, 0.05)
    loop = control_loop(setup.machine, setup.crop, setup.rule, job, prescription=MapProfile(grid, plane))
    record, ticks = Record(), []
    for step in simulated_run(plant, loop, 200.0):
        record.add(step)
        ticks.append(step.tick)
    return ticks, record.columns(), grid, record.fired


def test_a_run_follows_both(driven):
    ticks, columns, grid, _ = driven
    rows = [tick.row for tick in ticks if tick.row.time_s > 25.0]
    assert {row.target_source for row in rows} == {"map_and_canopy"} and all(row.ndvi is not None for row in rows)
    inside = (columns["working"] > 0) & (columns["time_s"] > 25.0)
    target, north = columns["target_kg_ha"][inside], columns["north_m"][inside]
    base = np.array([grid.at((0.0, float(n))).rate_kg_ha for n in north])
    edge = np.abs((north + 20.0) % 10.0 - 5.0) < 4.8                # not where the place is known to centimetres only
    off = target[edge] / base[edge]
    assert off.min() >= 0.8 - 1e-6 and off.max() <= 1.2 + 1e-6
    assert (off < 0.999).any() and (off > 1.001).any() and off.std() > 0.05


def test_edges_of_the_map_are_made_ahead_of_their_place(driven):
    """Where both cells are at their limit the step at an edge of the map is made a lag distance before it."""
    _, _, _, fired = driven

    ahead = np.array([one.place_m - one.track_m for one in fired if one.before.rate_kg_ha > 0.0])
    assert len(ahead) > 30 and 1.5 < np.median(ahead) < 3.5, "a lag of some 2 s at 1.25 m/s"


def test_silent_heads_are_an_alarm_and_the_map_goes_on():
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    job = setup.job.model_copy(update={"target": Wanted(source=BOTH, map="made here")})
    grid = Prescription(GridMap(frame_m((-20.0, -20.0), 400.0, 400.0), [[200.0]]), Fallbacks())
    plane = TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
    plant = simulated_machine(setup.machine, job, 1, 0.05)
    loop = control_loop(setup.machine, setup.crop, setup.rule, job, prescription=MapProfile(grid, plane))
    inner = loop.tick

    def deaf(m, *rest):
        return inner(m._replace(ndvi=(None,) * 6) if m.time_s > 40.0 else m, *rest)
    loop.tick = deaf
    last = [step.tick for step in simulated_run(plant, loop, 60.0)][-1]
    assert "ndvi_silent" in (last.row.alarms or "") and last.row.target_source == "map"
    assert last.row.target_rate_kg_ha == 200.0 and last.command.shaft_rpm > 5.0


def test_it_is_ordered_only_where_there_is_a_map_and_needs_a_place():
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    loop = control_loop(setup.machine, setup.crop, setup.rule, setup.job)
    assert loop.order(Order(Do.SOURCE, "map_and_canopy")).why == "source_not_ready"
    with pytest.raises(ValidationError, match="source map_and_canopy needs the key map"):
        Job(target=Wanted(source=BOTH))
