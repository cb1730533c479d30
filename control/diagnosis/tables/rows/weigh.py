"""Weigh tables: what was to be applied on a plot and what was (decision paper, table 2)."""
from __future__ import annotations

import numpy as np

from control.calibration.bench_table import BenchTable
from control.diagnosis.effects import (
    FLOW_GAIN,
    FLOW_ZERO_OFFSET,
    SCALE_GAIN,
    SPEED_WHEEL_RADIUS,
    SPEED_WHEEL_SLIP,
)
from control.diagnosis.tables.piece import Array, TableCandidate, TablePiece, varying
from control.experiments.bench_tests import wheel_reads
from control.experiments.levels import USUAL_MPS
from control.machine.flow import grams_per_rev
from control.machine.machine import Machine
from control.machine.scale import ScaleInput, scale_reads

from .labels import column_of, labels_of

EFFECTS = (FLOW_GAIN, FLOW_ZERO_OFFSET, SPEED_WHEEL_SLIP, SPEED_WHEEL_RADIUS, SCALE_GAIN)


def pieces(table: BenchTable, machine: Machine) -> tuple[TablePiece, ...]:
    """One piece: applied_kg. Metering by the model, speed from the wheel, the applied mass by the hopper scale."""
    columns = table.columns
    target = columns["target_kg"]
    speed = table.speed_mps()
    mean_mps = USUAL_MPS if speed is None else float(np.nanmean(speed))
    rpm = machine.set_points.shaft_rpm
    turns = _turns(table, machine, mean_mps)
    opening = target * 1000.0 / np.maximum(turns * grams_per_rev(machine.flow, rpm, 1.0), 1e-9)

    def predict(m: Machine) -> Array:
        moved = wheel_reads(m, mean_mps) / wheel_reads(machine, mean_mps)
        grams = np.array([grams_per_rev(m.flow, rpm, o) / max(grams_per_rev(machine.flow, rpm, o), 1e-9)
                          for o in opening.tolist()])
        weighed = (scale_reads(m.scale, ScaleInput(100.0, 0.0)) / scale_reads(machine.scale, ScaleInput(100.0, 0.0)))
        return np.asarray(target * grams * moved * weighed, np.float64)

    # Two readings of the scale, before and after a plot; a digit's rounding is uniform.
    noise = float(np.hypot(machine.noise.scale_kg, machine.scale.resolution_kg / np.sqrt(12.0)) * np.sqrt(2.0))
    variables = {"target_kg": target, "area_m2": columns["area_m2"],
                 "replicate": columns.get("replicate", np.full(table.rows, np.nan))}
    if speed is not None:
        variables["speed_mps"] = speed
    return (TablePiece(f"{table.path} applied_kg".strip(), "flow", "kg", columns["applied_kg"], predict,
                       (np.ones(table.rows),), labels_of(table), column_of(table),
                       tuple(TableCandidate(row.id) for row in EFFECTS), (), varying(variables),
                       {"flow": target * machine.tolerance.flow_percent / 100.0,
                        "wheel": target * machine.tolerance.wheel_percent / 100.0},
                       {FLOW_ZERO_OFFSET.id: target[:, None], FLOW_GAIN.id: np.ones((table.rows, 1))}, noise_sd=noise),)


def _turns(table: BenchTable, machine: Machine, mean_mps: float) -> Array:
    """Revolutions of the shaft on each plot, (n,).

    Where the table has none, they follow from the strategy: at the set-point's shaft speed they go with the area
    (opening first), at one opening with the target (speed first). Taken is the one that an offset at zero opening,
    which is so much each turn, fits better.
    """
    columns = table.columns
    if "revolutions" in columns:
        return columns["revolutions"]
    target = columns["target_kg"]
    width = columns.get("width_m", np.full(table.rows, machine.geometry.working_width_m))
    by_area = columns["area_m2"] / (width * mean_mps) * machine.set_points.shaft_rpm / 60.0
    by_target = by_area * target / float(np.mean(target))
    error_kg = columns["applied_kg"] - target

    def rss(turns: Array) -> float:
        return float(np.sum((error_kg - turns * np.sum(turns * error_kg) / np.sum(turns ** 2)) ** 2))

    return by_target if rss(by_target) < rss(by_area) else by_area
