"""Sizes and intervals of chosen effects: where settings differ by more than replicates, and where shapes matter."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import f as fisher

from .algebra import Design, LeastSquares, least_squares, orthonormal, projected_out, whitened
from .noise import NO_SCATTER
from .piece import Array, Candidate, IntArray, SizedEffect
from .problem import Problem

LACK_OF_FIT_P = 0.05        # lack-of-fit F test: below it intervals are widened, or other shapes are let in
MIN_PURE_DOF, MIN_LACK_DOF = 3, 2       # of that test: replicates, and settings beyond the effects
SETTINGS_P = 0.01           # F test of setting means against replicates, for a sentence


def forms_of(problem: Problem, chosen: Sequence[Candidate]) -> Array:
    """Other shapes of the chosen effects, whitened, (m, k): what a wrong shape leaves must call in no second cause."""
    columns = [np.zeros((len(problem.observed), 0))]
    for effect_id in dict.fromkeys(candidate.id for candidate in chosen):
        shapes = [piece.forms.get(effect_id) for piece in problem.pieces]
        width = max((s.shape[1] for s in shapes if s is not None), default=0)
        if width:
            columns.append(np.concatenate([np.zeros((len(piece.observed), width)) if s is None else s
                                           for piece, s in zip(problem.pieces, shapes, strict=True)]))
    return whitened(problem, np.column_stack(columns))


def lack_of_fit(problem: Problem, effects: Sequence[SizedEffect], best: LeastSquares) -> tuple[float, float]:
    """Factor by which intervals grow, and their degrees of freedom, by the lack-of-fit F test.

    Mean squares of setting means about the model against those of replicates about their means (Draper and Smith,
    Applied Regression Analysis, 1998, ch. 2). Where settings differ by more, they are what the intervals must count.
    """
    rows = len(problem.observed)
    forms = orthonormal(forms_of(problem, [effect.candidate for effect in effects])[:rows])
    rest = projected_out(forms, (problem.observed - problem.predicted(effects)) / problem.sd)
    counts = np.bincount(problem.setting)
    means = np.bincount(problem.setting, rest) / counts
    pure_dof = int(np.sum(counts - 1))
    lack_dof = len(counts) - len(effects) - forms.shape[1]
    if pure_dof < MIN_PURE_DOF or lack_dof < MIN_LACK_DOF:
        return 1.0, best.dof
    pure = float(np.sum((rest - means[problem.setting]) ** 2)) / pure_dof
    lack = float(np.sum(counts * means ** 2)) / lack_dof
    if pure <= NO_SCATTER ** 2 or fisher.sf(lack / pure, lack_dof, pure_dof) >= LACK_OF_FIT_P:
        return 1.0, best.dof
    return max(1.0, float(np.sqrt(lack / best.variance))), float(lack_dof)


def settings_differ(rest: Array, setting: IntArray) -> bool:
    """F test of setting means against replicates: they share something that the model does not have."""
    kinds, index, counts = np.unique(setting, return_inverse=True, return_counts=True)
    means = np.bincount(index, rest) / counts
    within = float(np.sum((rest - means[index]) ** 2))
    dof = len(rest) - len(kinds)
    if dof < MIN_PURE_DOF or len(kinds) < 2 or within <= NO_SCATTER ** 2:
        return False
    between = float(np.sum(counts * means ** 2)) / len(kinds)
    return bool(fisher.sf(between / (within / dof), len(kinds), dof) < SETTINGS_P)


def beside_other_forms(problem: Problem, effects: tuple[SizedEffect, ...], best: LeastSquares,
                       design: Design) -> tuple[tuple[SizedEffect, ...], LeastSquares]:
    """Sizes that another effect's wrong shape does not pull: where shapes matter, those of the others are left free."""
    sizes, errors = [effect.size for effect in effects], best.se.copy()
    for k, effect in enumerate(effects):
        others = [other for other in effects if other != effect]
        shapes = forms_of(problem, [other.candidate for other in others])
        if not others or shapes.shape[1] == 0:
            continue
        index = [problem.candidates.index(other.candidate) for other in (effect, *others)]
        free = orthonormal(projected_out(design.nuisances, np.column_stack([shapes, design.x[:, index[1:]]])))
        fixed = design._replace(nuisances=orthonormal(np.column_stack([design.nuisances, free])))
        found = least_squares(fixed, index[:1])
        spent = fixed.nuisances.shape[1] - design.nuisances.shape[1] - len(others)
        if found is None or spent <= 0:
            continue
        ratio = (best.rss - found.rss) / spent / found.variance
        if fisher.sf(max(0.0, ratio), spent, found.dof) < LACK_OF_FIT_P:
            sizes[k], errors[k] = float(found.sizes[0]), float(found.se[0])
    return _resized(effects, sizes, best, errors)


def at_definition(problem: Problem, effects: tuple[SizedEffect, ...], best: LeastSquares,
                  design: Design) -> tuple[tuple[SizedEffect, ...], LeastSquares]:
    """Sizes read where the catalogue defines them, off the effect in whatever shape the rows ask for.

    Only where the other shapes fit better (F test), and only for effects whose piece says what a shape is worth there.
    """
    sizes, errors = [effect.size for effect in effects], best.se.copy()
    for k, effect in enumerate(effects):
        worth = next((piece.at_definition[effect.candidate.id] for piece in problem.pieces
                      if effect.candidate.id in piece.at_definition), None)
        if worth is None:
            continue
        others = [design.x[:, [problem.candidates.index(o.candidate)]] for o in effects if o != effect]
        own = np.column_stack([design.x[:, problem.candidates.index(effect.candidate)],
                               forms_of(problem, [effect.candidate])])
        found = _freely_shaped(design, others, own, worth, best)
        if found is not None:
            sizes[k], errors[k] = found
    return _resized(effects, sizes, best, errors)


def _freely_shaped(design: Design, others: Sequence[Array], columns: Array, worth: Array,
                   best: LeastSquares) -> tuple[float, float] | None:
    """Size and standard error of an effect with its shapes free; None where those do not fit better."""
    fixed = orthonormal(np.column_stack([design.nuisances, *others]))
    y = projected_out(fixed, design.y)
    x = projected_out(fixed, columns)
    dof = best.dof - len(worth)
    length = np.linalg.norm(x, axis=0)
    if dof < 1.0 or np.any(length <= 0.0):
        return None
    inverse = np.linalg.pinv((x / length).T @ (x / length))
    fit = inverse @ ((x / length).T @ y)
    rest = y - (x / length) @ fit
    rss = float(rest @ rest) + design.prior_rss
    variance = max(rss / dof, design.min_variance)
    if fisher.sf(max(0.0, best.rss - float(rest @ rest) - design.prior_rss) / len(worth) / variance,
                 len(worth), dof) >= LACK_OF_FIT_P:
        return None
    at = np.concatenate([[1.0], worth]) / length
    return float(at @ fit), float(np.sqrt(at @ inverse @ at * variance))


def _resized(effects: tuple[SizedEffect, ...], sizes: Sequence[float], best: LeastSquares,
             errors: Array) -> tuple[tuple[SizedEffect, ...], LeastSquares]:
    return (tuple(SizedEffect(effect.candidate, size) for effect, size in zip(effects, sizes, strict=True)),
            best._replace(sizes=np.array(sizes), se=errors))
