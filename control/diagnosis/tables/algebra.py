"""The linear algebra of a diagnosis: whitened rows with tolerances as pseudo-observations, least squares on columns."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .piece import Array, Candidate, SizedEffect
from .problem import Problem

# Collinearity: share of a column's length that must be left once others are projected out of it, else its effect
# cannot be told from theirs. 0.05 is a variance inflation of 400.
MIN_LENGTH_LEFT = 0.05
MIN_LENGTH = 1e-9           # of a whitened column: its effect does nothing to these rows
SETTLED = 1e-3              # standard errors that a Gauss-Newton step may still move a size


class Design(NamedTuple):
    """The rows linearised about the effects that are in the machine, whitened: divided by their noise.

    m = n rows + q tolerances. A tolerance of the machine file is a nuisance parameter with a standard normal prior: a
    pseudo-observation of 0.
    """

    y: Array                # (m,) residual with the share of the effects put back
    x: Array                # (m, c), one column for each candidate
    nuisances: Array        # (m, q) orthonormal
    prior_rss: float        # of what the machine file says of the noise
    prior_dof: float
    min_variance: float = 1e-9


class LeastSquares(NamedTuple):
    """`rss` has a floor: rows that scatter less than their noise do not make the tolerances any narrower."""

    sizes: Array
    se: Array
    rss: float
    dof: float

    @property
    def variance(self) -> float:
        return self.rss / self.dof


class Fit(NamedTuple):
    effects: tuple[SizedEffect, ...]
    estimate: LeastSquares
    design: Design


def design_of(problem: Problem, effects: Sequence[SizedEffect] = ()) -> Design:
    """Linearised about the effects."""
    base, slopes = problem.slopes(effects)
    residual = problem.observed - base
    for candidate, size in effects:
        residual = residual + size * slopes[:, problem.candidates.index(candidate)]
    extra = problem.nuisances.shape[1]
    y = np.concatenate([residual / problem.sd, np.zeros(extra)])
    return Design(y, whitened(problem, slopes), orthonormal(np.vstack([problem.nuisances / problem.sd[:, None],
                                                                       np.eye(extra)])),
                  problem.prior_rss, problem.prior_dof, problem.min_variance)


def whitened(problem: Problem, columns: Array) -> Array:
    """Columns (n, k) divided by the noise, with zeros for the tolerances, (m, k)."""
    return np.vstack([columns / problem.sd[:, None], np.zeros((problem.nuisances.shape[1], columns.shape[1]))])


def orthonormal(columns: Array) -> Array:
    """Basis of what the columns (m, k) span; negligible directions are dropped."""
    if columns.shape[1] == 0:
        return columns
    length = np.linalg.norm(columns, axis=0)
    columns = columns[:, length > 0.0] / length[length > 0.0]
    if columns.shape[1] == 0:
        return columns
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, s > 1e-7 * s[0]])


def projected_out(basis: Array, columns: Array) -> Array:
    """Columns less their share in an orthonormal basis."""
    return np.asarray(columns - basis @ (basis.T @ columns))


def least_squares(design: Design, index: Sequence[int]) -> LeastSquares | None:
    """Least squares on some columns; None where they cannot be told apart or no degree of freedom is left."""
    y = projected_out(design.nuisances, design.y)
    dof = len(y) - design.nuisances.shape[1] - len(index) + design.prior_dof
    if dof <= 0.0:
        return None
    if len(index) == 0:
        return LeastSquares(np.zeros(0), np.zeros(0), max(float(y @ y) + design.prior_rss, design.min_variance * dof),
                            dof)
    raw = design.x[:, list(index)]
    x = projected_out(design.nuisances, raw)
    length = np.linalg.norm(x, axis=0)
    if np.any(length <= MIN_LENGTH_LEFT * np.linalg.norm(raw, axis=0)) or np.any(length <= MIN_LENGTH):
        return None
    gram = (x / length).T @ (x / length)
    if np.linalg.eigvalsh(gram)[0] < MIN_LENGTH_LEFT ** 2:
        return None
    sizes = np.linalg.solve(gram, (x / length).T @ y)
    rest = y - (x / length) @ sizes
    rss = max(float(rest @ rest) + design.prior_rss, design.min_variance * dof)
    se = np.sqrt(np.diag(np.linalg.inv(gram)) * rss / dof) / length
    return LeastSquares(sizes / length, se, rss, dof)


def fitted(problem: Problem, candidates: Sequence[Candidate], rounds: int = 4) -> Fit | None:
    """Gauss-Newton through the machine model for the sizes. None: they cannot be told apart."""
    found, effects = estimated(problem, candidates, rounds)
    return None if found is None else Fit(effects, found, design_of(problem, effects))


def estimated(problem: Problem, candidates: Sequence[Candidate],
              rounds: int = 4) -> tuple[LeastSquares | None, tuple[SizedEffect, ...]]:
    """The estimate alone; None in its place where the effects cannot be told apart."""
    alone = problem._replace(candidates=tuple(candidates))
    effects: tuple[SizedEffect, ...] = ()
    found = None
    for _ in range(rounds if candidates else 1):
        found = least_squares(design_of(alone, effects), range(len(candidates)))
        if found is None:
            return None, ()
        before = effects
        effects = tuple(SizedEffect(candidate, float(size))
                        for candidate, size in zip(candidates, found.sizes, strict=True))
        if before and max(abs(a.size - b.size) / (s + 1e-12)
                          for a, b, s in zip(effects, before, found.se, strict=True)) < SETTLED:
            break
    return found, effects
