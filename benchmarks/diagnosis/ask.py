"""Puts one case to the diagnosis, as the command line would, and returns its published JSON."""
from __future__ import annotations

import json
from typing import Any

from control.machine.machine import Machine


def diagnosis(kind: str, columns: dict[str, Any], machine: Machine, name: str, seed: int = 0) -> dict[str, Any]:
    """`kind`: run, lag, catch, weigh, heads, place. Raises whatever the diagnosis raises."""
    if kind == "run":
        from control.diagnosis.runs.diagnose import diagnose_run

        found = diagnose_run(columns, machine, path=f"{name}.csv", seed=seed)
    else:
        from control.diagnosis.tables import Table, diagnose_tables

        numbers = {k: v for k, v in columns.items() if v.dtype != object}
        texts = [(k, v.astype(str)) for k, v in columns.items() if v.dtype == object]
        name_of, label = texts[0] if texts else ("", None)
        table = Table(kind, numbers, name_of, f"{name}.csv", label)
        found = diagnose_tables([table], machine, seed=seed)
    answer: dict[str, Any] = json.loads(json.dumps(found.to_json(), allow_nan=False))
    return answer


def missing(kind: str = "run") -> str:
    """Why the diagnosis of runs or tables cannot be asked yet; empty when it can."""
    try:
        if kind == "run":
            import control.diagnosis.runs.diagnose
        else:
            import control.diagnosis.tables  # noqa: F401
    except ImportError as error:
        return str(error)
    return ""
