"""Puts one case to the diagnosis, as the command line would, and returns its published JSON."""

from __future__ import annotations

import json
from typing import Any

from topdress.control.diagnosis.result import Diagnosis
from topdress.control.machine.machine import Machine


def found(
    kind: str, columns: dict[str, Any], machine: Machine, name: str, seed: int = 0
) -> Diagnosis:
    """`kind`: run, lag, catch, weigh, heads, place. Raises whatever the diagnosis raises."""
    if kind == "run":
        from topdress.control.diagnosis.runs.diagnose import diagnose_run

        return diagnose_run(columns, machine, path=f"{name}.csv", seed=seed)
    from topdress.control.diagnosis.tables import Table, diagnose_tables

    numbers = {k: v for k, v in columns.items() if v.dtype != object}
    texts = [(k, v.astype(str)) for k, v in columns.items() if v.dtype == object]
    name_of, label = texts[0] if texts else ("", None)
    return diagnose_tables(
        [Table(kind, numbers, name_of, f"{name}.csv", label)], machine, seed=seed
    )


def published(one: Diagnosis) -> dict[str, Any]:
    """A diagnosis as its JSON says it."""
    answer: dict[str, Any] = json.loads(json.dumps(one.to_json(), allow_nan=False))
    return answer


def diagnosis(
    kind: str, columns: dict[str, Any], machine: Machine, name: str, seed: int = 0
) -> dict[str, Any]:
    """`found`, published."""
    return published(found(kind, columns, machine, name, seed))
