"""Means over a variable, and the variable that tells an effect."""
from __future__ import annotations

import numpy as np
import pytest

from console.reports.binned import Axis, binned, binned_rates, shown_share, telling


@pytest.fixture
def x() -> np.ndarray:
    return np.random.default_rng(3).uniform(0.0, 10.0, 20_000)


def test_means_follow_the_function_within_their_bands(x: np.ndarray) -> None:
    noise = np.random.default_rng(4).standard_normal(len(x))
    means = binned(Axis("x", x), np.sin(x) + noise)
    off = np.abs(means.mean - np.sin(means.at))
    assert np.mean(off < means.half + 0.02) > 0.85
    assert np.all(means.half < 0.1)


def test_bands_widen_with_memory(x: np.ndarray) -> None:
    plain, slow = (binned(Axis("x", x), np.cos(7.0 * x), memory) for memory in (0.0, 0.6))
    assert slow.half == pytest.approx(2.0 * plain.half)


def test_the_axis_that_holds_the_effect_is_taken(x: np.ndarray) -> None:
    other = np.random.default_rng(5).uniform(0.0, 1.0, len(x))
    axes = (Axis("other", other), Axis("x", x))
    assert telling(axes, x ** 2 - 30.0).label == "x"
    assert shown_share(axes[0], x ** 2 - 30.0) < 0.2


def test_the_first_of_equals_is_taken(x: np.ndarray) -> None:
    assert telling((Axis("first", x), Axis("copy", 2.0 * x)), np.sqrt(x)).label == "first"


def test_turned_residuals_do_not_cancel(x: np.ndarray) -> None:
    sign = np.where(np.arange(len(x)) % 2 == 0, 1.0, -1.0)
    means = binned(Axis("x", x, sign), 3.0 * sign)
    assert means.mean == pytest.approx(3.0)
    assert binned(Axis("x", x), 3.0 * sign).mean == pytest.approx(0.0, abs=0.3)


def test_named_values_keep_their_places() -> None:
    means = binned(Axis("way", np.array([0.0, 1.0] * 10), names=("closing", "opening")), np.array([1.0, -1.0] * 10))
    assert means.at.tolist() == [0.0, 1.0]
    assert means.mean.tolist() == [1.0, -1.0]


@pytest.mark.parametrize("memory", [0.0, 0.6])
def test_rates_are_read_off_the_level(memory: float) -> None:
    rng = np.random.default_rng(7)
    place = np.repeat(rng.integers(0, 3, 60), 40).astype(float)
    rates = np.array([-0.02, 0.0, 0.01])
    off = []
    for _ in range(40):
        noise = rng.standard_normal(len(place))
        for k in range(1, len(noise)):
            noise[k] = memory * noise[k - 1] + np.sqrt(1.0 - memory ** 2) * noise[k]
        level = np.concatenate(([0.0], np.cumsum(rates[place.astype(int)])[:-1])) + 0.15 * noise
        segments = np.repeat([0, 1], len(place) // 2)
        found = binned_rates(Axis("place", place), level + 90.0 * segments, 1.0, segments, memory)
        off.append((found.mean - rates) / found.half)
    assert found.half.max() < 0.002
    assert 0.80 < np.mean(np.abs(off) < 1.0) < 0.97
