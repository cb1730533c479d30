"""What the scale teaches: how soon, how sure, and nothing that is not so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import exp, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from topdress.control.field.job import Job, Wanted
from topdress.control.field.job_totals import Totals, TotalSums
from topdress.control.machine.model_elements import Array
from topdress.control.metering.flow_trim import FlowTrim
from topdress.control.metering.trims import DriveTrim, TrimLimits
from topdress.control.readings import Reading
from topdress.control.simulation.closed_loop import RunRecord
from topdress.control.simulation.error_metrics import find_crop_needs, find_landing, judge_run
from topdress.control.simulation.tractor import make_field_path
from topdress.control.targets.canopy_target import (
    HOLD_HORIZON_M,
    MAX_DEFICIT_SHARE,
    MAX_FACTOR,
    MIN_FACTOR,
    MeanRateHold,
)

from tests.control_loop.closed import SETUP, Closed

# 5.5 g a millimetre at 22 mm: 0.14 kg/s; ordered 0.09 in the field
DT_S, RPM, G_REV = 0.1, 70.0, 121.0


class Learnt(NamedTuple):
    trim: Array  # (n,) by tick
    right: Array  # (n,): what it would have to be

    def back_s(self, share: float = 0.8, from_s: float = 0.0) -> float:
        """Seconds until that share of the error is taken back."""
        first = round(from_s / DT_S)
        off = (
            np.abs(self.trim - self.right)[first:]
            <= (1.0 - share) * np.abs(self.right - 1.0)[first:]
        )
        return float(np.argmax(off)) * DT_S if off.any() else float("inf")


def work(
    seconds: float,
    seed: int,
    true: Callable[[float, float, float], tuple[float, float]],
    slope_deg: float = 0.0,
    grams: float = 0.64 * G_REV,
    stands_s: float = 0.0,
) -> Learnt:
    """Work with an opening that follows the canopy; `true`: (time, g per revolution, pitch) to
    what really flows, g per revolution, and what the scale reads too much. The scale: 0.15 kg,
    correlated over 1 s, steps of 0.05 kg."""
    rng, trim, hopper, noise, pitch = np.random.default_rng(seed), FlowTrim(), 300.0, 0.0, 0.0
    keep, made, right = exp(-DT_S), [], []
    for k in range(round(seconds / DT_S)):
        now = k * DT_S
        by_model = grams * (1.0 + 0.15 * sin(now / 7.0) + 0.1 * sin(now / 2.3))
        pitch += -DT_S / 3.0 * pitch + 0.5 * sqrt(2.0 * DT_S / 3.0) * float(rng.standard_normal())
        nose = pitch + (slope_deg if sin(2.0 * pi * now / 480.0) > 0.0 else -slope_deg)
        flows, more_kg = true(now, by_model, nose)
        rpm = RPM if now >= stands_s else 0.0
        hopper -= flows * rpm / 60_000.0 * DT_S
        noise = keep * noise + sqrt(1.0 - keep * keep) * 0.15 * float(rng.standard_normal())
        weighed = round((hopper + more_kg + noise) / 0.05) * 0.05
        trim.update_trim(now, DT_S, by_model * rpm / 60_000.0, rpm, nose, Reading(weighed, now))
        made.append(trim.present_factor)
        right.append(flows / by_model)
    return Learnt(np.array(made), np.array(right))


def test_six_per_cent_more_are_taken_back_in_two_minutes() -> None:
    """From the start of work, after half a minute in which the scale stood. 240 s and a half of
    it, once: a window of 15 kg, half believed."""
    runs = [
        work(270.0, seed, lambda now, grams, pitch: (1.06 * grams, 0.0), stands_s=30.0)
        for seed in range(6)
    ]
    assert np.median([run.back_s(from_s=30.0) for run in runs]) < 120.0
    assert max(run.back_s(from_s=30.0) for run in runs) < 200.0
    assert max(np.abs(run.trim - 1.06)[-200:].max() for run in runs) < 0.015


@pytest.mark.exam
def test_a_healthy_machine_is_left_alone() -> None:
    """Also in its first minute, when a straight line through the scale's noise says anything
    from -5 to +5 %."""
    starts = [work(150.0, seed, lambda now, grams, pitch: (grams, 0.0)) for seed in range(6)]
    assert np.mean([np.abs(run.trim - 1.0).mean() for run in starts]) < 0.003
    assert sum(np.abs(run.trim - 1.0).max() > 0.01 for run in starts) <= 1
    hour = work(2700.0, 7, lambda now, grams, pitch: (grams, 0.0))
    assert np.abs(hour.trim - 1.0).max() < 0.01 and abs(hour.trim.mean() - 1.0) < 0.003


def test_it_says_how_sure_it_is() -> None:
    trim = FlowTrim()
    begin = trim.flow_sd_percent
    for k in range(3000):
        now = k * DT_S
        trim.update_trim(now, DT_S, 0.1, RPM, 0.0, Reading(300.0 - 0.1 * now, now))
    assert begin > 4.0 and trim.flow_sd_percent < 0.5


def test_what_flows_more_a_revolution_is_told_from_a_gain_where_the_opening_changes() -> None:
    run = work(900.0, 3, lambda now, grams, pitch: (grams + 5.0, 0.0))
    assert np.abs(run.trim - run.right)[-3000:].mean() < 0.006 and np.std(run.right[-3000:]) > 0.008


@pytest.mark.exam
def test_a_slope_is_told_from_a_gain() -> None:
    run = work(
        1500.0, 4, lambda now, grams, pitch: (grams * (1.0 + 0.007 * pitch), 0.0), slope_deg=5.0
    )
    assert (
        np.abs(run.right - 1.0).mean() > 0.03
        and np.abs(run.trim - run.right)[-5000:].mean() < 0.006
    )


def test_a_man_on_the_hopper_is_not_taken_for_flow() -> None:
    """He looks like a refill, perhaps of another lot, and is soon found to be none."""
    run = work(420.0, 6, lambda now, grams, pitch: (grams, 80.0 if 200.0 < now < 260.0 else 0.0))
    assert np.abs(run.trim - 1.0).max() < 0.03 and np.abs(run.trim - 1.0)[-300:].max() < 0.005


def test_a_noisier_scale_than_the_file_says_slows_it_down() -> None:
    rough = np.random.default_rng(8).standard_normal(3000)
    runs = [
        work(300.0, seed, lambda now, grams, pitch: (grams, 0.8 * float(rough[round(now / DT_S)])))
        for seed in (8, 9, 10)
    ]
    assert np.mean([np.abs(run.trim - 1.0).mean() for run in runs]) < 0.012


def test_a_refill_begins_a_new_level_and_perhaps_a_new_lot() -> None:
    trim = FlowTrim()
    for k in range(3000):
        now = k * DT_S
        more = 0.0 if now < 150.0 else 200.0
        trim.update_trim(now, DT_S, 0.1, RPM, 0.0, Reading(250.0 - 0.105 * now + more, now))
        if k == 1499:
            sure = trim.flow_sd_percent
        if k == 1510:
            assert trim.flow_sd_percent > sure + 1.0
    assert trim.present_factor == pytest.approx(1.05, abs=0.01)


# --- What the host's trim of the shaft learns from a shaft that is jammed: nothing
# -----------------------------------


@pytest.mark.parametrize(
    ("measured_rpm", "learnt"), [(0.0, 0.0), (45.0, 0.0), (55.0, 0.1), (66.5, 0.03), (95.0, 0.0)]
)
def test_a_jammed_shaft_teaches_nothing_and_a_slow_one_does(
    measured_rpm: float, learnt: float
) -> None:
    trim = DriveTrim(TrimLimits(), still=1.0)
    for tick in range(72):  # 3 s after it has settled
        now_s = 0.05 * tick
        trim.update_trims(
            now_s, 0.05, 70.0, Reading(measured_rpm, now_s), 25.0, Reading(25.0, now_s)
        )
    assert trim.shaft_share == pytest.approx(learnt, abs=0.002)


# --- The field's mean held at a given rate while the canopy says where: it comes out, and it
# cannot run away ---------

PASSES, LENGTH_M = 4, 120.0
FIELD_HA = PASSES * LENGTH_M * 2.4 / 10_000.0


def worked(
    mean_kg_ha: float | None, seed: int, **canopy: float
) -> tuple[float, dict[str, np.ndarray], Totals]:
    """What came to lie on a small field, mean in kg/ha; the run's columns, and what the
    operator is told."""
    ground = SETUP.job.simulated.canopy.model_dump() | canopy
    closed = Closed(
        sim={"passes": PASSES, "pass_length_m": LENGTH_M, "canopy": ground},
        seed=seed,
        target=SETUP.job.target.model_copy(update={"hold_mean_kg_ha": mean_kg_ha}),
    )
    record = RunRecord()
    for step in closed.through(
        make_field_path(closed.job.simulated, 2.4, 0.0).length_m / 1.25 + 5.0
    ):
        record.add_tick(step)
    columns = record.make_columns()
    return float((columns["flow_kg_s"] * 0.05).sum()) / FIELD_HA, columns, closed.loop.totals


@pytest.mark.parametrize(
    ("mean_kg_ha", "seed"), [(250.0, 1), pytest.param(150.0, 3, marks=pytest.mark.exam)]
)
@pytest.mark.exam
def test_the_field_ends_at_its_mean_and_keeps_its_pattern(mean_kg_ha, seed):
    found, columns, totals = worked(mean_kg_ha, seed)
    assert found == pytest.approx(mean_kg_ha, rel=0.02)
    assert totals.area_ha == pytest.approx(FIELD_HA, rel=0.02), (
        "a standing shaft's noise on the turns is no work"
    )
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


@example([(5e-324, 0.5, 0.0)], 5.0)
@settings(deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.0, 500.0), st.floats(0.1, 20.0), st.floats(0.0, 3.0)), max_size=60
    ),
    st.floats(5.0, 500.0),
)
def test_whatever_lands_it_stays_within_its_bounds(steps, mean):
    """Rates decided, ways, and what share of the decided rate came out."""
    hold = MeanRateHold(mean)
    hold.is_learning = True
    for rule, way_m, share in steps:
        rate = hold.scale_decision(rule, way_m)
        assert 0.0 <= rate <= MAX_FACTOR * rule + 1e-9
        assert rate >= MIN_FACTOR * rule - 1e-9 or rate == 0.0
        hold.record_landed(share * rate, way_m)
        assert abs(hold.owed_kg_ha) <= MAX_DEFICIT_SHARE * mean + 1e-9


def test_a_bare_half_is_not_made_up_on_the_other():
    """300 m without crop: nothing there; afterwards at most a half more than the mean, for some
    hundred metres."""
    hold = MeanRateHold(200.0)
    hold.is_learning = True
    for _ in range(100):
        hold.record_landed(hold.scale_decision(300.0, 1.0), 1.0)
    for _ in range(300):
        assert hold.scale_decision(0.0, 1.0) == 0.0
        hold.record_landed(0.0, 1.0)
    assert hold.owed_kg_ha == MAX_DEFICIT_SHARE * 200.0
    rates = []
    for _ in range(1000):
        rates.append(hold.scale_decision(300.0, 1.0))
        hold.record_landed(rates[-1], 1.0)
    assert max(rates) == pytest.approx(1.5 * 200.0, rel=0.01) and rates[-1] == pytest.approx(
        200.0, rel=0.02
    )


def test_a_drive_that_gives_less_is_made_good():
    """10 % too little comes out of the machine: within some horizons the mean is as ordered."""
    hold, given_kg = MeanRateHold(200.0), 0.0
    hold.is_learning = True
    for _ in range(2000):
        rate = 0.9 * hold.scale_decision(250.0, 1.0)
        given_kg += rate
        hold.record_landed(rate, 1.0)
    assert rate == pytest.approx(200.0, rel=0.01)
    assert (
        given_kg / 2000.0 == pytest.approx(200.0, rel=0.02)
        and hold.owed_kg_ha * HOLD_HORIZON_M < 0.03 * 2000.0 * 200.0
    )


def test_before_work_begins_nothing_is_learned_and_by_another_source_nothing_changed():
    hold = MeanRateHold(200.0)
    assert hold.scale_decision(100.0, 1.0) == 200.0 and hold.scale_decision(400.0, 1.0) == 200.0, (
        "no mean yet: each is the mean"
    )
    hold.is_active = False
    assert hold.scale_decision(123.0, 1.0) == 123.0
    hold.record_landed(0.0, 500.0)
    assert hold.owed_kg_ha == 0.0


def test_a_job_that_goes_on_knows_what_it_owes():
    loop = Closed(target=Wanted(hold_mean_kg_ha=200.0)).loop
    assert loop._ahead.hold is not None
    from topdress.control.field.coverage import Coverage

    loop.resume_job(
        TotalSums(area_ha=0.024, kg=0.024 * 150.0), Coverage(2.4, 0.4).make_raster(), None
    )
    assert loop._ahead.hold.owed_kg_ha * HOLD_HORIZON_M == pytest.approx(50.0 * 100.0)


def test_only_the_canopy_has_no_mean_of_its_own():
    with pytest.raises(
        ValidationError, match="hold_mean_kg_ha goes with source canopy, not manual"
    ):
        Job(target=Wanted(source="manual", hold_mean_kg_ha=200.0))


# --- Three rate errors: against what was held, the graded and the smooth need of the canopy
# --------------------------


@pytest.mark.exam
def test_held_is_what_the_machine_does_and_the_needs_are_what_the_crop_gets(simulated: Any) -> None:
    found = simulated(60.0).errors
    assert (
        0.0
        < found.rate_error_percent
        < found.graded_error_percent
        < found.smooth_error_percent
        < 15.0
    )
    assert found.smooth_error_kg_ha > found.graded_error_kg_ha > found.rate_error_kg_ha


def test_without_grades_both_needs_are_one(simulated: Any) -> None:
    run = simulated(60.0)
    smooth = replace(run.rule, crop=run.rule.crop.model_copy(update={"grades": False}))
    one = judge_run(run.record.make_columns(), run.record.fired, run.width_m, rule=smooth)
    assert one.graded_error_kg_ha == pytest.approx(one.smooth_error_kg_ha)
    assert one.smooth_error_kg_ha == pytest.approx(run.errors.smooth_error_kg_ha)


def test_without_a_rule_there_is_no_need(simulated: Any) -> None:
    run = simulated(60.0)
    one = judge_run(run.record.make_columns(), run.record.fired, run.width_m)
    assert one.rate_error_percent == run.errors.rate_error_percent
    assert one.graded_error_percent is None and one.smooth_error_percent is None


def test_what_lands_as_needed_has_no_error_against_the_need(simulated: Any) -> None:
    run = simulated(60.0)
    columns = run.record.make_columns()
    rows = columns["in_pass"] > 0.0
    graded = np.array(
        [run.rule.decide_rate(value).rate_kg_ha for value in columns["ndvi"].tolist()]
    )
    columns |= {
        "drop_s": 0.0 * graded,
        "settled_drop_s": 0.0 * graded,
        "flow_kg_s": graded * run.width_m * np.abs(columns["speed_mps"]) / 10_000.0 * rows,
    }
    inside = find_landing(columns, run.width_m).inside > 0.0
    again = judge_run(columns, [], run.width_m, rule=run.rule)
    assert inside.sum() > 50
    assert again.graded_error_percent < 0.3 * run.errors.graded_error_percent
    assert again.smooth_error_percent > 3.0 * again.graded_error_percent


def test_needs_are_the_crops_rule() -> None:
    from topdress.control.agronomy.nitrogen_rate import prepare_rule
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import CROP_KIND

    rule = prepare_rule(load_config("huanghai_wheat", CROP_KIND).model)
    found = find_crop_needs(rule, np.array([0.2, 0.512, 0.55, 0.9]))
    assert found.graded_kg_ha[1] == rule.decide_rate(0.512).rate_kg_ha
    assert found.smooth_kg_ha[1] > found.graded_kg_ha[1], (
        "a grade's rate is taken at its upper edge: too low inside"
    )
    assert found.smooth_kg_ha[2] == pytest.approx(found.graded_kg_ha[2])
    assert list(found.graded_kg_ha[[0, 3]]) == list(found.smooth_kg_ha[[0, 3]]) == [0.0, 0.0]
