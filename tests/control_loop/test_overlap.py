"""No double dose, the headland, and what the totals say: through the whole loop on the
simulated machine."""

from __future__ import annotations

import datetime as dt
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from topdress.console.services.replay_rerun import parse_events
from topdress.control.agronomy.nitrogen_rate import prepare_rule
from topdress.control.agronomy.reference_strips import ReferenceStrips, StripMean
from topdress.control.field.coverage import Coverage
from topdress.control.field.job import Ground, Job, Simulated, Wanted
from topdress.control.loop import ControlLoop
from topdress.control.orders import Do, Order, TargetSource
from topdress.control.simulation.assembly import make_control_loop
from topdress.control.simulation.closed_loop import RunRecord, simulate_run
from topdress.control.simulation.error_metrics import find_landing
from topdress.control.simulation.plant import Plant
from topdress.control.simulation.tractor import PathLeg
from topdress.control.simulation.tractor import TractorPath as Way
from topdress.control.targets.done_ground_ahead import DoneGroundAhead, merge_short_runs
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import CROP_KIND
from topdress.drivers.files.run_setup import Setup, load_setup

from tests.control_loop.closed import Closed

WIDTH_M = 2.4
FIELD_M = ((-30.0, -30.0), (60.0, -30.0), (60.0, 90.0), (-30.0, 90.0))


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_setup("huanghai", "demo", dt.date(2014, 3, 7))


def job_of(boundary: tuple[tuple[float, float], ...] = FIELD_M, **more: Any) -> Job:
    ground = {
        name: more.pop(name) for name in ("headland_m", "headland_rate_kg_ha") if name in more
    }
    return Job(
        target=Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=300.0),
        simulated=Simulated(speed_kmh=5.4, passes=1, refill_at_kg=0.0, speed_wander_percent=0.0),
        field=Ground(boundary_m=boundary, **ground),
        **more,
    )


def driven(
    setup: Setup,
    job: Job,
    legs: list[PathLeg],
    seconds: float,
    orders: Any = None,
    notes: list[str] | None = None,
) -> tuple[dict[str, Any], Any, ControlLoop]:
    plant = Plant(setup.machine, job, 1, 0.05, path=Way(legs))
    loop, record = make_control_loop(setup.machine, setup.crop, setup.rule, job), RunRecord()
    for step in simulate_run(plant, loop, seconds, orders):
        record.add_tick(step)
        if notes is not None:
            notes += step.tick.notes
    columns = record.make_columns()
    return columns, find_landing(columns, WIDTH_M), loop


LOOP = [
    PathLeg(0.0, 0.0, 0.0, 50.0, 0.0),
    PathLeg(0.0, 50.0, 0.0, np.pi * 8.0 * 1.5, 270.0),
    PathLeg(8.0, 42.0, 270.0, 60.0, 0.0),
]
"""North, three quarters of a right-hand circle of 8 m, and west across the first leg 42 m up."""


def skipped(columns: dict[str, Any], land: Any) -> list[tuple[float, float]]:
    """Stretches of the way (begin, end) without material, between stretches with some."""
    centres, rate = land.ground.calc_centres_m(), land.landed_kg_ha
    flows = np.flatnonzero(rate > 100.0)
    return [
        (float(centres[a]), float(centres[b])) for a, b in pairwise(flows.tolist()) if b - a > 3
    ]


def test_the_first_pass_is_not_crossed_with_a_second_dose(setup: Setup) -> None:
    notes: list[str] = []
    columns, land, loop = driven(setup, job_of(), LOOP, 80.0, notes=notes)
    assert 20 < notes.count("already_spread") < 60, "1.6 s and the lag"
    crossing = 50.0 + np.pi * 12.0 + 8.0
    found = [gap for gap in skipped(columns, land) if gap[1] > 20.0]
    assert len(found) == 1
    begin, end = found[0]
    assert begin == pytest.approx(crossing - 1.2, abs=0.5)
    assert end == pytest.approx(crossing + 1.2, abs=0.5)
    totals = loop.totals
    assert totals.overlap_ha is not None and totals.overlap_ha * 1e4 < 0.55 * WIDTH_M**2, (
        "run-down and edges"
    )
    assert totals.covered_ha == pytest.approx(totals.area_ha, rel=0.06)
    assert totals.metres_left_m == pytest.approx(
        (300.0 - totals.applied_kg) / (300.0 * WIDTH_M / 1e4), rel=0.01
    )
    assert totals.applied_n_kg == pytest.approx(totals.applied_kg * setup.crop.product_n_fraction)


@pytest.mark.exam
@pytest.mark.parametrize("how", ["job", "order"])
def test_switched_off_it_is_crossed_like_any_ground(setup: Setup, how: str) -> None:
    orders = [(1.0, Order(Do.READY)), (4.0, Order(Do.START))]
    if how == "order":
        orders.append((20.0, Order(Do.NO_DOUBLE, False)))
    columns, land, loop = driven(setup, job_of(no_double=how == "order"), LOOP, 80.0, orders)
    assert not [gap for gap in skipped(columns, land) if gap[1] > 20.0]
    assert loop.totals.overlap_ha is not None
    assert loop.totals.overlap_ha * 1e4 == pytest.approx(WIDTH_M**2, rel=0.15)
    assert loop.handle_order(Order(Do.NO_DOUBLE, "no")).why == "yes_or_no"


def test_neighbouring_passes_are_no_overlap(setup: Setup) -> None:
    legs = [
        PathLeg(0.0, 0.0, 0.0, 40.0, 0.0),
        PathLeg(0.0, 40.0, 0.0, np.pi * 1.2, 180.0),
        PathLeg(WIDTH_M, 40.0, 180.0, 60.0, 0.0),
    ]
    columns, land, _ = driven(setup, job_of(), legs, 60.0)
    assert not [gap for gap in skipped(columns, land) if gap[0] > 46.0]


@pytest.mark.exam
def test_the_headland_has_its_own_rate_or_none(setup: Setup) -> None:
    square = ((-20.0, 0.0), (20.0, 0.0), (20.0, 60.0), (-20.0, 60.0))
    way = [PathLeg(0.0, -20.0, 0.0, 120.0, 0.0)]
    for rate in (0.0, 150.0):
        notes: list[str] = []
        job = job_of(square, headland_m=12.0, headland_rate_kg_ha=rate)
        _, land, _ = driven(setup, job, way, 70.0, notes=notes)
        assert 250 < notes.count("on_headland") < 1100, (
            "said where it is, not in the middle of the field"
        )
        place = land.ground.calc_centres_m() - 20.0
        inner = land.landed_kg_ha[(place > 13.0) & (place < 47.0)]
        head = land.landed_kg_ha[
            ((place > 1.0) & (place < 11.0)) | ((place > 49.0) & (place < 59.0))
        ]
        outside = land.landed_kg_ha[(place < -1.0) | (place > 61.0)]
        assert inner.mean() == pytest.approx(300.0, rel=0.03)
        assert head.mean() == pytest.approx(rate, abs=8.0)
        assert outside.mean() < 1.0


def test_a_headland_that_leaves_nothing_is_said(setup: Setup) -> None:
    job = job_of(((0, 0), (40, 0), (40, 40), (0, 40)), headland_m=25.0)
    with pytest.raises(ValueError, match=r"headland_m 25: leaves nothing"):
        make_control_loop(setup.machine, setup.crop, setup.rule, job)


def test_short_runs_take_the_value_before_them() -> None:
    flags = np.array([0, 0, 0, 1, 0, 0, 1, 1, 1, 0, 1, 1], dtype=bool)
    assert merge_short_runs(flags, 2).astype(int).tolist() == [0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1]
    assert merge_short_runs(np.zeros(4, dtype=bool), 2).tolist() == [False] * 4


def test_edges_of_done_ground_lie_where_they_are_seen() -> None:
    coverage = Coverage(WIDTH_M)
    for k in range(400):
        coverage.extend_to((0.1 * k - 20.0, 10.0), 90.0, True)
    coverage.extend_to((200.0, 200.0), 0.0, False)
    overlap = DoneGroundAhead(coverage, 6)
    overlap.look_ahead(5.0, (0.0, 0.0), 0.0, float("-inf"))
    assert overlap.places_m == pytest.approx([5.0 + 8.8, 5.0 + 11.2], abs=0.26)
    assert overlap.is_inside(10.0) and not overlap.is_inside(15.0) and overlap.is_inside(16.5)
    overlap.look_ahead(15.0, (0.0, 10.0), 0.0, float("-inf"))
    assert not overlap.is_inside(15.0) and overlap.is_inside(17.0)
    overlap.record_start()
    overlap.look_ahead(15.0, (0.0, 10.0), 0.0, float("-inf"))
    assert overlap.is_inside(15.0), "ordered to start on done ground: it gets some"
    overlap.look_ahead(17.0, (0.0, 12.0), 0.0, float("-inf"))
    overlap.look_ahead(13.0, (0.0, 8.0), 0.0, float("-inf"))
    assert not overlap.is_inside(14.5), "once off it, it is done ground again"
    overlap.look_ahead(15.0, None, None, float("-inf"))
    assert overlap.is_inside(15.0), "no place known: nothing counts as done"


def test_start_lifts_ground_of_this_run_only() -> None:
    earlier = Coverage(WIDTH_M, 0.25)
    for k in range(400):
        earlier.extend_to((0.1 * k - 20.0, 10.0), 90.0, True)
    overlap = DoneGroundAhead(Coverage(WIDTH_M), 6)
    overlap.add_earlier_ground(earlier.make_raster())
    overlap.record_start()
    overlap.look_ahead(15.0, (0.0, 10.0), 0.0, float("-inf"))
    assert not overlap.is_inside(15.0) and overlap.is_inside(17.0)
    assert overlap.is_done_earlier((0.0, 10.0)) and not overlap.is_done_earlier((0.0, 13.0))


# --- A strip that is measured on the way counts from the next decision on; the log says so, and
# a rerun takes... -----


@pytest.fixture
def field_crop():
    crop = load_config("osu_winter_wheat_2007", CROP_KIND).model
    return crop.model_copy(update={"ndvi_nrich": None, "ndvi_check": None})


def run(crop, seconds, orders=()):
    """Rows of a run on the shipped day with another crop; the operator begins at once."""
    begin = [(0.2, Order(Do.READY)), (2.0, Order(Do.START))]
    closed = Closed(sim={"begin_m": 30.0}, known={"crop": crop, "rule": prepare_rule(crop, 100)})
    return [step.tick for step in closed.through(seconds, [*begin, *orders])]


@pytest.mark.exam
def test_both_strips_count_without_a_new_start(field_crop):
    told = [StripMean("nrich", 0.66, 0.004, 40), StripMean("check", 0.55, 0.005, 38)]
    ticks = run(
        field_crop,
        40.0,
        [(15.0, Order(Do.STRIP, told[0].event_text)), (20.0, Order(Do.STRIP, told[1].event_text))],
    )
    sources = [
        (tick.row.time_s, tick.row.target_source) for tick in ticks if tick.row.state == "working"
    ]
    assert {name for at_s, name in sources if 5.0 < at_s < 20.0} == {"fallback"}, (
        "no strips, no decision"
    )
    assert {name for at_s, name in sources if at_s > 30.0} == {"canopy"}
    assert ticks[-1].strips == ReferenceStrips(0.66, 0.55)
    rule = prepare_rule(field_crop, 100, 0.66, 0.55)
    rates = [tick.row.target_rate_kg_ha for tick in ticks if tick.row.time_s > 32.0]
    # 0 beyond the N-rich strip's
    decided = [rule.decide_rate(ndvi).rate_kg_ha for ndvi in np.linspace(0.36, 0.68, 33)]
    assert min(decided) <= min(rates) <= max(rates) < max(decided) and np.ptp(rates) > 5.0
    events = [tick.row.events for tick in ticks if tick.row.events and "strip" in tick.row.events]
    assert events == [f"strip {one.event_text}" for one in told]
    assert [parse_events(event) for event in events] == [
        [Order(Do.STRIP, one.event_text)] for one in told
    ], "a rerun's order"


def test_what_is_no_ndvi_is_refused_and_changes_nothing(field_crop):
    loop = Closed(known={"crop": field_crop, "rule": prepare_rule(field_crop, 100)}).loop
    for value in ("nrich 0", "nrich 1.2", "rich 0.6", 0.6, None):
        answer = loop.handle_order(Order(Do.STRIP, value))
        assert not answer.accepted and answer.why == "strip_out_of_range"
    assert loop.handle_order(Order(Do.STRIP, "nrich 0.6")).accepted
