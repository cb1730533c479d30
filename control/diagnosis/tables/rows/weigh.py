"""Weigh tables: what was to be applied on a plot and what was (decision paper, table 2)."""
from __future__ import annotations

import numpy as np

from control.calibration.bench_table import BenchTable
from control.diagnosis.tables.piece import Array, Choice, Piece, varying
from control.machine.flow import grams_per_rev
from control.machine.machine import Machine
from control.machine.scale import ScaleInput, scale_reads
from control.machine.speed import SpeedInput, speed_start, speed_step

IDS = ("flow.gain", "flow.zero_offset", "speed.wheel_slip", "speed.wheel_radius", "scale.gain")
USUAL_MPS = 1.25            # decision paper: about 4.5 km/h


def pieces(table: BenchTable, machine: Machine) -> tuple[Piece, ...]:
    """One piece: applied_kg. Metering by the model, speed from the wheel, the applied mass by the hopper scale."""
    columns = table.columns
    target, area = columns["target_kg"], columns["area_m2"]
    width = columns.get("width_m", np.full(table.rows, machine.geometry.working_width_m))
    speed = table.speed_mps()
    mean_mps = USUAL_MPS if speed is None else float(np.nanmean(speed))
    rpm = machine.set_points.shaft_rpm
    turns = columns.get("revolutions", area / (width * mean_mps) * rpm / 60.0)
    if "revolutions" not in columns:
        turns = _turns(turns, turns * target / float(np.mean(target)), columns["applied_kg"] - target)
    opening = target * 1000.0 / np.maximum(turns * grams_per_rev(machine.flow, rpm, 1.0), 1e-9)

    def predict(m: Machine) -> Array:
        moved = wheel_reads(m, mean_mps) / wheel_reads(machine, mean_mps)
        grams = np.array([grams_per_rev(m.flow, rpm, o) / max(grams_per_rev(machine.flow, rpm, o), 1e-9)
                          for o in opening.tolist()])
        weighed = (scale_reads(m.scale, ScaleInput(100.0, 0.0)) / scale_reads(machine.scale, ScaleInput(100.0, 0.0)))
        return np.asarray(target * grams * moved * weighed, np.float64)

    noise = float(np.hypot(machine.noise.scale_kg, machine.scale.resolution_kg / np.sqrt(12.0)) * np.sqrt(2.0))
    label = np.full(table.rows, "") if table.label is None else table.label
    variables = {"target_kg": target, "area_m2": area,
                 "replicate": columns.get("replicate", np.full(table.rows, np.nan))}
    if speed is not None:
        variables["speed_mps"] = speed
    return (Piece(f"{table.path} applied_kg".strip(), "flow", "kg", columns["applied_kg"], predict,
                  (np.ones(table.rows),), label, tuple(Choice(i) for i in IDS), (), varying(variables),
                  {"flow": target * machine.tolerance.flow_percent / 100.0,
                   "wheel": target * machine.tolerance.wheel_percent / 100.0},
                  {"flow.zero_offset": target[:, None], "flow.gain": np.ones((table.rows, 1))}, noise_sd=noise),)


def _turns(at_constant_speed: Array, at_constant_opening: Array, error_kg: Array) -> Array:
    """Revolutions a plot where the table has none: of opening first and speed first, those that an offset fits."""
    def left(turns: Array) -> float:
        return float(np.sum((error_kg - turns * np.sum(turns * error_kg) / np.sum(turns ** 2)) ** 2))

    return at_constant_opening if left(at_constant_opening) < left(at_constant_speed) else at_constant_speed


def wheel_reads(machine: Machine, true_mps: float, working: float = 1.0) -> float:
    """Wheel speed at a true speed, m/s, on level ground."""
    _, out = speed_step(machine.speed, speed_start(true_mps), SpeedInput(true_mps, working), 0.05)
    return float(out.wheel_mps)
