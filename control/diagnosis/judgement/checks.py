"""Whether what a model leaves is noise: checks that hold for every channel and log, at one level.

A posterior compares models; it does not say that the best of them is any good. Each check asks how probable a feature
of the residual is under the noise that the machine file leads one to expect (Box, JRSS A 143, 1980, 383; Gelman, Meng
and Stern, Statistica Sinica 6, 1996, 733). The noise's two strengths have log-normal priors; what stands at one
frequency is held against the largest of as many chi-squares as there are frequencies.
"""
from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import log_ndtr

from .noise import Noise, NoisePrior, Segments, start, strengths

Array = npt.NDArray[np.float64]

LEVEL = 0.002               # of a false alarm, of one check of one channel: one healthy log in some hundred
MIN_PERIODS = 5.0           # of a frequency within the log: what comes round less often is drift


def is_loud(noise: Noise, prior: NoisePrior, left: Array | None = None) -> bool:
    """Whether the fast noise, or all that is left (banded coefficients (m,)), is stronger than the machine file's noise
    can be: in a short log a noise of long memory need not be strong to be large."""
    beyond = float(np.mean(left ** 2)) - prior.floor_sd ** 2 if left is not None and len(left) else 0.0
    strongest = max(noise.theta[0], 0.5 * float(np.log(beyond)) if beyond > 0.0 else -np.inf)
    return _beyond(strongest - start(prior).theta[0], prior.spread[0])


def drifts(noise: Noise, prior: NoisePrior) -> bool:
    """Whether the slow noise is stronger, with the fast one fitted, than a sensor's drift can be."""
    fast = max(noise.theta[0], start(prior).theta[0])
    return _beyond(noise.theta[2] - fast - float(np.log(prior.slow_share)), prior.spread[2])


def _beyond(off: float, sd: float) -> bool:
    return bool(log_ndtr(-off / sd) < np.log(LEVEL))


def line_s(left: Array, noise: Noise, prior: NoisePrior, cut: Segments, step_s: float) -> float | None:
    """Period of a frequency that stands out of the noise in banded coefficients (m,), s; None where none does."""
    power = left ** 2 / strengths(noise, prior, cut, step_s)
    omega = np.concatenate([np.pi * np.arange(end - begin) / (end - begin) for begin, end in cut.bounds])[cut.order]
    power = np.where(omega * cut.length > 2.0 * np.pi * MIN_PERIODS, power, 0.0)
    if not len(power):
        return None
    at = int(np.argmax(power))
    if omega[at] <= 0.0 or np.log(2.0 * len(power)) + log_ndtr(-float(np.sqrt(power[at]))) > np.log(LEVEL):
        return None
    return float(2.0 * np.pi / omega[at] * step_s)
