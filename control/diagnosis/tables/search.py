"""Finds the probable models of bench tables: every effect, every pair, triples of the best, with
and without an unknown dependence, by log evidence (judgement/rows.py) and prior odds.

The search uses slopes at the nominal machine. The models within `MAX_SCORE_DEFICIT` of the best are
then refitted at their own sizes (Gauss-Newton), because effects multiply one another. An effect
whose best size is out of its bounds is not the cause; the table then has an unknown dependence that
looks like the effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import log
from typing import NamedTuple

import numpy as np
from topdress.control.diagnosis.judgement.gaussian import ColumnProducts
from topdress.control.diagnosis.judgement.prior import (
    UNKNOWN_PROB,
    find_size_log_weight,
    find_size_sd,
)
from topdress.control.diagnosis.judgement.rows import (
    Posterior,
    RowProducts,
    calc_posterior,
    make_table_rows,
    mix_posteriors,
)

from .candidate_effects import TableEffect, UnknownDependence, find_effects, list_unknowns
from .problem import TableProblem
from .table_series import Array, BoolArray, IntArray, SizedEffect, sort_best_first

# Maximum number of simultaneous effects.
MAX_SIMULTANEOUS_EFFECTS = 3
# Maximum deficit in log odds of a counted model (Madigan and Raftery 1994).
MAX_SCORE_DEFICIT = 7.0
# Maximum number of models that are refitted at their own sizes.
MAX_MODELS_REFITTED = 40
# Maximum number of models to which a third effect, or an unknown dependence, is added.
MAX_MODELS_EXTENDED = 12
# Number of rows, and of settings, that are tried as misread or set wrongly.
MAX_TRIED_ROWS = 3
# Maximum number of tables without replicates that have their own factor on their noise.
MAX_TABLES_WITH_OWN_NOISE = 2
# Prior probability that an effect has another shape than the catalogue's.
OTHER_SHAPE_PROB = 0.5
# Standard deviation of a parameter that is fixed at zero.
FIXED_PARAMETER_SD = 1e-6
# Ridge as a share of a column's norm: it limits the sizes of nearly equal columns.
RIDGE_OF_COLUMN_NORM = 1e-3
# Maximum number of Gauss-Newton rounds.
MAX_ROUNDS = 3
# Maximum change of a size in a converged round, in s.d.
MAX_SETTLED_SD = 1e-3


class CandidateModel(NamedTuple):
    """A candidate model: the indices of its effects among the candidates, and the index of the
    unknown dependence (None for none)."""

    effects: tuple[int, ...]
    unknown: int | None = None


class FittedModel(NamedTuple):
    """A refitted model. `score`: log evidence plus log prior odds. `outside`: indices of effects
    whose size is out of its bounds."""

    model: CandidateModel
    sized: tuple[SizedEffect, ...]
    se: tuple[float, ...]
    score: float
    outside: tuple[int, ...]
    posterior: Posterior
    # Contribution of the unknown dependence, in units of the noise, (n,).
    unknown_signal: Array
    # Whether that dependence is one misread row.
    misread: bool

    @property
    def is_unknown(self) -> bool:
        """Whether the model contains an unknown dependence of the machine."""
        return bool(self.outside) or (self.model.unknown is not None and not self.misread)

    @property
    def is_nothing(self) -> bool:
        return not self.sized and not self.is_unknown


class TableSearch(NamedTuple):
    """Result of a search. `fitted`: probable models, the best first; `probability`: of each."""

    problem: TableProblem
    effects: tuple[TableEffect, ...]
    unknowns: tuple[UnknownDependence, ...]
    fitted: tuple[FittedModel, ...]
    probability: tuple[float, ...]

    @property
    def best(self) -> FittedModel:
        return self.fitted[0]


def search_table_models(problem: TableProblem) -> TableSearch:
    """Return all models that are probable with these rows."""
    effects = find_effects(problem)
    unknowns = list_unknowns(problem, effects)
    found = [
        refine_table_model(problem, effects, unknowns, model)
        for model in _list_probable_models(problem, effects, unknowns)
    ]
    scores = [one.score for one in found]
    order = sort_best_first(scores)
    weights = np.exp(np.array(scores) - max(scores))[order]
    return TableSearch(
        problem,
        tuple(effects),
        tuple(unknowns),
        tuple(found[k] for k in order),
        tuple((weights / weights.sum()).tolist()),
    )


class _ColumnMatrix(NamedTuple):
    """All columns as one matrix, with the column indices of each component."""

    rows: RowProducts
    y: Array
    columns: Array
    tolerances: int
    effect: tuple[IntArray, ...]
    form: tuple[IntArray, ...]
    unknown: tuple[IntArray, ...]


def _stack_all_columns(
    problem: TableProblem,
    y: Array,
    effects: Sequence[TableEffect],
    unknowns: Sequence[UnknownDependence],
    kept: BoolArray | None = None,
    whole: bool = True,
) -> _ColumnMatrix:
    """Stack the columns of all components.

    kept : (n,) rows that are used; None for all. whole : whether pieces without replicates have
    their own noise.
    """
    tolerances = problem.nuisances / problem.sd[:, None]
    blocks = [
        tolerances,
        *(one.column[:, None] for one in effects),
        *(one.forms for one in effects),
        *(one.columns for one in unknowns),
    ]
    ends = np.cumsum([block.shape[1] for block in blocks])
    places = [
        np.arange(end - block.shape[1], end) for block, end in zip(blocks, ends, strict=True)
    ][1:]
    count = len(effects)
    columns = np.column_stack(blocks)
    used = np.ones(len(y), bool) if kept is None else kept
    setting = np.unique(problem.setting[used], return_inverse=True)[1]
    rows = make_table_rows(
        y[used],
        columns[used],
        setting,
        (problem.rounding / problem.sd)[used],
        problem.min_variance,
        problem.usual_noise,
        [(problem.piece == k)[used] for k in problem.unrepeated[:MAX_TABLES_WITH_OWN_NOISE]]
        if whole
        else (),
    )
    return _ColumnMatrix(
        rows,
        y,
        columns,
        tolerances.shape[1],
        tuple(places[:count]),
        tuple(places[count : 2 * count]),
        tuple(places[2 * count :]),
    )


def _list_probable_models(
    problem: TableProblem, effects: Sequence[TableEffect], unknowns: Sequence[UnknownDependence]
) -> list[CandidateModel]:
    """Return the models within MAX_SCORE_DEFICIT of the best, by slopes at the nominal machine."""
    y = (problem.observed - problem.nominal) / problem.sd
    table = _stack_all_columns(problem, y, effects, unknowns, whole=False)
    scores: dict[CandidateModel, float] = {}

    def tried(models: Sequence[CandidateModel]) -> None:
        for model in models:
            if model not in scores and _is_possible_set([effects[k] for k in model.effects]):
                scores[model] = score_table_model(table, effects, unknowns, model, sizes=False)[0]

    def leading() -> list[CandidateModel]:
        every = list(scores)
        return [
            every[k] for k in sort_best_first([scores[one] for one in every])[:MAX_MODELS_EXTENDED]
        ]

    every = range(len(effects))
    tried(
        [
            CandidateModel(()),
            *(CandidateModel((k,)) for k in every),
            *(CandidateModel(pair) for pair in combinations(every, 2)),
        ]
    )
    for _ in range(MAX_SIMULTANEOUS_EFFECTS - 2):
        tried(
            [
                CandidateModel(tuple(sorted({*one.effects, k})))
                for one in leading()
                if len(one.effects) == 2
                for k in every
            ]
        )
    for one in [CandidateModel(()), *leading()]:
        tried(
            [
                CandidateModel(one.effects, k)
                for k in _list_likely_unknowns(table, effects, unknowns, one)
            ]
        )
    best = max(scores.values())
    kept = [one for one in scores if scores[one] > best - MAX_SCORE_DEFICIT]
    return [kept[k] for k in sort_best_first([scores[one] for one in kept])[:MAX_MODELS_REFITTED]]


def _list_likely_unknowns(
    table: _ColumnMatrix,
    effects: Sequence[TableEffect],
    unknowns: Sequence[UnknownDependence],
    model: CandidateModel,
) -> list[int]:
    """Return the unknown dependences to try in a model: of single rows and settings those with the
    largest residuals."""
    found = score_table_model(table, effects, unknowns, model)[1]
    index = _list_model_columns(table, model)
    left = np.abs(table.y - table.columns[:, index] @ found.mean)
    kept = [k for k, one in enumerate(unknowns) if not one.at]
    for misread in (True, False):
        single = [k for k, one in enumerate(unknowns) if one.at and one.misread is misread]
        single.sort(
            key=lambda k: -float(np.mean(left[list(unknowns[k].at)])) * len(unknowns[k].at) ** 0.5
        )
        kept += single[:MAX_TRIED_ROWS]
    return kept


def _list_model_columns(table: _ColumnMatrix, model: CandidateModel) -> IntArray:
    """Return the column indices of a model: its effects, their shapes, its unknown dependence,
    tolerances."""
    none = np.zeros(0, np.int64)
    strange = none if model.unknown is None else table.unknown[model.unknown]
    return np.concatenate(
        [
            none,
            *(table.effect[k] for k in model.effects),
            *(table.form[k] for k in model.effects),
            strange,
            np.arange(table.tolerances),
        ]
    )


def _is_possible_set(effects: Sequence[TableEffect]) -> bool:
    """Tell whether a set of effects is possible: an effect of a member (an outlet, a head) occurs
    on one member at a time."""
    ids = [one.candidate.id for one in effects if one.candidate.member is not None]
    return len(ids) == len(set(ids))


def score_table_model(
    table: _ColumnMatrix,
    effects: Sequence[TableEffect],
    unknowns: Sequence[UnknownDependence],
    model: CandidateModel,
    sizes: bool = True,
) -> tuple[float, Posterior]:
    """Return log evidence plus log prior odds, and the posterior of the sizes (first) and all other
    parameters.

    The prior of an effect's size has the tails of a Cauchy distribution (`prior.find_size_sd`): its
    s.d. depends on the fitted size. The columns of an unknown dependence share one s.d., by the
    same rule.
    """
    chosen = [effects[k] for k in model.effects]
    index = _list_model_columns(table, model)
    strange = 0 if model.unknown is None else unknowns[model.unknown].columns.shape[1]
    # Sizes by least squares, with the tolerances limited by their priors.
    least = table.rows.products.select_columns(index)
    trust = RIDGE_OF_COLUMN_NORM * np.maximum(np.diag(least.A[0]), 1e-12)
    trust[len(index) - table.tolerances :] = 1.0
    guess = ColumnProducts(least.A[0], least.s[0]).fit(1.0 / np.sqrt(trust)).b
    log_odds = 0.0
    sd = np.ones(len(index))
    at = len(chosen)
    for k, one in enumerate(chosen):
        size = float(guess[k])
        sd[k] = find_size_sd(size, one.usual)
        sd[at : at + one.forms.shape[1]] = abs(size)
        at += one.forms.shape[1]
        log_odds += (
            one.log_odds + find_size_log_weight(size, one.usual) + one.calc_sign_log_prior(size)
        )
    if model.unknown is not None:
        other = unknowns[model.unknown]
        size = float(np.sqrt(np.mean(guess[at : at + strange] ** 2)))
        sd[at : at + strange] = find_size_sd(size, other.usual)
        log_odds += other.log_odds + find_size_log_weight(size, other.usual)
    free = calc_posterior(table.rows, index, sd, sizes)
    if at == len(chosen):
        return free.log_evidence + log_odds, free
    sd[len(chosen) : at] = FIXED_PARAMETER_SD
    found = mix_posteriors(free, calc_posterior(table.rows, index, sd, sizes), OTHER_SHAPE_PROB)
    return found.log_evidence + log_odds, found


def refine_table_model(
    problem: TableProblem,
    effects: Sequence[TableEffect],
    unknowns: Sequence[UnknownDependence],
    model: CandidateModel,
    kept: BoolArray | None = None,
) -> FittedModel:
    """Refit a model at its own sizes. kept : (n,) rows of the fit; None for all."""
    chosen = [effects[k] for k in model.effects]
    other: tuple[UnknownDependence, ...] = (
        () if model.unknown is None else (unknowns[model.unknown],)
    )
    alone = problem._replace(candidates=tuple(one.candidate for one in chosen))
    own = CandidateModel(tuple(range(len(chosen))), None if model.unknown is None else 0)
    sized: tuple[SizedEffect, ...] = ()
    here = list(chosen)
    for _ in range(MAX_ROUNDS if chosen else 1):
        base, slopes = alone.calc_slopes(sized)
        y = problem.observed - base
        for k, (_, size) in enumerate(sized):
            y = y + size * slopes[:, k]
        here = [
            one._replace(column=column / problem.sd)
            for one, column in zip(chosen, slopes.T, strict=True)
        ]
        score, found = score_table_model(
            _stack_all_columns(problem, y / problem.sd, here, other, kept), here, other, own
        )
        before = sized
        sized = tuple(
            SizedEffect(one.candidate, float(size))
            for one, size in zip(here, found.mean, strict=False)
        )
        se = np.sqrt(np.diag(found.covariance))[: len(here)]
        if before and all(
            abs(a.size - b.size) < MAX_SETTLED_SD * e
            for a, b, e in zip(sized, before, se, strict=True)
        ):
            break
    outside = tuple(k for k, one in enumerate(here) if not one.low < sized[k].size < one.high)
    score += sum(log(UNKNOWN_PROB / len(effects)) - here[k].log_odds for k in outside)
    shown, errors = _convert_to_definition(here, found, sized)
    strange = len(here) + sum(one.forms.shape[1] for one in here)
    signal = (
        other[0].columns @ found.mean[strange : strange + other[0].columns.shape[1]]
        if other
        else np.zeros(len(problem.observed))
    )
    for k in outside:
        signal = signal + sized[k].size * here[k].column
    return FittedModel(
        model, shown, errors, score, outside, found, signal, bool(other) and other[0].misread
    )


def _convert_to_definition(
    here: Sequence[TableEffect], found: Posterior, sized: Sequence[SizedEffect]
) -> tuple[tuple[SizedEffect, ...], tuple[float, ...]]:
    """Return sizes and their s.d. where the catalogue defines them, for an effect of any fitted
    shape."""
    shown, errors, at = [], [], len(here)
    for k, one in enumerate(here):
        weight = np.zeros(len(found.mean))
        weight[k] = 1.0
        weight[at : at + len(one.worth)] = one.worth
        at += len(one.worth)
        shown.append(SizedEffect(sized[k].candidate, float(weight @ found.mean)))
        errors.append(float(np.sqrt(weight @ found.covariance @ weight)))
    return tuple(shown), tuple(errors)
