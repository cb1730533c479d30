"""Log evidence of a linear model of a few rows, with the strength of their noise integrated.

Rows y (n,), divided by the s.d. that the noise has by the look of the replicates, are

    y = X b + s (t u + e),    b ~ N(0, diag(S^2)),    e ~ N(0, 1) by row,    u ~ N(0, 1) by setting

s is what that s.d. is wrong by; t what all rows of one setting share, for a setting is never
set twice alike. Under a given s and t all is Gaussian and b is integrated in closed form
(`gaussian.py`, (6)). Both are integrated on a grid: s^2 by a scaled inverse chi-square of `DOF`
about 1, and t by `SHARED`. Where tables are judged together, rows without replicates have a
factor of their own on their s.d. (`ALONE`): what the others know of s says little of them. That
intervals grow where settings differ by more than their rows do, and that they have the tails of
Student's t where rows are few, comes out of that by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .gaussian import Gaussian

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# what is known of the noise beforehand is worth so many rows
DOF = 2.0
# What the rows of one setting share, over their own noise, and how often: mostly nothing,
# rarely as much as the noise.
SHARED = ((0.0, 0.8), (0.3, 0.1), (0.6, 0.06), (1.2, 0.04))
# What the s.d. of rows without replicates is wrong by, where other rows have theirs, and how often.
ALONE = ((0.6, 0.2), (1.0, 0.4), (1.7, 0.25), (2.8, 0.15))
# s: a grid of steps of 14 %
STRENGTHS = np.exp(np.linspace(np.log(0.02), np.log(50.0), 60))


class TableRows(NamedTuple):
    """`products`: of columns (T, p, p) and data for each t, and each factor of rows without
    replicates; `log_det`: (T,); `shared`: (T,) t."""

    products: Gaussian
    log_det: Array
    log_prior: Array  # of s, t and factors, (T, strengths)
    shared: Array
    n: int


class Posterior(NamedTuple):
    """Mean (k,) and covariance (k, k) of b. `settings_share`: probability that t is more than
    nothing."""

    log_evidence: float
    mean: Array
    covariance: Array
    settings_share: float


def make_table_rows(
    y: Array,
    columns: Array,
    setting: IntArray,
    rounding: Array,
    least: float,
    usual: float = 1.0,
    alone: Sequence[BoolArray] = (),
) -> TableRows:
    """Products under each t.

    y : (n,) data; columns : (n, p); setting : (n,) index from 0; rounding : (n,) s.d. of what
    rounding does alike to all rows of their setting; least : s^2 is not below it; usual : s
    that is expected; alone : (n,) each, rows whose noise has a factor of its own.
    """
    both = np.column_stack([y, columns])
    counts = np.bincount(setting)
    cells = (setting[:, None] == np.arange(len(counts))).astype(float)
    own = (cells.T @ rounding) / np.maximum(counts, 1)
    grams, log_det, log_p, shared = [], [], [], []
    for factors in product(ALONE, repeat=len(alone)):
        factor = np.ones(len(y))
        for rows, (value, _) in zip(alone, factors, strict=True):
            factor = np.where(rows, value, factor)
        here = both / factor[:, None]
        whole, sums = here.T @ here, cells.T @ here
        for t, p in SHARED:
            variance = t**2 + own**2
            grams.append(whole - (sums * (variance / (1.0 + counts * variance))[:, None]).T @ sums)
            log_det.append(
                float(np.sum(np.log1p(counts * variance)) + 2.0 * np.sum(np.log(factor)))
            )
            log_p.append(float(np.log(p) + sum(np.log(share) for _, share in factors)))
            shared.append(t)
    squares = STRENGTHS**2
    log_s = np.where(
        squares >= least, -DOF * np.log(STRENGTHS) - 0.5 * DOF * usual**2 / squares, -np.inf
    )
    log_prior = log_s - np.logaddexp.reduce(log_s) + np.array(log_p)[:, None]
    every = np.stack(grams)  # row and column 0 are the data
    products = Gaussian(every[:, 1:, 1:], every[:, 1:, 0], every[:, 0, 0])
    return TableRows(products, np.array(log_det), log_prior, np.array(shared), len(y))


def calc_posterior(rows: TableRows, chosen: IntArray, sd: Array, sizes: bool = True) -> Posterior:
    """Of the model with the chosen columns (k,), whose sizes have the prior s.d. `sd` (k,)."""
    squares, along = STRENGTHS**2, rows.products.of(chosen).find_independent_axes(sd)
    value = (
        along.log_evidence(squares)
        - rows.n * np.log(STRENGTHS)
        - 0.5 * rows.log_det[:, None]
        + rows.log_prior
    )  # (T, strengths)
    # scipy's logsumexp: a third of all that a table takes
    total = float(np.logaddexp.reduce(value, axis=None))
    if not sizes:
        return Posterior(total, np.zeros(0), np.zeros((0, 0)), 0.0)
    weight = np.exp(value - total)  # (T, strengths)
    means, variances = along.sizes(squares)
    mean = np.einsum("ts,tsi->i", weight, means)
    within = np.einsum(
        "tij,tj,tkj->ik", along.axes, np.einsum("ts,tsj->tj", weight, variances), along.axes
    )
    away = means - mean
    between = np.einsum("ts,tsi,tsj->ij", weight, away, away)
    return Posterior(total, mean, within + between, float(weight[rows.shared > 0.0].sum()))


def mix_posteriors(one: Posterior, other: Posterior, share: float) -> Posterior:
    """Of two models of the same sizes, of which the first has the prior probability `share`."""
    logs = np.array([np.log(share) + one.log_evidence, np.log(1.0 - share) + other.log_evidence])
    total = float(np.logaddexp(*logs))
    p, q = np.exp(logs - total).tolist()
    mean = p * one.mean + q * other.mean
    away = one.mean - other.mean
    return Posterior(
        total,
        mean,
        p * one.covariance + q * other.covariance + p * q * np.outer(away, away),
        p * one.settings_share + q * other.settings_share,
    )
