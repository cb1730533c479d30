"""The noise of a channel: a fast and a slow first-order component over a white floor, fitted to
band powers.

A channel's series are taken to the cosine domain (DCT-II, which needs no wrap-around at the
ends); there the noise of neighbouring coefficients is independent, and over a narrow band of
equal strength. Sums of products per band are all that any hypothesis needs, so refitting the
noise under each of them costs microseconds (Whittle's likelihood).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.fft import dct, idct, prev_fast_len

from .noise_fit import BAND_DOF, find_likelihood, find_spectrum, fit_spectrum

Array = npt.NDArray[np.float64]

# longer series are cut: memory of noise is far shorter
SEGMENT = 32768
# samples: a shorter segment is transformed in no time whatever its length
LONG = 4096
BAND_RATIO = 1.25


class Segments(NamedTuple):
    """How a channel's series is cut and its coefficients banded."""

    length: int  # of the series
    bounds: tuple[tuple[int, int], ...]
    order: npt.NDArray[np.int64]  # coefficients sorted by band
    starts: npt.NDArray[np.int64]  # first of each band in that order
    members: Array  # coefficients per band
    omega: Array  # mean angular frequency per band, rad per sample


def make_segments(length: int, bounds: tuple[tuple[int, int], ...] | None = None) -> Segments:
    """Bands for a series of `length`, cut in equal segments or at given `bounds` (what lies
    outside is not used).

    A long segment ends a per cent or so earlier, where its length has small factors: a
    transform of a length with a large one takes ten times as long.
    """
    if bounds is None:
        pieces = max(1, round(length / SEGMENT))
        edges = np.linspace(0, length, pieces + 1).astype(int)
        bounds = tuple(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    bounds = tuple(
        (begin, end if end - begin < LONG else begin + prev_fast_len(end - begin))
        for begin, end in bounds
    )
    longest = max(end - begin for begin, end in bounds)
    omega = np.concatenate(
        [np.pi * np.arange(end - begin) / (end - begin) for begin, end in bounds]
    )
    index = omega * longest / np.pi
    high = 1 + np.floor(np.log(np.maximum(index, 1.0)) / np.log(BAND_RATIO) + 1e-9)
    band = np.where(index < 0.5, 0, high).astype(int)
    order = np.argsort(band, kind="stable")
    _, starts, count = np.unique(band[order], return_index=True, return_counts=True)
    mean = np.add.reduceat(omega[order], starts) / count
    return Segments(length, bounds, order, starts, count.astype(np.float64), mean)


def merge_bands(cut: Segments) -> Segments:
    """The same with one strength at every frequency: of a noise that is known to be white."""
    return cut._replace(
        starts=np.zeros(1, np.int64),
        members=np.array([float(cut.members.sum())]),
        omega=np.array([0.5 * np.pi]),
    )


def leave_out_bands(cut: Segments, bands: npt.NDArray[np.bool_]) -> Segments:
    """The same without some of its bands, (bands,): no coefficient of theirs is looked at."""
    kept = ~np.repeat(bands, cut.members.astype(np.int64))
    members = cut.members[~bands]
    starts = np.concatenate(([0], np.cumsum(members[:-1]))).astype(np.int64)
    return Segments(cut.length, cut.bounds, cut.order[kept], starts, members, cut.omega[~bands])


def coefficients(series: Array, cut: Segments) -> Array:
    """Cosine coefficients of series (n,) or (p, n), sorted by band: (m,) or (p, m)."""
    parts = [dct(series[..., begin:end], norm="ortho", axis=-1) for begin, end in cut.bounds]
    if len(parts) == 1 and len(cut.order) == parts[0].shape[-1]:
        # one segment: its coefficients come in the order of their bands
        return np.asarray(parts[0])
    return np.take(np.concatenate(parts, axis=-1), cut.order, axis=-1)


def make_series_of(banded: Array, cut: Segments) -> Array:
    """The series (n,) of cosine coefficients sorted by band (m,); zero outside the segments."""
    plain = np.zeros(sum(end - begin for begin, end in cut.bounds))
    plain[cut.order] = banded
    out = np.zeros(cut.length)
    begin_at = 0
    for begin, end in cut.bounds:
        out[begin:end] = idct(plain[begin_at : begin_at + end - begin], norm="ortho")
        begin_at += end - begin
    return out


def band_products(x: Array, y: Array, cut: Segments) -> Array:
    """Sums of products per band of coefficient rows x (p, m) and y (q, m): (bands, p, q)."""
    ends = np.append(cut.starts[1:], x.shape[-1])
    out = np.empty((len(cut.starts), x.shape[0], y.shape[0]))
    for band, (begin, end) in enumerate(zip(cut.starts, ends, strict=True)):
        out[band] = x[:, begin:end] @ y[:, begin:end].T
    return out


class NoisePrior(NamedTuple):
    """Where the fit starts, from the machine file, and how far it may go (natural logarithms, 1
    s.d.)."""

    fast_sd: float
    fast_s: float
    floor_sd: float
    slow_share: float = 0.2  # of the fast component
    # drift that remembers for longer looks like a constant in an hour
    slow_s: float = 120.0
    spread: tuple[float, float, float, float] = (0.7, 1.0, 0.7, 1.0)
    # of each sample's step of a random walk: what adds up unseen (between rows)
    walk_sd: float = 0.0


class Noise(NamedTuple):
    """log s.d. and log correlation time (s) of the fast and the slow component.

    louder : variance of each band over the spectrum's, as the residual that it was fitted to
    says (bands,); empty: 1.
    """

    theta: tuple[float, float, float, float]
    louder: tuple[float, ...] = ()

    @property
    def fast_sd(self) -> float:
        return float(np.exp(self.theta[0]))

    @property
    def slow_sd(self) -> float:
        return float(np.exp(self.theta[2]))


def _make_noise(theta: Array) -> Noise:
    return Noise((float(theta[0]), float(theta[1]), float(theta[2]), float(theta[3])))


def find_starting_noise(prior: NoisePrior) -> Noise:
    return Noise(
        (
            float(np.log(prior.fast_sd)),
            float(np.log(prior.fast_s)),
            float(np.log(prior.fast_sd * prior.slow_share)),
            float(np.log(prior.slow_s)),
        )
    )


def calc_spectrum(theta: Array, prior: NoisePrior, cut: Segments, step_s: float) -> Array:
    """Variance of one coefficient in each band (bands,)."""
    return np.asarray(
        find_spectrum(
            theta, prior.floor_sd, prior.walk_sd, np.cos(cut.omega), cut.members.sum(), step_s
        )
    )


def calc_band_variances(noise: Noise, prior: NoisePrior, cut: Segments, step_s: float) -> Array:
    """Variance of one coefficient in each band, its own factor included (bands,); of other
    bands, without it."""
    plain = calc_spectrum(np.array(noise.theta), prior, cut, step_s)
    return plain * np.array(noise.louder) if len(noise.louder) == len(plain) else plain


def calc_coefficient_strengths(
    noise: Noise, prior: NoisePrior, cut: Segments, step_s: float
) -> Array:
    """Variance of every coefficient, sorted by band (m,)."""
    return np.repeat(calc_band_variances(noise, prior, cut, step_s), cut.members.astype(np.int64))


def log_likelihood(
    power: Array, noise: Noise, prior: NoisePrior, cut: Segments, step_s: float
) -> float:
    """Whittle log-likelihood of residual band powers (bands,), the prior of the noise included."""
    theta = np.array(noise.theta)
    return float(
        find_likelihood(
            theta,
            power,
            cut.members,
            calc_spectrum(theta, prior, cut, step_s),
            np.array(find_starting_noise(prior).theta),
            np.array(prior.spread),
        )
    )


def fit_noise(
    power: Array, noise: Noise, prior: NoisePrior, cut: Segments, step_s: float, rounds: int = 12
) -> Noise:
    """Most probable noise for residual band powers (bands,): Fisher scoring with step halving."""
    theta = fit_spectrum(
        np.array(noise.theta),
        power,
        cut.members,
        np.cos(cut.omega),
        prior.floor_sd,
        prior.walk_sd,
        np.array(find_starting_noise(prior).theta),
        np.array(prior.spread),
        step_s,
        rounds,
    )
    return scale_bands(power, _make_noise(theta), prior, cut, step_s)


def scale_bands(
    power: Array, noise: Noise, prior: NoisePrior, cut: Segments, step_s: float
) -> Noise:
    """A noise with each band's factor as residual band powers (bands,) say."""
    plain = calc_spectrum(np.array(noise.theta), prior, cut, step_s)
    return Noise(
        noise.theta, tuple(((BAND_DOF + power / plain) / (BAND_DOF + cut.members)).tolist())
    )
