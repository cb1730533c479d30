"""Fits one model to a whole season: the contribution of machine, operator, product, field and time
to every effect.

The size of effect e in log j is a sum over the levels of the log, and its own scatter:

    x_je = machine_me(t) + operator_oe + product_pe + field_fe + fleet_e + scatter_je

and log j gives x_j a Gaussian likelihood of known precision (`log_evidence.py`). This is a linear
mixed model with known variances within logs (Searle, Casella and McCulloch, Variance Components,
1992, ch. 6; Gelman and Hill, Data Analysis Using Regression and Multilevel/Hierarchical Models,
2007, ch. 11 to 13). Every level is a random effect around the machine file, and no level is the
reference: the most common operator is examined as any other. The prior of a level is that of an
effect that is mostly absent: 0, or with a small probability N(0, tau^2) (spike and slab; Mitchell
and Beauchamp, Journal of the American Statistical Association 83, 1988, 1023). The levels of a
factor share tau, the most likely of a short grid. An error of a scale belongs to a machine, or to
all machines, never to an operator, product or field. Given the set of present levels, the model is
linear and Gaussian (`judgement/gaussian.py`): the mixed-model equations (Henderson, Biometrics 31,
1975, 423). A machine's own terms, the stretches of its courses and its tolerances (of variance 1,
once for all its logs), are connected to other machines only through shared terms. They are
eliminated machine by machine (4), which leaves equations of the shared terms. So the cost is
proportional to the number of logs.

The present levels are searched greedily, the most likely first, together with all that share no
machine with an accepted level, because these are independent. Then each is tested again given all
others: the gain of its terms by their own posterior (Savage-Dickey). `change_points.py` divides the
course of a machine over time, with the other terms at their means. All reported results come from
the posterior in which no further level is certain.

Alternatives to a cause are every effect of its level, and every other level with its effect (or,
where that level cannot have the effect, with those that it can). Their marginal likelihoods give
the set of alternatives with probabilities. An effect's form is wrong by a few per cent of itself,
so likelihoods are tempered accordingly (coarsened posterior; Miller and Dunson, Journal of the
American Statistical Association 114, 2019, 1113).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.special import expit
from topdress.control.diagnosis.effects import EFFECT_ROWS, EffectRow
from topdress.control.diagnosis.judgement.gaussian import (
    Array,
    ColumnProducts,
    Indices,
    SizePosterior,
    calc_elementwise_gain,
)
from topdress.control.diagnosis.judgement.prior import FORM_SHARE
from topdress.control.machine.machine import CATALOGUE

from .change_points import (
    SLOPE_SD_OF_LEVEL_SD,
    CoursePartition,
    calc_course_gain,
    calc_season_shares,
    find_partition,
)
from .log_evidence import StackedLogs, add_scatter

# Prior probability that one level has one effect: about one of a season's some thousand pairs.
LEVEL_PRIOR_PROB = 1e-3
# Probability from which a level is reported; noise in thousands of pairs reaches 0.1.
MIN_REPORT_PROB = 0.95
# Trial values of tau, in units of an effect's usual size; levels of a factor may differ by less.
SLAB_SD_GRID = (0.1, 0.3, 1.0)
# Coarsening of alternatives as a share of the gain: a deficit of 3 % has a probability of one in
# twenty.
COARSENING_OF_GAIN = 0.005
# Number of sweeps over all causes.
SWEEP_COUNT = 3
# Maximum number of rounds of the assignment of names, and the change of a probability that ends the
# rounds.
MAX_URN_ROUNDS, MAX_SETTLED_CHANGE = 300, 1e-3
# Maximum number of rounds of additions and of replacements: more than the causes that a machine and
# its shared levels have.
MAX_ROUNDS = 40
# Probability from which an alternative is listed.
MIN_SHOWN_PROB = 0.05
# Degrees of freedom of a smooth course, and minimum number of logs for each.
CURVE_DF, MIN_LOGS_PER_DF = 5, 3
# Minimum information, to avoid a division by zero.
MIN_INFORMATION = 1e-12
# Share of a level's information that counts as zero: the part not shared with other terms, within
# rounding.
MIN_INFORMATION_SHARE = 1e-6
MACHINE_FACTOR, FLEET_FACTOR = "machine", "fleet"
# Stages whose effects belong to a single machine, or to all machines by design and calibration. An
# error of a scale comes from its cells, its amplifier and its calibration weight. They are bolted
# to the machine, independently of operator, product and field; pitch and time of day are inputs of
# their effects.
MACHINE_STAGES = frozenset({"scale"})
EFFECT_ORDER = tuple(CATALOGUE)
EMPTY_ARRAY = np.zeros(0)
# Pairs of level row and effect index.
LevelEffects = list[tuple[int, int]]


class Alternative(NamedTuple):
    """An alternative to a cause: the same effect of another level, or another effect of this
    level."""

    factor: str
    level: str
    effect: str
    size: float
    probability: float


class EffectAtLevel(NamedTuple):
    """One effect of one level (its row). columns: (logs, k) share of its terms in each log of `at`,
    with prior s.d. `sd` (k,).

    scatter: variance of each of these logs; for a level that machines share, one variance for all
    its logs.
    """

    row: int
    effect: int
    at: Indices
    columns: Array
    sd: Array
    scatter: Array = np.zeros(1)
    # Course of a machine's effect over the logs `at`.
    course: CoursePartition | None = None
    log_odds: float = 0.0
    alternatives: tuple[Alternative, ...] = ()


class FactorLevels(NamedTuple):
    """Factor and level of each row, machines first. code: (n, factors) rows of each log, -1 where
    the log has none."""

    keys: tuple[tuple[str, str], ...]
    row: Mapping[tuple[str, str], int]
    code: Indices
    logs: tuple[Indices, ...]
    # Machines of each row's logs.
    machines: tuple[Indices, ...]


class MachineTerms(NamedTuple):
    """A machine's logs (n) with all their terms: its own first, then those that it shares with
    others.

    of: causes of these terms. products: of the terms (K,). cross: (q, K, n) information that the
    logs' effects share with the terms. own: s.d. of its own terms. scatter: (n, q) variance of each
    size from log to log, included in `likely`. alone: posterior of its own terms, their products
    with the other terms, and the remainder of those. place: indices of the other terms among all
    shared terms. terms: of each cause, by its number. b and cov: posterior of the terms; left:
    residual scores of the logs (n, q).
    """

    of: tuple[EffectAtLevel, ...]
    logs: slice
    likely: ColumnProducts
    cross: Array
    products: ColumnProducts
    own: Array
    scatter: Array
    alone: tuple[SizePosterior, Array, ColumnProducts]
    place: Indices = np.zeros(0, np.int64)
    terms: Mapping[int, slice] = {}
    b: Array = EMPTY_ARRAY
    cov: Array = EMPTY_ARRAY
    left: Array = EMPTY_ARRAY


class SeasonScan(NamedTuple):
    """Score tests of every level (row) and effect on top of the accepted causes: (rows, q). odds:
    log odds for against.

    cross: by effect, information that each row shares with the shared terms, whose covariance is
    `cov` (q, terms, terms). doubts: for a row and a cause, the share of the row's information in
    logs of that cause.
    """

    score: Array
    information: Array
    tau: Array
    odds: Array
    doubts: dict[tuple[int, int], Array]
    cross: tuple[csr_array, ...]
    cov: Array


class Season(NamedTuple):
    """Logs and levels with the accepted causes, and the posterior of all terms."""

    logs: StackedLogs
    levels: FactorLevels
    causes: tuple[EffectAtLevel, ...]
    machines: tuple[MachineTerms, ...]
    shared: SizePosterior
    # Index of a cause's term among the shared terms.
    place: dict[int, int]

    def find_posterior(self, number: int) -> tuple[Array, Array]:
        """Return posterior mean and covariance of a cause's terms."""
        cause = self.causes[number]
        if cause.row < len(self.machines):
            one = self.machines[cause.row]
            here = one.terms[number]
            return one.b[here], one.cov[here, here]
        at = [self.place[number]]
        return self.shared.b[at], self.shared.cov[np.ix_(at, at)]

    def calc_effect_score(self, number: int) -> tuple[Array, Array]:
        """Return score and information of a cause's effect in each log `at`, with all other terms
        at their means."""
        cause, b = self.causes[number], self.find_posterior(number)[0]
        parts = [self.machines[k] for k in self.levels.machines[cause.row]]
        information = np.concatenate([one.likely.A[:, cause.effect, cause.effect] for one in parts])
        left = np.concatenate([one.left[:, cause.effect] for one in parts])
        inside = np.isin(
            np.concatenate([np.arange(one.logs.start, one.logs.stop) for one in parts]), cause.at
        )
        return left[inside] + information[inside] * (cause.columns @ b), information[inside]


def list_factor_levels(logs: StackedLogs) -> FactorLevels:
    count, factors = len(logs.machines), sorted({name for log in logs.logs for name in log.shared})
    keys, codes = [(MACHINE_FACTOR, name) for name in logs.machines], [logs.machine]
    for factor in factors:
        of = [log.shared.get(factor, "") for log in logs.logs]
        number = {level: len(keys) + k for k, level in enumerate(sorted(set(of) - {""}))}
        keys += [(factor, level) for level in number]
        codes.append(np.array([number.get(level, -1) for level in of], np.int64))
    if count > 1:
        codes.append(np.full(len(logs.logs), len(keys), np.int64))
        keys.append((FLEET_FACTOR, ""))
    each = list[Indices]()
    for code in codes:
        order = np.argsort(code, kind="stable")
        cuts = np.flatnonzero(np.diff(code[order])) + 1
        each += [part for part in np.split(order, cuts) if len(part) and code[part[0]] >= 0]
    return FactorLevels(
        tuple(keys),
        {key: row for row, key in enumerate(keys)},
        np.stack(codes, axis=1),
        tuple(each),
        tuple(np.unique(logs.machine[part]) for part in each),
    )


def solve_season(
    logs: StackedLogs,
    levels: FactorLevels,
    causes: Sequence[EffectAtLevel],
    before: Season | None = None,
) -> Season:
    """Return the posterior of all terms: each machine's own terms are eliminated, the shared terms
    solved, and the own terms substituted.

    A machine whose causes have the same terms as `before` is reused.
    """
    mine: list[list[int]] = [[] for _ in logs.machines]
    for number, cause in enumerate(causes):
        for machine in levels.machines[cause.row]:
            mine[machine].append(number)
    several = [number for number, cause in enumerate(causes) if cause.row >= len(logs.machines)]
    place, total = {number: k for k, number in enumerate(several)}, len(several)
    shared, parts = ColumnProducts(np.zeros((total, total)), np.zeros(total)), list[MachineTerms]()
    for machine, numbers in enumerate(mine):
        # A machine's own terms come first.
        numbers.sort(key=lambda one: one in place)
        of = tuple(causes[number] for number in numbers)
        one = before.machines[machine] if before else None
        if (
            one is None
            or len(of) != len(one.of)
            or any(
                new.columns is not old.columns or new.scatter is not old.scatter
                for new, old in zip(of, one.of, strict=True)
            )
        ):
            one = _list_machine_terms(logs, machine, of)
        ends = len(one.products.s) - np.cumsum([0, *(len(cause.sd) for cause in of[::-1])])[::-1]
        one = one._replace(
            place=np.array([place[each] for each in numbers if each in place], np.int64),
            terms={
                number: slice(*each)
                for number, each in zip(numbers, pairwise(ends.tolist()), strict=True)
            },
        )
        shared.A[one.place[:, None], one.place] += one.alone[2].A
        shared.s[one.place] += one.alone[2].s
        parts.append(one)
    sizes = shared.fit(np.array([causes[number].sd[0] for number in several]))
    return Season(
        logs,
        levels,
        tuple(causes),
        tuple(_add_posterior(one, sizes) for one in parts),
        sizes,
        place,
    )


def _list_machine_terms(
    logs: StackedLogs, machine: int, of: tuple[EffectAtLevel, ...]
) -> MachineTerms:
    here, q, width = logs.find_slice(machine), len(logs.names), logs.every.s.shape[1]
    count = here.stop - here.start
    variance, shares, own = np.zeros((count, width)), list[Array](), list[Array]()
    for cause in of:
        low, high = np.searchsorted(cause.at, [here.start, here.stop])
        at, share = cause.at[low:high] - here.start, np.zeros((count, len(cause.sd)))
        share[at] = cause.columns[low:high]
        shares.append(share)
        if cause.row == machine:
            own.append(cause.sd)
        scatters = at if cause.row == machine else np.arange(count)
        variance[scatters, cause.effect] = np.maximum(
            variance[scatters, cause.effect], cause.scatter
        )
    likely = ColumnProducts(logs.every.A[here], logs.every.s[here])
    if variance.any():
        likely = add_scatter(likely, variance)
    # Tolerances precede all other terms.
    open_ = q + np.flatnonzero(np.any(likely.A[:, q:, q:] != 0.0, axis=(0, 2)))
    share = np.concatenate([np.ones((count, len(open_))), *shares], axis=1)
    at = np.concatenate([open_, *(np.full(len(cause.sd), cause.effect) for cause in of)])
    cross, sd = likely.A[:, :, at] * share[:, None, :], np.concatenate([np.ones(len(open_)), *own])
    products = ColumnProducts(
        np.einsum("nk,nkl->kl", share, cross[:, at]), np.sum(share * likely.s[:, at], axis=0)
    )
    return MachineTerms(
        of,
        here,
        ColumnProducts(likely.A[:, :q, :q], likely.s[:, :q]),
        np.ascontiguousarray(cross[:, :q].transpose(1, 2, 0)),
        products,
        sd,
        variance[:, :q],
        _eliminate_machine(products, sd),
    )


def _eliminate_machine(
    products: ColumnProducts, own: Array
) -> tuple[SizePosterior, Array, ColumnProducts]:
    """Return the posterior of a machine's own terms, their products with the other terms, and the
    remainder of the other terms."""
    first, rest = np.arange(len(own)), np.arange(len(own), products.s.shape[-1])
    fit, across = products.select_columns(first).fit(own), products.A[..., rest[:, None], first]
    return fit, across, products.select_columns(rest).project_out(across, fit)


def _add_posterior(one: MachineTerms, shared: SizePosterior) -> MachineTerms:
    fit, across, _ = one.alone
    # Sensitivity of the own terms to the shared terms.
    turn = fit.cov @ across.T
    b, cov = shared.b[one.place], shared.cov[one.place[:, None], one.place]
    b = np.concatenate([fit.b - turn @ b, b])
    cov = np.block([[fit.cov + turn @ cov @ turn.T, -turn @ cov], [-cov @ turn.T, cov]])
    return one._replace(b=b, cov=cov, left=one.likely.s - np.einsum("qkn,k->nq", one.cross, b))


def _estimate_scatter(logs: StackedLogs, one: MachineTerms) -> Array:
    """Return the variance (q,) by which sizes scatter from log to log, from their residuals without
    scatter."""
    information = np.diagonal(one.likely.A, axis1=1, axis2=2)
    without = 1.0 / (1.0 - one.scatter * information)
    return fit_smooth_courses(
        _make_time_basis(logs.times_d[one.logs]), without * one.left, without * information
    )[1]


def fit_smooth_courses(rows: Array, score: Array, information: Array) -> tuple[Array, Array]:
    """Return smooth courses (n, q) through sizes score / information, and the variance (q,) of the
    sizes around them beyond their own errors.

    The method of moments is that of DerSimonian and Laird, Controlled Clinical Trials 7, 1986, 177.
    """
    # The weighted basis has shape (q, n, df).
    weighted = rows[None] * information.T[:, :, None]
    inverse = np.linalg.pinv(rows.T @ weighted, hermitian=True)
    curve = (rows @ (inverse @ (score.T[:, None] @ rows).swapaxes(1, 2)))[..., 0].T
    known = information > 0.0
    free = known.sum(axis=0) - np.minimum(known.sum(axis=0), rows.shape[1])
    reach = information.sum(axis=0) - np.einsum("qij,qni,qnj->q", inverse, weighted, weighted)
    left = np.where(known, score - information * curve, 0.0)
    excess = np.sum(left**2 / np.where(known, information, 1.0), axis=0) - free
    enough = (free >= 1) & (reach > 0.0)
    return curve, np.where(enough, np.maximum(0.0, excess / np.where(enough, reach, 1.0)), 0.0)


def _make_time_basis(times_d: Array) -> Array:
    """Return a time basis (logs, df): constant, time, and smooth curves; fewer columns for few
    logs."""
    df = min(CURVE_DF, max(1, len(times_d) // MIN_LOGS_PER_DF))
    return np.asarray(
        np.cos(np.pi * np.outer(calc_season_shares(times_d), np.arange(df))), np.float64
    )


def find_effect_row(name: str) -> EffectRow:
    """Return the catalogue row of an effect, or of one member's effect."""
    return EFFECT_ROWS[name.partition("#")[0]]


def list_slab_sds(logs: StackedLogs) -> Array:
    """Return trial s.d. of present effects: (grid, q)."""
    return np.asarray(
        np.array(SLAB_SD_GRID)[:, None] * [find_effect_row(name).usual for name in logs.names],
        np.float64,
    )


def scan_season(season: Season) -> SeasonScan:
    """Test every level and effect on top of the accepted causes.

    Each effect also scatters from log to log by the variance of its residual, which has rank one in
    each log.
    """
    q, count, rows, total = (
        len(season.logs.names),
        len(season.machines),
        len(season.levels.keys),
        len(season.shared.b),
    )
    # Two further rows for each machine test a rising and a falling course.
    score, raw, took = (np.zeros((rows + 2 * count, q)) for _ in range(3))
    shared = ColumnProducts(np.zeros((q, total, total)), np.zeros((q, total)))
    places, values = list[Array](), list[Array]()
    doubts = dict[tuple[int, int], Array]()
    for machine, one in enumerate(season.machines):
        own, information = len(one.own), np.diagonal(one.likely.A, axis1=1, axis2=2)
        scatter = np.where(
            np.any(one.scatter > 0.0, axis=0), 0.0, _estimate_scatter(season.logs, one)
        )
        weight = 1.0 / (1.0 + scatter * information)
        lost = one.cross * (scatter * weight).T[:, None, :]
        products = ColumnProducts(
            one.products.A - lost @ one.cross.swapaxes(1, 2),
            one.products.s - np.einsum("qkn,nq->qk", lost, one.likely.s),
        )
        fit, across, rest = _eliminate_machine(products, one.own)
        shared.A[:, one.place[:, None], one.place] += rest.A
        shared.s[:, one.place] += rest.s
        which, has = _list_machine_levels(season, machine)
        # The product has shape (q, levels, K).
        crossed = has.T @ (one.cross * weight.T[:, None, :]).swapaxes(1, 2)
        turned = crossed[..., :own] @ fit.cov
        raw[which] += (has**2).T @ (weight * information)
        took[which] += np.sum(turned * crossed[..., :own], axis=-1).T
        score[which] += has.T @ (weight * one.likely.s) - np.einsum(
            "qck,qk->cq", crossed[..., :own], fit.b
        )
        places.append(
            np.stack([each.ravel() for each in np.meshgrid(which, one.place, indexing="ij")])
        )
        values.append((crossed[..., own:] - turned @ across.swapaxes(1, 2)).reshape(q, -1))
        _collect_form_doubts(season, one, which, has, weight * information, doubts)
    sizes = shared.fit(np.array([season.causes[one].sd[0] for one in season.place]))
    at, value = np.concatenate(places, axis=1), np.concatenate(values, axis=1)
    cross = tuple(csr_array((value[k], at), shape=(len(score), total)) for k in range(q))
    for k, each in enumerate(cross):
        score[:, k] -= each @ sizes.b[k]
        took[:, k] += (
            np.asarray(each.multiply(each @ sizes.cov[k]).sum(axis=1)).ravel() if total else 0.0
        )
    information = np.where(raw - took > MIN_INFORMATION_SHARE * raw, raw - took, 0.0)
    score = np.where(information > 0.0, score, 0.0)
    shares = {key: each / np.maximum(raw[key[0]], MIN_INFORMATION) for key, each in doubts.items()}
    return SeasonScan(
        score,
        information,
        *_calc_effect_odds(season, score, information, shares),
        shares,
        cross,
        sizes.cov,
    )


def _list_machine_levels(season: Season, machine: int) -> tuple[Indices, Array]:
    """Return the rows of the levels of a machine's logs, and the share (n, rows) of each; the last
    are a rise and a fall."""
    logs, rows, count = season.machines[machine].logs, len(season.levels.keys), len(season.machines)
    code = season.levels.code[logs]
    which = np.unique(code[code >= 0])
    has = np.zeros((len(code), len(which) + 2))
    for column in code.T:
        has[np.flatnonzero(column >= 0), np.searchsorted(which, column[column >= 0])] = 1.0
    has[:, -2] = calc_season_shares(season.logs.times_d[logs])
    has[:, -1] = 1.0 - has[:, -2]
    return np.concatenate([which, [rows + machine, rows + count + machine]]), has


def _collect_form_doubts(
    season: Season,
    one: MachineTerms,
    which: Indices,
    has: Array,
    information: Array,
    found: dict[tuple[int, int], Array],
) -> None:
    """Add the information of each level in logs of each cause (q,), for effects in the same
    channels.

    A cause's imperfect form may leave a residual that resembles another effect in these logs.
    """
    for number, here in one.terms.items():
        cause = season.causes[number]
        if not find_effect_row(season.logs.names[cause.effect]).form_over:
            continue
        there = np.any(one.cross[cause.effect, here] != 0.0, axis=0)
        touched = np.any(one.likely.A[there, cause.effect] != 0.0, axis=0)
        both = (has[there, :-2].T @ information[there]) * touched
        for row, each in zip(which[:-2].tolist(), both, strict=True):
            found[row, number] = found.get((row, number), 0.0) + each


def calc_doubtful_gain(
    season: Season, doubts: dict[tuple[int, int], Array], gained: Array
) -> Array:
    """Return the part of each gain (rows, q) that is in doubt: for each cause, at most what an
    error of its form may cause, and only what was gained in logs of the cause.

    The gain of a level in other logs is not due to the cause.
    """
    result = np.zeros_like(gained)
    for (row, number), share in doubts.items():
        cause, taken = season.causes[number], np.minimum(share, 1.0) * np.maximum(gained[row], 0.0)
        # A cause does not limit itself.
        taken[cause.effect] *= cause.row != row
        result[row] += np.minimum(taken, FORM_SHARE**2 * max(0.0, cause.log_odds))
    return result


def _calc_effect_odds(
    season: Season, score: Array, information: Array, doubts: dict[tuple[int, int], Array]
) -> tuple[Array, Array]:
    """Return the s.d. of the slab, and log odds of presence.

    The prior depends on the number of machines with each effect, each member of a set by its
    probability; -inf where a level cannot have the effect.
    """
    levels, rows, count = season.levels, len(season.levels.keys), len(season.machines)
    # The candidates have shape (grid, rows, q).
    each = np.stack(
        [calc_elementwise_gain(information, score, sd) for sd in list_slab_sds(season.logs)]
    )
    machines = np.zeros(len(season.logs.names))
    for cause in season.causes:
        for one in cause.alternatives:
            machines[season.logs.names.index(one.effect)] += one.probability * (
                one.factor == MACHINE_FACTOR
            )
        machines[cause.effect] += cause.row < count and not cause.alternatives
    others = np.array([factor not in (MACHINE_FACTOR, FLEET_FACTOR) for factor, _ in levels.keys])
    scale = np.array([find_effect_row(name).stage in MACHINE_STAGES for name in season.logs.names])
    names = np.where(others[:, None] & scale, -np.inf, calc_urn_prior(machines))
    names = np.concatenate([names, names[:count], names[:count]])
    factors = np.array([one[0] for one in levels.keys] + ["rise"] * count + ["fall"] * count)
    tau, odds = np.zeros_like(score), np.zeros_like(score)
    for factor in np.unique(factors):
        of = np.flatnonzero(factors == factor)
        best = np.argmax(np.logaddexp(0.0, each[:, of] + names[of]).sum(axis=1), axis=0)
        tau[of] = np.take_along_axis(list_slab_sds(season.logs), best[None], axis=0)
        odds[of] = np.take_along_axis(each[:, of], best[None, None], axis=0)[0] + names[of]
    shapes = np.stack([odds[:count], odds[rows : rows + count], odds[rows + count :]])
    odds[:count] = np.logaddexp.reduce(shapes, axis=0) - np.log(len(shapes))
    return tau, odds[:rows] - calc_doubtful_gain(
        season, doubts, odds[:rows] - np.where(np.isfinite(names[:rows]), names[:rows], 0.0)
    )


def calc_urn_prior(counts: Array) -> Array:
    """Return the log prior odds (..., q) of each effect on a machine, by the number of other
    machines with the effect (Polya's urn)."""
    return np.asarray(
        np.log(LEVEL_PRIOR_PROB) + np.log1p(counts) - np.log1p(counts.mean(axis=-1, keepdims=True))
    )


def find_season_causes(logs: StackedLogs) -> Season:
    """Find the causes: greedily, then each tested again given all others, because a removed cause
    may have hidden another."""
    season = solve_season(logs, list_factor_levels(logs), ())
    if not logs.names:
        return season
    for _ in range(SWEEP_COUNT):
        before = _list_named_pairs(season)
        season = _refit_each_cause(_add_sure_causes(season))
        if _list_named_pairs(season) == before:
            break
    return season


def _list_named_pairs(season: Season) -> set[tuple[int, int]]:
    return {(one.row, one.effect) for one in season.causes}


def _add_sure_causes(season: Season) -> Season:
    """Add all certain levels, of those that share no machine at a time."""
    for _ in range(MAX_ROUNDS):
        odds = scan_season(season).odds.copy()
        for cause in season.causes:
            odds[cause.row, cause.effect] = -np.inf
        sure = np.argwhere(expit(odds) >= MIN_REPORT_PROB)
        ranked = sure[np.argsort(-odds[sure[:, 0], sure[:, 1]], kind="stable")]
        new = [
            _make_rough_effect(season, row, effect)._replace(log_odds=float(odds[row, effect]))
            for row, effect in _skip_shared_machines(season.levels, map(tuple, ranked.tolist()))
        ]
        if not new:
            break
        season = _make_cause_terms(
            solve_season(season.logs, season.levels, [*season.causes, *new], season),
            range(len(season.causes), len(season.causes) + len(new)),
        )
    return season


def _skip_shared_machines(
    levels: FactorLevels, ranked: Iterable[tuple[int, int]]
) -> Iterator[tuple[int, int]]:
    """Yield the level rows (with effects) that share no machine with an earlier one."""
    free = np.ones(int(levels.code[:, 0].max(initial=-1)) + 1, bool)
    for row, effect in ranked:
        if free[levels.machines[row]].all():
            free[levels.machines[row]] = False
            yield row, effect


def _make_rough_effect(season: Season, row: int, effect: int) -> EffectAtLevel:
    """Return a preliminary cause before its course is known: a smooth course for a machine, a
    single size for any other level."""
    at = season.levels.logs[row]
    columns = (
        _make_time_basis(season.logs.times_d[at])
        if row < len(season.machines)
        else np.ones((len(at), 1))
    )
    return EffectAtLevel(
        row, effect, at, columns, np.full(columns.shape[1], list_slab_sds(season.logs)[-1, effect])
    )


def _make_cause_terms(season: Season, numbers: Sequence[int]) -> Season:
    """Replace the preliminary terms of these causes: a machine's are the stretches of its
    course."""
    causes = list(season.causes)
    for number in numbers:
        cause = causes[number]
        score, information = season.calc_effect_score(number)
        if cause.row < len(season.machines):
            known = information > 0.0
            at, score, information = cause.at[known], score[known], information[known]
            times_d, sd = (
                season.logs.times_d[at],
                _choose_level_sd(season, score, information, cause.effect),
            )
            curve, scatter = fit_smooth_courses(
                _make_time_basis(times_d), score[:, None], information[:, None]
            )
            course = find_partition(
                times_d, score / information, 1.0 / information, sd, curve[:, 0], float(scatter[0])
            )
            columns, sds = _make_stretch_columns(times_d, course, sd)
            causes[number] = cause._replace(
                at=at, columns=columns, sd=sds, scatter=course.scatter, course=course
            )
        else:
            sd = _choose_level_sd(
                season, score.sum(keepdims=True), information.sum(keepdims=True), cause.effect
            )
            causes[number] = cause._replace(sd=np.array([sd]))
    return _estimate_all_scatter(season._replace(causes=tuple(causes)), numbers)


def _estimate_all_scatter(season: Season, numbers: Sequence[int]) -> Season:
    """Estimate the scatter around these causes from the residual of all terms.

    Causes that several machines share have a common scatter. A single machine's scatter is too
    uncertain: its logs would gain weight when its scatter happens to be small.
    """
    causes, count = list(season.causes), len(season.machines)
    of = cache(lambda machine: _estimate_scatter(season.logs, season.machines[machine]))
    for number in numbers:
        cause = causes[number]
        if cause.row >= count:
            each = [
                of(machine)[cause.effect] for machine in season.levels.machines[cause.row].tolist()
            ]
            causes[number] = cause._replace(scatter=np.array([np.mean(each)]))
    return solve_season(season.logs, season.levels, causes, season)


def _choose_level_sd(season: Season, score: Array, information: Array, effect: int) -> float:
    """Return the grid's standard deviation under which the sizes of a level are most likely. Each
    log counts by itself, because the sign of an effect may change over the season."""
    return max(
        map(float, list_slab_sds(season.logs)[:, effect]),
        key=lambda sd: float(np.sum(calc_elementwise_gain(information, score, sd))),
    )


def _make_stretch_columns(
    times_d: Array, course: CoursePartition, sd: float
) -> tuple[Array, Array]:
    """Return (n, k) and (k,): columns and prior s.d. of the level of each present stretch, and of
    its slope over the season."""
    columns, sds, shares = list[Array](), list[float](), calc_season_shares(times_d)
    for stretch in course.stretches:
        here = slice(stretch.begin, stretch.end)
        inside = np.zeros(len(shares))
        inside[here] = 1.0
        if stretch.kind != "gone" or len(course.stretches) == 1:
            columns.append(inside)
            sds.append(sd)
        if stretch.kind == "line":
            columns.append(inside * (shares - shares[here].mean()))
            sds.append(SLOPE_SD_OF_LEVEL_SD * sd)
    # The effect is absent in every stretch, so only scatter remains.
    if not columns:
        return np.ones((len(shares), 1)), np.array([sd])
    return np.stack(columns, axis=1), np.array(sds)


def _refit_each_cause(season: Season) -> Season:
    """Refit and test each cause together with all others; causes that share no machine are refitted
    at a time."""
    season, done = (
        _replace_until_stable(season, lambda one: one, _split_by_machines),
        set[tuple[int, int]](),
    )
    # The rounds take one cause of each machine that was not refitted yet.
    for _ in range(MAX_ROUNDS):
        keys = [(one.row, one.effect) for one in season.causes]
        turn = set(_skip_shared_machines(season.levels, [key for key in keys if key not in done]))
        if not turn:
            break
        done |= turn
        season = _replace_causes(season, {k: [key] for k, key in enumerate(keys) if key in turn})
    # The first causes were refitted with the fewest others, so the scatter is estimated again.
    season = _estimate_all_scatter(season, range(len(season.causes)))
    return _replace_until_stable(season, judge_season_causes, _find_replacement)


def _replace_until_stable(
    season: Season,
    seen: Callable[[Season], Season],
    asked: Callable[[Season, int], LevelEffects | None],
) -> Season:
    """Replace causes until no replacement is better."""
    for _ in range(MAX_ROUNDS):
        season = seen(season)
        other = {k: new for k in range(len(season.causes)) if (new := asked(season, k)) is not None}
        turn = set(_skip_shared_machines(season.levels, [(season.causes[k].row, k) for k in other]))
        if not turn:
            break
        season = _replace_causes(season, {k: other[k] for _, k in turn})
    return season


def _replace_causes(season: Season, by: dict[int, LevelEffects]) -> Season:
    """Replace some causes, by their number; an existing cause is not added twice."""
    causes, held = (
        list[EffectAtLevel](),
        {(one.row, one.effect) for k, one in enumerate(season.causes) if k not in by},
    )
    rough = list[int]()
    for number, cause in enumerate(season.causes):
        if number not in by:
            causes.append(cause)
        for key in by.get(number, []):
            if key not in held:
                held.add(key)
                rough.append(len(causes))
                causes.append(_make_rough_effect(season, *key)._replace(log_odds=cause.log_odds))
    return _make_cause_terms(solve_season(season.logs, season.levels, causes, season), rough)


def _find_replacement(season: Season, number: int) -> LevelEffects | None:
    """Return the replacement of a cause: empty where the cause is no longer certain, None where it
    stays."""
    cause = season.causes[number]
    if expit(cause.log_odds) < MIN_REPORT_PROB:
        return []
    held = _list_named_pairs(season) - {(cause.row, cause.effect)}
    keys = [
        (season.levels.row[one.factor, one.level], season.logs.names.index(one.effect), one)
        for one in cause.alternatives
    ]
    row, effect, _ = max(
        (one for one in keys if one[:2] not in held),
        key=lambda one: (
            round(one[2].probability, 2),
            one[2].factor == MACHINE_FACTOR,
            -EFFECT_ORDER.index(find_effect_row(one[2].effect).id),
        ),
    )
    return None if (row, effect) == (cause.row, cause.effect) else [(row, effect)]


def judge_season_causes(season: Season) -> Season:
    """Calculate the gain of each cause given all others, and its alternatives."""
    if not season.causes:
        return season
    seen, held = scan_season(season), _list_named_pairs(season)
    tried = [_list_alternatives(season, seen, held, number) for number in range(len(season.causes))]
    sets, prior = _share_probability(season.logs.names, [one for one, _ in tried])
    gained, odds = np.zeros(seen.odds.shape), list[float]()
    for cause, (_, own), of_effects in zip(season.causes, tried, prior, strict=True):
        gained[cause.row, cause.effect] = own
        odds.append(own + float(of_effects[cause.effect]))
    less = calc_doubtful_gain(season, seen.doubts, gained)
    return season._replace(
        causes=tuple(
            cause._replace(
                alternatives=tuple(one for one in set_ if one.probability >= MIN_SHOWN_PROB),
                log_odds=each - float(less[cause.row, cause.effect]),
            )
            for cause, set_, each in zip(season.causes, sets, odds, strict=True)
        )
    )


def _share_probability(
    names: Sequence[str], sets: Sequence[Sequence[Alternative]]
) -> tuple[list[list[Alternative]], Array]:
    """Convert sets with log likelihoods to probabilities, most likely first, and return (causes, q)
    the log prior odds of each effect.

    Effects of other machines are more likely for this machine. The urn of all sets starts empty,
    and each set is weighed by the contents of all others (collapsed variational Bayes of a
    mixture's weights; Asuncion, Welling, Smyth and Teh, UAI 2009). An urn that started with the
    assigned names would keep them: inseparable alternatives would get the most common name, with a
    certainty that grows with the number of machines.
    """
    every, number = (
        [one for set_ in sets for one in set_],
        {name: k for k, name in enumerate(names)},
    )
    begins = np.cumsum([0, *map(len, sets)])
    of, effect = (
        np.repeat(np.arange(len(sets)), np.diff(begins)),
        np.array([number[one.effect] for one in every]),
    )
    likely, mine = (
        np.array([one.probability for one in every]),
        np.array([one.factor == MACHINE_FACTOR for one in every]),
    )
    share, counts = np.zeros(len(every)), np.zeros((len(sets), len(names)))
    for _ in range(MAX_URN_ROUNDS):
        prior, before = calc_urn_prior(counts.sum(axis=0) - counts), share
        odds = likely + prior[of, effect]
        share = np.exp(odds - np.maximum.reduceat(odds, begins[:-1])[of])
        share = share / np.add.reduceat(share, begins[:-1])[of]
        counts = np.zeros_like(counts)
        np.add.at(counts, (of, effect), share * mine)
        if np.max(np.abs(share - before)) < MAX_SETTLED_CHANGE:
            break
    found = [one._replace(probability=float(p)) for one, p in zip(every, share, strict=True)]
    return [
        sorted(found[low:high], key=lambda one: -one.probability) for low, high in pairwise(begins)
    ], prior


def _list_alternatives(
    season: Season, seen: SeasonScan, held: set[tuple[int, int]], number: int
) -> tuple[list[Alternative], float]:
    """Return the cause and its alternatives, with log likelihoods for probabilities, and the
    cause's own gain.

    For columns z together with cause c and all other terms, the remaining information of z is that
    of the posterior plus the share that c took, (z C) P (C z), with P the information of c in the
    posterior and z C the products of z with its terms there.
    """
    levels, logs, cause, able = (
        season.levels,
        season.logs,
        season.causes[number],
        seen.odds > -np.inf,
    )
    b, cov = season.find_posterior(number)
    precision, usual = np.linalg.inv(cov), list_slab_sds(logs)[0]
    own = season.machines[cause.row] if cause.row < len(season.machines) else None
    effects = np.array(
        [k for k in range(len(logs.names)) if (cause.row, k) not in held or k == cause.effect]
    )
    last = np.flatnonzero(np.any(cause.columns != 0.0, axis=1))[-1]

    def fit_sizes(information: Array, score: Array, shared: Array, sd: Array) -> SizePosterior:
        pull = shared @ precision
        return ColumnProducts(information + pull @ cov @ pull.swapaxes(1, 2), score + pull @ b).fit(
            sd
        )

    if own is None:
        here = np.array([season.place[number]])
        shared = np.array(
            [_calc_shared_covariance(seen, k, np.array([cause.row]), here) for k in effects]
        )
        sizes = fit_sizes(
            seen.information[cause.row, effects][:, None, None],
            seen.score[cause.row, effects][:, None],
            shared,
            cause.sd * usual[effects, None] / usual[cause.effect],
        )
    else:
        terms, at = own.terms[number], cause.at - own.logs.start
        crossed = np.einsum("nc,qkn->qck", cause.columns, own.cross[effects][:, :, at])
        information = np.einsum(
            "nc,nq,nd->qcd",
            cause.columns,
            np.diagonal(own.likely.A[at], axis1=1, axis2=2)[:, effects],
            cause.columns,
        ) - crossed @ own.cov @ crossed.swapaxes(1, 2)
        sizes = fit_sizes(
            information,
            own.left[at][:, effects].T @ cause.columns,
            crossed @ own.cov[:, terms],
            cause.sd * usual[effects, None] / usual[cause.effect],
        )
    base = dict(zip(effects.tolist(), sizes.gain.tolist(), strict=True))
    tried = [
        (base[k], base[k], cause.row, k, float(cause.columns[last] @ sizes.b[j]))
        for j, k in enumerate(effects.tolist())
        if able[cause.row, k]
    ]
    rows = np.unique(levels.code[cause.at[np.any(cause.columns != 0.0, axis=1)]])
    rows = rows[(rows >= 0) & (rows != cause.row)]
    # An effect that a level cannot have is replaced by each effect that it can have.
    for k in effects.tolist():
        can = able[rows, k] & ((k == cause.effect) | ~able[rows, cause.effect])
        asked = np.array([row for row in rows[can].tolist() if (row, k) not in held], np.int64)
        if not len(asked):
            continue
        if own is None:
            shared = _calc_shared_covariance(seen, k, asked, here)[:, None]
        else:
            which, has = _list_machine_levels(season, cause.row)
            fit, across, _ = own.alone
            crossed = has[:, np.searchsorted(which[:-2], asked)].T @ own.cross[k].T
            shared = (
                crossed[:, : len(own.own)] @ fit.cov[:, terms]
                - _calc_shared_covariance(seen, k, asked, own.place) @ (across @ fit.cov[:, terms])
            )[:, None]
        fits = fit_sizes(
            seen.information[asked, k][:, None, None],
            seen.score[asked, k][:, None],
            shared,
            cause.sd[:1] * usual[k] / usual[cause.effect],
        )
        tried += [
            (base[k], float(fits.gain[j]), row, k, float(fits.b[j, 0]))
            for j, row in enumerate(asked.tolist())
        ]
    most = max(likely for _, likely, *_ in tried)
    temper = 1.0 / (1.0 + COARSENING_OF_GAIN * 2.0 * max(0.0, most))
    # The same effect of another level has the same error of form, so only different effects are
    # tempered.
    return [
        Alternative(
            *levels.keys[row], logs.names[k], size, temper * (base_ - most) + likely - base_
        )
        for base_, likely, row, k, size in tried
    ], base[cause.effect]


def _calc_shared_covariance(seen: SeasonScan, effect: int, rows: Indices, terms: Indices) -> Array:
    """Return the covariance (rows, terms) of some shared terms, by the information that each row
    shares with all of them."""
    return np.asarray(seen.cross[effect][rows] @ seen.cov[effect][:, terms])


def _split_by_machines(season: Season, number: int) -> LevelEffects | None:
    """Return the machines' own courses where they explain the season better than a shared level.

    The greedy search prefers a field to four machines that worked there when they were reset.
    """
    cause = season.causes[number]
    if cause.row < len(season.machines):
        return None
    size = float(season.find_posterior(number)[0][0])
    effect, whole, apart, other = (
        cause.effect,
        np.log(LEVEL_PRIOR_PROB),
        0.0,
        list[tuple[int, int]](),
    )
    information = 0.0
    for machine in season.levels.machines[cause.row].tolist():
        one = season.machines[machine]
        own = one.likely.A[:, effect, effect]
        known = own > 0.0
        if not known.any():
            continue
        score = one.left[:, effect]
        for k, here in one.terms.items():
            if season.causes[k].effect == effect and season.causes[k].row == machine:
                score = score + one.cross[effect, here].T @ one.b[here]
        has = np.isin(np.arange(one.logs.start, one.logs.stop), cause.at, assume_unique=True)
        before = score + size * has * own
        whole += size * float(before @ has) - 0.5 * size**2 * float(own @ has)
        information += float(own @ has)
        times_d = season.logs.times_d[one.logs][known]
        gained = []
        for each in (score, before):
            sd = _choose_level_sd(season, each[known], own[known], effect)
            gained.append(
                np.log(LEVEL_PRIOR_PROB)
                + calc_course_gain(times_d, each[known] / own[known], 1.0 / own[known], sd)
            )
        whole += max(0.0, gained[0])
        apart += max(0.0, gained[1])
        if gained[1] > 0.0:
            other.append((machine, effect))
    whole -= 0.5 * float(np.log1p(information * cause.sd[0] ** 2))
    return other if apart > whole else None
