"""Diagnoses the logs and bench tables of a variable-rate fertilizer applicator, and extends its
machine file.

    import topdress
    log = topdress.read_log("run.csv")
    found = topdress.diagnose_run(log, machine)
    topdress.save("new.yaml", topdress.extend(machine, found, date="2026-07-01"))

The rooms are `topdress.control` (the models, pure), `topdress.drivers` (lines and files) and
`topdress.console` (the screen, the worker, the commands).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

_HERE = Path(__file__).resolve().parent
if not (_HERE / "control").is_dir():
    # In a checkout the rooms lie beside this folder, in a wheel inside it.
    __path__ = [str(_HERE.parent)]

if TYPE_CHECKING:
    from topdress.control.diagnosis import (
        Diagnosis,
        compared,
        diagnose_run,
        diagnose_runs,
        diagnose_tables,
        extend,
    )
    from topdress.control.machine.machine import Machine
    from topdress.drivers.files.read_log import read_log

# Where each public function is defined. They are imported when they are first asked for: a
# diagnosis loads scipy and the compiled model.
_HOMES = {
    "Diagnosis": "control.diagnosis",
    "compared": "control.diagnosis",
    "diagnose_run": "control.diagnosis",
    "diagnose_runs": "control.diagnosis",
    "diagnose_tables": "control.diagnosis",
    "extend": "control.diagnosis",
    "read_log": "drivers.files.read_log",
}
__all__ = [
    "Diagnosis",
    "compared",
    "diagnose_run",
    "diagnose_runs",
    "diagnose_tables",
    "extend",
    "read_log",
    "save",
]


def save(path: str | Path, machine: Machine, comment: str = "") -> None:
    """Writes a machine file, whole or not at all.

    Parameters
    ----------
    path : of the YAML file, which is replaced if it is there.
    machine : as `extend` returns it.
    comment : lines that the file begins with.

    Raises
    ------
    OSError : the file cannot be written.
    """
    from topdress.drivers.files.config import save_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    save_config(Path(path), machine, MACHINE_KIND, comment)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
