"""Rate error and place error of a run, as defined once for everybody.

Rate error: the area mean of |landed - target|. Place error: the distance between a step of the target and the half-way
point of the landed step.
"""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from control.machine.elements import Array
from control.machine.landing import Ground, landed
from control.targets.lag_correction import Fired

BIN_M = 0.25
FARTHEST_M = 12.0           # the landed step is looked for this far on
LEAST_STEP = 0.03           # smaller steps of the target, as a share of it, have no findable half-way point


class Errors(NamedTuple):
    """Place errors are signed: landed minus wanted along the travel, late positive."""

    rate_error_kg_ha: float
    rate_error_percent: float           # of the mean target
    bias_kg_ha: float                   # mean landed minus mean target
    mean_target_kg_ha: float
    mean_landed_kg_ha: float
    place_error_m: float                # mean of |place error|
    place_bias_m: float
    place_p50_m: float
    place_p95_m: float
    steps: int                          # whose half-way point was found
    steps_lost: int                     # undone or overtaken by the next step before they were half-way
    released_kg: float
    landed_kg: float
    area_ha: float


class Landing(NamedTuple):
    """The ground of a run and, tick by tick, what came to lie where."""

    ground: Ground
    place_m: Array              # of each tick's parcel
    rate_kg_ha: Array           # landed where the outlet is in each tick
    target_kg_ha: Array         # by bin of the ground
    landed_kg_ha: Array         # by bin
    inside: Array               # by bin: 1 where work was on and a target known


def landing(columns: dict[str, Array], width_m: float, lever_arm_m: float = 0.0) -> Landing:
    """Bin a run on the ground along its own way. `columns`: see `closed_loop.Record`."""
    time, driven = columns["time_s"], columns["driven_m"]
    dt = np.diff(time, prepend=time[0] - (time[1] - time[0] if len(time) > 1 else 0.05))
    mass = columns["flow_kg_s"] * dt
    ground, place = landed(time, driven, mass, columns["drop_s"], BIN_M, lever_arm_m)
    centres = ground.centres_m()
    rate = ground.mass_kg / (BIN_M * width_m) * 10_000.0
    at = np.interp(centres, driven, np.arange(len(driven)))
    row = np.clip(np.round(at).astype(np.int64), 0, len(driven) - 1)
    target = columns["target_kg_ha"][row]
    inside = (columns["working"][row] > 0.0) & (columns["in_pass"][row] > 0.0) & (target > 0.0)
    inside &= (centres >= driven[0]) & (centres <= driven[-1])
    here = np.clip(np.floor((driven - ground.origin_m) / BIN_M).astype(np.int64), 0, len(rate) - 1)
    return Landing(ground, place, rate[here], target, rate, inside.astype(np.float64))


def errors(columns: dict[str, Array], fired: Sequence[Fired], width_m: float, lever_arm_m: float = 0.0) -> Errors:
    """Judge a run. The first metres after work begins count: a late start is an error like any other."""
    land = landing(columns, width_m, lever_arm_m)
    inside = land.inside > 0.0
    target, got = land.target_kg_ha[inside], land.landed_kg_ha[inside]
    places, lost = place_errors(columns, fired, land, width_m)
    mean_target = float(target.mean()) if len(target) else 0.0
    mean_got = float(got.mean()) if len(got) else 0.0
    miss = float(np.abs(got - target).mean()) if len(target) else 0.0
    time = columns["time_s"]
    dt = np.diff(time, prepend=time[0] - (time[1] - time[0] if len(time) > 1 else 0.05))
    size = np.abs(places)
    return Errors(miss, 100.0 * miss / mean_target if mean_target else 0.0, mean_got - mean_target, mean_target, mean_got,
                  float(size.mean()) if len(places) else 0.0, float(places.mean()) if len(places) else 0.0,
                  float(np.percentile(size, 50)) if len(places) else 0.0,
                  float(np.percentile(size, 95)) if len(places) else 0.0, len(places), lost,
                  float((columns["flow_kg_s"] * dt).sum()), float(land.ground.mass_kg.sum()),
                  float(inside.sum() * BIN_M * width_m / 10_000.0))


def place_errors(columns: dict[str, Array], fired: Sequence[Fired], land: Landing, width_m: float) -> tuple[Array, int]:
    """Signed place errors (k,), m, and how many steps never came half-way before the next one.

    A step is followed by what was released after it was commanded: from the landing place of the parcel of that
    moment on, the first bin at which the landed rate has passed the middle of the two targets.
    """
    smooth = np.convolve(land.landed_kg_ha, np.ones(3) / 3.0, mode="same")
    time, track, driven = columns["time_s"], columns["track_m"], columns["driven_m"]
    found: list[float] = []
    lost = 0
    for k, change in enumerate(fired):
        low, high = sorted((change.before.rate_kg_ha, change.after.rate_kg_ha))
        if high - low < max(LEAST_STEP * high, 1.0):
            continue
        row = int(np.searchsorted(time, change.time_s))
        if row >= len(time) or not columns["working"][row]:
            continue
        wanted = float(np.interp(change.place_m, track, driven))
        begin = int((land.place_m[row] - land.ground.origin_m) / BIN_M)
        following = fired[k + 1] if k + 1 < len(fired) else None
        end_m = land.place_m[row] + FARTHEST_M
        if following is not None:
            next_row = min(len(time) - 1, int(np.searchsorted(time, following.time_s + following.lag.response_s
                                                              + 2.0 * following.lag.transition_s)))
            end_m = min(end_m, float(land.place_m[next_row]))
        end = min(len(smooth) - 1, int((end_m - land.ground.origin_m) / BIN_M) + 1)
        crossing = _crossing(smooth, begin, end, 0.5 * (low + high),
                             change.after.rate_kg_ha > change.before.rate_kg_ha)
        if crossing is None:
            lost += 1
            continue
        found.append(land.ground.origin_m + BIN_M * (crossing + 0.5) - wanted)
    return np.array(found), lost


def _crossing(rate: Array, begin: int, end: int, middle: float, rising: bool) -> float | None:
    """Bin, with its fraction, at which `rate` first passes `middle` in the wanted direction."""
    for k in range(max(1, begin), end + 1):
        a, b = rate[k - 1], rate[k]
        if (a < middle <= b) if rising else (a > middle >= b):
            return float(k - 1 + (middle - a) / (b - a))
    return None
