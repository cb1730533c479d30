"""Place tables: landed minus wanted along the travel (lag paper, tables 5 and 6)."""
from __future__ import annotations

import numpy as np

from control.calibration.bench_table import BenchTable
from control.diagnosis.effects import (
    LAG_ASYMMETRY,
    LAG_FIRST_FILL,
    LAG_REBOUND,
    PLACE_LATENCY,
    PLACE_LEVER_ARM,
)
from control.diagnosis.tables.piece import Array, TableCandidate, TablePiece, varying
from control.machine.machine import Machine

from .labels import column_of, labels_of, roles_of
from .lag import predicted, rises

UNCORRECTED = "before"


def pieces(table: BenchTable, machine: Machine) -> tuple[TablePiece, ...]:
    """One piece: miss_m = v_true (lag + latency) - v_written x corrected lag + lever arm.

    A correction is a distance that control made of its lag and the speed that it believed, the written one (lag paper
    eq 1). Driven faster than written, all of the lag grows and the correction does not.

    A wrong test speed (lag.speed_scale) is not offered by the misses alone, where latency and lever arm say the same
    with less; where a lag table with distances asks for it, the misses have their say.

    The lag corrected for is the table's own `corrected_lag_s`, else 0 for rows labelled `before`, else what the machine
    file in use says.
    """
    rpm, speed = table.columns["shaft_rpm"], table.speed_mps()
    assert speed is not None
    label = labels_of(table)
    roles = roles_of(table)
    corrected = np.where(label == UNCORRECTED, 0.0, predicted(machine, rpm, "lag_s", roles))
    if "corrected_lag_s" in table.columns:
        given = table.columns["corrected_lag_s"]
        corrected = np.where(np.isfinite(given), given, corrected)

    def predict(m: Machine) -> Array:
        true_mps = speed * (1.0 + m.fall.speed_scale_percent / 100.0)
        lag = predicted(m, rpm, "lag_s", roles)
        return true_mps * (lag + m.fall.latency_s) - speed * corrected + m.fall.lever_arm_m

    by_label = (*((LAG_FIRST_FILL,) if roles.tell_start else ()), *((LAG_ASYMMETRY,) if roles.tell_direction else ()))
    effects = (PLACE_LEVER_ARM, PLACE_LATENCY, LAG_REBOUND, *by_label)
    variables = {"shaft_rpm": rpm, "speed_mps": speed,
                 "corrected_lag_s": table.columns.get("corrected_lag_s", np.full(table.rows, np.nan)),
                 "replicate": table.columns.get("replicate", np.full(table.rows, np.nan))}
    if roles.running.any():
        variables["before_rpm"] = np.nan_to_num(table.columns["before_rpm"])
    return (TablePiece(f"{table.path} miss_m".strip(), "place", "m", table.columns["miss_m"], predict,
                       (np.ones(len(rpm)),), label, column_of(table), tuple(TableCandidate(row.id) for row in effects),
                       (PLACE_LEVER_ARM.id, PLACE_LATENCY.id), varying(variables),
                       {"dead_time": speed * machine.tolerance.dead_time_s},
                       {LAG_REBOUND.id: rises(rpm, machine.fall.full_rpm) * speed[:, None]},
                       {LAG_REBOUND.id: rises(np.full(1, machine.fall.full_rpm), machine.fall.full_rpm)[0]},
                       on_ground=True),)
