"""How often noise alone gives as much: the largest of everything searched, under Gaussian noise of unknown size.

The statistics do not depend on the size of the noise, so draws of unit noise in the same rows give their distribution
(a Monte Carlo max-t test; Westfall and Young 1993).
"""
from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from .algebra import MIN_LENGTH, MIN_LENGTH_LEFT, projected_out
from .piece import Array
from .ties import first_best

DRAWS = 2000                # p of 0.003 is then known to 0.0012
DECIDED = 0.2               # of the level: a Bonferroni bound below this share of it needs no draws


def normalised(basis: Array, columns: Array) -> tuple[Array, list[int]]:
    """Columns less the basis at unit length, and which of them are left."""
    left = projected_out(basis, columns)
    length = np.linalg.norm(left, axis=0)
    keep = [k for k in range(columns.shape[1])
            if length[k] > max(MIN_LENGTH_LEFT * float(np.linalg.norm(columns[:, k])), MIN_LENGTH)]
    return left[:, keep] / length[keep], keep


def max_t_p(y: Array, basis: Array, unit: Array, prior_rss: float, prior_dof: float, level: float,
            seed: int, min_variance: float = 1e-9) -> tuple[float, int]:
    """p of the best single column against all of them having been tried, and which it is (-1: none can be judged; of
    columns that fit alike the first).

    y: (m,), basis: (m, r) orthonormal, unit: (m, c) orthogonal to it and of unit length. Far from `level` a bound
    decides (Bonferroni above, Sidak below); near it, draws do.
    """
    dof = y.shape[0] - basis.shape[1] - 1 + prior_dof
    if unit.shape[1] == 0 or dof <= 0:
        return 1.0, -1
    y = projected_out(basis, y)
    shares = (unit.T @ y) ** 2
    best = first_best(shares)
    total = float(y @ y) + prior_rss
    ratio = float(shares[best] / max(total - shares[best], min_variance * dof))
    single = float(2.0 * student.sf(np.sqrt(ratio * dof), dof))
    count = unit.shape[1]
    if single * count < DECIDED * level:
        return single * count, best
    if single > level:
        return 1.0 - (1.0 - single) ** count, best
    rng = np.random.default_rng(seed)
    draws = rng.standard_normal((DRAWS, y.shape[0]))
    totals = np.sum(draws ** 2, axis=1) - np.sum((draws @ basis) ** 2, axis=1)
    if prior_dof > 0:
        totals = totals + rng.chisquare(prior_dof, DRAWS)
    most = np.max((draws @ unit) ** 2, axis=1)
    reached = int(np.sum(most / np.maximum(totals - most, 1e-12) >= ratio))
    return (reached + 1) / (DRAWS + 1), best
