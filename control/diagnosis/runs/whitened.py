"""What a hypothesis leaves of a group's channels, whitened, against which columns, forms and
times are held; and how much of what a column gains there is evidence, where the noise is more
uneven in time than its model says.

The rows of `judgement/gaussian.py`: each cosine coefficient stands over the s.d. of its noise,
and each prior is one more row, of its mean. An orthonormal basis of all that the hypothesis can
take up is projected off: what is left of the data is orthogonal to it, and of a further series
only what is orthogonal to it counts.

How even: the log is cut into blocks of time. The variance of a block's noise is the model's
times a factor of its own with an inverse-gamma prior about 1, integrated: all samples of a
block together follow a multivariate t with `BLOCK_DOF` degrees of freedom (scale mixtures:
West, Biometrika 74, 1987, 646). What is loud for a while counts as the noise that it is; what a
column takes away there, because it fits, counts in full.

Moves that the model follows badly make a column's scores unlike from block to block, more than
its information allows. The gain is divided by the ratio of block-robust to model variance of
its score (Kent, Biometrika 69, 1982, 19; Miller and Dunson, JASA 114, 2019, 1113: coarsening).

A column gains in two ways: over what the other columns cannot follow, and by what it spares
those that have a prior (a tolerance that need not be exceeded). Without it these would have to
move, or else the data be left as they are: the better of the two is what it is held against.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.judgement.evidence import Column
from topdress.control.diagnosis.judgement.gaussian import Array, Gaussian
from topdress.control.diagnosis.judgement.noise import (
    Noise,
    calc_coefficient_strengths,
    make_series_of,
)

from .channels import ChannelSeries
from .hypothesis import Hypothesis
from .search import Search

# of a block: longer than one event lasts (a restart, a turn, a hand on the machine) ...
BLOCK_S = 30.0
FEWEST, MOST = 8, 64  # ... of so many
# noise of one stretch is known to be what it is elsewhere to some 30 % of its s.d.
BLOCK_DOF = 5.0
# of a column, in a block: in one with less it does nothing
LEAST_ENERGY = 1e-9


class WhitenedResidual:
    """A hypothesis fitted and taken off under a given noise.

    banded : cosine coefficients of the residual where the hypothesis stands, by channel of the
    group. base : columns of all that it can take up. left : what it leaves (rows,): of each
    channel its coefficients, then `priors`, one each.
    """

    def __init__(
        self,
        channels: Sequence[ChannelSeries],
        banded: Mapping[str, Array],
        base: Sequence[Column],
        noise: Mapping[str, Noise],
    ) -> None:
        # what has no prior first
        base = sorted(base, key=lambda column: column.sd < np.inf)
        self._free = sum(column.sd == np.inf for column in base)
        self._scale = {
            c.name: 1.0
            / np.sqrt(calc_coefficient_strengths(noise[c.name], c.prior, c.cut, c.grid.step_s))
            for c in channels
        }
        ends = np.cumsum([0, *(len(one) for one in self._scale.values())]).tolist()
        self._place = {name: slice(*ends[k : k + 2]) for k, name in enumerate(self._scale)}
        self.priors = slice(ends[-1], ends[-1] + len(base))
        right, stack = (
            self._stacked(banded),
            np.array([self._stacked(column.coefficients) for column in base]).T,
        )
        stack = stack.reshape(len(right), len(base))
        stack[self.priors] = np.diag([1.0 / column.sd for column in base])
        right[self.priors] = [column.mean / column.sd for column in base]
        self._basis = np.linalg.qr(stack / np.maximum(np.linalg.norm(stack, axis=0), 1e-300))[0]
        self.left = right - self._basis @ (self._basis.T @ right)

    def _stacked(self, coefficients: Mapping[str, Array]) -> Array:
        """Coefficients by channel, whitened, in one column with the rows of the priors, which
        are 0: (rows,)."""
        found = np.zeros(self.priors.stop)
        for name, place in self._place.items():
            if name in coefficients:
                found[place] = coefficients[name] * self._scale[name]
        return found

    def split(self, column: Column) -> tuple[Array, Array]:
        """A further column, whitened: what the hypothesis cannot take up, and what it takes up
        of it by moving what has a prior, the rest following: (rows,) each."""
        whole = self._stacked(column.coefficients)
        taken = self._basis.T @ whole
        return whole - self._basis @ taken, self._basis[:, self._free :] @ taken[self._free :]

    def series(self, channel: ChannelSeries, rows: Array) -> Array:
        """Whitened rows of a channel as a series (copies x m,)."""
        return make_series_of(rows[self._place[channel.name]], channel.cut)

    def weighted(self, channel: ChannelSeries) -> Array:
        """What is left of a channel, times the inverse covariance of its noise: (copies, m)."""
        name = channel.name
        return make_series_of(
            self.left[self._place[name]] * self._scale[name], channel.cut
        ).reshape(channel.copies, -1)

    def white(
        self, channel: ChannelSeries, banded: npt.NDArray[Any]
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Cosine coefficients (k, m) of a channel, all or its slowest, whitened, and what the
        hypothesis takes up of them, in its basis; in their own precision: single is good enough
        to choose by."""
        begin, count = self._place[channel.name].start, banded.shape[1]
        white = banded * self._scale[channel.name][:count].astype(banded.dtype, copy=False)
        return white, white @ self._basis[begin : begin + count].astype(banded.dtype, copy=False)

    def beyond(self, channel: ChannelSeries, banded: npt.NDArray[Any]) -> Gaussian:
        """The same coefficients once the hypothesis is fitted."""
        white, taken = self.white(channel, banded)
        left = self.left[self._place[channel.name]][: banded.shape[1]].astype(
            banded.dtype, copy=False
        )
        a, s = white @ white.T - taken @ taken.T, white @ left
        return Gaussian(a.astype(np.float64), s.astype(np.float64))


def find_even_gain(
    search: Search,
    others: Hypothesis,
    noise: dict[str, Noise],
    trace: Column,
    more: Sequence[Column] = (),
) -> float:
    """What a trace gains in log-likelihood on top of a model, by its scores block by block.

    others : the model without it; more : columns of it along with those of its parts. What
    these take up of the trace is none of its evidence.
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
    moved, stands = size * float(off @ spared) - 0.5 * size**2 * float(spared @ spared), 0.0
    scores, energies = list[Array](), list[Array]()
    for channel in model.channels:
        r, t, h = (residual.series(channel, rows) for rows in (residual.left, own, held))
        lasts_s = channel.grid.step_s * len(r)
        blocks = int(np.clip(lasts_s / (channel.copies * BLOCK_S), FEWEST, MOST)) * channel.copies
        if channel.settled:  # no row knows of the one before
            blocks = len(r)
        edges = np.linspace(0, len(r), blocks + 1).astype(int)[:-1]
        left = r - size * t
        within, without, stood, score, energy, count = (
            np.add.reduceat(product, edges)
            for product in (left**2, r**2, (r + size * h) ** 2, t * left, t**2, np.ones(len(r)))
        )
        moved += _calc_student_gain(without, within, count)
        stands += _calc_student_gain(stood, within, count)
        scores.append(score)
        energies.append(energy)
    return min(moved, stands) / _calc_unevenness(np.concatenate(scores), np.concatenate(energies))


def _calc_student_gain(without: Array, within: Array, count: Array) -> float:
    """Gain from sums of squares without a trace to those with it, (b,): in each block a
    multivariate t."""
    return 0.5 * float(
        np.sum((BLOCK_DOF + count) * (np.log(BLOCK_DOF + without) - np.log(BLOCK_DOF + within)))
    )


def _calc_unevenness(score: Array, energy: Array) -> float:
    """Block-robust over model variance of a trace's score by block (b,), along with it, from
    its energy there (b,); 1 where the blocks agree better."""
    known = energy > LEAST_ENERGY * max(float(energy.sum()), 1e-300)
    return max(1.0, float(np.mean(score[known] ** 2 / energy[known]))) if known.any() else 1.0
