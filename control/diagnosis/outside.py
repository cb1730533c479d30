"""What a notebook asks of rooms that control knows nothing of: asked for by name when it is wanted, never imported."""
from __future__ import annotations

from importlib import import_module
from typing import Any

from control.machine.machine import Machine

NOTEBOOK = "console.reports.notebook"       # pages and pictures, and the machine files that come with topdress


def notebook() -> Any:
    """The room that draws. Raises ValueError, one line, where only `control` is installed."""
    try:
        return import_module(NOTEBOOK)
    except ImportError as error:
        raise ValueError(f"pictures and shipped machines come with the whole of topdress: {error}") from None


def machine_of(machine: Machine | str) -> Machine:
    """A machine, or the machine file of a path or a shipped name. Raises ValueError."""
    if isinstance(machine, Machine):
        return machine
    found: Machine = notebook().machine_named(machine)
    return found
