"""Heads tables: what each canopy head reads over references of known NDVI."""
from __future__ import annotations

import numpy as np

from control.calibration.bench_table import BenchTable
from control.diagnosis.tables.piece import Array, Choice, Piece, varying
from control.machine.heads import WARM_UP_S, HeadInput, head_reads
from control.machine.machine import Machine

WARM_S = 100.0 * WARM_UP_S
LEVELS_KEPT = 3             # minutes that free shapes of warming up must leave, or they would fit anything


def pieces(table: BenchTable, machine: Machine) -> tuple[Piece, ...]:
    """One piece: ndvi. Warming up can be seen only where the table says how long the heads had been on."""
    columns = table.columns
    reference, head = columns["ndvi_reference"], columns["head"]
    timed = "warm_min" in columns
    on_s = columns["warm_min"] * 60.0 if timed else np.full(table.rows, WARM_S)
    on_s = np.where(np.isfinite(on_s), on_s, WARM_S)
    inputs = [HeadInput(*row) for row in zip(reference.tolist(), head.tolist(), on_s.tolist(), strict=True)]

    def predict(m: Machine) -> Array:
        return np.array([head_reads(m.heads, one) for one in inputs])

    choices = [Choice("canopy.head_fouled", int(k)) for k in np.unique(head) if k == int(k)]
    choices += [Choice("canopy.saturation")] + ([Choice("canopy.warm_up")] if timed else [])
    speeds = (0.5, 2.0, 0.25)[:max(1, len(np.unique(on_s)) - LEVELS_KEPT)]
    forms = {"canopy.saturation": np.column_stack([reference ** 2, reference ** 3, reference ** 6,
                                                   np.maximum(0.0, reference - 0.6)]),
             "canopy.warm_up": np.column_stack([reference * np.exp(-on_s / (k * WARM_UP_S)) for k in speeds])}
    tolerance = machine.tolerance.head_percent / 100.0
    variables = {"ndvi_reference": reference, "head": head, "replicate": columns.get("replicate", head * np.nan)}
    if timed:
        variables["warm_min"] = on_s / 60.0
    if "height_m" in columns:
        variables["height_m"] = columns["height_m"]
    return (Piece(f"{table.path} ndvi".strip(), "heads", "NDVI", columns["ndvi"], predict, (np.ones(table.rows),),
                  np.full(table.rows, "") if table.label is None else table.label, tuple(choices), (),
                  varying(variables),
                  {f"head_{int(k)}": np.where(head == k, reference * tolerance, 0.0) for k in np.unique(head)},
                  forms, {"canopy.warm_up": np.full(len(speeds), 100.0)}, noise_sd=machine.noise.ndvi),)
