"""What a hypothesis leaves of a group's channels, whitened, against which columns, forms and times are held.

The rows of `judgement/gaussian.py`: each cosine coefficient stands over the s.d. of its noise, and each prior is one
more row, of its mean. An orthonormal basis of all that the hypothesis can take up is projected off: what is left of the
data is orthogonal to it, and of a further series only what is orthogonal to it counts.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from control.diagnosis.judgement.evidence import Column
from control.diagnosis.judgement.gaussian import Gaussian
from control.diagnosis.judgement.noise import Noise, coefficients, series_of, strengths

from .channels import ChannelSeries

Array = npt.NDArray[np.float64]


class WhitenedResidual:
    """A hypothesis fitted and taken off under a given noise.

    banded : cosine coefficients of the residual where the hypothesis stands, by channel of the group. base : columns of
    all that it can take up. left : what it leaves (rows,): of each channel its coefficients, then `priors`, one each.
    """

    def __init__(self, channels: Sequence[ChannelSeries], banded: Mapping[str, Array], base: Sequence[Column],
                 noise: Mapping[str, Noise]) -> None:
        base = sorted(base, key=lambda column: column.sd < np.inf)      # what has no prior first
        self._free = sum(column.sd == np.inf for column in base)
        self._scale = {c.name: 1.0 / np.sqrt(strengths(noise[c.name], c.prior, c.cut, c.grid.step_s)) for c in channels}
        ends = np.cumsum([0, *(len(one) for one in self._scale.values())]).tolist()
        self._place = {name: slice(*ends[k:k + 2]) for k, name in enumerate(self._scale)}
        self.priors = slice(ends[-1], ends[-1] + len(base))
        right, stack = self._stacked(banded), np.array([self._stacked(column.coefficients) for column in base]).T
        stack = stack.reshape(len(right), len(base))
        stack[self.priors] = np.diag([1.0 / column.sd for column in base])
        right[self.priors] = [column.mean / column.sd for column in base]
        self._basis = np.linalg.qr(stack / np.maximum(np.linalg.norm(stack, axis=0), 1e-300))[0]
        self.left = right - self._basis @ (self._basis.T @ right)

    def _stacked(self, coefficients: Mapping[str, Array]) -> Array:
        """Coefficients by channel, whitened, in one column with the rows of the priors, which are 0: (rows,)."""
        found = np.zeros(self.priors.stop)
        for name, place in self._place.items():
            if name in coefficients:
                found[place] = coefficients[name] * self._scale[name]
        return found

    def split(self, column: Column) -> tuple[Array, Array]:
        """A further column, whitened: what the hypothesis cannot take up, and what it takes up of it by moving what has
        a prior, the rest following: (rows,) each."""
        whole = self._stacked(column.coefficients)
        taken = self._basis.T @ whole
        return whole - self._basis @ taken, self._basis[:, self._free:] @ taken[self._free:]

    def series(self, channel: ChannelSeries, rows: Array) -> Array:
        """Whitened rows of a channel as a series (copies x m,)."""
        return series_of(rows[self._place[channel.name]], channel.cut)

    def weighted(self, channel: ChannelSeries) -> Array:
        """What is left of a channel, times the inverse covariance of its noise: (copies, m)."""
        name = channel.name
        return series_of(self.left[self._place[name]] * self._scale[name], channel.cut).reshape(channel.copies, -1)

    def white(self, channel: ChannelSeries, series: Array) -> tuple[Array, Array]:
        """Series (k, m) of a channel whitened, and what the hypothesis takes up of them, in its basis."""
        white = coefficients(series, channel.cut) * self._scale[channel.name]
        return white, white @ self._basis[self._place[channel.name]]

    def beyond(self, channel: ChannelSeries, series: Array) -> Gaussian:
        """Series (k, m) of one channel once the hypothesis is fitted."""
        white, taken = self.white(channel, series)
        return Gaussian(white @ white.T - taken @ taken.T, white @ self.left[self._place[channel.name]])

    def kept_beyond(self, channel: ChannelSeries, kept: npt.NDArray[np.float32]) -> Gaussian:
        """The same of the slowest cosine coefficients (k, kept), in single precision: good enough to choose by."""
        count = kept.shape[1]
        place = slice(self._place[channel.name].start, self._place[channel.name].start + count)
        white = kept * self._scale[channel.name][:count].astype(np.float32)
        taken = white @ self._basis[place].astype(np.float32)
        a, s = white @ white.T - taken @ taken.T, white @ self.left[place].astype(np.float32)
        return Gaussian(a.astype(np.float64), s.astype(np.float64))
