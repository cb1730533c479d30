"""Compiled spectrum and fit of the noise, which is refitted under every model and at every
evaluation.

`noise` explains the numbers; theta : log s.d. and log correlation time of the fast and the slow
component.

No first-order spectrum is exact. The variance of each band is therefore the spectrum's times its
own factor with an inverse-gamma prior around 1, integrated: each band's coefficients then follow a
Student t with `BAND_DOF` degrees of freedom (Roever, Meyer and Christensen, Classical and Quantum
Gravity 28, 2011, 015010). A sensor with excess noise in one band, or excess drift, then counts less
at these frequencies.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from topdress.control.machine.compiled import compile_function

Array = npt.NDArray[np.float64]

# Change of theta for a numerical slope.
SLOPE_STEP = 1e-4
# Prior standard deviation of a drift's log s.d. below its usual value.
LOW_DRIFT_SD = 3.0
# Maximum number of halvings of a step without gain.
MAX_HALVINGS = 6
# Maximum change of theta in one step.
MAX_STEP = 1.5
# Minimum gain of the log-likelihood for a further step.
MIN_STEP_GAIN = 1e-3
# Minimum ratio of the slow to the fast correlation time: otherwise both components are the same.
MIN_TIME_RATIO = 5.0
# Degrees of freedom of a band: its s.d. agrees with the spectrum to 1 / sqrt(2 BAND_DOF), some 16
# %.
BAND_DOF = 20.0


@compile_function
def calc_spectrum_values(
    theta: Array, floor_sd: float, walk_sd: float, cos: Array, count: float, step_s: float
) -> Array:
    """Return the variance of one coefficient in each band (bands,). cos : cosine of its frequency.
    count : number of all coefficients.

    The variance of the mean is exact: over a log shorter than a component's correlation time it is
    far smaller than the spectrum at frequency 0.
    """
    total = np.full(len(cos), floor_sd**2)
    if walk_sd > 0.0:
        lowest = (np.pi / max(2.0, count)) ** 2
        for band in range(len(cos)):
            total[band] += walk_sd**2 / max(2.0 - 2.0 * cos[band], lowest)
    for k in (0, 2):
        rho = np.exp(-step_s / np.exp(theta[k + 1]))
        power = np.exp(2.0 * theta[k]) * (1.0 - rho * rho)
        longer = count * step_s / np.exp(theta[k + 1])
        of_mean = 2.0 * (longer - 1.0 + np.exp(-longer)) / (longer * longer)
        for band in range(len(cos)):
            there = power / (1.0 - 2.0 * rho * cos[band] + rho * rho)
            total[band] += (
                there if cos[band] < 1.0 else min(there, count * np.exp(2.0 * theta[k]) * of_mean)
            )
    return total


@compile_function
def choose_prior_sd(k: int, off: float, spread: float) -> float:
    """Return the prior s.d. of theta's k-th number on the side of its current value: many sensors
    hardly drift at all."""
    return LOW_DRIFT_SD if k == 2 and off < 0.0 else spread


@compile_function
def calc_fit_likelihood(
    theta: Array, power: Array, members: Array, strength: Array, centre: Array, spread: Array
) -> float:
    """Return the log-likelihood of residual band powers, Student t in each band, including the
    prior of theta."""
    total = 0.0
    for band in range(len(power)):
        total -= 0.5 * (
            (BAND_DOF + members[band]) * np.log1p(power[band] / (BAND_DOF * strength[band]))
            + members[band] * np.log(strength[band])
        )
    for k in range(4):
        away = (theta[k] - centre[k]) / choose_prior_sd(k, theta[k] - centre[k], spread[k])
        total -= 0.5 * away * away
    return total


@compile_function
def sum_values(values: Array) -> float:
    """Return the sum of the values in sequence: the compiled order is fixed."""
    total = 0.0
    for value in values:
        total += value
    return total


@compile_function
def add_scaled_step(theta: Array, step: Array, part: float) -> Array:
    """Return theta + part x step (4,)."""
    there = np.empty(4)
    for k in range(4):
        there[k] = theta[k] + part * step[k]
    return there


@compile_function
def solve_linear_system(matrix: Array, right: Array) -> Array:
    """Solve matrix x = right by elimination with the largest pivot of each column; both arguments
    are overwritten.

    Compiling numpy's solver would take two thirds of the compile time of a first diagnosis on a
    machine. Raises LinAlgError where a number is not finite, or the matrix is singular.
    """
    size = len(right)
    for k in range(size):
        pivot = k
        for row in range(k + 1, size):
            if abs(matrix[row, k]) > abs(matrix[pivot, k]):
                pivot = row
        if not 0.0 < abs(matrix[pivot, k]) < np.inf:
            raise np.linalg.LinAlgError(
                "the step of a noise's fit leads beyond what a computer can hold"
            )
        for column in range(size):
            matrix[k, column], matrix[pivot, column] = matrix[pivot, column], matrix[k, column]
        right[k], right[pivot] = right[pivot], right[k]
        for row in range(k + 1, size):
            share = matrix[row, k] / matrix[k, k]
            for column in range(k, size):
                matrix[row, column] -= share * matrix[k, column]
            right[row] -= share * right[k]
    for k in range(size - 1, -1, -1):
        for column in range(k + 1, size):
            right[k] -= matrix[k, column] * right[column]
        right[k] /= matrix[k, k]
    return right


@compile_function
def calc_scoring_step(
    theta: Array,
    power: Array,
    members: Array,
    cos: Array,
    strength: Array,
    floor_sd: float,
    walk_sd: float,
    centre: Array,
    spread: Array,
    step_s: float,
) -> Array:
    """Return the step of theta by Fisher scoring (4,)."""
    # Scalar loops compile faster than operations on whole arrays.
    bands, count = len(power), sum_values(members)
    slopes = np.empty((4, bands))
    for k in range(4):
        moved = theta.copy()
        moved[k] += SLOPE_STEP
        there = calc_spectrum_values(moved, floor_sd, walk_sd, cos, count, step_s)
        for band in range(bands):
            slopes[k, band] = (np.log(there[band]) - np.log(strength[band])) / SLOPE_STEP
    gradient, fisher = np.zeros(4), np.zeros((4, 4))
    for k in range(4):
        off = theta[k] - centre[k]
        pulled = 0.0
        for band in range(bands):
            louder = (
                (BAND_DOF + members[band]) * power[band] / (BAND_DOF * strength[band] + power[band])
            )
            pulled += slopes[k, band] * (louder - members[band])
        gradient[k] = 0.5 * pulled - off / choose_prior_sd(k, off, spread[k]) ** 2
        for other in range(4):
            shared = 0.0
            for band in range(bands):
                known = members[band] * BAND_DOF / (BAND_DOF + members[band] + 2.0)
                shared += slopes[k, band] * known * slopes[other, band]
            fisher[k, other] = 0.5 * shared
        fisher[k, k] += 1.0 / choose_prior_sd(k, off, spread[k]) ** 2
    step: Array = solve_linear_system(fisher, gradient)
    for k in range(4):
        if abs(step[k]) > MAX_STEP:
            step[k] = MAX_STEP if step[k] > 0.0 else -MAX_STEP
    return step


@compile_function
def fit_spectrum(
    start: Array,
    power: Array,
    members: Array,
    cos: Array,
    floor_sd: float,
    walk_sd: float,
    centre: Array,
    spread: Array,
    step_s: float,
    rounds: int,
) -> Array:
    """Return the most probable theta (4,), by Fisher scoring with step halving from `start`."""
    theta, count = start.copy(), sum_values(members)
    strength = calc_spectrum_values(theta, floor_sd, walk_sd, cos, count, step_s)
    best = calc_fit_likelihood(theta, power, members, strength, centre, spread)
    for _ in range(rounds):
        step = calc_scoring_step(
            theta, power, members, cos, strength, floor_sd, walk_sd, centre, spread, step_s
        )
        tried, part = best - 1.0, 1.0
        for _ in range(MAX_HALVINGS):
            moved = add_scaled_step(theta, step, part)
            there = calc_spectrum_values(moved, floor_sd, walk_sd, cos, count, step_s)
            tried = calc_fit_likelihood(moved, power, members, there, centre, spread)
            if moved[1] > moved[3] - np.log(MIN_TIME_RATIO):
                tried = -np.inf
            if tried >= best:
                break
            part *= 0.5
        if not tried >= best:
            break
        gained, best, theta, strength = tried - best, tried, moved, there
        if gained < MIN_STEP_GAIN:
            break
    return theta
