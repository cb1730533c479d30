"""Which flow model does a catch test give? Grams per revolution and mm, and further effects that
it shows."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from topdress.control.agronomy.product import CatchTest
from topdress.control.machine.machine import Machine, describe_unit

from .bench_table import Array, BenchTable, select_usable_rows
from .calibration_record import make_record, make_title, merge_records
from .least_squares import FittedInterval, LinearFit, fit_linear

# Significance below which an offset or a fall-off enters the machine file.
SIGNIFICANCE = 0.01


@dataclass(frozen=True, slots=True)
class FlowFit:
    """Holds the fitted flow:

    None: not shown by this test, 0 in the machine. `residual_percent`: (n,) measured over
    fitted - 1. Valid over the settings of the test."""

    grams_per_rev_mm: FittedInterval
    zero_offset_g_rev: FittedInterval | None
    fill_falloff_percent: FittedInterval | None
    shaft_rpm: tuple[float, float]
    opening_mm: tuple[float, float]
    rows_used: int
    residual_sd_percent: float
    residual_percent: Array
    notes: tuple[str, ...]


def fit_flow(table: BenchTable, machine: Machine, *, date: str = "") -> tuple[Machine, FlowFit]:
    """Fits the flow model to a catch test and returns a copy of the machine with it, and the
    fit.

    The noise is a share of the mass. Zero offset and fall-off enter only where they are
    significant (1 %).

    Raises
    ------
    ValueError : in one line, where the table cannot give a flow."""
    table = select_usable_rows(table)
    if table.kind != "catch":
        raise ValueError(f"{table.path}: a {table.kind} table: a flow fit needs a catch table")
    rows = _select_catch_rows(table, machine)
    # A row without flow has no relative error.
    keep = (rows.mass_per_rev > 0.0) & (rows.opening_mm > 0.0)
    rows = _CatchRows(*(values[keep] for values in rows))
    if len(rows.mass_per_rev) < 2:
        raise ValueError(
            f"{table.path}: {len(rows.mass_per_rev)} rows with flow: at least 2 are needed"
        )
    notes = (
        [] if keep.all() else [f"{int((~keep).sum())} rows without flow or opening are left out"]
    )
    try:
        terms, fit, said = _choose_terms(rows)
    except ValueError as error:
        raise ValueError(f"{table.path}: {error}") from None
    notes += said
    # The fitted mass is the measured mass minus the residual.
    percent = 100.0 * fit.residuals / (rows.mass_per_rev - fit.residuals)
    flow = FlowFit(
        fit.calc_interval(0),
        _find_coefficient(terms, fit, "zero_offset"),
        _find_coefficient(terms, fit, "fill_falloff", 100.0),
        (float(rows.shaft_rpm.min()), float(rows.shaft_rpm.max())),
        (float(rows.opening_mm.min()), float(rows.opening_mm.max())),
        len(percent),
        float(np.sqrt(np.sum(percent**2) / fit.dof)),
        percent,
        tuple(notes),
    )
    return _calibrate_machine(machine, flow, table, date), flow


class _CatchRows(NamedTuple):
    # Mass per revolution of all outlets, g, (n,).
    mass_per_rev: Array
    opening_mm: Array
    # Share of the shaft speed at which the fall-off is defined.
    share: Array
    shaft_rpm: Array


def _select_catch_rows(table: BenchTable, machine: Machine) -> _CatchRows:
    columns = table.columns
    grams = (
        1000.0
        * columns["mass_kg"]
        # The floor avoids a division by zero; such rows are replaced below.
        / np.maximum(columns["shaft_rpm"] / 60.0 * columns["duration_s"], 1e-9)
    )
    if "outlet" in columns:
        # A catch at one outlet stands for all outlets.
        grams = grams * machine.geometry.outlets
    return _CatchRows(
        np.where(columns["shaft_rpm"] > 0.0, grams, 0.0),
        columns["opening_mm"],
        columns["shaft_rpm"] / machine.flow.full_rpm,
        columns["shaft_rpm"],
    )


def _fit_coefficients(rows: _CatchRows, terms: tuple[str, ...]) -> LinearFit:
    """Fits by Gauss-Newton with the residuals in units of the fitted mass, so that noise is a
    share of it.

    Coefficients: grams per revolution and mm, then those of the terms, the fall-off as a share
    at full_rpm."""
    # The fill of the cells falls with the cube of the shaft speed, as in the machine model.
    fast = rows.share**3
    # The median of the quotients is a start that single bad catches do not move.
    slope, offset, falloff = float(np.median(rows.mass_per_rev / rows.opening_mm)), 0.0, 0.0
    fit = None
    # Twenty steps are an upper bound; the fit usually needs few.
    for _ in range(20):
        full = slope * rows.opening_mm + offset
        fills = 1.0 - falloff * fast
        columns = {"zero_offset": fills, "fill_falloff": -full * fast}
        design = np.column_stack([rows.opening_mm * fills, *(columns[name] for name in terms)])
        now = np.concatenate(
            [[slope], [{"zero_offset": offset, "fill_falloff": falloff}[name] for name in terms]]
        )
        fit = fit_linear(
            # Dividing by the fitted mass makes the noise a share of the mass.
            design,
            rows.mass_per_rev - full * fills + design @ now,
            np.maximum(full * fills, 1e-6),
        )
        found = dict(zip(terms, fit.coefficients[1:].tolist(), strict=True))
        moved = float(np.max(np.abs(fit.coefficients - now) / np.maximum(np.abs(now), 1e-3)))
        slope = float(fit.coefficients[0])
        offset, falloff = found.get("zero_offset", 0.0), found.get("fill_falloff", 0.0)
        # The change is far below the last printed digit.
        if moved < 1e-9:
            break
    assert fit is not None
    return fit


def _choose_terms(rows: _CatchRows) -> tuple[tuple[str, ...], LinearFit, list[str]]:
    """Returns the terms that this test shows by significance; the weakest is left out first."""
    notes = []
    terms: tuple[str, ...] = ()
    if len(np.unique(rows.opening_mm)) > 1:
        terms += ("zero_offset",)
    else:
        # At one opening both parameters describe the same line.
        notes.append("one opening only: a zero offset cannot be distinguished from the flow per mm")
    if len(np.unique(rows.shaft_rpm)) > 1:
        terms += ("fill_falloff",)
    else:
        notes.append("one shaft speed only: a fall-off cannot be shown")
    # Each parameter needs a row, and one more row to test it.
    while len(terms) and len(rows.mass_per_rev) <= len(terms) + 1:
        notes.append(f"too few rows for the {terms[-1].replace('_', ' ')}")
        terms = terms[:-1]
    fit = _fit_coefficients(rows, terms)
    while terms:
        # The least significant term is removed first, and the others are tested again.
        worst = int(np.argmax(fit.p_values[1:]))
        if fit.p_values[1 + worst] < SIGNIFICANCE:
            break
        notes.append(f"no {terms[worst].replace('_', ' ')} shown (p {fit.p_values[1 + worst]:.2g})")
        terms = tuple(name for k, name in enumerate(terms) if k != worst)
        fit = _fit_coefficients(rows, terms)
    return terms, fit, notes


def _find_coefficient(
    terms: tuple[str, ...], fit: LinearFit, name: str, times: float = 1.0
) -> FittedInterval | None:
    if name not in terms:
        return None
    found = fit.calc_interval(1 + terms.index(name))
    return FittedInterval(found.value * times, found.low * times, found.high * times)


def _calibrate_machine(machine: Machine, flow: FlowFit, table: BenchTable, date: str) -> Machine:
    valid = {"shaft_rpm": flow.shaft_rpm, "opening_mm": flow.opening_mm}
    records = [
        make_record(
            "flow.grams_per_rev_mm",
            flow.grams_per_rev_mm,
            "g per revolution and mm",
            table.path,
            date,
            valid,
        )
    ]
    if flow.zero_offset_g_rev is not None:
        records.append(
            make_record(
                "flow.zero_offset",
                flow.zero_offset_g_rev,
                "g per revolution",
                table.path,
                date,
                valid,
            )
        )
    if flow.fill_falloff_percent is not None:
        unit = describe_unit("flow.fill_falloff", machine)
        records.append(
            make_record(
                "flow.fill_falloff", flow.fill_falloff_percent, unit, table.path, date, valid
            )
        )
    stage = machine.flow._replace(
        grams_per_rev_mm=flow.grams_per_rev_mm.value,
        # The new grams per turn contain the old gain.
        gain_percent=0.0,
        zero_offset_g_rev=flow.zero_offset_g_rev.value if flow.zero_offset_g_rev else 0.0,
        fill_falloff_percent=flow.fill_falloff_percent.value if flow.fill_falloff_percent else 0.0,
    )
    # The model is validated again, because a fit can leave the allowed range.
    checked = Machine.model_validate({**dict(machine), "flow": stage})
    return checked.model_copy(
        update={
            "adopted": merge_records(
                machine, tuple(records), ("flow.gain", "flow.zero_offset", "flow.fill_falloff")
            ),
            "title": make_title(machine, "flow", table.path, date),
        }
    )


def make_catch_test(
    machine: Machine, fit: FlowFit, date: dt.date, data: str, sha256: str = ""
) -> CatchTest:
    """Returns the test as the product's file keeps it. machine: with which it was done. data,
    sha256: of the table."""
    grams = fit.grams_per_rev_mm
    return CatchTest(
        date=date,
        machine=machine.id,
        grams_per_rev_mm=grams.value,
        low=grams.low,
        high=grams.high,
        zero_offset_g_rev=fit.zero_offset_g_rev.value if fit.zero_offset_g_rev else 0.0,
        fill_falloff_percent=fit.fill_falloff_percent.value if fit.fill_falloff_percent else 0.0,
        rows=fit.rows_used,
        data=data,
        sha256=sha256,
    )
