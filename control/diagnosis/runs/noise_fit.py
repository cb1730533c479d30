"""The noise's spectrum and its fit, compiled: under every hypothesis and at every look it is fitted anew.

See `noise` for what the numbers are; theta : log s.d. and log correlation time of the fast and the slow component.
"""
from __future__ import annotations

import numpy as np
import numpy.typing as npt

from control.machine.compiled import compiled

Array = npt.NDArray[np.float64]

MOVED = 1e-4                # of theta, for a slope
HALVINGS = 6                # of a step that gains nothing
LONGEST_STEP = 1.5          # of theta, at once
SETTLED = 1e-3              # of the log-likelihood


@compiled
def spectrum_run(theta: Array, floor_sd: float, walk_sd: float, cos: Array, count: float, step_s: float) -> Array:
    """Variance of one coefficient in each band (bands,). cos : of its frequency. count : of all coefficients."""
    total = np.full(len(cos), floor_sd ** 2)
    if walk_sd > 0.0:
        lowest = (np.pi / max(2.0, count)) ** 2
        for band in range(len(cos)):
            total[band] += walk_sd ** 2 / max(2.0 - 2.0 * cos[band], lowest)
    for k in (0, 2):
        rho = np.exp(-step_s / np.exp(theta[k + 1]))
        power = np.exp(2.0 * theta[k]) * (1.0 - rho * rho)
        for band in range(len(cos)):
            total[band] += power / (1.0 - 2.0 * rho * cos[band] + rho * rho)
    return total


@compiled
def value_run(theta: Array, power: Array, members: Array, strength: Array, centre: Array, spread: Array) -> float:
    """Whittle log-likelihood of residual band powers, the prior of theta included."""
    total = 0.0
    for band in range(len(power)):
        total -= 0.5 * (members[band] * np.log(strength[band]) + power[band] / strength[band])
    for k in range(4):
        away = (theta[k] - centre[k]) / spread[k]
        total -= 0.5 * away * away
    return total


@compiled
def step_run(theta: Array, power: Array, members: Array, cos: Array, strength: Array, floor_sd: float, walk_sd: float,
             centre: Array, spread: Array, step_s: float) -> Array:
    """The step of theta that Fisher scoring asks for (4,)."""
    slopes = np.empty((4, len(power)))
    for k in range(4):
        moved = theta.copy()
        moved[k] += MOVED
        there = spectrum_run(moved, floor_sd, walk_sd, cos, members.sum(), step_s)
        slopes[k] = (np.log(there) - np.log(strength)) / MOVED
    gradient, fisher = np.zeros(4), np.zeros((4, 4))
    for k in range(4):
        gradient[k] = 0.5 * np.sum(slopes[k] * (power / strength - members)) - (theta[k] - centre[k]) / spread[k] ** 2
        for other in range(4):
            fisher[k, other] = 0.5 * np.sum(slopes[k] * members * slopes[other])
        fisher[k, k] += 1.0 / spread[k] ** 2
    step = np.asarray(np.linalg.solve(fisher, gradient))
    return np.asarray(np.minimum(np.maximum(step, -LONGEST_STEP), LONGEST_STEP))


@compiled
def fit_run(start: Array, power: Array, members: Array, cos: Array, floor_sd: float, walk_sd: float, centre: Array,
            spread: Array, step_s: float, rounds: int) -> Array:
    """Fisher scoring with step halving from `start`: the most probable theta (4,)."""
    theta = start.copy()
    strength = spectrum_run(theta, floor_sd, walk_sd, cos, members.sum(), step_s)
    best = value_run(theta, power, members, strength, centre, spread)
    for _ in range(rounds):
        step = step_run(theta, power, members, cos, strength, floor_sd, walk_sd, centre, spread, step_s)
        tried = best - 1.0
        for _ in range(HALVINGS):
            there = spectrum_run(theta + step, floor_sd, walk_sd, cos, members.sum(), step_s)
            tried = value_run(theta + step, power, members, there, centre, spread)
            if tried >= best:
                break
            step = 0.5 * step
        if not tried >= best:
            break
        gained, best, theta, strength = tried - best, tried, theta + step, there
        if gained < SETTLED:
            break
    return theta
