"""The machine file with what a diagnosis found: simulated, predicted and compensated from then on."""
from __future__ import annotations

from collections.abc import Mapping

from control.machine.machine import CATALOGUE, Adopted, Machine, with_effect

from .result import Diagnosis, TableFit

TABLE_FIELD = {"shaft": "table_percent", "gate": "table_mm", "flow": "table_percent", "scale": "table_kg",
               "speed": "table_percent"}


def extend(machine: Machine, diagnosis: Diagnosis, *, date: str = "", sha256: str = "",
           valid: Mapping[str, tuple[float, float]] | None = None) -> Machine:
    """The machine with the named causes adopted, and a smooth table where no effect explains what is there.

    date : as it shall stand in the file; sha256 : of the data; valid : range by recorded variable in which the
    extension may be believed (default: the ranges that the diagnosis saw excited). Effects that begin mid-run (a
    blocked outlet, a stall) are repaired, not modelled: they are left out. Raises ValueError for a size out of bounds.
    """
    ranges = dict(diagnosis.excited if valid is None else valid)
    adopted = list(machine.adopted)
    for cause in diagnosis.causes:
        entry = CATALOGUE[cause.id]
        if entry.effect.onset_only or cause.onset_s is not None or cause.size.value is None:
            continue
        before = getattr(getattr(machine, entry.stage), entry.field) - entry.neutral
        total = min(entry.high - entry.neutral, max(entry.low - entry.neutral, before + cause.size.value))
        machine = with_effect(machine, cause.id, total, cause.member)
        adopted.append(Adopted(id=cause.id, size=cause.size.value, low=cause.size.low, high=cause.size.high,
                               unit=cause.size.unit, member=cause.member, data=diagnosis.data.path, sha256=sha256,
                               date=date, valid=ranges))
    tables = dict(machine.tables_over)
    for table in diagnosis.tables:
        machine = _with_table(machine, table)
        tables[table.stage] = table.variable
        adopted.append(Adopted(id=f"{table.stage}.table", size=max(abs(v) for v in table.values),
                               data=diagnosis.data.path, sha256=sha256, date=date,
                               valid={table.variable: (table.nodes[0], table.nodes[-1])}))
    return machine.model_copy(update={"adopted": tuple(adopted), "tables_over": tables})


def _with_table(machine: Machine, table: TableFit) -> Machine:
    stage = getattr(machine, table.stage)
    changed = stage._replace(**{"table_x": table.nodes, TABLE_FIELD[table.stage]: table.values})
    return machine.model_copy(update={table.stage: changed})
