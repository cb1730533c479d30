"""A check is cheap enough for 100 ticks a second and for hours in tests. Figures: docs/safety.md."""
from __future__ import annotations

from time import thread_time


def test_a_check_costs_little(working, situation_at):
    """Below 60 us on an idle core; the bound is wider because test machines are shared. The processor's time alone."""
    run = working()
    situations = [situation_at(run.now_s + 0.05 * k, hopper_kg=200.0 - 0.005 * k) for k in range(1, 2001)]
    best_s = float("inf")
    for start in range(0, 2000, 200):
        begun = thread_time()
        for s in situations[start:start + 200]:
            verdict = run.safety.check(s.measurements.time_s, s)
        best_s = min(best_s, (thread_time() - begun) / 200)
        assert verdict.flow_allowed
    assert best_s < 120e-6, f"{best_s * 1e6:.0f} us a check"
