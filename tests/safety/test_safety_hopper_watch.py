"""The hopper's loss against what the shaft should have taken: delay, false alarms over days, refills."""
from __future__ import annotations

import numpy as np
import pytest

from control.orders import Do, State
from control.safety import SafetyLimits
from control.safety.hopper_watch import HopperWatch, watched

LIMITS = SafetyLimits()
STEP_S = 0.25


def scale_noise(rng, n, step_s, sd_kg=0.15, memory_s=1.0):
    """Noise of a hopper scale: `sd_kg`, correlated over `memory_s`."""
    keep = np.exp(-step_s / memory_s)
    kicks = rng.standard_normal(n) * sd_kg * np.sqrt(1 - keep**2)
    out = np.empty(n)
    value = rng.standard_normal() * sd_kg
    for k in range(n):
        value = keep * value + kicks[k]
        out[k] = value
    return out


def reports(flow_kg_s, true_share, seed=1, step_s=STEP_S, sd_kg=0.15, start_kg=250.0):
    """Times at which missing flow is reported; `flow_kg_s` expected and the true share of it, one per step."""
    rng = np.random.default_rng(seed)
    n = len(flow_kg_s)
    hopper = start_kg - np.cumsum(flow_kg_s * true_share * step_s) + scale_noise(rng, n, step_s, sd_kg)
    hopper = np.round(hopper / 0.05) * 0.05
    w, found = HopperWatch(), []
    for k in range(n):
        w = watched(w, k * step_s, float(hopper[k]), float(flow_kg_s[k]), True, LIMITS)
        if w.missing:
            found.append(k * step_s)
    return found


@pytest.mark.parametrize("flow_kg_s", [0.02, 0.05, 0.1, 0.15])
def test_no_false_alarm_in_eight_hours_of_noise(flow_kg_s):
    n = int(8 * 3600 / STEP_S)
    assert reports(np.full(n, flow_kg_s), 1.0, seed=int(1000 * flow_kg_s)) == []


def test_no_false_alarm_in_eight_hours_of_changing_flow_that_is_a_quarter_short():
    rng = np.random.default_rng(5)
    n = int(8 * 3600 / STEP_S)
    flow = np.repeat(rng.uniform(0.04, 0.15, n // 4 + 1), 4)[:n]
    assert reports(flow, 0.75, seed=6, start_kg=3000.0) == []


@pytest.mark.parametrize(("flow_kg_s", "earliest_s", "latest_s"), [(0.15, 17, 23), (0.1, 17, 23), (0.05, 20, 32)])
def test_a_stream_that_stops_is_found_after_the_stated_delay(flow_kg_s, earliest_s, latest_s):
    delays = []
    for seed in range(20):
        share = np.where(np.arange(1200) * STEP_S < 120.0, 1.0, 0.0)
        found = reports(np.full(1200, flow_kg_s), share, seed=seed)
        delays.append(found[0] - 120.0)
    assert earliest_s <= np.percentile(delays, 5) and np.percentile(delays, 95) <= latest_s, sorted(delays)


def test_a_stream_down_to_30_percent_is_found():
    share = np.where(np.arange(2400) * STEP_S < 120.0, 1.0, 0.3)
    delays = [reports(np.full(2400, 0.1), share, seed=seed)[0] - 120.0 for seed in range(10)]
    assert max(delays) < 45.0


def test_a_spell_of_eight_seconds_is_not_reported():
    times = np.arange(2400) * STEP_S
    share = np.where((times % 120.0 >= 60.0) & (times % 120.0 < 68.0), 0.0, 1.0)
    assert reports(np.full(2400, 0.1), share, seed=3) == []


def test_missing_flow_holds_and_is_red(working):
    run = working()
    run.tick(60.0)
    stuck_kg = run.hopper_kg
    seconds = run.until(lambda v: v.state is not State.WORKING, 60.0, hopper_kg=stuck_kg)
    assert 18.0 < seconds < 23.0
    assert (run.verdict.state, run.verdict.why_state) == (State.HELD, "flow_missing")
    assert not run.verdict.flow_allowed
    assert run.order(Do.START).why == "acknowledge_first;alarm=flow_missing"
    run.order(Do.ACKNOWLEDGE)
    assert run.order(Do.START).accepted
    assert run.tick(1.0, hopper_kg=stuck_kg).flow_allowed, "counted anew after the start"


@pytest.mark.parametrize("commanded", [True, False])
def test_a_refill_between_is_no_missing_flow(working, commanded):
    run = working()
    run.tick(30.0)
    run.order(Do.HOLD)
    run.tick(60.0, speed_mps=0.0, expected_flow_kg_s=0.0)
    run.hopper_kg += 150.0
    if commanded:
        run.order(Do.REFILL, 150.0)
    run.order(Do.START)
    assert run.tick(90.0).flow_allowed


def test_filling_slowly_while_working_is_no_missing_flow(working):
    run = working()
    for _ in range(120):
        run.tick(1.0)
        run.hopper_kg += 0.6
    assert run.verdict.flow_allowed


def test_the_order_refill_takes_a_small_one_out(working):
    """Bags of 0.9 kg every 10 s: each too small to be seen as a refill, together they hide most of the flow."""

    def state_after(commanded):
        run = working()
        run.tick(30.0)
        for _ in range(5):
            run.hopper_kg += 0.9
            if commanded:
                run.order(Do.REFILL, 0.9)
            run.tick(10.0)
        return run.verdict.state

    assert (state_after(False), state_after(True)) == (State.HELD, State.WORKING)


def test_pauses_without_expected_flow_count_for_nothing(working):
    run = working()
    for _ in range(30):
        run.tick(3.0)
        run.tick(6.0, landing_inside=False, expected_flow_kg_s=0.0)
    assert run.verdict.flow_allowed is False and run.verdict.state is State.WORKING
    assert run.alarm_ids() == []


@pytest.mark.parametrize("value", [0.0, -5.0, True, "much", None, float("nan")])
def test_odd_refills_are_refused(working, value):
    assert working().order(Do.REFILL, value).why == "refill_kg"
