"""Finds the errors of the machine model on measured data, their causes, and the gain of correcting
them.

    from topdress.control.diagnosis import compared, diagnose_run, diagnose_tables, extend

The entry functions load scipy and the compiled model, so they are imported at their first use: a
page that only shows a `Diagnosis` starts without them.

Files:

- `dataframe_input`: Converts data frames, dictionaries
- `effect_cost`: Calculates the cost of an uncompensated effect in the field
- `effects`: Declares how a diagnosis treats each effect of the catalogue
- `extend`: Extends a machine file by the results of a diagnosis, so that they are simulated
- `judgement`: Weighs candidate causes with one model, one score, and declared priors
- `live`: Compares the model with a log that is still being written
- `prediction`: Validates by prediction everything that a diagnosis reports or a machine file adopts
- `result`: Defines the result of a diagnosis, by the published contract "topdress-diagnosis/1"
- `runs`: Diagnosis of a run log: shows errors, names their causes, lists alternatives
- `season`: Analyses many logs of many machines together
- `tables`: Diagnoses bench tables: lag, catch, weigh, heads, place
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

_ENTRY_MODULES = {
    "compared": ".runs.compared",
    "diagnose_run": ".runs.diagnose",
    "diagnose_runs": ".runs.several",
    "diagnose_tables": ".tables.diagnose",
}


def __getattr__(name: str) -> Any:
    if name not in _ENTRY_MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_ENTRY_MODULES[name], __name__), name)
