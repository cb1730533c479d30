"""Sensor noise of a run log: what is added to noise-free readings, and the same thing as a
model to whiten with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from .kernels import whiten

Floats = npt.NDArray[np.float64]
KINDS = ("ar1", "drift", "quantised", "tails")
_BASE = {"shaft": 0.3, "gate": 0.1, "scale": 0.15, "gnss": 0.03, "wheel": 0.02, "heads": 0.01}
_FINE = {"shaft": 0.001, "gate": 0.001, "scale": 0.05, "gnss": 1e-4, "wheel": 1e-4, "heads": 1e-4}
_COARSE = {"shaft": 0.1, "gate": 0.1, "scale": 0.2, "gnss": 0.1 / 3.6, "wheel": 0.01, "heads": 0.01}
TAIL_FREEDOM = 3.0
STALE_S = 0.5


class Noise(NamedTuple):
    """Noise of one sensor. `fresh_rows`: a new sample every so many rows, held between them."""

    sd: float  # of the fast component
    fast_s: float  # its correlation time; 0 = white
    slow_sd: float
    slow_s: float
    step: float  # resolution of the number written
    tails: bool
    dropouts: float  # share of samples lost
    fresh_rows: int = 1
    hum_s: float = 0.0  # period at which it rings; 0 = it does not
    # how slowly its size grows and shrinks; 0 = it does not
    swell_s: float = 0.0

    def whitened(self, signals: Floats, time_s: Floats) -> Floats:
        """`signals` (columns, samples) in units of the noise that is left once its past is known.

        Heavy tails count with the Fisher information of their centre: (f + 1) / (f + 3) of a
        normal of equal scale.
        """
        fast = self.sd**2
        if self.tails:
            fast *= (TAIL_FREEDOM - 2) / TAIL_FREEDOM * (TAIL_FREEDOM + 3) / (TAIL_FREEDOM + 1)
        white = self.step**2 / 12.0 + 1e-12 * fast
        if self.fast_s <= 0.0:
            white, fast = white + fast, 0.0
        return whiten(
            np.ascontiguousarray(signals),
            time_s,
            fast,
            max(self.fast_s, 0.0),
            self.slow_sd**2,
            max(self.slow_s, 1.0),
            white,
        )


def noises(kind: str, row_s: float, rng: np.random.Generator) -> dict[str, Noise]:
    """One noise a sensor, of the kind named, its figures scattered about the machine's."""
    gnss_hz = float(rng.choice([5.0, 10.0, 1.0 / row_s]))
    out = {}
    speed_fast = float(rng.uniform(0.05, 0.5))
    for name, base in _BASE.items():
        sd = base * rng.uniform(0.7, 1.4)
        fast = (
            speed_fast
            if name in ("gnss", "wheel")
            else 1.0 * rng.uniform(0.7, 1.4)
            if name == "scale"
            else float(rng.choice([0.0, rng.uniform(0.05, 0.4)]))
        )
        slow_sd, slow_s = 0.0, 1.0
        if kind == "drift":
            slow_sd, slow_s = sd * rng.uniform(0.2, 0.7), float(rng.uniform(40.0, 300.0))
        step = (_COARSE if kind == "quantised" else _FINE)[name]
        tails = kind == "tails" and name != "scale"
        rows = {
            "gnss": max(1, round(1.0 / gnss_hz / row_s)),
            "heads": max(1, round(0.5 / row_s)),
        }.get(name, 1)
        out[name] = Noise(
            float(sd),
            float(fast),
            float(slow_sd),
            slow_s,
            step,
            tails,
            float(rng.uniform(0.001, 0.01)) if kind == "tails" else 0.0,
            rows,
        )
    return out


def louder(kind: str, row_s: float, rng: np.random.Generator) -> dict[str, Noise]:
    """Noise beyond what the machine is said to have: 1.5 to 5 times as loud, drifting, pink,
    humming, or uneven.

    A hum and noise that grows and shrinks count in z as the white noise of the same power.
    """
    out = {}
    all_by = float(np.exp(rng.uniform(np.log(1.5), np.log(5.0))))
    for name, n in noises("ar1", row_s, rng).items():
        by = all_by if rng.random() < 0.5 else float(np.exp(rng.uniform(np.log(1.5), np.log(5.0))))
        sd = by * n.sd
        if kind == "loud_drift":
            n = n._replace(
                slow_sd=sd * float(rng.uniform(0.2, 0.7)), slow_s=float(rng.uniform(40.0, 300.0))
            )
        elif kind == "pink":
            n = n._replace(
                fast_s=float(rng.uniform(0.1, 0.6)),
                slow_sd=sd * float(rng.uniform(0.4, 0.8)),
                slow_s=float(rng.uniform(4.0, 25.0)),
            )
        elif kind in ("hum", "uneven"):
            n = n._replace(
                fast_s=0.0,
                hum_s=float(rng.uniform(0.25, 4.0)) * (kind == "hum"),
                swell_s=float(rng.uniform(20.0, 200.0)) * (kind == "uneven"),
            )
        out[name] = n._replace(sd=sd)
    return out


def at_rate(one: Noise, row_s: float, other_row_s: float) -> Noise:
    """The same sensor in a log of another rate."""
    return one._replace(fresh_rows=max(1, round(one.fresh_rows * row_s / other_row_s)))


def _hum(count: int, step_s: float, period_s: float, draws: Floats) -> Floats:
    """Noise (count,) of unit spread that rings at a period (AR(2), damped within about three
    periods)."""
    period = max(period_s, 2.5 * step_s)
    r = np.exp(-step_s / (3.0 * period))
    a1, a2 = 2.0 * r * np.cos(2.0 * np.pi * step_s / period), -r * r
    scale = np.sqrt((1.0 - a2) / (1.0 + a2) / ((1.0 - a2) ** 2 - a1**2))
    return np.asarray(lfilter([1.0 / scale], [1.0, -a1, -a2], draws))


def _coloured(count: int, step_s: float, correlation_s: float, draws: Floats) -> Floats:
    if correlation_s <= 0:
        return draws
    a = np.exp(-step_s / correlation_s)
    return np.asarray(lfilter([np.sqrt(1 - a * a)], [1, -a], draws, zi=[a * draws[0]])[0])


def readings(clean: Floats, row_s: float, n: Noise, rng: np.random.Generator) -> Floats:
    """What the log holds for noise-free `clean` (rows,): noise, resolution, holding, dropouts;
    NaN = empty cell."""
    fresh = np.arange(0, clean.size, n.fresh_rows)
    step_s = row_s * n.fresh_rows
    draws = (
        rng.standard_t(TAIL_FREEDOM, fresh.size) / np.sqrt(TAIL_FREEDOM / (TAIL_FREEDOM - 2))
        if n.tails
        else rng.normal(size=fresh.size)
    )
    if n.hum_s:
        draws = 0.8 * _hum(fresh.size, step_s, n.hum_s, draws) + 0.6 * rng.normal(size=fresh.size)
    if n.swell_s:
        slow = _coloured(fresh.size, step_s, n.swell_s, rng.normal(size=fresh.size))
        draws = draws * np.exp(0.5 * slow - 0.25)
    y = clean[fresh] + n.sd * _coloured(fresh.size, step_s, n.fast_s, draws)
    if n.slow_sd:
        y = y + n.slow_sd * _coloured(fresh.size, step_s, n.slow_s, rng.normal(size=fresh.size))
    y = np.round(y / n.step) * n.step
    got = np.ones(fresh.size, bool)
    if n.dropouts:
        starts = np.flatnonzero(rng.random(fresh.size) < n.dropouts / 4.0)
        for s in starts:
            got[s : s + int(rng.geometric(0.25))] = False
        if starts.size > 3:  # and a few silences that outlast the holding
            for s in rng.choice(starts, 3, replace=False):
                got[s : s + int(rng.uniform(0.6, 3.0) / step_s)] = False
        got[0] = True
    last = np.maximum.accumulate(np.where(got, fresh, 0))[np.arange(clean.size) // n.fresh_rows]
    held = np.interp(last, fresh, y)
    held[(np.arange(clean.size) - last) * row_s > max(STALE_S, 2.5 * step_s)] = np.nan
    return held


def fresh_samples(clean_rows: int, n: Noise) -> npt.NDArray[np.int64]:
    """Rows that carry a new sample (dropouts, a per cent at most, not taken out)."""
    return np.arange(0, clean_rows, n.fresh_rows)
