"""A motor that turns a metering shaft, by its circuit and its torques; nothing of the program's
is used.

Torques in N m and volts: dry friction by a tanh of the speed (Andersson et al., Tribol. Int.
40, 2007, 580), oil by the speed, product by the mass that the rollers shear, at an arm. The
controller finds the voltage that holds the speed.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

ROW_S, FULL_V = 0.1, 13.5
EMF_V_PER_RAD_S, OHM, NM_PER_A = 0.76, 0.14, 0.76
DRY_NM, OIL_NM_S, SHEAR_NM_PER_G = 6.0, 0.10, 0.045


def duty_percent(
    rpm: Array,
    grams_rev: Array,
    supply_v: Array,
    *,
    dry: float = 1.0,
    oil: float = 1.0,
    material: float = 1.0,
) -> Array:
    """Of full duty, without noise: (n,). dry, oil, material : times what they are of a sound
    machine."""
    omega = rpm * 2.0 * np.pi / 60.0
    torque = (
        dry * DRY_NM * np.tanh(omega / 0.1)
        + oil * OIL_NM_S * omega
        + material * SHEAR_NM_PER_G * grams_rev
    )
    volts = EMF_V_PER_RAD_S * omega + OHM * torque / NM_PER_A
    return np.asarray(100.0 * volts / supply_v)


def log(
    seed: int,
    *,
    dry: float = 1.0,
    oil: float = 1.0,
    material: float = 1.0,
    from_s: float = 0.0,
    supply_v: float = FULL_V,
    minutes: float = 10.0,
    g_rev_mm: float = 5.5,
) -> dict[str, Array]:
    """A run at many speeds and openings. from_s : when what differs begins."""
    rng = np.random.default_rng(seed)
    n, hold = round(60.0 * minutes / ROW_S), 80
    time_s = ROW_S * np.arange(n)
    rpm = np.repeat(rng.uniform(20.0, 90.0, n // hold + 1), hold)[:n]
    opening = np.repeat(rng.uniform(10.0, 40.0, n // (3 * hold) + 1), 3 * hold)[:n]
    volts = supply_v + 0.3 * np.sin(time_s / 41.0)
    there = time_s >= from_s
    clean, other = (
        duty_percent(rpm, g_rev_mm * opening, volts, dry=a, oil=b, material=c)
        for a, b, c in ((1.0, 1.0, 1.0), (dry, oil, material))
    )
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": rpm,
        "shaft_rpm": rpm + 0.3 * rng.standard_normal(n),
        "opening_mm_cmd": opening,
        "opening_mm": opening + 0.1 * rng.standard_normal(n),
        "supply_v": volts,
        "shaft_effort": np.where(there, other, clean) + 1.0 * rng.standard_normal(n),
    }
