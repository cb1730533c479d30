"""Evidence block by block, and what a search finds where there is nothing: replicates of the whitened residual.

Every statistic of the search is a sum over time of (whitened residual) x (whitened trace). Cut into blocks, those sums
are few numbers; with the sign of each block drawn anew they are what noise of this strength, this unevenness and these
tails would have given (wild block bootstrap: Wu 1986, Annals of Statistics 14, 1261). One matrix product gives the
maximum over everything searched, hundreds of times.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from . import noise as noises
from .channels import ChannelSeries
from .columns import Columns
from .hypothesis import Parts
from .likelihood import Column, problem, solved, taken_off, weighted
from .noise import Noise, series_of

Array = npt.NDArray[np.float64]

BLOCKS = 64                 # of each channel: a block is far longer than whitened noise remembers
SHORT_BLOCKS = 16           # of what comes and goes
REPLICATES = 1000           # a probability of 0.002 is then two of them
SEED = 20260101             # of the signs: the same log gives the same diagnosis
UNEVEN = 1.5                # times the variance between blocks that even noise gives: below it is chance
MIN_ENERGY_LEFT = 0.05      # of a trace's energy: on less, nothing is told
MANY = 48                   # coefficients of a band, for its strength to be known to a fifth
MIN_DRIFT = 0.12            # of the fast noise's s.d.: less is no drift
NO_NOISE = -30.0            # logarithm of an s.d. so small that it stands for none


class Scores(NamedTuple):
    """Traces against the whitened residual, block by block. Nuisances, slopes and forms are fitted first.

    The last row is that of the tolerances: each is one more reading, of 0 with the tolerance as its noise.
    """

    score: Array                # (blocks + 1, k): sum of residual x trace
    energy: Array               # (blocks + 1, k): sum of trace squared


def scores(columns: Columns, parts: Parts, noise: dict[str, Noise], traces: Sequence[Column],
           counts: Mapping[str, int] | None = None) -> Scores:
    """Block sums of `traces` on top of a hypothesis. counts : blocks by channel; BLOCKS of each if None."""
    base, model = columns.of_hypothesis(parts), columns.model
    before, data = len(base), model.banded_residual(parts)
    p = problem(model.channels, data, [*base, *traces])
    amplitude, covariance = solved(p, np.arange(before), noise)
    normal, _ = weighted(p, noise)
    shares = covariance @ normal[:before, before:]                    # of each base column in each trace
    left, found = taken_off(data, base, amplitude), list[tuple[Array, Array]]()
    for channel in model.channels:
        plain = _stacked(traces, channel)
        for j, column in enumerate(base):
            if channel.name in column.coefficients:
                plain -= shares[j][:, None] * column.coefficients[channel.name]
        count = BLOCKS if counts is None else counts[channel.name]
        found.append(_block_sums(channel, noise[channel.name], left[channel.name], plain, count))
    told = (p.mean[:before] - amplitude) / p.sd[:before]
    tolerated = -shares / p.sd[:before, None]
    found.append(((told @ tolerated)[None], (tolerated ** 2).sum(axis=0)[None]))
    return Scores(np.concatenate([s for s, _ in found]), np.concatenate([e for _, e in found]))


def _stacked(traces: Sequence[Column], channel: ChannelSeries) -> Array:
    """Banded coefficients of the traces in one channel (k, m), zero where one does not touch it."""
    stack = np.zeros((len(traces), len(channel.cut.order)))
    for k, trace in enumerate(traces):
        if channel.name in trace.coefficients:
            stack[k] = trace.coefficients[channel.name]
    return stack


def _edges(samples: int, blocks: int) -> npt.NDArray[np.int_]:
    """First samples of so many blocks (blocks,)."""
    return np.linspace(0, samples, blocks + 1).astype(int)[:-1]


def _block_sums(channel: ChannelSeries, noise: Noise, left: Array, traces: Array,
                blocks: int) -> tuple[Array, Array]:
    """Sums over blocks, (blocks, k) each: whitened residual times whitened traces, and these squared."""
    scale = 1.0 / np.sqrt(noises.strengths(noise, channel.prior, channel.cut, channel.grid.step_s))
    residual = series_of(left * scale, channel.cut)
    edges = _edges(len(residual), blocks)
    sums, squares = np.empty((blocks, len(traces))), np.empty((blocks, len(traces)))
    for k, banded in enumerate(traces):
        trace = series_of(banded * scale, channel.cut)
        sums[:, k] = np.add.reduceat(residual * trace, edges)
        squares[:, k] = np.add.reduceat(trace ** 2, edges)
    return sums, squares


def colour(columns: Columns, parts: Parts, noise: dict[str, Noise], trace: Column) -> float:
    """How much stronger than its noise the residual is where a trace lives: 1 where the noise tells it.

    A sensor that hums is louder in a few quick bands than any first-order noise says; what a trace gains there counts
    by so much less. Only bands of MANY coefficients are looked at: in narrower ones lives what else may be wrong.
    """
    base, model = columns.of_hypothesis(parts), columns.model
    data = model.banded_residual(parts)
    amplitude, _ = solved(problem(model.channels, data, base), np.arange(len(base)), noise)
    loud = total = 0.0
    for channel in model.channels:
        name, cut = channel.name, channel.cut
        if name not in trace.coefficients:
            continue
        left = data[name].copy()
        for size, column in zip(amplitude, base, strict=True):
            if name in column.coefficients:
                left -= size * column.coefficients[name]
        strength = noises.spectrum(np.array(noise[name].theta), channel.prior, cut, channel.grid.step_s)
        energy = np.add.reduceat(trace.coefficients[name] ** 2, cut.starts) / strength
        louder = np.add.reduceat(left ** 2, cut.starts) / (cut.members * strength)
        loud += float(np.sum(energy * np.where(cut.members >= MANY, np.maximum(1.0, louder), 1.0)))
        total += float(np.sum(energy))
    return loud / total if total > 0.0 else 1.0


def slow_share(banded: Array, channel: ChannelSeries, noise: Noise) -> float:
    """Share of the energy of `banded` coefficients (m,) in bands where the slow noise is stronger than the fast.

    0 where there is no slow noise worth the name: its prior never lets it vanish altogether.
    """
    if noise.slow_sd < MIN_DRIFT * noise.fast_sd:
        return 0.0
    fast = np.array([*noise.theta[:2], NO_NOISE, noise.theta[3]])
    cut, step_s = channel.cut, channel.grid.step_s
    slow = noises.spectrum(np.array(noise.theta), channel.prior, cut, step_s) > 2.0 * noises.spectrum(
        fast, channel.prior, cut, step_s)
    power = np.add.reduceat(banded ** 2, cut.starts)
    return float(power[slow].sum() / max(float(power.sum()), 1e-300))


def without_fit(seen: Scores) -> Array:
    """Block scores (blocks, k) once each trace's own best amplitude is taken off: what is left is noise."""
    amplitude = seen.score.sum(axis=0) / np.maximum(seen.energy.sum(axis=0), 1e-12)
    return np.asarray(seen.score - seen.energy * amplitude)


def null_of_maximum(seen: Scores) -> Array:
    """Largest gain (twice the log-likelihood) over all traces in each replicate: (REPLICATES,), sorted.

    Each trace's gain is in units of its own unevenness: one that carries noise itself would drown all others.
    """
    signs = np.random.default_rng(SEED).choice((-1.0, 1.0), (REPLICATES, len(seen.score)))
    energy = np.maximum(seen.energy.sum(axis=0), 1e-12)
    uneven = np.array([unevenness(seen, k) for k in range(seen.score.shape[1])])
    return np.sort(((signs @ without_fit(seen)) ** 2 / (energy * uneven)).max(axis=1, initial=0.0))


def chance(null: Array, gain: float) -> float:
    """Share of replicates in which nothing gained as much."""
    return float((1.0 + np.sum(null >= gain)) / (1.0 + len(null)))


def spread_over(seen: Scores, k: int) -> float:
    """How uneven trace k's evidence is: its variance between blocks over that of even noise, at least 1."""
    left = without_fit(seen)[:, k]
    return max(1.0, float(np.sum(left ** 2) / max(float(seen.energy[:, k].sum()), 1e-12)))


def unevenness(seen: Scores, k: int) -> float:
    """The same where it is more than the chance of BLOCKS blocks, else 1."""
    spread = spread_over(seen, k)
    return spread if spread > UNEVEN else 1.0


def coarser(seen: Scores, by: int = 4) -> Scores:
    """The same in blocks that are `by` times as long; the tolerances' row stays."""
    traces = seen.score.shape[1]

    def merged(rows: Array) -> Array:
        return np.concatenate([rows[:-1].reshape(-1, by, traces).sum(axis=1), rows[-1:]])
    return Scores(merged(seen.score), merged(seen.energy))


def without_best_block(seen: Scores, k: int) -> float:
    """Gain that trace k keeps when the block that speaks loudest for it is left out, scaled to the whole."""
    score, energy = seen.score[:, k], seen.energy[:, k]
    total_score, total = float(score.sum()), float(energy.sum())
    sign = 1.0 if total_score >= 0.0 else -1.0
    least = np.inf
    for s, e in zip(sign * score[:-1], energy[:-1], strict=True):
        if e > 0.9 * total or total <= 0.0:
            continue
        rest = max(0.0, sign * total_score - float(s))
        least = min(least, rest ** 2 / (total - float(e)) * total / (total - float(e)))
    return float(least)


def while_there(columns: Columns, parts: Parts, noise: dict[str, Noise], trace: Column, from_s: float,
                to_s: float) -> Scores:
    """Block sums of a trace that comes and goes, over SHORT_BLOCKS of the time in which it is there.

    What nuisances take of it elsewhere is none of its evidence.
    """
    inside, counts = [], {}
    for channel in columns.model.channels:
        time_s = channel.grid.even_s
        each = max(1, round(SHORT_BLOCKS * float(time_s[-1] - time_s[0]) / (to_s - from_s)))
        counts[channel.name] = channel.copies * min(each, len(time_s))
        there = np.tile((time_s >= from_s) & (time_s < to_s), channel.copies)
        inside.append(np.logical_or.reduceat(there, _edges(len(there), counts[channel.name])))
    seen = scores(columns, parts, noise, [trace], counts)
    kept = np.append(np.concatenate(inside), True)
    return Scores(seen.score[kept], seen.energy[kept])


def without_best_stretch(seen: Scores, k: int, blocks: int = 4, scaled: bool = True) -> float:
    """The same with `blocks` in a row left out, tolerances apart; 0 where no other stretch could tell of the trace.

    scaled : to the whole, for what would tell more were the log longer; else what the other stretches gain.
    """
    score, energy = seen.score[:-1, k], seen.energy[:-1, k]
    if len(score) <= blocks:            # no reading, or hardly one, was taken while it was there
        return 0.0
    sign, total = 1.0 if score.sum() >= 0.0 else -1.0, float(energy.sum())
    row = np.ones(blocks)
    rest = np.maximum(0.0, sign * score.sum() - np.convolve(sign * score, row, "valid"))
    left = total - np.convolve(energy, row, "valid")
    told = left > MIN_ENERGY_LEFT * max(total, 1e-12)
    kept = rest ** 2 * told / np.where(told, left, 1.0)
    return float(np.min(kept * total / np.where(told, left, 1.0) if scaled else kept))
