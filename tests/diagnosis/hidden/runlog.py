"""A drive and a machine become the columns of a run log, by the published contract."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import nominal as nom
from .noise import Noise, readings
from .nominal import Effect, Physics
from .plant import Plant

Floats = npt.NDArray[np.float64]
_PULSE_M = 2.5 / 16.0


def _missed(wheel: Floats, distance: Floats, time_s: Floats, row_s: float, e: Effect) -> Floats:
    """Wheel speed with random pulses missing: an interval twice as long, or a thinner count
    over half a second."""
    rng = np.random.default_rng([e.seed, 3])
    pulses = np.floor(distance / _PULSE_M).astype(int)
    share: Floats | float = e.size / 100.0
    if e.course is not None:  # more and more of them, or from some time on
        first = np.searchsorted(pulses, np.arange(pulses[-1] + 3)).clip(0, time_s.size - 1)
        share = share * e.course.at(time_s[first])
    lost = rng.random(pulses[-1] + 3) < share
    if e.form % 2 == 0:
        return np.where(lost[pulses] | lost[pulses + 1], wheel / 2.0, wheel)
    back = np.interp(np.arange(wheel.size) - 0.5 / row_s, np.arange(wheel.size), distance)
    total = np.r_[0, np.cumsum(lost)]
    gone = total[pulses] - total[np.floor(back / _PULSE_M).astype(int)]
    return np.maximum(0.0, wheel - gone * _PULSE_M / 0.5)


def columns(
    plant: Plant, physics: Physics, effects: Sequence[Effect], noises: dict[str, Noise], seed: int
) -> dict[str, npt.NDArray[Any]]:
    """Contract columns: float64 with NaN for empty cells, object with "" for texts."""
    rng = np.random.default_rng([seed, 21])
    d, clean = (
        plant.drive,
        plant.run(physics, [e for e in effects if e.id != "shaft.coarse_encoder"]),
    )
    rows = d.time_s.size
    wheel = clean["wheel"]
    for e in effects:
        if e.id == "speed.missed_pulses":
            there = 1.0 if e.course is None else e.course.at(d.time_s)
            whole = wheel / (1 - e.size / 100.0 * there)
            wheel = _missed(whole, np.cumsum(d.speed_mps) * d.row_s, d.time_s, d.row_s, e)
    out: dict[str, npt.NDArray[Any]] = {"time_s": np.round(d.time_s, 3)}

    def seen(clean_rows: Floats, name: str) -> Floats:
        return readings(clean_rows, d.row_s, noises[name], rng)

    moving = d.speed_mps > 0
    out["speed_mps"] = np.maximum(0.0, np.round(seen(clean["gnss"], "gnss"), 4))
    out["wheel_speed_mps"] = np.where(
        moving, np.maximum(0.0, np.round(seen(wheel, "wheel"), 4)), 0.0
    )
    shaft = seen(clean["shaft"], "shaft")
    for e in effects:
        if e.id == "shaft.coarse_encoder":
            coarse = np.round(shaft / e.size) * e.size
            shaft = (
                coarse if e.course is None else np.where(e.course.at(d.time_s) > 0.5, coarse, shaft)
            )
    out["shaft_rpm"] = np.round(shaft, 3)
    out["opening_mm"] = np.round(seen(clean["gate"], "gate"), 3)
    out["hopper_kg"] = np.round(seen(clean["scale"], "scale"), 3)
    for h in range(nom.HEADS):
        out[f"ndvi_{h + 1}"] = np.clip(np.round(seen(clean["heads"][h], "heads"), 4), -1, 1)
    with np.errstate(all="ignore"):
        out["ndvi"] = np.median([out[f"ndvi_{h + 1}"] for h in range(nom.HEADS)], axis=0)
    out["heading_deg"] = np.round(d.heading_deg, 3)
    out["pitch_deg"] = np.round(d.pitch_deg + 0.1 * rng.normal(size=rows), 3)
    out["roll_deg"] = np.round(d.roll_deg + 0.1 * rng.normal(size=rows), 3)
    out["supply_v"] = np.round(d.supply_v + 0.05 * rng.normal(size=rows), 3)
    east = np.cumsum(d.speed_mps * np.sin(np.radians(d.heading_deg))) * d.row_s
    north = np.cumsum(d.speed_mps * np.cos(np.radians(d.heading_deg))) * d.row_s
    fresh = np.arange(rows) // noises["gnss"].fresh_rows * noises["gnss"].fresh_rows
    out["lat_deg"] = np.round(40.0 + (north + 0.02 * rng.normal(size=rows))[fresh] / 111_030.0, 9)
    out["lon_deg"] = np.round(116.0 + (east + 0.02 * rng.normal(size=rows))[fresh] / 85_390.0, 9)
    out["fix_quality"], out["satellites"] = np.full(rows, 4.0), np.full(rows, 14.0)
    out["hdop"] = np.full(rows, 0.7)
    out["speed_used_mps"] = np.where(
        np.isnan(out["speed_mps"]), out["wheel_speed_mps"], out["speed_mps"]
    )
    out["target_rate_kg_ha"], out["nudge_percent"] = d.rate_kg_ha.copy(), np.zeros(rows)
    out["shaft_rpm_cmd"], out["opening_mm_cmd"] = d.shaft_rpm_cmd.copy(), d.opening_mm_cmd.copy()
    out["flow_trim"] = np.ones(rows)
    flow = nom.FLOW_G_PER_REV_MM / 1000.0 * out["opening_mm"] * out["shaft_rpm"] / 60.0
    v = out["speed_used_mps"]
    with np.errstate(all="ignore"):
        out["applied_rate_kg_ha"] = np.where(
            v > 0.3, np.round(flow * 1e4 / (nom.WIDTH_M * v), 3), 0.0
        )
    lag = nom.RESPONSE_S + nom.DROP_INTERCEPT_S + nom.DROP_SLOPE_S_PER_RPM * d.shaft_rpm_cmd
    out["lag_s"], out["lag_m"] = np.round(lag, 4), np.round(lag * np.nan_to_num(v), 4)
    standing = (d.speed_mps < 0.05) & (d.time_s > 10.0)
    out["state"] = np.where(d.time_s < 4.0, "ready", np.where(standing, "held", "working")).astype(
        object
    )
    out["strategy"] = np.where(d.speed_first, "speed_first", "opening_first").astype(object)
    out["target_source"] = np.full(rows, "map", dtype=object)
    out["events"] = np.full(rows, "", dtype=object)
    if d.refill_row is not None:
        out["events"][d.refill_row] = f"refill {d.refill_kg:.1f}"
    return out
