"""Decides the verdict on bench tables from the probabilities of the models: none, named, ambiguous,
unexplained, not judged.

- not judged: no effect within its bounds could have shown in these rows.
- none: the model without effects is more probable than all others together.
- unexplained: of the probability of any deviation, models with an unknown dependence, or with an
effect of an
  impossible size, have MIN_NAMED_PROB.
- named: every effect of the most probable model without an unknown dependence is in models that
together have
  MIN_NAMED_PROB of the probability; otherwise the verdict is ambiguous.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from topdress.control.diagnosis.judgement.prior import MIN_LISTED_PROB, MIN_NAMED_PROB
from topdress.control.diagnosis.result import UNKNOWN, UnexplainedStructure, Verdict

from .held_out_gain import MIN_ROWS
from .search import FittedModel, TableSearch
from .table_series import SizedEffect, TableCandidate


class TableRival(NamedTuple):
    """An alternative in the place of a cause. `effect`: None for an unknown dependence, or
    chance."""

    id: str
    effect: SizedEffect | None
    probability: float


class NamedEffect(NamedTuple):
    """One effect of the most probable model. `se`: s.d. of its size; `rivals`: of probability
    MIN_LISTED_PROB or more."""

    effect: SizedEffect
    se: float
    probability: float
    rivals: tuple[TableRival, ...]


class TableVerdict(NamedTuple):
    """Judgement of a search. `nothing`: probability of noise only. `model`: the reported model,
    None for no report.

    `nearest`: the effect, with an impossible size, that is most similar to the unexplained
    dependence.
    """

    search: TableSearch
    model: FittedModel | None
    verdict: Verdict
    named: tuple[NamedEffect, ...]
    unexplained: tuple[UnexplainedStructure, ...]
    nothing: float
    unknown: float
    nearest: TableCandidate | None

    @property
    def effects(self) -> tuple[SizedEffect, ...]:
        return tuple(one.effect for one in self.named)


def judge_table_search(search: TableSearch, shows: bool) -> TableVerdict:
    """Return the judgement without the clocks. shows : whether these rows would show any effect
    within its bounds."""
    every = list(zip(search.fitted, search.probability, strict=True))
    nothing = sum(p for one, p in every if one.is_nothing)
    unknown = sum(p for one, p in every if one.is_unknown)
    if nothing >= 0.5 or len(search.problem.observed) < MIN_ROWS:
        verdict: Verdict = "none" if shows else "not_judged"
        return TableVerdict(search, None, verdict, (), (), nothing, unknown, None)
    model = _choose_reported_model(search, nothing, unknown)
    named = tuple(
        _name_effect(search, model, k) for k in range(len(model.sized)) if k not in model.outside
    )
    unexplained = _list_unexplained(search, model)
    verdict = (
        "unexplained"
        if unexplained
        else "ambiguous"
        if any(one.rivals for one in named)
        else "named"
    )
    nearest = next((one.sized[k].candidate for one in search.fitted for k in one.outside), None)
    return TableVerdict(search, model, verdict, named, unexplained, nothing, unknown, nearest)


def _choose_reported_model(search: TableSearch, nothing: float, unknown: float) -> FittedModel:
    """Return the reported model, among those with or without an unknown dependence."""
    some = [one for one in search.fitted if not one.is_nothing]
    strange = next((one for one in some if one.is_unknown), None)
    known = next((one for one in some if not one.is_unknown), None)
    if strange is None or known is None:
        return some[0]
    return strange if unknown >= MIN_NAMED_PROB * (1.0 - nothing) else known


def _name_effect(search: TableSearch, model: FittedModel, k: int) -> NamedEffect:
    """Return the k-th effect of a model with its rivals: its replacements in the models without the
    effect."""
    own = model.sized[k]
    mine = 0.0
    shares: dict[tuple[str, int | None], float] = {}
    sizes: dict[tuple[str, int | None], SizedEffect] = {}
    there = {one.candidate[:2] for one in model.sized}
    for one, p in zip(search.fitted, search.probability, strict=True):
        inside = [effect for place, effect in enumerate(one.sized) if place not in one.outside]
        if own.candidate[:2] in [effect.candidate[:2] for effect in inside]:
            mine += p
            continue
        new = [effect for effect in inside if effect.candidate[:2] not in there]
        keys = [effect.candidate[:2] for effect in new] + [(UNKNOWN, None)] * (
            one.is_unknown or not new
        )
        for key in keys:
            shares[key] = shares.get(key, 0.0) + p / len(keys)
        for effect in new:
            sizes.setdefault(effect.candidate[:2], effect)
    rivals = (
        [
            TableRival(key[0], sizes.get(key), p)
            for key, p in shares.items()
            if p >= (MIN_LISTED_PROB if key in sizes else 1.0 - MIN_NAMED_PROB)
        ]
        if mine < MIN_NAMED_PROB
        else []
    )
    return NamedEffect(
        own, model.se[k], mine, tuple(sorted(rivals, key=lambda one: -one.probability))
    )


def _list_unexplained(search: TableSearch, model: FittedModel) -> tuple[UnexplainedStructure, ...]:
    """Return the part of a model that no effect can be, with its share of the residual sum of
    squares after the model's effects."""
    if not model.is_unknown:
        return ()
    problem = search.problem
    inside = tuple(effect for k, effect in enumerate(model.sized) if k not in model.outside)
    left = (problem.observed - problem.predict(inside)) / problem.sd
    share = min(1.0, float(np.sum(model.unknown_signal**2)) / max(float(np.sum(left**2)), 1e-300))
    if model.model.unknown is not None and not model.misread:
        shares: dict[tuple[str, str], float] = {}
        for one, p in zip(search.fitted, search.probability, strict=True):
            if one.model.unknown is not None and not one.misread:
                other = search.unknowns[one.model.unknown]
                shares[other.channel, other.variable] = (
                    shares.get((other.channel, other.variable), 0.0) + p
                )
        return (UnexplainedStructure(*max(shares, key=lambda key: shares[key]), share),)
    most = int(
        np.argmax(
            [
                np.sum(model.unknown_signal[problem.piece == k] ** 2)
                for k in range(len(problem.pieces))
            ]
        )
    )
    return (UnexplainedStructure(problem.pieces[most].channel, "", share),)
