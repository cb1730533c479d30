"""Residuals of each channel against the data sheet, and the trace of each named fault in them.

The peers of this folder stand on it: it is what any engineer would do first.

Nothing of the diagnosis is imported, nor its catalogue: the physics is written down again, in plain
formulas.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
import yaml
from scipy.signal import lfilter

Floats = npt.NDArray[np.float64]
# Fine step of a simulated drive, s.
STEP_S = 0.0125
# Window over which the flow is read off the scale, s.
WINDOW_S = 10.0
# Mean square from which a trace is there at all.
LEAST_POWER = 1e-9
# Faults that take away or add, never the other way: a size of the other sign is none of them.
ONE_SIGN = (
    *(f"shaft.{n}" for n in ("slow", "dead_time", "dead_band", "dead_zone", "saturation", "stall")),
    *(f"shaft.{n}" for n in ("voltage_sag", "load_droop")),
    *(f"gate.{n}" for n in ("backlash", "lost_steps", "slow", "stuck")),
    *(f"flow.{n}" for n in ("fill_falloff", "hopper_head", "blocked_outlet", "leak", "pulsation")),
    *("speed.wheel_slip", "speed.missed_pulses", "speed.gnss_latency", "canopy.saturation"),
    *("lag.rebound", "lag.first_fill"),
)
# What a machine file tolerates of a size, 1 s.d., where it says nothing.
TOLERANCES = {"gate.slow": 0.6, "gate.offset": 0.02}


class Channel(NamedTuple):
    """A residual (n,), the traces of faults of unit size in it, and the faults' tolerances."""

    name: str
    time_s: Floats
    left: Floats
    columns: dict[str, Floats]


class Fit(NamedTuple):
    """One fault alone, fitted by least squares. gain : of the log-likelihood, nats. share : of the
    residual's square."""

    size: float
    sd: float
    gain: float
    share: float


class Plain(NamedTuple):
    """A case as the peers see it."""

    kind: str
    channels: list[Channel]
    tolerances: dict[str, float]


def read_case(data: Path, machine: Path) -> Plain:
    """Returns residuals and traces of a run or of a bench table."""
    kind = (data.parent / "kind.txt").read_text(encoding="utf-8")
    columns = {name: values.to_numpy() for name, values in pd.read_csv(data).items()}
    columns = {n: x.astype(float) if x.dtype.kind in "if" else x for n, x in columns.items()}
    sheet = yaml.safe_load(machine.read_text(encoding="utf-8"))
    own = sheet.get("tolerance", {})
    tolerances = {
        **TOLERANCES,
        "shaft.gain": own.get("shaft_percent", 0.0),
        "shaft.dead_time": own.get("dead_time_s", 0.01),
        "shaft.slow": own.get("time_constant_s", 0.015),
        "gate.home_error": own.get("opening_mm", 0.0),
        "flow.gain": own.get("flow_percent", 0.0),
        "speed.wheel_radius": own.get("wheel_percent", 0.0),
        "canopy.head_fouled": own.get("head_percent", 0.0),
    }
    if kind == "run":
        return Plain(kind, _read_run(columns, sheet), tolerances)
    table = {"lag": _read_lag, "catch": _read_catch, "weigh": _read_weigh}.get(kind)
    if table is None:
        table = _read_heads if kind == "heads" else _read_place
    return Plain(kind, table(columns), tolerances)


def _fill(values: Floats) -> Floats:
    known = np.isfinite(values)
    return np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])


def _follow(time_s: Floats, command: Floats, dead_s: float, tau_s: float, slope: float) -> Floats:
    """Returns the answer at the rows: a held command, dead time, first-order lag with a limited
    slope, or, without a lag, the slope alone."""
    fine = np.arange(time_s[0], time_s[-1] + STEP_S, STEP_S)
    at = np.searchsorted(time_s, fine - dead_s, side="right") - 1
    aim = command[np.maximum(at, 0)]
    keep = float(np.exp(-STEP_S / tau_s)) if tau_s > 0.0 else 0.0
    if slope > 1e5:
        out, _ = lfilter([1.0 - keep], [1.0, -keep], aim, zi=[keep * aim[0]])
    else:
        most, now, found = slope * STEP_S, float(aim[0]), []
        for wanted in aim.tolist():
            move = (wanted - now) * (1.0 - keep)
            now += most if move > most else -most if move < -most else move
            found.append(now)
        out = np.array(found)
    return np.interp(time_s, fine + STEP_S, out)


def _read_run(c: dict[str, Any], sheet: dict[str, Any]) -> list[Channel]:
    time_s = c["time_s"]
    known = {
        name: _fill(values)
        for name, values in c.items()
        if values.dtype.kind == "f" and np.isfinite(values).sum() > 10
    }
    found = []
    if "shaft_rpm_cmd" in known and "shaft_rpm" in known:
        found.append(_read_shaft(time_s, known, sheet))
    if "opening_mm_cmd" in known and "opening_mm" in known:
        found.append(_read_gate(time_s, known, sheet))
    if {"hopper_kg", "shaft_rpm", "opening_mm"} <= set(known):
        found.append(_read_flow(time_s, known, sheet))
    if {"wheel_speed_mps", "speed_mps"} <= set(known):
        found.append(_read_speed(time_s, known))
    heads = [name for name in known if name.startswith("ndvi_")]
    if len(heads) > 2:
        found += _read_run_heads(time_s, np.array([known[name] for name in heads]))
    return found


def _read_shaft(t: Floats, c: dict[str, Floats], sheet: dict[str, Any]) -> Channel:
    shaft, full = sheet["shaft"], sheet["limits"]["shaft_high_rpm"]
    dead, tau = shaft["dead_time_s"], shaft["time_constant_s"]
    slope, command = shaft["acceleration_rpm_s"], c["shaft_rpm_cmd"]
    said = _follow(t, command, dead, tau, slope)
    low = (c["shaft_rpm"] < 0.02 * full) & (said > 0.1 * full)
    held = max(3, round(5.0 / max(1e-3, float(np.median(np.diff(t))))))
    stands = np.convolve(low, np.ones(held), mode="same") > held - 0.5
    later = _follow(t, command, dead + 0.02, tau, slope)
    slower = _follow(t, command, dead, 1.3 * tau, slope)
    columns = {
        "shaft.gain": said / 100.0,
        "shaft.dead_time": (later - said) / 0.02,
        "shaft.slow": (slower - said) / (0.3 * tau),
        "shaft.dead_band": -said * (said < 0.15 * full),
        "shaft.stall": -said * stands,
    }
    if not shaft.get("regulated"):
        columns["shaft.dead_zone"] = -(said > 0.0).astype(float)
        columns["shaft.saturation"] = -full * (said / full) ** 2 / 100.0
    if "supply_v" in c:
        columns["shaft.voltage_sag"] = -said * (shaft["nominal_supply_v"] - c["supply_v"]) / 100.0
    if "opening_mm" in c:
        columns["shaft.load_droop"] = -said * c["opening_mm"] / 6000.0
    return Channel("shaft", t, c["shaft_rpm"] - said, columns)


def _read_gate(t: Floats, c: dict[str, Floats], sheet: dict[str, Any]) -> Channel:
    gate, command = sheet["gate"], c["opening_mm_cmd"]
    said = _follow(t, command, gate["dead_time_s"], 0.0, gate["slew_mm_s"])
    slower = _follow(t, command, gate["dead_time_s"], 0.0, 0.85 * gate["slew_mm_s"])
    move = np.sign(np.diff(said, prepend=said[0]))
    last = np.maximum.accumulate(np.where(move != 0.0, np.arange(len(move)), 0))
    return Channel(
        "gate",
        t,
        c["opening_mm"] - said,
        {
            "gate.offset": np.ones(len(t)),
            "gate.backlash": -0.5 * move[last],
            "gate.lost_steps": -np.cumsum(np.abs(np.diff(said, prepend=said[0]))) / 100.0,
            "gate.slow": (slower - said) / (0.15 * gate["slew_mm_s"]),
            "gate.stuck": np.where(np.arange(len(t)) > len(t) // 2, said.mean() - said, 0.0),
        },
    )


def _read_flow(t: Floats, c: dict[str, Floats], sheet: dict[str, Any]) -> Channel:
    """The scale's level against what was metered, over windows of work, refills left out."""
    k = sheet["flow"]["grams_per_rev_mm"] / 1000.0 / 60.0
    edges = np.arange(t[0], t[-1], WINDOW_S)
    step = np.diff(t, prepend=t[0])

    def add_up(values: Floats) -> Floats:
        return np.diff(np.interp(edges, t, np.cumsum(values * step)))

    rpm, mm, level = c["shaft_rpm"], c["opening_mm"], c["hopper_kg"]
    smooth = np.convolve(np.pad(level, 2, mode="edge"), np.ones(5) / 5.0, mode="valid")
    lost = -np.diff(np.interp(edges, t, smooth))
    flow, middle = add_up(k * rpm * mm), 0.5 * (edges[1:] + edges[:-1])
    kept = (lost > -1.0) & (flow > 0.05)
    refill = float(middle[np.argmin(lost)]) if lost.min() < -5.0 else np.inf
    pitch = c.get("pitch_deg", np.zeros(len(t)))
    at_level = np.interp(middle, t, smooth)
    columns = {
        "flow.gain": flow / 100.0,
        "flow.zero_offset": add_up(rpm) / 60_000.0,
        "flow.fill_falloff": -add_up(k * rpm * mm * (rpm / 100.0) ** 2) / 100.0,
        "flow.hopper_head": -flow * (1.0 - at_level / 300.0) / 100.0,
        "flow.moisture_drift": flow * (middle - t[0]) / 360_000.0,
        "flow.leak": np.full(len(flow), WINDOW_S / 3600.0),
        "flow.slope": add_up(k * rpm * mm * pitch) / 100.0,
        "flow.blocked_outlet": -flow * (middle > np.median(t)) / 100.0,
        "scale.gain": flow / 100.0,
        "scale.drift": np.full(len(flow), -WINDOW_S / 3600.0),
        "scale.tilt": -np.diff(np.interp(edges, t, smooth * pitch)) / 100.0,
        "gate.offset": -add_up(k * rpm),
        "gate.home_error": add_up(k * rpm),
    }
    if np.isfinite(refill):
        columns["flow.batch"] = flow * (middle > refill) / 100.0

    def level_off(x: Floats) -> Floats:
        """The level's own series: changes have noise that the next change takes back."""
        summed = np.cumsum(x[kept])
        return np.asarray(summed - summed.mean())

    return Channel(
        "flow", middle[kept], level_off(lost - flow), {n: level_off(x) for n, x in columns.items()}
    )


def _read_speed(t: Floats, c: dict[str, Floats]) -> Channel:
    gnss, wheel = c["speed_mps"], c["wheel_speed_mps"]
    smooth = np.convolve(np.pad(gnss, 4, mode="edge"), np.ones(9) / 9.0, mode="valid")
    pitch = c.get("pitch_deg", np.zeros(len(t)))
    kept = gnss > 0.4
    columns = {
        "speed.wheel_radius": smooth / 100.0,
        "speed.wheel_slip": smooth * np.clip(1.0 + pitch / 5.0, 0.0, 3.0) / 100.0,
        "speed.missed_pulses": -smooth * (wheel < 0.8 * smooth) / 100.0,
        "speed.gnss_latency": np.gradient(smooth, t),
    }
    return Channel("speed", t[kept], (wheel - gnss)[kept], {n: x[kept] for n, x in columns.items()})


def _read_run_heads(t: Floats, heads: Floats) -> list[Channel]:
    """Each head against the median of all; heads give a value twice a second."""
    every = max(1, round(0.5 / max(1e-3, float(np.median(np.diff(t))))))
    some = heads[:, ::every]
    middle = np.median(some, axis=0)
    worst = int(np.argmax(np.abs((some / np.maximum(middle, 0.05)).mean(axis=1) - 1.0)))
    return [
        Channel("heads", t[::every], some[worst] - middle, {"canopy.head_fouled": middle / 100.0})
    ]


def _read_lag(c: dict[str, Any]) -> list[Channel]:
    rpm, rows = c["shaft_rpm"], np.arange(len(c["shaft_rpm"]), dtype=float)
    flat = np.ones(len(rpm))
    if "lag_s" not in c:
        left = c["response_s"] - 0.383
        return [Channel("lag", rows, left, {"shaft.dead_time": flat})]
    said = 0.383 + 1.8288 - 0.0083 * rpm
    columns = {
        "lag.offset": flat,
        "lag.speed_scale": said / 100.0,
        "lag.rebound": rpm / 100.0,
    }
    if "direction" in c:
        columns["lag.asymmetry"] = np.where(c["direction"] == "up", 0.0, 1.0)
    if "start" in c:
        columns["lag.first_fill"] = np.where(c["start"] == "empty", 1.0, 0.0)
    if "speed_kmh" in c:
        columns["lag.speed_scale"] = c["speed_kmh"] / 360.0
    return [Channel("lag", rows, c["lag_s"] - said, columns)]


def _read_catch(c: dict[str, Any]) -> list[Channel]:
    revs = c["shaft_rpm"] * c["duration_s"] / 60.0
    outlets = 6.0 if "outlet" in c else 1.0
    said = 0.0055 * revs * c["opening_mm"] / outlets
    columns = {
        "flow.gain": np.full(len(said), 0.01),
        "flow.zero_offset": revs / 1000.0 / outlets / said,
        "flow.fill_falloff": -((c["shaft_rpm"] / 100.0) ** 2) / 100.0,
        "flow.pulsation": np.sin(np.arange(len(said))) / 100.0,
    }
    left = c["mass_kg"] / said - 1.0
    if "outlet" in c:
        means = [left[c["outlet"] == n].mean() for n in range(1, 7)]
        worst = 1 + int(np.argmax(np.abs(means - np.median(means))))
        columns["flow.outlet_uneven"] = (c["outlet"] == worst) / 100.0
    return [Channel("catch", np.arange(len(said), dtype=float), left, columns)]


def _read_weigh(c: dict[str, Any]) -> list[Channel]:
    left = c["applied_kg"] / c["target_kg"] - 1.0
    flat = np.full(len(left), 0.01)
    columns = {
        "flow.gain": flat,
        "scale.gain": flat,
        "speed.wheel_radius": flat,
        "speed.wheel_slip": flat,
        "flow.zero_offset": 1.0 / c["target_kg"],
    }
    return [Channel("weigh", np.arange(len(left), dtype=float), left, columns)]


def _read_heads(c: dict[str, Any]) -> list[Channel]:
    said, left = c["ndvi_reference"], c["ndvi"] - c["ndvi_reference"]
    numbers = np.unique(c["head"])
    means = np.array([(left / said)[c["head"] == n].mean() for n in numbers])
    worst = numbers[int(np.argmax(np.abs(means - np.median(means))))]
    columns = {
        "canopy.head_fouled": said * (c["head"] == worst) / 100.0,
        "canopy.saturation": -said * np.maximum(0.0, said - 0.6) / 40.0,
    }
    if "warm_min" in c:
        columns["canopy.warm_up"] = said * np.exp(-c["warm_min"] / 5.0) / 100.0
    return [Channel("heads", np.arange(len(left), dtype=float), left, columns)]


def _read_place(c: dict[str, Any]) -> list[Channel]:
    miss, speed = c["miss_m"], c["speed_mps"]
    if "corrected_lag_s" in c:
        lag = 0.383 + 1.8288 - 0.0083 * c["shaft_rpm"]
        miss = miss - speed * np.maximum(0.0, lag - c["corrected_lag_s"])
    columns = {"place.lever_arm": np.ones(len(miss)), "place.latency": speed}
    return [Channel("place", np.arange(len(miss), dtype=float), miss, columns)]


def count_rows(left: Floats) -> float:
    """Returns how many independent rows a residual is worth, by its first autocorrelation."""
    about = left - left.mean()
    power = float(about @ about)
    near = float(about[1:] @ about[:-1]) / power if power > 0.0 else 0.0
    near = min(max(near, 0.0), 0.995)
    return max(3.0, len(left) * (1.0 - near) / (1.0 + near))


def fit_channel(
    channel: Channel, tolerances: dict[str, float], rows_in: npt.NDArray[np.bool_] | None = None
) -> dict[str, Fit]:
    """Returns the fit of each trace alone, together with what a machine within its tolerances may
    be off.

    The noise is what all traces together leave, of as many independent rows as its first
    autocorrelation says. rows_in : rows in which the faults act, (n,); default all.
    """
    names = [n for n, x in channel.columns.items() if x @ x > LEAST_POWER * len(x)]
    y = channel.left
    if not names or len(y) < 4:
        return {}
    x = np.array([channel.columns[n] for n in names])
    scale = np.sqrt(np.mean(x**2, axis=1))
    x = x / scale[:, None]
    ridge = 1e-6 * len(y) * np.eye(len(names))
    rest = y - np.linalg.solve(x @ x.T + ridge, x @ y) @ x
    rows = count_rows(rest)
    noise = max(float(np.mean(rest**2)), 1e-12) * len(y) / rows
    sds = np.array([tolerances.get(n, 0.0) for n in names]) * scale
    free = np.flatnonzero(sds > 0.0)
    acting = x if rows_in is None else x * rows_in
    found = {}
    for k, name in enumerate(names):
        others = free[free != k]
        t = x[others]
        prior = np.diag(1.0 / sds[others] ** 2)
        known = np.linalg.solve(
            t @ t.T / noise + prior, np.column_stack((t @ acting[k], t @ y)) / noise
        )
        power = float(acting[k] @ acting[k] - (acting[k] @ t.T) @ known[:, 0]) / noise
        along = float(acting[k] @ y - (acting[k] @ t.T) @ known[:, 1]) / noise
        if power <= 1e-12:
            continue
        size, gain = along / power, 0.5 * along**2 / power
        own = sds[k]
        if own > 0.0:
            gain -= 0.5 * along**2 / (power + 1.0 / own**2)
        sd = float(np.hypot(power**-0.5, own)) / scale[k]
        if size < 0.0 and name in ONE_SIGN:
            size, gain = 0.0, 0.0
        share = min(1.0, size * along * noise / max(float(y @ y), 1e-12))
        found[name] = Fit(float(size / scale[k]), sd, gain, share)
    return found
