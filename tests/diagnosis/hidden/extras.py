"""Columns beyond the standard ones: what a tractor's bus tells besides. At most one of them is
to blame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .programmes import Drive

Floats = npt.NDArray[np.float64]


class Column(NamedTuple):
    """Usual middle and spread of a column, its resolution, and the stages (terms.STAGES) that
    it could well drive."""

    middle: float
    spread: float
    step: float
    drives: tuple[str, ...] = ()


KNOWN: dict[str, Column] = {
    "engine_torque_nm": Column(310.0, 60.0, 1.0, ("y.wheel",)),
    "drawbar_force_kn": Column(11.0, 3.0, 0.1, ("y.wheel",)),
    "engine_load_percent": Column(55.0, 14.0, 0.4, ("y.shaft", "y.wheel")),
    "engine_speed_rpm": Column(1850.0, 90.0, 1.0, ("y.shaft",)),
    "hydraulic_pressure_bar": Column(165.0, 12.0, 0.5, ("y.shaft", "y.gate")),
    "oil_temperature_c": Column(62.0, 9.0, 0.5, ("y.shaft",)),
    "motor_current_a": Column(8.0, 2.5, 0.05, ("y.gate",)),
    "ambient_temperature_c": Column(17.0, 4.0, 0.1, ("y.flow", "y.scale")),
    "relative_humidity_percent": Column(58.0, 12.0, 0.5, ("y.flow",)),
    "product_temperature_c": Column(21.0, 4.0, 0.1, ("y.flow",)),
    "vibration_mps2": Column(3.2, 1.1, 0.01, ("y.flow", "y.scale")),
    "fan_speed_rpm": Column(3400.0, 180.0, 1.0, ("y.scale", "y.flow")),
    "wind_speed_mps": Column(3.6, 1.6, 0.1, ("y.scale",)),
    "tyre_pressure_bar": Column(1.6, 0.08, 0.01, ("y.wheel",)),
    "soil_moisture_percent": Column(24.0, 5.0, 0.1, ("y.wheel",)),
    "fuel_rate_l_h": Column(13.0, 3.0, 0.05),
    "coolant_temperature_c": Column(84.0, 3.0, 0.5),
    "pto_speed_rpm": Column(540.0, 12.0, 1.0),
    "cab_pressure_pa": Column(48.0, 5.0, 0.5),
    "can_bus_load_percent": Column(31.0, 4.0, 0.1),
}
LIKE = ("wander", "gusts", "held", "place", "speed", "time", "noise")
# those of a cause: not just the clock, nor another column
_DRIVING = ("wander", "gusts", "held", "place")


class Extra(NamedTuple):
    """One column as it truly is and as the log tells it (rows,)."""

    name: str
    like: str
    true: Floats
    told: Floats


def dealt(drive: Drive, count: int, rng: np.random.Generator, cause: bool) -> list[Extra]:
    """`count` columns; with `cause` the first of them is one that could drive a stage."""
    able = [n for n, c in KNOWN.items() if c.drives]
    first = [str(rng.choice(able))] if cause else []
    names = [*first, *(str(n) for n in rng.permutation([n for n in KNOWN if n not in first]))][
        :count
    ]
    return [
        _column(n, drive, rng, str(rng.choice(_DRIVING if cause and k == 0 else LIKE)))
        for k, n in enumerate(names)
    ]


def again(one: Extra, drive: Drive, rng: np.random.Generator) -> Extra:
    """The same column on another drive."""
    return _column(one.name, drive, rng, one.like)


def _column(name: str, drive: Drive, rng: np.random.Generator, like: str) -> Extra:
    known, t = KNOWN[name], drive.time_s
    true = known.middle + known.spread * _unit(like, drive, rng)
    # a bus tells it now and then
    every = max(1, round(float(rng.choice([0.0, 0.1, 1.0])) / drive.row_s))
    rows = np.arange(t.size) // every * every
    noisy = true[rows] + 0.03 * known.spread * rng.normal(size=t.size)[rows]
    return Extra(name, like, true, np.round(np.round(noisy / known.step) * known.step, 4))


def _unit(like: str, d: Drive, rng: np.random.Generator) -> Floats:
    """A signal (rows,) of mean 0 and spread 1."""
    t = d.time_s
    if like == "wander":
        x = _wander(t, float(rng.uniform(20.0, 200.0)), rng)
    elif like == "gusts":
        x = _wander(t, float(rng.uniform(3.0, 15.0)), rng) + 0.5 * _wander(t, 60.0, rng)
    elif like == "held":
        edges = np.cumsum(rng.uniform(8.0, 70.0, int(t[-1] / 20.0) + 9)) + t[0]
        x = rng.normal(size=edges.size + 1)[np.searchsorted(edges, t)]
    elif like == "place":
        far = np.cumsum(d.speed_mps) * d.row_s
        x = _wander(far, float(rng.uniform(10.0, 60.0)), rng)
    elif like == "speed":
        x = d.speed_mps + 0.3 * d.speed_mps.std() * _wander(t, 30.0, rng)
    elif like == "time":
        x = t / max(t[-1], 1.0) * float(rng.choice([-1, 1])) + 0.08 * _wander(t, 90.0, rng)
    else:
        x = rng.normal(size=t.size)
    return np.asarray((x - x.mean()) / max(x.std(), 1e-9))


def _wander(at: Floats, correlation: float, rng: np.random.Generator) -> Floats:
    """Smooth random values over `at` (seconds or metres): knots every `correlation`,
    half-cosines between them."""
    x = (at - at[0]) / correlation
    knots = rng.normal(size=int(x[-1]) + 3)
    k = x.astype(int)
    f = 0.5 - 0.5 * np.cos(np.pi * (x - k))
    return np.asarray(knots[k] * (1.0 - f) + knots[k + 1] * f)
