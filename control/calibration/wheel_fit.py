"""Which circumference has the wheel? The way by GNSS against the way by its pulses, on straight
stretches of a run log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit
from topdress.control.geodesy import TangentPlane
from topdress.control.machine.machine import Machine

from .bench_table import Array
from .calibration_record import make_record, make_title, merge_records
from .least_squares import FittedInterval

# Length of a stretch from fix to fix, m; the noise of both ends is part of the scatter.
STRETCH_LENGTH_M = 10.0
# A stretch with a fix farther from its chord is not straight, m.
MAX_ASIDE_M = 0.10
# Longest gap between fixes, s.
MAX_FIX_GAP_S = 1.5
MIN_SPEED_MPS = 0.5
MIN_WAY_M, MIN_STRETCHES = 100.0, 5
# RTK fixed; another quality is used only where nothing better is there, and reported.
NEEDED_QUALITY = 4


class WheelLog(NamedTuple):
    """Holds columns (n,) of a run log; NaN: unknown. `flowing`: the machine is under load."""

    time_s: Array
    lat_deg: Array
    lon_deg: Array
    fix_quality: Array
    wheel_speed_mps: Array
    flowing: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class WheelFit:
    """Holds the fitted wheel. `slip_percent`: at work against out of work; None where the log
    has not both."""

    circumference_m: FittedInterval
    way_m: float
    stretches: int
    # Without way out of work the slip is included in the circumference.
    at_work: bool
    slip_percent: FittedInterval | None
    notes: tuple[str, ...]


def fit_wheel(
    log: WheelLog, machine: Machine, counted_m: float, data: str, *, date: str = ""
) -> tuple[Machine, WheelFit]:
    """Returns a copy of the machine with the circumference by GNSS, and the fit.

    Way without flow is used, because a wheel slips under load; where there is too little, all.

    Parameters
    ----------
    log : columns of the run log.
    machine : the machine model.
    counted_m : circumference with which the log's wheel speed was counted, m.
    data, date : of the log, for the record.

    Raises
    ------
    ValueError : in one line, where the log cannot give a circumference."""
    stretches = _cut_stretches(log, data)
    # The third column marks work; both groups are compared for the slip.
    idle, loaded = stretches[stretches[:, 2] == 0.0], stretches[stretches[:, 2] > 0.0]
    at_work = not _is_way_enough(idle)
    used = loaded if at_work else idle
    if not _is_way_enough(used):
        raise ValueError(
            f"{data}: {len(used)} straight stretches of {STRETCH_LENGTH_M:g} m, "
            f"{used[:, 0].sum():.0f} m, with "
            f"wheel and places: at least {MIN_STRETCHES} and {MIN_WAY_M:g} m are needed"
        )
    share = _calc_way_ratio(used)
    circumference = FittedInterval(*(counted_m * value for value in share))
    notes = []
    if at_work:
        notes.append(
            "the log has too little way without flow: the wheel's slip under load is in the "
            "circumference"
        )
    # The worst fix counts, because one drifting stretch can shift the mean.
    worst = int(np.nanmin(log.fix_quality)) if np.isfinite(log.fix_quality).any() else 0
    if worst != NEEDED_QUALITY:
        notes.append(
            f"fix quality down to {worst}: places may drift; {NEEDED_QUALITY} (RTK fixed) is better"
        )
    slip = None
    if not at_work and _is_way_enough(loaded):
        work = _calc_way_ratio(loaded)
        # Independent errors of both ratios add in squares.
        half = 100.0 * np.hypot(work.high - work.value, share.high - share.value)
        percent = 100.0 * (share.value / work.value - 1.0)
        slip = FittedInterval(percent, percent - float(half), percent + float(half))
    fit = WheelFit(circumference, float(used[:, 0].sum()), len(used), at_work, slip, tuple(notes))
    # The new circumference contains the old correction of the radius.
    speed = machine.speed._replace(wheel_circumference_m=circumference.value, radius_percent=0.0)
    checked = Machine.model_validate({**dict(machine), "speed": speed})
    found = make_record("speed.wheel_circumference_m", circumference, "m", data, date, {})
    return checked.model_copy(
        update={
            "adopted": merge_records(machine, (found,), ("speed.wheel_radius",)),
            "title": make_title(machine, "wheel", data, date),
        }
    ), fit


def _is_way_enough(stretches: Array) -> bool:
    return len(stretches) >= MIN_STRETCHES and float(stretches[:, 0].sum()) >= MIN_WAY_M


def _calc_way_ratio(stretches: Array) -> FittedInterval:
    """Returns way by GNSS over way by the wheel, with the 90 % interval from the scatter of the
    stretches."""
    gnss, wheel = stretches[:, 0], stretches[:, 1]
    ratio = float(gnss.sum() / wheel.sum())
    # Deviations of single stretches from the mean ratio give the interval.
    off = (gnss - ratio * wheel) / wheel.mean()
    half = float(stdtrit(len(off) - 1, 0.95) * off.std(ddof=1) / np.sqrt(len(off)))
    return FittedInterval(ratio, ratio - half, ratio + half)


def _cut_stretches(log: WheelLog, data: str) -> Array:
    """Returns (k, 3): way by GNSS, by the wheel, and 1 at work; each straight, at speed, and
    wholly in or out of work."""
    known = np.isfinite(log.lat_deg) & np.isfinite(log.lon_deg)
    # A receiver repeats its last position between epochs; repeated rows are no new fixes.
    moved = known & np.concatenate(
        ([True], (np.diff(log.lat_deg) != 0.0) | (np.diff(log.lon_deg) != 0.0))
    )
    rows = np.flatnonzero(moved & np.isfinite(log.wheel_speed_mps))
    if len(rows) < 2:
        raise ValueError(
            f"{data}: no rows with wheel_speed_mps and places (lat_deg, lon_deg): both are needed"
        )
    plane = TangentPlane(float(log.lat_deg[rows[0]]), float(log.lon_deg[rows[0]]))
    places = plane.project_many_to_m(log.lat_deg[rows], log.lon_deg[rows])
    speed = np.where(np.isfinite(log.wheel_speed_mps), log.wheel_speed_mps, 0.0)
    steps = np.diff(log.time_s, append=log.time_s[-1:])
    # The wheel's way is the speed integrated by the trapezoidal rule.
    way = np.concatenate(([0.0], np.cumsum(0.5 * (speed[:-1] + speed[1:]) * steps[:-1])))
    # Cumulated counts tell in one subtraction whether a bad row lies inside a stretch.
    bad = (speed < MIN_SPEED_MPS).astype(np.int64).cumsum()
    loaded = log.flowing.astype(np.int64)
    changes = np.concatenate(([0], np.cumsum(np.abs(np.diff(loaded)))))
    found, begin = [], 0
    for k in range(1, len(rows)):
        a, b = rows[begin], rows[k]
        if (
            log.time_s[b] - log.time_s[rows[k - 1]] > MAX_FIX_GAP_S
            or bad[b] != bad[a]
            or changes[b] != changes[a]
            or _calc_max_aside_m(places[begin : k + 1]) > MAX_ASIDE_M
        ):
            begin = k
            continue
        chord = float(np.hypot(*(places[k] - places[begin])))
        if chord >= STRETCH_LENGTH_M:
            found.append((chord, float(way[b] - way[a]), float(loaded[a])))
            begin = k
    return np.array(found).reshape(-1, 3)


def _calc_max_aside_m(places: Array) -> float:
    """Returns the largest distance from the chord between the ends, m."""
    along = places[-1] - places[0]
    length = float(np.hypot(*along))
    if length < 1.0 or len(places) < 3:
        return 0.0
    off = places[1:-1] - places[0]
    return float(np.abs(off[:, 0] * along[1] - off[:, 1] * along[0]).max()) / length
