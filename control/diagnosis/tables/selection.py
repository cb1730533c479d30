"""Which effects the rows ask for, how large, and which others they could be."""
from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from control.machine.machine import CATALOGUE

from .algebra import Space, Subset, orthonormal, refitted, sizes_of, space_of, subset, widened, without
from .null import largest_p, normalised
from .piece import Array, Choice, Sized
from .problem import Problem

LEVEL = 0.005               # of a false alarm by the best single effect; pairs and the open set have the rest of 1 %
PAIR_LEVEL = 0.001
ONE_SIDED = {"lag.asymmetry": ("lag.offset", "shaft.dead_time")}    # what half of it looks like on one side only
NEVER_LESS = ("shaft.dead_time", "lag.rebound", "lag.first_fill", "flow.fill_falloff", "speed.wheel_slip")
MOST = 3                    # effects at once
SAME_LEVEL = 0.03           # rivals: a confidence set of 97 %, a little wider than what is reported
UNEVEN_P = 0.05             # settings differ by more than replicates do: intervals are widened


class RivalOf(NamedTuple):
    choice: Choice
    size: float
    probability: float


class Found(NamedTuple):
    """One named effect. `p`: of its step of the search. `probability`: its weight among those that could stand here."""

    part: Sized
    se: float
    p: float
    probability: float
    rivals: tuple[RivalOf, ...]


class Named(NamedTuple):
    """`structure_p`: of the whole search, nothing being hidden. `dof`: of the intervals."""

    found: tuple[Found, ...]
    structure_p: float
    subset: Subset
    space: Space
    dof: float
    widened_by: float

    @property
    def parts(self) -> tuple[Sized, ...]:
        return tuple(one.part for one in self.found)


def named(problem: Problem, seed: int) -> Named:
    """Searches for effects one by one, each with exchanges, against the null of the whole search."""
    chosen: list[Choice] = []
    ps: list[float] = []
    barred: set[Choice] = set()
    structure = 1.0
    while len(chosen) < MOST:
        fit = refitted(problem, chosen)
        assert fit is not None
        p, best = _addition(problem, fit[2], chosen, barred, seed + len(chosen))
        if not chosen:
            structure = p
        if p >= LEVEL or best is None:
            pair = None if chosen else _pair(problem, fit[2], seed)
            if pair is None:
                break
            chosen, ps, structure = list(pair[0]), [pair[1], pair[1]], min(structure, 5.0 * pair[1])
            continue
        tried = _exchanged(problem, [*chosen, best], barred)
        if tried is None:
            barred.add(best)
            continue
        chosen = tried
        ps.append(p)
    chosen = _broadened(problem, chosen)
    fit = refitted(problem, chosen)
    assert fit is not None
    parts, found, space = fit
    wider, dof = _between_settings(problem, parts, found)
    parts, found = _beside_forms(problem, parts, found, space)
    parts, found = _in_its_own_form(problem, parts, found, space)
    causes = tuple(_with_rivals(problem, space, parts, k, found, float(found.se[k] * wider), dof, ps[k])
                   for k in range(len(parts)))
    best_dof = found.dof
    kept = tuple(c for c in causes if (wider == 1.0 or _still(c, best_dof, len(problem.choices)))
                 and not _half_of_another(c, causes))
    if len(kept) < len(causes):
        fit = refitted(problem, [c.part.choice for c in kept])
        assert fit is not None
        return Named(tuple(Found(p, c.se, c.p, c.probability, c.rivals) for p, c in zip(fit[0], kept, strict=True)),
                     structure, fit[1], fit[2], dof, wider)
    return Named(causes, structure, found, space, dof, wider)


def forms_of(problem: Problem, chosen: Sequence[Choice]) -> Array:
    """Other shapes of the chosen effects, whitened, (m, k): what a wrong shape leaves must call in no second cause."""
    columns = [np.zeros((len(problem.observed), 0))]
    for effect_id in dict.fromkeys(choice.id for choice in chosen):
        shapes = [piece.forms.get(effect_id) for piece in problem.pieces]
        width = max((s.shape[1] for s in shapes if s is not None), default=0)
        if width:
            columns.append(np.concatenate([np.zeros((len(piece.observed), width)) if s is None else s
                                           for piece, s in zip(problem.pieces, shapes, strict=True)]))
    return widened(problem, np.column_stack(columns))


def _addition(problem: Problem, space: Space, chosen: Sequence[Choice], barred: set[Choice],
              seed: int) -> tuple[float, Choice | None]:
    index = [problem.choices.index(choice) for choice in chosen]
    basis = orthonormal(np.column_stack([space.basis, space.x[:, index], forms_of(problem, chosen)]))
    open_ = [k for k, choice in enumerate(problem.choices) if choice not in chosen and choice not in barred]
    unit, kept = normalised(basis, space.x[:, open_])
    if len(space.y) - basis.shape[1] + space.extra_dof < 2.0:
        return 1.0, None
    p, best = largest_p(space.y, basis, unit, space.extra_rss, space.extra_dof, LEVEL, seed, space.least_variance)
    return p, problem.choices[open_[kept[best]]] if best >= 0 else None


def _pair(problem: Problem, space: Space, seed: int) -> tuple[tuple[Choice, Choice], float] | None:
    """Two effects that hide one another: neither shows alone. The F statistic of the best pair, Bonferroni."""
    best: tuple[float, tuple[Choice, Choice]] | None = None
    pairs = list(combinations(range(len(problem.choices)), 2))
    none = subset(space, [])
    if none is None:
        return None
    for a, b in pairs:
        found = subset(space, [a, b])
        if found is None or found.dof < 3.0:
            continue
        ratio = (none.rss - found.rss) / 2.0 / found.variance
        p = float(fisher.sf(ratio, 2, found.dof)) * len(pairs)
        if best is None or p < best[0]:
            best = (p, (problem.choices[a], problem.choices[b]))
    if best is None or best[0] >= PAIR_LEVEL or not _within_bounds(problem, best[1]):
        return None
    return best[1], best[0]


def _within_bounds(problem: Problem, chosen: Sequence[Choice]) -> bool:
    found, parts = sizes_of(problem, chosen)
    return found is not None and all(_allowed(problem, choice, size) for choice, size in parts)


def _exchanged(problem: Problem, chosen: list[Choice], barred: set[Choice]) -> list[Choice] | None:
    """Each member in turn against whatever would fit better in its place. None: out of every bound."""
    now = chosen
    for _ in range(2):
        changed = False
        for k in range(len(now)):
            space = space_of(problem)
            scores = {}
            for choice in problem.choices:
                if choice in barred or (choice in now and choice != now[k]):
                    continue
                tried = [*now[:k], choice, *now[k + 1:]]
                found = subset(space, [problem.choices.index(c) for c in tried])
                if found is not None:
                    scores[choice] = found.rss
            for choice in sorted(scores, key=scores.__getitem__)[:2]:
                tried = [*now[:k], choice, *now[k + 1:]]
                if choice != now[k] and scores[choice] < 0.999 * scores.get(now[k], np.inf) and \
                        _within_bounds(problem, tried):
                    now, changed = tried, True
                    break
        if not changed:
            break
    return now if _within_bounds(problem, now) else None


def _broadened(problem: Problem, chosen: list[Choice]) -> list[Choice]:
    """An effect of one group becomes one of all rows where that fits as well."""
    for k, choice in enumerate(chosen):
        wide = Choice(choice.id, choice.member)
        if choice.scope is None or wide not in problem.choices or wide in chosen:
            continue
        tried = [*chosen[:k], wide, *chosen[k + 1:]]
        before, after = sizes_of(problem, chosen)[0], sizes_of(problem, tried)[0]
        if before and after and _as_good(after, before):
            chosen = tried
    return chosen


def _as_good(other: Subset, best: Subset) -> bool:
    t = float(student.ppf(1.0 - SAME_LEVEL / 2.0, best.dof))
    return bool(other.rss <= best.rss * (1.0 + t * t / best.dof))


def _with_rivals(problem: Problem, space: Space, parts: tuple[Sized, ...], k: int, best: Subset, se: float,
                 dof: float, p: float) -> Found:
    own = parts[k].choice
    weights: dict[Choice, tuple[float, float]] = {own: (1.0, parts[k].size)}
    for choice in problem.choices:
        if choice in [part.choice for part in parts] or (choice.scope is not None and own.scope is None):
            continue
        tried = [problem.choices.index(part.choice) for part in parts]
        tried[k] = problem.choices.index(choice)
        found = subset(space, tried)
        if found is None or not _allowed(problem, choice, float(found.sizes[k])):
            continue
        found = _exactly(problem, [problem.choices[i] for i in tried]) or found
        if _as_good(found, best):
            weight = float(np.exp(-0.5 * best.dof * np.log(max(found.rss, 1e-300) / max(best.rss, 1e-300))))
            weights[choice] = (weight, float(found.sizes[k]))
    total = sum(weight for weight, _ in weights.values())
    mine = sum(weight for choice, (weight, _) in weights.items() if choice.id == own.id and choice.member == own.member)
    rivals: dict[tuple[str, int | None], RivalOf] = {}
    for choice, (weight, size) in weights.items():
        key = (choice.id, choice.member)
        if key == (own.id, own.member):
            continue
        before = rivals.get(key)
        rivals[key] = RivalOf(choice, size, weight / total + (before.probability if before else 0.0))
    ordered = tuple(sorted(rivals.values(), key=lambda r: -r.probability))
    return Found(parts[k], se, p, mine / total * (1.0 - min(1.0, p)), ordered)


def _exactly(problem: Problem, chosen: list[Choice]) -> Subset | None:
    """Refit where the effects multiply one another, so that a rival is judged at its own best sizes."""
    return sizes_of(problem, chosen, rounds=3)[0] if len(chosen) > 1 else None


def _allowed(problem: Problem, choice: Choice, size: float) -> bool:
    """Within the catalogue's bounds; what is lost or extra by definition only adds to what the machine has of it."""
    entry = CATALOGUE[choice.id]
    has = float(getattr(getattr(problem.machine, entry.stage), entry.field))
    low = entry.neutral - has if choice.id in NEVER_LESS else entry.low - entry.neutral
    return low <= size <= entry.high - entry.neutral


def _between_settings(problem: Problem, parts: Sequence[Sized], best: Subset) -> tuple[float, float]:
    """Factor by which intervals grow, and their degrees of freedom, where settings differ more than replicates do."""
    rows = len(problem.observed)
    forms = orthonormal(forms_of(problem, [part.choice for part in parts])[:rows])
    rest = without(forms, (problem.observed - problem.predicted(parts)) / problem.sd)
    counts = np.bincount(problem.setting)
    means = np.bincount(problem.setting, rest) / counts
    pure_dof = int(np.sum(counts - 1))
    lack_dof = len(counts) - len(parts) - forms.shape[1]
    if pure_dof < 3 or lack_dof < 2:
        return 1.0, best.dof
    pure = float(np.sum((rest - means[problem.setting]) ** 2)) / pure_dof
    lack = float(np.sum(counts * means ** 2)) / lack_dof
    if pure <= 0.0 or fisher.sf(lack / pure, lack_dof, pure_dof) >= UNEVEN_P:
        return 1.0, best.dof
    return max(1.0, float(np.sqrt(lack / best.variance))), float(lack_dof)


def _half_of_another(one: Found, causes: Sequence[Found]) -> bool:
    """An effect that differs between two sides may be all on one of them: then its half must not be named as well."""
    return any(one.part.choice.id in ONE_SIDED.get(other.part.choice.id, ())
               and abs(one.part.size) < 0.5 * abs(other.part.size) + 2.0 * (one.se + 0.5 * other.se)
               for other in causes)


def _beside_forms(problem: Problem, parts: tuple[Sized, ...], best: Subset,
                  space: Space) -> tuple[tuple[Sized, ...], Subset]:
    """Sizes that another effect's wrong shape does not pull: where shapes matter, those of the others are left free."""
    sizes, errors = [part.size for part in parts], best.se.copy()
    for k, part in enumerate(parts):
        others = [other for other in parts if other != part]
        shapes = forms_of(problem, [other.choice for other in others])
        if not others or shapes.shape[1] == 0:
            continue
        index = [problem.choices.index(other.choice) for other in (part, *others)]
        free = orthonormal(without(space.basis, np.column_stack([shapes, space.x[:, index[1:]]])))
        fixed = space._replace(basis=orthonormal(np.column_stack([space.basis, free])))
        found = subset(fixed, index[:1])
        spent = fixed.basis.shape[1] - space.basis.shape[1] - len(others)
        if found is None or spent <= 0:
            continue
        ratio = (best.rss - found.rss) / spent / found.variance
        if fisher.sf(max(0.0, ratio), spent, found.dof) < UNEVEN_P:
            sizes[k], errors[k] = float(found.sizes[0]), float(found.se[0])
    return (tuple(Sized(part.choice, size) for part, size in zip(parts, sizes, strict=True)),
            best._replace(sizes=np.array(sizes), se=errors))


def _in_its_own_form(problem: Problem, parts: tuple[Sized, ...], best: Subset,
                     space: Space) -> tuple[tuple[Sized, ...], Subset]:
    """Sizes read where the catalogue defines them, off the effect in whatever shape the rows ask for.

    Only where the other shapes fit better, and only for effects whose piece says what a shape is worth there.
    """
    sizes, errors = [part.size for part in parts], best.se.copy()
    for k, part in enumerate(parts):
        worth = next((piece.at_definition[part.choice.id] for piece in problem.pieces
                      if part.choice.id in piece.at_definition), None)
        if worth is None:
            continue
        shapes = forms_of(problem, [part.choice])
        fixed = orthonormal(np.column_stack([space.basis, *(space.x[:, [problem.choices.index(o.choice)]]
                                                            for o in parts if o != part)]))
        y = without(fixed, space.y)
        x = without(fixed, np.column_stack([space.x[:, problem.choices.index(part.choice)], shapes]))
        dof = best.dof - len(worth)
        scale = np.linalg.norm(x, axis=0)
        if dof < 1.0 or np.any(scale <= 0.0):
            continue
        inverse = np.linalg.pinv((x / scale).T @ (x / scale))
        fit = inverse @ ((x / scale).T @ y)
        rest = y - (x / scale) @ fit
        variance = max((float(rest @ rest) + space.extra_rss) / dof, space.least_variance)
        if fisher.sf(max(0.0, best.rss - float(rest @ rest) - space.extra_rss) / len(worth) / variance,
                     len(worth), dof) >= UNEVEN_P:
            continue
        at = np.concatenate([[1.0], worth]) / scale
        sizes[k], errors[k] = float(at @ fit), float(np.sqrt(at @ inverse @ at * variance))
    return (tuple(Sized(part.choice, size) for part, size in zip(parts, sizes, strict=True)),
            best._replace(sizes=np.array(sizes), se=errors))


def _still(cause: Found, dof: float, tried: int) -> bool:
    t = abs(cause.part.size) / max(cause.se, 1e-12)
    return bool(2.0 * student.sf(t, dof) * tried < 2.0 * LEVEL)
