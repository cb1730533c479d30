"""Compares redundant sensors of a log where both have new readings: wheel and GNSS speed, and the
canopy heads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve1d
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.judgement.line_search import climb_to_best
from topdress.control.diagnosis.judgement.prior import calc_log_prior_odds
from topdress.control.machine.machine import Machine
from topdress.control.recordings.speed_unit import MOVING_MPS

from .grid import SMOOTH_S, Grid, choose_row_windows, make_grid
from .inputs import LogRows
from .log import MIN_ROWS

Array = npt.NDArray[np.float64]

# Lengths of the parabola that smooths the speed, s: up to the time in which a tractor starts or
# stops and reaches a constant speed.
SPEED_WINDOWS_S = tuple(k * SMOOTH_S for k in (2.0, 4.0, 8.0))
# Correlation time of a receiver's or a wheel's noise, s.
NOISE_MEMORY_S = 0.5
# Longest delay of a receiver's speed that is looked for, s.
MAX_DELAY_S = 3.0
# Longest period in the search for a delay, s: a tractor that starts and stops.
DELAY_WINDOW_S = 2.0 * SPEED_WINDOWS_S[-1]
# Largest coherence of two speeds that are printed to four decimals.
MAX_COHERENCE = 1.0 - 1e-8
# Bandwidth of the Hann taper, frequencies (Harris, Proc. IEEE 66, 1978, 51).
TAPER_BANDWIDTH = 1.5
# Minimum number of readings to separate the noise of two sensors: variances to 7 %.
MIN_PAIRED_READINGS = 400
# Minimum number of frequencies of an octave; lower frequencies join the first octave that has
# enough.
MIN_OCTAVE_FREQUENCIES = 8
# Minimum noise share of a sensor's power: a share of 0 would trust this sensor alone.
MIN_NOISE_SHARE = 0.01
# Length of a gap that stands for left-out rows, s: filters of receivers and wheels forget within
# it, and braking before a stop does not continue after it.
FILTER_MEMORY_S = 1.0
# Minimum share of moving rows; with fewer, the standing rows are examined as well.
MIN_MOVING_SHARE = 0.2
# Share of new readings above which a sensor is as fast as the log, so that repetitions are by
# chance.
MIN_FRESH_SHARE = 0.7
# Minimum share of rows with a reading: with fewer, the head is absent.
MIN_HEAD_SHARE = 0.2


class TwoSpeeds(NamedTuple):
    """Wheel and GNSS speed at the rows where GNSS has a new reading."""

    time_s: Array
    # Weighted mean of both speeds, smoothed, m/s.
    true_mps: Array
    working: Array
    pitch_deg: Array
    wheel_mps: Array
    gnss_mps: Array
    grid: Grid
    # Sum of the machine file's terms, %.
    more_percent: Array | float = 0.0
    # Standard deviation of the wheel speed that is missing in dips too short to be removed, %.
    unseen_percent: float = 0.0


class HeadContrasts(NamedTuple):
    """Contrast of each head with the mean of all heads, at the rows with new readings."""

    time_s: Array
    # Readings, (k, m).
    ndvi: Array
    # Mean of the heads, (m,).
    mean: Array
    grid: Grid


def read_both_speeds(
    every: LogRows, gnss: Array, wheel: Array, machine: Machine
) -> TwoSpeeds | None:
    """Return both speeds where they have new readings; None where they hardly have any.

    The mean weighted with the precision of both sensors has noise that is uncorrelated with the
    noise of their difference.
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
    delay_s = _measure_delay_s(at, gnss[rows], wheel_there / ratio)
    both = _weight_octaves(np.interp(at + delay_s, at, gnss[rows]), wheel_there / ratio, machine)
    longest = len(both) - 1 + len(both) % 2
    windows = [min(longest, 2 * int(0.5 * one / step) + 1) for one in SPEED_WINDOWS_S]
    alike, ends = int(NOISE_MEMORY_S / step), min(windows[-1] // 2, len(both) // 4)
    smooth = (
        both
        if windows[0] <= 3
        else _smooth_quadratically(
            both, min(windows, key=lambda one: _calc_left_out_error(both, one, alike, ends))
        )
    )
    moving = smooth > MOVING_MPS
    looked = moving if moving.sum() > MIN_MOVING_SHARE * len(at) else np.ones(len(at), bool)
    grid = make_grid(at, looked, step, seam_s=FILTER_MEMORY_S)
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


def _measure_delay_s(time_s: Array, gnss_mps: Array, wheel_mps: Array) -> float:
    """Return the most probable delay of the GNSS speed behind the wheel's, s; 0 where no delay is
    more probable.

    A delay turns the phase between both speeds in proportion to the frequency, and noise that they
    do not share has no phase. In each octave the coherence g at a delay is fitted, which gains
    -n ln(1 - g^2) over independent speeds, n frequencies (Knapp and Carter, IEEE Trans. Acoust. 24,
    1976, 320); an octave without a common speed is as probable as one with it, at half ln n for g
    (Schwarz, Ann. Stat. 6, 1978, 461). Slow differences (slip) are no delay: periods above
    DELAY_WINDOW_S are left out.

    Parameters
    ----------
    time_s : times of the readings (n,), s.
    gnss_mps, wheel_mps : speeds, (n,) each.
    """
    step_s = float(np.median(np.diff(time_s)))
    even_s = np.arange(time_s[0], time_s[-1], step_s)
    taper, longest = np.hanning(len(even_s)), round(MAX_DELAY_S / step_s)
    gnss, wheel = (
        np.fft.rfft(taper * (one - one.mean()))
        for one in (np.interp(even_s, time_s, series) for series in (gnss_mps, wheel_mps))
    )
    frequency_hz = np.fft.rfftfreq(len(even_s), step_s)
    quick = frequency_hz > 1.0 / DELAY_WINDOW_S
    octave = np.floor(np.log2(frequency_hz[quick] * DELAY_WINDOW_S)).astype(int)
    independent = np.bincount(octave) / TAPER_BANDWIDTH
    shared = (gnss * wheel.conj())[quick]
    power = np.sqrt(
        np.prod([np.bincount(octave, np.abs(one[quick]) ** 2) for one in (gnss, wheel)], axis=0)
    )

    def calc_gain(delay_s: float) -> float:
        turned = (shared * np.exp(2j * np.pi * frequency_hz[quick] * delay_s)).real
        coherence = np.bincount(octave, turned) / np.maximum(power, 1e-300)
        squares = np.clip(coherence, 0.0, MAX_COHERENCE) ** 2
        gains = -independent * np.log1p(-squares) - 0.5 * np.log(np.maximum(1.0, independent))
        return float(np.sum(np.logaddexp(0.0, gains)))

    # The prior of a delay is that of the effect, shared over the delays.
    names = sum("speed" in row.channels for row in EFFECT_ROWS.values())
    prior = calc_log_prior_odds("steady", names) - np.log(max(1, longest))
    gains = np.array([calc_gain(k * step_s) + prior * (k > 0) for k in range(longest + 1)])
    best = int(np.argmax(gains))
    if not 0 < best < longest:
        return best * step_s
    return step_s * climb_to_best(
        float(best), lambda k: calc_gain(k * step_s), lambda k, by: (k - by, k + by), [0.5, 0.25]
    )


def _weight_octaves(gnss: Array, wheel: Array, machine: Machine) -> Array:
    """Return the mean of both speeds (n,), weighted in each octave of frequency with the precision
    of each sensor.

    In an octave, the common component, at whatever delay, is the ground's; the remainder is each
    sensor's own noise. Noise that is in both the mean and the difference would be mistaken for a
    delay between them.
    """
    spectra = np.fft.rfft([gnss - gnss.mean(), wheel - wheel.mean()])
    octave = np.floor(
        np.log2(np.maximum(MIN_OCTAVE_FREQUENCIES, np.arange(spectra.shape[1])))
    ).astype(int)
    own = np.array([[machine.noise.gnss_mps], [machine.noise.wheel_mps]]) ** 2 + 0.0 * octave
    if len(gnss) >= MIN_PAIRED_READINGS:
        power = np.array([np.bincount(octave, one) for one in np.abs(spectra) ** 2])
        product = spectra[0] * spectra[1].conj()
        shared = np.hypot(np.bincount(octave, product.real), np.bincount(octave, product.imag))
        own = np.maximum(power - shared, MIN_NOISE_SHARE * power)[:, octave]
    trust = (own[0] + 1e-12) / (own.sum(axis=0) + 2e-12)
    return np.asarray(gnss + np.fft.irfft(trust * np.fft.rfft(wheel - gnss), len(gnss)))


def _calc_left_out_error(values: Array, window: int, alike: int, ends: int) -> float:
    """Return the mean square error of leave-out quadratics at the middle of a window (odd).

    Each quadratic omits the neighbours within `alike`, whose noise is correlated (Burman, Chow and
    Nolan 1994, Biometrika 81, 351); the first and last `ends` do not count. Too little smoothing
    makes a delay between the sensors look too short, by the noise in the speed's slope.
    """
    at = np.arange(window) - window // 2
    seen = np.abs(at) > min(alike, window // 4)
    weights = np.zeros(window)
    weights[seen] = np.linalg.pinv(np.vander(at[seen], 3, increasing=True))[0]
    error = values - convolve1d(values, weights[::-1], mode="nearest")
    return float(np.mean(error[ends : len(error) - ends] ** 2))


def _smooth_quadratically(values: Array, window: int) -> Array:
    """Smooth by quadratics fitted to every `window` (odd) neighbours; the ends use the first and
    last window (Savitzky and Golay 1964, Anal. Chem. 36, 1627)."""
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
    """Return the rows with a new value of a sensor that is slower than the log and held between its
    readings."""
    changed = np.concatenate(([True], series[1:] != series[:-1]))
    known = np.isfinite(series)
    return changed if changed[known].mean() < MIN_FRESH_SHARE else np.ones(len(series), bool)


def find_moving_rows(gnss: Array, wheel: Array) -> npt.NDArray[np.bool_]:
    """Return the rows in which the machine moves, by either speed; all rows where no speed is
    recorded."""
    known = np.isfinite(gnss) | np.isfinite(wheel)
    return np.where(known, np.fmax(gnss, wheel) > MOVING_MPS, ~known.any())


def read_heads_channel(
    time: Array, ndvi: Array, moves: npt.NDArray[np.bool_]
) -> HeadContrasts | None:
    """Return the heads while the machine moves: at a standstill each head sees its own piece of
    canopy, which is no property of the head."""
    there = np.isfinite(ndvi).mean(axis=1) > MIN_HEAD_SHARE
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
