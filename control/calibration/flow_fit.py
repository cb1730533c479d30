"""Catch test to flow model: grams per revolution and mm, and what the test shows beside it."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from control.machine.machine import Machine

from .adopt import record, retitled, with_records
from .bench_table import Array, BenchTable, usable
from .least_squares import Fit, Interval, fitted

LEVEL = 0.01            # an offset or a fall-off goes into the machine file only below this p


@dataclass(frozen=True, slots=True)
class FlowFit:
    """g per revolution = (grams_per_rev_mm opening_mm + zero_offset_g_rev) (1 - fill_falloff_percent/100 (n/100)^3).

    None: not shown by this test, 0 in the machine. `residual_percent`: (n,) measured over fitted - 1. Valid over the
    settings of the test.
    """

    grams_per_rev_mm: Interval
    zero_offset_g_rev: Interval | None
    fill_falloff_percent: Interval | None
    shaft_rpm: tuple[float, float]
    opening_mm: tuple[float, float]
    rows_used: int
    residual_sd_percent: float
    residual_percent: Array
    notes: tuple[str, ...]


def fit_flow(table: BenchTable, machine: Machine, *, date: str = "") -> tuple[Machine, FlowFit]:
    """Fits the flow model to a catch test and puts it into a copy of the machine.

    The noise is taken as a share of the mass. Zero offset and fall-off enter only where they are significant (1 %).
    Raises ValueError with one line where the table cannot give a flow.
    """
    table = usable(table)
    if table.kind != "catch":
        raise ValueError(f"{table.path}: a {table.kind} table: a flow fit needs a catch table")
    rows = _rows(table, machine)
    keep = (rows.mass_per_rev > 0.0) & (rows.opening_mm > 0.0)
    rows = _Rows(*(values[keep] for values in rows))
    if len(rows.mass_per_rev) < 2:
        raise ValueError(f"{table.path}: {len(rows.mass_per_rev)} rows with flow: at least 2 are needed")
    notes = [] if keep.all() else [f"{int((~keep).sum())} rows without flow or opening are left out"]
    terms = _terms(rows, notes)
    try:
        fit = _solved(rows, terms)
    except ValueError as error:
        raise ValueError(f"{table.path}: {error}") from None
    expected = rows.mass_per_rev - fit.residuals
    flow = _result(table, rows, terms, fit, 100.0 * fit.residuals / expected, tuple(notes))
    return _calibrated(machine, flow, table, date), flow


class _Rows(tuple[Array, Array, Array]):
    """Mass per revolution of all outlets (g), opening, shaft speed, each (n,)."""

    def __new__(cls, mass_per_rev: Array, opening_mm: Array, shaft_rpm: Array) -> _Rows:
        return super().__new__(cls, (mass_per_rev, opening_mm, shaft_rpm))

    @property
    def mass_per_rev(self) -> Array:
        return self[0]

    @property
    def opening_mm(self) -> Array:
        return self[1]

    @property
    def shaft_rpm(self) -> Array:
        return self[2]
