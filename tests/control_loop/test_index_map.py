"""A map of the canopy's index beneath the rule: where the heads fall silent the loop goes on by
it."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from topdress.control.agronomy.crop import Crop
from topdress.control.field.job import Canopy, Job, Wanted
from topdress.control.geodesy import TangentPlane
from topdress.control.loop import Tick
from topdress.control.orders import Do, TargetSource
from topdress.control.simulation.assembly import make_control_loop, make_plant
from topdress.control.simulation.closed_loop import RunRecord, simulate_run
from topdress.control.simulation.simulated_canopy import CanopyField, HeadRow
from topdress.control.targets.canopy_target import MapAndCanopy, RateBounds
from topdress.control.targets.index_map import MAX_OFFSET, IndexMap
from topdress.control.targets.map_profile import MapProfile
from topdress.control.targets.prescription import Fallbacks, Prescription
from topdress.control.targets.rate_map import GridMap, make_frame_m
from topdress.control.targets.target_profile import DecidedStretches, Target, TargetChange
from topdress.drivers.files.run_setup import Setup, load_setup

from tests.control_loop.closed import SETUP, Closed

CELL_M = 3.0  # as a resampled drone's map has
# the drone's camera reads this much less than the heads do
SEEN_OFF = 0.06
SILENT_S = 50.0


class Run(NamedTuple):
    ticks: list[Tick]
    # by the rule, of the canopy at the outlets' place
    wanted_kg_ha: np.ndarray
    target_kg_ha: np.ndarray  # that this place was meant to get
    setup: Setup


def of_canopy(at: Callable[..., np.ndarray], off: float) -> GridMap:
    """Means over cells of the simulated canopy, as a camera from above would have them."""
    easts, norths = np.arange(-30.0, 60.0, CELL_M), np.arange(-30.0, 330.0, CELL_M)
    inner = (np.arange(5) + 0.5) / 5.0 * CELL_M
    e, n, a, b = np.meshgrid(easts, norths, inner, inner, indexing="xy")
    return GridMap(
        make_frame_m((-30.0, -30.0), CELL_M, CELL_M), at(e + a, n + b).mean(axis=(2, 3)) - off
    )


def driven(with_map: bool, heads: str) -> Run:
    """heads: silent_later, never."""
    setup, ground = SETUP, SETUP.job.field
    field = Closed().plant._canopy._field
    off = SEEN_OFF if heads == "silent_later" else 0.0
    under = (
        IndexMap(
            of_canopy(field.find_many_ndvi, off),
            TangentPlane(ground.origin_lat_deg, ground.origin_lon_deg),
            setup.machine.geometry.working_width_m,
        )
        if with_map
        else None
    )
    closed = Closed(loop={"index_map": under})
    inner: Any = closed.loop.run_tick

    def deaf(m: Any, *rest: Any) -> Tick:
        silent = heads == "never" or m.time_s > SILENT_S
        return inner(m._replace(ndvi=(None,) * len(m.ndvi)) if silent else m, *rest)

    closed.loop.run_tick = deaf  # type: ignore[method-assign]
    steps = closed.through(95.0)
    half = 0.5 * setup.machine.geometry.working_width_m
    aside = np.linspace(-half, half, 7)
    wanted = [
        setup.rule.decide_rate(
            float(
                np.mean(field.find_many_ndvi(s.truth.east_m + aside, s.truth.north_m + 0.0 * aside))
            )
        ).rate_kg_ha
        for s in steps
    ]
    return Run(
        [s.tick for s in steps],
        np.array(wanted),
        np.array([s.target_rate_kg_ha for s in steps]),
        setup,
    )


def off_kg_ha(run: Run, after_s: float, before_s: float = float("inf")) -> float:
    """Mean distance of the target at the outlets from what the rule says of the canopy there."""
    rows = [tick.row for tick in run.ticks]
    some = [
        k
        for k, row in enumerate(rows)
        if after_s < row.time_s < before_s
        and row.state == "working"
        and (row.applied_rate_kg_ha or 0.0) > 0.0
    ]
    assert len(some) > 400
    return float(np.mean([abs(run.target_kg_ha[k] - run.wanted_kg_ha[k]) for k in some]))


@pytest.fixture(scope="module")
def by_map() -> Run:
    return driven(True, "silent_later")


@pytest.mark.exam
def test_the_map_goes_on_where_the_heads_fall_silent(by_map: Run) -> None:
    after = [
        tick.row
        for tick in by_map.ticks
        if tick.row.time_s > SILENT_S + 5.0 and tick.row.state == "working"
    ]
    before = [tick.row for tick in by_map.ticks if 25.0 < tick.row.time_s < SILENT_S]
    assert {row.target_source for row in before} == {"canopy"}
    assert {row.target_source for row in after} == {"index_map"} and all(
        row.ndvi is not None for row in after
    )
    assert all(
        "heads_by_map" in (row.alarms or "") and "ndvi_silent" not in (row.alarms or "")
        for row in after
    )
    assert len({row.target_rate_kg_ha for row in after}) > 2, "it follows the canopy"


def test_it_is_levelled_to_the_heads_and_nearer_than_the_fallback(by_map: Run) -> None:
    """A map that reads 0.06 too little: learned while the heads speak."""
    alone = driven(False, "silent_later")
    assert {tick.row.target_source for tick in alone.ticks[-40:]} == {"fallback"}
    near, far = (off_kg_ha(run, SILENT_S + 5.0) for run in (by_map, alone))
    heads = off_kg_ha(by_map, 25.0, SILENT_S)
    print(
        f"from the rule's rate: index map {near:.1f} kg/ha, fallback {far:.1f} kg/ha, heads "
        f"before {heads:.1f}"
    )
    assert near < 0.6 * far


@pytest.mark.exam
def test_a_machine_without_heads_goes_by_the_map_alone() -> None:
    run = driven(True, "never")
    print(f"no heads at all: {off_kg_ha(run, 30.0):.1f} kg/ha from the rule's rate")
    worked = [
        tick.row for tick in run.ticks if tick.row.time_s > 30.0 and tick.row.state == "working"
    ]
    assert {row.target_source for row in worked} == {"index_map"}


def test_where_the_map_has_nothing_the_fallback_holds_and_wild_differences_are_not_taken() -> None:
    plane = TangentPlane(52.0, 9.0)
    under = IndexMap(
        GridMap(make_frame_m((0.0, 0.0), 10.0, 10.0), [[0.5, np.nan], [0.7, 0.6]]), plane, 4.0
    )
    assert (
        under.find_index((5.0, 5.0), 0.0) == pytest.approx(0.5)
        and under.find_index((15.0, 5.0), 0.0) is None
    )
    assert under.find_index((500.0, 5.0), 0.0) is None and under.find_index(
        (10.0, 5.0), 0.0
    ) == pytest.approx(0.5), "half of it"
    for _ in range(50):
        under.learn_offset(0.9, 0.2)
    assert under.head_offset == MAX_OFFSET
    fresh = IndexMap(GridMap(make_frame_m((0.0, 0.0), 10.0, 10.0), [[0.5]]), plane, 4.0)
    for k in range(400):
        fresh.learn_offset(0.55 + 0.02 * (-1) ** k, 0.5)
    assert fresh.head_offset == pytest.approx(0.05, abs=0.002) and fresh.adjust_to_heads(
        0.4
    ) == pytest.approx(0.45, abs=0.002)


def write_tif(
    path: Path, values: np.ndarray, lat: float, lon: float, size_deg: float, name: str | None = None
) -> Path:
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=values.shape[1],
        height=values.shape[0],
        count=1,
        dtype="float32",
        crs="EPSG:4326",
        nodata=-9999.0,
        transform=rasterio.transform.from_origin(lon, lat, size_deg, size_deg),
    ) as file:
        file.write(values.astype(np.float32), 1)
        if name:
            file.set_band_description(1, name)
    return path


@pytest.mark.parametrize("name", [None, "NDVI"])
def test_a_job_names_a_geotiff(tmp_path: Path, name: str | None) -> None:
    """As a satellite gives it: water below 0, a band with or without a name; what is scaled is
    refused."""
    from topdress.drivers.files.prescriptions.job_targets import read_loop_targets
    from topdress.drivers.files.prescriptions.map_choices import PrescriptionError

    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    job: Job = setup.job.model_copy(
        update={"target": setup.job.target.model_copy(update={"index_map": "a.tif"})}
    )
    crop: Crop = setup.crop
    values = np.array([[0.3, 0.4], [-0.1, -9999.0]])
    write_tif(tmp_path / "a.tif", values, 34.282, 119.880, 0.001, name)
    under = read_loop_targets(job, tmp_path, setup.machine, crop.index)["index_map"]
    assert under is not None
    read = [
        under.find_index(
            under.plane.project_to_m(34.282 - 0.0005 - 0.001 * row, 119.8805 + 0.001 * column), 0.0
        )
        for row in (0, 1)
        for column in (0, 1)
    ]
    assert read[:3] == pytest.approx([0.3, 0.4, 0.0]) and read[3] is None
    write_tif(tmp_path / "a.tif", 10_000.0 * values.clip(0.0), 34.282, 119.880, 0.001, name)
    with pytest.raises(PrescriptionError, match="allowed as NDVI is -1 to 1"):
        read_loop_targets(job, tmp_path, setup.machine, crop.index)


# --- The canopy of a whole run at once is the canopy of its ticks
# ----------------------------------------------------


@pytest.mark.parametrize("index", ["ndvi", "ndre"])
def test_means_over_a_run_are_those_of_its_places_to_the_last_bit(index: str) -> None:
    across = HeadRow(CanopyField(Canopy(), (-10.0, 300.0), (-30.0, 400.0), 3), 6, 2.4, index)
    draw = np.random.default_rng(1)
    east, north = draw.uniform(-500.0, 500.0, 400), draw.uniform(-500.0, 900.0, 400)
    heading = draw.choice([0.0, 180.0, 33.3, 271.2], 400)
    places = zip(east.tolist(), north.tolist(), heading.tolist(), strict=True)
    one_by_one = [sum(read) / len(read) for read in (across.read_heads(*place) for place in places)]
    assert across.calc_means(east, north, heading).tolist() == one_by_one


# --- The map's rate as base, the heads' around it within limits; both seen ahead
# -------------------------------------

MAP, BOTH = TargetSource.MAP, TargetSource.MAP_AND_CANOPY


class Base:
    """A map along the track: rates from places on."""

    def __init__(self, *steps: tuple[float, float]) -> None:
        self.steps = [
            (place, Target(rate, MAP if rate >= 0.0 else TargetSource.FALLBACK))
            for place, rate in steps
        ]

    def find_target(self, place_m: float) -> Target:
        return [target for place, target in self.steps if place <= place_m][-1]

    def find_next_change(
        self, after_m: float, before_m: float, holding: Target
    ) -> TargetChange | None:
        for place in (after_m, *(place for place, _ in self.steps if after_m < place <= before_m)):
            if self.find_target(place) != holding:
                return TargetChange(place, self.find_target(place))
        return None


def seen(*stretches: tuple[float, float, float]) -> DecidedStretches:
    found = DecidedStretches(99.0)
    for one in stretches:
        found.append_stretch(*one)
    return found


def test_the_heads_move_the_rate_within_the_limits():
    for around, rates in (
        (RateBounds(20.0), (160.0, 190.0, 240.0)),
        (RateBounds(20.0, 30.0), (170.0, 190.0, 230.0)),
        (RateBounds(0.0), (200.0, 200.0, 200.0)),
        (RateBounds(100.0), (0.0, 190.0, 400.0)),
    ):
        both = MapAndCanopy(
            Base((-1e9, 200.0)), seen((0.0, 2.0, 0.0), (2.0, 4.0, 190.0), (4.0, 6.0, 999.0)), around
        )
        assert tuple(both.find_target(place).rate_kg_ha for place in (1.0, 3.0, 5.0)) == rates
        assert both.find_target(1.0).source is BOTH


def test_without_a_reading_the_map_without_a_map_nothing_changed():
    both = MapAndCanopy(
        Base((-1e9, 200.0), (10.0, 0.0), (20.0, -1.0)),
        seen((0.0, 2.0, 190.0), (11.0, 22.0, 190.0)),
        RateBounds(),
    )
    assert both.find_target(1.0) == Target(190.0, BOTH) and both.find_target(6.0) == Target(
        200.0, MAP
    )
    assert both.find_target(15.0) == Target(0.0, MAP), (
        "where the map says nothing is to fall nothing falls"
    )
    assert both.find_target(21.0).source is TargetSource.FALLBACK


def test_changes_of_either_are_seen_ahead():
    both = MapAndCanopy(
        Base((-1e9, 200.0), (3.0, 300.0)), seen((0.0, 2.0, 190.0), (2.0, 8.0, 280.0)), RateBounds()
    )
    found, place, holding = [], 0.5, both.find_target(0.5)
    while (change := both.find_next_change(place, 12.0, holding)) is not None:
        found.append((change.place_m, round(change.target.rate_kg_ha, 6)))
        place, holding = change.place_m, change.target
    assert found == [(2.0, 240.0), (3.0, 280.0), (9.5, 300.0)], (
        "canopy, map, end of what the heads have seen"
    )


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.5, 4.0), st.sampled_from([0.0, 100.0, 150.0, 300.0])),
        min_size=1,
        max_size=6,
    ),
    st.lists(st.tuples(st.floats(0.5, 4.0), st.floats(0.0, 400.0)), min_size=1, max_size=6),
)
@example([(1.25, 0.0), (3.0, 100.0)], [(2.772422720644507, 0.0)])  # two changes 2 cm apart
def test_following_the_changes_is_being_at_the_places(base, canopy):
    """Property: from change to change one holds what `at` says in between; at the end of what
    the heads have seen at the latest with the next look, as by the canopy alone."""
    places = np.cumsum([way for way, _ in base])
    steps = Base(
        (-1e9, 50.0), *((float(place), rate) for place, (_, rate) in zip(places, base, strict=True))
    )
    stretches, at = DecidedStretches(99.0), 0.0
    for way, rate in canopy:
        stretches.append_stretch(at, at + way, rate)
        at += way
    both, place, holding = MapAndCanopy(steps, stretches, RateBounds()), 0.0, None
    holding, before = both.find_target(0.0), 0.0
    for probe in np.linspace(0.05, 30.0, 120):
        while (change := both.find_next_change(place, probe, holding)) is not None:
            place, holding = change.place_m, change.target
            before = place + 1e-9
        assert holding == both.find_target(probe) or (
            both.find_target(probe).source is MAP and holding == both.find_target(before)
        )
        place = before = probe


@pytest.fixture(scope="module")
def driven_by_both():
    """A pass over 10 m cells of 200 and 300 kg/ha, heads around them within 20 %; 300 m."""
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    job = setup.job.model_copy(update={"target": Wanted(source=BOTH, map="made here")})
    rates = np.where(np.arange(40)[:, None] % 2 == 0, 200.0, 300.0) * np.ones((1, 4))
    grid = Prescription(GridMap(make_frame_m((-20.0, -20.0), 10.0, 10.0), rates), Fallbacks())
    plane = TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
    plant = make_plant(setup.machine, job, 1, 0.05)
    loop = make_control_loop(
        setup.machine, setup.crop, setup.rule, job, prescription=MapProfile(grid, plane)
    )
    record, ticks = RunRecord(), []
    for step in simulate_run(plant, loop, 200.0):
        record.add_tick(step)
        ticks.append(step.tick)
    return ticks, record.make_columns(), grid, record.fired


@pytest.mark.exam
def test_a_run_follows_both(driven_by_both):
    ticks, columns, grid, _ = driven_by_both
    rows = [tick.row for tick in ticks if tick.row.time_s > 25.0]
    assert {row.target_source for row in rows} == {"map_and_canopy"} and all(
        row.ndvi is not None for row in rows
    )
    inside = (columns["working"] > 0) & (columns["time_s"] > 25.0)
    target, north = columns["target_kg_ha"][inside], columns["north_m"][inside]
    base = np.array([grid.find_target((0.0, float(n))).rate_kg_ha for n in north])
    # not where the place is known to centimetres only
    edge = np.abs((north + 20.0) % 10.0 - 5.0) < 4.8
    off = target[edge] / base[edge]
    assert off.min() >= 0.8 - 1e-6 and off.max() <= 1.2 + 1e-6
    assert (off < 0.999).any() and (off > 1.001).any() and off.std() > 0.05


def test_edges_of_the_map_are_made_ahead_of_their_place(driven_by_both):
    """Where both cells are at their limit the step at an edge of the map is made a lag distance
    before it."""
    _, _, _, fired = driven_by_both

    ahead = np.array([one.place_m - one.track_m for one in fired if one.before.rate_kg_ha > 0.0])
    assert len(ahead) > 30 and 1.5 < np.median(ahead) < 3.5, "a lag of some 2 s at 1.25 m/s"


def test_silent_heads_are_an_alarm_and_the_map_goes_on():
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    job = setup.job.model_copy(update={"target": Wanted(source=BOTH, map="made here")})
    grid = Prescription(GridMap(make_frame_m((-20.0, -20.0), 400.0, 400.0), [[200.0]]), Fallbacks())
    plane = TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
    plant = make_plant(setup.machine, job, 1, 0.05)
    loop = make_control_loop(
        setup.machine, setup.crop, setup.rule, job, prescription=MapProfile(grid, plane)
    )
    inner = loop.run_tick

    def deaf(m, *rest):
        return inner(m._replace(ndvi=(None,) * 6) if m.time_s > 40.0 else m, *rest)

    loop.run_tick = deaf
    last = [step.tick for step in simulate_run(plant, loop, 60.0)][-1]
    assert "ndvi_silent" in (last.row.alarms or "") and last.row.target_source == "map"
    assert last.row.target_rate_kg_ha == 200.0 and last.command.shaft_rpm > 5.0


def test_it_is_ordered_only_where_there_is_a_map_and_needs_a_place():
    assert Closed().order(Do.SOURCE, "map_and_canopy").why == "source_not_ready"
    with pytest.raises(ValidationError, match="source map_and_canopy needs the key map"):
        Job(target=Wanted(source=BOTH))
