"""A stage's residual as a linear problem: columns of a peer's dictionary as they show in the channel, whitened.

What acts on the flow is read off the scale as its sum, so a dictionary's column is multiplied by what 1 % is and added
up first. Whitened by the noise model of the diagnosis (a fast and a slow component over a floor, by band in the cosine
domain), fitted to what an additive spline over everything recorded leaves.
"""
from __future__ import annotations

from functools import cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from beyond_other_run import NOISE, READING
from beyond_problem import Channel, column_of
from peers_methods import Small

from control.diagnosis.judgement import noise as noises

Floats = npt.NDArray[np.float64]
STAGES = ("shaft", "gate", "flow", "scale", "speed")
FAST_S = {"shaft": 0.1, "gate": 0.1, "scale": 1.0, "speed": 0.2}
KNOTS = 6                         # of the spline, a variable
RIDGE = 3.0


def shown(stage: str, channel: Channel, rows: Floats) -> Floats:
    """What rows (k, n) in the unit of the stage (%, mm, kg) do to its channel (k, n)."""
    if stage == "flow":
        return np.asarray(np.cumsum(rows * channel.weight, axis=-1))
    return rows if stage in ("gate", "scale") else np.asarray(rows * channel.weight)


class White(NamedTuple):
    """Whitens series (k, n) of a channel to (k, m)."""

    cut: noises.Segments
    root: Floats

    def __call__(self, rows: Floats) -> Floats:
        return np.asarray(noises.coefficients(rows, self.cut) / self.root)


class Stage(NamedTuple):
    """One stage's problem. `y` (m,) and `nuisances` (j, m): whitened residual; level of stage and channel, and
    what the tolerances of the drives change."""

    name: str
    channel: Channel
    white: White
    y: Floats
    nuisances: Floats

    def small(self, rows: Floats) -> Small:
        """The problem of a dictionary's rows (k, n), nuisances taken out, rotated to as many coordinates as it has."""
        x = self.white(shown(self.name, self.channel, rows))
        q, _ = np.linalg.qr(self.nuisances.T)
        x, y = x - (x @ q) @ q.T, self.y - (self.y @ q) @ q.T
        r = np.linalg.qr(np.column_stack([x.T, y]), mode="r")
        norms = np.linalg.norm(r[:, :-1], axis=0)
        return Small(r[:, :-1], r[:, -1], np.flatnonzero(norms > 1e-6))

    def sizes(self, rows: Floats) -> tuple[Floats, float]:
        """Sizes of rows (k, n) and of the stage's level, fitted together."""
        x = np.vstack([self.nuisances, self.white(shown(self.name, self.channel, rows))])
        found = np.linalg.lstsq(x.T, self.y, rcond=None)[0]
        return found[len(self.nuisances):], float(found[0])


class Log:
    """The stages that a log shows, and what several peers ask of them, made once."""

    def __init__(self, problem: dict[str, Channel]) -> None:
        self.stages = stages(problem)

    @cached_property
    def libraries(self) -> dict[str, Small]:
        """Each stage's problem with polynomials of degree two."""
        return {s.name: s.small(library(monomials(s.channel.features), ranges(s.channel).scaled(s.channel)))
                for s in self.stages}

    @cached_property
    def splines(self) -> dict[str, Small]:
        """Each stage's problem with additive splines."""
        return {s.name: s.small(hats(s.channel)) for s in self.stages}


def stages(problem: dict[str, Channel]) -> list[Stage]:
    """Every stage that the log shows."""
    whites = {name: _white(name, channel) for name, channel in problem.items()}
    out = []
    for name in STAGES:
        key = READING[name]
        if key in problem:
            channel, white = problem[key], whites[key]
            ones = np.ones((1, len(channel.residual)))
            level = shown(name, channel, ones)
            rows = [level, *(() if name == "gate" else (ones,)), channel.nuisances[channel.nuisances.any(axis=1)]]
            out.append(Stage(name, channel, white, white(channel.residual), white(np.vstack(rows))))
    return out


def _white(name: str, channel: Channel) -> White:
    """The noise of what a spline over everything leaves."""
    cut = noises.segments(len(channel.residual))
    sd = NOISE[name] / max(1.0, channel.step_s / FAST_S[name]) ** 0.5
    prior = noises.NoisePrior(sd, FAST_S[name], 0.05 * sd)
    rows = hats(channel)
    columns = [shown(stage, channel, rows) for stage in STAGES if READING[stage] == name]
    design = noises.coefficients(np.vstack([np.ones((1, rows.shape[1])), channel.nuisances, *columns]), cut)
    target, left = noises.coefficients(channel.residual, cut), noises.coefficients(channel.residual, cut)
    noise = noises.start(prior)
    for _ in range(2):
        noise = noises.fit(np.add.reduceat(left ** 2, cut.starts), noise, prior, cut, channel.step_s)
        root = np.sqrt(noises.strengths(noise, prior, cut, channel.step_s))
        x = design / root
        norms = np.linalg.norm(x, axis=1) + 1e-9
        x = x / norms[:, None]
        size = np.linalg.solve(x @ x.T + 0.01 * np.eye(len(x)), x @ (target / root))
        left = target - (size / norms) @ design
    noise = noises.fit(np.add.reduceat(left ** 2, cut.starts), noise, prior, cut, channel.step_s)
    return White(cut, np.sqrt(noises.strengths(noise, prior, cut, channel.step_s)))


class Ranges(NamedTuple):
    """Middle, spread and ends of each feature in the first run (k,): another run is not asked beyond them."""

    middle: Floats
    spread: Floats
    low: Floats
    high: Floats

    def scaled(self, channel: Channel) -> Floats:
        held = np.clip(channel.values, self.low[:, None], self.high[:, None])
        return np.asarray((held - self.middle[:, None]) / self.spread[:, None])


def ranges(channel: Channel) -> Ranges:
    v = channel.values.astype(float)
    return Ranges(v.mean(axis=1), np.maximum(v.std(axis=1), 1e-9), v.min(axis=1), v.max(axis=1))


def hats(channel: Channel, of: Channel | None = None) -> Floats:
    """Straight-line splines over each feature of `channel`, knots at quantiles of `of` (k KNOTS, n)."""
    first = of or channel
    out = []
    for x, known in zip(channel.values.astype(float), first.values.astype(float), strict=True):
        knots = np.unique(np.quantile(known, np.linspace(0.0, 1.0, KNOTS)))
        if len(knots) < 2:
            out.append(np.zeros((KNOTS, len(x))))
            continue
        some = [np.interp(x, knots, np.eye(len(knots))[k]) for k in range(len(knots))]
        out.append(np.vstack([*some, np.zeros((KNOTS - len(knots), len(x)))]))
    return np.vstack(out)


class Monomial(NamedTuple):
    features: tuple[int, ...]

    def columns(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Log columns that it is over."""
        return tuple(sorted({column_of(names[k]) for k in self.features}))

    def form(self, names: tuple[str, ...]) -> str:
        """By the published list."""
        if any(names[k].startswith(("sin ", "cos ")) for k in self.features):
            return "periodic" if len(self.columns(names)) == 1 else "product"
        return "slope" if len(self.features) == 1 else "product" if len(set(self.features)) == 2 else "bend"


def monomials(names: tuple[str, ...]) -> list[Monomial]:
    """Degrees one and two, products of two variables included."""
    count = range(len(names))
    return [*(Monomial((k,)) for k in count), *(Monomial(pair) for pair in combinations_with_replacement(count, 2))]


def library(some: list[Monomial], scaled: Floats) -> Floats:
    """Their values (k, n)."""
    return np.array([np.prod(scaled[list(m.features)], axis=0) for m in some])
