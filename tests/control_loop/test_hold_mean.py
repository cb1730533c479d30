"""The field's mean held at a given rate while the canopy says where: it comes out, and it cannot run away."""
from __future__ import annotations

import datetime as dt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from control.field.job import Job, Wanted
from control.field.totals import Sums, Totals
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.closed_loop import Record, simulated_run
from control.simulation.tractor import field_path
from control.targets.hold_mean import HORIZON_M, LEAST_FACTOR, MOST_FACTOR, MOST_OWED, HoldMean
from drivers.files.setup import load_setup

PASSES, LENGTH_M = 4, 120.0
FIELD_HA = PASSES * LENGTH_M * 2.4 / 10_000.0


def worked(mean_kg_ha: float | None, seed: int, **canopy: float) -> tuple[float, dict[str, np.ndarray], Totals]:
    """What came to lie on a small field, mean in kg/ha; the run's columns, and what the operator is told."""
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    ground = setup.job.simulated.canopy.model_copy(update=canopy)
    sim = setup.job.simulated.model_copy(update={"passes": PASSES, "pass_length_m": LENGTH_M, "canopy": ground})
    job = with_simulated_field(setup.job.model_copy(update={
        "simulated": sim, "target": setup.job.target.model_copy(update={"hold_mean_kg_ha": mean_kg_ha})}),
        setup.machine)
    plant = simulated_machine(setup.machine, job, seed, 0.05)
    loop = control_loop(setup.machine, setup.crop, setup.rule, job)
    record = Record()
    for step in simulated_run(plant, loop, field_path(sim, 2.4, 0.0).length_m / 1.25 + 5.0):
        record.add(step)
    columns = record.columns()
    return float((columns["flow_kg_s"] * 0.05).sum()) / FIELD_HA, columns, loop.totals


@pytest.mark.parametrize(("mean_kg_ha", "seed"), [
    (250.0, 1), pytest.param(150.0, 3, marks=pytest.mark.exam)])
def test_the_field_ends_at_its_mean_and_keeps_its_pattern(mean_kg_ha, seed):
    found, columns, totals = worked(mean_kg_ha, seed)
    assert found == pytest.approx(mean_kg_ha, rel=0.02)
    assert totals.area_ha == pytest.approx(FIELD_HA, rel=0.02), "a standing shaft's noise on the turns is no work"
    assert totals.mean_rate_kg_ha == pytest.approx(mean_kg_ha, rel=0.03)
    inside = (columns["working"] > 0) & (columns["in_pass"] > 0) & (columns["target_kg_ha"] > 0)
    ndvi, target = columns["ndvi"][inside], columns["target_kg_ha"][inside]
    assert np.corrcoef(ndvi, target)[0, 1] < -0.7, "thin places get more, as by the rule"
    assert target.std() > 0.1 * mean_kg_ha


@pytest.mark.exam
def test_without_it_the_rule_says_how_much():
    """What it is worth: the same field by the rule alone."""
    found, _, _ = worked(None, 1)
    assert found > 300.0


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 500.0), st.floats(0.1, 20.0), st.floats(0.0, 3.0)), max_size=60),
       st.floats(5.0, 500.0))
def test_whatever_lands_it_stays_within_its_bounds(steps, mean):
    """Rates decided, ways, and what share of the decided rate came out."""
    hold = HoldMean(mean)
    hold.learns = True
    for rule, way_m, share in steps:
        rate = hold.decided(rule, way_m)
        assert 0.0 <= rate <= MOST_FACTOR * rule + 1e-9
        assert rate >= LEAST_FACTOR * rule - 1e-9 or rate == 0.0
        hold.landed(share * rate, way_m)
        assert abs(hold.owed_kg_ha) <= MOST_OWED * mean + 1e-9


def test_a_bare_half_is_not_made_up_on_the_other():
    """300 m without crop: nothing there; afterwards at most a half more than the mean, for some hundred metres."""
    hold = HoldMean(200.0)
    hold.learns = True
    for _ in range(100):
        hold.landed(hold.decided(300.0, 1.0), 1.0)
    for _ in range(300):
        assert hold.decided(0.0, 1.0) == 0.0
        hold.landed(0.0, 1.0)
    assert hold.owed_kg_ha == MOST_OWED * 200.0
    rates = []
    for _ in range(1000):
        rates.append(hold.decided(300.0, 1.0))
        hold.landed(rates[-1], 1.0)
    assert max(rates) == pytest.approx(1.5 * 200.0, rel=0.01) and rates[-1] == pytest.approx(200.0, rel=0.02)


def test_a_drive_that_gives_less_is_made_good():
    """10 % too little comes out of the machine: within some horizons the mean is as ordered."""
    hold, given_kg = HoldMean(200.0), 0.0
    hold.learns = True
    for _ in range(2000):
        rate = 0.9 * hold.decided(250.0, 1.0)
        given_kg += rate
        hold.landed(rate, 1.0)
    assert rate == pytest.approx(200.0, rel=0.01)
    assert given_kg / 2000.0 == pytest.approx(200.0, rel=0.02) and hold.owed_kg_ha * HORIZON_M < 0.03 * 2000.0 * 200.0


def test_before_work_begins_nothing_is_learned_and_by_another_source_nothing_changed():
    hold = HoldMean(200.0)
    assert hold.decided(100.0, 1.0) == 200.0 and hold.decided(400.0, 1.0) == 200.0, "no mean yet: each is the mean"
    hold.on = False
    assert hold.decided(123.0, 1.0) == 123.0
    hold.landed(0.0, 500.0)
    assert hold.owed_kg_ha == 0.0


def test_a_job_that_goes_on_knows_what_it_owes():
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    job = setup.job.model_copy(update={"target": Wanted(hold_mean_kg_ha=200.0)})
    loop = control_loop(setup.machine, setup.crop, setup.rule, job)
    assert loop._ahead.hold is not None
    from control.field.coverage import Coverage
    loop.go_on(Sums(area_ha=0.024, kg=0.024 * 150.0), 1.0, Coverage(2.4, 0.4).raster(), None)
    assert loop._ahead.hold.owed_kg_ha * HORIZON_M == pytest.approx(50.0 * 100.0)


def test_only_the_canopy_has_no_mean_of_its_own():
    with pytest.raises(ValidationError, match="hold_mean_kg_ha goes with source canopy, not manual"):
        Job(target=Wanted(source="manual", hold_mean_kg_ha=200.0))
