"""What a hypothesis leaves of a log, whitened, against which every time of beginning is held at once."""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.judgement.evidence import Column
from control.diagnosis.judgement.noise import Noise, coefficients, series_of, strengths

from .channels import ChannelSeries
from .hypothesis import EffectInstance
from .model import adds_up, course, with_course
from .search import Candidate

Array = npt.NDArray[np.float64]


class Whitened(NamedTuple):
    """One channel under a hypothesis. `weighted`: residual times the inverse covariance of the noise, (copies, m)."""

    channel: ChannelSeries
    weighted: Array
    scale: Array                # of banded coefficients: 1 / s.d. of the noise there
    place: slice                # of its coefficients in the stack of all channels


class Tried(NamedTuple):
    """A candidate, and what one unit of it does all along, (copies x m,) by channel."""

    candidate: Candidate
    units: list[Array]


class WhitenedResidual(NamedTuple):
    """What a hypothesis leaves, and an orthonormal basis of what it can take up (whitened, priors as rows)."""

    channels: dict[str, Whitened]
    basis: Array                # (rows, columns)


class Alike(NamedTuple):
    """Candidates that touch the same channels in the same way, looked at side by side."""

    seen: list[Whitened]        # the channels that they touch
    summed: tuple[bool, ...]    # whether each adds up what they do
    ones: list[Tried]

    @property
    def usual(self) -> list[float]:
        """S.d. of the prior of each one's size."""
        return [one.candidate.usual for one in self.ones]

    def units(self) -> list[Array]:
        """What one unit of each does all along, (k, copies x m) by channel."""
        return [np.array([one.units[k] for one in self.ones]) for k in range(len(self.seen))]

    def only(self, which: Sequence[bool]) -> Alike:
        """Those of them that are chosen."""
        return self._replace(ones=[one for one, chosen in zip(self.ones, which, strict=True) if chosen])


def alike(ground: WhitenedResidual, tried: Sequence[Candidate], traces: Sequence[dict[str, Array]],
          cells: int) -> Iterator[Alike]:
    """Candidates gathered by the channels that they touch. traces : what each does all along, (m,) by channel.

    cells : numbers that one of a group may have at most, over its candidates.
    """
    found: dict[tuple[tuple[str, ...], tuple[bool, ...]], list[Tried]] = {}
    for candidate, trace in zip(tried, traces, strict=True):
        names = tuple(name for name in ground.channels if name in trace)
        if names:
            summed = tuple(adds_up(candidate.part, name) for name in names)
            found.setdefault((names, summed), []).append(Tried(
                candidate, [trace[name] / candidate.part.size for name in names]))
    for (names, summed), ones in found.items():
        seen = [ground.channels[name] for name in names]
        each = max(1, cells // sum(one.weighted.size for one in seen))
        for begin in range(0, len(ones), each):
            yield Alike(seen, summed, ones[begin:begin + each])


def whitened_residual(channels: Sequence[ChannelSeries], left: dict[str, Array], base: Sequence[Column],
             noise: dict[str, Noise]) -> WhitenedResidual:
    """left : what the base leaves of the banded residual, (m,) by channel."""
    found, begin = {}, 0
    for channel in channels:
        name, cut = channel.name, channel.cut
        strength = strengths(noise[name], channel.prior, cut, channel.grid.step_s)
        weighted = series_of(left[name] / strength, cut).reshape(channel.copies, -1)
        found[name] = Whitened(channel, weighted, 1.0 / np.sqrt(strength), slice(begin, begin + len(strength)))
        begin += len(strength)
    stack = np.zeros((begin + len(base), len(base)))
    for k, column in enumerate(base):
        for name, one in found.items():
            if name in column.coefficients:
                stack[one.place, k] = column.coefficients[name] * one.scale
        stack[begin + k, k] = 1.0 / column.sd
    stack /= np.maximum(np.linalg.norm(stack, axis=0), 1e-300)
    return WhitenedResidual(found, np.linalg.qr(stack)[0])


def scores_by_onset(group: Alike, grows: bool) -> tuple[Array, Array]:
    """Times of the finest channel (m,), and the sum of weighted residual x trace, were it to begin then: (k, m)."""
    finest = max((one.channel for one in group.seen), key=lambda c: len(c.grid.even_s))
    time_s = finest.grid.even_s
    score = np.zeros((len(group.ones), len(time_s)))
    for one, unit, adds in zip(group.seen, group.units(), group.summed, strict=True):
        sums = _sums_from(one, unit.reshape(len(group.ones), one.channel.copies, -1), adds, grows)
        score += sums if one.channel is finest else np.array([np.interp(time_s, one.channel.grid.even_s, row)
                                                             for row in sums])
    return time_s, score


def _sums_from(seen: Whitened, trace: Array, summed: bool, grows: bool) -> Array:
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


def rows_from_onset(ground: WhitenedResidual, group: Alike, onsets_s: Array, grows: bool) -> tuple[list[Array], Array]:
    """What one unit of each does that begins at each time, whitened: (k, onsets, coefficients) by channel, and what the
    hypothesis takes up of it, in its basis (k, onsets, columns)."""
    count = len(group.ones)
    taken = np.zeros((count, len(onsets_s), ground.basis.shape[1]))
    rows = []
    for one, unit, adds in zip(group.seen, group.units(), group.summed, strict=True):
        weight = np.array([course(one.channel, EffectInstance("", 1.0, float(at), grows=grows)) for at in onsets_s])
        delayed = with_course(unit[:, None, :], weight, one.channel.copies, adds).reshape(count * len(onsets_s), -1)
        whole = (coefficients(delayed, one.channel.cut) * one.scale).reshape(count, len(onsets_s), -1)
        taken += whole @ ground.basis[one.place]
        rows.append(whole)
    return rows, taken
