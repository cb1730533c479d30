"""Whether what a model leaves is noise: checks that hold for every channel and log, at one level.

A posterior compares models; it does not say that the best of them is any good. Each check asks
how probable a feature of the residual is under the noise that the machine file leads one to
expect (Box, JRSS A 143, 1980, 383; Gelman, Meng and Stern, Statistica Sinica 6, 1996, 733). The
noise's two strengths have log-normal priors; what stands at one frequency is held against the
largest of as many chi-squares as there are frequencies.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import fdtrc, log_ndtr, stdtr

from .noise import Noise, NoisePrior, Segments, calc_coefficient_strengths, find_starting_noise

Array = npt.NDArray[np.float64]

# of a false alarm, of one check of one channel: one healthy log in some hundred
LEVEL = 0.002
# of the logarithm of a machine file's noise: of some seven readings (GUM, table E.1)
FILE_SD = 0.3
# of a series, either side, that no correlation hangs on (Wilcox 1993)
OUTER = 0.2
FEWEST_PAIRS = 10  # of two series that are held against each other
# of a frequency within the log: what comes round less often is drift
MIN_PERIODS = 5.0


def is_noise_loud(noise: Noise, prior: NoisePrior, left: Array | None = None) -> bool:
    """Whether the fast noise, or all that is left (banded coefficients (m,)), is stronger than
    the machine file's noise can be: in a short log a noise of long memory need not be strong to
    be large."""
    return _count_sd_beyond(find_strongest_noise(noise, prior, left), prior.spread[0])


def estimate_noise_ratio(noise: Noise, prior: NoisePrior, left: Array) -> float:
    """How many times the machine file's noise what is left (m,) is, where that is more than the
    file's figure can be off by itself; else 0. A sensor may be so loud, but somebody has to say
    so: a drive may, too."""
    off = find_strongest_noise(noise, prior, left)
    return float(np.exp(off)) if _count_sd_beyond(off, FILE_SD) else 0.0


def find_strongest_noise(noise: Noise, prior: NoisePrior, left: Array | None) -> float:
    """Logarithm of the fast noise, or of all that is left if that is more, over the machine
    file's."""
    beyond = float(np.mean(left**2)) - prior.floor_sd**2 if left is not None and len(left) else 0.0
    strongest = max(noise.theta[0], 0.5 * float(np.log(beyond)) if beyond > 0.0 else -np.inf)
    return float(strongest - find_starting_noise(prior).theta[0])


def is_drift_excessive(noise: Noise, prior: NoisePrior) -> bool:
    """Whether the slow noise is stronger, with the fast one fitted, than a sensor's drift can
    be."""
    fast = max(noise.theta[0], find_starting_noise(prior).theta[0])
    return _count_sd_beyond(
        noise.theta[2] - fast - float(np.log(prior.slow_share)), prior.spread[2]
    )


def _count_sd_beyond(off: float, sd: float) -> bool:
    return bool(log_ndtr(-off / sd) < np.log(LEVEL))


def by_chance_together(one: Array, other: Array, level: float = 1.0) -> float:
    """Probability that two series (n,) which have nothing to do with each other rise and fall
    together as much as these do: the correlation of the one, its outer fifths held at their
    edges (Wilcox, Psychometrika 58, 1993), with the ranks of the other, and so many independent
    pairs as the memory of both leaves of them (Pyper and Peterman, Can. J. Fish. Aquat. Sci.
    55, 1998, 2127). Ranks of both would see an order in a rounded reading: what lies a
    hundredth of a step higher comes after all others of that step, and the mean says nothing of
    it. level : above it the pairs are counted as if they were all independent, which says less
    than the probability is."""
    count = float(len(one))
    if count < FEWEST_PAIRS:
        return 1.0
    held = np.clip(one, *np.quantile(one, (OUTER, 1.0 - OUTER)))
    a, b = held - held.mean(), _rank_values(other)
    size = float(np.sqrt((a @ a) * (b @ b)))
    if size <= 0.0:
        return 1.0
    rho = float(a @ b) / size
    if (least := _calc_chance_probability(rho, count)) > level:
        return least
    lags = np.arange(1, len(a) // 2)
    remembered = float(
        _calc_autocorrelation(a)[lags] * _calc_autocorrelation(b)[lags] @ (1.0 - lags / count)
    )
    return max(least, _calc_chance_probability(rho, count / max(1.0, 1.0 + 2.0 * remembered)))


def _rank_values(series: Array) -> Array:
    """Ranks about 0; equals share theirs. (scipy.stats takes a second to load.)"""
    _, place, count = np.unique(series, return_inverse=True, return_counts=True)
    shared = np.cumsum(count) - 0.5 * (count - 1.0)
    return np.asarray(shared[place] - 0.5 * (len(series) + 1.0))


def _calc_chance_probability(rho: float, pairs: float) -> float:
    """Of a correlation of so many independent pairs: Student's t, from two sides."""
    free = pairs - 2.0
    return (
        2.0 * float(stdtr(free, -abs(rho) * np.sqrt(free / max(1e-12, 1.0 - rho * rho))))
        if free > 0.0
        else 1.0
    )


def _calc_autocorrelation(series: Array) -> Array:
    """Correlation of a series (n,) of mean 0 with itself, by lag (n,)."""
    power = np.abs(np.fft.rfft(series, 2 * len(series))) ** 2
    by_lag = np.fft.irfft(power)[: len(series)]
    return np.asarray(by_lag / max(by_lag[0], 1e-300))


def by_chance_taken(left: Array, columns: Array) -> float:
    """Probability that columns (k, n) that have nothing to do with a white series (n,) take as
    much off it (F)."""
    basis, strength, _ = np.linalg.svd(columns.T, full_matrices=False)
    basis = basis[:, strength > 1e-6 * strength.max(initial=1e-300)]
    free = len(left) - basis.shape[1]
    if not basis.shape[1] or free < FEWEST_PAIRS:
        return 1.0
    taken, whole = float(np.sum((basis.T @ left) ** 2)), float(left @ left)
    ratio = taken / basis.shape[1] / max(1e-300, (whole - taken) / free)
    return float(fdtrc(basis.shape[1], free, ratio))


def find_line_period_s(
    left: Array, noise: Noise, prior: NoisePrior, cut: Segments, step_s: float
) -> float | None:
    """Period of a frequency that stands out of the noise in banded coefficients (m,), s; None
    where none does."""
    power = left**2 / calc_coefficient_strengths(noise, prior, cut, step_s)
    omega = np.concatenate(
        [np.pi * np.arange(end - begin) / (end - begin) for begin, end in cut.bounds]
    )[cut.order]
    power = np.where(omega * cut.length > 2.0 * np.pi * MIN_PERIODS, power, 0.0)
    if not len(power):
        return None
    at = int(np.argmax(power))
    if omega[at] <= 0.0 or np.log(2.0 * len(power)) + log_ndtr(-float(np.sqrt(power[at]))) > np.log(
        LEVEL
    ):
        return None
    return float(2.0 * np.pi / omega[at] * step_s)
