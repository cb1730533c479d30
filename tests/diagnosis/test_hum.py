"""Speed sensors that hum: no latency, and no noise of other frequencies; what does not hum is left alone."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from control.diagnosis.judgement.noise import coefficients, leaving_out, segments, series_of
from control.diagnosis.runs.diagnose import diagnose_run
from control.machine.machine import Machine

MACHINE = Machine()


def speeds(hum_mps: float, period_s: float = 1.7, wheel_percent: float = 0.0, late_s: float = 0.0) -> dict[str, Any]:
    """Wheel and GNSS speed of 15 minutes, ten rows a second; the GNSS hums, its phase wandering."""
    rng, time_s = np.random.default_rng(8), np.arange(0.0, 900.0, 0.1)
    true = 1.3 + 0.25 * np.sin(time_s / 8.0)
    phase = 2.0 * np.pi * time_s / period_s + np.cumsum(0.15 * rng.standard_normal(len(time_s)))
    gnss = np.interp(time_s - late_s, time_s, true) + hum_mps * np.sin(phase) + 0.02 * rng.standard_normal(len(time_s))
    return {"time_s": time_s, "speed_mps": gnss,
            "wheel_speed_mps": (1.0 + 0.01 * wheel_percent) * true + 0.02 * rng.standard_normal(len(time_s))}


def test_a_hum_is_said_with_its_period_and_is_no_cause() -> None:
    found = diagnose_run(speeds(0.12), MACHINE)
    assert any("hums with a period of 2 s and 1.6 s" in one for one in found.findings)
    assert not found.causes


@pytest.mark.parametrize(("effect", "planted"), [("speed.wheel_radius", {"wheel_percent": 1.0}),
                                                 pytest.param("speed.gnss_latency", {"late_s": 0.4},
                                                              marks=pytest.mark.exam)])
def test_what_is_slower_than_the_hum_is_found_beside_it(effect: str, planted: dict[str, float]) -> None:
    found = diagnose_run(speeds(0.12, **planted), MACHINE)
    (cause,) = found.causes
    assert cause.id == effect
    assert cause.size.low <= next(iter(planted.values())) <= cause.size.high


@pytest.mark.parametrize("columns", [speeds(0.0), speeds(0.12, 9.0)], ids=["noise", "slow swing"])
def test_noise_and_slow_swings_are_no_hum(columns: dict[str, Any]) -> None:
    assert not any("hums" in one for one in diagnose_run(columns, MACHINE).findings)


def test_bands_left_out_are_in_no_coefficient_and_in_no_series() -> None:
    series, cut = np.random.default_rng(2).standard_normal(3000), segments(3000)
    bands = np.arange(len(cut.starts)) % 5 == 2
    less = leaving_out(cut, bands)
    kept, every = coefficients(series, less), coefficients(series, cut)
    assert len(kept) == less.members.sum() == len(every) - cut.members[bands].sum()
    again = series_of(kept, less)
    assert again.shape == series.shape
    assert np.sum(again ** 2) == pytest.approx(np.sum(kept ** 2))
    assert np.abs(coefficients(again, leaving_out(cut, ~bands))).max() < 1e-9
    assert np.add.reduceat(kept ** 2, less.starts) == pytest.approx(np.add.reduceat(every ** 2, cut.starts)[~bands])
