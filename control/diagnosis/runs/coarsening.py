"""How much of what a column gains is evidence, where the noise is more uneven in time than its model says.

The log is cut into blocks of time. The variance of a block's noise is the model's times a factor of its own with an
inverse-gamma prior about 1, integrated: all samples of a block together follow a multivariate t with `BLOCK_DOF`
degrees of freedom (scale mixtures: West, Biometrika 74, 1987, 646). What is loud for a while counts as the noise that
it is; what a column takes away there, because it fits, counts in full.

Moves that the model follows badly make a column's scores unlike from block to block, more than its information allows.
The gain is divided by the ratio of block-robust to model variance of its score (Kent, Biometrika 69, 1982, 19; Miller
and Dunson, JASA 114, 2019, 1113: coarsening).

A column gains in two ways: over what the other columns cannot follow, and by what it spares those that have a prior
(a tolerance that need not be exceeded). Without it these would have to move, or else the data be left as they are: the
better of the two is what it is held against.
"""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.judgement.evidence import Column
from control.diagnosis.judgement.noise import Noise

from .hypothesis import Hypothesis
from .search import Search
from .whitened import WhitenedResidual

Array = npt.NDArray[np.float64]

BLOCK_S = 30.0              # of a block: longer than one event lasts (a restart, a turn, a hand on the machine) ...
FEWEST, MOST = 8, 64        # ... of so many
BLOCK_DOF = 5.0             # noise of one stretch is known to be what it is elsewhere to some 30 % of its s.d.
LEAST_ENERGY = 1e-9         # of a column, in a block: in one with less it does nothing


class Blocks(NamedTuple):
    """Products of whitened series, summed by block (b,). residual : what the model without the trace leaves; trace :
    what its columns cannot follow of it; held : what they can, by moving what has a prior. samples : how many."""

    residual_residual: Array
    trace_residual: Array
    trace_trace: Array
    held_residual: Array
    held_held: Array
    samples: Array


def even_gain(search: Search, others: Hypothesis, noise: dict[str, Noise], trace: Column,
              more: Sequence[Column] = ()) -> float:
    """What a trace gains in log-likelihood on top of a model, by its scores block by block.

    others : the model without it; more : columns of it along with those of its parts. What these take up of the trace
    is none of its evidence.
    """
    model = search.model
    base = [*search.columns.of_hypothesis(others), *more]
    residual = WhitenedResidual(model.channels, model.banded_residual(others), base, noise)
    own, held = residual.split(trace)
    sums = []
    for channel in model.channels:
        r, t, h = (residual.series(channel, rows) for rows in (residual.left, own, held))
        lasts_s = channel.grid.step_s * len(r)
        blocks = int(np.clip(lasts_s / (channel.copies * BLOCK_S), FEWEST, MOST)) * channel.copies
        if channel.settled:         # no row knows of the one before
            blocks = len(r)
        edges = np.linspace(0, len(r), blocks + 1).astype(int)[:-1]
        sums.append([np.add.reduceat(product, edges) for product in (
            r * r, t * r, t * t, h * r, h * h, np.ones(len(r)))])
    by_block = Blocks(*(np.concatenate(one) for one in zip(*sums, strict=True)))
    if not by_block.trace_trace.any() and not by_block.held_held.any():
        return 0.0
    # Each prior is one more reading, of its mean, with its s.d. as noise.
    off, spared = residual.left[residual.priors], own[residual.priors]
    return _gain(by_block, float(off @ spared), float(spared @ spared))


def _gain(by_block: Blocks, score_of_priors: float, energy_of_priors: float) -> float:
    """Of the products by block and those of the priors: the gain of the best size over the better of two fits without
    it: what has a prior moves in its place, or stands where the trace leaves it."""
    b = by_block
    size = (float(b.trace_residual.sum()) + score_of_priors) / (float(b.trace_trace.sum()) + energy_of_priors)
    left = b.residual_residual - 2.0 * size * b.trace_residual + size ** 2 * b.trace_trace
    stands = b.residual_residual + 2.0 * size * b.held_residual + size ** 2 * b.held_held
    of_priors = size * (score_of_priors - 0.5 * size * energy_of_priors)
    moved = _student(b.residual_residual, left, b.samples) + of_priors
    return min(moved, _student(stands, left, b.samples)) / _unevenness(b, size)


def _student(without: Array, within: Array, count: Array) -> float:
    """Gain from sums of squares without a trace to those with it, (b,): in each block a multivariate t."""
    return 0.5 * float(np.sum((BLOCK_DOF + count) * (np.log(BLOCK_DOF + without) - np.log(BLOCK_DOF + within))))


def _unevenness(b: Blocks, size: float) -> float:
    """Block-robust over model variance of a trace's score, along with it; 1 where the blocks agree better."""
    known = b.trace_trace > LEAST_ENERGY * max(float(b.trace_trace.sum()), 1e-300)
    if not known.any():
        return 1.0
    within = (b.trace_residual - size * b.trace_trace)[known] ** 2 / b.trace_trace[known]
    return max(1.0, float(within.mean()))
