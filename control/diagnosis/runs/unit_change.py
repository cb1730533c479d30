"""Did a column change its unit within a log?

A logger that is restarted, or a file joined of two, may write kg above a row and lb below. The
machine is as before, but the column reads a multiple, and the multiple is the ratio of two units.
Both hypotheses predict the jump; they differ in its size. A unit predicts the ratio exactly, and an
effect that begins predicts any size, with a Cauchy distribution around 0 (`prior`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.judgement.prior import (
    MIN_REPORT_LOG_ODDS,
    ROBUST_SD,
    WRONG_UNIT_PROB,
    calc_log_prior_odds,
)
from topdress.control.recordings.speeds import KMH_PER_MPS, MILE_M, NAUTICAL_MILE_M

Array = npt.NDArray[np.float64]

# The international pound, kg.
POUND_KG = 0.45359237
_SPEEDS = {"km/h": 1.0 / KMH_PER_MPS, "mph": MILE_M / 3600.0, "kn": NAUTICAL_MILE_M / 3600.0}
_TURNS = {"r/s": 60.0, "rad/s": 30.0 / np.pi}
_LENGTHS = {"cm": 10.0, "m": 1000.0, "in": 25.4}
# Units that a column may be in, each in the column's own unit.
UNITS: dict[str, dict[str, float]] = {
    "shaft_rpm_cmd": _TURNS,
    "shaft_rpm": _TURNS,
    "opening_mm_cmd": _LENGTHS,
    "opening_mm": _LENGTHS,
    "speed_mps": _SPEEDS,
    "wheel_speed_mps": _SPEEDS,
    "hopper_kg": {"lb": POUND_KG, "t": 1000.0},
}
# The columns' own units, by the ending of their names.
OWN_UNITS = {
    "rpm": "r/min",
    "rpm_cmd": "r/min",
    "mm": "mm",
    "mm_cmd": "mm",
    "mps": "m/s",
    "kg": "kg",
}
# What a column is compared with: it goes in proportion, but for the machine's errors.
REFERENCES = {
    "shaft_rpm_cmd": "shaft_rpm",
    "shaft_rpm": "shaft_rpm_cmd",
    "opening_mm_cmd": "opening_mm",
    "opening_mm": "opening_mm_cmd",
    "speed_mps": "wheel_speed_mps",
    "wheel_speed_mps": "speed_mps",
}
# Share of the largest value, below which a ratio is mostly noise and dead zone.
MIN_SHARE = 0.1
# Rows on each side of a jump: fewer give no ratio.
MIN_ROWS = 40
# A jump by a unit's ratio is within this of it, natural logarithm: drives move by less in a row.
JUMP_TOLERANCE = 0.15
# Rows at which a jump is looked at in full: those with the largest jumps.
MAX_JUMPS = 20
# A ratio of readings before and after is known no better than this, natural logarithm: drives and
# loads change on the way.
RATIO_SD = 0.02
# Scale of the size of an effect that begins, natural logarithm: the widest prior of the catalogue
# for a gain, 10 %.
EFFECT_SCALE = 0.1
# Rows over which the scale's loss is summed for a ratio to the metered volume.
LOSS_ROWS = 200


class UnitChange(NamedTuple):
    """Describes a column that is in another unit from a row on. units : of the earlier and of the
    later rows, as far as their ratio tells. factor : of the later readings to the earlier ones for
    the same machine. log_odds : against an effect that begins there."""

    column: str
    row: int
    units: tuple[str, str]
    factor: float
    log_odds: float


def restore_units(
    columns: Mapping[str, Array], time_s: Array, findings: list[str]
) -> dict[str, Array]:
    """Return the columns (n,) with readings after a change of unit in the unit from before, and
    append a finding for each."""
    restored = dict(columns)
    for name in UNITS:
        change = find_unit_change(restored, name)
        if change is None:
            continue
        values = restored[name].copy()
        values[change.row :] /= change.factor
        restored[name] = values
        findings.append(
            f"column {name}: from row {change.row + 1} ({time_s[change.row]:.6g} s) it reads "
            f"{change.factor:.4g} times what it read before, as {change.units[0]} that become "
            f"{change.units[1]}, and the machine is as before: these rows are judged in the unit "
            "of the rows before"
        )
    return restored


def find_unit_change(columns: Mapping[str, Array], name: str) -> UnitChange | None:
    """Return the most probable change of unit of a column, or None where an effect that begins is
    as probable."""
    values = columns[name]
    known = np.flatnonzero(np.isfinite(values) & (values != 0.0))
    if len(known) < 2 * MIN_ROWS:
        return None
    jumps = np.diff(np.log(np.abs(values[known])))
    ratios = _calc_own_ratio(columns, name)
    if ratios is None:
        return None
    best: UnitChange | None = None
    for unit, size in UNITS[name].items():
        own = OWN_UNITS[name.split("_", name.startswith("wheel") + 1)[-1]]
        for factor, units in ((1.0 / size, (own, unit)), (size, (unit, own))):
            near = np.flatnonzero(np.abs(jumps - np.log(factor)) < JUMP_TOLERANCE)
            for at in near[np.argsort(np.abs(jumps[near] - np.log(factor)))][:MAX_JUMPS]:
                row = int(known[at + 1])
                log_odds = _calc_log_odds(*ratios, row, float(np.log(factor)), len(UNITS[name]))
                if log_odds > (MIN_REPORT_LOG_ODDS if best is None else best.log_odds):
                    best = UnitChange(name, row, units, factor, log_odds)
    return best


def _calc_own_ratio(
    columns: Mapping[str, Array], name: str
) -> tuple[npt.NDArray[np.int64], Array] | None:
    """Return rows (k,) and the logarithm of a column over its reference there (k,); for a scale,
    of its loss over the metered volume. None where the log has no reference."""
    if name == "hopper_kg":
        metered = np.abs(columns["shaft_rpm"] * columns["opening_mm"])
        kept = np.flatnonzero(np.isfinite(metered) & np.isfinite(columns[name]))
        pieces = kept[: len(kept) // LOSS_ROWS * LOSS_ROWS].reshape(-1, LOSS_ROWS)
        loss = columns[name][pieces[:, 0]] - columns[name][pieces[:, -1]]
        volume = metered[pieces].sum(axis=1)
        good = (loss > 0.0) & (volume > 0.0)
        if good.sum() < 2:
            return None
        return pieces[good, 0], np.log(loss[good] / volume[good])
    values, reference = np.abs(columns[name]), np.abs(columns[REFERENCES[name]])
    # Each row is compared with the largest value nearby: after a change of unit all are small.
    good = (reference > MIN_SHARE * np.nanmax(reference, initial=0.0)) & (values > 0.0)
    if good.sum() < 2 * MIN_ROWS:
        return None
    rows = np.flatnonzero(good)
    return rows, np.log(values[rows] / reference[rows])


def _calc_log_odds(
    rows: npt.NDArray[np.int64], ratio: Array, row: int, log_factor: float, units: int
) -> float:
    """Return the log posterior odds of a change of unit at a row against an effect that begins
    there: by the change of the median ratio."""
    before, after = ratio[rows < row], ratio[rows >= row]
    if min(len(before), len(after)) < 2:
        return -np.inf
    change = float(np.median(after) - np.median(before))
    noise = ROBUST_SD * float(np.median(np.abs(after - np.median(after))))
    sd = float(np.hypot(RATIO_SD, noise / np.sqrt(min(len(before), len(after)) / 2.0)))
    by_unit = -0.5 * ((change - log_factor) / sd) ** 2 - np.log(np.sqrt(2.0 * np.pi) * sd)
    by_effect = np.log(EFFECT_SCALE / (np.pi * (EFFECT_SCALE**2 + change**2)))
    prior = np.log(WRONG_UNIT_PROB / (2.0 * units)) - calc_log_prior_odds("begins", 1)
    return float(prior + by_unit - by_effect)
