"""The mathematical forms an effect may take here. Each is 1 at the point where the catalogue
defines the size."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def fill_loss(shaft_rpm: Floats, form: int, knob: float) -> Floats:
    """Loss of filling, 0 for slow turning, 1 at 100 r/min: square, hinge, logistic, exponential."""
    n = np.clip(shaft_rpm, 0.0, 130.0)
    if form == 0:
        return (n / 100.0) ** (1.7 + 0.8 * knob)
    if form == 1:
        foot = 25.0 + 25.0 * knob
        return np.asarray(
            np.logaddexp(0.0, (n - foot) / 3.0) / np.logaddexp(0.0, (100.0 - foot) / 3.0)
        )
    if form == 2:

        def s(x):  # type: ignore[no-untyped-def]
            return np.tanh((x - 55.0 - 15.0 * knob) / 28.0)

        return np.asarray((s(n) - s(0.0)) / (s(100.0) - s(0.0)))
    width = 30.0 + 20.0 * knob
    return np.asarray(np.expm1(n / width) / np.expm1(100.0 / width))


def droop(opening_mm: Floats, form: int, knob: float) -> Floats:
    """Load on the shaft, 0 when closed, 1 at 60 mm: quadratic, sine, power."""
    x = np.clip(opening_mm / 60.0, 0.0, 1.1)
    if form == 0:
        return (1.0 - 0.5 * knob) * x + 0.5 * knob * x**2
    if form == 1:
        return np.asarray(np.sin(x * (0.7 + 0.5 * knob)) / np.sin(0.7 + 0.5 * knob))
    return np.asarray(x ** (0.85 + 0.5 * knob))


def sag(supply_v: Floats, nominal_v: float, form: int, knob: float) -> Floats:
    """Volts below nominal, 1 at one volt below; one form bends."""
    below = np.maximum(0.0, nominal_v - supply_v)
    return below if form % 2 == 0 else np.asarray(below ** (0.9 + 0.25 * knob))


def emptied(share_full: Floats, form: int, knob: float) -> Floats:
    """0 at a full hopper, 1 at an empty one."""
    x = np.clip(1.0 - share_full, 0.0, 1.0)
    if form % 3 == 0:
        return x
    if form % 3 == 1:
        return np.asarray(x ** (0.85 + 0.4 * knob))
    return np.asarray(np.expm1(x * (0.2 + 0.8 * knob)) / np.expm1(0.2 + 0.8 * knob))


def aged(time_s: Floats, form: int, knob: float) -> Floats:
    """Hours gone by; one form flattens, its mean slope over the run being one."""
    hours = time_s / 3600.0
    if form % 2 == 0:
        return hours
    settle = 0.7 + 1.5 * knob
    curve = -np.expm1(-hours / settle)
    slope = np.polyfit(hours, curve, 1)[0]
    return np.asarray(curve / slope)


def tilted(pitch_deg: Floats, form: int, knob: float) -> Floats:
    """Degrees nose up; one form flattens far from level."""
    if form % 2 == 0:
        return pitch_deg
    return np.asarray((14.0 + 10.0 * knob) * np.tanh(pitch_deg / (14.0 + 10.0 * knob)))


def begun(time_s: Floats, onset_s: float | None) -> Floats:
    """0 before the onset, 1 after it."""
    return np.ones_like(time_s) if onset_s is None else (time_s >= onset_s).astype(float)


def spells(time_s: Floats, share: float, seed: int) -> Floats:
    """1 while material bridges: random spells of 3 to 10 s that fill `share` of the time."""
    rng = np.random.default_rng([seed, 5])
    total = time_s[-1] - time_s[0]
    out = np.zeros_like(time_s)
    left = share * total
    while left > 0.5:
        length = min(left, rng.uniform(3.0, 10.0))
        at = time_s[0] + rng.uniform(0.03, 0.97) * total
        out[(time_s >= at) & (time_s < at + length)] = 1.0
        left -= length
    return out


def hump(x: Floats, middle: float, width: float) -> Floats:
    """1 in the middle, nothing far from it."""
    return np.asarray(np.exp(-(((x - middle) / width) ** 2)))


def trend(x: Floats) -> Floats:
    """0 at the lowest of `x`, 1 at the highest."""
    spread = float(np.ptp(x))
    return np.asarray((x - x.min()) / spread) if spread > 0 else np.zeros_like(x)
