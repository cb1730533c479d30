"""Compresses data and columns of coupled channels to band products, and calculates the likelihood
of any set of columns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any, NamedTuple, Protocol

import numpy as np

from . import noise as noises
from .gaussian import Array, ColumnProducts, Indices, SizePosterior
from .noise import Noise
from .noise_fit import MIN_TIME_RATIO

# Half of a 90 % interval in standard deviations.
TWO_SIDED_90_QUANTILE = 1.645
# Maximum number of rounds of a fit of amplitudes and noise.
MAX_ROUNDS = 15
# Divisor of the usual drift for a calm noise, from which fits start.
CALM_DIVISOR = 5.0
# Start values of the fast component's correlation time, s.
START_TIMES_S = (0.2, 1.0)
# Minimum gain of the log-likelihood for a further round.
MIN_ROUND_GAIN = 0.05


class MeasuredChannel(Protocol):
    """Interface of a measured series."""

    @property
    def name(self) -> str: ...
    @property
    def cut(self) -> noises.Segments: ...
    @property
    def prior(self) -> noises.NoisePrior: ...
    @property
    def grid(self) -> Any: ...


class ColumnRole(Enum):
    """Role of a column in a regression problem."""

    # A nominal value of the machine file, uncertain within its tolerance.
    TOLERANCE = "tolerance"
    # The same value, varying between operating conditions.
    TRAIT = "trait"
    # Uncertainty of a reading: level, refills, rounding, time stamps, heads.
    READING = "reading"
    # Slope of the prediction in an effect's size.
    SLOPE = "slope"
    # Smooth function of a variable, or of an effect's form.
    FORM = "form"
    # One unit of a candidate effect.
    CANDIDATE = "candidate"
    # The total contribution of an effect.
    TRACE = "trace"


class ColumnLabel(NamedTuple):
    """Identity of a column. name : key of the nominal value, or id of the effect. part : index of
    the effect, or -1."""

    role: ColumnRole
    name: str = ""
    part: int = -1


class Column(NamedTuple):
    """Change of the channels for one unit of an amplitude: cosine coefficients by channel (an
    absent channel does not change)."""

    label: ColumnLabel
    coefficients: Mapping[str, Array]
    # Prior standard deviation of the amplitude; inf means free.
    sd: float
    # Prior mean of the amplitude.
    mean: float = 0.0


class BandProducts(NamedTuple):
    """Band products of one channel; row and column 0 are the data."""

    channel: MeasuredChannel
    # Sums of products, (bands, 1 + p, 1 + p).
    gram: Array
    # Indices in the problem's list of columns, (p,).
    columns: Indices

    @property
    def noise_inputs(self) -> tuple[noises.NoisePrior, noises.Segments, float]:
        """Return the prior of the channel's noise, the channel's segments, and its time step, s."""
        return self.channel.prior, self.channel.cut, self.channel.grid.step_s

    def calc_residual_power(self, chosen: Indices, amplitude: Array) -> Array:
        """Return the residual power by band."""
        full = np.zeros(max(self.columns.max(initial=-1), chosen.max(initial=-1)) + 1)
        full[chosen] = amplitude
        vector = np.concatenate(([1.0], -full[self.columns]))
        return np.maximum(1e-300, (self.gram @ vector) @ vector)


class Problem(NamedTuple):
    """Inputs of a likelihood: columns by their labels, their priors, and their products with the
    data."""

    labels: tuple[ColumnLabel, ...]
    # Prior standard deviations, (q,).
    sd: Array
    # Prior means, (q,).
    mean: Array
    products: tuple[BandProducts, ...]
    # Log weight of the priors, where their standard deviations come from heavy tails
    # (`prior.find_size_log_weight`).
    log_weight: float = 0.0

    def find_indices(self, role: ColumnRole) -> list[int]:
        """Return the indices of the columns of one role."""
        return [k for k, label in enumerate(self.labels) if label.role is role]

    def weigh_columns(self, noise: Mapping[str, Noise]) -> ColumnProducts:
        """Return the products of all columns under a given noise, without their priors."""
        size = len(self.labels)
        a, s = np.zeros((size, size)), np.zeros(size)
        for one in self.products:
            total = np.tensordot(
                1.0 / noises.calc_band_variances(noise[one.channel.name], *one.noise_inputs),
                one.gram,
                axes=1,
            )
            a[np.ix_(one.columns, one.columns)] += total[1:, 1:]
            s[one.columns] += total[1:, 0]
        return ColumnProducts(a, s)

    def fit_sizes(self, chosen: Indices, noise: Mapping[str, Noise]) -> SizePosterior:
        """Return the posterior sizes of the chosen columns under a given noise."""
        return (
            self.weigh_columns(noise).select_columns(chosen).fit(self.sd[chosen], self.mean[chosen])
        )


class Fit(NamedTuple):
    """Most probable amplitudes and noise of a set of columns."""

    # Amplitudes of the chosen columns, (k,).
    amplitude: Array
    # Covariance of the amplitudes, (k, k).
    covariance: Array
    # Log-likelihood with fitted noise, priors included.
    log_likelihood: float
    # Log evidence: amplitudes with a prior are integrated (Laplace).
    log_evidence: float
    noise: dict[str, Noise]


def make_evidence_problem(
    channels: Sequence[MeasuredChannel], data: Mapping[str, Array], columns: Sequence[Column]
) -> Problem:
    """Compress channels and columns to a regression problem.

    `data`: cosine coefficients of the residual by channel.
    """
    products = []
    for channel in channels:
        here = [k for k, column in enumerate(columns) if channel.name in column.coefficients]
        stack = np.stack(
            [data[channel.name], *(columns[k].coefficients[channel.name] for k in here)]
        )
        products.append(
            BandProducts(
                channel,
                noises.calc_band_products(stack, stack, channel.cut),
                np.array(here, np.int64),
            )
        )
    return Problem(
        tuple(c.label for c in columns),
        np.array([c.sd for c in columns]),
        np.array([c.mean for c in columns]),
        tuple(products),
    )


def fit_amplitudes_and_noise(
    p: Problem, chosen: Indices, noise: Mapping[str, Noise], rounds: int = MAX_ROUNDS
) -> Fit:
    """Return the most probable amplitudes and noise, fitted alternately until the gain is
    negligible, at most `rounds` times.

    A drift and a constant are nearly interchangeable, so the convergence is slow.
    """
    now = dict(noise)
    sizes, before = p.fit_sizes(chosen, now), -np.inf
    for _ in range(rounds):
        for one in p.products:
            name = one.channel.name
            now[name] = noises.fit_noise(
                one.calc_residual_power(chosen, sizes.b), now[name], *one.noise_inputs
            )
        sizes = p.fit_sizes(chosen, now)
        value = _calc_log_posterior(p, chosen, sizes.b, now)
        if value - before < MIN_ROUND_GAIN:
            break
        before = value
    value = _calc_log_posterior(p, chosen, sizes.b, now)
    return Fit(sizes.b, sizes.cov, value, value + float(sizes.log_occam), now)


def choose_better_fit(
    p: Problem, chosen: Indices, noise: Mapping[str, Noise], channels: Sequence[MeasuredChannel]
) -> Fit:
    """Return the better of two fits: from the given noise and from its calm version.

    The noise of one hypothesis may be far from the best start for another.
    """
    return max(
        (
            fit_amplitudes_and_noise(p, chosen, start)
            for start in (noise, limit_slow_noise(noise, channels))
        ),
        key=lambda fit: fit.log_evidence,
    )


def fit_first_noise(
    p: Problem, chosen: Indices, noise: Mapping[str, Noise], channels: Sequence[MeasuredChannel]
) -> dict[str, Noise]:
    """Return the noise from which models of a group are fitted: the best of fits from a short and a
    longer correlation time, because the likelihood has a mode at either."""
    starts = [
        dict(noise),
        *(
            {
                c.name: Noise(
                    (noise[c.name].theta[0], float(np.log(quick_s)), *noise[c.name].theta[2:])
                )
                for c in channels
            }
            for quick_s in START_TIMES_S
        ),
    ]
    return max(
        (fit_amplitudes_and_noise(p, chosen, one) for one in starts),
        key=lambda fit: fit.log_evidence,
    ).noise


def adapt_noise(
    p: Problem, chosen: Indices, amplitude: Array, noise: Mapping[str, Noise]
) -> dict[str, Noise]:
    """Return the noise with a factor for each band, by the residual of the chosen columns."""
    return {
        one.channel.name: noises.scale_bands(
            one.calc_residual_power(chosen, amplitude), noise[one.channel.name], *one.noise_inputs
        )
        for one in p.products
    }


def limit_slow_noise(
    noise: Mapping[str, Noise], channels: Sequence[MeasuredChannel]
) -> dict[str, Noise]:
    """Return the noise with its slow component limited to the machine file's: a start for fits that
    must separate a steady effect from a drift."""
    found = {}
    for channel in channels:
        here, usual = noise[channel.name].theta, noises.find_starting_noise(channel.prior).theta
        fast = (
            here[:2]
            if here[1] < here[3] and here[1] < usual[3] - np.log(MIN_TIME_RATIO)
            else usual[:2]
        )
        found[channel.name] = Noise(
            (*fast, min(here[2], usual[2] - float(np.log(CALM_DIVISOR))), usual[3])
        )
    return found


def subtract_columns(
    banded: Mapping[str, Array], columns: Sequence[Column], amplitude: Array
) -> dict[str, Array]:
    """Return banded coefficients minus the columns times their amplitudes, (m,) by channel."""
    left = {name: values.copy() for name, values in banded.items()}
    for size, column in zip(amplitude, columns, strict=True):
        for name in left.keys() & column.coefficients.keys():
            left[name] -= size * column.coefficients[name]
    return left


def find_residual_power(p: Problem, channel: str, chosen: Indices, amplitude: Array) -> float:
    """Return the residual sum of squares of one channel after the chosen columns."""
    return next(
        float(np.sum(one.calc_residual_power(chosen, amplitude)))
        for one in p.products
        if one.channel.name == channel
    )


def _calc_log_posterior(
    p: Problem, chosen: Indices, amplitude: Array, noise: Mapping[str, Noise]
) -> float:
    of_sizes = p.log_weight - 0.5 * float(
        np.sum(((amplitude - p.mean[chosen]) / p.sd[chosen]) ** 2)
    )
    return of_sizes + sum(
        noises.calc_log_likelihood(
            one.calc_residual_power(chosen, amplitude), noise[one.channel.name], *one.noise_inputs
        )
        for one in p.products
    )


def project_out_fixed(p: Problem, fixed: Indices, noise: Mapping[str, Noise]) -> ColumnProducts:
    """Return the products of all columns after the fit of the `fixed` columns."""
    every = p.weigh_columns(noise)
    return every.project_out(
        every.A[:, fixed], every.select_columns(fixed).fit(p.sd[fixed], p.mean[fixed])
    )
