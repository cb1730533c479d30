"""What an effect costs in the field: through the model, the same for run logs and for bench
tables."""

from __future__ import annotations

import numpy as np
import pytest
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.runs import log, stages
from topdress.control.diagnosis.runs.cost import calc_field_cost
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.diagnosis.tables import report as tables
from topdress.control.diagnosis.tables.table_series import SizedEffect, TableCandidate
from topdress.control.machine.machine import Machine

SPEED_MPS = 1.25


def a_log(shaft_rpm, seconds=400.0):
    """Columns of a run at the set-points, or at shaft speeds that change every five seconds;
    all readings plain."""
    time_s = np.arange(0.0, seconds, 0.1)
    machine, rng = Machine(), np.random.default_rng(3)
    asked = (
        np.full(len(time_s), shaft_rpm)
        if np.isscalar(shaft_rpm)
        else shaft_rpm[(time_s / 5.0).astype(int)]
    )
    opening_mm = np.full(len(time_s), machine.set_points.opening_mm)
    used_kg = np.cumsum(5.5e-3 * asked * opening_mm / 60.0) * 0.1
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": asked,
        "shaft_rpm": asked + 0.1 * rng.standard_normal(len(time_s)),
        "opening_mm_cmd": opening_mm,
        "opening_mm": opening_mm + 0.02 * rng.standard_normal(len(time_s)),
        "hopper_kg": 290.0 - used_kg + 0.05 * rng.standard_normal(len(time_s)),
        "pitch_deg": 0.0 * time_s,
        "speed_mps": SPEED_MPS + 0.01 * rng.standard_normal(len(time_s)),
        "wheel_speed_mps": SPEED_MPS + 0.01 * rng.standard_normal(len(time_s)),
    }


def data_of(columns):
    return stages.make_run_data(log.clean_run_log(columns), Machine())


@pytest.mark.parametrize(
    ("effect", "size", "percent"),
    [
        (effects.SCALE_GAIN, 2.0, -1.96),
        (effects.FLOW_GAIN, 6.0, 6.0),
        (effects.SPEED_WHEEL_RADIUS, -1.5, -1.5),
        (effects.SPEED_WHEEL_SLIP, 2.0, 2.0),
        (effects.FLOW_ZERO_OFFSET, 4.0, None),
        (effects.FLOW_FILL_FALLOFF, 8.0, None),
    ],
)
def test_runs_and_tables_tell_the_same_dose_at_the_same_operating_point(effect, size, percent):
    machine = Machine()
    of_run = calc_field_cost(
        EffectInstance(effect.id, size), machine, data_of(a_log(machine.set_points.shaft_rpm))
    )
    of_table = tables.calc_table_field_cost(
        machine, SizedEffect(TableCandidate(effect.id), size), SPEED_MPS
    )
    assert of_run.rate_error_percent == pytest.approx(of_table.rate_error_percent, abs=0.02)
    if percent is not None:
        assert of_run.rate_error_percent == pytest.approx(percent, abs=0.02)
    assert of_run.place_error_m == of_table.place_error_m == 0.0


@pytest.mark.parametrize(
    ("effect", "size", "late_s"),
    [
        (effects.SHAFT_DEAD_TIME, 0.1, 0.1),  # whatever the move
        # of 60 r/min: 0.15 s x 45 + 4.5 less 0.25 s x 35 + 0.5
        (effects.SHAFT_SLOW, 0.1, 0.034),
    ],
)
def test_what_comes_late_lands_late(effect, size, late_s):
    data = data_of(a_log(np.tile([20.0, 80.0], 50)))
    found = calc_field_cost(EffectInstance(effect.id, size), Machine(), data)
    assert found.rate_error_percent == 0.0
    assert found.place_error_m == pytest.approx(late_s * SPEED_MPS, abs=0.01)


def test_a_late_receiver_lands_late_where_the_speed_changes():
    columns = a_log(50.0)
    for name in ("speed_mps", "wheel_speed_mps"):
        columns[name] = columns[name] + 0.2 * np.sin(columns["time_s"] / 7.0)
    found = calc_field_cost(
        EffectInstance(effects.SPEED_GNSS_LATENCY.id, 0.3), Machine(), data_of(columns)
    )
    assert found.place_error_m == pytest.approx(0.3 * SPEED_MPS, rel=0.05)


def test_what_begins_in_the_middle_is_counted_from_then_on():
    data = data_of(a_log(50.0))
    assert (
        calc_field_cost(
            EffectInstance(effects.SHAFT_STALL.id, 1.0, 300.0), Machine(), data
        ).rate_error_percent
        < -97.0
    )
    blocked = calc_field_cost(
        EffectInstance(effects.FLOW_BLOCKED_OUTLET.id, 16.7, 300.0), Machine(), data
    )
    assert blocked.rate_error_percent == pytest.approx(-16.7)


def test_what_has_no_cost_that_a_log_can_tell_says_so():
    data = data_of(a_log(50.0))
    fouled = calc_field_cost(
        EffectInstance(effects.CANOPY_HEAD_FOULED.id, 5.0, None, 1), Machine(), data
    )
    assert fouled.rate_error_percent is None and fouled.place_error_m is None
    steps = calc_field_cost(EffectInstance(effects.SHAFT_COARSE_ENCODER.id, 2.0), Machine(), data)
    assert steps.rate_error_percent == steps.place_error_m == 0.0
