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


def test_one_wild_reading_neither_moves_the_median_nor_drops_the_head():
    steady = [0.5] * 6
    _, results = run([steady, [0.5, 0.5, 0.9, 0.5, 0.5, 0.5], steady, steady])
    assert all(fused.ndvi == 0.5 and fused.dropped == () for fused in results)


def test_a_disagreeing_head_is_dropped_after_two_seconds_and_named():
    bad = [0.5, 0.51, 0.75, 0.49, 0.5, 0.52]
    _, results = run([bad] * 8)
    assert [fused.dropped for fused in results] == [()] * 4 + [(3,)] * 4
    assert results[-1].disagreeing == (3,) and results[-1].silent == ()
    assert results[-1].valid == 5 and not results[-1].degraded
    assert results[-1].ndvi == 0.5


def test_an_interrupted_disagreement_starts_anew():
    bad, good = [0.5, 0.5, 0.75, 0.5, 0.5, 0.5], [0.5] * 6
    _, results = run([bad, bad, bad, good, bad, bad, bad, good])
    assert all(fused.dropped == () for fused in results)


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


def test_fewer_than_four_is_degraded_and_none_is_none():
    _, (fused,) = run([[0.5, 0.5, 0.5, None, None, None]])
    assert fused.degraded and fused.valid == 3 and fused.dropped == (4, 5, 6)
    _, (fused,) = run([[0.5, 0.5, 0.5, 0.5, None, None]])
    assert not fused.degraded
    _, (fused,) = run([[None] * 6])
    assert fused.ndvi is None and fused.degraded


def test_a_canopy_that_varies_across_the_machine_drops_nobody():
    """A field edge: three heads over bare soil, three over wheat. Neither side outvotes the other."""
    _, results = run([[0.2, 0.21, 0.19, 0.6, 0.61, 0.62]] * 20)
    assert all(fused.dropped == () for fused in results)
    _, results = run([[0.3, 0.36, 0.42, 0.48, 0.54, 0.60]] * 20)
    assert all(fused.dropped == () for fused in results)


def test_two_bad_heads_are_both_found():
    _, results = run([[0.5, 0.51, 0.75, 0.49, 0.2, 0.52]] * 8)
    assert results[-1].dropped == (3, 5)


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
