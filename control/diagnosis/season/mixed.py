"""One model of a whole season: what machine, operator, product, field and time each do to every effect.

The size of effect e in log j is a sum over the levels that the log has, along with its own scatter:

    x_je = machine_me(t) + operator_oe + product_pe + field_fe + fleet_e + scatter_je

and log j knows x_j through a Gaussian likelihood whose precision is known (`forms.py`). That is a linear mixed model
with known variances within logs (Searle, Casella and McCulloch, Variance Components, 1992, ch. 6; Gelman and Hill, Data
Analysis Using Regression and Multilevel/Hierarchical Models, 2007, ch. 11 to 13). Every level is a random effect about
the machine file, none is the reference: the commonest operator is examined as any other. A level's prior is that of an
effect that is mostly absent: 0, or with a small probability N(0, tau^2) (spike and slab; Mitchell and Beauchamp,
Journal of the American Statistical Association 83, 1988, 1023); tau is shared by the levels of a factor and is that of
a short grid under which all of them are likeliest. What a scale reads wrong is a machine's, or all machines': no
operator, product or field is asked for it. Given which levels are there, all else is linear and Gaussian
(`judgement/gaussian.py`): with z the logs' share in each term, z'A z is the information and z's the score of the terms
(best linear unbiased prediction; Robinson, Statistical Science 6, 1991, 15). Sizes are so drawn towards 0 as far as
their logs are silent, and every interval holds what the other terms leave open. The tolerances of each machine are
terms too, of variance 1, once for all its logs. Which levels are there is searched greedily, then each is left out and
asked again until nothing moves. Time: the course of a machine is cut by `changes.py`, the other terms at their means.

What cannot be told apart: with a cause left out, every effect at its place, and every other level with its effect (or,
where it cannot have that, with those that it can), is put there in turn. Their marginal likelihoods give the set of
alternatives with probabilities. An effect's form is wrong by a few per cent of itself, so likelihoods are tempered as
if the data were worth no more than that (coarsened posterior; Miller and Dunson, Journal of the American Statistical
Association 114, 2019, 1113).
"""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import expit, logsumexp

from control.diagnosis.effects import ROWS, EffectRow
from control.diagnosis.judgement.gaussian import Array, Gaussian, Indices, Sizes, gain
from control.diagnosis.judgement.prior import FORM_SHARE
from control.machine.machine import CATALOGUE

from .changes import SLOPES, Partition, partition, share_of
from .evidence import Logs, with_scatter

PRIOR = 1e-3                # that one level does one effect: of the some thousand pairs of a season about one does
SURE = 0.95                 # probability from which on a level is reported; of thousands of pairs noise gives 0.1
GRID = (0.1, 0.3, 1.0)      # of an effect's usual size: tau of the slab; levels of a factor may differ by less
COARSE = 0.005              # of a gain: what tempers alternatives; behind by 3 % of it is one in twenty
MOST = 60                   # causes of a season
SWEEPS = 3
SHOWN = 0.05                # probability from which on an alternative is named
CURVE_DF, LEAST_LOGS = 5, 3             # of a smooth course, and logs for each number of it
NOTHING = 1e-6              # of a level's information: what no other term takes, to rounding
MACHINE, FLEET = "machine", "fleet"
SHAPES = ("rise", "fall")   # of a machine's course, besides one that stands
# Stages whose effects a single machine has, or all by the way in which they are made and calibrated: what a scale
# reads wrong comes from its cells, its amplifier and its calibration weight. They are bolted to the machine, whoever
# drives it, whatever it spreads and wherever it stands; pitch and time of day are inputs of their effects.
OF_MACHINES_ONLY = frozenset({"scale"})
ORDER = tuple(CATALOGUE)


class Alternative(NamedTuple):
    """What a cause may be just as well: the same effect at another level, or another effect at this one."""

    factor: str
    level: str
    effect: str
    size: float
    probability: float


class EffectAtLevel(NamedTuple):
    """One effect at one level. columns: (n, k) its terms' share in each log, of prior s.d. `sd` (k,). scatter: (n,)."""

    factor: str
    level: str
    effect: int
    columns: Array
    sd: Array
    scatter: Array
    course: Partition | None = None         # of a machine's: over the logs `at`
    at: Indices = np.zeros(0, np.int64)
    log_odds: float = 0.0
    alternatives: tuple[Alternative, ...] = ()


class Solved(NamedTuple):
    """The terms' posterior. left: the logs (n, q, q), their score (n, q) of what the terms leave. begins: where each
    cause's terms begin.

    crossed: by machine (its logs, its terms, (logs, q, terms) information that its logs share with the terms)."""

    terms: Sizes
    left: Gaussian
    begins: tuple[int, ...]
    crossed: tuple[tuple[Indices, Indices, Array], ...]
    worth: float                # log of marginal likelihood and prior of all causes, against none


class Scattered(NamedTuple):
    """The same where one effect also scatters: of that effect its score (n,) and information (n,), what each log shares
    with the terms, the terms' covariance, and what the scatter is worth by itself (log marginal likelihood)."""

    left: Array
    information: Array
    crossed: tuple[tuple[Indices, Indices, Array], ...]
    cov: Array
    worth: float

    def shared_with(self, columns: Array) -> Array:
        """(k, terms) information that terms of these columns, (n, k), share with the terms that are there."""
        cross = np.zeros((columns.shape[1], len(self.cov)))
        for here, terms, each in self.crossed:
            cross[:, terms] += columns[here].T @ each
        return cross


class Scan(NamedTuple):
    """Every level and effect along with what is there: (levels, q). odds: log of, for against."""

    score: Array
    information: Array
    tau: Array
    odds: Array


class Levels(NamedTuple):
    """Factor and level of each, with the logs that have it: (n, levels)."""

    keys: tuple[tuple[str, str], ...]
    has: Array

    def of(self, factor: str) -> Indices:
        return np.array([k for k, one in enumerate(self.keys) if one[0] == factor], np.int64)


def levels_of(logs: Logs) -> Levels:
    found = [(MACHINE, name, (logs.machine == k).astype(np.float64)) for k, name in enumerate(logs.machines)]
    for factor in sorted({name for log in logs.logs for name in log.shared}):
        of = [log.shared.get(factor, "") for log in logs.logs]
        found += [(factor, level, np.array([float(one == level) for one in of])) for level in sorted(set(of) - {""})]
    if len(logs.machines) > 1:
        found.append((FLEET, "", np.ones(len(logs.logs))))
    return Levels(tuple(one[:2] for one in found), np.stack([one[2] for one in found], axis=1))


def solved(logs: Logs, causes: Sequence[EffectAtLevel]) -> Solved:
    count, open_columns = len(logs.names), logs.every.s.shape[1] - len(logs.names)
    (normal, right, _), worth = with_scatter(logs.every, np.pad(_taken(logs, causes), ((0, 0), (0, open_columns))))
    columns = [(cause.effect, cause.columns[:, k], cause.sd[k]) for cause in causes for k in range(len(cause.sd))]
    begins = tuple(int(one) for one in np.cumsum([0, *(len(cause.sd) for cause in causes)]))
    effect = np.array([one[0] for one in columns], np.int64)
    share = np.stack([one[1] for one in columns], axis=1) if columns else np.zeros((len(right), 0))
    parts, total = [], len(columns)
    for machine in range(len(logs.machines)):
        here = logs.of(machine)
        own = np.flatnonzero(np.any(share[here] != 0.0, axis=0))
        open_ = count + np.flatnonzero(np.any(normal[here][:, count:, count:] != 0.0, axis=(0, 2)))
        at = np.concatenate([effect[own], open_])
        terms = np.concatenate([own, total + np.arange(len(open_))])
        total += len(open_)
        parts.append((here, at, terms, np.concatenate([share[np.ix_(here, own)], np.ones((len(here), len(open_)))], 1)))
    sd = np.ones(total)
    sd[:len(columns)] = [one[2] for one in columns]
    information, score = np.zeros((total, total)), np.zeros(total)
    crossed = []
    for here, at, terms, has in parts:
        cross = normal[here][:, :, at] * has[:, None, :]
        information[np.ix_(terms, terms)] += np.einsum("nk,nkl->kl", has, cross[:, at])
        score[terms] += np.sum(has * right[here][:, at], axis=0)
        crossed.append((here, terms, cross[:, :count]))
    sizes, left = Gaussian(information, score).fit(sd), right[:, :count].copy()
    for here, terms, cross in crossed:
        left[here] -= cross @ sizes.b[terms]
    worth += float(sizes.gain)
    worth += sum(np.log(PRIOR) + (0.0 if cause.course is None else cause.course.log_prior) for cause in causes)
    return Solved(sizes, Gaussian(normal[:, :count, :count], left), begins, tuple(crossed), float(worth))


def scatters(logs: Logs, post: Solved, taken: Array) -> Array:
    """(n, q) variance of each size from log to log beyond its own error and a smooth course of its machine, by the
    method of moments (DerSimonian and Laird, Controlled Clinical Trials 7, 1986, 177); 0 where it is `taken` in."""
    found = np.zeros_like(post.left.s)
    information = np.diagonal(post.left.A, axis1=1, axis2=2)
    for machine in range(len(logs.machines)):
        here = logs.of(machine)
        for effect in np.flatnonzero(np.any(information[here] > 0.0, axis=0) & ~np.any(taken[here] > 0.0, axis=0)):
            _, found[here, effect] = smooth(logs.times_d[here], post.left.s[here, effect], information[here, effect])
    return found


def smooth(times_d: Array, score: Array, information: Array) -> tuple[Array, float]:
    """A smooth course through sizes score / information, (n,), and the variance of the sizes about it."""
    rows = _basis(times_d)
    weighted = rows * information[:, None]
    inverse = np.linalg.pinv(rows.T @ weighted)
    curve = rows @ (inverse @ (rows.T @ score))
    known = information > 0.0
    free = int(known.sum()) - int(np.linalg.matrix_rank(rows[known])) if known.any() else 0
    reach = float(information.sum()) - float(np.trace(inverse @ (weighted.T @ weighted)))
    if free < 1 or reach <= 0.0:
        return curve, 0.0
    excess = float(np.sum((score - information * curve)[known] ** 2 / information[known])) - free
    return curve, max(0.0, excess / reach)


def _basis(times_d: Array) -> Array:
    """(logs, df): one, time, and smooth bends; fewer for few logs."""
    df = min(CURVE_DF, max(1, len(times_d) // LEAST_LOGS))
    return np.asarray(np.cos(np.pi * np.outer(share_of(times_d), np.arange(df))), np.float64)


def row_of(name: str) -> EffectRow:
    """Of an effect, or of one member's."""
    return ROWS[name.partition("#")[0]]


def slab(logs: Logs) -> Array:
    """(grid, q) s.d. of what an effect is where it is."""
    return np.asarray(np.array(GRID)[:, None] * [row_of(name).usual for name in logs.names], np.float64)


def scattered(post: Solved, effect: int, extra: Array) -> Scattered:
    """With extra (n,) of variance from log to log: of rank one in each log, so that nothing is stacked anew."""
    own, left, before = post.left.A[:, effect, effect], post.left.s[:, effect], post.terms.cov
    crossed = tuple((here, terms, each[:, effect]) for here, terms, each in post.crossed)
    if not extra.any():
        return Scattered(left, own, crossed, before, 0.0)
    weight = 1.0 / (1.0 + extra * own)
    lost = extra * weight
    precision, score = np.linalg.inv(before), np.zeros(len(before))
    for here, terms, each in crossed:
        precision[np.ix_(terms, terms)] -= each.T @ (lost[here, None] * each)
        score[terms] -= each.T @ (lost[here] * left[here])
    cov = np.linalg.inv(precision)
    moved = cov @ score
    worth = float(np.sum(gain(own, left, np.sqrt(extra)))) + 0.5 * float(
        score @ moved + np.linalg.slogdet(cov)[1] - np.linalg.slogdet(before)[1])
    left = left.copy()
    for here, terms, each in crossed:
        left[here] -= each @ moved[terms]
    return Scattered(weight * left, weight * own, tuple((here, terms, weight[here, None] * each)
                                                        for here, terms, each in crossed), cov, worth)


def scan(logs: Logs, post: Solved, levels: Levels, causes: Sequence[EffectAtLevel]) -> Scan:
    """Of `causes`, solved as `post`."""
    extra, names = scatters(logs, post, _taken(logs, causes)), names_prior(logs, levels, causes)
    score = np.zeros((len(levels.keys), len(logs.names)))
    information = np.zeros_like(score)
    for effect in range(len(logs.names)):
        one = scattered(post, effect, extra[:, effect])
        cross = one.shared_with(levels.has)
        score[:, effect] = levels.has.T @ one.left
        raw = (levels.has ** 2).T @ one.information
        left = raw - np.einsum("lk,lk->l", cross @ one.cov, cross)
        information[:, effect] = np.where(left > NOTHING * raw, left, 0.0)
    score = np.where(information > 0.0, score, 0.0)
    each = np.stack([gain(information, score, sd) for sd in slab(logs)])        # (grid, levels, q)
    tau, bayes = np.zeros_like(score), np.zeros_like(score)
    for factor in {one for one, _ in levels.keys}:
        rows = levels.of(factor)
        best = np.argmax(np.logaddexp(0.0, each[:, rows] + names[rows]).sum(axis=1), axis=0)
        tau[rows] = np.take_along_axis(slab(logs), best[None], axis=0)
        bayes[rows] = np.take_along_axis(each[:, rows], best[None, None], axis=0)[0]
    return Scan(score, information, tau, bayes + names)


def names_prior(logs: Logs, levels: Levels, causes: Sequence[EffectAtLevel]) -> Array:
    """(levels, q) log prior odds: what other machines have, this one has rather (Polya's urn); -inf: it cannot."""
    counts = np.zeros(len(logs.names))
    for cause in causes:
        counts[cause.effect] += cause.factor == MACHINE
    urn = np.log(PRIOR) + np.log(1.0 + counts) - np.log1p(counts.sum() / len(logs.names))
    others = np.array([factor not in (MACHINE, *SHAPES, FLEET) for factor, _ in levels.keys])
    return np.where(np.outer(others, [row_of(name).stage in OF_MACHINES_ONLY for name in logs.names]), -np.inf, urn)


def found(logs: Logs) -> list[EffectAtLevel]:
    """What is there: greedily, then each left out and asked again; what goes may have hidden something else."""
    if not logs.names:
        return []
    levels, causes = levels_of(logs), list[EffectAtLevel]()
    for sweep in range(SWEEPS):
        while len(causes) < MOST and (best := _next(logs, levels, causes)) is not None:
            causes.append(best)
        before = [(one.factor, one.level, one.effect) for one in causes]
        causes = _swept(logs, levels, causes, sweep < SWEEPS - 1)
        if [(one.factor, one.level, one.effect) for one in causes] == before:
            break
    return causes


def _swept(logs: Logs, levels: Levels, causes: list[EffectAtLevel], by_machines: bool) -> list[EffectAtLevel]:
    """Each cause left out and asked again along with the others."""
    for cause in list(causes):
        at = next((k for k, one in enumerate(causes) if one is cause), None)
        if at is None:                  # something else stands for it by now
            continue
        others = causes[:at] + causes[at + 1:]
        again = _asked_again(logs, levels, others, cause)
        causes = others if again is None else [*others[:at], again, *others[at:]]
        if by_machines and again is not None and again.course is None:
            causes = _by_machines(logs, levels, causes, again)
    return causes


def _by_machines(logs: Logs, levels: Levels, causes: list[EffectAtLevel], shared: EffectAtLevel) -> list[EffectAtLevel]:
    """The same, or without what several machines share where courses of their own explain the season better: greedily
    one field is chosen before four machines that stood there when they were set anew."""
    machines = {logs.machines[k] for k in np.unique(logs.machine[shared.at])}
    tried = [one for one in causes if one is not shared and not (
        one.factor == MACHINE and one.effect == shared.effect and one.level in machines)]
    rows = [k for k in levels.of(MACHINE) if levels.keys[k][1] in machines]
    for _ in rows:
        more = _next(logs, levels, tried, rows, shared.effect)
        if more is None:
            break
        tried.append(more)
    return tried if solved(logs, tried).worth > solved(logs, causes).worth else causes


def _taken(logs: Logs, causes: Sequence[EffectAtLevel]) -> Array:
    """(n, q) scatter from log to log of the effects that are there."""
    found = np.zeros((len(logs.logs), len(logs.names)))
    for cause in causes:
        found[:, cause.effect] = np.maximum(found[:, cause.effect], cause.scatter)
    return found


def _with_shapes(logs: Logs, levels: Levels) -> Levels:
    """A machine's course may also grow or fall over the season."""
    rows = levels.of(MACHINE)
    rise = np.zeros((len(logs.logs), len(rows)))
    for k, row in enumerate(rows):
        here = levels.has[:, row] > 0.0
        rise[here, k] = share_of(logs.times_d[here])
    return Levels((*levels.keys, *((shape, levels.keys[row][1]) for shape in SHAPES for row in rows)),
                  np.concatenate([levels.has, rise, levels.has[:, rows] - rise], axis=1))


def _next(logs: Logs, levels: Levels, causes: Sequence[EffectAtLevel], only: Sequence[int] | None = None,
          effect: int | None = None) -> EffectAtLevel | None:
    """What is surest along with what is there; of `only` these levels and this effect, where they are given."""
    shaped = _with_shapes(logs, levels)
    seen = scan(logs, solved(logs, causes), shaped, causes).odds
    odds = seen[:len(levels.keys)].copy()
    shapes = np.stack([seen[shaped.of(factor)] for factor in (MACHINE, *SHAPES)])
    odds[levels.of(MACHINE)] = logsumexp(shapes, axis=0) - np.log(len(shapes))
    odds -= np.stack([_doubt(logs, levels, causes, k) for k in range(len(levels.keys))])
    for cause in causes:
        odds[levels.keys.index((cause.factor, cause.level)), cause.effect] = -np.inf
    if only is not None and effect is not None:
        asked = np.full_like(odds, -np.inf)
        asked[only, effect] = odds[only, effect]
        odds = asked
    level, best = np.unravel_index(int(np.argmax(odds)), odds.shape)
    if expit(odds[level, best]) < SURE:
        return None
    return _cause(logs, levels, causes, int(level), int(best), float(odds[level, best]))


def _doubt(logs: Logs, levels: Levels, causes: Sequence[EffectAtLevel], row: int) -> Array:
    """(q,) what effects that are there may leave to others in the same channels: their forms are not quite right."""
    has, doubt = levels.has[:, row] > 0.0, np.zeros(len(logs.names))
    for cause in causes:
        both = has & np.any(cause.columns != 0.0, axis=1)
        if both.any() and row_of(logs.names[cause.effect]).form_over:
            touched = np.any(logs.every.A[both, cause.effect, :len(logs.names)] != 0.0, axis=0)
            share = both.sum() / max(1, np.any(cause.columns != 0.0, axis=1).sum())
            doubt = np.maximum(doubt, touched * FORM_SHARE ** 2 * cause.log_odds * share)
    return doubt


def _cause(logs: Logs, levels: Levels, others: Sequence[EffectAtLevel], row: int, effect: int,
           odds: float) -> EffectAtLevel:
    """Its terms: of a machine the stretches of its course, of any other level one."""
    (factor, level), has = levels.keys[row], levels.has[:, row]
    at = np.flatnonzero(has)
    widest = float(slab(logs)[-1, effect])
    rough = np.zeros((len(has), 1))
    rough[at] = 1.0
    if factor == MACHINE:
        rough = np.zeros((len(has), CURVE_DF))
        bends = _basis(logs.times_d[at])
        rough[at, :bends.shape[1]] = bends
        rough = rough[:, :bends.shape[1]]
    trial = EffectAtLevel(factor, level, effect, rough, np.full(rough.shape[1], widest), np.zeros(len(has)))
    post = solved(logs, [*others, trial])
    information = post.left.A[:, effect, effect]
    at = at[information[at] > 0.0]
    score = post.left.s[:, effect] + information * (rough @ post.terms.b[post.begins[-2]:post.begins[-1]])
    if factor == MACHINE:
        sd = _level_sd(logs, score[at], information[at], effect)
        curve, scatter = smooth(logs.times_d[at], score[at], information[at])
        course = partition(logs.times_d[at], score[at] / information[at], 1.0 / information[at], sd, curve, scatter)
        columns, sds = _of_stretches(logs.times_d, at, course, sd)
        spread = np.zeros(len(has))
        spread[at] = course.scatter
        return EffectAtLevel(factor, level, effect, columns, sds, spread, course, at, odds)
    only = np.ones_like(post.left.s)
    only[:, effect] = 0.0
    sd = _level_sd(logs, np.array([has @ score]), np.array([has @ information]), effect)
    machines = np.isin(logs.machine, logs.machine[at])
    return EffectAtLevel(factor, level, effect, has[:, None], np.array([sd]),
                         np.where(machines, scatters(logs, post, only)[:, effect], 0.0), None, at, odds)


def _level_sd(logs: Logs, score: Array, information: Array, effect: int) -> float:
    """Of the grid, what makes the sizes of a level likeliest, each log by itself: a course may go through zero."""
    return max(map(float, slab(logs)[:, effect]), key=lambda sd: float(np.sum(gain(information, score, sd))))


def _of_stretches(times_d: Array, at: Indices, course: Partition, sd: float) -> tuple[Array, Array]:
    """(n, k) and (k,): the level of each stretch that is not gone, and its slope over the season."""
    columns, sds = list[Array](), list[float]()
    shares = share_of(times_d[at])
    for stretch in course.stretches:
        here, share = at[stretch.begin:stretch.end], shares[stretch.begin:stretch.end]
        if stretch.kind != "gone" or len(course.stretches) == 1:
            level = np.zeros(len(times_d))
            level[here] = 1.0
            columns.append(level)
            sds.append(sd)
        if stretch.kind == "line":
            slope = np.zeros(len(times_d))
            slope[here] = share - share.mean()
            columns.append(slope)
            sds.append(SLOPES * sd)
    if not columns:                     # every stretch is gone: nothing but scatter
        return np.isin(np.arange(len(times_d)), at).astype(np.float64)[:, None], np.array([sd])
    return np.stack(columns, axis=1), np.array(sds)


def _asked_again(logs: Logs, levels: Levels, others: Sequence[EffectAtLevel],
                 cause: EffectAtLevel) -> EffectAtLevel | None:
    """The cause along with all others as they stand now, under its likeliest name; None where it is no longer sure."""
    post, prior = solved(logs, others), names_prior(logs, levels, others)
    extra = scatters(logs, post, _taken(logs, others))
    alike = _alternatives(logs, levels, others, post, extra, prior, cause)
    held = {(one.factor, one.level, one.effect) for one in others}
    best = max((one for one in alike if (one.factor, one.level, logs.names.index(one.effect)) not in held),
               default=None,
               key=lambda one: (round(one.probability, 2), one.factor == MACHINE,
                                -ORDER.index(row_of(one.effect).id)))
    if best is None:
        return None
    effect = logs.names.index(best.effect)
    row = levels.keys.index((best.factor, best.level))
    again = _cause(logs, levels, others, row, effect, cause.log_odds)
    odds = _gain(post, np.maximum(again.scatter, extra[:, effect]), again.columns, again.sd, effect)[0] + float(
        prior[row, effect] - _doubt(logs, levels, others, row)[effect])
    if expit(odds) < SURE:
        return None
    return again._replace(log_odds=odds, alternatives=tuple(one for one in alike if one.probability >= SHOWN))


def _gain(post: Solved, extra: Array, columns: Array, sd: Array, effect: int) -> tuple[float, float, Array]:
    """Log marginal likelihood of an effect with given terms against none: of the terms, of its scatter; its sizes."""
    one = scattered(post, effect, extra)
    cross = one.shared_with(columns)
    information = columns.T @ (columns * one.information[:, None]) - cross @ one.cov @ cross.T
    sizes = Gaussian(information, columns.T @ one.left).fit(sd)
    return float(sizes.gain), one.worth, sizes.b


Tried = tuple[float, float, float, Alternative]         # log likelihood at the cause's level, at its own; log prior


def _alternatives(logs: Logs, levels: Levels, others: Sequence[EffectAtLevel], post: Solved, extra: Array, prior: Array,
                  cause: EffectAtLevel) -> list[Alternative]:
    """The cause and what may stand in its place, with probabilities that add up to 1; likeliest first."""
    tried, here = list[Tried](), np.any(cause.columns != 0.0, axis=1)
    usual, own = slab(logs)[0], levels.keys.index((cause.factor, cause.level))
    scale, scatter = usual / usual[cause.effect], np.where(here, cause.scatter, 0.0)
    for effect, name in enumerate(logs.names):
        spread = scatter if effect == cause.effect else np.where(here, extra[:, effect], 0.0)
        linear, scattering, size = _gain(post, spread, cause.columns, cause.sd * scale[effect], effect)
        tried.append((linear + scattering, linear + scattering, float(prior[own, effect]), Alternative(
            cause.factor, cause.level, name, float((cause.columns @ size)[here][-1]), 0.0)))
    held = {(one.factor, one.level, one.effect) for one in others}
    elsewhere = [row for row in range(len(levels.keys)) if row != own and levels.has[:, row] @ here > 0.0]
    for effect in range(len(logs.names)):
        # What a level cannot do is asked of it under each name that it can.
        rows = [row for row in elsewhere if prior[row, effect] > -np.inf and (*levels.keys[row], effect) not in held
                and (effect == cause.effect or prior[row, cause.effect] == -np.inf)]
        spread = np.maximum(extra[:, effect], cause.scatter * (effect == cause.effect))
        sd, likely = cause.sd * scale[effect], tried[effect][0]
        if rows:
            likely -= _gain(post, spread, cause.columns, sd, effect)[0]
        for row in rows:
            linear, _, size = _gain(post, spread, levels.has[:, [row]], sd[:1], effect)
            tried.append((tried[effect][0], likely + linear, float(prior[row, effect]), Alternative(
                *levels.keys[row], logs.names[effect], float(size[0]), 0.0)))
    most = max(likely for _, likely, odds, _ in tried if odds > -np.inf)
    temper = 1.0 / (1.0 + COARSE * 2.0 * max(0.0, most))
    # Of the same effect at another level the form is as wrong: only effects among each other are tempered.
    weights = np.array([temper * (base - most) + likely - base + odds for base, likely, odds, _ in tried])
    shares = np.exp(weights - logsumexp(weights))
    return sorted((one[-1]._replace(probability=float(share)) for one, share in zip(tried, shares, strict=True)),
                  key=lambda one: -one.probability)
