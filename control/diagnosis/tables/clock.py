"""Times that come in steps: a detector that looks only every so often (lag.coarse_clock).

A step shows in the values themselves, not in their mean: they heap near its multiples. The
statistic is the cosine quantogram of D. G. Kendall ("Hunting quanta", Phil. Trans. R. Soc. A
276, 1974): for each step tried, the mean cosine of the values' phase, compared with that of
smooth scatter of the same mean and size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, stdtrit
from topdress.control.diagnosis.judgement.checks import LEVEL
from topdress.control.diagnosis.judgement.prior import ROBUST_SD

from .table_series import Array, find_first_best

# The test of the quantogram's peak.
DRAWS = 1500  # of smooth scatter
BATCH = 100
# draws that heap as clearly, after which no more are made: noise does it too
MAX_REACHED = 5
# of the mean cosine, times sqrt(rows): what smooth scatter has at the least
MIN_SD = 0.3
MIN_ROWS = 8

# The steps that are tried.
# for each turn that the phase of the longest time makes
STEPS_PER_TURN = 6.0
MIN_STEPS, MAX_STEPS = 50, 3000
MIN_DIGITS = 8.0  # printed digits in the finest step
# times the scatter, or half the spread of all times: coarser steps have no phases left
MAX_SCATTERS = 4.0
# of the step at the peak that may be meant instead
MAX_MULTIPLE = 12
# of the clearest heaping: a multiple of the step that heaps as well is meant instead
AS_CLEAR = 0.95

# Readings so few that no scatter is left to see the steps by: whole steps and nothing between them.
MAX_VALUES = 3  # different readings
MIN_ROWS_PER_VALUE = 6
# p of one and the same reading throughout: a steady detector, or a step
UNDECIDED = 0.5
MAX_STEPS_PER_VALUE = 39
# readings alike to so many digits are one reading: nobody prints lags finer
SAME_DIGITS = 7
# a last digit of so much is itself a step: nobody writes lags so roughly by choice
COARSE_DIGIT_S = 0.1
PRINTED_S = 0.001

# share of a step: smaller scatter does not average the rounding out
DITHERED = 0.35


class CoarseClock(NamedTuple):
    """`step_s` with its 90 % interval; `p`: that smooth times would heap so; `smallest_s`: what
    would have shown."""

    step_s: float
    low_s: float
    high_s: float
    p: float
    heaping: float  # mean cosine: 1 all on the multiples
    smallest_s: float | None

    @property
    def shown(self) -> bool:
        return self.p < LEVEL

    @property
    def undecided(self) -> bool:
        """One and the same reading throughout: a step is neither shown nor excluded."""
        return self.p == UNDECIDED


def find_clock_step(
    times_s: Array, fitted_s: Array, digit_s: float, seed: int
) -> CoarseClock | None:
    """Looks for a clock step in times (n,) about their fitted means (n,). None: too few rows or
    no scatter to see it.

    `digit_s`: the last printed digit; where that is a tenth of a second or more, it is itself
    such a step.
    """
    digit_s = PRINTED_S if digit_s >= COARSE_DIGIT_S else digit_s
    rows = len(times_s)
    few = _find_step_of_few_values(times_s, digit_s)
    if few is not None:
        return few
    rest = times_s - fitted_s
    scatter = float(np.std(rest, ddof=1)) if rows > 1 else 0.0
    spread = float(np.std(times_s))
    finest = max(MIN_DIGITS * digit_s, 0.1 * scatter)
    coarsest = MAX_SCATTERS * max(scatter, 0.5 * spread)
    if rows < MIN_ROWS or scatter <= 10.0**-SAME_DIGITS or coarsest <= 1.2 * finest:
        return None
    count = int((1.0 / finest - 1.0 / coarsest) * STEPS_PER_TURN * float(np.abs(times_s).max()))
    steps = 1.0 / np.linspace(1.0 / finest, 1.0 / coarsest, min(max(count, MIN_STEPS), MAX_STEPS))
    mean, sd = _calc_quantogram_moments(fitted_s, scatter, steps)
    seen = _calc_quantogram(times_s[None, :], steps)[0]
    z = (seen - mean) / sd
    highest = float(z.max())
    p = _calc_heaping_p_value(highest, fitted_s, scatter, steps, mean, sd, seed)
    # of equal ones the coarsest
    step = _find_coarsest_step(times_s, float(steps[::-1][find_first_best(z[::-1])]), coarsest)
    step, half = _refine_clock_step(times_s, step)
    # whose full heaping would have stood out of as many
    shown = steps[ndtr((mean - 1.0) / sd) < LEVEL / len(steps)]
    return CoarseClock(
        step,
        step - half,
        step + half,
        p,
        _calc_heaping(times_s, step),
        float(shown[0]) if len(shown) else None,
    )


def _find_step_of_few_values(times: Array, digit_s: float) -> CoarseClock | None:
    """Many readings, hardly any different ones: whole steps and nothing between them."""
    kinds = np.unique(np.round(times, SAME_DIGITS))
    if (
        len(times) < MIN_ROWS
        or len(kinds) > min(MAX_VALUES, len(times) // MIN_ROWS_PER_VALUE)
        or kinds[0] <= 0.0
    ):
        return None
    gaps = np.diff(kinds)
    if len(gaps) and gaps.min() < MIN_DIGITS * digit_s:
        return None
    p = (
        UNDECIDED
        if len(gaps) == 0 and kinds[0] < 10.0 * MIN_DIGITS * digit_s
        else 1.0 / (DRAWS + 1)
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
    """S.d. of what rounding does to all replicates of a setting alike, s: 0 where their scatter
    evens it out."""
    if clock is None or not clock.shown or scatter_s >= DITHERED * clock.step_s:
        return 0.0
    return clock.step_s / float(np.sqrt(12.0))


def _calc_quantogram_moments(fitted: Array, scatter: float, steps: Array) -> tuple[Array, Array]:
    """Mean and s.d. of the quantogram of normal times about their means, (steps,), in closed
    form."""
    turn = 2.0 * np.pi / steps[:, None]
    one, two = np.exp(-0.5 * (turn * scatter) ** 2), np.exp(-2.0 * (turn * scatter) ** 2)
    mean = np.cos(turn * fitted) * one
    variance = 0.5 * (1.0 + np.cos(2.0 * turn * fitted) * two) - mean**2
    rows = len(fitted)
    return mean.mean(axis=1), np.maximum(
        np.sqrt(np.maximum(variance.mean(axis=1), 0.0) / rows), MIN_SD / np.sqrt(rows)
    )


def _calc_heaping_p_value(
    highest: float, fitted: Array, scatter: float, steps: Array, mean: Array, sd: Array, seed: int
) -> float:
    """Share of draws of smooth times that heap as clearly at any step; few draws where it is
    plain that many do."""
    rng = np.random.default_rng(seed)
    reached = drawn = 0
    while drawn < DRAWS and reached < MAX_REACHED:
        times = fitted + scatter * rng.standard_normal((BATCH, len(fitted)))
        reached += int(
            np.sum(((_calc_quantogram(times, steps) - mean) / sd).max(axis=1) >= highest)
        )
        drawn += BATCH
    return (reached + 1) / (drawn + 1)


def _calc_quantogram(times: Array, steps: Array) -> Array:
    """Mean cosine of the phase, (draws, steps); single precision is ample and quick."""
    turns = (2.0 * np.pi * times).astype(np.float32)
    rates = (1.0 / steps).astype(np.float32)
    out = np.empty((len(times), len(steps)))
    for row, one in enumerate(turns):
        out[row] = np.cos(np.outer(rates, one)).sum(axis=1) / len(one)
    return out


def _find_coarsest_step(times: Array, step: float, coarsest: float) -> float:
    """The step about `step` at which the times heap most, or the largest multiple of it at
    which they do as well."""
    best = step = _find_peak_near(times, step)
    for factor in range(2, MAX_MULTIPLE + 1):
        if factor * step > coarsest:
            break
        tried = _find_peak_near(times, factor * step)
        if _calc_heaping(times, tried) >= AS_CLEAR * _calc_heaping(times, step):
            best = tried
    return best


def _find_peak_near(times: Array, step: float) -> float:
    reach = 0.5 / float(np.abs(times).max())
    near = 1.0 / np.maximum(1.0 / step + np.linspace(-reach, reach, 81), 1e-6)
    return float(near[int(np.argmax(_calc_quantogram(times[None, :], near)[0]))])


def _calc_heaping(times: Array, step: float) -> float:
    return float(np.mean(np.cos(2.0 * np.pi * times / step)))


def _refine_clock_step(times: Array, step: float) -> tuple[float, float]:
    """Least squares of the times on their whole numbers of steps, far rows left out; half a 90
    % interval."""
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
