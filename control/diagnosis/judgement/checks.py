"""Tests whether a model's residual is noise, for every channel and log, at one significance level.

A posterior compares models; it does not say that the best model is adequate. Each check calculates
the probability of a feature of the residual under the noise that the machine file predicts (Box,
JRSS A 143, 1980, 383; Gelman, Meng and Stern, Statistica Sinica 6, 1996, 733). The strengths of the
two noise components have log-normal priors. Power at a single frequency is compared with the
largest of as many chi-squared variables as there are frequencies.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import fdtrc, log_ndtr, stdtr

from .noise import Noise, NoisePrior, Segments, calc_coefficient_variances, find_starting_noise

Array = npt.NDArray[np.float64]

# Probability of a false alarm by one check of one channel: one healthy log in some hundred.
FALSE_ALARM_PROB = 0.002
# Standard deviation of the logarithm of a machine file's noise, estimated from some seven readings
# (GUM, table E.1).
LOG_NOISE_SD = 0.3
# Share of a series at either side that is winsorised, so that no outlier makes a correlation
# (Wilcox 1993).
WINSORISED_SHARE = 0.2
# Minimum number of independent pairs of two series.
MIN_PAIRS = 10
# Minimum number of periods within the log: a slower oscillation counts as drift.
MIN_PERIODS = 5.0


def is_noise_loud(noise: Noise, prior: NoisePrior, left: Array | None = None) -> bool:
    """Tell whether the fast noise, or the whole residual (banded coefficients (m,)), exceeds the
    machine file's noise.

    The whole residual is tested as well, because in a short log a noise of long correlation time
    can be large without being strong.
    """
    return _count_sd_beyond(find_strongest_noise(noise, prior, left), prior.spread[0])


def estimate_noise_ratio(noise: Noise, prior: NoisePrior, left: Array) -> float:
    """Return the ratio of the residual (m,) to the machine file's noise, where it exceeds the
    uncertainty of the file's value; else 0.

    A sensor may be that noisy, but so may a drive, so the user is informed.
    """
    off = find_strongest_noise(noise, prior, left)
    return float(np.exp(off)) if _count_sd_beyond(off, LOG_NOISE_SD) else 0.0


def find_strongest_noise(noise: Noise, prior: NoisePrior, left: Array | None) -> float:
    """Return the logarithm of the fast noise, or of the whole residual if that is larger, over the
    machine file's noise."""
    beyond = float(np.mean(left**2)) - prior.floor_sd**2 if left is not None and len(left) else 0.0
    strongest = max(noise.theta[0], 0.5 * float(np.log(beyond)) if beyond > 0.0 else -np.inf)
    return float(strongest - find_starting_noise(prior).theta[0])


def is_drift_excessive(noise: Noise, prior: NoisePrior) -> bool:
    """Tell whether the slow noise exceeds a sensor's possible drift, with the fast noise fitted."""
    fast = max(noise.theta[0], find_starting_noise(prior).theta[0])
    return _count_sd_beyond(
        noise.theta[2] - fast - float(np.log(prior.slow_share)), prior.spread[2]
    )


def _count_sd_beyond(off: float, sd: float) -> bool:
    return bool(log_ndtr(-off / sd) < np.log(FALSE_ALARM_PROB))


def calc_correlation_p(one: Array, other: Array, level: float = 1.0) -> float:
    """Return the probability that two unrelated series (n,) are correlated as strongly as these.

    The statistic is the correlation of the one series, winsorised at its outer fifths (Wilcox,
    Psychometrika 58, 1993), with the ranks of the other. The effective number of independent pairs
    follows from the autocorrelation of both (Pyper and Peterman, Can. J. Fish. Aquat. Sci. 55,
    1998, 2127). Ranks of both series would overrate the order within a rounded reading: a value a
    hundredth of a step higher ranks after all others of that step. level : above this p value the
    pairs are counted as independent, which gives a lower bound of the probability.
    """
    count = float(len(one))
    if count < MIN_PAIRS:
        return 1.0
    held = np.clip(one, *np.quantile(one, (WINSORISED_SHARE, 1.0 - WINSORISED_SHARE)))
    a, b = held - held.mean(), _rank_values(other)
    size = float(np.sqrt((a @ a) * (b @ b)))
    if size <= 0.0:
        return 1.0
    rho = float(a @ b) / size
    if (least := _calc_t_test_p(rho, count)) > level:
        return least
    lags = np.arange(1, len(a) // 2)
    remembered = float(
        _calc_autocorrelation(a)[lags] * _calc_autocorrelation(b)[lags] @ (1.0 - lags / count)
    )
    return max(least, _calc_t_test_p(rho, count / max(1.0, 1.0 + 2.0 * remembered)))


def _rank_values(series: Array) -> Array:
    """Return ranks around 0; equal values share their rank. (scipy.stats takes a second to
    import.)"""
    _, place, count = np.unique(series, return_inverse=True, return_counts=True)
    shared = np.cumsum(count) - 0.5 * (count - 1.0)
    return np.asarray(shared[place] - 0.5 * (len(series) + 1.0))


def _calc_t_test_p(rho: float, pairs: float) -> float:
    """Return the two-sided p value of a correlation of independent pairs, by Student's t."""
    free = pairs - 2.0
    return (
        2.0 * float(stdtr(free, -abs(rho) * np.sqrt(free / max(1e-12, 1.0 - rho * rho))))
        if free > 0.0
        else 1.0
    )


def _calc_autocorrelation(series: Array) -> Array:
    """Return the autocorrelation of a series (n,) of mean 0, by lag (n,)."""
    power = np.abs(np.fft.rfft(series, 2 * len(series))) ** 2
    by_lag = np.fft.irfft(power)[: len(series)]
    return np.asarray(by_lag / max(by_lag[0], 1e-300))


def calc_fit_p(left: Array, columns: Array) -> float:
    """Return the probability that columns (k, n) unrelated to a white series (n,) explain as much
    of it (F test)."""
    basis, strength, _ = np.linalg.svd(columns.T, full_matrices=False)
    basis = basis[:, strength > 1e-6 * strength.max(initial=1e-300)]
    free = len(left) - basis.shape[1]
    if not basis.shape[1] or free < MIN_PAIRS:
        return 1.0
    taken, whole = float(np.sum((basis.T @ left) ** 2)), float(left @ left)
    ratio = taken / basis.shape[1] / max(1e-300, (whole - taken) / free)
    return float(fdtrc(basis.shape[1], free, ratio))


def find_line_period(
    left: Array, noise: Noise, prior: NoisePrior, cut: Segments, step_s: float
) -> float | None:
    """Return the period of a significant spectral line in banded coefficients (m,), s; None where
    there is none."""
    power = left**2 / calc_coefficient_variances(noise, prior, cut, step_s)
    omega = np.concatenate(
        [np.pi * np.arange(end - begin) / (end - begin) for begin, end in cut.bounds]
    )[cut.order]
    power = np.where(omega * cut.length > 2.0 * np.pi * MIN_PERIODS, power, 0.0)
    if not len(power):
        return None
    at = int(np.argmax(power))
    if omega[at] <= 0.0 or np.log(2.0 * len(power)) + log_ndtr(-float(np.sqrt(power[at]))) > np.log(
        FALSE_ALARM_PROB
    ):
        return None
    return float(2.0 * np.pi / omega[at] * step_s)
