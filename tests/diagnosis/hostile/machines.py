"""Recordings of five plain machines, before anybody spoils them: arrays by the run log's column
names.

No formula, reader or constant of the program is used: what breaks here is not what the program
expects.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

# (n,) each: float64, or object where the cells are texts
Table = dict[str, np.ndarray]


def _stairs(
    rng: np.random.Generator, time_s: np.ndarray, low: float, high: float, every_s: float
) -> np.ndarray:
    levels = rng.uniform(low, high, int(time_s[-1] / every_s) + 2)
    return np.round(levels[(time_s / every_s).astype(int)], 1)


def _follow(command: np.ndarray, share: float, late: int) -> np.ndarray:
    """A drive that goes a share of the way in each row, some rows late."""
    out, at = np.empty(len(command)), float(command[0])
    for k in range(len(command)):
        at += share * (command[max(0, k - late)] - at)
        out[k] = at
    return out


def spreader(rng: np.random.Generator) -> Table:
    """Four minutes, ten rows a second: both drives, scale, both speeds, heads, slope."""
    time_s = np.arange(0.0, 240.0, 0.1)
    n = len(time_s)
    rpm_cmd, mm_cmd = _stairs(rng, time_s, 30.0, 95.0, 7.0), _stairs(rng, time_s, 12.0, 45.0, 9.0)
    rpm, mm = _follow(rpm_cmd, 0.4, 3), _follow(mm_cmd, 0.6, 1)
    left = 290.0 - np.cumsum(5.5e-3 * rpm * mm / 60.0) * 0.1
    speed = 1.3 + 0.2 * np.sin(time_s / 17.0)
    canopy = 0.6 + 0.1 * np.sin(time_s / 9.0)
    heads = {f"ndvi_{k}": canopy + rng.normal(0.0, 0.02, n) for k in (1, 2, 3)}
    return {
        "time_s": time_s,
        "speed_mps": speed + rng.normal(0.0, 0.03, n),
        "wheel_speed_mps": speed + rng.normal(0.0, 0.02, n),
        "shaft_rpm_cmd": rpm_cmd,
        "shaft_rpm": rpm + rng.normal(0.0, 0.3, n),
        "opening_mm_cmd": mm_cmd,
        "opening_mm": mm + rng.normal(0.0, 0.1, n),
        "hopper_kg": left + rng.normal(0.0, 0.1, n),
        "pitch_deg": 3.0 * np.sin(time_s / 40.0),
        "state": np.full(n, "working", object),
    } | heads


def pump(rng: np.random.Generator) -> Table:
    """A quarter of an hour of a pump in steps, its valve never moved, on the scale of a tank."""
    time_s = np.arange(0.0, 900.0, 0.25)
    n = len(time_s)
    command = _stairs(rng, time_s, 40.0, 180.0, 25.0)
    rpm = _follow(command, 0.25, 2)
    tank = 900.0 - np.cumsum(0.011 * rpm / 60.0 * 20.0) * 0.25
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": command,
        "shaft_rpm": rpm + rng.normal(0.0, 0.5, n),
        "opening_mm_cmd": np.full(n, 20.0),
        "opening_mm": np.full(n, 20.0),
        "hopper_kg": np.round(tank + rng.normal(0.0, 0.3, n), 1),
    }


def wheel(rng: np.random.Generator) -> Table:
    """Two minutes of one drive, fifty rows a second."""
    time_s = np.arange(0.0, 120.0, 0.02)
    command = _stairs(rng, time_s, 0.0, 120.0, 3.0)
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": command,
        "shaft_rpm": _follow(command, 0.15, 4) + rng.normal(0.0, 0.6, len(time_s)),
    }


def hauler(rng: np.random.Generator) -> Table:
    """Half an hour of speeds and a scale, a row a second; the drives' readings without commands."""
    time_s = np.arange(0.0, 1800.0, 1.0)
    n = len(time_s)
    speed, rpm = 2.0 + 0.5 * np.sin(time_s / 60.0), 60.0 + 20.0 * np.sin(time_s / 45.0)
    return {
        "time_s": time_s,
        "speed_mps": speed + rng.normal(0.0, 0.05, n),
        "wheel_speed_mps": 1.03 * speed + rng.normal(0.0, 0.03, n),
        "shaft_rpm": rpm + rng.normal(0.0, 0.3, n),
        "opening_mm": np.full(n, 25.0) + rng.normal(0.0, 0.1, n),
        "hopper_kg": 400.0 - np.cumsum(5.5e-3 * rpm * 25.0 / 60.0) + rng.normal(0.0, 0.2, n),
    }


def spread_map(rng: np.random.Generator) -> Table:
    """Twenty minutes of points of another program: rates and places, a row a second, no drives."""
    time_s = np.arange(0.0, 1200.0, 1.0)
    n = len(time_s)
    target = _stairs(rng, time_s, 120.0, 260.0, 30.0)
    return {
        "time_s": time_s,
        "lat_deg": 48.1 + 1.2e-5 * time_s,
        "lon_deg": np.full(n, 11.3),
        "speed_mps": 1.33 + rng.normal(0.0, 0.03, n),
        "target_rate_kg_ha": target,
        "applied_rate_kg_ha": _follow(target, 0.5, 1) + rng.normal(0.0, 4.0, n),
    }


MACHINES: tuple[Callable[[np.random.Generator], Table], ...] = (
    spreader,
    pump,
    wheel,
    hauler,
    spread_map,
)
