"""What the machine model gets wrong on measured data, why, and what putting it right gains.

    from topdress.control.diagnosis import compared, diagnose_run, diagnose_tables, extend

The two entries load scipy and the compiled model, so they are imported when they are first
asked for: a page that only shows a `Diagnosis` starts without them.

Files:

- `cost`: What an effect costs in the field when nobody knows of it
- `dataframe_input`: What a notebook hands over as a log
- `effects`: How a diagnosis treats each effect of the catalogue
- `extend`: The machine file with what a diagnosis found
- `judgement`: How candidate causes are weighed
- `live`: The model held against a log that is still being written
- `prediction`: Nothing is said or written that prediction does not bear out
- `result`: The result of a diagnosis, by the published contract "topdress-diagnosis/1"
- `runs`: A run log to a diagnosis
- `season`: Many logs of many machines together
- `tables`: Diagnosis of bench tables
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
