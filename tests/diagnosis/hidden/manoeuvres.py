"""Short runs that an operator drives at the end of a day because a diagnosis asked for one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from . import nominal as nom
from .programmes import Drive

Floats = npt.NDArray[np.float64]
WORDS = {
    "Shaft staircase": "stairs",
    "Opening staircase": "openings",
    "slope": "slope",
    "ground speeds": "two_speeds",
    "shaft stopped every second": "out_of_work",
    "Stand still": "standing",
    "fill up": "refill",
}
# must be left in the hopper when the manoeuvre begins
SPARE_KG = 90.0
REFILL_KG = 150.0
PER_KG_S = nom.FLOW_G_PER_REV_MM / 60_000.0


def asked_for(plan: str) -> str | None:
    """Which manoeuvre the plan of a diagnosis describes; None: nothing that can be driven."""
    return next((name for word, name in WORDS.items() if word.lower() in plan.lower()), None)


def driven_too(name: str) -> Callable[[Drive], Drive]:
    """Drives the manoeuvre after the rest of the run, which ends earlier where the hopper would
    not last."""
    return lambda drive: _joined(_with_spare(drive), name)


def _with_spare(d: Drive) -> Drive:
    level = (
        d.start_kg
        - np.cumsum(PER_KG_S * d.shaft_rpm_cmd * d.opening_mm_cmd - d.refill_kg_s) * d.row_s
    )
    low = np.flatnonzero(level < SPARE_KG)
    keep = (
        int(low[0])
        if low.size and (d.refill_row is None or low[0] > d.refill_row + 400)
        else d.time_s.size
    )
    return d._replace(**{k: v[:keep] for k, v in d._asdict().items() if isinstance(v, np.ndarray)})


def _joined(d: Drive, name: str) -> Drive:
    minutes = 20.0 if name == "refill" else 10.0
    t = np.arange(0.0, 60.0 * minutes, d.row_s)
    n = np.ones(t.size)
    shaft, opening = np.full(t.size, 60.0), np.full(t.size, 20.0)
    speed, pitch, working = 1.25 * n, 0.3 * np.sin(t / 7.0), n > 0
    supply = nom.NOMINAL_SUPPLY_V - 0.6 * (np.floor(t / 90.0) % 2)
    pour, row, kg = np.zeros(t.size), d.refill_row, d.refill_kg
    turn = np.floor(t / 60.0)
    if name == "stairs":
        shaft = 20.0 + 20.0 * (turn % 4)
    elif name == "openings":
        opening = 10.0 + 10.0 * (turn % 4)
    elif name == "slope":
        pitch = pitch + np.where(np.floor(t / 120.0) % 2 < 1, 4.0, -4.0)
    elif name == "two_speeds":
        speed = np.where(np.floor(t / 120.0) % 2 < 1, 0.83, 1.67)
    elif name == "out_of_work":
        working = turn % 2 < 1
    elif name == "standing":
        working, speed = n < 0, 0.0 * n
    elif name == "refill" and row is None:
        standing = (t >= 600.0) & (t < 660.0)
        working, speed = ~standing, np.where(standing, 0.0, speed)
        inside = (t >= 615.0) & (t < 640.0)
        pour[inside] = REFILL_KG / (inside.sum() * d.row_s)
        row, kg = int(d.time_s.size + np.flatnonzero(inside)[-1] + 2.0 / d.row_s), REFILL_KG
    shaft = np.where(working, shaft, 0.0)
    rate = np.where(
        working, PER_KG_S * shaft * opening * 1e4 / nom.WIDTH_M / np.maximum(speed, 0.4), 0.0
    )
    more = {
        "time_s": d.time_s[-1] + d.row_s + t,
        "working": working,
        "speed_mps": _eased(speed, d.row_s),
        "heading_deg": d.heading_deg[-1] * n,
        "pitch_deg": pitch,
        "roll_deg": 0.5 * np.sin(t / 11.0),
        "supply_v": supply,
        "rate_kg_ha": rate,
        "shaft_rpm_cmd": shaft,
        "opening_mm_cmd": opening,
        "speed_first": n < 0,
        "ndvi": 0.5 + 0.05 * np.sin(t / 23.0),
        "refill_kg_s": pour,
    }
    return d._replace(
        refill_row=row,
        refill_kg=kg,
        **{k: np.concatenate((getattr(d, k), v)) for k, v in more.items()},
    )


def _eased(speed: Floats, row_s: float) -> Floats:
    """A tractor's speed: running mean over three seconds."""
    width = max(1, round(3.0 / row_s))
    padded = np.concatenate((np.full(width, speed[0]), speed))
    total = np.concatenate(([0.0], np.cumsum(padded)))
    return np.asarray((total[width:] - total[:-width])[1:] / width)
