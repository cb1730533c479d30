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
from .likelihood import Column, Problem, best_fitted, calm, problem, solved, taken_off
from .model import adds_up, course, with_course
from .noise import Noise, coefficients, series_of, strengths
from .search import Candidate, Scanned

Array = npt.NDArray[np.float64]

TIMES = 8                   # at which the information is had exactly ...
FEW_TIMES = 3               # ... once it is had at these and the gain may matter
MAY_MATTER = 6.0            # of twice the log-likelihood
MOST_CELLS = 8_000_000      # of numbers at a time: candidates are looked at side by side
END_S = 8.0                 # from either end of the log: nothing is told to begin there


class _Whitened(NamedTuple):
    """One channel under a hypothesis. `weighted`: residual times the inverse covariance of the noise, (copies, m)."""

    channel: ChannelSeries
    weighted: Array
    scale: Array                # of banded coefficients: 1 / s.d. of the noise there
    place: slice                # of its coefficients in the stack of all channels


class _Tried(NamedTuple):
    """A candidate, and what one unit of it does all along, (copies x m,) by channel."""

    candidate: Candidate
    units: list[Array]


class _Ground(NamedTuple):
    """What a hypothesis leaves, and an orthonormal basis of what it can take up (whitened, priors as rows)."""

    channels: dict[str, _Whitened]
    basis: Array                # (rows, columns)


def changes(columns: Columns, parts: Parts, noise: dict[str, Noise],
            tried: Sequence[Candidate]) -> list[Scanned]:
    """Every candidate with the best time to begin, at once and growing: best gain first, noise as given and calm.

    The gain is of twice the log-likelihood under a noise that is not fitted again.
    """
    begins = that_may_begin(tried)
    if not begins:
        return []
    traces = [columns.model.difference(parts, candidate.part) for candidate in begins]
    channels, banded, base = columns.model.channels, columns.model.banded_residual(parts), columns.of_hypothesis(parts)
    p = problem(channels, banded, base)
    fit = best_fitted(p, np.arange(len(base)), noise, channels)
    at_ease = calm(fit.noise, channels)
    under = [fit.noise] if at_ease == fit.noise else [fit.noise, at_ease]
    return best_begins(p, channels, banded, base, under, begins, traces)


def that_may_begin(tried: Sequence[Candidate]) -> list[Candidate]:
    """Those of some candidates that may begin in the middle of a log."""
    return [c for c in tried if c.part.onset_s is None and ROWS[c.part.id].may_begin
            and not CATALOGUE[c.part.id].effect.onset_only
            and (ROWS[c.part.id].has_slope or ROWS[c.part.id].threshold)]


def best_begins(p: Problem, channels: Sequence[ChannelSeries], banded: dict[str, Array], base: Sequence[Column],
                under: Sequence[dict[str, Noise]], begins: Sequence[Candidate], traces: Sequence[dict[str, Array]],
                matters: float = MAY_MATTER, end_s: float = END_S) -> list[Scanned]:
    """The same of series, however they were had. traces : what each candidate does all along, (m,) by channel.

    banded : cosine coefficients of the residual by channel. base : what the hypothesis can take up. p : both as one
    problem. under : noises, of which each candidate has the one that speaks most for it. matters : gain from which on
    the information is had at more times. end_s : from either end, within which nothing is looked for.
    """
    best: dict[tuple[str, int | None, bool], Scanned] = {}
    for noise in under:
        amplitude, _ = solved(p, np.arange(len(base)), noise)
        ground = _ground(channels, taken_off(banded, base, amplitude), base, noise)
        for grows in (False, True):
            for found in _begun_all(ground, begins, traces, grows, matters, end_s):
                name = (found.part.id, found.part.member, grows)
                if name not in best or found.gain > best[name].gain:
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


def _begun_all(ground: _Ground, tried: Sequence[Candidate], traces: Sequence[dict[str, Array]],
               grows: bool, matters: float, end_s: float) -> list[Scanned]:
    """The best time for each candidate to begin; those of the same channels are looked at side by side."""
    alike: dict[tuple[tuple[str, ...], tuple[bool, ...]], list[_Tried]] = {}
    for candidate, trace in zip(tried, traces, strict=True):
        names = tuple(name for name in ground.channels if name in trace)
        if names and not (grows and ROWS[candidate.part.id].threshold):
            summed = tuple(adds_up(candidate.part, name) for name in names)
            alike.setdefault((names, summed), []).append(_Tried(
                candidate, [trace[name] / candidate.part.size for name in names]))
    found = []
    for (names, summed), ones in alike.items():
        seen = [ground.channels[name] for name in names]
        each = max(1, MOST_CELLS // (TIMES * sum(one.weighted.size for one in seen)))
        for begin in range(0, len(ones), each):
            found += _begun(ground, seen, summed, ones[begin:begin + each], grows, matters, end_s)
    return found


def _begun(ground: _Ground, seen: Sequence[_Whitened], summed: Sequence[bool], ones: Sequence[_Tried],
           grows: bool, matters: float, end_s: float) -> list[Scanned]:
    """The best time to begin for candidates that touch the same channels in the same way."""
    finest = max((one.channel for one in seen), key=lambda c: len(c.grid.even_s))
    time_s = finest.grid.even_s
    inside = (time_s > time_s[0] + end_s) & (time_s < time_s[-1] - end_s)
    if not inside.any():
        return []
    units = [np.array([one.units[k] for one in ones]) for k in range(len(seen))]
    pull = np.zeros((len(ones), len(time_s)))
    for one, unit, adds in zip(seen, units, summed, strict=True):
        sums = _sums_from(one, unit.reshape(len(ones), one.channel.copies, -1), adds, grows)
        pull += sums if one.channel is finest else np.array([np.interp(time_s, one.channel.grid.even_s, row)
                                                             for row in sums])
    left = np.arange(len(ones))
    found: dict[int, Scanned] = {}
    for count in (FEW_TIMES, TIMES):
        exact_s = np.linspace(time_s[0] + end_s, time_s[-1] - end_s, count)
        exact = _information(ground, seen, summed, [unit[left] for unit in units], exact_s, grows)
        more = []
        for k, line in zip(left.tolist(), exact, strict=True):
            information = np.maximum(np.interp(time_s, exact_s, line), 1e-12)
            found[k] = _at_best(ones[k].candidate, pull[k], information, inside, time_s, grows)
            if found[k].gain >= matters:
                more.append(k)
        left = np.array(more, int)
        if not more:
            break
    return [found[k] for k in range(len(ones))]


def _at_best(candidate: Candidate, pull: Array, information: Array, inside: npt.NDArray[np.bool_], time_s: Array,
             grows: bool) -> Scanned:
    """One candidate at its best time. pull, information : were it to begin at each sample (m,)."""
    size = np.clip(pull / information, candidate.low, candidate.high)
    if ROWS[candidate.part.id].threshold:       # half a threshold's column is not what half a threshold does
        size = np.full(len(time_s), candidate.part.size)
    gain = np.where(inside, 2.0 * pull * size - information * size ** 2, -np.inf)
    at = int(np.argmax(gain))
    return Scanned(candidate.part._replace(size=float(size[at]), onset_s=float(time_s[at]), grows=grows),
                   float(gain[at]))


def _sums_from(seen: _Whitened, trace: Array, summed: bool, grows: bool) -> Array:
    """Sum of weighted residual x trace, were it to begin at each sample: (k, m). trace : (k, copies, m)."""
    weighted, time_s = seen.weighted, seen.channel.grid.even_s
    if not grows:
        level = trace.sum(axis=1) * _ahead(weighted) if summed else 0.0
        return np.asarray(_ahead(weighted * trace) - level)
    if not summed:
        sums = _ahead(weighted * trace * time_s) - time_s * _ahead(weighted * trace)
    else:
        rate = np.diff(trace, prepend=trace[..., :1])
        moment, level = np.cumsum(rate * time_s, axis=-1), np.cumsum(rate, axis=-1)
        sums = _ahead(weighted * moment) - moment[:, 0] * _ahead(weighted)
        sums = sums - time_s * (_ahead(weighted * level) - level[:, 0] * _ahead(weighted))
    return np.asarray(sums / np.maximum(time_s[-1] - time_s, 1.0))


def _ahead(values: Array) -> Array:
    """Sum over copies of all samples from each one on: (..., m) of (..., copies, m)."""
    return np.asarray(np.cumsum(values[..., ::-1].sum(axis=-2), axis=-1)[..., ::-1])


def _information(ground: _Ground, seen: Sequence[_Whitened], summed: Sequence[bool], units: Sequence[Array],
                 onsets_s: Array, grows: bool) -> Array:
    """Information on sizes by onset, (k, onsets), once the hypothesis has taken up what it can. units : (k, m)."""
    count = len(units[0]) * len(onsets_s)
    own, taken = np.zeros(count), np.zeros((count, ground.basis.shape[1]))
    for one, unit, adds in zip(seen, units, summed, strict=True):
        weight = np.array([course(one.channel, Part("", 1.0, float(at), grows=grows)) for at in onsets_s])
        begun = with_course(unit[:, None, :], weight, one.channel.copies, adds).reshape(count, -1)
        whole = coefficients(begun, one.channel.cut) * one.scale
        own += np.einsum("ij,ij->i", whole, whole)
        taken += whole @ ground.basis[one.place]
    return np.asarray((own - np.sum(taken ** 2, axis=1)).reshape(-1, len(onsets_s)))
