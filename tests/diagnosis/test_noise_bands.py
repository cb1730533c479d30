"""Bands of frequency that noise is looked at in: a segment's place in the log changes nothing."""
from __future__ import annotations

import numpy as np
import pytest

from control.diagnosis.judgement.noise import coefficients, segments, series_of


@pytest.mark.parametrize("bounds", [((0, 400), (400, 800)), ((0, 400), (500, 900)), ((100, 500), (600, 1000))])
def test_segments_alike_have_the_same_bands_wherever_they_lie(bounds: tuple[tuple[int, int], ...]) -> None:
    one, both = segments(400), segments(1000, bounds)
    assert one.bounds == ((0, 400),) and both.bounds == bounds
    assert both.members == pytest.approx(2.0 * one.members)
    assert both.omega == pytest.approx(one.omega)
    assert 0.0 <= one.omega[0] < one.omega[-1] < np.pi


def test_a_wave_lies_in_the_band_of_its_frequency() -> None:
    """In the second segment as in the first: sin(0.5 k) is found where omega is about 0.5 rad per sample."""
    cut = segments(2000, ((0, 1000), (1000, 2000)))
    wave = np.where(np.arange(2000) < 1000, 0.0, np.sin(0.5 * np.arange(2000)))
    power = np.add.reduceat(coefficients(wave, cut) ** 2, cut.starts)
    assert cut.omega[power.argmax()] == pytest.approx(0.5, rel=0.3)


def test_coefficients_give_the_series_again() -> None:
    series = np.random.default_rng(1).standard_normal(900)
    cut = segments(900, ((0, 400), (500, 900)))
    again = series_of(coefficients(series, cut), cut)
    assert again[:400] == pytest.approx(series[:400]) and again[500:] == pytest.approx(series[500:])
    assert np.all(again[400:500] == 0.0)
