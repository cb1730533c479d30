"""Calculates the log evidence of a linear model of a few rows, integrated over the strength of
their noise.

Rows y (n,), divided by the s.d. that the replicates suggest, are

    y = X b + s (t u + e),    b ~ N(0, diag(S^2)),    e ~ N(0, 1) by row,    u ~ N(0, 1) by setting

s is the error factor of that s.d.; t is the noise that all rows of one setting share, because a
setting is never reproduced exactly. For given s and t the model is Gaussian and b is integrated in
closed form (`gaussian.py`, (6)). Both are integrated on a grid: s^2 with a scaled inverse
chi-square prior of `PRIOR_DOF` around 1, and t with `SHARED_NOISE_GRID`. Where tables are judged
together, rows without replicates have their own factor on their s.d. (`UNREPEATED_SD_GRID`),
because the s of the other rows says little about them. As a result, intervals grow where settings
differ by more than their rows do, and have the tails of Student's t where rows are few.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .gaussian import ColumnProducts

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Prior knowledge of the noise is worth this number of rows.
PRIOR_DOF = 2.0
# Values and prior probabilities of the noise shared by the rows of a setting, relative to their own
# noise: mostly zero, rarely as much as the noise.
SHARED_NOISE_GRID = ((0.0, 0.8), (0.3, 0.1), (0.6, 0.06), (1.2, 0.04))
# Values and prior probabilities of the error factor of the s.d. of rows without replicates, where
# other rows have replicates.
UNREPEATED_SD_GRID = ((0.6, 0.2), (1.0, 0.4), (1.7, 0.25), (2.8, 0.15))
# Grid of s in steps of 14 %.
NOISE_FACTORS = np.exp(np.linspace(np.log(0.02), np.log(50.0), 60))


class RowProducts(NamedTuple):
    """Products of columns (T, p, p) and data for each t and each factor of rows without replicates;
    `log_det`: (T,); `shared`: t, (T,)."""

    products: ColumnProducts
    log_det: Array
    # Log prior of s, t and factors, (T, strengths).
    log_prior: Array
    shared: Array
    n: int


class Posterior(NamedTuple):
    """Mean (k,) and covariance (k, k) of b. `settings_share`: probability that t exceeds zero."""

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
) -> RowProducts:
    """Return the products for each t.

    y : (n,) data; columns : (n, p); setting : (n,) index from 0; rounding : (n,) s.d. of the
    rounding error common to all rows of a setting; least : lower bound of s^2; usual : expected s;
    alone : (n,) each, rows whose noise has its own factor.
    """
    both = np.column_stack([y, columns])
    counts = np.bincount(setting)
    cells = (setting[:, None] == np.arange(len(counts))).astype(float)
    own = (cells.T @ rounding) / np.maximum(counts, 1)
    grams, log_det, log_p, shared = [], [], [], []
    for factors in product(UNREPEATED_SD_GRID, repeat=len(alone)):
        factor = np.ones(len(y))
        for rows, (value, _) in zip(alone, factors, strict=True):
            factor = np.where(rows, value, factor)
        here = both / factor[:, None]
        whole, sums = here.T @ here, cells.T @ here
        for t, p in SHARED_NOISE_GRID:
            variance = t**2 + own**2
            grams.append(whole - (sums * (variance / (1.0 + counts * variance))[:, None]).T @ sums)
            log_det.append(
                float(np.sum(np.log1p(counts * variance)) + 2.0 * np.sum(np.log(factor)))
            )
            log_p.append(float(np.log(p) + sum(np.log(share) for _, share in factors)))
            shared.append(t)
    squares = NOISE_FACTORS**2
    log_s = np.where(
        squares >= least,
        -PRIOR_DOF * np.log(NOISE_FACTORS) - 0.5 * PRIOR_DOF * usual**2 / squares,
        -np.inf,
    )
    log_prior = log_s - np.logaddexp.reduce(log_s) + np.array(log_p)[:, None]
    # Row and column 0 are the data.
    every = np.stack(grams)
    products = ColumnProducts(every[:, 1:, 1:], every[:, 1:, 0], every[:, 0, 0])
    return RowProducts(products, np.array(log_det), log_prior, np.array(shared), len(y))


def calc_posterior(rows: RowProducts, chosen: IntArray, sd: Array, sizes: bool = True) -> Posterior:
    """Return the posterior of the model with the chosen columns (k,), whose sizes have the prior
    s.d. `sd` (k,)."""
    squares, along = (
        NOISE_FACTORS**2,
        rows.products.select_columns(chosen).find_independent_axes(sd),
    )
    value = (
        along.calc_log_evidence(squares)
        - rows.n * np.log(NOISE_FACTORS)
        - 0.5 * rows.log_det[:, None]
        + rows.log_prior
        # The sum has shape (T, strengths).
    )
    # scipy's logsumexp would take a third of the time of a table.
    total = float(np.logaddexp.reduce(value, axis=None))
    if not sizes:
        return Posterior(total, np.zeros(0), np.zeros((0, 0)), 0.0)
    # The weights have shape (T, strengths).
    weight = np.exp(value - total)
    means, variances = along.calc_sizes(squares)
    mean = np.einsum("ts,tsi->i", weight, means)
    within = np.einsum(
        "tij,tj,tkj->ik", along.axes, np.einsum("ts,tsj->tj", weight, variances), along.axes
    )
    away = means - mean
    between = np.einsum("ts,tsi,tsj->ij", weight, away, away)
    return Posterior(total, mean, within + between, float(weight[rows.shared > 0.0].sum()))


def mix_posteriors(one: Posterior, other: Posterior, share: float) -> Posterior:
    """Return the mixture of two models of the same sizes; the first has the prior probability
    `share`."""
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
