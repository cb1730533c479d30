"""Stepwise selection: which effects the rows ask for, how large, and which others they could be.

Forward steps against the null of the whole search (max-t), lateral steps (each effect against whatever would fit better
in its place), and a backward step at the end.
"""
from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from control.diagnosis.effects import ROWS
from control.machine.machine import CATALOGUE, bounds

from .algebra import Design, LeastSquares, design_of, estimated, fitted, least_squares, orthonormal
from .null import max_t_p, normalised
from .piece import Candidate, SizedEffect
from .problem import Problem
from .sizes import at_definition, beside_other_forms, forms_of, lack_of_fit
from .ties import best_first, first_best

# Levels of false alarms, 1 % in all: a forward step, a step of two, and what no effect explains (unexplained.LEVEL).
# Set on the layouts used while building; the table in docs/bench-tables.md holds them against others.
LEVEL = 0.005
PAIR_LEVEL = 0.001
MIN_DOF = 2.0               # that a forward step must leave
MIN_PAIR_DOF = 3.0
MAX_EFFECTS = 3             # at once
SWEEPS = 2                  # of lateral steps
BETTER = 0.999              # share of the residual sum of squares that a lateral step must gain

RIVAL_P = 0.03              # rivals: a confidence set of 97 %, a little wider than the 95 % that is reported


class FittedRival(NamedTuple):
    candidate: Candidate
    size: float
    probability: float


class Selected(NamedTuple):
    """One named effect. `p`: of its forward step. `probability`: its weight among those that could stand here."""

    effect: SizedEffect
    se: float
    p: float
    probability: float
    rivals: tuple[FittedRival, ...]


class Selection(NamedTuple):
    """`structure_p`: of the whole search, nothing being hidden. `dof`: of the intervals, `inflation` times wider."""

    selected: tuple[Selected, ...]
    structure_p: float
    estimate: LeastSquares
    design: Design
    dof: float
    inflation: float
    refused: tuple[Candidate, ...] = ()         # that fitted best in a forward step, with a size out of bounds

    @property
    def effects(self) -> tuple[SizedEffect, ...]:
        return tuple(one.effect for one in self.selected)

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        return tuple(one.effect.candidate for one in self.selected)


def select(problem: Problem, seed: int) -> Selection:
    """Effects one by one, each with lateral steps, against the null of the whole search."""
    chosen, ps, structure_p, refused = _searched(problem, seed)
    fit = fitted(problem, _of_all_rows(problem, chosen))
    assert fit is not None
    effects, estimate, design = fit
    inflation, dof = lack_of_fit(problem, effects, estimate)
    effects, estimate = beside_other_forms(problem, effects, estimate, design)
    effects, estimate = at_definition(problem, effects, estimate, design)
    selected = tuple(_with_rivals(problem, fit._replace(effects=effects, estimate=estimate), k,
                                  float(estimate.se[k] * inflation), dof, ps[k]) for k in range(len(effects)))
    kept = tuple(one for one in selected
                 if (inflation == 1.0 or _still_shown(one, estimate.dof, len(problem.candidates)))
                 and not _half_of_another(one, selected))
    if len(kept) == len(selected):
        return Selection(selected, structure_p, estimate, design, dof, inflation, refused)
    fit = fitted(problem, [one.effect.candidate for one in kept])
    assert fit is not None
    return Selection(tuple(one._replace(effect=effect) for effect, one in zip(fit.effects, kept, strict=True)),
                     structure_p, fit.estimate, fit.design, dof, inflation, refused)


def nothing_selected(problem: Problem, selection: Selection) -> Selection:
    """The same search, with nothing named."""
    design = design_of(problem)
    estimate = least_squares(design, [])
    assert estimate is not None
    return Selection((), selection.structure_p, estimate, design, estimate.dof, 1.0, selection.refused)


def _searched(problem: Problem, seed: int) -> tuple[list[Candidate], list[float], float, tuple[Candidate, ...]]:
    """Candidates, the p of each one's step, p of the first step, and candidates refused because of their bounds."""
    chosen: list[Candidate] = []
    ps: list[float] = []
    barred: dict[Candidate, None] = {}
    structure_p = 1.0
    while len(chosen) < MAX_EFFECTS:
        fit = fitted(problem, chosen)
        assert fit is not None
        p, best = _forward_step(problem, fit.design, chosen, barred, seed + len(chosen))
        if not chosen:
            structure_p = min(structure_p, p)
        if p >= LEVEL or best is None:
            pair = None if chosen else _forward_pair(problem, fit.design)
            if pair is None:
                break
            chosen, ps = list(pair[0]), [pair[1], pair[1]]
            structure_p = min(structure_p, LEVEL / PAIR_LEVEL * pair[1])
            continue
        tried = _lateral_steps(problem, [*chosen, best], barred)
        if tried is None:
            barred[best] = None
            continue
        chosen = tried
        ps.append(p)
    return chosen, ps, structure_p, tuple(barred)


def _forward_step(problem: Problem, design: Design, chosen: Sequence[Candidate], barred: Collection[Candidate],
                  seed: int) -> tuple[float, Candidate | None]:
    """The candidate that explains most of what the chosen ones leave, in whatever shape, and its max-t p."""
    index = [problem.candidates.index(candidate) for candidate in chosen]
    basis = orthonormal(np.column_stack([design.nuisances, design.x[:, index], forms_of(problem, chosen)]))
    open_ = [k for k, candidate in enumerate(problem.candidates) if candidate not in chosen and candidate not in barred]
    unit, kept = normalised(basis, design.x[:, open_])
    if len(design.y) - basis.shape[1] + design.prior_dof < MIN_DOF:
        return 1.0, None
    p, best = max_t_p(design.y, basis, unit, design.prior_rss, design.prior_dof, LEVEL, seed, design.min_variance)
    return p, problem.candidates[open_[kept[best]]] if best >= 0 else None


def _forward_pair(problem: Problem, design: Design) -> tuple[tuple[Candidate, Candidate], float] | None:
    """Two effects that hide one another: neither shows alone. The F test of the best pair, Bonferroni."""
    pairs = list(combinations(range(len(problem.candidates)), 2))
    none = least_squares(design, [])
    if none is None:
        return None
    tried: list[tuple[int, int]] = []
    ratios: list[float] = []        # F of each: all of the same degrees of freedom
    for pair in pairs:
        found = least_squares(design, pair)
        if found is None or found.dof < MIN_PAIR_DOF:
            continue
        tried.append(pair)
        dof = found.dof
        ratios.append((none.rss - found.rss) / 2.0 / found.variance)
    if not tried:
        return None
    best = first_best(ratios)
    p = float(fisher.sf(ratios[best], 2, dof)) * len(pairs)
    names = (problem.candidates[tried[best][0]], problem.candidates[tried[best][1]])
    return (names, p) if p < PAIR_LEVEL and _within_bounds(problem, names) else None


def _lateral_steps(problem: Problem, chosen: list[Candidate], barred: Collection[Candidate]) -> list[Candidate] | None:
    """Each effect in turn against whatever would fit better in its place. None: out of every bound."""
    design = design_of(problem)
    for _ in range(SWEEPS):
        before = chosen
        for k in range(len(chosen)):
            chosen = _lateral_step(problem, design, chosen, k, barred)
        if chosen == before:
            break
    return chosen if _within_bounds(problem, chosen) else None


def _lateral_step(problem: Problem, design: Design, chosen: list[Candidate], k: int,
                  barred: Collection[Candidate]) -> list[Candidate]:
    """The best within bounds in place of the k-th, of the two that fit best."""
    scores: dict[Candidate, float] = {}
    for candidate in problem.candidates:
        if candidate in barred or (candidate in chosen and candidate != chosen[k]):
            continue
        tried = [*chosen[:k], candidate, *chosen[k + 1:]]
        found = least_squares(design, [problem.candidates.index(c) for c in tried])
        if found is not None:
            scores[candidate] = found.rss
    open_ = list(scores)
    for candidate in [open_[i] for i in best_first([-scores[one] for one in open_])[:2]]:
        tried = [*chosen[:k], candidate, *chosen[k + 1:]]
        if candidate != chosen[k] and scores[candidate] < BETTER * scores.get(chosen[k], np.inf) and \
                _within_bounds(problem, tried):
            return tried
    return chosen


def _of_all_rows(problem: Problem, chosen: list[Candidate]) -> list[Candidate]:
    """An effect of one group becomes one of all rows where that fits as well."""
    for k, candidate in enumerate(chosen):
        wide = candidate._replace(scope=None)
        if candidate.scope is None or wide not in problem.candidates or wide in chosen:
            continue
        tried = [*chosen[:k], wide, *chosen[k + 1:]]
        before, after = estimated(problem, chosen)[0], estimated(problem, tried)[0]
        if before and after and as_good(after, before):
            chosen = tried
    return chosen


def _within_bounds(problem: Problem, chosen: Sequence[Candidate]) -> bool:
    found, effects = estimated(problem, chosen)
    return found is not None and all(_allowed(problem, candidate, size) for candidate, size in effects)


def _allowed(problem: Problem, candidate: Candidate, size: float) -> bool:
    """Strictly within the catalogue's bounds; what is lost or extra by definition only adds to what there is of it."""
    entry = CATALOGUE[candidate.id]
    has = float(getattr(getattr(problem.machine, entry.stage), entry.field))
    low, high = bounds(candidate.id, problem.machine)
    return (entry.neutral - has if ROWS[candidate.id].only_adds else low) < size < high


def as_good(other: LeastSquares, best: LeastSquares) -> bool:
    """Within the confidence set of the best, by its likelihood (t)."""
    t = float(student.ppf(1.0 - RIVAL_P / 2.0, best.dof))
    return bool(other.rss <= best.rss * (1.0 + t * t / best.dof))


def _with_rivals(problem: Problem, fit: tuple[tuple[SizedEffect, ...], LeastSquares, Design], k: int, se: float,
                 dof: float, p: float) -> Selected:
    """The k-th effect beside whatever could stand in its place, members and scopes of one id taken together."""
    effects, best, design = fit
    own = effects[k].candidate
    weights: dict[Candidate, tuple[float, float]] = {own: (1.0, effects[k].size)}
    weights |= _rival_weights(problem, effects, best, design, k)
    total = sum(weight for weight, _ in weights.values())
    mine = sum(weight for candidate, (weight, _) in weights.items() if candidate[:2] == own[:2])
    rivals: dict[tuple[str, int | None], FittedRival] = {}
    for candidate, (weight, size) in weights.items():
        key = (candidate.id, candidate.member)
        if key == (own.id, own.member):
            continue
        before = rivals.get(key)
        rivals[key] = FittedRival(candidate, size, weight / total + (before.probability if before else 0.0))
    every = list(rivals.values())
    ordered = tuple(every[i] for i in best_first([rival.probability for rival in every]))
    return Selected(effects[k], se, p, mine / total * (1.0 - min(1.0, p)), ordered)


def _rival_weights(problem: Problem, effects: Sequence[SizedEffect], best: LeastSquares, design: Design,
                   k: int) -> dict[Candidate, tuple[float, float]]:
    """Likelihood, relative to the k-th effect's, and size of every candidate that could stand in its place."""
    chosen = [effect.candidate for effect in effects]
    found = {}
    for candidate in problem.candidates:
        if candidate in chosen or (candidate.scope is not None and chosen[k].scope is None):
            continue
        tried = [*chosen[:k], candidate, *chosen[k + 1:]]
        estimate = least_squares(design, [problem.candidates.index(one) for one in tried])
        if estimate is None or not _allowed(problem, candidate, float(estimate.sizes[k])):
            continue
        if len(tried) > 1:      # where effects multiply one another, a rival is judged at its own best sizes
            estimate = estimated(problem, tried, rounds=3)[0] or estimate
        if as_good(estimate, best):
            log_ratio = np.log(max(estimate.rss, 1e-300) / max(best.rss, 1e-300))
            found[candidate] = (float(np.exp(-0.5 * best.dof * log_ratio)), float(estimate.sizes[k]))
    return found


def _still_shown(one: Selected, dof: float, tried: int) -> bool:
    """Backward step: whether an effect still stands out once settings count instead of replicates (Bonferroni)."""
    t = abs(one.effect.size) / max(one.se, 1e-12)
    return bool(2.0 * student.sf(t, dof) * tried < 2.0 * LEVEL)


def _half_of_another(one: Selected, selected: Sequence[Selected]) -> bool:
    """An effect that differs between two sides may be all on one of them: then its half must not be named as well."""
    return any(one.effect.candidate.id in ROWS[other.effect.candidate.id].half_looks_like
               and abs(one.effect.size) < 0.5 * abs(other.effect.size) + 2.0 * (one.se + 0.5 * other.se)
               for other in selected)
