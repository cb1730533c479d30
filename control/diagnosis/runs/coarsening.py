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

import numpy as np

from control.diagnosis.judgement.evidence import Column
from control.diagnosis.judgement.gaussian import Array
from control.diagnosis.judgement.noise import Noise

from .hypothesis import Hypothesis
from .search import Search
from .whitened import WhitenedResidual

BLOCK_S = 30.0              # of a block: longer than one event lasts (a restart, a turn, a hand on the machine) ...
FEWEST, MOST = 8, 64        # ... of so many
BLOCK_DOF = 5.0             # noise of one stretch is known to be what it is elsewhere to some 30 % of its s.d.
LEAST_ENERGY = 1e-9         # of a column, in a block: in one with less it does nothing


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
    if not own.any() and not held.any():
        return 0.0
    size = float(own @ residual.left) / float(own @ own)
    # Each prior is one more reading, of its mean, with its s.d. as noise.
    off, spared = residual.left[residual.priors], own[residual.priors]
    moved, stands = size * float(off @ spared) - 0.5 * size ** 2 * float(spared @ spared), 0.0
    scores, energies = list[Array](), list[Array]()
    for channel in model.channels:
        r, t, h = (residual.series(channel, rows) for rows in (residual.left, own, held))
        lasts_s = channel.grid.step_s * len(r)
        blocks = int(np.clip(lasts_s / (channel.copies * BLOCK_S), FEWEST, MOST)) * channel.copies
        if channel.settled:         # no row knows of the one before
            blocks = len(r)
        edges = np.linspace(0, len(r), blocks + 1).astype(int)[:-1]
        left = r - size * t
        within, without, stood, score, energy, count = (np.add.reduceat(product, edges) for product in (
            left ** 2, r ** 2, (r + size * h) ** 2, t * left, t ** 2, np.ones(len(r))))
        moved += _student(without, within, count)
        stands += _student(stood, within, count)
        scores.append(score)
        energies.append(energy)
    return min(moved, stands) / _unevenness(np.concatenate(scores), np.concatenate(energies))


def _student(without: Array, within: Array, count: Array) -> float:
    """Gain from sums of squares without a trace to those with it, (b,): in each block a multivariate t."""
    return 0.5 * float(np.sum((BLOCK_DOF + count) * (np.log(BLOCK_DOF + without) - np.log(BLOCK_DOF + within))))


def _unevenness(score: Array, energy: Array) -> float:
    """Block-robust over model variance of a trace's score by block (b,), along with it, from its energy there (b,); 1
    where the blocks agree better."""
    known = energy > LEAST_ENERGY * max(float(energy.sum()), 1e-300)
    return max(1.0, float(np.mean(score[known] ** 2 / energy[known]))) if known.any() else 1.0
