"""Drive programmes: what was driven and ordered, before any machine is asked what it made of it.

Every programme belongs to one half for good: `tuning` may be looked at while the diagnosis is
being built, `unseen` is kept for its examination.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from . import nominal as nom

Floats = npt.NDArray[np.float64]
# Rough ground, as on the demonstration field: s.d. of the pitch, deg, and how long it holds, s.
ROUGH_DEG, ROUGH_S = 0.5, 3.0


class Programme(NamedTuple):
    name: str
    split: str  # tuning, unseen
    # of the wanted rate, or of the set-points themselves (grid, walk)
    pattern: str
    strategy: str  # opening_first, speed_first, switch
    speeds_mps: tuple[float, ...]
    ground: str  # flat, slope
    supply: str  # steady, dips, wander
    headlands: bool
    refill: bool
    stops: int
    row_hz: float
    minutes: tuple[float, float]


_TUNING = (
    (
        "canopy_opening",
        "canopy",
        "opening_first",
        (1.25,),
        "flat",
        "steady",
        True,
        False,
        0,
        20,
        (22, 40),
    ),
    (
        "canopy_speed",
        "canopy",
        "speed_first",
        (1.25,),
        "flat",
        "wander",
        True,
        False,
        0,
        20,
        (22, 40),
    ),
    (
        "canopy_refill",
        "canopy",
        "opening_first",
        (1.1, 1.6),
        "slope",
        "wander",
        True,
        True,
        1,
        20,
        (28, 40),
    ),
    ("stairs_speed", "stairs", "speed_first", (1.4,), "flat", "dips", True, False, 1, 20, (20, 30)),
    (
        "stairs_opening",
        "stairs",
        "opening_first",
        (1.4, 1.8),
        "slope",
        "steady",
        True,
        False,
        0,
        20,
        (20, 32),
    ),
    (
        "sine_speed",
        "sine",
        "speed_first",
        (1.25,),
        "slope",
        "wander",
        False,
        False,
        0,
        10,
        (20, 40),
    ),
    ("grid_refill", "grid", "switch", (1.0, 1.5), "slope", "dips", True, True, 2, 20, (28, 40)),
    (
        "stop_and_go",
        "canopy",
        "speed_first",
        (0.9, 1.3),
        "slope",
        "dips",
        True,
        False,
        5,
        20,
        (20, 36),
    ),
    (
        "hills_refill",
        "sine",
        "opening_first",
        (1.0, 1.7),
        "slope",
        "wander",
        True,
        True,
        0,
        20,
        (28, 40),
    ),
    ("switching", "canopy", "switch", (1.25, 1.9), "flat", "dips", True, True, 1, 10, (28, 40)),
    (
        "steady_rate",
        "constant",
        "opening_first",
        (1.25,),
        "flat",
        "steady",
        False,
        False,
        0,
        20,
        (20, 30),
    ),
    ("grid_long", "grid", "switch", (1.5,), "slope", "wander", True, False, 1, 20, (30, 40)),
)
_UNSEEN = (
    (
        "field_opening",
        "walk",
        "opening_first",
        (1.3,),
        "flat",
        "wander",
        True,
        False,
        1,
        20,
        (22, 40),
    ),
    (
        "field_speed",
        "walk",
        "speed_first",
        (1.15, 1.5),
        "slope",
        "steady",
        True,
        False,
        0,
        20,
        (22, 40),
    ),
    (
        "field_refill",
        "walk",
        "speed_first",
        (1.2, 1.7),
        "slope",
        "dips",
        True,
        True,
        0,
        20,
        (28, 40),
    ),
    (
        "telegraph_speed",
        "telegraph",
        "speed_first",
        (1.35,),
        "flat",
        "wander",
        True,
        False,
        0,
        20,
        (20, 34),
    ),
    (
        "telegraph_opening",
        "telegraph",
        "opening_first",
        (1.2, 1.6),
        "slope",
        "dips",
        True,
        False,
        2,
        20,
        (20, 34),
    ),
    ("chirp_speed", "chirp", "speed_first", (1.4,), "slope", "dips", False, False, 0, 10, (20, 40)),
    (
        "scatter_refill",
        "scatter",
        "switch",
        (0.9, 1.6),
        "slope",
        "wander",
        True,
        True,
        1,
        20,
        (28, 40),
    ),
    (
        "crawl_and_go",
        "canopy",
        "opening_first",
        (0.7, 1.4),
        "slope",
        "wander",
        True,
        False,
        6,
        20,
        (20, 36),
    ),
    (
        "valley_refill",
        "chirp",
        "opening_first",
        (1.1, 1.5),
        "slope",
        "dips",
        True,
        True,
        2,
        20,
        (28, 40),
    ),
    ("both_ways", "walk", "switch", (1.3, 1.8), "flat", "wander", True, True, 0, 10, (28, 40)),
    (
        "plain_rate",
        "constant",
        "speed_first",
        (1.3,),
        "flat",
        "steady",
        False,
        False,
        0,
        20,
        (20, 30),
    ),
    ("scatter_long", "scatter", "switch", (1.4,), "slope", "dips", True, False, 2, 20, (30, 40)),
)
PROGRAMMES: tuple[Programme, ...] = tuple(
    Programme(name, split, *rest)  # type: ignore[arg-type]
    for split, rows in (("tuning", _TUNING), ("unseen", _UNSEEN))
    for name, *rest in rows
)
SPLITS = ("tuning", "unseen")


def chosen(split: str) -> tuple[Programme, ...]:
    """The programmes of one half, or of both (`all`). Raises ValueError on another word."""
    if split not in (*SPLITS, "all"):
        raise ValueError(f"programmes: {split!r} is not one of tuning, unseen, all")
    return tuple(p for p in PROGRAMMES if split in ("all", p.split))


class Drive(NamedTuple):
    """One programme driven once: arrays of one value a row."""

    programme: Programme
    time_s: Floats
    row_s: float
    working: npt.NDArray[np.bool_]
    speed_mps: Floats
    heading_deg: Floats
    pitch_deg: Floats
    roll_deg: Floats
    supply_v: Floats
    rate_kg_ha: Floats
    shaft_rpm_cmd: Floats
    opening_mm_cmd: Floats
    speed_first: npt.NDArray[np.bool_]
    ndvi: Floats
    start_kg: float
    refill_kg_s: Floats  # kg/s poured in
    refill_row: int | None  # where the operator told it
    refill_kg: float


def _slow(rng: np.random.Generator, count: int, step: float, correlation: float) -> Floats:
    """A stationary random wander (count,) of unit variance, smooth beyond `correlation` (in
    units of `step`)."""
    knots = max(4, int(count * step / correlation) + 4)
    coarse = rng.normal(size=knots)
    x = np.linspace(1.0, knots - 2.0, count)
    k = x.astype(int)
    f = x - k
    w = (
        np.stack([(1 - f) ** 3, 3 * f**3 - 6 * f**2 + 4, -3 * f**3 + 3 * f**2 + 3 * f + 1, f**3])
        / 6.0
    )
    k = np.clip(k, 1, knots - 3)
    out = sum(w[j] * coarse[k - 1 + j] for j in range(4))
    return np.asarray(out / 0.69)


def _held(
    rng: np.random.Generator,
    time_s: Floats,
    low_s: float,
    high_s: float,
    draw: Callable[[int], float],
) -> Floats:
    """Values from `draw(i)` held for a random span each."""
    edges = [0.0]
    while edges[-1] < time_s[-1]:
        edges.append(edges[-1] + rng.uniform(low_s, high_s))
    values = np.array([draw(i) for i in range(len(edges))])
    return values[np.searchsorted(edges, time_s, side="right") - 1]


def _phases(
    p: Programme, rng: np.random.Generator, total_s: float
) -> list[tuple[float, str, float]]:
    """(length in s, what, speed): rows, headlands, stops and one refill, one after another."""
    spans: list[tuple[float, str, float]] = [(rng.uniform(4, 8), "ready", 0.0)]
    worked, row = 0.0, 0
    stops_at = np.sort(rng.uniform(0.1, 0.9, p.stops)) * total_s
    refill_at = rng.uniform(0.4, 0.6) * total_s if p.refill else np.inf
    now = spans[0][0]
    long_row = rng.uniform(90, 200) if p.headlands else 1e9
    done = 0
    while now < total_s:
        speed = p.speeds_mps[row % len(p.speeds_mps)]
        nexts = [long_row * rng.uniform(0.8, 1.2), total_s - now + 1.0]
        if done < p.stops:
            nexts.append(max(5.0, stops_at[done] - now))
        nexts.append(max(5.0, refill_at - now))
        length = min(nexts)
        spans.append((length, "row", speed))
        now += length
        worked += length
        if now >= refill_at:
            spans.append((60.0, "refill", 0.0))
            refill_at, now = np.inf, now + 60.0
        elif done < p.stops and now >= stops_at[done]:
            rest = rng.uniform(15, 50)
            spans.append((rest, "stop", 0.0))
            done, now = done + 1, now + rest
        elif p.headlands:
            turn = rng.uniform(14, 24)
            spans.append((turn, "turn", 0.75 * speed))
            now, row = now + turn, row + 1
    return spans


def _pattern(p: Programme, rng: np.random.Generator, t: Floats) -> Floats:
    """Wanted rate kg/ha over time (rows,)."""
    low, high = rng.uniform(90, 140), rng.uniform(380, 470)
    middle, half = (low + high) / 2, (high - low) / 2
    if p.pattern == "canopy":
        x = 0.6 * _slow(rng, t.size, t[1] - t[0], 25.0) + 0.5 * _slow(rng, t.size, t[1] - t[0], 6.0)
        grade = np.clip(np.round(5 + 3.2 * x), 0, 10)
        grade = grade[(np.floor(t) / (t[1] - t[0])).astype(int).clip(0, t.size - 1)]
        return np.asarray(low + grade / 10 * (high - low))
    if p.pattern == "walk":
        x = _slow(rng, t.size, t[1] - t[0], 40.0) + 0.5 * _slow(rng, t.size, t[1] - t[0], 9.0)
        return np.asarray(np.clip(middle + 0.75 * half * x, low, high))
    if p.pattern == "stairs":
        steps = rng.integers(6, 10)
        span = rng.uniform(12, 30)
        k = np.floor(t / span).astype(int) % (2 * steps)
        return np.asarray(low + (high - low) * np.minimum(k, 2 * steps - k) / steps)
    if p.pattern == "telegraph":
        levels = rng.uniform(low, high, 5)
        return _held(rng, t, 3, 25, lambda i: rng.choice(levels))
    if p.pattern == "sine":
        return np.asarray(middle + half * np.sin(2 * np.pi * t / rng.uniform(20, 90)))
    if p.pattern == "chirp":
        slow, fast = rng.uniform(100, 160), rng.uniform(10, 18)
        period = slow * (fast / slow) ** ((t / t[-1] * 3) % 1.0)
        return np.asarray(middle + half * np.sin(np.cumsum(2 * np.pi / period) * (t[1] - t[0])))
    return np.full(t.size, rng.uniform(220, 340))


def _supply(p: Programme, rng: np.random.Generator, t: Floats, row_s: float) -> Floats:
    """Volts."""
    supply = nom.NOMINAL_SUPPLY_V + 0.08 * _slow(rng, t.size, row_s, 40.0) + 0.05
    if p.supply == "wander":
        return np.asarray(supply - 0.45 * np.abs(_slow(rng, t.size, row_s, 90.0)) - 0.2)
    if p.supply == "dips":
        dips = _held(rng, t, 12, 60, lambda i: rng.choice([0.0, 0.0, 0.5, 1.0, 1.5, 2.0]))
        return np.asarray(supply - _smooth(dips, row_s, 0.8))
    return np.asarray(supply)


def drive(p: Programme, seed: int) -> Drive:
    """Drives a programme once. The same programme and seed give the same arrays."""
    rng = np.random.default_rng([seed, 11])
    row_s = 1.0 / p.row_hz
    total_s = 60.0 * rng.uniform(*p.minutes)
    t = np.arange(0.0, total_s, row_s)
    spans = _phases(p, rng, total_s)
    ends = np.cumsum([length for length, _, _ in spans])
    which = np.minimum(np.searchsorted(ends, t, side="right"), len(spans) - 1)
    what = np.array([w for _, w, _ in spans])[which]
    wanted_speed = np.array([v for _, _, v in spans])[which]
    moving = wanted_speed > 0
    wanted_speed = wanted_speed * (1.0 + 0.03 * _slow(rng, t.size, row_s, 20.0))
    speed = _smooth(wanted_speed, row_s, 1.2)
    speed[~moving & (speed < 0.05)] = 0.0
    working = (what == "row") & (speed > 0.4)

    turned = np.cumsum(np.r_[0, (np.diff((what == "turn").astype(int)) == 1)])
    base = rng.uniform(0, 360)
    progress = np.clip(
        (t - np.r_[0, ends][which]) / np.maximum(1.0, np.r_[ends][which] - np.r_[0, ends][which]),
        0,
        1,
    )
    in_turn = what == "turn"
    heading = base + 180.0 * (turned - in_turn) + np.where(in_turn, 180.0 * progress, 0.0)
    if not p.headlands:
        heading = heading + 200.0 * t / t[-1] + 25.0 * _slow(rng, t.size, row_s, 60.0)
    heading = (heading + 1.0 * _slow(rng, t.size, row_s, 3.0)) % 360.0
    place = np.cumsum(speed) * row_s
    rough = _by_place(rng, place, 6.0)
    slope = rng.uniform(3.0, 6.0) if p.ground == "slope" else rng.uniform(0.3, 0.8)
    uphill = rng.uniform(0, 360)
    pitch = (
        slope * np.cos(np.radians(heading - uphill)) * (1 + 0.3 * _by_place(rng, place, 60.0))
        + 0.4 * rough
        + _shaken(np.random.default_rng([seed, 12]), t.size, row_s)
    )
    cross = rng.uniform(1.5, 3.5)
    bank = 0.5 * np.sin(np.radians(heading - uphill + 40)) + _by_place(rng, place, 35.0)
    roll = cross * bank + 0.8 * _by_place(rng, place, 5.0)

    supply = _supply(p, rng, t, row_s)
    rate = _pattern(p, rng, t)
    used = _smooth(speed + 0.01 * rng.normal(size=t.size), row_s, 0.5)
    flow = rate * nom.WIDTH_M * used / 1e4
    per = nom.FLOW_G_PER_REV_MM / 1000.0 / 60.0
    if p.strategy == "switch":
        speed_first = _held(rng, t, 120, 300, lambda i: i % 2) > 0
    else:
        speed_first = np.full(t.size, p.strategy == "speed_first")
    fixed_rpm, fixed_mm = rng.uniform(60, 78), rng.uniform(16, 27)
    shaft = np.where(speed_first, flow / per / fixed_mm, fixed_rpm)
    opening = np.where(speed_first, fixed_mm, flow / per / fixed_rpm)
    if p.pattern == "grid":
        shaft = _held(
            rng, t, 14, 30, lambda i: (12.0, 30.0, 48.0, 64.0, 80.0, 96.0)[int(i * 5 % 6)]
        )
        opening = _held(rng, t, 22, 45, lambda i: (8.0, 20.0, 33.0, 46.0, 57.0)[int(i * 3 % 5)])
    elif p.pattern == "scatter":
        shaft = _held(rng, t, 8, 40, lambda i: rng.uniform(11, 99))
        opening = _held(rng, t, 10, 50, lambda i: rng.uniform(6, 58))
    if p.pattern in ("grid", "scatter"):
        scale = np.minimum(1.0, 0.22 / np.maximum(1e-9, per * shaft * opening))
        opening = np.maximum(6.0, opening * scale)
    dead = rng.choice([0.0, 0.2, 0.5])
    shaft = np.where(working, np.round(_deadened(np.clip(shaft, 10, 100), dead), 1), 0.0)
    opening = np.round(_deadened(_keep_when_idle(np.clip(opening, 5, 60), working), dead), 1)
    rate = np.where(
        working,
        rate
        if p.pattern not in ("grid", "scatter")
        else per * shaft * opening * 1e4 / nom.WIDTH_M / np.maximum(used, 0.4),
        0.0,
    )

    pour, row, kg = np.zeros(t.size), None, 0.0
    start = rng.uniform(240, 300)
    used_kg = np.cumsum(per * shaft * opening) * row_s
    if p.refill and (what == "refill").any():
        at = np.flatnonzero(what == "refill")
        kg = float(np.round(min(used_kg[at[0]] + rng.uniform(0, 15), 285.0), 0))
        first, last = t[at[0]] + rng.uniform(12, 20), t[at[0]] + rng.uniform(30, 42)
        inside = (t >= first) & (t < last)
        pour[inside] = kg / (inside.sum() * row_s)
        row = int(np.flatnonzero(inside)[-1] + rng.integers(20, 60))
    ndvi = np.clip(
        0.5 + 0.09 * _by_place(rng, place, 25.0) + 0.03 * _by_place(rng, place, 5.0), 0.22, 0.8
    )
    if used_kg[-1] - kg > start - 5.0:  # ends before the hopper is empty
        last_row = int(np.searchsorted(used_kg - np.cumsum(pour) * row_s, start - 5.0))
        keep = slice(0, max(last_row, 2000))
    else:
        keep = slice(0, t.size)
    if row is not None and row >= t[keep].size:
        row = None
    return Drive(
        p,
        t[keep],
        row_s,
        working[keep],
        speed[keep],
        heading[keep],
        pitch[keep],
        roll[keep],
        supply[keep],
        rate[keep],
        shaft[keep],
        opening[keep],
        speed_first[keep],
        ndvi[keep],
        start,
        pour[keep],
        row,
        kg,
    )


def _smooth(x: Floats, step: float, tau: float) -> Floats:
    a = np.exp(-step / tau)
    return np.asarray(lfilter([1 - a], [1, -a], x, zi=[a * x[0]])[0])


def _shaken(rng: np.random.Generator, count: int, row_s: float) -> Floats:
    """Pitch of a tractor on rough ground (rows,), deg: first-order noise, as rough from row to
    row as over seconds."""
    keep = np.exp(-row_s / ROUGH_S)
    fresh = ROUGH_DEG * rng.normal(size=count)
    fresh[1:] *= np.sqrt(1.0 - keep * keep)
    return np.asarray(lfilter([1.0], [1.0, -keep], fresh))


def _by_place(rng: np.random.Generator, place: Floats, correlation_m: float) -> Floats:
    """A wander (rows,) that belongs to the ground: smooth over metres, still when standing."""
    far = max(place[-1], correlation_m) + 1.0
    grid = _slow(rng, int(far) + 2, 1.0, correlation_m)
    return np.interp(place, np.arange(grid.size), grid)


def _deadened(x: Floats, band: float) -> Floats:
    """Follows x only when it is further than `band` away, as a controller with a dead band does."""
    if band <= 0:
        return x
    out = x.copy()
    for k in range(1, x.size):
        out[k] = x[k] if abs(x[k] - out[k - 1]) > band else out[k - 1]
    return out


def _keep_when_idle(x: Floats, working: npt.NDArray[np.bool_]) -> Floats:
    last = np.maximum.accumulate(np.where(working, np.arange(x.size), 0))
    return x[last]
