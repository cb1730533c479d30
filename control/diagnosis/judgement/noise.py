"""Models the noise of a channel: a fast and a slow first-order component over a white floor, fitted
to band powers.

A channel's series are transformed to the cosine domain (DCT-II, which needs no wrap-around at the
ends). There the noise of neighbouring coefficients is independent, and of equal strength over a
narrow band. Any hypothesis needs only sums of products per band, so refitting the noise under each
hypothesis takes microseconds (Whittle's likelihood).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.fft import dct, idct, prev_fast_len

from .noise_fit import BAND_DOF, calc_fit_likelihood, calc_spectrum_values, fit_spectrum

Array = npt.NDArray[np.float64]

# Maximum segment length, samples: longer series are split, because the correlation time of noise is
# far shorter.
MAX_SEGMENT_SAMPLES = 32768
# Segment length, samples, below which the transform is fast for any length.
MIN_FACTORED_SAMPLES = 4096
# Ratio of the upper to the lower frequency of a band.
BAND_RATIO = 1.25


class Segments(NamedTuple):
    """Segments of a channel's series, and the bands of its coefficients."""

    # Length of the series, samples.
    length: int
    bounds: tuple[tuple[int, int], ...]
    # Indices of the coefficients sorted by band.
    order: npt.NDArray[np.int64]
    # Index of each band's first coefficient in that order.
    starts: npt.NDArray[np.int64]
    # Number of coefficients of each band.
    members: Array
    # Mean angular frequency of each band, rad per sample.
    omega: Array
    # Weight of each sample (n,): its noise is that of the bands divided by the weight. None: 1.
    weights: Array | None = None


def make_segments(length: int, bounds: tuple[tuple[int, int], ...] | None = None) -> Segments:
    """Return the bands for a series of `length`, split into equal segments or at given `bounds`
    (samples outside are not used).

    A long segment is shortened by a per cent or so to a length with small prime factors, because a
    length with a large prime factor takes ten times as long.
    """
    if bounds is None:
        pieces = max(1, round(length / MAX_SEGMENT_SAMPLES))
        edges = np.linspace(0, length, pieces + 1).astype(int)
        bounds = tuple(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    bounds = tuple(
        (begin, end if end - begin < MIN_FACTORED_SAMPLES else begin + prev_fast_len(end - begin))
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
    """Return the segments with a single band, for a noise that is known to be white."""
    return cut._replace(
        starts=np.zeros(1, np.int64),
        members=np.array([float(cut.members.sum())]),
        omega=np.array([0.5 * np.pi]),
    )


def leave_out_bands(cut: Segments, bands: npt.NDArray[np.bool_]) -> Segments:
    """Return the segments without some bands, (bands,): their coefficients are ignored."""
    kept = ~np.repeat(bands, cut.members.astype(np.int64))
    members = cut.members[~bands]
    starts = np.concatenate(([0], np.cumsum(members[:-1]))).astype(np.int64)
    return cut._replace(
        order=cut.order[kept], starts=starts, members=members, omega=cut.omega[~bands]
    )


def calc_coefficients(series: Array, cut: Segments) -> Array:
    """Return the cosine coefficients of series (n,) or (p, n), sorted by band: (m,) or (p, m). The
    series are weighted."""
    if cut.weights is not None:
        series = series * cut.weights.astype(series.dtype, copy=False)
    parts = [dct(series[..., begin:end], norm="ortho", axis=-1) for begin, end in cut.bounds]
    if len(parts) == 1 and len(cut.order) == parts[0].shape[-1]:
        # With a single segment, the coefficients are in the order of their bands already.
        return np.asarray(parts[0])
    return np.take(np.concatenate(parts, axis=-1), cut.order, axis=-1)


def make_series(banded: Array, cut: Segments) -> Array:
    """Return the series (n,) of cosine coefficients sorted by band (m,), without the weights; zero
    outside the segments."""
    plain = np.zeros(sum(end - begin for begin, end in cut.bounds))
    plain[cut.order] = banded
    out = np.zeros(cut.length)
    begin_at = 0
    for begin, end in cut.bounds:
        out[begin:end] = idct(plain[begin_at : begin_at + end - begin], norm="ortho")
        begin_at += end - begin
    return out if cut.weights is None else out / cut.weights


def calc_band_products(x: Array, y: Array, cut: Segments) -> Array:
    """Return sums of products per band of coefficient rows x (p, m) and y (q, m): (bands, p, q)."""
    ends = np.append(cut.starts[1:], x.shape[-1])
    out = np.empty((len(cut.starts), x.shape[0], y.shape[0]))
    for band, (begin, end) in enumerate(zip(cut.starts, ends, strict=True)):
        out[band] = x[:, begin:end] @ y[:, begin:end].T
    return out


class NoisePrior(NamedTuple):
    """Start of the noise fit, from the machine file, and its prior standard deviations (natural
    logarithms)."""

    fast_sd: float
    fast_s: float
    floor_sd: float
    # Strength of the slow component as a share of the fast component.
    slow_share: float = 0.2
    # Correlation time of the slow component, s: within an hour, a slower drift looks like a
    # constant.
    slow_s: float = 120.0
    spread: tuple[float, float, float, float] = (0.7, 1.0, 0.7, 1.0)
    # Standard deviation of each sample's step of a random walk: unobserved accumulation between
    # rows.
    walk_sd: float = 0.0


class Noise(NamedTuple):
    """Log standard deviation and log correlation time (s) of the fast and the slow component.

    louder : ratio of each band's variance to the spectrum, by the fitted residual (bands,); empty
    means 1.
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
    """Return the variance of one coefficient in each band (bands,)."""
    return np.asarray(
        calc_spectrum_values(
            theta, prior.floor_sd, prior.walk_sd, np.cos(cut.omega), cut.members.sum(), step_s
        )
    )


def calc_band_variances(noise: Noise, prior: NoisePrior, cut: Segments, step_s: float) -> Array:
    """Return the variance of one coefficient in each band (bands,), with its own factor where the
    noise has one."""
    plain = calc_spectrum(np.array(noise.theta), prior, cut, step_s)
    return plain * np.array(noise.louder) if len(noise.louder) == len(plain) else plain


def calc_coefficient_variances(
    noise: Noise, prior: NoisePrior, cut: Segments, step_s: float
) -> Array:
    """Return the variance of every coefficient, sorted by band (m,)."""
    return np.repeat(calc_band_variances(noise, prior, cut, step_s), cut.members.astype(np.int64))


def calc_log_likelihood(
    power: Array, noise: Noise, prior: NoisePrior, cut: Segments, step_s: float
) -> float:
    """Return the Whittle log-likelihood of residual band powers (bands,), including the noise's
    prior."""
    theta = np.array(noise.theta)
    return float(
        calc_fit_likelihood(
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
    """Return the most probable noise for residual band powers (bands,), by Fisher scoring with step
    halving."""
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
    """Return the noise with a factor for each band by residual band powers (bands,)."""
    plain = calc_spectrum(np.array(noise.theta), prior, cut, step_s)
    return Noise(
        noise.theta, tuple(((BAND_DOF + power / plain) / (BAND_DOF + cut.members)).tolist())
    )
