"""Drives of other machines: a motor with an encoder, its command, its speed and its supply.

Nothing of the program is imported. A machine is drawn (full speed, lag, dead time, noise), then
what is wrong with it, in one of several mathematical forms, with a detectability z that is
log-uniform.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

Floats = npt.NDArray[np.float64]
# Fine steps a row.
FINE = 16
# Least and largest detectability: length of an effect's trace in units of the noise, what
# tolerances can say projected out.
Z_ENDS = (4.0, 60.0)
# Cosine of two traces from which the data do not tell them apart, as in tests/diagnosis/hidden.
EQUAL = 0.99
SHARES = {"none": 0.35, "single": 0.5, "outside": 0.15}
# Unit of a size, and its first guess as a share of full speed, of the time constant, or in %.
IDS = {
    "shaft.gain": ("%", 1.0),
    "shaft.slow": ("s", 0.01),
    "shaft.dead_time": ("s", 0.01),
    "shaft.dead_zone": ("r/min", 5.0),
    "shaft.saturation": ("% lost at full speed", 1.0),
    "shaft.voltage_sag": ("% lost per V", 0.5),
}
SIGNED = ("shaft.gain",)
OUTSIDE = "x.hump"


class Drive(NamedTuple):
    """One drawn machine on one drawn command."""

    full_rpm: float
    tau_s: float
    dead_s: float
    noise_rpm: float
    nominal_v: float
    row_s: float
    command_rpm: Floats
    supply_v: Floats


class Made(NamedTuple):
    """A case: columns of its log, text of its machine file, truth, columns of another run."""

    columns: dict[str, Floats]
    machine: str
    truth: dict[str, Any]
    other: dict[str, Floats]


def draw_drive(rng: np.random.Generator, like: Drive | None = None) -> Drive:
    """Returns a machine with a command of held steps, half of them small. like : another run of
    this machine."""
    full = float(rng.uniform(200.0, 3000.0))
    drive = Drive(
        full,
        float(rng.uniform(0.05, 0.4)),
        float(rng.uniform(0.02, 0.12)),
        full * float(rng.uniform(0.002, 0.008)),
        float(rng.choice([7.4, 12.0, 24.0])),
        float(rng.choice([0.02, 0.05])),
        np.empty(0),
        np.empty(0),
    )
    drive = drive if like is None else like
    rows = int(rng.uniform(120.0, 240.0) / drive.row_s)
    steps, left = [], rows
    level = 0.5
    while left > 0:
        held = min(left, int(rng.uniform(0.5, 4.0) / drive.row_s))
        level = (
            float(np.clip(level + rng.normal(0.0, 0.1), 0.08, 0.95))
            if rng.random() < 0.5
            else float(rng.uniform(0.08, 0.95))
        )
        steps.append(np.full(held, level))
        left -= held
    supply = drive.nominal_v * (1.0 - 0.1 * np.cumsum(rng.normal(size=rows)) / np.sqrt(rows))
    return drive._replace(command_rpm=np.concatenate(steps) * drive.full_rpm, supply_v=supply)


def simulate(drive: Drive, off: dict[str, float], form: int) -> Floats:
    """Returns the speed at each row (rows,), r/min. off : size by id, or by name of a tolerance
    (ratio, tau_s, dead_s)."""
    full, u = drive.full_rpm, np.repeat(drive.command_rpm, FINE)
    supply = np.repeat(drive.supply_v, FINE)
    zone, lost = off.get("shaft.dead_zone", 0.0), off.get("shaft.saturation", 0.0) / 100.0
    u = np.maximum(0.0, u - zone) if form % 2 else np.where(u > zone, u - zone, 0.0)
    u = u - lost * full * (u / full) ** (2 if form % 3 else 3)
    u = u * (1.0 + off.get("shaft.gain", 0.0) / 100.0) * (1.0 + off.get("ratio", 0.0))
    u = u * (1.0 - off.get("shaft.voltage_sag", 0.0) / 100.0 * (drive.nominal_v - supply))
    u = u + off.get(OUTSIDE, 0.0) * np.sin(2.0 * np.pi * u / (0.35 * full))
    step = drive.row_s / FINE
    dead = (drive.dead_s + off.get("shaft.dead_time", 0.0) + off.get("dead_s", 0.0)) / step
    at = np.maximum(0.0, np.arange(len(u)) - dead)
    u = np.interp(at, np.arange(len(u)), u)
    tau = max(1e-3, drive.tau_s + off.get("shaft.slow", 0.0) + off.get("tau_s", 0.0))
    keep = np.exp(-step / tau)
    speed, _ = lfilter([1.0 - keep], [1.0, -keep], u, zi=[keep * u[0]])
    return np.r_[u[0], speed[FINE - 1 : -1 : FINE]]


def calc_tolerances(drive: Drive) -> dict[str, float]:
    """Returns 1 s.d. of what a machine within its tolerances is off, by name."""
    return {"ratio": 0.005, "tau_s": 0.1 * drive.tau_s, "dead_s": 0.005}


class Seen(NamedTuple):
    """What a difference shows against noise and tolerances."""

    drive: Drive
    base: Floats
    tolerances: Floats

    def whiten(self, off: dict[str, float], form: int) -> Floats:
        """Returns the trace in units of the noise, tolerances projected out under their prior."""
        d = (simulate(self.drive, off, form) - self.base) / self.drive.noise_rpm
        t = self.tolerances
        # Square root of (1 + t t') ^ -1 along the span of t.
        values, vectors = np.linalg.eigh(t.T @ t)
        share = (1.0 - 1.0 / np.sqrt(1.0 + values)) / np.maximum(values, 1e-12)
        return np.asarray(d - t @ (vectors * share) @ (vectors.T @ (t.T @ d)))


def see(drive: Drive) -> Seen:
    """Returns the drive as its nominal machine sees it."""
    base = simulate(drive, {}, 0)
    traces = [
        (simulate(drive, {name: sd}, 0) - base) / drive.noise_rpm
        for name, sd in calc_tolerances(drive).items()
    ]
    return Seen(drive, base, np.array(traces).T)


def make_drive_case(rng: np.random.Generator) -> Made:
    """Returns one case of a drawn machine."""
    drive = draw_drive(rng)
    seen = see(drive)
    category = str(rng.choice(list(SHARES), p=list(SHARES.values())))
    form = int(rng.integers(12))
    off = {name: sd * float(rng.normal()) for name, sd in calc_tolerances(drive).items()}
    name = {"none": "", "outside": OUTSIDE}.get(category, str(rng.choice(list(IDS))))
    z, size = 0.0, 0.0
    if name:
        wanted = float(np.exp(rng.uniform(*np.log(Z_ENDS))))
        size = IDS.get(name, ("r/min", 1.0))[1]
        sign = float(rng.choice([-1.0, 1.0])) if name in SIGNED else 1.0
        for _ in range(12):
            z = float(np.linalg.norm(seen.whiten({name: sign * size}, form)))
            size *= float(np.clip(wanted / max(z, 1e-9), 0.1, 10.0))
        size = sign * size
        z = float(np.linalg.norm(seen.whiten({name: size}, form)))
        off[name] = size
    equal = []
    if name in IDS:
        mine = seen.whiten({name: size}, form)
        for other, (_, guess) in IDS.items():
            its = seen.whiten({other: guess}, 1)
            like = float(mine @ its / (np.linalg.norm(mine) * np.linalg.norm(its)))
            if other != name and (abs(like) if other in SIGNED else like) > EQUAL:
                equal.append(other)
    causes = (
        [{"id": name, "size": size, "z": z, "equal": equal, "size_defined": True}]
        if name in IDS
        else []
    )
    other = draw_drive(rng, drive)
    return Made(
        _write_columns(drive, simulate(drive, off, form), rng),
        format_machine(drive),
        {"category": category, "causes": causes, "z_outside": z if name == OUTSIDE else None},
        _write_columns(other, simulate(other, off, form), rng),
    )


def _write_columns(drive: Drive, speed: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    rows = len(speed)
    return {
        "time_s": np.round(np.arange(rows) * drive.row_s, 3),
        "shaft_rpm_cmd": np.round(drive.command_rpm, 2),
        "shaft_rpm": np.round(speed + drive.noise_rpm * rng.normal(size=rows), 2),
        "supply_v": np.round(drive.supply_v + 0.02 * rng.normal(size=rows), 3),
    }


def format_machine(drive: Drive) -> str:
    """Returns the machine file: what a data sheet says, and no more."""
    full = f"{drive.full_rpm:.6g}"
    return f"""format: topdress-machine/1
id: drive
shaft:
  dead_time_s: {drive.dead_s:.6g}
  time_constant_s: {drive.tau_s:.6g}
  acceleration_rpm_s: 1000000.0
  nominal_supply_v: {drive.nominal_v:.6g}
  full_rpm: {full}
flow: {{full_rpm: {full}}}
fall: {{full_rpm: {full}}}
limits: {{shaft_low_rpm: 0.0, shaft_high_rpm: {full}}}
set_points: {{shaft_rpm: {0.5 * drive.full_rpm:.6g}}}
noise: {{shaft_rpm: {drive.noise_rpm:.6g}, supply_v: 0.02}}
tolerance:
  shaft_percent: 0.5
  dead_time_s: 0.005
  time_constant_s: {0.1 * drive.tau_s:.6g}
"""
