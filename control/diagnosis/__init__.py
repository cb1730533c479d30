"""What the machine model gets wrong on measured data, why, and what putting it right gains.

    from topdress.control.diagnosis import compared, diagnose_run, diagnose_tables, extend

The two entries load scipy and the compiled model, so they are imported when they are first
asked for: a page that only shows a `Diagnosis` starts without them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .extend import extend
from .result import Diagnosis

if TYPE_CHECKING:
    from .runs.compared import compared
    from .runs.diagnose import diagnose_run
    from .runs.several import diagnose_runs
    from .tables.diagnose import diagnose_tables

__all__ = ["Diagnosis", "compared", "diagnose_run", "diagnose_runs", "diagnose_tables", "extend"]

_ENTRIES = {
    "compared": ".runs.compared",
    "diagnose_run": ".runs.diagnose",
    "diagnose_runs": ".runs.several",
    "diagnose_tables": ".tables.diagnose",
}


def __getattr__(name: str) -> Any:
    if name not in _ENTRIES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_ENTRIES[name], __name__), name)
