"""Lag tables: response, drop time, both, or the distance they make at the written speed (lag paper eq 1, 6)."""
from __future__ import annotations

import numpy as np

from control.calibration.bench_table import LAGS, BenchTable, where
from control.diagnosis.effects import (
    LAG_ASYMMETRY,
    LAG_FIRST_FILL,
    LAG_OFFSET,
    LAG_REBOUND,
    LAG_SPEED_SCALE,
    SHAFT_DEAD_TIME,
)
from control.diagnosis.tables.piece import Array, TableCandidate, TablePiece, varying
from control.machine.fall import drop_s, start_drop_s
from control.machine.machine import Machine
from control.machine.start import change_response_s, response_s

from .labels import Roles, column_of, labels_of, roles_of

FORMS_OVER = ((0.6, 1.0), (0.7, 0.5), (0.7, 2.0), (0.75, 1.0), (0.8, 1.0))    # (from, power) of a rise; of full_rpm


def pieces(table: BenchTable, machine: Machine) -> tuple[TablePiece, ...]:
    """One piece for each measured column."""
    return tuple(_piece(table, machine, name) for name in LAGS
                 if name in table.columns and np.isfinite(table.columns[name]).sum() > 0)


def _piece(table: BenchTable, machine: Machine, name: str) -> TablePiece:
    keep = np.isfinite(table.columns[name])
    rpm = table.columns["shaft_rpm"][keep]
    speed = table.speed_mps()
    speed = None if speed is None else speed[keep]
    observed = table.columns[name][keep]
    if name == "lag_m":
        assert speed is not None
        observed = observed / speed
    label = labels_of(table)[keep]
    roles = roles_of(where(table, keep))
    # A column of times next to one of distances is the detector's; any other may have been read off distances.
    by_distance = name == "lag_m" or (name == "lag_s" and "lag_m" not in table.columns)

    def predict(m: Machine) -> Array:
        scale = 1.0 + m.fall.speed_scale_percent / 100.0 if by_distance else 1.0
        return predicted(m, rpm, name, roles) * scale

    drops = name != "response_s"
    nuisances = {} if name == "drop_s" else {"dead_time": np.full(len(rpm), machine.tolerance.dead_time_s)}
    if drops:       # about the middle of the line, where its level, which `lag.offset` is, does not go with its slope
        nuisances["drop_slope"] = machine.tolerance.drop_s_per_rpm * (rpm - 0.5 * machine.fall.full_rpm)
    variables = {"shaft_rpm": rpm, "replicate": table.columns.get("replicate", np.full(len(keep), np.nan))[keep]}
    if roles.running.any():
        variables["before_rpm"] = np.nan_to_num(table.columns["before_rpm"][keep])
    if speed is not None:
        variables["speed_mps"] = speed
    # A distance has a constant error in m: the slower the drive, the larger the error of its time.
    spread = np.ones(len(rpm)) if name != "lag_m" or speed is None else float(np.median(speed)) / speed
    return TablePiece(f"{table.path} {name}".strip(), "lag" if drops else "shaft", "s", observed, predict, (spread,),
                      label, column_of(table), tuple(TableCandidate(i) for i in _ids(name, roles)),
                      _scoped_ids(name, roles), varying(variables), nuisances,
                      {LAG_REBOUND.id: rises(rpm, machine.fall.full_rpm)} if drops else {},
                      {LAG_REBOUND.id: rises(np.full(1, machine.fall.full_rpm), machine.fall.full_rpm)[0]},
                      clocked=name != "lag_m", on_ground=name == "lag_m",
                      named_only=frozenset() if name == "lag_m" else frozenset({LAG_SPEED_SCALE.id}))


def _ids(name: str, roles: Roles) -> tuple[str, ...]:
    """Effects that a column of lags can show."""
    drops = (LAG_OFFSET, LAG_REBOUND) if name != "response_s" else ()
    response = (SHAFT_DEAD_TIME,) if name != "drop_s" else ()
    by_label = (*((LAG_FIRST_FILL,) if roles.tell_start else ()), *((LAG_ASYMMETRY,) if roles.tell_direction else ()))
    distance = (LAG_SPEED_SCALE,) if name == "lag_m" else ()
    return tuple(row.id for row in (*drops, *response, *(by_label if drops else ()), *distance))


def _scoped_ids(name: str, roles: Roles) -> tuple[str, ...]:
    """Those that may hold for one label only; none where the labels say how a change began.

    Times of one label may have been read off distances, whose written speed may be wrong.
    """
    if roles.known:
        return ()
    ids = [*_ids(name, roles), *([LAG_SPEED_SCALE.id] if name == "lag_s" else [])]
    return tuple(i for i in ids if i in (SHAFT_DEAD_TIME.id, LAG_OFFSET.id, LAG_SPEED_SCALE.id))


def predicted(machine: Machine, rpm: Array, name: str, roles: Roles) -> Array:
    """Lag of each row, s: the machine's own model with its effects, but for the scale of distances.

    A row is a start out of a standing shaft, as a rig and the papers time it, unless it carries the speed from which
    the shaft changed: that one answers as soon as it changes and has the settled drop of a running shaft. Labels alone
    do not tell the speed before: between them, it is what is found.
    """
    fall = machine.fall
    total = np.zeros(len(rpm))
    rows = list(zip(rpm.tolist(), roles.running.tolist(), strict=True))
    if name != "drop_s":
        total += [change_response_s(machine) if running else response_s(machine, n) for n, running in rows]
    if name != "response_s":
        total += [drop_s(fall, n) if running else start_drop_s(fall, n) for n, running in rows]
        total += fall.first_fill_s * roles.start - 0.5 * fall.asymmetry_s * roles.change
    return total


def rises(rpm: Array, full_rpm: float) -> Array:
    """Other shapes that a rise at high shaft speed may have, (n, k)."""
    return np.column_stack([np.maximum(0.0, rpm - start * full_rpm) ** power for start, power in FORMS_OVER])
