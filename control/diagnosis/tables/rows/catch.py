"""Catch tables: mass from a turning shaft in a given time, all outlets together or each by itself."""
from __future__ import annotations

from math import pi

import numpy as np

from control.calibration.bench_table import BenchTable
from control.diagnosis.effects import (
    FLOW_FILL_FALLOFF,
    FLOW_GAIN,
    FLOW_OUTLET_UNEVEN,
    FLOW_PULSATION,
    FLOW_ZERO_OFFSET,
)
from control.diagnosis.tables.piece import Array, TableCandidate, TablePiece, varying
from control.machine.flow import Flow, grams_per_rev
from control.machine.machine import Machine

from .labels import column_of, labels_of

SMALL_SHARE = 0.1           # of the median mass: below it even proportional noise is constant
MIN_LEVELS_LEFT = 3         # shaft speeds that free shapes of a fall-off must leave, or they would pass for a gain
MAX_PASSAGES = 3.0          # flute passages in the shortest catch, above which no catch shows a pulsation


def pieces(table: BenchTable, machine: Machine) -> tuple[TablePiece, ...]:
    """One piece: mass_kg. Its noise is constant, a share of the mass, or between; the replicates decide."""
    columns = table.columns
    rpm, opening, lasts_s = columns["shaft_rpm"], columns["opening_mm"], columns["duration_s"]
    outlet = columns.get("outlet")

    def steady(m: Machine) -> Array:
        return _mass(m.flow, rpm, opening, lasts_s, outlet, m.geometry.outlets)

    nominal = steady(machine)
    angle = 2.0 * pi * machine.flow.flutes * rpm / 60.0 * lasts_s
    begins = _begins(columns["mass_kg"], nominal, angle)

    def predict(m: Machine) -> Array:
        return steady(m) + nominal * m.flow.pulsation_percent / 100.0 * _pulse(angle, begins)

    share = np.maximum(nominal, 1e-9) / (float(np.median(nominal)) or 1.0)
    spreads = (np.ones(table.rows), np.hypot(share, 1.0) / np.sqrt(2.0), np.hypot(share, SMALL_SHARE))
    wide = machine.model_copy(update={"flow": machine.flow._replace(zero_offset_g_rev=machine.flow.zero_offset_g_rev
                                      + machine.flow.grams_per_rev_mm * machine.tolerance.opening_mm)})
    variables = {"shaft_rpm": rpm, "opening_mm": opening, "duration_s": lasts_s,
                 "replicate": columns.get("replicate", np.full(table.rows, np.nan))}
    if outlet is not None:
        variables["outlet"] = outlet
    candidates = _candidates(outlet, pulsates=bool(angle.min() / (2.0 * pi) < MAX_PASSAGES
                                                   and len(np.unique(lasts_s)) > 2))
    return (TablePiece(f"{table.path} mass_kg".strip(), "flow", "kg", columns["mass_kg"], predict,
                       spreads, labels_of(table), column_of(table), candidates,
                       (FLOW_GAIN.id,), varying(variables),
                       {"flow": nominal * machine.tolerance.flow_percent / 100.0, "opening_mm": predict(wide) - nominal,
                        **_each_outlet(nominal, outlet, machine)},
                       {FLOW_FILL_FALLOFF.id: _falloffs(nominal, rpm, rpm, machine.flow.full_rpm),
                        FLOW_PULSATION.id: np.column_stack([        # of another shape: a second harmonic too
                            nominal * _pulse(2.0 * angle, begins) for begins in (0.0, pi / 2.0)])},
                       {FLOW_FILL_FALLOFF.id: -100.0 * _falloffs(np.ones(1), np.full(1, machine.flow.full_rpm), rpm,
                                                                 machine.flow.full_rpm)[0]}),)


def _candidates(outlet: Array | None, pulsates: bool) -> tuple[TableCandidate, ...]:
    outlets = [] if outlet is None else [int(k) for k in np.unique(outlet) if k == int(k)]
    return (*(TableCandidate(row.id) for row in (FLOW_GAIN, FLOW_ZERO_OFFSET, FLOW_FILL_FALLOFF)),
            *(TableCandidate(FLOW_OUTLET_UNEVEN.id, k) for k in outlets),
            *((TableCandidate(FLOW_PULSATION.id),) if pulsates else ()))


def _mass(flow: Flow, rpm: Array, opening: Array, lasts_s: Array, outlet: Array | None, outlets: int) -> Array:
    grams = [grams_per_rev(flow, n, o) for n, o in zip(rpm.tolist(), opening.tolist(), strict=True)]
    mass = np.array(grams) * rpm / 60.0 * lasts_s / 1000.0
    if outlet is None:
        return mass * (1.0 + (flow.uneven_percent / outlets / 100.0 if flow.uneven_outlet > 0.0 else 0.0))
    return mass / outlets * (1.0 + np.where(outlet == flow.uneven_outlet, flow.uneven_percent / 100.0, 0.0))


def _each_outlet(nominal: Array, outlet: Array | None, machine: Machine) -> dict[str, Array]:
    """Outlets differ by as much as leaves their sum within its tolerance."""
    if outlet is None:
        return {}
    share = machine.tolerance.flow_percent / 100.0 * float(np.sqrt(machine.geometry.outlets))
    return {f"outlet_{k:g}": np.where(outlet == k, nominal * share, 0.0) for k in np.unique(outlet).tolist()}


def _falloffs(nominal: Array, rpm: Array, tested_rpm: Array, full_rpm: float) -> Array:
    """Other shapes that a loss at high shaft speed may have, (n, k); fewer where fewer speeds were tested."""
    fast = rpm / full_rpm
    shapes = [fast ** 2, fast ** 5, np.maximum(0.0, fast - 0.6), fast, np.maximum(0.0, fast - 0.4)]
    return np.column_stack([nominal * shape for shape in shapes[:max(1, len(np.unique(tested_rpm)) - MIN_LEVELS_LEFT)]])


def _pulse(angle: Array, begins: float) -> Array:
    """Mean of the model's sine (flow_step) over a catch of that many radians of flutes, started at `begins`, (n,)."""
    angle = np.maximum(angle, 1e-9)
    return np.asarray((np.cos(begins) - np.cos(begins + angle)) / angle)


def _begins(mass: Array, nominal: Array, angle: Array) -> float:
    """Where in a flute's passage the catches begin, radians: the phase that fits, the rest being steady."""
    known = nominal > 0.0
    columns = [np.ones(int(known.sum())), _pulse(angle, 0.0)[known], _pulse(angle, pi / 2.0)[known]]
    fit, *_ = np.linalg.lstsq(np.column_stack(columns) * nominal[known, None], mass[known], rcond=None)
    return float(np.arctan2(fit[2], fit[1]))
