"""Structure that no catalogued effect explains: what is left, against every recorded setting."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import f as fisher

from .algebra import SPENT, Space, orthonormal, space_of, widened, without
from .piece import Array, Sized
from .problem import Problem
from .selection import ONE_SIDED, forms_of

LEVEL = 0.003
DRAWS = 2000
POWERS = (1, 2, 4)          # sizes of the smooth bases


class Left(NamedTuple):
    """`share`: of the scatter that was left, explained beyond what noise would be. `p`: of the whole search."""

    channel: str
    variable: str
    p: float
    share: float
    sum_of_squares: float


LEAST_OF_REPLICATES = 0.01


class _Basis(NamedTuple):
    channel: str
    variable: str
    unit: Array


def left_over(problem: Problem, parts: Sequence[Sized], seed: int) -> Left | None:
    """The strongest remaining dependence on one setting. None where no setting varies or no freedom is left."""
    space = space_of(problem, parts)
    chosen = [part.choice for part in parts]
    index = [problem.choices.index(choice) for choice in chosen]
    sides = [problem.choices.index(choice) for choice in problem.choices
             if any(choice.id in ONE_SIDED.get(one.id, ()) for one in chosen)]
    basis = orthonormal(np.column_stack([space.basis, space.x[:, [*index, *sides]], forms_of(problem, chosen)]))
    bases = _bases(problem, basis, space)
    if not bases:
        return None
    y = without(basis, space.y)
    dof = len(y) - basis.shape[1] + space.extra_dof
    ps = _p_values(y[None, :], np.array([float(y @ y) + space.extra_rss]), bases, dof,
                   [_least(one, space) for one in bases])[0]
    best = int(np.argmin(ps))
    single = float(ps[best])
    if single * len(bases) < 0.2 * LEVEL or single > LEVEL:
        p = min(1.0, single * len(bases))
    else:
        rng = np.random.default_rng(seed)
        draws = rng.standard_normal((DRAWS, len(y)))
        draws = draws - (draws @ basis) @ basis.T
        totals = np.sum(draws ** 2, axis=1) + (rng.chisquare(space.extra_dof, DRAWS) if space.extra_dof else 0.0)
        least = _p_values(draws, totals, bases, dof, [1e-12] * len(bases)).min(axis=1)
        p = (int(np.sum(least <= single)) + 1) / (DRAWS + 1)
    size = bases[best].unit.shape[1]
    explained = float(np.sum((bases[best].unit.T @ y) ** 2))
    total = float(y @ y) + space.extra_rss
    noise = (total - explained) / max(1.0, dof - size)
    share = max(0.0, explained - size * noise) / total if total > 0.0 else 0.0
    return Left(bases[best].channel, bases[best].variable, p, share, max(0.0, explained - size * noise))


def _p_values(rows: Array, totals: Array, bases: Sequence[_Basis], dof: float,
              least: Sequence[float]) -> Array:
    """(draws, bases): F test of each basis; `least`: variances below which the rest does not count as smaller."""
    out = np.ones((len(rows), len(bases)))
    for k, basis in enumerate(bases):
        size = basis.unit.shape[1]
        explained = np.sum((rows @ basis.unit) ** 2, axis=1)
        rest = np.maximum(totals - explained, least[k] * (dof - size))
        out[:, k] = fisher.sf(explained / size / (rest / (dof - size)), size, dof - size)
    return out


def _least(basis: _Basis, space: Space) -> float:
    """Rows do not scatter less than their replicates, unless what is asked is whether the replicates differ."""
    return LEAST_OF_REPLICATES if basis.variable == "replicate" else space.least_variance


def _bases(problem: Problem, basis: Array, space: Space) -> list[_Basis]:
    found = []
    most = 0.4 * (len(space.y) - basis.shape[1])
    for index, piece in enumerate(problem.pieces):
        inside = problem.piece == index
        columns: dict[str, list[Array]] = {}
        for name, values in piece.variables.items():
            columns[name] = _shapes(problem, inside, values)
        texts = list(dict.fromkeys(piece.group.tolist()))
        columns["label"] = [_one_hot(inside, piece.group, texts[1:])] if len(texts) > 1 else []
        columns["constant"] = [inside.astype(float)[:, None]]
        size = np.abs(problem.nominal) if len(piece.spreads) > 1 else np.ones(len(problem.nominal))
        for name, shapes in columns.items():
            for shape in shapes:
                unit = orthonormal_left(basis, widened(problem, shape * size[:, None]))
                if 0 < unit.shape[1] <= most:
                    found.append(_Basis(piece.channel, name, unit))
    return found


def orthonormal_left(basis: Array, columns: Array) -> Array:
    """Orthonormal basis of what the columns have beyond `basis`; near-copies of it are dropped."""
    left = without(basis, columns)
    keep = np.linalg.norm(left, axis=0) > SPENT * np.linalg.norm(columns, axis=0)
    return orthonormal(left[:, keep])


def _shapes(problem: Problem, inside: np.ndarray, values: Array) -> list[Array]:
    """Polynomials, and every value by itself where that is few."""
    kinds = np.unique(values)
    x = 2.0 * (values - kinds[0]) / (kinds[-1] - kinds[0]) - 1.0
    powers = [p for p in POWERS if p < len(kinds)] or [len(kinds) - 1]
    out = []
    for power in powers:
        block = np.zeros((len(problem.observed), power))
        for k in range(power):
            block[inside, k] = np.cos((k + 1) * np.arccos(np.clip(x, -1.0, 1.0)))
        out.append(block)
    if 2 < len(kinds) <= 12 and len(kinds) < 0.5 * len(values):
        out.append(_one_hot(inside, values, kinds[1:].tolist()))
    return out


def _one_hot(inside: np.ndarray, values: np.ndarray, kinds: Sequence[object]) -> Array:
    block = np.zeros((len(inside), len(kinds)))
    for k, kind in enumerate(kinds):
        block[inside, k] = values == kind
    return block
