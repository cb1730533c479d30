"""A spline corrector: what a smooth nameless function of everything recorded takes away."""
from __future__ import annotations

from typing import Any

import numpy as np
from evidence import drive_of, poured
from hidden.nominal import Effect, Physics
from hidden.plant import Plant


def spline_gain(truth: dict[str, Any], columns: dict[str, Any]) -> float | None:
    """Share of the removable error that an additive spline over all variables removes on two fifths held out.

    The spline knows no names: it is the ceiling of a smooth corrector. Only for one hidden effect, in its own channel.
    """
    from scipy.interpolate import BSpline

    if truth["category"] != "single":
        return None
    c = truth["causes"][0]
    channel = {"shaft": "shaft", "gate": "gate", "flow": "scale", "scale": "scale", "speed": "wheel"}.get(
        c["id"].split(".")[0])
    if channel is None:
        return None
    plant = Plant(drive_of(columns))
    effect = Effect(c["id"], c["size"], c["form"], c["knob"], c["onset_s"], c["member"], c["seed"])
    clean, planted = plant.run(Physics()), plant.run(Physics(), (effect,))
    seen = {"shaft": "shaft_rpm", "gate": "opening_mm", "scale": "hopper_kg", "wheel": "wheel_speed_mps"}[channel]
    step = round(10.0 / plant.drive.row_s) if channel == "scale" else 4
    measured = columns[seen] - clean[channel]
    truth_d = planted[channel] - clean[channel]
    if channel == "scale":
        measured, truth_d = np.diff(measured[::step]), np.diff(truth_d[::step])      # kg in ten seconds
    else:
        measured, truth_d = measured[::step], truth_d[::step]
    rows = np.arange(measured.size) * step
    knots = np.r_[[0.0] * 4, np.linspace(0, 1, 7)[1:-1], [1.0] * 4]
    parts = [np.ones((rows.size, 1))]
    for name in ("pitch_deg", "roll_deg", "supply_v", "speed_mps", "shaft_rpm_cmd", "opening_mm_cmd", "time_s"):
        v = np.nan_to_num(columns[name][rows])
        spread = np.ptp(v)
        if spread > 1e-9:
            parts.append(BSpline.design_matrix(np.clip((v - v.min()) / spread, 0, 1 - 1e-9), knots, 3).toarray())
    x = np.hstack(parts)
    good = np.isfinite(measured) & ~(poured(columns)[rows] & (channel == "scale"))
    good &= np.abs(measured - np.nanmedian(measured[good])) < 6 * np.nanstd(measured[good])
    block = (plant.drive.time_s[rows] // 60.0).astype(int) % 5
    fit = good & (block % 2 == 0)                            # three blocks of a minute in five, the others held out
    w = np.linalg.solve(x[fit].T @ x[fit] + 1.0 * np.eye(x.shape[1]), x[fit].T @ measured[fit])
    held = good & (block % 2 == 1)
    there = float(np.mean(truth_d[held] ** 2))
    return 1.0 - float(np.mean((truth_d[held] - x[held] @ w) ** 2)) / there if there > 0 else None
