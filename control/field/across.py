"""What one rate across the width costs: the need under each head, or section, against the one
rate for all.

A machine meters by side only where each side has a metering unit of its own; with one roller
for all outlets the rate is that of the fused canopy, and what the crop needs next to it is
missed. Reported as the r.m.s. of need less rate, kg/ha, by the rule without grades. The heads'
own noise is part of it; how much of it that noise alone would make is reported next to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.agronomy.noa import Rule
from topdress.control.machine.machine import Machine

Floats = npt.NDArray[np.float64]

TABLE_STEP_NDVI = 0.001  # of the table of needs


class WidthError(NamedTuple):
    """kg/ha. `samples`: in which at least two heads spoke. `by_section_kg_ha`: None without
    sections."""

    mean_need_kg_ha: float
    by_head_kg_ha: float
    by_section_kg_ha: float | None
    # of the r.m.s. by head that the heads' noise alone would make
    noise_kg_ha: float
    samples: int


def measure_width_error(rule: Rule, machine: Machine, heads: npt.ArrayLike) -> WidthError | None:
    """heads: NDVI (samples, heads), left to right, NaN: silent. None where no two heads ever
    spoke together."""
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
    """Each section needs the mean of its heads; one without a head of its own is left out."""
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
    """One line."""
    by_section = (
        "" if found.by_section_kg_ha is None else f", by section {found.by_section_kg_ha:.1f}"
    )
    return (
        f"{found.by_head_kg_ha:.1f} kg/ha r.m.s. between the need under each head and the "
        f"one rate{by_section} "
        f"(the heads' noise alone would make {found.noise_kg_ha:.1f}; mean need "
        f"{found.mean_need_kg_ha:.1f})"
    )
