"""Ground speed and canopy heads of a log: sensors of the same thing held against each other,
where both are new."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve1d
from topdress.control.machine.machine import Machine
from topdress.control.recordings.speeds import MOVING_MPS

from .grid import SMOOTH_S, Grid, choose_row_windows, make_grid
from .inputs import LogRows
from .log import MIN_ROWS

Array = npt.NDArray[np.float64]

# of a parabola through the speed: from as long as a
SPEED_WINDOWS_S = tuple(k * SMOOTH_S for k in (2.0, 4.0, 8.0))
# tractor takes to start or stop, to where it keeps its speed
# after which a receiver's or a wheel's noise is no longer alike
FORGOTTEN_S = 0.5
# readings from which two sensors' noises are told apart: variances to 7 %
MIN_READINGS_OF_TWO = 400
# frequencies: slower ones stand with the first octave that has as many
FEWEST_OF_OCTAVE = 8
# of a sensor's power that is its own noise, at least: a share of 0 would trust it alone
LEAST_OWN = 0.01
# for which a gap that is left out stands: filters of receivers and wheels forget within it, and
# what stopped braking is not what starts again in the next row
FORGETS_S = 1.0
# of the rows: where it moves in fewer, those in which it stands are looked at as well
MOVES_SHARE = 0.2
# of the rows new: a sensor with more is as quick as the log, and repeats by chance
FRESH_SHARE = 0.7
HEAD_THERE = 0.2  # of the rows: a head known in fewer is not there


class TwoSpeeds(NamedTuple):
    """Wheel against GNSS at the rows where GNSS is new."""

    time_s: Array
    true_mps: Array  # weighted mean of both, smoothed
    working: Array
    pitch_deg: Array
    wheel_mps: Array
    gnss_mps: Array
    grid: Grid
    more_percent: Array | float = 0.0  # of the machine file's terms
    # (1 s.d.) of the wheel's speed, missing in dips too short to be taken out
    unseen_percent: float = 0.0


class HeadContrasts(NamedTuple):
    """Contrast of each head with the mean of all, at the rows where the heads are new."""

    time_s: Array
    ndvi: Array  # (k, m)
    mean: Array  # (m,)
    grid: Grid


def read_speeds(every: LogRows, gnss: Array, wheel: Array, machine: Machine) -> TwoSpeeds | None:
    """Both speeds where they are new; None where they hardly ever are.

    The mean weighted with both sensors' precision is the one whose noise their difference knows
    nothing of.
    """
    time = every.time_s
    fresh = _find_fresh_rows(gnss)
    known = np.isfinite(gnss) & np.isfinite(wheel) & fresh
    rows = choose_row_windows(len(time))
    rows = rows[known[rows]]
    if len(rows) < MIN_ROWS:
        return None
    at = time[rows]
    step = float(np.median(np.diff(at)))
    wheel_there = wheel[rows]
    going = (gnss[rows] > MOVING_MPS) & (wheel_there > MOVING_MPS)
    ratio = float(np.median(wheel_there[going] / gnss[rows][going])) if going.any() else 1.0
    both = _weight_octaves(gnss[rows], wheel_there / ratio, machine)
    longest = len(both) - 1 + len(both) % 2
    windows = [min(longest, 2 * int(0.5 * one / step) + 1) for one in SPEED_WINDOWS_S]
    alike, ends = int(FORGOTTEN_S / step), min(windows[-1] // 2, len(both) // 4)
    smooth = (
        both
        if windows[0] <= 3
        else _smooth_quadratically(
            both, min(windows, key=lambda one: _calc_left_out_error(both, one, alike, ends))
        )
    )
    moving = smooth > MOVING_MPS
    looked = moving if moving.sum() > MOVES_SHARE * len(at) else np.ones(len(at), bool)
    grid = make_grid(at, looked, step, seam_s=FORGETS_S)
    more = every.more.get("wheel_percent")
    return TwoSpeeds(
        at,
        smooth,
        every.working[rows],
        every.pitch_deg[rows],
        wheel_there,
        gnss[rows],
        grid,
        0.0 if more is None else more[rows],
    )


def _weight_octaves(gnss: Array, wheel: Array, machine: Machine) -> Array:
    """Mean of both speeds (n,), weighted in each octave of frequency with the precision that
    both have there.

    Of an octave, the part that both have in common, at whatever delay, is the ground's; the
    rest is each one's own noise. What of one's noise is both in the mean and in the difference
    of the two passes for a delay between them.
    """
    spectra = np.fft.rfft([gnss - gnss.mean(), wheel - wheel.mean()])
    octave = np.floor(np.log2(np.maximum(FEWEST_OF_OCTAVE, np.arange(spectra.shape[1])))).astype(
        int
    )
    own = np.array([[machine.noise.gnss_mps], [machine.noise.wheel_mps]]) ** 2 + 0.0 * octave
    if len(gnss) >= MIN_READINGS_OF_TWO:
        power = np.array([np.bincount(octave, one) for one in np.abs(spectra) ** 2])
        product = spectra[0] * spectra[1].conj()
        shared = np.hypot(np.bincount(octave, product.real), np.bincount(octave, product.imag))
        own = np.maximum(power - shared, LEAST_OWN * power)[:, octave]
    trust = (own[0] + 1e-12) / (own.sum(axis=0) + 2e-12)
    return np.asarray(gnss + np.fft.irfft(trust * np.fft.rfft(wheel - gnss), len(gnss)))


def _calc_left_out_error(values: Array, window: int, alike: int, ends: int) -> float:
    """Mean square error of quadratics, each at the middle of a window (odd) of which it did not
    see the neighbours within `alike`, whose noise is alike (Burman, Chow and Nolan 1994,
    Biometrika 81, 351); the first and last `ends` do not count. What is smoothed too little
    makes a delay between the two sensors look too short, by the noise in the speed's slope."""
    at = np.arange(window) - window // 2
    seen = np.abs(at) > min(alike, window // 4)
    weights = np.zeros(window)
    weights[seen] = np.linalg.pinv(np.vander(at[seen], 3, increasing=True))[0]
    error = values - convolve1d(values, weights[::-1], mode="nearest")
    return float(np.mean(error[ends : len(error) - ends] ** 2))


def _smooth_quadratically(values: Array, window: int) -> Array:
    """Quadratics fitted to every `window` (odd) neighbours, at their middle; at the ends those
    of the first and last window (Savitzky and Golay 1964, Anal. Chem. 36, 1627)."""
    reach = window // 2
    at = np.arange(-reach, reach + 1)
    weights = (
        (3.0 * reach * (reach + 1) - 1.0 - 5.0 * at**2)
        * 3.0
        / ((window - 2.0) * window * (window + 2.0))
    )
    found = convolve1d(values, weights, mode="nearest")
    for end, ours in (
        (slice(0, window), slice(0, reach)),
        (slice(-window, None), slice(-reach, None)),
    ):
        quadratic = np.polynomial.polynomial.polyfit(at, values[end], 2)
        found[ours] = np.polynomial.polynomial.polyval(at[ours], quadratic)
    return np.asarray(found)


def _find_fresh_rows(series: Array) -> npt.NDArray[np.bool_]:
    """Rows with a new value, where a sensor slower than the log is held between its readings."""
    changed = np.concatenate(([True], series[1:] != series[:-1]))
    known = np.isfinite(series)
    return changed if changed[known].mean() < FRESH_SHARE else np.ones(len(series), bool)


def find_moving_rows(gnss: Array, wheel: Array) -> npt.NDArray[np.bool_]:
    """Rows in which the machine moves, by either speed; all of them where no speed is known."""
    known = np.isfinite(gnss) | np.isfinite(wheel)
    return np.where(known, np.fmax(gnss, wheel) > MOVING_MPS, ~known.any())


def read_heads_channel(
    time: Array, ndvi: Array, moves: npt.NDArray[np.bool_]
) -> HeadContrasts | None:
    """The heads while the machine moves: where it stands, each sees its own piece of canopy all
    the time, which is no trait of the head."""
    there = np.isfinite(ndvi).mean(axis=1) > HEAD_THERE
    ndvi = np.where(there[:, None], ndvi, np.nan)
    some = ndvi[there]
    known = np.isfinite(some).all(axis=0)
    changed = np.concatenate(([True], (some[:, 1:] != some[:, :-1]).any(axis=0)))
    rows = choose_row_windows(ndvi.shape[1])
    rows = rows[(known & changed & moves)[rows]]
    if len(rows) < MIN_ROWS:
        return None
    at = time[rows]
    used = ndvi[:, rows]
    return HeadContrasts(
        at,
        used,
        np.nanmean(used, axis=0),
        make_grid(at, np.ones(len(at), bool), float(np.median(np.diff(at)))),
    )
