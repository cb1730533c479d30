"""Estimates the cost of a named effect in the field when it is not compensated, at the log's own
operating points.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effect_cost import (
    COSTS_OUTSIDE_MODEL,
    OperatingPoint,
    calc_rate_error,
)
from topdress.control.diagnosis.effects import EFFECT_ROWS, CostKind, LogRequirement
from topdress.control.diagnosis.result import FieldCost
from topdress.control.experiments.setting_levels import USUAL_SPEED_MPS
from topdress.control.machine.machine import Machine
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S
from topdress.control.recordings.speed_unit import MOVING_MPS

from .channels import SEAM_S, select_speed_rows, simulate_drive_rows
from .drives import Drive
from .grid import join_clock
from .hypothesis import EffectInstance, Schedule, add_part, list_stages, make_schedule
from .stages import RunData

Array = npt.NDArray[np.float64]

# Maximum number of operating points of a log, evenly spaced over the log.
MAX_OPERATING_POINTS = 500
# Minimum length of a window in which a drive's lag is measured, s: longer than any delay.
MIN_WINDOW_S = 5.0


def calc_field_cost(part: EffectInstance, machine: Machine, data: RunData) -> FieldCost:
    """Return the mean change of the dose, %, and of the landing position, m (late is positive),
    from the effect's onset to the end of the log.

    None means that the log cannot tell such a cost. The cost of a speed sensor's effect assumes
    that this sensor alone gives the speed. The cost of the scale's effect assumes that the flow
    follows the scale.
    """
    costs = EFFECT_ROWS[part.id].costs
    if costs in COSTS_OUTSIDE_MODEL:
        return COSTS_OUTSIDE_MODEL[costs]
    if costs is CostKind.PLACE:
        late_s = _calc_extra_lag_s(part, machine, data)
        return FieldCost(0.0, None if late_s is None else round(late_s * _calc_mean_speed(data), 3))
    rate = _rate_percent(part, machine, data)
    return FieldCost(None if rate is None else round(rate, 2), 0.0)


def _make_both_schedules(part: EffectInstance, machine: Machine) -> tuple[Schedule, Schedule]:
    base = list_stages(machine)
    return make_schedule(base, ()), make_schedule(base, (part,))


def _rate_percent(part: EffectInstance, machine: Machine, data: RunData) -> float | None:
    drive = {"shaft": data.shaft, "gate": data.gate}.get(EFFECT_ROWS[part.id].stage)
    onset_s = part.onset_s or -np.inf
    time_s = (
        np.linspace(data.time_s[0], data.time_s[-1], MAX_OPERATING_POINTS)
        if drive is None
        else drive.time_s
    )
    rows = np.flatnonzero(time_s >= onset_s)
    if not len(rows):
        return None
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, MAX_OPERATING_POINTS).astype(int))]
    points = _list_operating_points(
        data, machine, time_s[rows], float(LogRequirement.REFILL in EFFECT_ROWS[part.id].needs)
    )
    changed = machine.model_copy(update=add_part(list_stages(machine), part).by_name)
    if drive is None:
        return calc_rate_error(machine, points, changed, points)
    wanted, applied = (
        _find_standing_rows(drive, plan)[rows] for plan in _make_both_schedules(part, machine)
    )
    return calc_rate_error(
        machine,
        _place_operating_points(points, drive, wanted),
        changed,
        _place_operating_points(points, drive, applied),
    )


def _list_operating_points(
    data: RunData, machine: Machine, time_s: Array, refills: float
) -> list[OperatingPoint]:
    """Return operating points at times of the log (n,), as they were commanded; unrecorded inputs
    have their nominal values."""
    at = np.maximum(0, np.searchsorted(data.time_s, time_s, side="right") - 1)
    usual = {
        "shaft_rpm": machine.set_points.shaft_rpm,
        "opening_mm": machine.set_points.opening_mm,
        "hopper_kg": machine.flow.full_kg,
        "speed_mps": USUAL_SPEED_MPS,
        "pitch_deg": 0.0,
    }
    known = {
        name: data.variables[name][at].tolist() if name in data.variables else [value] * len(at)
        for name, value in usual.items()
    }
    known |= {"time_s": time_s.tolist(), "working": data.working[at].tolist()}
    return [
        OperatingPoint(**dict(zip(known, values, strict=True)), refills=refills)
        for values in zip(*known.values(), strict=True)
    ]


def _find_standing_rows(drive: Drive, plan: Schedule) -> Array:
    """Return the true position of a drive at its rows (n,).

    A gate is controlled by its own reading, so the true opening differs from the command by the
    error of the reading.
    """
    if drive.name == "shaft":
        return simulate_drive_rows(drive)(plan, MAX_MODEL_STEP_S)[:, 0]
    true, read = simulate_drive_rows(drive)(plan, MAX_MODEL_STEP_S).T
    return np.asarray(np.maximum(0.0, 2.0 * true - read))


def _place_operating_points(
    points: list[OperatingPoint], drive: Drive, standing: Array
) -> list[OperatingPoint]:
    field = "shaft_rpm" if drive.name == "shaft" else "opening_mm"
    return [
        point._replace(**{field: float(value)})
        for point, value in zip(points, standing, strict=True)
    ]


def _calc_extra_lag_s(part: EffectInstance, machine: Machine, data: RunData) -> float | None:
    """Return the additional lag of a drive or a sensor, s; None where the log does not move it."""
    plans = _make_both_schedules(part, machine)
    stage = EFFECT_ROWS[part.id].stage
    drive = {"shaft": data.shaft, "gate": data.gate}.get(stage)
    if drive is not None:
        moves = np.flatnonzero(np.diff(drive.command)) + 1
        now, late = (_find_standing_rows(drive, plan) for plan in plans)
        return _calc_lag_s(
            now, late, drive.clock_s, moves[drive.time_s[moves] >= (part.onset_s or -np.inf)]
        )
    if stage == "speed" and data.speed is not None:
        every = np.flatnonzero(data.speed.time_s >= (part.onset_s or -np.inf))
        now, late = (select_speed_rows(data.speed)(plan, MAX_MODEL_STEP_S)[:, 1] for plan in plans)
        return _calc_lag_s(now, late, join_clock(data.speed.time_s, SEAM_S), every)
    return None


def _calc_lag_s(
    now: Array, late: Array, clock_s: Array, moves: npt.NDArray[np.int64]
) -> float | None:
    """Estimate the lag of one series behind another, s, by least squares over windows from one move
    to a later move.

    A series that lags by d seconds falls behind by d times its travelled distance. now, late :
    series (n,) at `clock_s`; moves : rows at which a move begins.
    """
    cuts: list[int] = []
    for row in moves.tolist():
        if not cuts or clock_s[row] - clock_s[cuts[-1]] >= MIN_WINDOW_S:
            cuts.append(row)
    behind = np.concatenate(([0.0], np.cumsum((now - late)[:-1] * np.diff(clock_s))))
    fell, went = np.diff(behind[cuts]), np.diff(now[cuts])
    return float(fell @ went / (went @ went)) if np.any(went) else None


def _calc_mean_speed(data: RunData) -> float:
    speed = data.variables.get("speed_mps")
    if speed is None:
        return USUAL_SPEED_MPS
    moving = speed[(data.working > 0.0) & (speed > MOVING_MPS)]
    return float(np.mean(moving)) if len(moving) else USUAL_SPEED_MPS
