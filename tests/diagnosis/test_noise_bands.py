"""How noise and readings are looked at: bands of frequency, steps, tails, the noise's fit,
blocks held out."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.signal import lfilter
from topdress.control.diagnosis.judgement.noise import (
    calc_coefficients,
    leave_out_bands,
    make_segments,
    make_series,
)
from topdress.control.diagnosis.judgement.noise_fit import solve_linear_system
from topdress.control.diagnosis.judgement.prior import MIN_REPORT_LOG_ODDS
from topdress.control.diagnosis.runs.held_out import (
    BLOCK_COUNT,
    BLOCK_MARGIN_S,
    HELD_OUT_BLOCKS,
    hold_out_blocks,
)
from topdress.control.diagnosis.runs.intermittent import (
    MIN_DIP_SD,
    _calc_depth_evidence,
    _calc_step_gains,
)
from topdress.control.diagnosis.runs.quantised import (
    calc_rounding_error,
    find_final_steps,
    find_reading_step,
    fit_dither_noise,
)
from topdress.control.diagnosis.runs.robust import find_tail_excess


@pytest.mark.parametrize(
    "bounds", [((0, 400), (400, 800)), ((0, 400), (500, 900)), ((100, 500), (600, 1000))]
)
def test_segments_alike_have_the_same_bands_wherever_they_lie(
    bounds: tuple[tuple[int, int], ...],
) -> None:
    one, both = make_segments(400), make_segments(1000, bounds)
    assert one.bounds == ((0, 400),) and both.bounds == bounds
    assert both.members == pytest.approx(2.0 * one.members)
    assert both.omega == pytest.approx(one.omega)
    assert 0.0 <= one.omega[0] < one.omega[-1] < np.pi


def test_a_wave_lies_in_the_band_of_its_frequency() -> None:
    """In the second segment as in the first: sin(0.5 k) is found where omega is about 0.5 rad
    per sample."""
    cut = make_segments(2000, ((0, 1000), (1000, 2000)))
    wave = np.where(np.arange(2000) < 1000, 0.0, np.sin(0.5 * np.arange(2000)))
    power = np.add.reduceat(calc_coefficients(wave, cut) ** 2, cut.starts)
    assert cut.omega[power.argmax()] == pytest.approx(0.5, rel=0.3)


def test_coefficients_give_the_series_again() -> None:
    series = np.random.default_rng(1).standard_normal(900)
    cut = make_segments(900, ((0, 400), (500, 900)))
    again = make_series(calc_coefficients(series, cut), cut)
    assert again[:400] == pytest.approx(series[:400]) and again[500:] == pytest.approx(series[500:])
    assert np.all(again[400:500] == 0.0)


def test_bands_left_out_are_in_no_coefficient_and_in_no_series() -> None:
    series, cut = np.random.default_rng(2).standard_normal(3000), make_segments(3000)
    bands = np.arange(len(cut.starts)) % 5 == 2
    less = leave_out_bands(cut, bands)
    kept, every = calc_coefficients(series, less), calc_coefficients(series, cut)
    assert len(kept) == less.members.sum() == len(every) - cut.members[bands].sum()
    again = make_series(kept, less)
    assert again.shape == series.shape
    assert np.sum(again**2) == pytest.approx(np.sum(kept**2))
    assert np.abs(calc_coefficients(again, leave_out_bands(cut, ~bands))).max() < 1e-9
    assert np.add.reduceat(kept**2, less.starts) == pytest.approx(
        np.add.reduceat(every**2, cut.starts)[~bands]
    )


# --- How readings are taken: whole steps of an encoder, heavy tails
# ---------------------------------------------------


def test_readings_that_are_whole_steps_say_their_step_and_others_say_nothing() -> None:
    rng = np.random.default_rng(1)
    true = 40.0 + 30.0 * np.sin(np.linspace(0.0, 40.0, 5000))
    noisy = true + rng.normal(0.0, 0.3, true.size)
    step = find_reading_step(np.round(np.round(noisy / 1.37) * 1.37, 3))
    assert (
        step is not None and step.step_rpm == pytest.approx(1.37, abs=0.001) and step.sd_rpm < 0.001
    )
    assert find_reading_step(np.round(noisy, 3)) is None
    assert find_reading_step(np.round(noisy, 1)) is None  # an ordinary log of one decimal
    # one value says nothing of its neighbours
    assert find_reading_step(np.full(5000, 70.0)) is None
    assert (
        find_reading_step(
            np.round(np.round(true / 1.37) * 1.37 + rng.normal(0.0, 0.3, true.size), 3)
        )
        is None
    )


def test_the_mean_error_of_rounding_is_what_many_rounded_readings_show() -> None:
    rng = np.random.default_rng(2)
    for speed, noise in ((70.0, 0.3), (69.0, 0.8), (31.2, 0.1)):
        true = np.full(200_000, speed)
        read = np.round((true + rng.normal(0.0, noise, true.size)) / 2.47) * 2.47
        said = calc_rounding_error(true[:1], 2.47, noise)[0]
        assert said == pytest.approx(read.mean() - speed, abs=0.02)
    swept = 50.0 + 20.0 * np.sin(np.linspace(0.0, 60.0, 40_000))
    read = np.round((swept + rng.normal(0.0, 0.45, swept.size)) / 2.47) * 2.47
    assert fit_dither_noise(read, swept, 2.47, 0.3) == pytest.approx(0.45, rel=0.15)


def test_heavy_tails_are_drawn_in_and_a_steady_shift_stays() -> None:
    rng = np.random.default_rng(3)
    noise = lfilter([1.0], [1.0, -0.5], rng.standard_t(3.0, 20_000))
    shift = np.where(np.arange(20_000) > 12_000, 8.0, 0.0)
    free = np.ones(20_000, bool)
    better = noise + shift - find_tail_excess(noise + shift, free)
    assert np.mean(better[12_100:]) - np.mean(better[:11_900]) == pytest.approx(8.0, abs=0.15)
    plain, robust = [], []
    for _ in range(60):
        one = rng.standard_t(3.0, 2_000)
        plain.append(one.mean())
        robust.append((one - find_tail_excess(one, np.ones(2_000, bool))).mean())
    assert np.std(robust) < 0.85 * np.std(plain)


def test_normal_noise_and_protected_samples_are_left_alone() -> None:
    rng = np.random.default_rng(4)
    assert not find_tail_excess(rng.normal(size=5_000), np.ones(5_000, bool)).any()
    free = np.arange(5_000) < 4_000
    noise = rng.standard_t(3.0, 5_000)
    noise[4_500] = 60.0
    drawn = find_tail_excess(noise, free)
    assert drawn[:4_000].any() and abs(drawn[4_500]) < 1e-6


def test_an_encoder_that_begins_to_read_in_steps_is_told_from_when_on() -> None:
    rng = np.random.default_rng(4)
    speed_rpm = np.repeat(rng.uniform(30.0, 90.0, 40), 100) + rng.normal(0.0, 0.3, 4000)
    readings = np.where(
        np.arange(4000) < 2600, np.round(speed_rpm, 3), np.round(np.round(speed_rpm / 3.7) * 3.7, 3)
    )
    steps = find_final_steps(readings)
    assert steps is not None and abs(steps.step_rpm - 3.7) < 1e-3 and abs(steps.first - 2600) <= 5
    assert find_final_steps(np.round(speed_rpm, 3)) is None


# --- The noise's fit: its own small solver against LAPACK's
# -----------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_the_step_is_that_of_lapack(seed: int) -> None:
    rng = np.random.default_rng(seed)
    square, right = rng.normal(size=(4, 4)) * 10.0 ** rng.uniform(-3.0, 3.0, 4), rng.normal(size=4)
    for matrix in (square, square @ square.T):  # rows must change places; as Fisher's is
        expected = np.linalg.solve(matrix, right)
        off = matrix @ solve_linear_system(matrix.copy(), right.copy()) - right
        assert np.abs(off).max() <= 1e-12 + 10.0 * np.abs(matrix @ expected - right).max()


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_what_has_no_step_is_refused(value: float) -> None:
    with pytest.raises(np.linalg.LinAlgError):
        solve_linear_system(np.full((4, 4), value), np.ones(4))


def test_weighted_samples_count_by_their_weight_and_come_back_without_it() -> None:
    series = np.random.default_rng(5).standard_normal(600)
    weights = np.where(np.arange(600) < 200, 0.5, 1.0)
    cut = make_segments(600)._replace(weights=weights)
    banded = calc_coefficients(series, cut)
    assert np.sum(banded**2) == pytest.approx(np.sum((weights * series) ** 2))
    assert make_series(banded, cut) == pytest.approx(series)


def test_a_step_of_the_scale_is_weighed_against_a_slope() -> None:
    noise = np.random.default_rng(6).normal(0.0, 0.1, 200)
    at, sd = np.arange(200), np.array([0.1 * np.sqrt(2.0 / 40.0)])
    step = _calc_step_gains(noise + (at >= 100), np.array([96]), 40, 8, sd)
    slope = _calc_step_gains(noise + at / 88.0, np.array([96]), 40, 8, sd)
    assert step[0] > 50.0 and slope[0] < -50.0


# --- Blocks of a log that no size is fitted to: where they lie, and that a short log has none
# -------------------------


class Steps(NamedTuple):
    step_s: float


class Series(NamedTuple):
    """What `hold_out_blocks` asks of a channel."""

    measured: np.ndarray
    grid: Steps
    cut: Any = make_segments(1)


@pytest.mark.parametrize("step_s", [0.1, 0.2])
def test_held_out_blocks_keep_their_distance_from_those_that_are_fitted(step_s: float) -> None:
    length, gap = 4800, round(BLOCK_MARGIN_S / step_s)
    blocks = hold_out_blocks(Series(np.zeros(length), Steps(step_s)))  # type: ignore[arg-type]
    assert [(piece.start, piece.stop) for piece in blocks.pieces] == [
        (length * k // BLOCK_COUNT + gap, length * (k + 1) // BLOCK_COUNT - gap)
        for k in HELD_OUT_BLOCKS
    ]


@pytest.mark.parametrize("seconds", [8.0, 80.0, 8.0 * 2.0 * BLOCK_MARGIN_S])
def test_a_log_shorter_than_the_gaps_holds_nothing_out(seconds: float) -> None:
    blocks = hold_out_blocks(Series(np.zeros(round(10.0 * seconds)), Steps(0.1)))  # type: ignore[arg-type]
    assert blocks.pieces == ()


@pytest.mark.parametrize("freedom", [2.5, 4.0, 30.0])
def test_the_tail_of_a_noise_has_no_depth_of_its_own(freedom):
    """Dips of a noise that has outliers on one side only."""
    for seed in range(20):
        z = np.abs(np.random.default_rng(seed).standard_t(freedom, 200_000))
        depths = z[z > MIN_DIP_SD][:150] / MIN_DIP_SD
        assert _calc_depth_evidence(depths, 8.0) < MIN_REPORT_LOG_ODDS


@pytest.mark.parametrize("shared", [0.0, 0.5])
def test_missing_pulses_have_a_depth_of_their_own(shared):
    """One pulse of a window of half a second at 1 to 3 m/s, half of the dips a noise's or none."""
    rng = np.random.default_rng(5)
    pulses = 2.5 / 16.0 / 0.5 / rng.uniform(1.0, 3.0, 200) / 0.08
    tail = rng.pareto(4.0, 200) + 1.0
    depths = np.where(rng.random(200) < shared, tail, np.maximum(1.0, pulses))
    assert _calc_depth_evidence(depths, 12.0) > 5.0
