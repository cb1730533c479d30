"""Effects that begin, grow or end somewhere in a log: every time of beginning tried at once.

The score test for a change point (Picard 1985, Advances in Applied Probability 17, 841; Andrews 1993, Econometrica 61,
821): the gain of an effect that begins at t is (sum of residual x trace from t on)^2 / information, the residual
weighted with the inverse of the noise's covariance. The sums are cumulative, so that one pass gives them for all t; the
information changes slowly with t and is had exactly at a few times. A drift can follow a step well, but not its edge:
the time must be exact for the step to tell.
"""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS
from control.machine.machine import CATALOGUE

from .channels import ChannelSeries
from .columns import Columns
from .hypothesis import Part, Parts
from .likelihood import Column, best_fitted, calm, problem, solved, taken_off
from .model import adds_up, in_course
from .noise import Noise, coefficients, series_of, strengths
from .search import Candidate, Scanned

Array = npt.NDArray[np.float64]

TIMES = 8                   # at which the information is had exactly ...
FEW_TIMES = 3               # ... once it is had at these and the gain may matter
MAY_MATTER = 6.0            # of twice the log-likelihood
END_S = 8.0                 # from either end of the log: nothing is told to begin there


class _Whitened(NamedTuple):
    """One channel under a hypothesis. `weighted`: residual times the inverse covariance of the noise, (copies, m)."""

    channel: ChannelSeries
    weighted: Array
    scale: Array                # of banded coefficients: 1 / s.d. of the noise there
    place: slice                # of its coefficients in the stack of all channels


class _Ground(NamedTuple):
    """What a hypothesis leaves, and an orthonormal basis of what it can take up (whitened, priors as rows)."""

    channels: dict[str, _Whitened]
    basis: Array                # (rows, columns)


def changes(columns: Columns, parts: Parts, noise: dict[str, Noise],
            tried: Sequence[Candidate]) -> list[Scanned]:
    """Every candidate with the best time to begin, at once and growing: best gain first, noise as given and calm.

    The gain is of twice the log-likelihood under a noise that is not fitted again.
    """
    begins = [c for c in tried if c.part.onset_s is None and ROWS[c.part.id].may_begin
              and not CATALOGUE[c.part.id].effect.onset_only
             and (ROWS[c.part.id].has_slope or ROWS[c.part.id].threshold)]
    if not begins:
        return []
    best: dict[tuple[str, int | None, bool], Scanned] = {}
    base, banded = columns.of_hypothesis(parts), columns.model.banded_residual(parts)
    p = problem(columns.model.channels, banded, base)
    fit = best_fitted(p, np.arange(len(base)), noise, columns.model.channels)
    traces = [columns.model.difference(parts, candidate.part) for candidate in begins]
    starts = [fit.noise, calm(fit.noise, columns.model.channels)]
    for start in starts[:1] if starts[0] == starts[1] else starts:
        amplitude, _ = solved(p, np.arange(len(base)), start)
        ground = _ground(columns.model.channels, taken_off(banded, base, amplitude), base, start)
        for candidate, trace in zip(begins, traces, strict=True):
            for grows in (False,) if ROWS[candidate.part.id].threshold else (False, True):
                found = _begun(ground, candidate, trace, grows)
                name = (candidate.part.id, candidate.part.member, grows)
                if found is not None and (name not in best or found.gain > best[name].gain):
                    best[name] = found
    return sorted(best.values(), key=lambda one: -one.gain)


def _ground(channels: Sequence[ChannelSeries], left: dict[str, Array], base: Sequence[Column],
            noise: dict[str, Noise]) -> _Ground:
    """left : what the base leaves of the banded residual, (m,) by channel."""
    found, begin = {}, 0
    for channel in channels:
        name, cut = channel.name, channel.cut
        strength = strengths(noise[name], channel.prior, cut, channel.grid.step_s)
        weighted = series_of(left[name] / strength, cut).reshape(channel.copies, -1)
        found[name] = _Whitened(channel, weighted, 1.0 / np.sqrt(strength), slice(begin, begin + len(strength)))
        begin += len(strength)
    stack = np.zeros((begin + len(base), len(base)))
    for k, column in enumerate(base):
        for name, one in found.items():
            if name in column.coefficients:
                stack[one.place, k] = column.coefficients[name] * one.scale
        stack[begin + k, k] = 1.0 / column.sd
    stack /= np.maximum(np.linalg.norm(stack, axis=0), 1e-300)
    return _Ground(found, np.linalg.qr(stack)[0])


def _begun(ground: _Ground, candidate: Candidate, trace: dict[str, Array], grows: bool) -> Scanned | None:
    """The best time for one candidate to begin. trace : what the candidate does all along, (m,) by channel."""
    unit = {name: one / candidate.part.size for name, one in trace.items() if name in ground.channels}
    finest = max((ground.channels[name].channel for name in unit), key=lambda c: len(c.grid.even_s), default=None)
    if finest is None:
        return None
    time_s = finest.grid.even_s
    inside = (time_s > time_s[0] + END_S) & (time_s < time_s[-1] - END_S)
    if not inside.any():
        return None
    pull = np.zeros(len(time_s))
    for name, one in unit.items():
        seen = ground.channels[name]
        sums = _sums_from(seen, one.reshape(seen.channel.copies, -1), adds_up(candidate.part, name), grows)
        pull += np.interp(time_s, seen.channel.grid.even_s, sums)
    part = candidate.part._replace(grows=grows)
    for count in (FEW_TIMES, TIMES):
        exact_s = np.linspace(time_s[0] + END_S, time_s[-1] - END_S, count)
        exact = _information(ground, unit, [part._replace(onset_s=float(at)) for at in exact_s])
        information = np.maximum(np.interp(time_s, exact_s, exact), 1e-12)
        size = np.clip(pull / information, candidate.low, candidate.high)
        if ROWS[part.id].threshold:             # half a threshold's column is not what half a threshold does
            size = np.full(len(time_s), part.size)
        gain = np.where(inside, 2.0 * pull * size - information * size ** 2, -np.inf)
        at = int(np.argmax(gain))
        if gain[at] < MAY_MATTER:
            break
    return Scanned(part._replace(size=float(size[at]), onset_s=float(time_s[at])), float(gain[at]))


def _sums_from(seen: _Whitened, trace: Array, summed: bool, grows: bool) -> Array:
    """Sum of weighted residual x trace, were the trace to begin at each sample: (m,). trace : (copies, m)."""
    weighted, time_s = seen.weighted, seen.channel.grid.even_s
    if not grows:
        level = trace.sum(axis=0) * _ahead(weighted) if summed else 0.0
        return np.asarray(_ahead(weighted * trace) - level)
    if not summed:
        sums = _ahead(weighted * trace * time_s) - time_s * _ahead(weighted * trace)
    else:
        rate = np.diff(trace, prepend=trace[:, :1])
        moment, level = np.cumsum(rate * time_s, axis=1), np.cumsum(rate, axis=1)
        sums = _ahead(weighted * moment) - moment[0] * _ahead(weighted)
        sums = sums - time_s * (_ahead(weighted * level) - level[0] * _ahead(weighted))
    return np.asarray(sums / np.maximum(time_s[-1] - time_s, 1.0))


def _ahead(values: Array) -> Array:
    """Sum over copies of all samples from each one on: (m,) of (copies, m)."""
    return np.asarray(np.cumsum(values[:, ::-1], axis=1)[:, ::-1].sum(axis=0))


def _information(ground: _Ground, unit: dict[str, Array], parts: Sequence[Part]) -> Array:
    """Information on the size of one effect by its onset, (k,), once the hypothesis has taken up what it can."""
    whole = np.zeros((len(ground.basis), len(parts)))
    for name, one in unit.items():
        seen = ground.channels[name]
        begun = np.array([in_course(one, seen.channel, part) for part in parts])
        whole[seen.place] = (coefficients(begun, seen.channel.cut) * seen.scale).T
    return np.asarray(np.sum(whole ** 2, axis=0) - np.sum((ground.basis.T @ whole) ** 2, axis=0))
