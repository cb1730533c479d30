"""Heads tables: what each canopy head reads over references of known NDVI."""
from __future__ import annotations

import numpy as np

from control.calibration.bench_table import BenchTable
from control.diagnosis.effects import CANOPY_HEAD_FOULED, CANOPY_SATURATION, CANOPY_WARM_UP
from control.diagnosis.tables.piece import Array, TableCandidate, TablePiece, varying
from control.machine.heads import WARM_UP_S, HeadInput, head_reads
from control.machine.machine import Machine

from .labels import column_of, labels_of

WARM_S = 100.0 * WARM_UP_S      # on for so long where the table does not say: warm
MIN_LEVELS_LEFT = 3             # times that free shapes of warming up must leave, or they would fit anything
DENSE_NDVI = 0.8                # at which the catalogue gives what a head loses in a dense canopy
WARM_UP_RATES = (0.5, 2.0, 0.25)    # time constants tried besides the model's, as shares of it


def pieces(table: BenchTable, machine: Machine) -> tuple[TablePiece, ...]:
    """One piece: ndvi. Warming up can be seen only where the table says how long the heads had been on."""
    columns = table.columns
    reference, head = columns["ndvi_reference"], columns["head"]
    timed = "warm_min" in columns
    on_s = columns["warm_min"] * 60.0 if timed else np.full(table.rows, WARM_S)
    on_s = np.where(np.isfinite(on_s), on_s, WARM_S)
    inputs = [HeadInput(*row) for row in zip(reference.tolist(), head.tolist(), on_s.tolist(), strict=True)]

    def predict(m: Machine) -> Array:
        return np.array([head_reads(m.heads, one) for one in inputs])

    candidates = [TableCandidate(CANOPY_HEAD_FOULED.id, int(k)) for k in np.unique(head) if k == int(k)]
    candidates += [TableCandidate(CANOPY_SATURATION.id), *([TableCandidate(CANOPY_WARM_UP.id)] if timed else [])]
    rates = WARM_UP_RATES[:max(1, len(np.unique(on_s)) - MIN_LEVELS_LEFT)]
    forms = {CANOPY_SATURATION.id: _flattenings(reference),
             CANOPY_WARM_UP.id: np.column_stack([reference * np.exp(-on_s / (k * WARM_UP_S)) for k in rates])}
    tolerance = machine.tolerance.head_percent / 100.0
    variables = {"ndvi_reference": reference, "head": head, "replicate": columns.get("replicate", head * np.nan)}
    if timed:
        variables["warm_min"] = on_s / 60.0
    if "height_m" in columns:
        variables["height_m"] = columns["height_m"]
    return (TablePiece(f"{table.path} ndvi".strip(), "heads", "NDVI", columns["ndvi"], predict, (np.ones(table.rows),),
                       labels_of(table), column_of(table), tuple(candidates), (), varying(variables),
                       {f"head_{int(k)}": np.where(head == k, reference * tolerance, 0.0) for k in np.unique(head)},
                       forms, {CANOPY_WARM_UP.id: np.full(len(rates), 100.0),
                               CANOPY_SATURATION.id: -100.0 / DENSE_NDVI * _flattenings(np.full(1, DENSE_NDVI))[0]},
                       noise_sd=machine.noise.ndvi),)


def _flattenings(reference: Array) -> Array:
    """Other shapes of what a reading loses in a dense canopy, (n, k)."""
    return np.column_stack([reference ** 2, reference ** 3, reference ** 6, np.maximum(0.0, reference - 0.6)])
