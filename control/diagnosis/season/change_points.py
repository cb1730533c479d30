"""Finds changes in the course of one effect on one machine, with a product partition model summed
exactly.

A machine is repaired, or set anew, between two logs, by chance once in MEAN_LOGS_PER_CHANGE logs.
Between two changes an effect is absent, constant, or grows linearly (wear). The two sides of a
change are independent (Barry and Hartigan, Journal of the American Statistical Association 88,
1993, 309). Each stretch then has a closed-form marginal likelihood, and the sums over all
partitions are a recursion over the logs in both directions (as Fearnhead, Statistics and Computing
16, 2006, 203). The recursion gives the probability of a change in each gap, and the most likely
partition. The scatter of a size from log to log beyond its own error, as a constant and as a share
of the size (an effect's form is never exactly right), is the most likely of a short grid.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from topdress.control.diagnosis.judgement.gaussian import Array, calc_elementwise_gain

# Mean number of logs between two changes of one effect: a season has some 50 logs, and one repair
# or none.
MEAN_LOGS_PER_CHANGE = 50.0
# Prior s.d. of a linear change over the season, in units of the level's prior s.d.
SLOPE_SD_OF_LEVEL_SD = 2.0
# Trial scatters, in units of the s.d. around a smooth curve.
TRIAL_SCATTERS = (0.0, 0.25, 0.5, 1.0, 1.5)
# Trial scatters as a share of the size.
TRIAL_SCATTER_SHARES = (0.0, 0.1, 0.2, 0.4)
# Number of gaps on either side of a change within which its position is uncertain.
NEIGHBOUR_GAPS = 2
# Kinds of stretches: the effect is absent, constant, or grows linearly.
STRETCH_KINDS = ("gone", "stands", "line")
# Log probabilities that an effect continues, or changes, in a gap between two logs.
STAY_LOG_PROB, CHANGE_LOG_PROB = (
    float(np.log1p(-1.0 / MEAN_LOGS_PER_CHANGE)),
    -float(np.log(MEAN_LOGS_PER_CHANGE)),
)


class LogStretch(NamedTuple):
    """Logs from `begin` up to and without `end` between two changes; kind: one of STRETCH_KINDS."""

    begin: int
    end: int
    kind: str


class CoursePartition(NamedTuple):
    """A partition of a course. change: (n - 1,) probability of a change in each gap. scatter: (n,)
    variance from log to log."""

    stretches: tuple[LogStretch, ...]
    change: Array
    scatter: Array

    def calc_change_probability_near(self, gap: int) -> float:
        """Return the probability of a change in a gap or its neighbours, which the logs cannot
        separate."""
        return float(
            min(1.0, self.change[max(0, gap - NEIGHBOUR_GAPS) : gap + NEIGHBOUR_GAPS + 1].sum())
        )


def calc_season_shares(times_d: Array) -> Array:
    """Return times in days as shares of the season, 0 at the first and 1 at the last."""
    return np.asarray((times_d - times_d.min()) / max(float(np.ptp(times_d)), 1e-9), np.float64)


def find_partition(
    times_d: Array, sizes: Array, variance: Array, level_sd: float, curve: Array, scatter: float
) -> CoursePartition:
    """Return the partition of sizes (n,) with their variances. curve: (n,) smooth sizes; scatter:
    variance around the curve."""
    tried = product(TRIAL_SCATTERS, TRIAL_SCATTER_SHARES) if scatter > 0.0 else [(0.0, 0.0)]
    extras = [constant**2 * scatter + (share * curve) ** 2 for constant, share in tried]
    return _choose_stretches(
        max(
            (
                (_calc_stretch_likelihoods(times_d, sizes, variance + extra, level_sd), extra)
                for extra in extras
            ),
            key=lambda one: _calc_likelihood_ahead(one[0])[-1],
        )
    )


def calc_course_gain(times_d: Array, sizes: Array, variance: Array, level_sd: float) -> float:
    """Return the log marginal likelihood of any course, relative to the absence of the effect."""
    each = _calc_stretch_likelihoods(times_d, sizes, variance, level_sd)
    return float(
        _calc_likelihood_ahead(each)[-1]
        - each[0, 0, -1]
        - np.log(len(STRETCH_KINDS))
        + STAY_LOG_PROB * (len(sizes) - 1)
    )


def _choose_stretches(found: tuple[Array, Array]) -> CoursePartition:
    """Return the most likely stretches, and the probability of a change in each gap."""
    each, extra = found
    count, whole, ahead = len(extra), np.logaddexp.reduce(each), _calc_likelihood_ahead(each)
    back, best, came = np.full(count + 1, -np.inf), np.full(count + 1, -np.inf), [0] * (count + 1)
    back[count] = best[0] = 0.0
    top = each.max(axis=0)
    for end in range(1, count + 1):
        tried = best[:end] + top[:end, end]
        came[end] = int(np.argmax(tried))
        best[end] = tried[came[end]]
    for begin in range(count - 1, -1, -1):
        ends = np.arange(begin + 1, count + 1)
        back[begin] = np.logaddexp.reduce(back[ends] + whole[begin, ends])
    inside = np.arange(1, count)
    stretches, end = list[LogStretch](), count
    while end > 0:
        stretches.append(
            LogStretch(came[end], end, STRETCH_KINDS[int(np.argmax(each[:, came[end], end]))])
        )
        end = came[end]
    return CoursePartition(
        tuple(stretches[::-1]), np.exp(ahead[inside] + back[inside] - ahead[count]), extra
    )


def _calc_likelihood_ahead(each: Array) -> Array:
    """Return the log likelihood of all logs before each log, over all partitions: (n + 1,)."""
    whole = np.logaddexp.reduce(each)
    ahead = np.zeros(len(whole) + 1)
    for end in range(1, len(ahead)):
        ahead[end] = np.logaddexp.reduce(ahead[:end] + whole[:end, end])
    return ahead


def _calc_stretch_likelihoods(
    times_d: Array, sizes: Array, variance: Array, level_sd: float
) -> Array:
    """Return the log marginal likelihood and prior (a change before, none within) of every stretch
    [begin, end) by kind: (kinds, n, n + 1).

    The value is -inf for an impossible stretch.
    """
    count, share, weight = len(sizes), calc_season_shares(times_d), 1.0 / variance
    sums = np.concatenate(
        [
            np.zeros((7, 1)),
            np.cumsum(
                np.stack(
                    [
                        weight,
                        weight * share,
                        weight * share**2,
                        weight * sizes,
                        weight * share * sizes,
                        weight * sizes**2,
                        np.log(2.0 * np.pi * variance),
                    ]
                ),
                axis=1,
            ),
        ],
        axis=1,
    )
    begin, end = np.arange(count)[:, None], np.arange(count + 1)
    outside = end <= begin
    # Each sum has shape (n, n + 1).
    w, wt, wtt, wy, wty, wyy, logs = np.where(outside, 0.0, sums[:, None, :] - sums[:, :-1, None])
    gone = -0.5 * (wyy + logs)
    stands = gone + calc_elementwise_gain(w, wy, level_sd)
    middle = np.divide(wt, w, out=np.zeros_like(wt), where=w > 0.0)
    spread, score = np.maximum(wtt - wt * middle, 0.0), wty - middle * wy
    line = stands + calc_elementwise_gain(spread, score, SLOPE_SD_OF_LEVEL_SD * level_sd)
    prior = (
        STAY_LOG_PROB * (end - 1 - begin)
        + CHANGE_LOG_PROB * (begin > 0)
        - np.log(len(STRETCH_KINDS))
    )
    return np.where(outside, -np.inf, np.stack([gone, stands, line]) + prior)
