"""Did a column change its unit within a log?

A logger that is restarted, or a file joined of two, may write kg above a row and lb below. The
machine is as before, but the column reads a multiple, and the multiple is the ratio of two units.
Two things tell a unit from an effect that begins. A unit predicts the ratio exactly, and an effect
any size, with a Cauchy distribution around 0 (`prior`). And a unit leaves the relative noise as it
is, while a drive that stands, or starts, reads noise alone.
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
from topdress.control.recordings.speed_unit import KMH_PER_MPS, MILE_M, NAUTICAL_MILE_M
from topdress.control.signals import SIGNALS

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
MIN_REFERENCE_SHARE = 0.1
# Values with a reference before and after a jump: fewer give no median.
MIN_ROWS = 40
# A jump by a unit's ratio is within this of it, natural logarithm: drives move by less in a row.
JUMP_TOLERANCE = 0.15
# A ratio of readings before and after is known no better than this, natural logarithm: drives and
# loads change on the way.
RATIO_SD = 0.02
# Scale of the size of an effect that begins, natural logarithm: the widest prior of the catalogue
# for a gain, 10 %.
EFFECT_SCALE = 0.1
# Standard deviation of the logarithm by which the relative noise differs between two parts of a log
# on the same machine: a factor of two, for manoeuvres differ.
NOISE_RATIO_SD = np.log(2.0)
# The same where the two parts differ as rounding and noise alone do: a factor of 20.
OTHER_NOISE_RATIO_SD = np.log(20.0)
# Rows over which the scale's loss is summed for a ratio to the metered volume.
LOSS_ROWS = 200
# Sums of that length before and after a jump: 40 s of work at ten rows a second.
MIN_LOSSES = 2


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
    rows, ratios = _calc_own_ratio(columns, name)
    values = columns[name]
    # The column itself jumps, not the one that it is compared with.
    known = np.flatnonzero(np.isfinite(values) & (values != 0.0))
    steps = np.diff(np.log(np.abs(values[known])))
    least = MIN_LOSSES if name == "hopper_kg" else MIN_ROWS
    best: UnitChange | None = None
    for unit, size in UNITS[name].items():
        own = SIGNALS[name].unit
        for factor, units in ((1.0 / size, (own, unit)), (size, (unit, own))):
            log_factor = float(np.log(factor))
            jumps = known[1:][np.abs(steps - log_factor) < JUMP_TOLERANCE]
            places = np.searchsorted(rows, jumps)
            inside = (places >= least) & (places <= len(rows) - least)
            if not inside.any():
                continue
            jumps, places = jumps[inside], places[inside]
            deviations = _calc_deviations(ratios, log_factor)
            likeliest = int(np.argmin(deviations[places]))
            at, row = places[likeliest], int(jumps[likeliest])
            log_odds = _calc_log_odds(
                ratios[:at],
                ratios[at:],
                log_factor,
                # A jump elsewhere than where the ratio changes is one of the readings' noise.
                apart=float(deviations[at] - deviations.min()),
                least=least,
                units=len(UNITS[name]),
            )
            if log_odds > (best.log_odds if best else MIN_REPORT_LOG_ODDS):
                best = UnitChange(name, row, units, factor, log_odds)
    return best


def _calc_deviations(ratios: Array, log_factor: float) -> Array:
    """Return for each place (k + 1,) the sum of absolute deviations of ratios (k,), if they are
    larger by a factor from this place on. Their median is that of the longer part."""
    found = []
    for level in (0.0, log_factor):
        off = ratios - np.median(ratios) + level
        moved = np.abs(off - log_factor)
        found.append(np.concatenate(([0.0], np.cumsum(np.abs(off) - moved))) + float(np.sum(moved)))
    return np.minimum(*found)


def _calc_own_ratio(columns: Mapping[str, Array], name: str) -> tuple[npt.NDArray[np.int64], Array]:
    """Return row numbers (k,) and, in these rows, log(column / reference) (k,). For the hopper
    scale it is log(mass lost / volume metered)."""
    if name == "hopper_kg":
        metered = np.abs(columns["shaft_rpm"] * columns["opening_mm"])
        kept = np.flatnonzero(np.isfinite(metered) & np.isfinite(columns[name]))
        pieces = kept[: len(kept) // LOSS_ROWS * LOSS_ROWS].reshape(-1, LOSS_ROWS)
        loss = columns[name][pieces[:, 0]] - columns[name][pieces[:, -1]]
        volume = metered[pieces].sum(axis=1)
        good = (loss > 0.0) & (volume > 0.0)
        return pieces[good, 0], np.log(loss[good] / volume[good])
    values, reference = np.abs(columns[name]), np.abs(columns[REFERENCES[name]])
    rows = np.flatnonzero(
        (reference > MIN_REFERENCE_SHARE * np.nanmax(reference, initial=0.0)) & (values > 0.0)
    )
    return rows, np.log(values[rows] / reference[rows])


def _calc_log_odds(
    before: Array, after: Array, log_factor: float, *, apart: float, least: int, units: int
) -> float:
    """Return the log posterior odds of a change of unit against an effect that begins.

    Parameters
    ----------
    before, after : logarithms of the column over its reference (k,), in the rows before and after.
    log_factor : logarithm of the ratio of the two units.
    apart : sum of absolute deviations over that of the place that fits best.
    least : number of values that are worth an independent one: neighbouring rows are correlated.
    units : number of units that the column may have.
    """
    change = float(np.median(after) - np.median(before))
    noise = [
        float(np.hypot(RATIO_SD, ROBUST_SD * np.median(np.abs(side - np.median(side)))))
        for side in (before, after)
    ]
    counts = [len(side) / least for side in (before, after)]
    of_medians = np.hypot(noise[0] / counts[0] ** 0.5, noise[1] / counts[1] ** 0.5)
    sd = float(np.hypot(RATIO_SD, of_medians))
    by_unit = _calc_log_normal(change - log_factor, sd)
    by_effect = np.log(EFFECT_SCALE / (np.pi * (EFFECT_SCALE**2 + change**2)))
    noise_ratio = float(np.log(noise[1] / noise[0]))
    same = _calc_log_normal(noise_ratio, NOISE_RATIO_SD)
    other = _calc_log_normal(noise_ratio, OTHER_NOISE_RATIO_SD)
    # Laplace's distribution: the log-likelihood is the sum of absolute deviations over their scale.
    place = -apart / (max(noise) * least)
    prior = np.log(WRONG_UNIT_PROB / (2.0 * units)) - calc_log_prior_odds("begins", 1)
    return float(prior + by_unit - by_effect + same - other + place)


def _calc_log_normal(value: float, sd: float) -> float:
    """Return the log density of a normal variable around 0."""
    return float(-0.5 * (value / sd) ** 2 - np.log(np.sqrt(2.0 * np.pi) * sd))
