"""How do strategies differ besides rate and place error? Time to reach a new rate, and moves an
hour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.machine.model_elements import Array
from topdress.control.targets.lag_correction import FiredChange

# Share of a step at which the new rate is reached.
REACHED_SHARE = 0.9
MAX_REACH_S = 5.0
# Smaller steps, as a share of the larger rate, are lost in changes of speed.
MIN_STEP_SHARE = 0.03


class DriveMoves(NamedTuple):
    """Holds the moves of one run: changed set-points in an hour of work with flow allowed."""

    # Median time from the command to 90 % of the step in the released stream, s; None without
    # steps.
    reach_p50_s: float | None
    reach_p95_s: float | None
    steps: int
    shaft_moves_per_h: float
    gate_moves_per_h: float
    gate_travel_mm_per_h: float


def count_moves(
    columns: dict[str, Array], fired: Sequence[FiredChange], width_m: float
) -> DriveMoves:
    """Counts the moves of a run. `columns`: see `closed_loop.Record`; `width_m`: working width.
    Steps from or to 0 are left out, and steps that the next one overtakes."""
    time = columns["time_s"]
    speed = np.maximum(0.1, np.abs(columns["speed_mps"]))
    released = columns["flow_kg_s"] * 10_000.0 / (width_m * speed)
    taken = [
        t
        for t in (_find_reach_time_s(time, released, fired, k) for k in range(len(fired)))
        if t is not None
    ]
    flowing = columns["flowing"] > 0.0
    hours = (
        float(flowing.sum()) * float(np.median(np.diff(time))) / 3600.0 if len(time) > 1 else 0.0
    )
    at_work = flowing[1:] & flowing[:-1]
    shaft = (np.abs(np.diff(columns["shaft_rpm_cmd"])) > 0.0)[at_work]
    gate = np.abs(np.diff(columns["opening_mm_cmd"]))[at_work]
    per_h = 1.0 / hours if hours > 0.0 else 0.0
    return DriveMoves(
        float(np.percentile(taken, 50)) if taken else None,
        float(np.percentile(taken, 95)) if taken else None,
        len(taken),
        float(shaft.sum()) * per_h,
        float((gate > 0.0).sum()) * per_h,
        float(gate.sum()) * per_h,
    )


def _find_reach_time_s(
    time: Array, released: Array, fired: Sequence[FiredChange], k: int
) -> float | None:
    change = fired[k]
    before, after = change.before.rate_kg_ha, change.after.rate_kg_ha
    if min(before, after) <= 0.0 or abs(after - before) < MIN_STEP_SHARE * max(before, after):
        return None
    ends = change.time_s + MAX_REACH_S
    if k + 1 < len(fired):
        ends = min(ends, fired[k + 1].time_s)
    first, last = int(np.searchsorted(time, change.time_s)), int(np.searchsorted(time, ends))
    share = (released[first:last] - before) / (after - before)
    there = np.flatnonzero(share >= REACHED_SHARE)
    return float(time[first + there[0]] - change.time_s) if len(there) else None
