"""Calculates the whitened residual of a hypothesis, the gain of columns, forms and times on it, and
the evidence in that gain where the noise varies over time more than its model.

The rows are those of `judgement/gaussian.py`: each cosine coefficient is divided by the s.d. of its
noise, and each prior is one more row, of its mean. An orthonormal basis of everything that the
hypothesis can absorb is projected out: the residual is orthogonal to the basis, and only the
orthogonal component of a further series counts.

The log is divided into blocks of time. The variance of a block's noise is the model's times its own
factor with an inverse-gamma prior around 1, integrated: all samples of a block together follow a
multivariate t with `BLOCK_DOF` degrees of freedom (scale mixtures: West, Biometrika 74, 1987, 646).
A temporarily loud block counts as noise; a column that fits such a block still counts in full.

Moves that the model predicts badly make a column's scores differ between blocks more than its
information allows. The gain is divided by the ratio of block-robust to model variance of its score,
each summed over the blocks (Kent, Biometrika 69, 1982, 19; Miller and Dunson, JASA 114, 2019, 1113:
coarsening).

A column gains in two ways: by the component that the other columns cannot follow, and by the cost
that it saves columns with a prior (a tolerance that need not be exceeded). Without the column,
these would have to move, or the data would stay unexplained. The column is compared with the better
of the two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.judgement.evidence import Column
from topdress.control.diagnosis.judgement.gaussian import Array, ColumnProducts
from topdress.control.diagnosis.judgement.noise import (
    Noise,
    calc_coefficient_variances,
    make_series,
)

from .channels import ChannelSeries
from .hypothesis import Hypothesis
from .search import Search

# Length of a block, s: longer than a single event (a restart, a turn, a hand on the machine).
BLOCK_S = 30.0
# Minimum and maximum number of blocks.
MIN_BLOCKS, MAX_BLOCKS = 8, 64
# Degrees of freedom of a block's noise: its s.d. agrees with that of other blocks to some 30 %.
BLOCK_DOF = 5.0


class WhitenedResidual:
    """Residual of a fitted hypothesis under a given noise, whitened.

    banded : cosine coefficients of the residual at the hypothesis, by channel of the group. base :
    columns of everything that the hypothesis can absorb. left : the residual (rows,): the
    coefficients of each channel, then `priors`, one row each.
    """

    def __init__(
        self,
        channels: Sequence[ChannelSeries],
        banded: Mapping[str, Array],
        base: Sequence[Column],
        noise: Mapping[str, Noise],
    ) -> None:
        # Columns without a prior come first.
        base = sorted(base, key=lambda column: column.sd < np.inf)
        self._free = sum(column.sd == np.inf for column in base)
        self._scale = {
            c.name: 1.0
            / np.sqrt(calc_coefficient_variances(noise[c.name], c.prior, c.cut, c.grid.step_s))
            for c in channels
        }
        ends = np.cumsum([0, *(len(one) for one in self._scale.values())]).tolist()
        self._place = {name: slice(*ends[k : k + 2]) for k, name in enumerate(self._scale)}
        self.priors = slice(ends[-1], ends[-1] + len(base))
        right, stack = (
            self._stack_channels(banded),
            np.array([self._stack_channels(column.coefficients) for column in base]).T,
        )
        stack = stack.reshape(len(right), len(base))
        stack[self.priors] = np.diag([1.0 / column.sd for column in base])
        right[self.priors] = [column.mean / column.sd for column in base]
        self._basis = np.linalg.qr(stack / np.maximum(np.linalg.norm(stack, axis=0), 1e-300))[0]
        self.left = right - self._basis @ (self._basis.T @ right)

    def _stack_channels(self, coefficients: Mapping[str, Array]) -> Array:
        """Return coefficients by channel, whitened, in one column with the rows of the priors,
        which are 0: (rows,)."""
        found = np.zeros(self.priors.stop)
        for name, place in self._place.items():
            if name in coefficients:
                found[place] = coefficients[name] * self._scale[name]
        return found

    def split_column(self, column: Column) -> tuple[Array, Array]:
        """Split a whitened column into the component that the hypothesis cannot absorb, and the
        component absorbed by columns with a prior, with the rest refitted: (rows,) each."""
        whole = self._stack_channels(column.coefficients)
        taken = self._basis.T @ whole
        return whole - self._basis @ taken, self._basis[:, self._free :] @ taken[self._free :]

    def make_series(self, channel: ChannelSeries, rows: Array) -> Array:
        """Return the whitened rows of a channel as a series (copies x m,)."""
        return make_series(rows[self._place[channel.name]], channel.cut._replace(weights=None))

    def weigh_residual(self, channel: ChannelSeries) -> Array:
        """Return the residual of a channel times the inverse covariance of its noise: (copies,
        m)."""
        scaled = self.left[self._place[channel.name]] * self._scale[channel.name]
        series = make_series(scaled, channel.cut._replace(weights=None))
        weights = channel.cut.weights
        return (series if weights is None else series * weights).reshape(channel.copies, -1)

    def whiten(
        self, channel: ChannelSeries, banded: npt.NDArray[Any]
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Return whitened cosine coefficients (k, m) of a channel, all or the slowest, and their
        components in the basis of the hypothesis.

        The precision of the input is kept, because single precision suffices for a selection.
        """
        begin, count = self._place[channel.name].start, banded.shape[1]
        white = banded * self._scale[channel.name][:count].astype(banded.dtype, copy=False)
        return white, white @ self._basis[begin : begin + count].astype(banded.dtype, copy=False)

    def project_out_base(self, channel: ChannelSeries, banded: npt.NDArray[Any]) -> ColumnProducts:
        """Return the products of the same coefficients after the fit of the hypothesis."""
        white, taken = self.whiten(channel, banded)
        left = self.left[self._place[channel.name]][: banded.shape[1]].astype(
            banded.dtype, copy=False
        )
        a, s = white @ white.T - taken @ taken.T, white @ left
        return ColumnProducts(a.astype(np.float64), s.astype(np.float64))


def calc_block_gain(
    search: Search,
    others: Hypothesis,
    noise: dict[str, Noise],
    trace: Column,
    more: Sequence[Column] = (),
) -> float:
    """Return the gain of a trace in log-likelihood on top of a model, by its scores in blocks.

    others : the model without the trace; more : columns of the trace besides those of its effects.
    The component that these absorb is no evidence for the trace.
    """
    model = search.model
    base = [*search.columns.list_columns(others), *more]
    residual = WhitenedResidual(model.channels, model.calc_banded_residual(others), base, noise)
    own, held = residual.split_column(trace)
    if not own.any() and not held.any():
        return 0.0
    size = float(own @ residual.left) / float(own @ own)
    # Each prior is one more reading, of its mean, with its s.d. as noise.
    off, spared = residual.left[residual.priors], own[residual.priors]
    of_priors = size * float(off @ spared) - 0.5 * size**2 * float(spared @ spared)
    moved, stands = list[Array](), list[Array]()
    scores, energies = list[Array](), list[Array]()
    for channel in model.channels:
        r, t, h = (residual.make_series(channel, rows) for rows in (residual.left, own, held))
        lasts_s = channel.grid.step_s * len(r)
        blocks = (
            int(np.clip(lasts_s / (channel.copies * BLOCK_S), MIN_BLOCKS, MAX_BLOCKS))
            * channel.copies
        )
        # Settled rows are independent of the rows before.
        if channel.settled:
            blocks = len(r)
        edges = np.linspace(0, len(r), blocks + 1).astype(int)[:-1]
        left = r - size * t
        within, without, stood, score, energy, count = (
            np.add.reduceat(product, edges)
            for product in (left**2, r**2, (r + size * h) ** 2, t * left, t**2, np.ones(len(r)))
        )
        moved.append(_calc_student_gains(without, within, count))
        stands.append(_calc_student_gains(stood, within, count))
        scores.append(score)
        energies.append(energy)
    gain = min(
        of_priors + _sum_gains(np.concatenate(moved)),
        _sum_gains(np.concatenate(stands)),
    )
    return gain / _calc_variance_ratio(np.concatenate(scores), np.concatenate(energies))


def _calc_student_gains(without: Array, within: Array, count: Array) -> Array:
    """Return the gain of each block (b,) from its sums of squares without and with a trace (b,): a
    multivariate t in each block."""
    return np.asarray(
        0.5 * (BLOCK_DOF + count) * (np.log(BLOCK_DOF + without) - np.log(BLOCK_DOF + within))
    )


def _sum_gains(gains: Array) -> float:
    """Return the sum of the gains of blocks (b,)."""
    return float(gains.sum())


def _calc_variance_ratio(score: Array, energy: Array) -> float:
    """Return the ratio of block-robust to model variance of a trace's score, from its score and
    energy in each block (b,); 1 where the blocks agree better."""
    return max(1.0, float(np.sum(score**2)) / max(float(np.sum(energy)), 1e-300))
