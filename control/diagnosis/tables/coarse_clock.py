"""Detects times that are quantised by a detector with a coarse clock (lag.coarse_clock).

A clock step shows in the values themselves, not in their mean: they cluster near its multiples. The
statistic is the cosine quantogram of D. G. Kendall ("Hunting quanta", Phil. Trans. R. Soc. A 276,
1974): the mean cosine of the values' phase for each trial step, compared with that of smooth
scatter of the same mean and size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, stdtrit
from topdress.control.diagnosis.judgement.checks import FALSE_ALARM_PROB
from topdress.control.diagnosis.judgement.prior import ROBUST_SD

from .table_series import Array, find_first_best

# Number of random draws of smooth scatter for the test of the quantogram's peak.
DRAW_COUNT = 1500
# Number of draws that are calculated together.
BATCH_DRAWS = 100
# The test stops after this number of draws that cluster as clearly, because noise then explains the
# peak.
MAX_EXCEEDING_DRAWS = 5
# Minimum standard deviation of the mean cosine, times sqrt(rows), under smooth scatter.
MIN_MEAN_COSINE_SD = 0.3
# Minimum number of times for the test.
MIN_ROWS = 8

# Number of trial steps for each turn of the longest time's phase.
TRIAL_STEPS_PER_PHASE_TURN = 6.0
# Bounds of the number of trial steps.
MIN_STEPS, MAX_STEPS = 50, 3000
# Number of printed digits in the smallest trial step.
MIN_STEP_DIGITS = 8.0
# Maximum step in units of the scatter, or of half the range of all times: larger steps have no
# phases.
MAX_STEP_IN_SCATTERS = 4.0
# Maximum multiple of the step at the peak that is tried.
MAX_TRIED_STEP_MULTIPLE = 12
# Share of the highest mean cosine from which a multiple of the step is preferred.
SAME_PEAK_SHARE = 0.95

# Maximum number of distinct readings for the test of whole steps, where too little scatter is left
# for the quantogram.
MAX_DISTINCT_VALUES = 3
# Minimum number of rows for each distinct reading.
MIN_ROWS_PER_VALUE = 6
# P value for a single reading throughout: either a steady detector, or a coarse step.
SINGLE_READING_P_VALUE = 0.5
# Maximum number of steps within a distinct reading.
MAX_STEPS_PER_VALUE = 39
# Readings that agree to this number of digits are equal: nobody prints lags more finely.
COMPARED_DIGITS = 7
# A last digit of this size, s, is itself a clock step: nobody chooses such coarse digits.
COARSE_DIGIT_S = 0.1
# Resolution of printed times, s.
PRINT_RESOLUTION_S = 0.001

# Minimum scatter as a share of a step for the rounding to average out.
MIN_SCATTER_IN_STEPS = 0.35


class CoarseClock(NamedTuple):
    """A clock step `step_s` with its 90 % interval; `p`: probability of such clustering under
    smooth times; `smallest_s`: smallest detectable step, s."""

    step_s: float
    low_s: float
    high_s: float
    p: float
    # Mean cosine: 1 where all times are multiples of the step.
    heaping: float
    smallest_s: float | None

    @property
    def shown(self) -> bool:
        return self.p < FALSE_ALARM_PROB

    @property
    def undecided(self) -> bool:
        """Whether all readings are equal: a step is then neither shown nor excluded."""
        return self.p == SINGLE_READING_P_VALUE


def find_clock_step(
    times_s: Array, fitted_s: Array, digit_s: float, seed: int
) -> CoarseClock | None:
    """Search for a clock step in times (n,) around their fitted means (n,); None for too few rows
    or no scatter.

    `digit_s`: the last printed digit, s; a digit of a tenth of a second or more is itself such a
    step.
    """
    digit_s = PRINT_RESOLUTION_S if digit_s >= COARSE_DIGIT_S else digit_s
    rows = len(times_s)
    few = _find_step_of_few_values(times_s, digit_s)
    if few is not None:
        return few
    rest = times_s - fitted_s
    scatter = float(np.std(rest, ddof=1)) if rows > 1 else 0.0
    spread = float(np.std(times_s))
    finest = max(MIN_STEP_DIGITS * digit_s, 0.1 * scatter)
    coarsest = MAX_STEP_IN_SCATTERS * max(scatter, 0.5 * spread)
    if rows < MIN_ROWS or scatter <= 10.0**-COMPARED_DIGITS or coarsest <= 1.2 * finest:
        return None
    count = int(
        (1.0 / finest - 1.0 / coarsest) * TRIAL_STEPS_PER_PHASE_TURN * float(np.abs(times_s).max())
    )
    steps = 1.0 / np.linspace(1.0 / finest, 1.0 / coarsest, min(max(count, MIN_STEPS), MAX_STEPS))
    mean, sd = _calc_quantogram_moments(fitted_s, scatter, steps)
    seen = _calc_quantogram(times_s[None, :], steps)[0]
    z = (seen - mean) / sd
    highest = float(z.max())
    p = _calc_heaping_p_value(highest, fitted_s, scatter, steps, mean, sd, seed)
    # The largest of equally good steps is chosen.
    step = _find_coarsest_step(times_s, float(steps[::-1][find_first_best(z[::-1])]), coarsest)
    step, half = _refine_clock_step(times_s, step)
    # Steps whose full clustering would be significant among all trial steps.
    shown = steps[ndtr((mean - 1.0) / sd) < FALSE_ALARM_PROB / len(steps)]
    return CoarseClock(
        step,
        step - half,
        step + half,
        p,
        _calc_clustering(times_s, step),
        float(shown[0]) if len(shown) else None,
    )


def _find_step_of_few_values(times: Array, digit_s: float) -> CoarseClock | None:
    """Return the step of many readings with few distinct values: whole steps and nothing
    between."""
    kinds = np.unique(np.round(times, COMPARED_DIGITS))
    if (
        len(times) < MIN_ROWS
        or len(kinds) > min(MAX_DISTINCT_VALUES, len(times) // MIN_ROWS_PER_VALUE)
        or kinds[0] <= 0.0
    ):
        return None
    gaps = np.diff(kinds)
    if len(gaps) and gaps.min() < MIN_STEP_DIGITS * digit_s:
        return None
    p = (
        SINGLE_READING_P_VALUE
        if len(gaps) == 0 and kinds[0] < 10.0 * MIN_STEP_DIGITS * digit_s
        else 1.0 / (DRAW_COUNT + 1)
    )
    for count in range(1, MAX_STEPS_PER_VALUE + 1):
        step = float(kinds[0]) / count
        if np.all(np.abs(kinds / step - np.round(kinds / step)) * step < 2.0 * digit_s):
            return CoarseClock(
                step,
                0.5 * step if len(kinds) == 1 else 0.98 * step,
                step if len(kinds) == 1 else 1.02 * step,
                p,
                1.0,
                None,
            )
    return None


def find_rounding_sd(clock: CoarseClock | None, scatter_s: float) -> float:
    """Return the s.d. of the rounding error that all replicates of a setting share, s; 0 where
    their scatter averages it out."""
    if clock is None or not clock.shown or scatter_s >= MIN_SCATTER_IN_STEPS * clock.step_s:
        return 0.0
    return clock.step_s / float(np.sqrt(12.0))


def _calc_quantogram_moments(fitted: Array, scatter: float, steps: Array) -> tuple[Array, Array]:
    """Return mean and s.d. of the quantogram of normal times around their means, (steps,), in
    closed form."""
    turn = 2.0 * np.pi / steps[:, None]
    one, two = np.exp(-0.5 * (turn * scatter) ** 2), np.exp(-2.0 * (turn * scatter) ** 2)
    mean = np.cos(turn * fitted) * one
    variance = 0.5 * (1.0 + np.cos(2.0 * turn * fitted) * two) - mean**2
    rows = len(fitted)
    return mean.mean(axis=1), np.maximum(
        np.sqrt(np.maximum(variance.mean(axis=1), 0.0) / rows), MIN_MEAN_COSINE_SD / np.sqrt(rows)
    )


def _calc_heaping_p_value(
    highest: float, fitted: Array, scatter: float, steps: Array, mean: Array, sd: Array, seed: int
) -> float:
    """Return the share of draws of smooth times that cluster as clearly at any step; a clear excess
    stops early."""
    rng = np.random.default_rng(seed)
    reached = drawn = 0
    while drawn < DRAW_COUNT and reached < MAX_EXCEEDING_DRAWS:
        times = fitted + scatter * rng.standard_normal((BATCH_DRAWS, len(fitted)))
        reached += int(
            np.sum(((_calc_quantogram(times, steps) - mean) / sd).max(axis=1) >= highest)
        )
        drawn += BATCH_DRAWS
    return (reached + 1) / (drawn + 1)


def _calc_quantogram(times: Array, steps: Array) -> Array:
    """Return the mean cosine of the phase, (draws, steps); single precision is sufficient and
    fast."""
    turns = (2.0 * np.pi * times).astype(np.float32)
    rates = (1.0 / steps).astype(np.float32)
    out = np.empty((len(times), len(steps)))
    for row, one in enumerate(turns):
        out[row] = np.cos(np.outer(rates, one)).sum(axis=1) / len(one)
    return out


def _find_coarsest_step(times: Array, step: float, coarsest: float) -> float:
    """Return the step near `step` with the strongest clustering, or the largest multiple with
    similar clustering."""
    best = step = _find_peak_near(times, step)
    for factor in range(2, MAX_TRIED_STEP_MULTIPLE + 1):
        if factor * step > coarsest:
            break
        tried = _find_peak_near(times, factor * step)
        if _calc_clustering(times, tried) >= SAME_PEAK_SHARE * _calc_clustering(times, step):
            best = tried
    return best


def _find_peak_near(times: Array, step: float) -> float:
    reach = 0.5 / float(np.abs(times).max())
    near = 1.0 / np.maximum(1.0 / step + np.linspace(-reach, reach, 81), 1e-6)
    return float(near[int(np.argmax(_calc_quantogram(times[None, :], near)[0]))])


def _calc_clustering(times: Array, step: float) -> float:
    return float(np.mean(np.cos(2.0 * np.pi * times / step)))


def _refine_clock_step(times: Array, step: float) -> tuple[float, float]:
    """Fit the step by least squares of the times on their whole numbers of steps, without outliers,
    and return half of its 90 % interval as well."""
    for _ in range(5):
        whole = np.round(times / step)
        off = times - whole * step
        limit = max(3.0 * ROBUST_SD * float(np.median(np.abs(off))), 0.02 * step)
        keep = (np.abs(off) <= limit) & (whole != 0)
        if keep.sum() < 3:
            return step, step * 0.05
        step = float(np.sum(times[keep] * whole[keep]) / np.sum(whole[keep] ** 2))
    dof = int(keep.sum()) - 1
    sd = float(np.sqrt(np.sum((times[keep] - whole[keep] * step) ** 2) / dof))
    return step, float(stdtrit(dof, 0.95) * max(sd, 1e-6) / np.sqrt(np.sum(whole[keep] ** 2)))
