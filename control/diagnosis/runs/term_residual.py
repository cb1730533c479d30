"""What a hypothesis leaves of a group's channels, whitened, and what further series would take of it."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from control.diagnosis.judgement import noise as noises
from control.diagnosis.judgement.evidence import Column
from control.diagnosis.judgement.noise import Noise, coefficients

from .channels import ChannelSeries
from .columns import Columns
from .hypothesis import Hypothesis

Array = npt.NDArray[np.float64]

LEAST_ENERGY = 1e-6         # whitened: a series of less does nothing
LEAST_OWN = 1e-3            # whitened energy of a level that the hypothesis must leave to it


class WhitenedResidual:
    """A hypothesis and further columns, fitted and taken off under a given noise; priors are rows of their own."""

    def __init__(self, columns: Columns, parts: Hypothesis, base: Sequence[Column], noise: dict[str, Noise]) -> None:
        model, begin = columns.model, 0
        self._scale: dict[str, Array] = {}
        self._place: dict[str, slice] = {}
        for channel in model.channels:
            strength = noises.variances(noise[channel.name], channel.prior, channel.cut, channel.grid.step_s)
            self._scale[channel.name] = 1.0 / np.sqrt(np.repeat(strength, channel.cut.members.astype(np.int64)))
            self._place[channel.name] = slice(begin, begin + len(channel.cut.order))
            begin += len(channel.cut.order)
        stack, right = np.zeros((begin + len(base), len(base))), np.zeros(begin + len(base))
        for name, left in model.banded_residual(parts).items():
            right[self._place[name]] = left * self._scale[name]
        for k, column in enumerate(base):
            for name, values in column.coefficients.items():
                stack[self._place[name], k] = values * self._scale[name]
            stack[begin + k, k] = 1.0 / column.sd
            right[begin + k] = column.mean / column.sd
        stack /= np.maximum(np.linalg.norm(stack, axis=0), 1e-300)
        self._basis = np.linalg.qr(stack)[0]
        self._left = right - self._basis @ (self._basis.T @ right)

    def products(self, channel: ChannelSeries, series: Array) -> tuple[Array, Array]:
        """Normal equations of series (k, m) of one channel once the hypothesis is fitted: (k, k) and (k,)."""
        place = self._place[channel.name]
        white = coefficients(series, channel.cut) * self._scale[channel.name]
        shared = white @ self._basis[place]
        return white @ white.T - shared @ shared.T, white @ self._left[place]

    def kept_products(self, channel: ChannelSeries, kept: npt.NDArray[np.float32]) -> tuple[Array, Array]:
        """The same of the slowest cosine coefficients (k, kept), in single precision: good enough to choose by."""
        count = kept.shape[1]
        place = slice(self._place[channel.name].start, self._place[channel.name].start + count)
        white = kept * self._scale[channel.name][:count].astype(np.float32)
        shared = white @ self._basis[place].astype(np.float32)
        normal = white @ white.T - shared @ shared.T
        return normal.astype(np.float64), (white @ self._left[place].astype(np.float32)).astype(np.float64)


def without(normal: Array, right: Array, k: int) -> tuple[Array, Array]:
    """Normal equations once column k is fitted, where the hypothesis leaves anything of it."""
    if normal[k, k] <= LEAST_OWN:
        return normal, right
    row = normal[k] / normal[k, k]
    return normal - np.outer(row, normal[k]), right - row * right[k]


def gains_of_single(normal: Array, right: Array, mixes: Array) -> Array:
    """Gains of forms of one amplitude each: mixes (k, n) -> (n,)."""
    energy = np.einsum("kn,kn->n", mixes, normal @ mixes)
    return np.where(energy > LEAST_ENERGY, (right @ mixes) ** 2 / np.maximum(energy, LEAST_ENERGY), 0.0)


def gain_of(normal: Array, right: Array, mix: Array) -> tuple[float, Array]:
    """Gain in twice the log-likelihood of the best amplitudes of mixed columns, and those: mix (k, p) -> (p,)."""
    part = mix.T @ normal @ mix
    side = mix.T @ right
    scale = np.sqrt(np.maximum(np.diag(part), 1e-300))
    if np.any(np.diag(part) <= LEAST_ENERGY):
        return 0.0, np.zeros(len(side))
    stiff = part / scale[:, None] / scale + 1e-4 * np.eye(len(side))
    amplitude = np.linalg.solve(stiff, side / scale) / scale
    return float(amplitude @ side), amplitude
