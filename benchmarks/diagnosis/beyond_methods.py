"""The peers beyond the catalogue: each says a stage, the variables, a form where it has one, and predicts other runs.

Every peer gets the same residuals (beyond_problem.py). The linear ones get a library of polynomials of degree two over
everything recorded, sine and cosine of the angles included, whitened by our noise model.
"""
from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import peers_methods
from beyond_linear import RIDGE, Log, Ranges, Stage, hats, library, monomials, ranges, shown
from beyond_problem import Channel, column_of
from scipy.optimize import minimize

Floats = npt.NDArray[np.float64]
LEAST = 16.0                      # of the sum of squares that a pick must be worth: four standard deviations
GP_ROWS, GP_STEPS, SYMBOLIC_ROWS = 200, 12, 400
WINDOW_S = 5.0                    # over which the flow is read off the scale where a method wants a value at each row
CELLS = 6                         # of a variable, among which LISDD's recipe looks for the regime that is right


class Said(NamedTuple):
    """`score`: what the threshold is held against. `predict`: the change of its own channel in another run (n,)."""

    stage: str
    variables: tuple[str, ...]
    form: str
    score: float
    predict: Callable[[Channel], Floats]


Method = Callable[[Log, int], list[Said]]      # what it says of each stage


# -- libraries of polynomials ------------------------------------------------------------------------------------------

def picked(stage: Stage, problem: Any, picks: Sequence[int], least: float = LEAST) -> Said | None:
    """The picks of a linear method, as far as each is worth something."""
    around = ranges(stage.channel)
    some, names = monomials(stage.channel.features), stage.channel.features
    rows = library(some, around.scaled(stage.channel))
    said = peers_methods.above(problem, list(picks), least)
    if not said:
        return None
    first = max(said, key=lambda one: one.gain)
    use = [one.index for one in said]
    sizes, level = stage.sizes(rows[use])

    def predict(other: Channel) -> Floats:
        values = sizes @ library([some[k] for k in use], around.scaled(other)) + level
        return np.asarray(shown(stage.name, other, values))
    return Said(stage.name, some[first.index].columns(names), some[first.index].form(names),
                min(one.gain for one in said), predict)


def there(found: Iterable[Said | None]) -> list[Said]:
    return [one for one in found if one is not None]


def by_library(rule: Callable[[Any, Any], list[int]]) -> Method:
    """A rule of peers_methods, asked of every stage."""
    def ask(log: Log, seed: int) -> list[Said]:
        return there([picked(stage, log.libraries[stage.name], rule(None, log.libraries[stage.name]))
                      for stage in log.stages])
    return ask


# -- correctors without a form -----------------------------------------------------------------------------------------

def _spline(stage: Stage, problem: Any) -> Said:
    """Additive splines over everything; named is the variable without which they lose most."""
    gram, right = problem.x.T @ problem.x, problem.x.T @ problem.y
    knots = gram.shape[0] // len(stage.channel.features)

    def worth(use: npt.NDArray[np.int64]) -> float:
        """What is explained, less the freedom used (AIC)."""
        g = gram[np.ix_(use, use)] + RIDGE * np.eye(len(use))
        size = np.linalg.solve(g, right[use])
        freedom = float(np.trace(np.linalg.solve(g, gram[np.ix_(use, use)])))
        return float(2.0 * size @ right[use] - size @ gram[np.ix_(use, use)] @ size) - 2.0 * freedom

    every = np.arange(len(gram))
    columns = [column_of(name) for name in stage.channel.features]
    whole = worth(every)
    lost = {name: whole - worth(np.array([k for k in every if columns[k // knots] != name])) for name in set(columns)}
    sizes = np.linalg.solve(gram + RIDGE * np.eye(len(every)), right)
    first = stage.channel

    def predict(other: Channel) -> Floats:
        return np.asarray(shown(stage.name, other, sizes @ hats(other, first)))
    return Said(stage.name, (max(lost, key=lambda name: lost[name]),), "", whole, predict)


def spline(log: Log, seed: int) -> list[Said]:
    return [_spline(stage, log.splines[stage.name]) for stage in log.stages]


def _pointed_at(log: Log) -> tuple[Stage, float]:
    """The stage of which the splines explain most, and how much."""
    best = max(spline(log, 0), key=lambda one: one.score)
    return next(s for s in log.stages if s.name == best.stage), best.score


class Pointwise(NamedTuple):
    """A stage's value at some rows: features scaled (n, k), values (n,), their s.d. (n,)."""

    x: Floats
    y: Floats
    sd: Floats
    around: Ranges


def pointwise(stage: Stage, count: int, seed: int) -> Pointwise:
    """Some rows, evenly drawn, at which the stage does enough to be read; flow over windows of the scale."""
    c, around = stage.channel, ranges(stage.channel)
    x, y, weight = around.scaled(c), c.residual, c.weight
    if stage.name == "flow":
        hop = max(1, round(WINDOW_S / c.step_s))
        starts = np.arange(0, len(y) - hop, hop)
        summed = np.cumsum(weight)
        y, weight = y[starts + hop] - y[starts], summed[starts + hop] - summed[starts]
        x = np.array([np.add.reduceat(row, starts) / hop for row in x])
    elif stage.name in ("gate", "scale"):
        y, weight = y - np.median(y), np.ones(len(y))
    use = np.flatnonzero(np.abs(weight) > 0.3 * np.median(np.abs(weight[weight != 0.0])) if weight.any() else [])
    use = np.sort(np.random.default_rng(seed).permutation(use)[:count])
    noise = 1.4826 * float(np.median(np.abs(y - np.median(y)))) + 1e-12
    return Pointwise(x[:, use].T, y[use] / weight[use], noise / np.abs(weight[use]), around)


def _few_steps(objective: Callable[..., Any], start: Floats, bounds: Floats) -> tuple[Floats, float]:
    """The usual optimizer, stopped early."""
    found = minimize(objective, start, method="L-BFGS-B", jac=True, bounds=bounds, options={"maxiter": GP_STEPS})
    return found.x, float(found.fun)


def gaussian_process(log: Log, seed: int) -> list[Said]:
    """Prediction only: on the stage that the splines point at. Named is the variable of the shortest length scale."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    stage, score = _pointed_at(log)
    p = pointwise(stage, GP_ROWS, seed)
    scale = float(np.std(p.y)) + 1e-12
    kernel = ConstantKernel(0.3, (1e-3, 1e2)) * RBF(np.full(p.x.shape[1], 3.0), (0.3, 1e3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = GaussianProcessRegressor(kernel, alpha=(p.sd / scale) ** 2 + 1e-6, optimizer=_few_steps)
        model.fit(p.x, (p.y - np.mean(p.y)) / scale)
    lengths, middle = model.kernel_.k2.length_scale, float(np.mean(p.y))

    def predict(other: Channel) -> Floats:
        values = scale * model.predict(p.around.scaled(other).T) + middle
        return np.asarray(shown(stage.name, other, values))
    return [Said(stage.name, (column_of(stage.channel.features[int(np.argmin(lengths))]),), "", score, predict)]


def symbolic(log: Log, seed: int) -> list[Said]:
    """Genetic programming (gplearn) on the stage that the splines point at. Score: what is explained of held-out rows,
    in units of their noise."""
    from gplearn.genetic import SymbolicRegressor

    stage, _ = _pointed_at(log)
    p = pointwise(stage, SYMBOLIC_ROWS, seed)
    fit = np.arange(len(p.y)) // max(1, len(p.y) // 10) % 2 == 0
    scale, weights = float(np.std(p.y)) + 1e-12, 1.0 / p.sd ** 2
    model = SymbolicRegressor(population_size=250, generations=8, tournament_size=12, metric="mse",
                              function_set=("add", "sub", "mul", "abs", "max", "min"), parsimony_coefficient=0.003,
                              const_range=(-1.0, 1.0), init_depth=(1, 3), random_state=seed, n_jobs=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(p.x[fit], p.y[fit] / scale, sample_weight=weights[fit])
    middle = float(np.average(p.y[fit], weights=weights[fit]))
    held = ~fit
    plain = np.sum(weights[held] * (p.y[held] - middle) ** 2)
    left = np.sum(weights[held] * (p.y[held] - scale * model.predict(p.x[held])) ** 2)
    used = sorted({column_of(stage.channel.features[node]) for node in model._program.program if isinstance(node, int)})

    def predict(other: Channel) -> Floats:
        return np.asarray(shown(stage.name, other, scale * model.predict(p.around.scaled(other).T)))
    return [Said(stage.name, tuple(used), "", float(plain - left), predict)] if used else []


# -- where is the physics wrong ----------------------------------------------------------------------------------------

def lisdd(log: Log, seed: int) -> list[Said]:
    """The recipe of "Where is my physics wrong?" (arXiv 2606.23215), from its description; no code is public.

    Find the regime in which the model is right, settle its parameters there, find the missing term where it is not.
    Here: cells of each variable; right are those whose residual, read at points, is noise. The stage's level is settled
    there; a sparse regression on the rows outside gives the term.
    """
    return there([_lisdd(stage, seed) for stage in log.stages])


def _lisdd(stage: Stage, seed: int) -> Said | None:
    import pysindy

    p = pointwise(stage, 4000, seed)
    right = _right_rows(p)
    if right is None:
        return None
    level = float(np.average(p.y[right], weights=1.0 / p.sd[right] ** 2))
    outside = ~right
    options = monomials(stage.channel.features)
    x, y = library(options, p.x[outside].T).T / p.sd[outside, None], (p.y[outside] - level) / p.sd[outside]
    norms = np.linalg.norm(x, axis=0) + 1e-9
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        weights = np.ravel(pysindy.STLSQ(threshold=4.5, alpha=1e-3).fit(x / norms, y[:, None]).coef_)
    use = [int(k) for k in np.argsort(-np.abs(weights)) if weights[k] != 0.0][:3]
    if not use:
        return None
    sizes = np.linalg.lstsq(x[:, use], y, rcond=None)[0]
    gain = float(y @ y - np.sum((y - x[:, use] @ sizes) ** 2))
    first = options[use[0]]

    def predict(other: Channel) -> Floats:
        values = sizes @ library([options[k] for k in use], p.around.scaled(other)) + level
        return np.asarray(shown(stage.name, other, values))
    return Said(stage.name, first.columns(stage.channel.features), first.form(stage.channel.features), gain, predict)


def _right_rows(p: Pointwise) -> npt.NDArray[np.bool_] | None:
    """Rows in the cells of the variable along which right and wrong differ most; None where all cells are alike."""
    z = p.y / p.sd
    best: tuple[float, npt.NDArray[np.bool_]] | None = None
    for x in p.x.T:
        edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, CELLS + 1)))
        cell = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(0, len(edges) - 2))
        count = np.bincount(cell)
        mean = np.bincount(cell, weights=z) / np.maximum(1, count)
        square = np.bincount(cell, weights=z ** 2) / np.maximum(1, count)
        contrast = float(np.sum(count * (mean - np.average(mean, weights=count)) ** 2)) + float(
            np.sum(count * (square / max(1e-9, float(np.median(square))) - 1.0) ** 2)) / 2.0
        trusted = np.abs(mean - np.median(mean)) * np.sqrt(count) + np.sqrt(count / 2.0) * np.maximum(
            0.0, square / max(1e-9, float(np.min(square))) - 1.0)
        right = (trusted <= np.median(trusted))[cell]
        if right.any() and not right.all() and (best is None or contrast > best[0]):
            best = (contrast, right)
    return None if best is None else best[1]
