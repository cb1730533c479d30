"""What the peers are given: a run's residuals and the traces of all effects, as a small linear problem.

Generous to the peers on purpose: residuals and traces come from the simulator that made the cases, with nominal
figures, so that a peer has no modelling error of its own to fight. Whitened with the noise model of the diagnosis (two
components over a rounding floor, fitted by band in the cosine domain), or not at all: the same figure everywhere.
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

from control.diagnosis.judgement import noise as noises

Floats = npt.NDArray[np.float64]
CHANNELS = ("shaft", "gate", "scale", "speed", "heads")
SD = {"shaft": 0.3, "gate": 0.1, "scale": 0.15, "speed": 0.036, "heads": 0.009}
FAST_S = {"shaft": 0.1, "gate": 0.1, "scale": 1.0, "speed": 0.2, "heads": 0.2}
ROUNDS = 3                        # of noise and fit in turn
SETTLED = 3                       # times that the tolerances are fitted and the traces taken anew
FEW = 0.05                        # share of repeated readings, up to which a repetition is a dropout


class Linear(NamedTuple):
    """`target` (m,), `traces` (effects, m), `nuisances` (k, m), rotated to m coordinates that hold all there is to know
    for linear fits; `rest`: squared length of the residual outside of them."""

    target: Floats
    traces: Floats
    nuisances: Floats
    rest: float


class Evidence(NamedTuple):
    """A run's residuals and what every effect would do to them; `white` by the noise model, `plain` without one."""

    effects: tuple[Effect, ...]
    white: Linear
    plain: Linear
    moved: Floats                 # (k,) how far each nuisance was moved already, in prior s.d.
    rows: int


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


def _stack(readings: dict[str, Floats], fresh: dict[str, int], weighed: npt.NDArray[np.bool_]) -> dict[str, Floats]:
    """Series by channel, (series, samples): fresh samples only, the filling of the hopper left out."""
    heads = readings["heads"][:, ::fresh["heads"]]
    return {"shaft": readings["shaft"][None], "gate": readings["gate"][None], "scale": readings["scale"][None, weighed],
            "speed": (readings["wheel"] - readings["gnss"])[None, ::fresh["gnss"]], "heads": heads - heads.mean(axis=0)}


class _Bands:
    """One channel in the cosine domain: band products of the residual (row 0), the traces and the nuisances."""

    def __init__(self, name: str, rows: list[Floats], step_s: float) -> None:
        """`rows`: series (heads or 1, samples) each, in the order of the whole problem."""
        self.step_s = step_s
        self.series = len(rows[0])
        self.cut = noises.segments(rows[0].shape[1])
        self.prior = noises.NoisePrior(SD[name], FAST_S[name], _step(rows[0]) / 12.0**0.5)
        self.noise = noises.start(self.prior)
        self.gram = np.zeros((len(self.cut.starts), len(rows), len(rows)))
        for k in range(self.series):
            stack = np.stack([noises.coefficients(row[k], self.cut) for row in rows])
            self.gram += noises.band_products(stack, stack, self.cut)

    def normal(self, whitened: bool) -> Floats:
        """Sums of products of all rows, in units of the noise of each band, or of the mean noise of all."""
        strength = noises.spectrum(np.array(self.noise.theta), self.prior, self.cut, self.step_s)
        if not whitened:
            strength = np.full(len(strength), float(strength @ self.cut.members / self.cut.members.sum()))
        return np.asarray(np.tensordot(1.0 / strength, self.gram, axes=1))

    def refit(self, amplitudes: Floats) -> None:
        """Noise of what the rows after the first leave of it at these amplitudes."""
        weights = np.r_[1.0, -amplitudes]
        power = np.einsum("bij,i,j->b", self.gram, weights, weights, optimize=True) / self.series
        self.noise = noises.fit(np.maximum(power, 1e-300), self.noise, self.prior, self.cut, self.step_s)


def _step(series: Floats) -> float:
    """Resolution of the numbers: the smallest difference between two of them."""
    kinds = np.unique(np.round(np.diff(series[0][:4000]), 6))
    return float(np.min(np.abs(kinds[kinds != 0.0]), initial=1e-3))


def _fitted(bands: list[_Bands], trust: Floats, towards: Floats) -> Floats:
    """Amplitudes of all rows after the first, noise and fit in turn. `trust`, `towards`: priors' precision and mean."""
    amplitudes = np.zeros(len(trust))
    for _ in range(ROUNDS):
        normal = sum(b.normal(True) for b in bands)
        amplitudes = np.linalg.solve(normal[1:, 1:] + np.diag(trust + 1e-9 * np.diag(normal)[1:] + 1e-12),
                                     normal[1:, 0] + trust * towards)
        for b in bands:
            b.refit(amplitudes)
    return amplitudes


def _linear(bands: list[_Bands], effects: int, whitened: bool) -> Linear:
    """The rows rotated to as many coordinates as there are rows after the first."""
    normal = sum(b.normal(whitened) for b in bands)
    order = np.r_[1:len(normal), 0]
    scale = np.sqrt(np.diag(normal)[order]) + 1e-12
    ratio = normal[np.ix_(order, order)] / np.outer(scale, scale)
    root = np.linalg.cholesky(ratio + 1e-10 * np.eye(len(order))).T * scale
    rows = root[:-1].T
    return Linear(rows[-1], rows[:effects], rows[effects:-1], float(root[-1, -1] ** 2))


def evidence(columns: dict[str, Any]) -> Evidence:
    """The linear problem of one run, tolerances settled first, for they are not quite linear."""
    plant = Plant(drive_of(columns))
    seen = {"shaft": columns["shaft_rpm"], "gate": columns["opening_mm"], "scale": columns["hopper_kg"],
            "wheel": columns["wheel_speed_mps"], "gnss": columns["speed_mps"],
            "heads": np.array([columns[f"ndvi_{k + 1}"] for k in range(nom.HEADS)])}
    fresh = {"gnss": _held(columns["speed_mps"]), "heads": _held(columns["ndvi_1"])}
    weighed = ~poured(columns)
    row_s = plant.drive.row_s
    steps = {"speed": row_s * fresh["gnss"], "heads": row_s * fresh["heads"]}

    known = {k: np.array([_told(r) for r in np.atleast_2d(v)]) for k, v in seen.items()}

    def changed(readings: dict[str, Floats], base: dict[str, Floats]) -> dict[str, Floats]:
        return _stack({k: readings[k] - base[k] for k in seen}, fresh, weighed)

    def left(base: dict[str, Floats]) -> dict[str, Floats]:
        """Residual where something was read, straight lines over what was not."""
        rows = {k: np.array([_bridged(r, told) for r, told in zip(np.atleast_2d(seen[k] - base[k]), known[k],
                                                                  strict=True)]) for k in seen}
        return _stack({k: r if k == "heads" else r[0] for k, r in rows.items()}, fresh, weighed)

    def banded(rows: list[dict[str, Floats]]) -> list[_Bands]:
        return [_Bands(c, [row[c] for row in rows], steps.get(c, row_s)) for c in CHANNELS]

    around = Physics()
    moved = np.zeros(len(nom.TOLERANCE) + nom.HEADS + 2)
    for last in (*[False] * SETTLED, True):
        base = plant.run(around)
        nuisances = [changed(plant.run(p), base) for p in _off_nominal(around)]
        nuisances += _levels(nuisances[0], _after_refill(plant.drive)[weighed])
        target = left(base)
        if not last:
            theta = _fitted(banded([target, *nuisances]), np.ones(len(moved)), -moved)
            around = _moved(around, theta)
            moved[:len(nom.TOLERANCE)] = [(getattr(around, k) - getattr(Physics(), k)) / sd
                                          for k, sd in nom.TOLERANCE.items()]
    effects, traces = [], []
    for effect in tried(plant.drive):
        trace = changed(plant.run(around, (effect,)), base)
        if any(one.any() for one in trace.values()):
            effects.append(effect)
            traces.append(trace)
    bands = banded([target, *traces, *nuisances])
    _fitted(bands, np.r_[np.zeros(len(traces)), np.ones(len(moved))], np.r_[np.zeros(len(traces)), -moved])
    rows = sum(one.size for one in target.values())
    return Evidence(tuple(effects), _linear(bands, len(traces), True), _linear(bands, len(traces), False), moved, rows)


def _off_nominal(around: Physics) -> list[Physics]:
    """The machine one standard deviation off in each tolerance."""
    heads = [around._replace(heads_ratio=tuple(1.0 + nom.HEAD_TOLERANCE * (h == m) for h in range(nom.HEADS)))
             for m in range(nom.HEADS)]
    return [*(around._replace(**{k: getattr(around, k) + sd}) for k, sd in nom.TOLERANCE.items()), *heads]


def _told(reading: Floats) -> npt.NDArray[np.bool_]:
    """Rows that hold a reading of their own: neither empty nor, in a column where that is rare, the last one again."""
    again = np.r_[False, reading[1:] == reading[:-1]] & (reading != 0.0)
    return np.isfinite(reading) & ~(again & (again.mean() < FEW))


def _bridged(series: Floats, told: npt.NDArray[np.bool_]) -> Floats:
    rows = np.arange(series.size)
    return np.interp(rows, rows[told], series[told])


def _levels(like: dict[str, Floats], after: Floats) -> list[dict[str, Floats]]:
    """The scale's unknown level, and that after a refill, per 50 kg."""
    blank = {name: np.zeros_like(series) for name, series in like.items()}
    return [{**blank, "scale": 50.0 * level[None]} for level in (np.ones_like(after), after)]


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
