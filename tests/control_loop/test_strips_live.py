"""A strip that is measured on the way counts from the next decision on; the log says so, and a rerun takes it too."""
from __future__ import annotations

import datetime as dt

import numpy as np
import pytest

from console.services.rerun import parse_events
from control.agronomy.noa import prepare
from control.agronomy.strips import Strips, StripValue
from control.orders import Do, Order
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.closed_loop import simulated_run
from drivers.files.config import load
from drivers.files.kinds import CROP
from drivers.files.setup import load_setup


@pytest.fixture
def field_crop():
    crop = load("osu_winter_wheat_2007", CROP).model
    return crop.model_copy(update={"ndvi_nrich": None, "ndvi_check": None})


def run(crop, seconds, orders=()):
    """Rows of a run on the shipped day with another crop; the operator begins at once."""
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    job = with_simulated_field(setup.job.model_copy(update={
        "simulated": setup.job.simulated.model_copy(update={"begin_m": 30.0})}), setup.machine)
    rule = prepare(crop, 100)
    begin = [(0.2, Order(Do.READY)), (2.0, Order(Do.START))]
    plant = simulated_machine(setup.machine, job, 1, 0.05)
    loop = control_loop(setup.machine, crop, rule, job)
    return [step.tick for step in simulated_run(plant, loop, seconds, [*begin, *orders])]


def test_both_strips_count_without_a_new_start(field_crop):
    told = [StripValue("nrich", 0.66, 0.004, 40), StripValue("check", 0.55, 0.005, 38)]
    ticks = run(field_crop, 40.0, [(15.0, Order(Do.STRIP, told[0].text)), (20.0, Order(Do.STRIP, told[1].text))])
    sources = [(tick.row.time_s, tick.row.target_source) for tick in ticks if tick.row.state == "working"]
    assert {name for at_s, name in sources if 5.0 < at_s < 20.0} == {"fallback"}, "no strips, no decision"
    assert {name for at_s, name in sources if at_s > 30.0} == {"canopy"}
    assert ticks[-1].strips == Strips(0.66, 0.55)
    rule = prepare(field_crop, 100, 0.66, 0.55)
    rates = [tick.row.target_rate_kg_ha for tick in ticks if tick.row.time_s > 32.0]
    low, high = (rule.decide(ndvi).rate_kg_ha for ndvi in (0.36, 0.68))
    assert low < min(rates) <= max(rates) < high and np.ptp(rates) > 5.0
    events = [tick.row.events for tick in ticks if tick.row.events and "strip" in tick.row.events]
    assert events == [f"strip {one.text}" for one in told]
    assert [parse_events(event) for event in events] == [[Order(Do.STRIP, one.text)] for one in told], "a rerun's order"


def test_what_is_no_ndvi_is_refused_and_changes_nothing(field_crop):
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    loop = control_loop(setup.machine, field_crop, prepare(field_crop, 100), setup.job)
    for value in ("nrich 0", "nrich 1.2", "rich 0.6", 0.6, None):
        answer = loop.order(Order(Do.STRIP, value))
        assert not answer.accepted and answer.why == "strip_out_of_range"
    assert loop.order(Order(Do.STRIP, "nrich 0.6")).accepted
