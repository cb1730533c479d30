"""What the scale teaches: how soon, how sure, and nothing that is not so."""
from __future__ import annotations

from collections.abc import Callable
from math import exp, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
import pytest

from control.machine.elements import Array
from control.metering.flow_trim import FlowTrim
from control.readings import Reading

DT_S, RPM, G_REV = 0.1, 70.0, 121.0         # 5.5 g a millimetre at 22 mm: 0.14 kg/s; ordered 0.09 in the field


class Learnt(NamedTuple):
    trim: Array             # (n,) by tick
    right: Array            # (n,): what it would have to be

    def back_s(self, share: float = 0.8, from_s: float = 0.0) -> float:
        """Seconds until that share of the error is taken back."""
        first = round(from_s / DT_S)
        off = np.abs(self.trim - self.right)[first:] <= (1.0 - share) * np.abs(self.right - 1.0)[first:]
        return float(np.argmax(off)) * DT_S if off.any() else float("inf")


def work(seconds: float, seed: int, true: Callable[[float, float, float], tuple[float, float]],
         slope_deg: float = 0.0, grams: float = 0.64 * G_REV) -> Learnt:
    """Work with an opening that follows the canopy; `true`: (time, g per revolution, pitch) to what really flows, g per
    revolution, and what the scale reads too much. The scale: 0.15 kg, correlated over 1 s, steps of 0.05 kg."""
    rng, trim, hopper, noise, pitch = np.random.default_rng(seed), FlowTrim(), 300.0, 0.0, 0.0
    keep, made, right = exp(-DT_S), [], []
    for k in range(round(seconds / DT_S)):
        now = k * DT_S
        by_model = grams * (1.0 + 0.15 * sin(now / 7.0) + 0.1 * sin(now / 2.3))
        pitch += -DT_S / 3.0 * pitch + 0.5 * sqrt(2.0 * DT_S / 3.0) * float(rng.standard_normal())
        nose = pitch + (slope_deg if sin(2.0 * pi * now / 480.0) > 0.0 else -slope_deg)
        flows, more_kg = true(now, by_model, nose)
        hopper -= flows * RPM / 60_000.0 * DT_S
        noise = keep * noise + sqrt(1.0 - keep * keep) * 0.15 * float(rng.standard_normal())
        weighed = round((hopper + more_kg + noise) / 0.05) * 0.05
        trim.update(now, DT_S, by_model * RPM / 60_000.0, RPM, nose, Reading(weighed, now))
        made.append(trim.value)
        right.append(flows / by_model)
    return Learnt(np.array(made), np.array(right))


def test_six_per_cent_more_are_taken_back_in_a_minute_and_a_half() -> None:
    """240 s and a half of it, before: a window of 15 kg, half believed."""
    runs = [work(240.0, seed, lambda now, grams, pitch: (1.06 * grams, 0.0)) for seed in range(6)]
    assert np.median([run.back_s() for run in runs]) < 95.0
    assert max(run.back_s() for run in runs) < 180.0
    assert max(np.abs(run.trim - 1.06)[-200:].max() for run in runs) < 0.015


def test_a_healthy_machine_is_left_alone() -> None:
    """Also in its first minute, when a straight line through the scale's noise says anything from -5 to +5 %."""
    starts = [work(150.0, seed, lambda now, grams, pitch: (grams, 0.0)) for seed in range(6)]
    assert np.mean([np.abs(run.trim - 1.0).mean() for run in starts]) < 0.003
    assert sum(np.abs(run.trim - 1.0).max() > 0.01 for run in starts) <= 1
    hour = work(2700.0, 7, lambda now, grams, pitch: (grams, 0.0))
    assert np.abs(hour.trim - 1.0).max() < 0.01 and abs(hour.trim.mean() - 1.0) < 0.003


def test_it_says_how_sure_it_is() -> None:
    trim = FlowTrim()
    begin = trim.sd_percent
    for k in range(3000):
        now = k * DT_S
        trim.update(now, DT_S, 0.1, RPM, 0.0, Reading(300.0 - 0.1 * now, now))
    assert begin > 4.0 and trim.sd_percent < 0.5


def test_what_flows_more_a_revolution_is_told_from_a_gain_where_the_opening_changes() -> None:
    run = work(900.0, 3, lambda now, grams, pitch: (grams + 8.0, 0.0))
    assert np.abs(run.trim - run.right)[-3000:].mean() < 0.006 and np.std(run.right[-3000:]) > 0.01


def test_a_slope_is_told_from_a_gain() -> None:
    run = work(1500.0, 4, lambda now, grams, pitch: (grams * (1.0 + 0.007 * pitch), 0.0), slope_deg=5.0)
    assert np.abs(run.right - 1.0).mean() > 0.03 and np.abs(run.trim - run.right)[-5000:].mean() < 0.006


def test_an_outlet_that_closes_is_found_soon() -> None:
    run = work(480.0, 5, lambda now, grams, pitch: (grams * (1.0 if now < 300.0 else 5.0 / 6.0), 0.0))
    assert run.back_s(from_s=301.0) < 120.0


def test_a_man_on_the_hopper_is_not_taken_for_flow() -> None:
    """He looks like a refill, perhaps of another lot, and is soon found to be none."""
    run = work(420.0, 6, lambda now, grams, pitch: (grams, 80.0 if 200.0 < now < 260.0 else 0.0))
    assert np.abs(run.trim - 1.0).max() < 0.03 and np.abs(run.trim - 1.0)[-300:].max() < 0.005


def test_a_noisier_scale_than_the_file_says_slows_it_down() -> None:
    rough = np.random.default_rng(8).standard_normal(3000)
    runs = [work(300.0, seed, lambda now, grams, pitch: (grams, 0.8 * float(rough[round(now / DT_S)])))
            for seed in (8, 9, 10)]
    assert np.mean([np.abs(run.trim - 1.0).mean() for run in runs]) < 0.012


def test_a_refill_begins_a_new_level_and_perhaps_a_new_lot() -> None:
    trim = FlowTrim()
    for k in range(3000):
        now = k * DT_S
        more = 0.0 if now < 150.0 else 200.0
        trim.update(now, DT_S, 0.1, RPM, 0.0, Reading(250.0 - 0.105 * now + more, now))
        if k == 1499:
            sure = trim.sd_percent
        if k == 1510:
            assert trim.sd_percent > sure + 1.0
    assert trim.value == pytest.approx(1.05, abs=0.01)


def test_it_is_bounded_and_goes_on_where_a_job_was_cut_off() -> None:
    trim = FlowTrim()
    for k in range(3000):
        now = k * DT_S
        trim.update(now, DT_S, 0.1, RPM, 0.0, Reading(300.0 - 0.2 * now, now))
    assert trim.value == 1.25
    again = FlowTrim()
    again.go_on(1.04)
    assert again.value == pytest.approx(1.04)
