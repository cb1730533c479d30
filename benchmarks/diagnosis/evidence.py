"""What the peers are given: a run's residuals and the traces of all effects, as a small linear problem.

Generous to the peers on purpose: residuals and traces come from the simulator that made the cases, with nominal
figures, so that a peer has no modelling error of its own to fight.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from hidden import nominal as nom
from hidden.nominal import IDS, Effect, Physics
from hidden.plant import Plant
from hidden.programmes import PROGRAMMES, Drive
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

Floats = npt.NDArray[np.float64]
VARIABLES = ("time_s", "pitch_deg", "roll_deg", "supply_v", "heading_deg", "speed_mps", "shaft_rpm_cmd",
             "opening_mm_cmd")
CHANNELS = ("shaft", "gate", "scale", "speed", "heads")


class Evidence(NamedTuple):
    """`target` (m,), `traces` (effects, m), `nuisances` (k, m): whitened and rotated to m coordinates that hold all
    there is to know for linear fits; `rest`: squared length of the residual outside of them, `rows` behind it."""

    effects: tuple[Effect, ...]
    target: Floats
    traces: Floats
    nuisances: Floats
    moved: Floats                 # (k,) how far each nuisance was moved already, in prior s.d.
    rest: float
    rows: int
    features: Floats              # for the forest


def drive_of(columns: dict[str, Any]) -> Drive:
    """The drive as far as a log tells it."""
    t = columns["time_s"]
    row_s = float(np.round(np.median(np.diff(t)), 3))
    refill = [(k, float(e.split()[1])) for k, e in enumerate(columns["events"]) if e.startswith("refill")]
    pour = np.zeros(t.size)
    row, kg = refill[0] if refill else (None, 0.0)
    if row is not None:
        span = slice(max(0, row - int(20 / row_s)), row)
        pour[span] = kg / ((span.stop - span.start) * row_s)
    speed = columns["wheel_speed_mps"]
    return Drive(PROGRAMMES[0], t, row_s, columns["shaft_rpm_cmd"] > 0, _smooth(speed, row_s), columns["heading_deg"],
                 columns["pitch_deg"], columns["roll_deg"], columns["supply_v"], columns["target_rate_kg_ha"],
                 columns["shaft_rpm_cmd"], columns["opening_mm_cmd"], columns["strategy"] == "speed_first",
                 _filled(columns["ndvi"]), float(columns["hopper_kg"][0]), pour, row, kg)


def _smooth(speed_mps: Floats, row_s: float) -> Floats:
    """Mean over 1.5 s: a speed that carried its own noise would look like a latency of the other sensor."""
    width = 2 * round(0.75 / row_s) + 1
    return uniform_filter1d(_filled(speed_mps), width)


def _filled(x: Floats) -> Floats:
    good = np.isfinite(x)
    return np.interp(np.arange(x.size), np.flatnonzero(good), x[good])


def tried(drive: Drive) -> tuple[Effect, ...]:
    """Every id that a run can show, at its first guess; where an onset matters, three of them."""
    end = float(drive.time_s[-1])
    out = []
    for name, kind in IDS.items():
        if "run" not in kind.seen or (name == "flow.batch" and not drive.refill_kg):
            continue
        onsets: tuple[float | None, ...] = (None,)
        if name in ("shaft.stall", "gate.stuck", "flow.blocked_outlet"):
            onsets = (0.3 * end, 0.5 * end, 0.7 * end)
        for onset in onsets:
            members = range(1, nom.HEADS + 1) if name == "canopy.head_fouled" else (1,)
            out.extend(Effect(name, kind.guess, 0, 0.5, onset, member, 1) for member in members)
    return tuple(out)


def poured(columns: dict[str, Any]) -> npt.NDArray[np.bool_]:
    """Rows about a refill, where the scale tells of the filling and of nothing else."""
    t = columns["time_s"]
    out = np.zeros(t.size, bool)
    for k, event in enumerate(columns["events"]):
        if event.startswith("refill"):
            out |= (t > t[k] - 60.0) & (t < t[k] + 2.0)
    return out


def _stack(readings: dict[str, Floats], fresh: dict[str, int], weighed: npt.NDArray[np.bool_]) -> list[Floats]:
    heads = readings["heads"][:, ::fresh["heads"]]
    return [readings["shaft"], readings["gate"], readings["scale"][weighed],
            (readings["wheel"] - readings["gnss"])[::fresh["gnss"]], (heads - heads.mean(axis=0)).ravel()]


def evidence(columns: dict[str, Any]) -> Evidence:
    """The linear problem of one run. Whitening: one AR(1) a channel, fitted to its residual."""
    plant = Plant(drive_of(columns))
    seen = {"shaft": columns["shaft_rpm"], "gate": columns["opening_mm"], "scale": columns["hopper_kg"],
            "wheel": columns["wheel_speed_mps"], "gnss": columns["speed_mps"],
            "heads": np.array([columns[f"ndvi_{k + 1}"] for k in range(nom.HEADS)])}
    seen = {k: np.array([_filled(r) for r in v]) if v.ndim == 2 else _filled(v) for k, v in seen.items()}
    fresh = {"gnss": _held(columns["speed_mps"]), "heads": _held(columns["ndvi_1"])}
    weighed = ~poured(columns)
    after = _after_refill(plant.drive)[weighed]
    keys = tuple(seen)
    around = Physics()
    for _ in range(3):                                       # tolerances are not quite linear: fitted, then afresh
        base = plant.run(around)
        target = _stack({k: seen[k] - base[k] for k in keys}, fresh, weighed)
        models = [_model(part) for part in target]

        def white(parts: list[Floats], models: list[tuple[float, float]] = models) -> Floats:
            return np.concatenate([lfilter([1, -phi], [1], p) / sd for p, (phi, sd) in zip(parts, models, strict=True)])

        def trace(physics: Physics, effects: tuple[Effect, ...] = (), base: dict[str, Floats] = base) -> Floats:
            moved = plant.run(physics, effects)
            return white(_stack({k: moved[k] - base[k] for k in keys}, fresh, weighed))

        nuisances = [trace(around._replace(**{k: getattr(around, k) + sd})) for k, sd in nom.TOLERANCE.items()]
        nuisances.extend(trace(around._replace(heads_ratio=tuple(1.0 + nom.HEAD_TOLERANCE * (h == m)
                                                                for h in range(nom.HEADS)))) for m in range(nom.HEADS))
        blank = [np.zeros_like(part) for part in target]
        levels = [50.0 * np.ones(target[2].size), 50.0 * after]
        nuisances.extend(white([*blank[:2], level, *blank[3:]]) for level in levels)
        y, j = white(target), np.array(nuisances)
        theta = np.linalg.solve(j @ j.T + np.eye(len(j)), j @ y)
        last, around = around, _moved(around, theta)
    p = last
    effects = tried(plant.drive)
    rows = [trace(p, (e,)) for e in effects]
    kept = [k for k, r in enumerate(rows) if r @ r > 1e-12]
    x = np.array([rows[k] for k in kept])
    q, _ = np.linalg.qr(np.vstack([x, j]).T)
    small = q.T @ y
    moved = np.zeros(len(nuisances))
    for k, (name, sd) in enumerate(nom.TOLERANCE.items()):
        moved[k] = (getattr(p, name) - getattr(Physics(), name)) / sd
    return Evidence(tuple(effects[k] for k in kept), small, x @ q, j @ q, moved, float(y @ y - small @ small), y.size,
                    _features(target, columns, fresh, models))


def _moved(p: Physics, theta: Floats) -> Physics:
    """The machine after a step of its tolerances, at most three standard deviations from nominal."""
    start = Physics()
    moved = {k: float(np.clip(getattr(p, k) + sd * t, getattr(start, k) - 3 * sd, getattr(start, k) + 3 * sd))
             for (k, sd), t in zip(nom.TOLERANCE.items(), theta, strict=False)}
    return p._replace(**moved)


def _held(x: Floats) -> int:
    """How many rows a reading is held."""
    changes = np.flatnonzero(np.diff(_filled(x)) != 0)
    return max(1, int(np.median(np.diff(changes)))) if changes.size > 2 else 1


def _after_refill(d: Drive) -> Floats:
    return (np.arange(d.time_s.size) >= (d.refill_row if d.refill_row is not None else d.time_s.size)).astype(float)


def _model(residual: Floats) -> tuple[float, float]:
    d = residual - np.median(residual)
    phi = float(np.clip(np.corrcoef(d[1:], d[:-1])[0, 1], 0.0, 0.995)) if d.std() > 0 else 0.0
    innovation = d[1:] - phi * d[:-1]
    return phi, max(1e-9, 1.4826 * float(np.median(np.abs(innovation))), 0.3 * float(innovation.std()))


def _features(target: list[Floats], columns: dict[str, Any], fresh: dict[str, int],
              models: list[tuple[float, float]]) -> Floats:
    """Spread, persistence and correlation with every variable, channel by channel."""
    out = []
    steps = (1, 1, 1, fresh["gnss"])
    for part, (phi, sd), step in zip(target[:4], models[:4], steps, strict=True):
        y = np.diff(part[::20]) if part is target[2] else part
        out += [phi, np.log(sd), np.log(part.std() + 1e-9), float(np.tanh(part.mean() / (part.std() + 1e-9)))]
        for name in VARIABLES:
            v = _filled(columns[name])[::step][:part.size]
            v = np.interp(np.linspace(0, 1, y.size), np.linspace(0, 1, v.size), v) if part is target[2] else v
            out.append(float(np.corrcoef(y, v)[0, 1]) if y.std() > 0 and v.std() > 1e-9 else 0.0)
    heads = target[4].reshape(nom.HEADS, -1).mean(axis=1)
    return np.r_[np.nan_to_num(out), np.sort(heads)[[0, -1]] / (heads.std() + 1e-9), heads.std()]
