"""Heavy-tailed noise made to count as a robust fit would count it.

The pseudo-values of an M-estimate: with psi the score of Student's t, least squares on (fit + psi / mean slope of psi)
has the M-estimate for its answer and its variance for its noise (Huber & Ronchetti 2009, Robust Statistics, 7.8). Only
what lies off the local median is reshaped, so that a structure of many samples stays as it is.
"""
from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import lfilter

Array = npt.NDArray[np.float64]

FREEDOM = 3.0               # of Student's t
MEDIAN_TO_SCALE = 0.7649    # median of the absolute value of t with three degrees of freedom
LOCAL = 15                  # samples of the local median
SLOW = 201                  # samples: what is slower is no memory of the fast noise
WORTH = 1.2                 # times less variance, from which on the tails are treated at all
LEAST = 400                 # samples


def tail_excess(left: Array, free: npt.NDArray[np.bool_]) -> Array:
    """What to take off a residual (m,) for its tails to count no more than they should; zeros where they are not heavy.

    free : samples that may be changed (m,); the others keep their values.
    """
    nothing = np.zeros(len(left))
    if free.sum() < LEAST:
        return nothing
    memory = _memory(left, free)
    local = median_filter(left, LOCAL)
    off = left - local
    fresh = lfilter([1.0, -memory], [1.0], off)
    scale = float(np.median(np.abs(fresh[free]))) / MEDIAN_TO_SCALE
    if scale <= 0.0:
        return nothing
    square, far = fresh ** 2, FREEDOM * scale ** 2
    score = (FREEDOM + 1.0) * fresh / (far + square)
    slope = float(np.mean(((FREEDOM + 1.0) * (far - square) / (far + square) ** 2)[free]))
    if slope <= 0.0:
        return nothing
    drawn_in = score / slope
    if np.var(fresh[free]) < WORTH * np.var(drawn_in[free]):
        return nothing
    return np.asarray(lfilter([1.0], [1.0, -memory], np.where(free, fresh - drawn_in, 0.0)))


def _memory(left: Array, free: npt.NDArray[np.bool_]) -> float:
    """Correlation of neighbouring samples, slow waves and outliers left out."""
    fast = left - uniform_filter1d(left, SLOW)
    reach = 2.5 * 1.4826 * float(np.median(np.abs(fast[free])))
    calm = np.clip(fast, -reach, reach)
    both = free[1:] & free[:-1]
    total = float(np.sum(calm[1:][both] ** 2))
    return float(np.clip(np.sum(calm[1:][both] * calm[:-1][both]) / total, 0.0, 0.95)) if total > 0.0 else 0.0
