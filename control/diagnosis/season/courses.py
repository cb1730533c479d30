"""Per machine the course of each effect over a season: level, wear, repair; and what products, operators, fields share.

All of it works on the quadratic forms of the logs (`evidence.py`). Which effects a machine has at all: forward
selection on the sum of its logs' forms, each effect as a curve over the season with five degrees of freedom. Each log's
own size of those effects then is a short linear solve, scattering by more than its own error from log to log (random
effects; DerSimonian and Laird, Controlled Clinical Trials 7, 1986, 177). What a machine's tolerances leave open is the
same in all its logs, so that no number of logs makes it less. Through these sizes goes a broken line: pieces
of straight lines, cut where that pays (segment neighbourhood, Bai and Perron, Journal of Applied Econometrics 18, 2003,
1; Schwarz's criterion). A piece that rises is wear, a break towards zero is a repair.
"""
from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls
from scipy.stats import chi2, norm

from control.diagnosis.effects import ROWS
from control.diagnosis.runs.columns import FORM_SHARE
from control.machine.machine import CATALOGUE

from .evidence import Form

Array = npt.NDArray[np.float64]

FALSE_FINDS = 1e-4          # probability that noise gives so much, over all effects tried on one machine
MOST_EFFECTS = 6            # of one machine
CHANCE_SD = 3.0             # of a sum of squares, before more is explained than chance does
CURVE_DF = 5                # of an effect's course in the selection
LEAST_APART = 0.1          # of a level's logs, what is not its machines' own: less, and the two cannot be told apart
LEAST_LOGS = 3              # for each number of a curve, and of a level
LEAST_PIECE = 5             # logs of a piece of a course
PIECE_PRICE = 3.0           # times log(logs): two numbers and a place (Schwarz)
LEAST_OWN = 1e-3            # of a log's variance, that is not the machine's tolerances
ALIKE_GAP = 6.0             # of twice the log-likelihood: behind by less is not told apart (95 % of chi2: 3.8) ...
ALIKE_SHARE = 0.03          # ... or by this share of it: forms are never quite right
TIE, TIE_SHARE = 1.0, 0.005     # of a gain: the same
ORDER = tuple(CATALOGUE)
SHARED_P = 1e-4             # that noise gives so much, over all levels and effects tried
MOST_SHARED = 12
LEAST_MACHINES = 2          # that show a level: of one, it is not told from the machine
LEVEL_DF = 3                # of each machine's own curve beside a level
Z90 = 1.645


class OneLog(NamedTuple):
    """A log as the season sees it. time_d: days, any origin, the same for all."""

    key: str
    machine: str
    time_d: float
    forms: tuple[Form, ...]
    shared: Mapping[str, str] = {}          # factor (product, operator, field) -> level; "" not known


class Piece(NamedTuple):
    """A straight piece of a course: sizes at its begin and end, and their 90 % intervals' half widths."""

    begin_d: float
    end_d: float
    begin: float
    end: float
    begin_half: float
    end_half: float
    per_day: float
    per_day_p: float            # that the slope is noise


class Course(NamedTuple):
    """One effect of one machine. sizes, half: of each log (in the order of `times_d`), with their 90 % half widths, the
    scatter from log to log included. breaks_d: between which logs it jumps."""

    machine: str
    effect: str
    gain: float                 # of twice the log-likelihood
    times_d: tuple[float, ...]
    sizes: tuple[float, ...]
    half: tuple[float, ...]
    pieces: tuple[Piece, ...]
    mean: float
    mean_half: float            # what the machine's tolerances leave open apart
    open_half: float            # 90 % half width of that; all sizes are off by the same
    alike: tuple[str, ...] = ()     # effects that these logs cannot tell from it

    @property
    def breaks_d(self) -> tuple[float, ...]:
        return tuple(0.5 * (a.end_d + b.begin_d) for a, b in zip(self.pieces, self.pieces[1:], strict=False))


class Shared(NamedTuple):
    """What one level of a factor does to an effect on every machine, against its machines' other logs."""

    factor: str
    level: str
    effect: str
    size: float
    half: float
    p: float                    # that it is noise, over all that was tried
    logs: int


class _Logs(NamedTuple):
    """The logs of one machine (n of them, in the order of their times) as arrays; zeros where a log tells nothing."""

    logs: tuple[OneLog, ...]
    times_d: Array              # (n,)
    names: tuple[str, ...]      # (q,)
    normal: Array               # (n, q, q)
    right: Array                # (n, q)
    pulls: Array                # (n, q, t)


class _Left(NamedTuple):
    """What logs say of one effect, once others are fitted to each: (n,), (n,), and the machine's own part (n, t)."""

    information: Array
    pull: Array
    own: Array


def courses(logs: Sequence[OneLog]) -> tuple[list[Course], list[Shared]]:
    """Of all machines; what is shared is taken off every log before each machine is looked at."""
    by_name: dict[str, list[OneLog]] = {}
    for log in sorted(logs, key=lambda one: (one.machine, one.time_d)):
        by_name.setdefault(log.machine, []).append(log)
    by_machine, shared = _without_shared({machine: _stacked(own) for machine, own in by_name.items()})
    found = _one_name(by_machine, {machine: _selected(own) for machine, own in by_machine.items()})
    done = []
    for machine, own in by_machine.items():
        for name, gain in found[machine]:
            others = [other for other, _ in found[machine] if other != name]
            done.append(_course(machine, name, gain, own.times_d, _left(own, others, name))._replace(
                alike=_alike(own, others, name)))
    return done, shared


def _stacked(logs: Sequence[OneLog]) -> _Logs:
    names = sorted({name for log in logs for form in log.forms for name in form.names})
    open_ = sorted({name for log in logs for form in log.forms for name in form.open})
    place, at_open = {name: k for k, name in enumerate(names)}, {name: k for k, name in enumerate(open_)}
    count, width = len(logs), len(names)
    normal, right = np.zeros((count, width, width)), np.zeros((count, width))
    pulls = np.zeros((count, width, len(open_)))
    for j, log in enumerate(logs):
        for form in log.forms:
            here = [place[name] for name in form.names]
            normal[np.ix_([j], here, here)] = form.normal
            right[j, here] = form.right
            if form.open:
                pulls[np.ix_([j], here, [at_open[name] for name in form.open])] = form.pulls
    return _Logs(tuple(logs), np.array([log.time_d for log in logs]), tuple(names), normal, right, pulls)


def _one_name(by_machine: Mapping[str, _Logs], found: Mapping[str, list[tuple[str, float]]]
              ) -> dict[str, list[tuple[str, float]]]:
    """Of effects that a machine's logs cannot tell apart, the one that explains most over all machines that have it.

    A machine that surely has another effect says nothing of what this one has.
    """
    beside = {(machine, name): [other for other, _ in own if other != name]
              for machine, own in found.items() for name, _ in own}
    alike = {key: {key[1], *_alike(by_machine[key[0]], others, key[1])} for key, others in beside.items()}

    def total(name: str, own: str) -> float:
        return sum(_curve_gain(by_machine[machine], beside[machine, other], name).gain
                   for (machine, other), names in alike.items() if own in names)
    result = {}
    for machine, each in found.items():
        mine: list[tuple[str, float]] = []
        for name, gain in each:
            free = (alike[machine, name] - {other for other, _ in mine} - set(beside[machine, name])) or {name}
            mine.append((_first({one: total(one, name) for one in free}), gain))
        result[machine] = mine
    return result


def selected(logs: Sequence[OneLog]) -> list[tuple[str, float]]:
    """Effects that one machine has, with what each gains; strongest first.

    Of those that are more than noise beside their scatter from log to log, those that explain most are looked at: what
    only looks like them leaves something in every log. Of these the one whose course is most regular is taken.
    """
    return _selected(_stacked(sorted(logs, key=lambda one: one.time_d)))


def _selected(logs: _Logs) -> list[tuple[str, float]]:
    found: list[tuple[str, float]] = []
    if not logs.names:
        return found
    while len(found) < MOST_EFFECTS:
        active = [name for name, _ in found]
        tried = {name: _curve_gain(logs, active, name) for name in logs.names if name not in active}
        surely = {name: one for name, one in tried.items() if one.p * len(logs.names) < FALSE_FINDS}
        if not surely:
            break
        most = max(one.explained for one in surely.values())
        near = {name: one for name, one in surely.items() if one.explained > _near(most)}
        best = _first({name: one.gain for name, one in near.items()})
        if near[best].gain < _form_doubt(logs, found, best):
            break
        found.append((best, near[best].gain))
    return found


def _near(most: float) -> float:
    """What is not behind `most` by more than a wrong form and chance."""
    return (1.0 - ALIKE_SHARE) * most - ALIKE_GAP


def _first(gains: Mapping[str, float]) -> str:
    """The name that gains most; of those that gain the same, that which stands first in the catalogue: drives and flow
    before the sensors that tell of them."""
    most = max(gains.values())
    return min((name for name, gain in gains.items() if gain >= (1.0 - TIE_SHARE) * most - TIE),
               key=lambda name: (ORDER.index(name.split("#")[0]), name))


def _form_doubt(logs: _Logs, found: Sequence[tuple[str, float]], name: str) -> float:
    """What effects that are there may leave to another for their forms are not quite right, in the same channels."""
    at = logs.names.index(name)
    return max((FORM_SHARE ** 2 * gain for other, gain in found if ROWS[other.split("#")[0]].form_over
                and np.any(logs.normal[:, at, logs.names.index(other)])), default=0.0)


class _Gain(NamedTuple):
    """gain: of twice the log-likelihood, scatter from log to log counted as error; p: of that. explained: without the
    scatter, with what sizes of each log's own explain beyond chance."""

    gain: float
    p: float
    explained: float


def _alike(logs: _Logs, others: Sequence[str], name: str) -> tuple[str, ...]:
    """Effects that explain a machine's logs beside the others about as well as `name` does, as regularly."""
    own = _curve_gain(logs, others, name)
    tried = {one: _curve_gain(logs, others, one) for one in logs.names if one != name and one not in others}
    return tuple(one for one, each in tried.items()
                 if each.explained > _near(own.explained) and each.gain > _near(own.gain))


def _basis(times_d: Array) -> Array:
    """(logs, df): one, time, and smooth bends; fewer for few logs."""
    df = min(CURVE_DF, max(1, len(times_d) // LEAST_LOGS))
    span = max(float(np.ptp(times_d)), 1e-9)
    share = (times_d - times_d.min()) / span
    return np.stack([np.cos(np.pi * k * share) for k in range(df)], axis=1)


def _left(logs: _Logs, active: Sequence[str], name: str) -> _Left:
    """Information and pull of one effect in each log, once the active ones are fitted to that log."""
    count, width = len(logs.times_d), logs.pulls.shape[2]
    if name not in logs.names:
        return _Left(np.zeros(count), np.zeros(count), np.zeros((count, width)))
    at = logs.names.index(name)
    own, fixed = logs.normal[:, at, at], [logs.names.index(one) for one in active if one in logs.names and one != name]
    if not fixed:
        return _Left(own, logs.right[:, at], logs.pulls[:, at])
    part = logs.normal[:, fixed][:, :, fixed].copy()
    k = np.arange(len(fixed))
    part[:, k, k] += 1e-9 * (part[:, k, k] + 1e-12)
    cross = logs.normal[:, at][:, fixed]
    solved = np.linalg.solve(part, np.concatenate(
        [cross[:, :, None], logs.right[:, fixed, None], logs.pulls[:, fixed]], axis=2))
    off = np.einsum("nk,nkm->nm", cross, solved)
    information = own - off[:, 0]
    told = information >= 1e-3 * own                    # less: not to be told from them in this log
    return _Left(np.where(told, information, 0.0), np.where(told, logs.right[:, at] - off[:, 1], 0.0),
                 np.where(told[:, None], logs.pulls[:, at] - off[:, 2:], 0.0))


class _Sizes(NamedTuple):
    """Sizes of one effect in the logs that tell of it. own: (n, t) what one s.d. of what is open adds to each."""

    known: npt.NDArray[np.bool_]        # of all logs
    size: Array
    information: Array
    own: Array

    def alone(self, extra: float | Array = 0.0) -> Array:
        """Variance of each log's own error, `extra` from log to log added."""
        return np.asarray(np.maximum(1.0 / self.information - np.sum(self.own ** 2, axis=1),
                                     LEAST_OWN / self.information) + extra)


def _sizes(seen: _Left) -> _Sizes:
    known = seen.information > 0.0
    information = seen.information[known]
    return _Sizes(known, seen.pull[known] / information, information, seen.own[known] / information[:, None])


def _curve_gain(logs: _Logs, active: Sequence[str], name: str) -> _Gain:
    seen = _sizes(_left(logs, active, name))
    if not seen.known.any():
        return _Gain(0.0, 1.0, 0.0)
    rows = _basis(logs.times_d)[seen.known][:, :max(1, len(seen.size) // LEAST_LOGS)]
    df = int(np.linalg.matrix_rank(rows))
    extra = _scatter(seen.size, seen.information, rows)
    gain, _ = _explained(rows, seen.size, seen.alone(extra), seen.own)
    fixed, whole = _explained(rows, seen.size, seen.alone(), seen.own)
    free = len(seen.size) - df
    beyond = whole - fixed - free - CHANCE_SD * (2.0 * free) ** 0.5
    return _Gain(gain, float(chi2.sf(gain, df)), fixed + max(0.0, beyond))


def _explained(rows: Array, sizes: Array, variance: Array, own: Array) -> tuple[float, float]:
    """Of twice the log-likelihood what rows (n, df) explain of sizes (n,), and all that there is to explain.

    Errors: `variance` of each log's own, and `own` (n, t) times what is the same in all of them (Woodbury's identity).
    """
    both = np.concatenate([rows, sizes[:, None]], axis=1)
    weighted = both / variance[:, None]
    cross = own.T @ weighted
    inner = np.eye(own.shape[1]) + own.T @ (own / variance[:, None])
    normal = both.T @ weighted - cross.T @ np.linalg.solve(inner, cross)
    right = normal[:-1, -1]
    return float(right @ np.linalg.lstsq(normal[:-1, :-1], right, rcond=None)[0]), float(normal[-1, -1])


def _scatter(sizes: Array, information: Array, rows: Array) -> float:
    """Variance of a size from log to log beyond each log's own error and a fitted curve: the method of moments."""
    free = len(sizes) - np.linalg.matrix_rank(rows)
    if free < 1:
        return 0.0
    weighted = rows * information[:, None]
    inverse = np.linalg.pinv(rows.T @ weighted)
    left = sizes - rows @ (inverse @ (weighted.T @ sizes))
    excess = float(information @ left ** 2) - free
    reach = float(information.sum()) - float(np.trace(inverse @ (weighted.T @ weighted)))
    return max(0.0, excess / reach) if reach > 0.0 else 0.0


def _scatter_by_size(sizes: Array, information: Array, rows: Array) -> Array:
    """The same for each log (n,), as a constant and a share of the size: an effect's form is never quite right, and
    what it is off by changes with the work done and grows with the effect."""
    constant = _scatter(sizes, information, rows)
    free = len(sizes) - int(np.linalg.matrix_rank(rows))
    if constant <= 0.0 or free < 1:
        return np.full(len(sizes), constant)
    weight = 1.0 / (1.0 / information + constant)
    level = rows @ np.linalg.lstsq(rows.T @ (rows * weight[:, None]), rows.T @ (weight * sizes), rcond=None)[0]
    excess = (sizes - level) ** 2 * len(sizes) / free - 1.0 / information
    both = np.stack([np.ones(len(sizes)), level ** 2], axis=1)
    parts, _ = nnls(both * weight[:, None], excess * weight)
    return np.asarray(both @ parts)


def _course(machine: str, effect: str, gain: float, times_d: Array, of: _Left) -> Course:
    seen = _sizes(of)
    times_d, sizes = times_d[seen.known], seen.size
    extra = _scatter_by_size(sizes, seen.information, _basis(times_d))
    whole, alone = np.sqrt(1.0 / seen.information + extra), np.sqrt(seen.alone(extra))
    pieces = tuple(_piece(times_d, sizes, alone, begin, end) for begin, end in _cut(times_d, sizes, alone))
    weight = alone ** -2 / np.sum(alone ** -2)
    return Course(machine, effect, gain, tuple(times_d.tolist()), tuple(sizes.tolist()),
                  tuple((Z90 * whole).tolist()), pieces, float(weight @ sizes),
                  Z90 * float(np.sum(alone ** -2)) ** -0.5, Z90 * float(np.linalg.norm(weight @ seen.own)))


def _line(times_d: Array, sizes: Array, sd: Array) -> tuple[Array, Array]:
    """Weighted straight line: (value at the first time, slope) and their covariance."""
    rows = np.stack([np.ones(len(times_d)), times_d - times_d[0]], axis=1)
    if np.ptp(times_d) <= 0.0:
        rows[:, 1] = 0.0
    normal = rows.T @ (rows / sd[:, None] ** 2)
    covariance = np.linalg.pinv(normal)
    fit = covariance @ (rows.T @ (sizes / sd ** 2))
    return fit, np.asarray(covariance, np.float64)


def _cut(times_d: Array, sizes: Array, sd: Array) -> list[tuple[int, int]]:
    """Where the pieces of the best broken line begin and end (dynamic programming over all places)."""
    count = len(sizes)
    if count < 2 * LEAST_PIECE:
        return [(0, count)]
    weight, time = sd ** -2, times_d - times_d.mean()
    sums = np.concatenate([np.zeros((6, 1)), np.cumsum(np.stack([
        weight, weight * time, weight * time ** 2, weight * sizes, weight * time * sizes, weight * sizes ** 2]),
        axis=1)], axis=1)
    price = PIECE_PRICE * float(np.log(count))
    best, came = np.full(count + 1, np.inf), [0] * (count + 1)
    best[0] = 0.0
    for end in range(LEAST_PIECE, count + 1):
        begins = np.arange(0, end - LEAST_PIECE + 1)
        cost = best[begins] + _squares_left(sums[:, end:end + 1] - sums[:, begins]) + price
        came[end] = int(np.argmin(cost))
        best[end] = cost[came[end]]
    pieces, end = [], count
    while end > 0:
        pieces.append((came[end], end))
        end = came[end]
    return pieces[::-1]


def _squares_left(sums: Array) -> Array:
    """Weighted squares that straight lines leave, from the sums (6, k) of w, w t, w t t, w y, w t y, w y y."""
    w, wt, wtt, wy, wty, wyy = sums
    spread = np.maximum(wtt - wt ** 2 / w, 1e-12 * np.maximum(wtt, 1e-300))
    return np.asarray(np.maximum(0.0, wyy - wy ** 2 / w - (wty - wt * wy / w) ** 2 / spread))


def _piece(times_d: Array, sizes: Array, sd: Array, begin: int, end: int) -> Piece:
    own = times_d[begin:end]
    fit, covariance = _line(own, sizes[begin:end], sd[begin:end])
    span = float(own[-1] - own[0])
    last = np.array([1.0, span])
    slope_sd = float(np.sqrt(max(covariance[1, 1], 0.0)))
    p = float(2.0 * norm.sf(abs(fit[1]) / slope_sd)) if slope_sd > 0.0 else 1.0
    return Piece(float(own[0]), float(own[-1]), float(fit[0]), float(fit @ last),
                 Z90 * float(np.sqrt(covariance[0, 0])), Z90 * float(np.sqrt(last @ covariance @ last)),
                 float(fit[1]), p)


def _without_shared(by_machine: Mapping[str, _Logs]) -> tuple[dict[str, _Logs], list[Shared]]:
    """What levels of factors (product, operator, field) do on every machine, strongest first, and the logs without it.

    Each level against a machine's other logs, beside a curve of its own and the effects that it has; then over machines
    as random effects, for what one machine alone shows is the machine's, whatever field it happened to stand in.
    """
    left, found = dict(by_machine), list[Shared]()
    levels = _levels([log for own in by_machine.values() for log in own.logs])
    while levels and len(found) < MOST_SHARED:
        beside = {machine: [name for name, _ in _selected(own)] for machine, own in left.items()}
        best = _strongest(left, beside, levels)
        if best is None:
            break
        left = {machine: _taken_off(own, best) for machine, own in left.items()}
        more = _refined(left, best)         # of what it hid itself: as long as it was there, all scattered by it
        left = {machine: _taken_off(own, more) for machine, own in left.items()}
        found.append(more._replace(size=best.size + more.size))
    return left, found


def _refined(by_machine: Mapping[str, _Logs], one: Shared) -> Shared:
    """What is left of a level once it is taken off, with its error."""
    each = [contrast for own in by_machine.values() for contrast in _contrasts(
        own, [name for name, _ in _selected(own)], one.effect, [(one.factor, one.level)]).values()]
    size, error = _over_machines(each)
    return one._replace(size=size, half=Z90 * error)


def _levels(logs: Sequence[OneLog]) -> list[tuple[str, str]]:
    """(factor, level), but the commonest of each factor: the others are held against it."""
    found = []
    for factor in sorted({name for log in logs for name in log.shared}):
        counts = Counter(level for log in logs if (level := log.shared.get(factor, "")))
        found += [(factor, level) for level, _ in counts.most_common()[1:]]
    return found


class _Contrast(NamedTuple):
    """One level of a factor on one machine: by how much an effect is larger there. plain: without scatter."""

    size: float
    variance: float
    plain: float                # of twice the log-likelihood
    logs: int


def _strongest(by_machine: Mapping[str, _Logs], beside: Mapping[str, Sequence[str]],
               levels: Sequence[tuple[str, str]]) -> Shared | None:
    """Of what is surely shared, that which explains most."""
    seen: dict[tuple[str, str, str], list[_Contrast]] = {}
    for machine, own in by_machine.items():
        for name in own.names:
            for (factor, level), contrast in _contrasts(own, beside[machine], name, levels).items():
                seen.setdefault((factor, level, name), []).append(contrast)
    tried = {key: each for key, each in seen.items() if len(each) >= LEAST_MACHINES}
    surely: dict[tuple[str, str], dict[str, Shared]] = {}
    explained: dict[tuple[str, str], dict[str, float]] = {}
    for (factor, level, name), each in tried.items():
        size, error = _over_machines(each)
        p = float(2.0 * norm.sf(abs(size) / error)) * len(tried)
        if p < SHARED_P:
            surely.setdefault((factor, level), {})[name] = Shared(
                factor, level, name, size, Z90 * error, p, sum(one.logs for one in each))
            explained.setdefault((factor, level), {})[name] = sum(one.plain for one in each)
    if not surely:
        return None
    best = max(explained, key=lambda level: max(explained[level].values()))
    return surely[best][_first(explained[best])]


def _contrasts(own: _Logs, beside: Sequence[str], name: str, levels: Sequence[tuple[str, str]]
               ) -> dict[tuple[str, str], _Contrast]:
    seen = _sizes(_left(own, [other for other in beside if other != name], name))
    logs = [log for log, known in zip(own.logs, seen.known, strict=True) if known]
    here = [(factor, level) for factor, level in levels
            if LEAST_LOGS <= sum(log.shared.get(factor) == level for log in logs) <= len(logs) - LEAST_LOGS]
    if not here:
        return {}
    base = _basis(own.times_d[seen.known])[:, :LEVEL_DF]
    dummies = np.array([[float(log.shared.get(factor) == level) for factor, level in here] for log in logs])
    extra = _scatter(seen.size, seen.information, base)
    weight = 1.0 / (1.0 / seen.information + extra)
    rows = base.T * weight
    off = dummies - base @ np.linalg.lstsq(rows @ base, rows @ dummies, rcond=None)[0]
    apart = np.sum(off ** 2, axis=0) > LEAST_APART * np.sum(dummies, axis=0)
    information = (weight @ off ** 2)
    pull = (weight * seen.size) @ off
    plain = (seen.information * seen.size) @ off
    plain_information = seen.information @ off ** 2
    return {level: _Contrast(float(pull[k] / information[k]), float(1.0 / information[k]),
                             float(plain[k] ** 2 / plain_information[k]), int(dummies[:, k].sum()))
            for k, level in enumerate(here) if apart[k] and information[k] > 0.0}


def _over_machines(each: Sequence[_Contrast]) -> tuple[float, float]:
    """Mean and its s.d., machines differing by more than their errors (DerSimonian and Laird)."""
    size, variance = np.array([one.size for one in each]), np.array([one.variance for one in each])
    weight = 1.0 / variance
    mean = float(weight @ size / weight.sum())
    excess = float(weight @ (size - mean) ** 2) - (len(each) - 1)
    reach = float(weight.sum() - np.sum(weight ** 2) / weight.sum())
    weight = 1.0 / (variance + max(0.0, excess / reach))
    return float(weight @ size / weight.sum()), float(weight.sum() ** -0.5)


def _taken_off(own: _Logs, one: Shared) -> _Logs:
    if one.effect not in own.names:
        return own
    has = np.array([float(log.shared.get(one.factor) == one.level) for log in own.logs])
    return own._replace(right=own.right - one.size * has[:, None] * own.normal[:, own.names.index(one.effect)])
