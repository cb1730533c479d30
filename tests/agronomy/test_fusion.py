"""Fusion of the heads: one bad head never reaches the decision, and is named."""
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from control.agronomy.fusion import Fused, FusionLimits, FusionState, fuse_readings, start
from control.readings import Reading


def fuse(state, values, time_s):
    """One step with values that were all read now."""
    return fuse_readings(state, tuple(None if v is None else Reading(v, time_s) for v in values), time_s)


def run(rows, period_s=0.5, state=None, from_s=0.0):
    """Fuse rows of six values at a period; the last state, and every result."""
    state, results = state or start(6), []
    for k, row in enumerate(rows):
        state, fused = fuse(state, row, from_s + k * period_s)
        results.append(fused)
    return state, results


def test_median_of_six():
    _, (fused,) = run([[0.50, 0.52, 0.48, 0.51, 0.49, 0.53]])
    assert fused == Fused(pytest.approx(0.505), 6, (), (), (), False)


GOOD, BAD = [0.5] * 6, [0.5, 0.51, 0.75, 0.49, 0.5, 0.52]
DROPPED = {                 # rows of the heads, two a second, and who is dropped after each
    "one wild reading": ([GOOD, [0.5, 0.5, 0.9, 0.5, 0.5, 0.5], GOOD, GOOD], [()] * 4),
    "after two seconds": ([BAD] * 8, [()] * 4 + [(3,)] * 4), "begun anew": ([BAD, BAD, BAD, GOOD] * 2, [()] * 8),
    "two at once": ([[0.5, 0.51, 0.75, 0.49, 0.2, 0.52]] * 8, [()] * 4 + [(3, 5)] * 4),
    # three heads over bare soil, three over wheat: neither side outvotes the other
    "an edge of the field": ([[0.2, 0.21, 0.19, 0.6, 0.61, 0.62]] * 20, [()] * 20),
    "a slope across the machine": ([[0.3, 0.36, 0.42, 0.48, 0.54, 0.60]] * 20, [()] * 20)}


@pytest.mark.parametrize("case", DROPPED)
def test_who_disagrees_is_dropped_and_named(case):
    rows, dropped = DROPPED[case]
    _, results = run(rows)
    assert [fused.dropped for fused in results] == dropped
    assert all(fused.disagreeing == fused.dropped and fused.silent == () for fused in results)
    assert all(fused.valid == 6 - len(fused.dropped) and not fused.degraded for fused in results)
    assert "edge" in case or "slope" in case or all(fused.ndvi == pytest.approx(0.5, abs=0.006) for fused in results)


@pytest.mark.parametrize(("row", "degraded", "ndvi"), [
    ([0.5, 0.5, 0.5, None, None, None], True, 0.5), ([0.5, 0.5, 0.5, 0.5, None, None], False, 0.5),
    ([None] * 6, True, None)])
def test_fewer_than_four_is_degraded_and_none_is_none(row, degraded, ndvi):
    _, (fused,) = run([row])
    assert (fused.degraded, fused.ndvi) == (degraded, ndvi) and fused.valid == 6 - row.count(None)
    assert fused.dropped == tuple(k for k, one in enumerate(row, start=1) if one is None)


def test_a_dropped_head_comes_back_only_after_five_close_seconds():
    bad, near, good = ([0.5, 0.5, v, 0.5, 0.5, 0.5] for v in (0.75, 0.56, 0.51))
    state, _ = run([bad] * 6)
    state, results = run([near] * 20, state=state, from_s=3.0)      # within 0.08, not within half of it
    assert all(fused.dropped == (3,) for fused in results)
    _, results = run([good] * 13, state=state, from_s=13.0)
    assert [fused.dropped for fused in results] == [(3,)] * 10 + [()] * 3


def test_a_silent_head_is_dropped_by_age_and_returns_with_its_next_reading():
    row = [0.5, None, 0.5, 0.5, 0.5, 0.5]
    state, _ = run([[0.5] * 6])
    state, results = run([row] * 4, state=state, from_s=0.5)
    assert [fused.silent for fused in results] == [(), (), (2,), (2,)]
    _, fused = fuse(state, [0.5] * 6, 2.5)
    assert fused.dropped == ()


def test_two_heads_cannot_judge_each_other():
    state = start(2)
    for k in range(10):
        state, fused = fuse(state, [0.3, 0.7], 0.5 * k)
    assert fused.dropped == ()


@pytest.mark.parametrize("nonsense", [float("nan"), float("inf"), -1.0, 1.5])
def test_a_value_that_is_no_ndvi_is_no_reading(nonsense):
    _, (fused,) = run([[0.5, nonsense, 0.5, 0.5, 0.5, 0.5]])
    assert fused.ndvi == 0.5 and fused.silent == (2,)


def test_held_readings_at_the_loops_rate_are_the_same_as_their_own_times():
    """At 20 Hz the same 2 Hz readings are seen ten times; nothing may come sooner or later for it."""
    state, dropped_at = start(6), None
    for tick in range(100):
        now = 0.05 * tick
        sampled = 0.5 * int(now / 0.5 + 1e-9)
        readings = [Reading(v, sampled) for v in (0.5, 0.51, 0.75, 0.49, 0.5, 0.52)]
        state, fused = fuse_readings(state, readings, now)
        if fused.dropped and dropped_at is None:
            dropped_at = now
    assert dropped_at == pytest.approx(2.0)


def test_noise_drops_nobody_in_an_hour():
    rng = np.random.default_rng(7)
    truth = 0.5 + 0.1 * np.sin(np.arange(7200) / 40.0)
    rows = truth[:, None] + 0.01 * rng.standard_normal((7200, 6))
    _, results = run(rows.tolist())
    assert not any(fused.dropped for fused in results)
    error = np.array([fused.ndvi for fused in results]) - truth
    assert float(np.std(error)) < 0.0065


@settings(deadline=None)
@given(st.lists(st.lists(st.none() | st.floats(allow_nan=True), min_size=6, max_size=6), max_size=30),
       st.floats(0.01, 3.0))
def test_whatever_is_said_the_answer_is_sound(rows, period_s):
    limits = FusionLimits()
    state = FusionState()
    for k, row in enumerate(rows):
        state, fused = fuse(state, row, k * period_s)
        assert fused.valid + len(fused.dropped) == 6
        assert set(fused.dropped) == set(fused.disagreeing) | set(fused.silent)
        assert fused.degraded == (fused.valid < limits.least_valid)
        assert (fused.ndvi is None) == (fused.valid == 0)
        assert fused.ndvi is None or limits.ndvi_low <= fused.ndvi <= limits.ndvi_high
