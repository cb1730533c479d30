"""Times that come in steps: a detector that looks only every so often (lag.coarse_clock).

A step shows in the values themselves, not in their mean: they heap near its multiples. For each step tried, the mean
cosine of the values' phase is compared with that of smooth scatter of the same mean and size.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from .piece import Array

LEVEL = 0.002
DRAWS = 400                 # of smooth scatter, for the mean and the spread of the statistic
CHECKED = 1500              # further draws near the level
FINEST_DIGITS = 8.0         # steps below this many printed digits are not tried
STEPS_A_DECADE = 700
LEAST_ROWS = 8
COARSEST = 4.0              # times the scatter: coarser steps have no phases left
AS_CLEAR = 0.85             # of the clearest heaping: of steps as clear as this the coarsest is meant
UNDECIDED = 0.5
COARSE_DIGIT_S = 0.1        # nobody writes lags so roughly by choice
PRINTED_S = 0.001
FEW_VALUES = 3              # different readings among many, far apart: no scatter is left to see the steps by
DITHERED = 0.35             # of a step: scatter below this does not even the rounding out


class Clock(NamedTuple):
    """`step_s` with its 90 % interval; `p`: that smooth times would heap so; `smallest_s`: what would have shown."""

    step_s: float
    low_s: float
    high_s: float
    p: float
    heaping: float              # mean cosine: 1 all on the multiples
    smallest_s: float | None


def coarse_clock(times_s: Array, fitted_s: Array, digit_s: float, seed: int) -> Clock | None:
    """Looks for a clock step in times (n,) about their fitted means (n,). None: too few rows or no scatter to see it.

    `digit_s`: the last printed digit; where that is a tenth of a second or more, it is itself such a step.
    """
    digit_s = PRINTED_S if digit_s >= COARSE_DIGIT_S else digit_s
    rows = len(times_s)
    few = _few_values(times_s, digit_s)
    if few is not None:
        return few
    rest = times_s - fitted_s
    scatter = float(np.std(rest, ddof=1)) if rows > 1 else 0.0
    spread = float(np.std(times_s))
    finest = max(FINEST_DIGITS * digit_s, 0.1 * scatter)
    coarsest = COARSEST * max(scatter, 0.5 * spread)
    if rows < LEAST_ROWS or scatter <= 0.0 or coarsest <= 1.2 * finest:
        return None
    count = int(np.ceil(np.log10(coarsest / finest) * STEPS_A_DECADE * max(1.0, float(np.ptp(times_s)) / coarsest)))
    steps = np.exp(np.linspace(np.log(finest), np.log(coarsest), min(count, 3000)))
    rng = np.random.default_rng(seed)
    smooth = _heaping(_smooth(fitted_s, rest, rng, DRAWS), steps)
    mean, sd = smooth.mean(axis=0), np.maximum(smooth.std(axis=0), 0.3 / np.sqrt(rows))
    seen = _heaping(times_s[None, :], steps)[0]
    z = (seen - mean) / sd
    highest = float(z.max())
    null = ((smooth - mean) / sd).max(axis=1)
    p = (int(np.sum(null >= highest)) + 1) / (DRAWS + 1)
    if p <= 3.0 / (DRAWS + 1):
        further = np.concatenate([((_heaping(_smooth(fitted_s, rest, rng, 250), steps) - mean) / sd).max(axis=1)
                                  for _ in range(CHECKED // 250)])
        p = (int(np.sum(further >= highest)) + 1) / (CHECKED + 1)
    clear = np.flatnonzero((seen >= AS_CLEAR * seen[int(np.argmax(z))]) & (z >= max(3.0, 0.3 * highest)))
    last = clear[-1] if len(clear) else int(np.argmax(z))
    clear = np.append(clear, last)
    near = clear[clear >= last - 3]
    step = float(steps[near[int(np.argmax(seen[near]))]])
    step, half = _refined(times_s, step)
    return Clock(step, step - half, step + half, p, float(seen.max()), _smallest(steps, mean, sd, float(np.quantile(
        null, 0.99))))


def _few_values(times: Array, digit_s: float) -> Clock | None:
    """Many readings, hardly any different ones: whole steps and nothing between them.

    One and the same reading throughout may also be a steady detector: p is then 1/2, neither shown nor excluded.
    """
    kinds = np.unique(times)
    if len(times) < LEAST_ROWS or len(kinds) > min(FEW_VALUES, len(times) // 6) or kinds[0] <= 0.0:
        return None
    gaps = np.diff(kinds)
    if len(gaps) and gaps.min() < FINEST_DIGITS * digit_s:
        return None
    p = UNDECIDED if len(gaps) == 0 and kinds[0] < 10.0 * FINEST_DIGITS * digit_s else 1.0 / (CHECKED + 1)
    for count in range(1, 40):
        step = float(kinds[0]) / count
        if np.all(np.abs(kinds / step - np.round(kinds / step)) * step < 2.0 * digit_s):
            return Clock(step, 0.5 * step if len(kinds) == 1 else 0.98 * step, step if len(kinds) == 1 else 1.02 * step,
                         p, 1.0, None)
    return None


def rounding_s(clock: Clock | None, scatter_s: float) -> float:
    """S.d. of what rounding does to all replicates of a setting alike, s: 0 where their scatter evens it out."""
    if clock is None or clock.p >= LEVEL or scatter_s >= DITHERED * clock.step_s:
        return 0.0
    return clock.step_s / float(np.sqrt(12.0))


def _smooth(fitted: Array, rest: Array, rng: np.random.Generator, draws: int) -> Array:
    """Draws of the same means with normal scatter as large, (draws, n)."""
    return np.asarray(fitted + rng.standard_normal((draws, len(rest))) * np.std(rest, ddof=1))


def _heaping(times: Array, steps: Array) -> Array:
    """Mean cosine of the phase, (draws, steps); single precision is ample and quick."""
    out = np.empty((len(times), len(steps)))
    turns = (2.0 * np.pi * times).astype(np.float32)
    for k, step in enumerate(steps.tolist()):
        out[:, k] = np.cos(turns / np.float32(step)).mean(axis=1)
    return out


def _refined(times: Array, step: float) -> tuple[float, float]:
    """Least squares of the times on their whole numbers of steps, far rows left out; half a 90 % interval."""
    for _ in range(5):
        whole = np.round(times / step)
        off = times - whole * step
        limit = max(3.0 * 1.4826 * float(np.median(np.abs(off))), 0.02 * step)
        keep = (np.abs(off) <= limit) & (whole != 0)
        if keep.sum() < 3:
            return step, step * 0.05
        step = float(np.sum(times[keep] * whole[keep]) / np.sum(whole[keep] ** 2))
    dof = int(keep.sum()) - 1
    sd = float(np.sqrt(np.sum((times[keep] - whole[keep] * step) ** 2) / dof))
    return step, float(student.ppf(0.95, dof) * max(sd, 1e-6) / np.sqrt(np.sum(whole[keep] ** 2)))


def _smallest(steps: Array, mean: Array, sd: Array, limit: float) -> float | None:
    """The finest step whose full heaping would have stood out."""
    shown = np.flatnonzero((1.0 - mean) / sd > limit)
    return float(steps[shown[0]]) if len(shown) else None
