"""A peer with the same forms as ours and the plainest of criteria: every form scanned, the best fitted by lmfit, BIC.

No resampling, no held-out rows, no drift test, no names: what the closed list of forms gives by itself.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from beyond_linear import Log, Ranges, Stage, ranges, shown
from beyond_methods import Said, there
from beyond_problem import ANGLES, Channel
from scipy.signal import lfilter

Floats = npt.NDArray[np.float64]
AT = (-1.2, -0.6, 0.0, 0.6, 1.2)
TAUS_S = (3.0, 10.0, 30.0, 90.0)
MOST_STEPS = 40                   # of lmfit's simplex over the knobs
SPANS = 24                        # begins of a span that are tried


class Values(NamedTuple):
    """Scaled variables (n,) by feature, of one log."""

    of: Mapping[str, Floats]
    time_s: Floats
    step_s: float


class Tried(NamedTuple):
    """One form with its knobs. `rows`: values, knobs -> columns (k, n) whose sizes are free."""

    form: str
    columns: tuple[str, ...]
    knobs: tuple[float, ...]
    rows: Callable[[Values, Sequence[float]], Floats]


def _follows(x: Floats, tau_s: float, step_s: float) -> Floats:
    a = float(np.exp(-step_s / max(tau_s, 0.3 * step_s)))
    return np.asarray(lfilter([1.0 - a], [1.0, -a], x, zi=[a * x[0]])[0])


def _span(v: Values, k: Sequence[float]) -> Floats:
    return ((v.time_s >= k[0]) & (v.time_s < k[1])).astype(float)[None]


def forms(stage: Stage) -> Iterator[Tried]:
    """Every form over every variable, or two."""
    names = [name for name in stage.channel.features if " " not in name]
    for name in names:
        yield from _over_one(name)
    for a, b in combinations(names, 2):
        yield Tried("product", (a, b), (), lambda v, k, a=a, b=b: np.array([v.of[a], v.of[b], v.of[a] * v.of[b]]))
    for angle in ANGLES:
        if f"sin {angle}" in stage.channel.features:
            yield from _over_angle(angle)
    t = stage.channel.time_s
    for begin in np.linspace(t[0], t[-1], SPANS, endpoint=False):
        for share in (0.08, 0.16, 0.25):
            yield Tried("span", ("time_s",), (float(begin), float(begin + share * (t[-1] - t[0]))), _span)


def _over_one(name: str) -> Iterator[Tried]:
    def of(v: Values) -> Floats:
        return v.of[name]
    one = (name,)
    yield Tried("slope", one, (), lambda v, k: of(v)[None])
    yield Tried("bend", one, (), lambda v, k: np.array([of(v), of(v) ** 2]))
    for at in AT:
        yield Tried("hinge", one, (at,), lambda v, k: np.array([np.minimum(0.0, of(v) - k[0]),
                                                                np.maximum(0.0, of(v) - k[0])]))
        yield Tried("threshold", one, (at,), lambda v, k: (of(v) > k[0]).astype(float)[None])
    for low, high in combinations(AT, 2):
        yield Tried("saturation", one, (low, high), lambda v, k: np.clip(of(v), min(k), max(k))[None])
        yield Tried("dead_zone", one, (low, high), lambda v, k: (of(v) - np.clip(of(v), min(k), max(k)))[None])
    for tau in TAUS_S:
        yield Tried("memory", one, (tau,), lambda v, k: np.array([of(v), _follows(of(v), k[0], v.step_s)]))
    yield Tried("side", one, (), lambda v, k: np.tanh((of(v) - _follows(of(v), 1.5, v.step_s)) / 0.1)[None])


def _over_angle(angle: str) -> Iterator[Tried]:
    def sine(v: Values) -> Floats:
        return v.of[f"sin {angle}"]

    def cosine(v: Values) -> Floats:
        return v.of[f"cos {angle}"]
    yield Tried("periodic", (angle,), (), lambda v, k: np.array([sine(v), cosine(v)]))
    yield Tried("periodic", (angle,), (), lambda v, k: np.array([2.0 * sine(v) * cosine(v),
                                                                 cosine(v) ** 2 - sine(v) ** 2]))


def values_of(channel: Channel, around: Ranges) -> Values:
    """Angles' sine and cosine as they are, all else scaled."""
    scaled = around.scaled(channel)
    return Values({name: channel.values[k].astype(float) if " " in name else scaled[k]
                   for k, name in enumerate(channel.features)}, channel.time_s, channel.step_s)


class _Fit(NamedTuple):
    """A stage's whitened problem without its nuisances."""

    stage: Stage
    q: Floats
    y: Floats

    def gain(self, rows: Floats) -> float:
        """What rows (k, n) explain of the sum of squares."""
        x = self.stage.white(shown(self.stage.name, self.stage.channel, rows))
        x = x - (x @ self.q) @ self.q.T
        size, *_ = np.linalg.lstsq(x @ x.T + 1e-9 * np.trace(x @ x.T) * np.eye(len(x)), x @ self.y, rcond=None)
        return float(size @ (x @ self.y))


def forms_and_bic(log: Log, seed: int) -> list[Said]:
    return there([_best(stage) for stage in log.stages])


def _best(stage: Stage) -> Said | None:
    q, _ = np.linalg.qr(stage.nuisances.T)
    fit = _Fit(stage, q, stage.y - (stage.y @ q) @ q.T)
    around = ranges(stage.channel)
    values = values_of(stage.channel, around)
    per_size = float(np.log(len(stage.y)))

    def score(one: Tried, knobs: Sequence[float]) -> float:
        rows = one.rows(values, knobs)
        return fit.gain(rows) - per_size * (len(rows) + len(knobs))

    best = max(forms(stage), key=lambda one: score(one, one.knobs))
    knobs = _refined(best, lambda k: score(best, k)) if best.knobs else best.knobs
    gained = score(best, knobs)
    if gained <= 0.0:
        return None
    sizes, level = stage.sizes(best.rows(values, knobs))

    def predict(other: Channel) -> Floats:
        if best.form == "span":
            return np.zeros(len(other.residual))
        return np.asarray(shown(stage.name, other, sizes @ best.rows(values_of(other, around), knobs) + level))
    return Said(stage.name, best.columns, best.form, gained, predict)


def _refined(one: Tried, score: Callable[[Sequence[float]], float]) -> tuple[float, ...]:
    """The knobs by lmfit's simplex."""
    import lmfit

    parameters = lmfit.Parameters()
    for k, value in enumerate(one.knobs):
        parameters.add(f"k{k}", value=value)

    def rest(p: Any) -> float:
        return -score([p[f"k{k}"].value for k in range(len(one.knobs))])
    found = lmfit.minimize(rest, parameters, method="nelder", max_nfev=MOST_STEPS, calc_covar=False)
    knobs = tuple(float(found.params[f"k{k}"].value) for k in range(len(one.knobs)))
    return knobs if score(knobs) > score(one.knobs) else one.knobs
