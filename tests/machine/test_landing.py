"""Landing conserves mass, whatever the drop times do; a sound delay comes out where it should."""
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from control.machine.landing import landed


@settings(max_examples=60, deadline=None)
@given(st.integers(3, 200), st.integers(0, 10_000), st.floats(0.0, 3.0), st.sampled_from([0.05, 0.1, 0.25, 1.0]))
def test_kg_landed_equal_kg_released(count: int, seed: int, spread_s: float, bin_m: float) -> None:
    rng = np.random.default_rng(seed)
    time_s = np.arange(count) * 0.05
    track = np.cumsum(rng.uniform(0.0, 0.15, count))
    mass = rng.uniform(0.0, 0.01, count)
    drop = rng.uniform(0.0, spread_s + 0.01, count)
    ground, place = landed(time_s, track, mass, drop, bin_m)
    assert ground.mass_kg.sum() == pytest.approx(mass.sum(), rel=1e-9)
    assert (ground.mass_kg >= -1e-15).all()
    assert len(place) == count


def test_a_step_lands_one_lag_distance_later() -> None:
    time_s = np.arange(2000) * 0.05
    track = 1.25 * time_s
    mass = np.where(time_s >= 50.0, 0.01, 0.0)
    ground, _ = landed(time_s, track, mass, np.full(2000, 1.6), 0.05)
    first = ground.centres_m()[np.flatnonzero(ground.mass_kg > 0)[0]]
    assert first == pytest.approx(1.25 * (50.0 + 1.6), abs=0.06)


def test_a_lever_arm_moves_everything() -> None:
    time_s = np.arange(100) * 0.05
    _, near = landed(time_s, time_s, np.ones(100), np.ones(100), 0.1)
    _, far = landed(time_s, time_s, np.ones(100), np.ones(100), 0.1, lever_arm_m=0.7)
    assert far - near == pytest.approx(0.7)


def test_steady_flow_lies_evenly() -> None:
    """No comb where bins are finer than a tick's travel."""
    time_s = np.arange(4000) * 0.05
    ground, _ = landed(time_s, 1.25 * time_s, np.full(4000, 0.004), np.full(4000, 1.3), 0.05)
    inner = ground.mass_kg[50:-50]
    assert inner == pytest.approx(np.full(len(inner), inner.mean()), rel=1e-9)
