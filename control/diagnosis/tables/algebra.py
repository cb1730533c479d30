"""The linear algebra of a diagnosis: whitened rows with tolerances as pseudo-observations, subsets of columns."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .piece import Array, Choice, Sized
from .problem import Problem

SPENT = 0.05            # share of a column's length that must be left after others, else it cannot be told from them


class Space(NamedTuple):
    """m = n rows + q tolerances. `y`: (m,) what the parts and all else leave, the parts' own share put back."""

    y: Array
    x: Array                # (m, c), one column for each choice
    basis: Array            # (m, q) orthonormal: the tolerances
    extra_rss: float
    extra_dof: float
    least_variance: float = 1e-9


class Subset(NamedTuple):
    """`rss` has a floor: rows that scatter less than their noise do not make the tolerances any narrower."""

    sizes: Array
    se: Array
    rss: float
    dof: float

    @property
    def variance(self) -> float:
        return self.rss / self.dof


def space_of(problem: Problem, parts: Sequence[Sized] = ()) -> Space:
    """Linearised about the parts."""
    base, slopes = problem.slopes(parts)
    residual = problem.observed - base
    for choice, size in parts:
        residual = residual + size * slopes[:, problem.choices.index(choice)]
    extra = problem.nuisances.shape[1]
    y = np.concatenate([residual / problem.sd, np.zeros(extra)])
    return Space(y, widened(problem, slopes), orthonormal(np.vstack([problem.nuisances / problem.sd[:, None],
                                                                     np.eye(extra)])),
                 problem.prior_rss, problem.prior_dof, problem.least_variance)


def widened(problem: Problem, columns: Array) -> Array:
    """Whitened columns (n, k) with zeros for the tolerances, (m, k)."""
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


def without(basis: Array, columns: Array) -> Array:
    """Columns less their share in an orthonormal basis."""
    return np.asarray(columns - basis @ (basis.T @ columns))


def subset(space: Space, index: Sequence[int]) -> Subset | None:
    """Least squares on some columns; None where they cannot be told apart or no degree of freedom is left."""
    y = without(space.basis, space.y)
    dof = len(y) - space.basis.shape[1] - len(index) + space.extra_dof
    if dof <= 0.0:
        return None
    if len(index) == 0:
        return Subset(np.zeros(0), np.zeros(0), max(float(y @ y) + space.extra_rss, space.least_variance * dof), dof)
    raw = space.x[:, list(index)]
    x = without(space.basis, raw)
    length = np.linalg.norm(x, axis=0)
    if np.any(length <= SPENT * np.linalg.norm(raw, axis=0)) or np.any(length <= 1e-9):
        return None
    gram = (x / length).T @ (x / length)
    if np.linalg.eigvalsh(gram)[0] < SPENT ** 2:
        return None
    sizes = np.linalg.solve(gram, (x / length).T @ y)
    rest = y - (x / length) @ sizes
    rss = max(float(rest @ rest) + space.extra_rss, space.least_variance * dof)
    se = np.sqrt(np.diag(np.linalg.inv(gram)) * rss / dof) / length
    return Subset(sizes / length, se, rss, dof)


class Refit(NamedTuple):
    parts: tuple[Sized, ...]
    subset: Subset
    space: Space


def refitted(problem: Problem, chosen: Sequence[Choice], rounds: int = 4) -> Refit | None:
    """Gauss-Newton through the machine model for the sizes of the chosen effects. None: they cannot be told apart."""
    found, parts = sizes_of(problem, chosen, rounds)
    if found is None:
        return None
    return Refit(parts, found, space_of(problem, parts))


def sizes_of(problem: Problem, chosen: Sequence[Choice], rounds: int = 4) -> tuple[Subset | None, tuple[Sized, ...]]:
    """The fit alone; None in place of the subset where the effects cannot be told apart."""
    alone = problem._replace(choices=tuple(chosen))
    parts: tuple[Sized, ...] = ()
    found = None
    for _ in range(rounds if chosen else 1):
        found = subset(space_of(alone, parts), range(len(chosen)))
        if found is None:
            return None, ()
        before = parts
        parts = tuple(Sized(choice, float(size)) for choice, size in zip(chosen, found.sizes, strict=True))
        if before and max(abs(a.size - b.size) / (s + 1e-12)
                          for a, b, s in zip(parts, before, found.se, strict=True)) < 1e-3:
            break
    return found, parts
