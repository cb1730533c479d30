"""The recursions of the generator that no array expression does. Compiled, because a run has a
million steps; not kept on disk, where they would be known by one name of this module, and tests
and benchmarks import it by two."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@numba.njit
def chase(wanted: Floats, tau_s: Floats, most_per_s: float, dt_s: float, start: float) -> Floats:
    """First-order approach to `wanted` (steps,), each step exact for a constant input, its
    speed bounded."""
    out = np.empty_like(wanted)
    x = start
    for k in range(wanted.size):
        move = (wanted[k] - x) * (1.0 - np.exp(-dt_s / tau_s[k]))
        most = most_per_s * dt_s
        x += min(max(move, -most), most)
        out[k] = x
    return out


@numba.njit
def drag(leader: Floats, half_play: Floats, start: float) -> Floats:
    """What a leader (steps,) drags along through a play of twice `half_play` (steps,), in the
    leader's unit."""
    out = np.empty_like(leader)
    x = start
    for k in range(leader.size):
        x = min(max(x, leader[k] - half_play[k]), leader[k] + half_play[k])
        out[k] = x
    return out


@numba.njit
def slew(wanted: Floats, most_per_s: Floats, dt_s: float, start: float) -> Floats:
    """Approach to `wanted` (steps,) at a speed (steps,)."""
    out = np.empty_like(wanted)
    x = start
    for k in range(wanted.size):
        most = most_per_s[k] * dt_s
        x += min(max(wanted[k] - x, -most), most)
        out[k] = x
    return out


@numba.njit
def whiten(
    signals: Floats,
    time_s: Floats,
    fast_var: float,
    fast_s: float,
    slow_var: float,
    slow_s: float,
    white_var: float,
) -> Floats:
    """Standardised innovations of `signals` (columns, samples) under fast AR(1) + slow AR(1) +
    white noise.

    One Kalman filter with states (fast, slow) serves all columns, for its gains do not depend
    on the data. Uneven times are exact: both components are processes in continuous time.
    """
    columns, count = signals.shape
    out = np.empty_like(signals)
    x = np.zeros((columns, 2))
    p00, p01, p11 = fast_var, 0.0, slow_var
    for k in range(count):
        if k > 0:
            dt = time_s[k] - time_s[k - 1]
            a = np.exp(-dt / fast_s) if fast_s > 0.0 else 0.0
            b = np.exp(-dt / slow_s)
            p00 = a * a * p00 + (1.0 - a * a) * fast_var
            p11 = b * b * p11 + (1.0 - b * b) * slow_var
            p01 = a * b * p01
            for c in range(columns):
                x[c, 0] *= a
                x[c, 1] *= b
        s = p00 + 2.0 * p01 + p11 + white_var
        g0, g1 = (p00 + p01) / s, (p01 + p11) / s
        root = np.sqrt(s)
        for c in range(columns):
            innovation = signals[c, k] - x[c, 0] - x[c, 1]
            out[c, k] = innovation / root
            x[c, 0] += g0 * innovation
            x[c, 1] += g1 * innovation
        n00 = p00 - g0 * (p00 + p01)
        n01 = p01 - g0 * (p01 + p11)
        p11 = p11 - g1 * (p01 + p11)
        p00, p01 = n00, n01
    return out
