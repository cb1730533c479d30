"""Estimates the error of a single rate across the width: the need under each head, or section,
against the common rate.

A machine varies the rate by side only with a metering unit for each side; with one roller for all
outlets the rate is that of the fused canopy. The error is the r.m.s. of need minus rate, kg/ha, by
the rule without grades. It includes the heads' own noise, whose share is reported separately.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.agronomy.nitrogen_rate import CropRule
from topdress.control.machine.machine import Machine

Floats = npt.NDArray[np.float64]

# Step of the table of needs, NDVI.
TABLE_STEP_NDVI = 0.001


class WidthError(NamedTuple):
    """Errors of a single rate, kg/ha. `samples`: number of samples with at least two valid
    heads. `by_section_kg_ha`: None without sections."""

    mean_need_kg_ha: float
    by_head_kg_ha: float
    by_section_kg_ha: float | None
    # R.m.s. by head that the heads' noise alone would cause, kg/ha.
    noise_kg_ha: float
    samples: int


def measure_width_error(
    rule: CropRule, machine: Machine, heads: npt.ArrayLike
) -> WidthError | None:
    """Measure the error of a single rate from NDVI of the heads (samples, heads), left to right,
    NaN for a silent head; None where no sample has two valid heads."""
    ndvi = np.asarray(heads, dtype=np.float64)
    ndvi = ndvi[np.count_nonzero(np.isfinite(ndvi), axis=1) >= 2]
    if not len(ndvi):
        return None
    table = np.arange(0.0, 1.0 + TABLE_STEP_NDVI, TABLE_STEP_NDVI)
    smooth = replace(rule, crop=rule.crop.model_copy(update={"grades": False}))
    needs = np.array([smooth.decide_rate(value).rate_kg_ha for value in table.tolist()])

    def need(values: Floats) -> Floats:
        return np.asarray(np.interp(values, table, needs), dtype=np.float64)

    middle = np.nanmedian(ndvi, axis=1)
    one_rate = need(middle)
    known = np.isfinite(ndvi)
    by_head = np.where(known, need(np.nan_to_num(ndvi)), np.nan)
    slope = np.gradient(needs, table)
    noise = machine.noise.ndvi * np.interp(middle, table, np.abs(slope))
    return WidthError(
        float(one_rate.mean()),
        _calc_rms(by_head - one_rate[:, None]),
        _calc_section_error(machine, by_head, one_rate),
        float(np.sqrt((noise**2).mean())),
        len(ndvi),
    )


def _calc_section_error(machine: Machine, by_head: Floats, one_rate: Floats) -> float | None:
    """Return the r.m.s. error by section: each section needs the mean of its heads; a section
    without a head is left out."""
    if not machine.sections:
        return None
    ends = np.cumsum([section.outlets for section in machine.sections]) / machine.geometry.outlets
    count = by_head.shape[1]
    of = np.searchsorted(ends, (np.arange(count) + 0.5) / count)
    columns: Sequence[Floats] = [
        np.nanmean(by_head[:, of == k], axis=1) for k in sorted(set(of.tolist()))
    ]
    return _calc_rms(np.column_stack(columns) - one_rate[:, None])


def _calc_rms(values: Floats) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def describe_width_error(found: WidthError) -> str:
    """Describe the errors in one line."""
    by_section = (
        "" if found.by_section_kg_ha is None else f", by section {found.by_section_kg_ha:.1f}"
    )
    return (
        f"{found.by_head_kg_ha:.1f} kg/ha r.m.s. between the need under each head and the "
        f"one rate{by_section} "
        f"(the heads' noise alone would make {found.noise_kg_ha:.1f}; mean need "
        f"{found.mean_need_kg_ha:.1f})"
    )
