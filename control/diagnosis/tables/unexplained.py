"""Structure that no catalogued effect explains: what is left, against every recorded setting."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import f as fisher

from control.diagnosis.effects import ROWS

from .algebra import MIN_LENGTH_LEFT, Design, design_of, orthonormal, projected_out, whitened
from .null import DECIDED, DRAWS
from .piece import Array, BoolArray, SizedEffect
from .problem import Problem
from .sizes import forms_of
from .ties import first_best

LEVEL = 0.003               # of a false alarm by the strongest dependence: what selection leaves of 1 % (see there)
DEGREES = (1, 2, 4)         # of the Chebyshev polynomials tried over each setting
MAX_VALUES = 12             # of a setting, for each value to have a mean of its own
MAX_DOF_SHARE = 0.4         # of the degrees of freedom that are left, for one dependence
MIN_REPLICATE_VARIANCE = 0.01       # floor of the residual variance where the replicates themselves are asked


class Structure(NamedTuple):
    """The strongest dependence on one recorded setting. `p`: of the whole search.

    `share`: of the scatter that was left, explained beyond what noise would be; `sum_of_squares`: the same, whitened.
    """

    channel: str
    variable: str
    p: float
    share: float
    sum_of_squares: float

    @property
    def shown(self) -> bool:
        return self.p < LEVEL


class _Dependence(NamedTuple):
    """One channel's dependence on one setting, in one shape: orthonormal columns (m, k)."""

    channel: str
    variable: str
    unit: Array


def remaining_structure(problem: Problem, effects: Sequence[SizedEffect], seed: int) -> Structure | None:
    """The strongest remaining dependence on one setting. None where no setting varies or no freedom is left."""
    design = design_of(problem, effects)
    explained = explained_by(problem, effects, design)
    tried = _dependences(problem, explained, design)
    if not tried:
        return None
    y = projected_out(explained, design.y)
    total = float(y @ y) + design.prior_rss
    dof = len(y) - explained.shape[1] + design.prior_dof
    ps = _f_test_ps(y[None, :], np.array([total]), tried, dof, [_min_variance(one, design) for one in tried])[0]
    best = tried[first_best(-ps)]
    p = _of_the_search(float(ps.min()), tried, explained, design, dof, seed)
    size = best.unit.shape[1]
    found = float(np.sum((best.unit.T @ y) ** 2))
    noise = (total - found) / max(1.0, dof - size)
    beyond = max(0.0, found - size * noise)
    return Structure(best.channel, best.variable, p, beyond / total if total > 0.0 else 0.0, beyond)


def explained_by(problem: Problem, effects: Sequence[SizedEffect], design: Design) -> Array:
    """What needs no explanation, (m, k): tolerances, the effects in any shape, and what half of one of them may be."""
    chosen = [effect.candidate for effect in effects]
    index = [problem.candidates.index(candidate) for candidate in chosen]
    halves = [problem.candidates.index(candidate) for candidate in problem.candidates
              if any(candidate.id in ROWS[one.id].half_looks_like for one in chosen)]
    return orthonormal(np.column_stack([design.nuisances, design.x[:, [*index, *halves]], forms_of(problem, chosen)]))


def _of_the_search(single: float, tried: Sequence[_Dependence], explained: Array, design: Design, dof: float,
                   seed: int) -> float:
    """p of the smallest p of all the F tests: Bonferroni where that decides, else by draws of noise."""
    if single * len(tried) < DECIDED * LEVEL or single > LEVEL:
        return min(1.0, single * len(tried))
    rng = np.random.default_rng(seed)
    draws = rng.standard_normal((DRAWS, len(design.y)))
    draws = draws - (draws @ explained) @ explained.T
    totals = np.sum(draws ** 2, axis=1) + (rng.chisquare(design.prior_dof, DRAWS) if design.prior_dof else 0.0)
    least = _f_test_ps(draws, totals, tried, dof, [1e-12] * len(tried)).min(axis=1)
    return (int(np.sum(least <= single)) + 1) / (DRAWS + 1)


def _f_test_ps(rows: Array, totals: Array, tried: Sequence[_Dependence], dof: float,
               min_variances: Sequence[float]) -> Array:
    """(draws, tried): p of the F test of each; below its minimum the variance of the rest does not count as smaller."""
    out = np.ones((len(rows), len(tried)))
    for k, one in enumerate(tried):
        size = one.unit.shape[1]
        explained = np.sum((rows @ one.unit) ** 2, axis=1)
        rest = np.maximum(totals - explained, min_variances[k] * (dof - size))
        out[:, k] = fisher.sf(explained / size / (rest / (dof - size)), size, dof - size)
    return out


def _min_variance(one: _Dependence, design: Design) -> float:
    """Rows do not scatter less than their replicates, unless what is asked is whether the replicates differ."""
    return MIN_REPLICATE_VARIANCE if one.variable == "replicate" else design.min_variance


def _dependences(problem: Problem, explained: Array, design: Design) -> list[_Dependence]:
    """Every setting of every piece, its labels, and a constant, in every shape that leaves enough freedom."""
    found = []
    max_size = MAX_DOF_SHARE * (len(design.y) - explained.shape[1])
    for index, piece in enumerate(problem.pieces):
        inside = problem.piece == index
        texts = list(dict.fromkeys(piece.group.tolist()))
        shapes = {name: _shapes(problem, inside, values) for name, values in piece.variables.items()}
        shapes["label"] = [_one_hot(inside, piece.group, texts[1:])] if len(texts) > 1 else []
        shapes["constant"] = [inside.astype(float)[:, None]]
        scale = np.abs(problem.nominal) if len(piece.spreads) > 1 else np.ones(len(problem.nominal))
        for name, shape in ((name, shape) for name, several in shapes.items() for shape in several):
            unit = _beyond(explained, whitened(problem, shape * scale[:, None]))
            if 0 < unit.shape[1] <= max_size:
                found.append(_Dependence(piece.channel, name, unit))
    return found


def _beyond(basis: Array, columns: Array) -> Array:
    """Orthonormal basis of what the columns have beyond `basis`; near-copies of it are dropped."""
    left = projected_out(basis, columns)
    keep = np.linalg.norm(left, axis=0) > MIN_LENGTH_LEFT * np.linalg.norm(columns, axis=0)
    return orthonormal(left[:, keep])


def _shapes(problem: Problem, inside: BoolArray, values: Array) -> list[Array]:
    """Polynomials, and every value by itself where that is few."""
    kinds = np.unique(values)
    x = 2.0 * (values - kinds[0]) / (kinds[-1] - kinds[0]) - 1.0
    degrees = [d for d in DEGREES if d < len(kinds)] or [len(kinds) - 1]
    out = []
    for degree in degrees:
        block = np.zeros((len(problem.observed), degree))
        for k in range(degree):
            block[inside, k] = np.cos((k + 1) * np.arccos(np.clip(x, -1.0, 1.0)))
        out.append(block)
    if 2 < len(kinds) <= MAX_VALUES and len(kinds) < 0.5 * len(values):
        out.append(_one_hot(inside, values, kinds[1:].tolist()))
    return out


def _one_hot(inside: BoolArray, values: np.ndarray, kinds: Sequence[object]) -> Array:
    block = np.zeros((len(inside), len(kinds)))
    for k, kind in enumerate(kinds):
        block[inside, k] = values == kind
    return block
