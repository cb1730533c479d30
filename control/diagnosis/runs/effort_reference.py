"""Fits the reference effort of healthy drives to a run; later logs are compared with the
reference."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit
from topdress.control.calibration.calibration_record import make_record, make_title, merge_records
from topdress.control.calibration.least_squares import FittedInterval, fit_linear
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.machine.compiled import run_flutes
from topdress.control.machine.machine import Machine

from .effort import EFFORT_CHANNELS, DriveEffort, read_drive_effort
from .inputs import make_log_rows
from .log import clean_run_log

Array = npt.NDArray[np.float64]

# Minimum ratio of the upper to the lower quartile of speed, for a friction that depends on speed.
MIN_SPEED_RATIO = 1.3
# Minimum ratio of the quartiles of the material load, for a friction that depends on load.
MIN_LOAD_RATIO = 1.2
# Minimum number of bins for a fit.
MIN_BINS = 20


class EffortFit(NamedTuple):
    """Fitted reference of a drive. numbers : each with its key in the machine file, its 90 %
    interval and its unit. scatter : 1 s.d. of a bin."""

    numbers: tuple[tuple[str, FittedInterval, str], ...]
    bins: int
    mean: float
    scatter: float
    unit: str
    notes: tuple[str, ...]


def fit_effort(
    columns: Mapping[str, npt.NDArray[Any]],
    machine: Machine,
    data: str,
    *,
    unit: str | None = None,
    date: str = "",
) -> tuple[Machine, tuple[EffortFit, ...]]:
    """Write the efforts of a healthy run into a copy of the machine: dry friction by direction, and
    dependence on speed and load.

    Dependence on speed or load is fitted where the run has several speeds or loads. Otherwise dry
    friction includes both.

    Raises ValueError, one line, where no drive of the log shows its effort while it moves.
    """
    log = clean_run_log(columns)
    every, fits = make_log_rows(log, machine), list[EffortFit]()
    fitted_machine = machine.model_copy(update={"effort_unit": unit or machine.effort_unit})
    for name in EFFORT_CHANNELS:
        drive = read_drive_effort(name, log, every, machine) if name in log.stages else None
        if drive is not None and int((drive.members > 0).sum()) >= MIN_BINS:
            fitted_machine, fit = _fit_drive_effort(drive, fitted_machine)
            fits.append(fit)
    if not fits:
        raise ValueError(
            f"{data}: no drive tells how hard it works while it moves: shaft_effort or "
            "gate_effort is "
            f"needed, with the speed or the opening, in {MIN_BINS} half seconds at least"
        )
    records = tuple(
        make_record(place, one, of, data, date, {})
        for fit in fits
        for place, one, of in fit.numbers
    )
    of_effort = [one for one, row in EFFECT_ROWS.items() if row.stage == "effort"]
    return Machine.model_validate(
        {
            **dict(fitted_machine),
            # A file that lists its stages would not read the reference otherwise.
            "stages": machine.stages and tuple(dict.fromkeys((*machine.stages, "effort"))),
            "adopted": merge_records(machine, records, of_effort),
            "title": make_title(machine, "effort", data, date),
        }
    ), tuple(fits)


def _fit_drive_effort(d: DriveEffort, machine: Machine) -> tuple[Machine, EffortFit]:
    of, per = ("", "r/min") if d.name == "effort" else ("gate_", "mm/s")
    stage, notes = machine.effort._replace(by_supply=float(machine.effort_unit == "%")), []
    left = d.measured / (1.0 + stage.by_supply * (d.supply_share - 1.0))
    flutes = run_flutes(
        machine.flow, d.speed, d.opening_mm, d.pitch_deg, d.share_full, d.time_s, d.refilled
    )[:, 0]
    asked: dict[str, tuple[Array, str]] = {}
    for suffix, way in (("", d.speed > 0.0), ("_back", d.speed < 0.0)):
        if not way.any():
            stage = stage._replace(**{f"{of}coulomb{suffix}": 0.0, f"{of}viscous{suffix}": 0.0})
            continue
        asked[f"{of}coulomb{suffix}"] = way.astype(np.float64), machine.effort_unit
        slow, fast = np.nanquantile(
            np.abs(d.bin_row_means(np.where(way, d.speed, np.nan))), (0.25, 0.75)
        )
        stage = stage._replace(**{f"{of}viscous{suffix}": 0.0})
        if fast > MIN_SPEED_RATIO * slow:
            asked[f"{of}viscous{suffix}"] = (
                np.where(way, np.abs(d.speed), 0.0),
                f"{machine.effort_unit} for each {per}",
            )
        else:
            notes.append(
                f"{d.name}: one speed{suffix.replace('_', ' ')}: what goes with speed does "
                "not part from dry "
                "friction and counts as such"
            )
    if d.name == "effort" and flutes.any():
        light, heavy = np.quantile(flutes, (0.05, 0.95))
        if heavy > MIN_LOAD_RATIO * max(light, 1e-9):
            asked["load"] = flutes, f"{machine.effort_unit} for each g a revolution"
        else:
            notes.append(
                "effort: one opening: the material's load does not part from friction: the "
                "file's is kept"
            )
            left = left - stage.load * flutes
    names = list(asked)
    design = np.column_stack([d.bin_row_means(asked[name][0]) for name in names])
    known = d.members > 0
    y = d.bin_row_means(left)[known]
    fit = fit_linear(design[known], y, 1.0 / np.sqrt(d.members[known]))
    below = [
        k for k, name in enumerate(names) if fit.coefficients[k] <= 0.0 and "coulomb" not in name
    ]
    for k in below:
        notes.append(f"{names[k]}: not above 0 in this run, left out")
        stage = stage._replace(**{names[k]: 0.0})
    if below:
        names = [name for k, name in enumerate(names) if k not in below]
        fit = fit_linear(
            design[known][:, [k for k in range(design.shape[1]) if k not in below]],
            y,
            1.0 / np.sqrt(d.members[known]),
        )
    # Neighbouring bins are correlated, so an effective number of bins is used (Bayley and
    # Hammersley, J. R. Stat. Soc. 8, 1946, 184).
    alike = float(np.clip(np.corrcoef(fit.residuals[1:], fit.residuals[:-1])[0, 1], 0.0, 0.98))
    wider = np.sqrt((1.0 + alike) / (1.0 - alike))
    numbers = []
    for k, name in enumerate(names):
        value = max(0.0, float(fit.coefficients[k]))
        half = float(stdtrit(max(1.0, fit.dof / wider**2), 0.95) * fit.se[k] * wider)
        stage = stage._replace(**{name: value})
        numbers.append(
            (f"effort.{name}", FittedInterval(value, value - half, value + half), asked[name][1])
        )
    scatter = float(fit.residuals.std())
    # Converts the scatter of a bin's mean to that of a single reading, with the correlation of
    # neighbouring bins.
    a_reading = scatter * wider * np.sqrt(d.rows_per_bin)
    noise = machine.noise.model_copy(update={"effort": max(1e-4, float(f"{a_reading:.3g}"))})
    return machine.model_copy(update={"effort": stage, "noise": noise}), EffortFit(
        tuple(numbers), len(y), float(y.mean()), scatter, machine.effort_unit, tuple(notes)
    )
