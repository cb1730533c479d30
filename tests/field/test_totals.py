"""Totals against numpy on whole arrays."""
from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from control.field.totals import Totaliser


def test_by_hand():
    totals = Totaliser(2.4, 0.45)
    for _ in range(4000):
        totals.add(0.05, 1.25, 300.0, 290.0)
    done = totals.snapshot()
    assert done.area_ha == pytest.approx(0.06)
    assert done.applied_kg == pytest.approx(18.0)
    assert done.applied_n_kg == pytest.approx(8.1)
    assert done.target_kg == pytest.approx(17.4)
    assert done.worked_s == pytest.approx(200.0)
    assert done.mean_rate_kg_ha == pytest.approx(300.0)
    assert done.cv_percent == pytest.approx(0.0, abs=1e-4)
    assert done.cuc_percent == pytest.approx(100.0, abs=1e-4)
    assert done.error_percent == pytest.approx(100 * (300 / 290 - 1))


def test_nothing_worked_is_not_zero_percent():
    done = Totaliser(2.4, 0.45).snapshot()
    assert done.area_ha == 0.0
    assert done.mean_rate_kg_ha is done.cv_percent is done.cuc_percent is done.error_percent is None


def test_weighted_by_area_not_by_time():
    totals = Totaliser(2.0, 0.45)
    totals.add(10.0, 1.0, 100.0)
    totals.add(10.0, 3.0, 300.0)
    done = totals.snapshot()
    assert done.mean_rate_kg_ha == pytest.approx(250.0)
    assert done.cv_percent == pytest.approx(100 * math.sqrt(0.25 * 150 ** 2 + 0.75 * 50 ** 2) / 250)
    assert done.cuc_percent == pytest.approx(100 * (1 - (0.25 * 150 + 0.75 * 50) / 250))


@settings(deadline=None)
@given(st.integers(0, 2 ** 32), st.floats(20.0, 400.0), st.floats(0.0, 0.4))
def test_the_same_as_on_whole_arrays(seed, level, spread):
    rng = np.random.default_rng(seed)
    rate = np.abs(level * (1.0 + spread * rng.standard_normal(300)))
    speed = rng.uniform(0.5, 3.0, 300)
    totals = Totaliser(2.4, 0.45)
    for v, r in zip(speed, rate, strict=True):
        totals.add(0.05, float(v), float(r))
    area = 2.4 * speed * 0.05 / 1e4
    mean = np.average(rate, weights=area)
    done = totals.snapshot()
    assert done.mean_rate_kg_ha == pytest.approx(mean)
    assert done.cv_percent == pytest.approx(
        100 * math.sqrt(np.average((rate - mean) ** 2, weights=area)) / mean, abs=1e-3)
    assert done.cuc_percent == pytest.approx(
        100 * (1 - np.average(np.abs(rate - mean), weights=area) / mean), abs=100 * 0.25 / level)


@pytest.mark.parametrize(("step", "speed", "rate"), [
    (0.05, None, 300.0), (0.05, 1.0, None), (0.05, 0.0, 300.0), (0.05, -1.0, 300.0), (0.05, math.nan, 300.0),
    (0.05, math.inf, 300.0), (0.05, 1.0, math.nan), (0.05, 1.0, math.inf), (0.05, 1.0, -5.0), (-0.05, 1.0, 300.0),
])
def test_what_is_not_known_adds_nothing(step, speed, rate):
    totals = Totaliser(2.4, 0.45)
    totals.add(step, speed, rate, 300.0)
    assert totals.snapshot() == Totaliser(2.4, 0.45).snapshot()


def test_zero_rate_is_worked_area():
    totals = Totaliser(2.4, 0.45)
    totals.add(1.0, 1.0, 0.0, 0.0)
    done = totals.snapshot()
    assert done.area_ha == pytest.approx(2.4e-4) and done.mean_rate_kg_ha == 0.0
    assert done.cv_percent is None and done.error_percent is None


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="width"):
        Totaliser(0.0, 0.45)
    with pytest.raises(ValueError, match="product_n_fraction"):
        Totaliser(2.4, 46.0)


def test_a_pass_is_as_long_as_its_ground():
    """Dead time at its begin, run-out at its end: counted both, each pass is longer by one of them."""
    totals = Totaliser(2.4, 0.45)
    for _ in range(2):
        for _ in range(8):
            assert not totals.add(0.05, 1.25, 2.0, 300.0)
        for _ in range(1912):
            assert totals.add(0.05, 1.25, 300.0, 300.0)
        for _ in range(8):
            assert totals.add(0.05, 1.25, 300.0, 0.0)
        totals.rest()
    done = totals.snapshot()
    assert done.area_ha == pytest.approx(0.0576) and done.mean_rate_kg_ha == pytest.approx(300.0)
    assert totals.add(0.05, 1.25, 0.0, 0.0) and not Totaliser(2.4, 0.45).add(0.05, 1.25, 0.0, 300.0)
    assert Totaliser(2.4, 0.45).add(0.05, 1.25, 0.0), "where no target is known, all work counts"
