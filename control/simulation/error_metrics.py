"""How large are rate error and place error of a run? The definitions for all of the project.

Rate error: the area mean of |landed - target|. Place error: the distance between a step of the
target and the half-way point of the landed step.

The target is a staircase: control keeps it for a decision period, based on noisy heads. Compared
with the target, the rate error shows how well the machine follows its commands, not how well the
crop is served. For that it is compared with the crop's need where the canopy is the source: the
graded need, by the crop's rule at the true canopy of every place, and the smooth need, by the
same rule without grades.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.agronomy.nitrogen_rate import CropRule
from topdress.control.machine.landing import LandedMass, bin_landings
from topdress.control.machine.landing import calc_fall_times_s as tube_falls_s
from topdress.control.machine.model_elements import Array
from topdress.control.targets.lag_correction import FiredChange

# Rates are judged on stretches of this length, m.
RATE_BIN_M = 0.25
# Half-way points are located on bins of this length, m.
PLACE_BIN_M = 0.05
# The landed step is looked for this far beyond its place, m.
MAX_PLACE_ERROR_M = 12.0
# The landed step is looked for from this far before its place, m: a drive may answer sooner than
# control assumes.
EARLY_LANDING_M = 0.25
# Least share of a bin's area: less was covered by the last grains of a closing valve.
MIN_OPEN_SHARE = 0.1
# Smaller steps of the target, as a share of it, have no detectable half-way point.
MIN_STEP_SHARE = 0.03


class RunErrors(NamedTuple):
    """Holds the errors of a run. Place errors are signed: landed minus wanted along the travel,
    late positive."""

    rate_error_kg_ha: float
    # Rate error as a share of the mean target, %.
    rate_error_percent: float
    # Mean landed minus mean target rate, kg/ha.
    bias_kg_ha: float
    mean_target_kg_ha: float
    mean_landed_kg_ha: float
    # Mean absolute place error, m.
    place_error_m: float
    place_bias_m: float
    place_p50_m: float
    place_p95_m: float
    # Number of steps with a half-way point.
    steps: int
    # Number of steps that the next step reversed or overtook before half-way.
    steps_lost: int
    released_kg: float
    landed_kg: float
    area_ha: float
    # Error against the graded need, kg/ha; None without a rule, or without a need.
    graded_error_kg_ha: float | None = None
    # Error as a share of the mean need, %.
    graded_error_percent: float | None = None
    # Error against the smooth need, kg/ha.
    smooth_error_kg_ha: float | None = None
    smooth_error_percent: float | None = None


class CropNeeds(NamedTuple):
    """Holds the crop's need by bin of the ground, kg/ha: by its rule, and by the rule without
    grades."""

    graded_kg_ha: Array
    smooth_kg_ha: Array


class RunLanding(NamedTuple):
    """Holds the ground of a run and where the material of each tick landed."""

    ground: LandedMass
    # Landing position of each tick's parcel, m.
    place_m: Array
    # Rate that landed at the outlet's position in each tick, kg/ha.
    rate_kg_ha: Array
    # Target by bin of the ground, kg/ha.
    target_kg_ha: Array
    # Landed rate by bin, kg/ha.
    landed_kg_ha: Array
    # By bin, 1 for work with a known target, else 0.
    inside: Array
    # NDVI of the canopy by bin, mean over the working width.
    ndvi: Array


def find_landing(columns: dict[str, Array], width_m: float, lever_arm_m: float = 0.0) -> RunLanding:
    """Bins a run on the ground along its own way. `columns`: see `closed_loop.Record`."""
    time, driven = columns["time_s"], columns["driven_m"]
    mass = columns["flow_kg_s"] * _calc_row_durations(time)
    ground, place = bin_landings(
        time, driven, mass, find_fall_times_s(columns), RATE_BIN_M, lever_arm_m
    )
    centres = ground.calc_centres_m()
    rate, passed = _calc_bin_rates(columns, ground, width_m, lever_arm_m)
    # Where the machine reversed, the first passage counts.
    at = np.interp(centres, np.maximum.accumulate(driven), np.arange(len(driven)))
    row = np.clip(np.round(at).astype(np.int64), 0, len(driven) - 1)
    target = columns["target_kg_ha"][row]
    inside = (columns["working"][row] > 0.0) & (columns["in_pass"][row] > 0.0) & (target > 0.0)
    inside &= (centres >= driven[0]) & (centres <= driven[-1]) & passed
    here = np.clip(
        np.floor((driven - ground.origin_m) / RATE_BIN_M).astype(np.int64), 0, len(rate) - 1
    )
    return RunLanding(
        ground,
        place,
        rate[here],
        target,
        rate,
        inside.astype(np.float64),
        # A row has the target at the beginning of its step.
        columns["ndvi"][np.maximum(0, row - 1)],
    )


def find_true_landing(columns: dict[str, Array], width_m: float) -> tuple[Array, Array]:
    """Returns the rate that landed at the outlet's place at the end of each row's step, kg/ha,
    and where the first material of that step landed, m along the way; both (n,).

    A row holds the flow of the step that ends with it. `find_landing` takes that as released from
    the row on, a tick late, as it takes the row's target: for comparing the two, its purpose, that
    is the same. It is not a true place."""
    step = _calc_row_durations(columns["time_s"])
    first = {name: column[:1] for name, column in columns.items()} | {
        "time_s": columns["time_s"][:1] - step[:1],
        "driven_m": columns["driven_m"][:1] - step[:1] * columns["speed_mps"][:1],
    }
    started = {name: np.concatenate((first[name], column)) for name, column in columns.items()}
    for name in ("flow_kg_s", "drop_s", "settled_drop_s"):
        started[name] = np.append(columns[name], 0.0 if name == "flow_kg_s" else columns[name][-1:])
    land = find_landing(started, width_m)
    return land.rate_kg_ha[1:], land.place_m[:-1]


def find_crop_needs(rule: CropRule, ndvi: Array) -> CropNeeds:
    """Returns the crop's need at canopies (n,), with the cut-offs and limits of its rule."""
    smooth = replace(rule, crop=rule.crop.model_copy(update={"grades": False}))
    return CropNeeds(
        *(
            np.array([one.decide_rate(value).rate_kg_ha for value in ndvi.tolist()])
            for one in (rule, smooth)
        )
    )


def find_fall_times_s(columns: dict[str, Array]) -> Array:
    """Returns each parcel's time to the ground, (n,) s: by its machine's tube, plus its own
    effects."""
    settled, share = columns["settled_drop_s"], columns.get("carried_share")
    carried = 1.0 if share is None or not len(share) else float(share[0])
    return tube_falls_s(columns["time_s"], settled, carried) + columns["drop_s"] - settled


def judge_run(
    columns: dict[str, Array],
    fired: Sequence[FiredChange],
    width_m: float,
    lever_arm_m: float = 0.0,
    rule: CropRule | None = None,
) -> RunErrors:
    """Returns the errors of a run. The first metres after work begins count: a late start is an
    error too. rule: of the crop, where the canopy is the source."""
    land = find_landing(columns, width_m, lever_arm_m)
    inside = land.inside > 0.0
    target, got = land.target_kg_ha[inside], land.landed_kg_ha[inside]
    places, lost = find_place_errors(columns, fired, land, width_m)
    mean_target = float(target.mean()) if len(target) else 0.0
    mean_got = float(got.mean()) if len(got) else 0.0
    miss = float(np.abs(got - target).mean()) if len(target) else 0.0
    size = np.abs(places)
    needed: tuple[Array, ...] = () if rule is None else find_crop_needs(rule, land.ndvi[inside])
    against = [_calc_mean_miss(got, need) for need in needed] or [(None, None), (None, None)]
    return RunErrors(
        miss,
        100.0 * miss / mean_target if mean_target else 0.0,
        mean_got - mean_target,
        mean_target,
        mean_got,
        float(size.mean()) if len(places) else 0.0,
        float(places.mean()) if len(places) else 0.0,
        float(np.percentile(size, 50)) if len(places) else 0.0,
        float(np.percentile(size, 95)) if len(places) else 0.0,
        len(places),
        lost,
        float((columns["flow_kg_s"] * _calc_row_durations(columns["time_s"])).sum()),
        float(land.ground.mass_kg.sum()),
        float(inside.sum() * RATE_BIN_M * width_m / 10_000.0),
        *against[0],
        *against[1],
    )


def _calc_mean_miss(got: Array, need: Array) -> tuple[float | None, float | None]:
    """Returns the mean of |got - need|, kg/ha, and the same in % of the mean need."""
    if not need.sum() > 0.0:
        return None, None
    miss = float(np.abs(got - need).mean())
    return miss, 100.0 * miss / float(need.mean())


def find_place_errors(
    columns: dict[str, Array], fired: Sequence[FiredChange], land: RunLanding, width_m: float
) -> tuple[Array, int]:
    """Returns the signed place errors (k,), m, and how many steps never came half-way before the
    next one.

    A step is looked for in the material released after its drive answered and before the next
    step could show. Its half-way point is where a step between the two targets fits the landed
    rate best (`_find_half_way`): a single noisy bin that touches the middle early does not
    count."""
    time, track, driven = columns["time_s"], columns["track_m"], columns["driven_m"]
    share = columns.get("open_share")
    falls = find_fall_times_s(columns)
    fine, _ = bin_landings(
        time,
        driven,
        columns["flow_kg_s"] * _calc_row_durations(time),
        falls,
        PLACE_BIN_M,
        float(np.median(land.place_m - np.interp(time + falls, time, driven))),
    )
    rate, _ = _calc_bin_rates(
        columns,
        fine,
        width_m,
        float(np.median(land.place_m - np.interp(time + falls, time, driven))),
    )
    found: list[float] = []
    lost = 0
    for k, change in enumerate(fired):
        before, after = change.before.rate_kg_ha, change.after.rate_kg_ha
        if abs(after - before) < max(MIN_STEP_SHARE * max(after, before), 1.0):
            continue
        row = int(np.searchsorted(time, change.time_s))
        if row >= len(time) or not columns["working"][row]:
            continue
        wanted = float(
            np.interp(change.place_m, np.maximum.accumulate(track), np.maximum.accumulate(driven))
        )
        answers = min(
            len(time) - 1, int(np.searchsorted(time, change.time_s + change.lag.response_s))
        )
        if share is not None and min(share[row], share[answers]) <= 0.0:
            continue
        begin_m = float(land.place_m[answers]) - EARLY_LANDING_M
        end_m = begin_m + MAX_PLACE_ERROR_M
        if k + 1 < len(fired):
            following = fired[k + 1]
            shows_s = following.time_s + following.lag.response_s
            end_m = min(
                end_m, float(land.place_m[min(len(time) - 1, int(np.searchsorted(time, shows_s)))])
            )
        begin = max(0, int((begin_m - fine.origin_m) / PLACE_BIN_M))
        end = min(len(rate), int((end_m - fine.origin_m) / PLACE_BIN_M) + 1)
        half_way = _find_half_way(rate[begin:end], before, after)
        if half_way is None:
            lost += 1
            continue
        found.append(fine.origin_m + PLACE_BIN_M * (begin + half_way) - wanted)
    return np.array(found), lost


def _find_half_way(rate: Array, before: float, after: float) -> int | None:
    """Returns the bins before the best fitting step from `before` to `after` (least squares);
    None: no step inside."""
    if len(rate) < 3:
        return None
    over = (rate - 0.5 * (before + after)) * (1.0 if after > before else -1.0)
    fit = np.concatenate(([0.0], np.cumsum(over)))
    at = int(np.argmin(fit))
    return None if at == len(rate) else at


def _calc_bin_rates(
    columns: dict[str, Array], ground: LandedMass, width_m: float, lever_arm_m: float
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Returns the rate by bin of the ground under the open width, kg/ha, and whether any was
    open. Where all is open all the time, over the whole width and everywhere."""
    time, driven, share = columns["time_s"], columns["driven_m"], columns.get("open_share")
    whole_m2 = ground.bin_m * width_m
    if share is None or bool(np.all(share >= 1.0)):
        return ground.mass_kg / whole_m2 * 10_000.0, np.ones(len(ground.mass_kg), dtype=np.bool_)
    way_m2 = width_m * share * np.abs(np.diff(driven, prepend=driven[0]))
    area, _ = bin_landings(
        time, driven, way_m2, find_fall_times_s(columns), ground.bin_m, lever_arm_m
    )
    passed = area.mass_kg > MIN_OPEN_SHARE * whole_m2
    return np.where(
        passed, ground.mass_kg / np.where(passed, area.mass_kg, 1.0) * 10_000.0, 0.0
    ), passed


def _calc_row_durations(time_s: Array) -> Array:
    return np.diff(time_s, prepend=time_s[0] - (time_s[1] - time_s[0] if len(time_s) > 1 else 0.05))
