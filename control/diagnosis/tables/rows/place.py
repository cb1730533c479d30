"""Place tables: landed minus wanted along the travel (lag paper, tables 5 and 6)."""
from __future__ import annotations

import numpy as np

from control.calibration.bench_table import BenchTable
from control.diagnosis.tables.piece import Array, Choice, Piece, varying
from control.machine.machine import Machine

from .labels import roles_of
from .lag import predicted, rises

UNCORRECTED = "before"
SCOPED = ("place.lever_arm", "place.latency")       # may have been put right between two labels or tables


def pieces(table: BenchTable, machine: Machine) -> tuple[Piece, ...]:
    """One piece: miss_m = v (lag - corrected lag + latency) + lever arm.

    A wrong test speed (lag.speed_scale) is not offered by the misses alone, where latency and lever arm say the same
    with less; where a lag table with distances beside them asks for it, the misses have their say.

    The lag corrected for is the table's own `corrected_lag_s`, else 0 for rows labelled `before`, else what the machine
    file in use says.
    """
    rpm, speed = table.columns["shaft_rpm"], table.speed_mps()
    assert speed is not None
    label = np.full(table.rows, "") if table.label is None else table.label
    roles = roles_of(label)
    corrected = np.where(label == UNCORRECTED, 0.0, predicted(machine, rpm, "lag_s", roles))
    if "corrected_lag_s" in table.columns:
        given = table.columns["corrected_lag_s"]
        corrected = np.where(np.isfinite(given), given, corrected)

    def predict(m: Machine) -> Array:
        true_mps = speed * (1.0 + m.fall.speed_scale_percent / 100.0)
        lag = predicted(m, rpm, "lag_s", roles)
        return true_mps * (lag + m.fall.latency_s - corrected) + m.fall.lever_arm_m

    choices = ["place.lever_arm", "place.latency", "lag.rebound"]
    choices += ["lag.first_fill"] if roles.tell_start else []
    choices += ["lag.asymmetry"] if roles.tell_direction else []
    variables = {"shaft_rpm": rpm, "speed_mps": speed,
                 "corrected_lag_s": table.columns.get("corrected_lag_s", np.full(table.rows, np.nan)),
                 "replicate": table.columns.get("replicate", np.full(table.rows, np.nan))}
    return (Piece(f"{table.path} miss_m".strip(), "place", "m", table.columns["miss_m"], predict, (np.ones(len(rpm)),),
                  label, tuple(Choice(i) for i in choices), SCOPED, varying(variables),
                  {"shaft.dead_time_s": speed * machine.tolerance.dead_time_s},
                  {"lag.rebound": rises(rpm) * speed[:, None]},
                  remarks=("a constant extra lag (lag.offset) looks like place.latency in a place table; a lag table "
                           "tells them apart",)),)
