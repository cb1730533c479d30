"""Catch tables: mass from a turning shaft in a given time, all outlets together or each by itself."""
from __future__ import annotations

from math import cos, pi

import numpy as np

from control.calibration.bench_table import BenchTable
from control.machine.flow import Flow, grams_per_rev
from control.machine.machine import Machine

from .piece import Array, Choice, Piece, varying

SMALL_SHARE = 0.1           # of the median mass: below it the noise is no longer a share of the mass
FAST_TURNS = 3.0            # flute passages in a catch, above which it is too slow to show a pulsation


def pieces(table: BenchTable, machine: Machine) -> tuple[Piece, ...]:
    """One piece: mass_kg. Its noise is a share of the mass, with a floor."""
    columns = table.columns
    rpm, opening, lasts_s = columns["shaft_rpm"], columns["opening_mm"], columns["duration_s"]
    outlet = columns.get("outlet")

    def predict(m: Machine) -> Array:
        return _mass(m.flow, rpm, opening, lasts_s, outlet, m.geometry.outlets)

    nominal = predict(machine)
    typical = float(np.median(nominal)) or 1.0
    choices = [Choice("flow.gain"), Choice("flow.zero_offset"), Choice("flow.fill_falloff")]
    if outlet is not None:
        choices += [Choice("flow.outlet_uneven", int(k)) for k in np.unique(outlet) if k == int(k)]
    passages = float(machine.flow.flutes) * rpm / 60.0 * lasts_s
    if passages.min() < FAST_TURNS and len(np.unique(lasts_s)) > 2:
        choices.append(Choice("flow.pulsation"))
    fast = rpm / 100.0
    shapes = [fast, fast ** 2, fast ** 5, np.maximum(0.0, fast - 0.4), np.maximum(0.0, fast - 0.6)]
    wide = machine.model_copy(update={"flow": machine.flow._replace(zero_offset_g_rev=machine.flow.zero_offset_g_rev
                                      + machine.flow.grams_per_rev_mm * machine.tolerance.opening_mm)})
    variables = {"shaft_rpm": rpm, "opening_mm": opening, "duration_s": lasts_s,
                 "replicate": columns.get("replicate", np.full(table.rows, np.nan))}
    if outlet is not None:
        variables["outlet"] = outlet
    label = np.full(table.rows, "") if table.label is None else table.label
    return (Piece(f"{table.path} mass_kg".strip(), "flow", "kg", columns["mass_kg"], predict,
                  np.hypot(nominal, SMALL_SHARE * typical) / typical, label, tuple(choices),
                  ("flow.gain",), varying(variables),
                  {"flow": nominal * machine.tolerance.flow_percent / 100.0, "opening_mm": predict(wide) - nominal},
                  {"flow.fill_falloff": np.column_stack([nominal * shape for shape in shapes]),
                   "flow.pulsation": _out_of_phase(machine.flow, nominal, rpm, lasts_s)}),)


def _mass(flow: Flow, rpm: Array, opening: Array, lasts_s: Array, outlet: Array | None, outlets: int) -> Array:
    grams = [grams_per_rev(flow, n, o) for n, o in zip(rpm.tolist(), opening.tolist(), strict=True)]
    mass = np.array(grams) * rpm / 60.0 * lasts_s / 1000.0
    if flow.pulsation_percent != 0.0:
        angles = 2.0 * pi * flow.flutes * rpm / 60.0 * lasts_s
        mass = mass * (1.0 + flow.pulsation_percent / 100.0 * np.array([_pulse(angle) for angle in angles.tolist()]))
    if outlet is None:
        return mass * (1.0 + (flow.uneven_percent / outlets / 100.0 if flow.uneven_outlet > 0.0 else 0.0))
    return mass / outlets * (1.0 + np.where(outlet == flow.uneven_outlet, flow.uneven_percent / 100.0, 0.0))


def _pulse(angle: float) -> float:
    """Mean of the model's sine over a catch that begins as a flute does (flow_step, started at angle 0)."""
    return (1.0 - cos(angle)) / angle if angle > 1e-9 else 0.0


def _out_of_phase(flow: Flow, nominal: Array, rpm: Array, lasts_s: Array) -> Array:
    """The same pulsation begun a quarter of a flute later, and twice as quick, (n, 3)."""
    angle = np.maximum(2.0 * pi * flow.flutes * rpm / 60.0 * lasts_s, 1e-9)
    shapes = [np.sin(angle) / angle, np.sin(2 * angle) / (2 * angle), (1.0 - np.cos(2 * angle)) / (2 * angle)]
    return np.column_stack([nominal * shape for shape in shapes])
