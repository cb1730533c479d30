"""How often noise alone gives as much: the largest of everything searched, under Gaussian noise of unknown size.

The statistics do not depend on the size of the noise, so draws of unit noise in the same rows give their distribution.
"""
from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from .algebra import SPENT, without
from .piece import Array

DRAWS = 2000


def normalised(basis: Array, columns: Array) -> tuple[Array, list[int]]:
    """Columns less the basis at unit length, and which of them are left."""
    left = without(basis, columns)
    length = np.linalg.norm(left, axis=0)
    keep = [k for k in range(columns.shape[1])
            if length[k] > max(SPENT * float(np.linalg.norm(columns[:, k])), 1e-9)]
    return left[:, keep] / length[keep], keep


def largest_p(y: Array, basis: Array, unit: Array, extra_rss: float, extra_dof: float, level: float,
              seed: int, least: float = 1e-9) -> tuple[float, int]:
    """p of the best single column against all of them having been tried, and which it is.

    y: (m,), basis: (m, r) orthonormal, unit: (m, c) orthogonal to it and of unit length. Far from `level` a bound
    decides (Bonferroni above, Sidak below); near it, draws do.
    """
    dof = y.shape[0] - basis.shape[1] - 1 + extra_dof
    if unit.shape[1] == 0 or dof <= 0:
        return 1.0, -1
    y = without(basis, y)
    shares = (unit.T @ y) ** 2
    best = int(np.argmax(shares))
    total = float(y @ y) + extra_rss
    ratio = float(shares[best] / max(total - shares[best], least * dof))
    single = float(2.0 * student.sf(np.sqrt(ratio * dof), dof))
    count = unit.shape[1]
    if single * count < 0.2 * level:
        return single * count, best
    if single > level:
        return 1.0 - (1.0 - single) ** count, best
    rng = np.random.default_rng(seed)
    draws = rng.standard_normal((DRAWS, y.shape[0]))
    totals = np.sum(draws ** 2, axis=1) - np.sum((draws @ basis) ** 2, axis=1)
    if extra_dof > 0:
        totals = totals + rng.chisquare(extra_dof, DRAWS)
    most = np.max((draws @ unit) ** 2, axis=1)
    reached = int(np.sum(most / np.maximum(totals - most, 1e-12) >= ratio))
    return (reached + 1) / (DRAWS + 1), best
