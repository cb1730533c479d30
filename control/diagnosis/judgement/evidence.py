"""Data and columns of coupled channels compressed to band products; likelihood of any choice of
columns from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any, NamedTuple, Protocol

import numpy as np

from . import noise as noises
from .gaussian import Array, Gaussian, Indices, Sizes
from .noise import Noise
from .noise_fit import SLOWER

Z90 = 1.645  # half an interval of 90 % in s.d.
MAX_ROUNDS = 15
# times less than usual: the drift of a calm noise, where fits start
CALM = 5.0
# of a fast part that is not white, where fits start
QUICK_S = (0.2, 1.0)
# of the log-likelihood: less is no gain of a further round
SETTLED = 0.05


class MeasuredChannel(Protocol):
    """What is asked of one measured series."""

    @property
    def name(self) -> str: ...
    @property
    def cut(self) -> noises.Segments: ...
    @property
    def prior(self) -> noises.NoisePrior: ...
    @property
    def grid(self) -> Any: ...


class Role(Enum):
    """What a column is in a problem."""

    # a nominal value of the machine file, open within its tolerance
    TOLERANCE = "tolerance"
    TRAIT = "trait"  # the same value, unlike from case to case
    # what a reading leaves open: level, refills, rounding, time stamps, heads
    READING = "reading"
    SLOPE = "slope"  # of the prediction in a part's size
    FORM = "form"  # smooth shape of a variable, or of a part's form
    CANDIDATE = "candidate"  # one unit of an effect that is tried
    TRACE = "trace"  # the whole of what a part does


class Label(NamedTuple):
    """What a column stands for. name : the nominal value's key, or the effect's id. part : its
    place, or -1."""

    role: Role
    name: str = ""
    part: int = -1


class Column(NamedTuple):
    """What one unit of something does to the channels: cosine coefficients by channel (absent:
    nothing)."""

    label: Label
    coefficients: Mapping[str, Array]
    sd: float  # prior s.d. of its amplitude; inf: free
    mean: float = 0.0  # prior mean of its amplitude


class Products(NamedTuple):
    """Band products of one channel; row and column 0 are the data."""

    channel: MeasuredChannel
    gram: Array  # (bands, 1 + p, 1 + p)
    columns: Indices  # their places in the problem's list (p,)

    @property
    def known(self) -> tuple[noises.NoisePrior, noises.Segments, float]:
        """What is known of the channel's noise beforehand, and how it is cut."""
        return self.channel.prior, self.channel.cut, self.channel.grid.step_s

    def calc_residual_power(self, chosen: Indices, amplitude: Array) -> Array:
        """Residual power by band."""
        full = np.zeros(max(self.columns.max(initial=-1), chosen.max(initial=-1)) + 1)
        full[chosen] = amplitude
        vector = np.concatenate(([1.0], -full[self.columns]))
        return np.maximum(1e-300, (self.gram @ vector) @ vector)


class Problem(NamedTuple):
    """Everything that a likelihood needs: columns by their labels, their priors, and their
    products with the data."""

    labels: tuple[Label, ...]
    sd: Array  # (q,)
    mean: Array  # (q,)
    products: tuple[Products, ...]
    # of the priors, where their s.d. are those of heavy tails (`prior.find_size_log_weight`)
    log_weight: float = 0.0

    def places(self, role: Role) -> list[int]:
        """Places of the columns of one role."""
        return [k for k, label in enumerate(self.labels) if label.role is role]

    def weigh_columns(self, noise: Mapping[str, Noise]) -> Gaussian:
        """All columns under a given noise, their priors left out."""
        size = len(self.labels)
        a, s = np.zeros((size, size)), np.zeros(size)
        for one in self.products:
            total = np.tensordot(
                1.0 / noises.calc_band_variances(noise[one.channel.name], *one.known),
                one.gram,
                axes=1,
            )
            a[np.ix_(one.columns, one.columns)] += total[1:, 1:]
            s[one.columns] += total[1:, 0]
        return Gaussian(a, s)

    def sizes(self, chosen: Indices, noise: Mapping[str, Noise]) -> Sizes:
        """Of the chosen columns, under a given noise."""
        return self.weigh_columns(noise).of(chosen).fit(self.sd[chosen], self.mean[chosen])


class Fit(NamedTuple):
    amplitude: Array  # of the chosen columns (k,)
    covariance: Array  # (k, k)
    log_likelihood: float  # noise fitted, priors included
    # the same with the amplitudes integrated (Laplace), but for those without a prior
    log_evidence: float
    noise: dict[str, Noise]


def make_evidence_problem(
    channels: Sequence[MeasuredChannel], data: Mapping[str, Array], columns: Sequence[Column]
) -> Problem:
    """`data`: cosine coefficients of the residual by channel."""
    products = []
    for channel in channels:
        here = [k for k, column in enumerate(columns) if channel.name in column.coefficients]
        stack = np.stack(
            [data[channel.name], *(columns[k].coefficients[channel.name] for k in here)]
        )
        products.append(
            Products(
                channel, noises.band_products(stack, stack, channel.cut), np.array(here, np.int64)
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
    """Most probable amplitudes and noise together: each in turn until nothing is gained, at
    most `rounds` times.

    A drift and a constant can stand for each other, so that the way from one to the other is
    slow.
    """
    now = dict(noise)
    sizes, before = p.sizes(chosen, now), -np.inf
    for _ in range(rounds):
        for one in p.products:
            name = one.channel.name
            now[name] = noises.fit_noise(
                one.calc_residual_power(chosen, sizes.b), now[name], *one.known
            )
        sizes = p.sizes(chosen, now)
        value = _calc_log_posterior(p, chosen, sizes.b, now)
        if value - before < SETTLED:
            break
        before = value
    value = _calc_log_posterior(p, chosen, sizes.b, now)
    return Fit(sizes.b, sizes.cov, value, value + float(sizes.log_occam), now)


def choose_better_fit(
    p: Problem, chosen: Indices, noise: Mapping[str, Noise], channels: Sequence[MeasuredChannel]
) -> Fit:
    """The better of two fits: from the noise given and from its calm version.

    What one hypothesis left of the noise may be far from where another must start.
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
    """The noise from which models of a group are fitted: the best of fits from a quick and from
    a slower fast part, for the likelihood has a mode at either."""
    starts = [
        dict(noise),
        *(
            {
                c.name: Noise(
                    (noise[c.name].theta[0], float(np.log(quick_s)), *noise[c.name].theta[2:])
                )
                for c in channels
            }
            for quick_s in QUICK_S
        ),
    ]
    return max(
        (fit_amplitudes_and_noise(p, chosen, one) for one in starts),
        key=lambda fit: fit.log_evidence,
    ).noise


def adapt_noise(
    p: Problem, chosen: Indices, amplitude: Array, noise: Mapping[str, Noise]
) -> dict[str, Noise]:
    """A noise with each band's own factor as the residual of chosen columns says."""
    return {
        one.channel.name: noises.scale_bands(
            one.calc_residual_power(chosen, amplitude), noise[one.channel.name], *one.known
        )
        for one in p.products
    }


def limit_slow_noise(
    noise: Mapping[str, Noise], channels: Sequence[MeasuredChannel]
) -> dict[str, Noise]:
    """A noise whose slow part is no stronger than the machine file's: where a fit must start
    that is to tell a steady effect from a drift."""
    found = {}
    for channel in channels:
        here, usual = noise[channel.name].theta, noises.find_starting_noise(channel.prior).theta
        fast = here[:2] if here[1] < here[3] and here[1] < usual[3] - np.log(SLOWER) else usual[:2]
        found[channel.name] = Noise((*fast, min(here[2], usual[2] - float(np.log(CALM))), usual[3]))
    return found


def subtract_columns(
    banded: Mapping[str, Array], columns: Sequence[Column], amplitude: Array
) -> dict[str, Array]:
    """What columns with their amplitudes leave of banded coefficients, (m,) by channel."""
    left = {name: values.copy() for name, values in banded.items()}
    for size, column in zip(amplitude, columns, strict=True):
        for name in left.keys() & column.coefficients.keys():
            left[name] -= size * column.coefficients[name]
    return left


def find_residual_power(p: Problem, channel: str, chosen: Indices, amplitude: Array) -> float:
    """Sum of squares that the chosen columns with their amplitudes leave of one channel."""
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
        noises.log_likelihood(
            one.calc_residual_power(chosen, amplitude), noise[one.channel.name], *one.known
        )
        for one in p.products
    )


def project_out_fixed(p: Problem, fixed: Indices, noise: Mapping[str, Noise]) -> Gaussian:
    """All columns once the `fixed` ones are fitted."""
    every = p.weigh_columns(noise)
    return every.beyond(every.A[:, fixed], every.of(fixed).fit(p.sd[fixed], p.mean[fixed]))
