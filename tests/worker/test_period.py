from __future__ import annotations

import numpy as np
import pytest
from topdress.console.worker.loop_host import DURATION_BINS, DurationHistogram, TickPunctuality


@pytest.mark.parametrize("share", [0.5, 0.99, 0.999])
def test_quantiles_to_two_and_a_half_percent(share):
    drawn = np.random.default_rng(3).lognormal(mean=-7.0, sigma=1.0, size=50_000)
    durations = DurationHistogram()
    for d in drawn:
        durations.add_duration(float(d))
    assert durations.find_quantile_s(share) == pytest.approx(np.quantile(drawn, share), rel=0.03)
    assert durations.longest_s == drawn.max()


def test_the_ends_of_the_range():
    durations = DurationHistogram()
    assert durations.find_quantile_s(0.5) == 0.0
    for d in (0.0, -1e-9, 1e9):
        durations.add_duration(d)
    assert durations.n == 3 and durations.longest_s == 1e9
    assert durations.find_quantile_s(0.5) <= 1.1e-6
    assert len(durations._counts) == DURATION_BINS


def test_period_error_is_early_or_late_alike():
    punctuality = TickPunctuality(0.05)
    for now_s in (0.0, 0.05, 0.11, 0.15):  # 0, 10 ms late, 10 ms early
        punctuality.note_tick_begin(now_s)
        punctuality.note_tick_end(now_s, now_s + 0.002)
    said = punctuality.summarise_ms()
    assert said["ticks"] == 4 and said["hz"] == pytest.approx(20.0)
    assert said["max_ms"] == pytest.approx(10.0) and said["p50_ms"] == pytest.approx(10.0, rel=0.03)
    assert said["busy_p50_ms"] == pytest.approx(2.0, rel=0.03)
