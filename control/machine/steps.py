"""Compiled steps in place of interpreted ones, as whoever begins a long run hands them in: what
takes them loads no compiler."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple


class Steps(NamedTuple):
    drives: Callable[..., Any]  # `machine.compiled_tick.CompiledDrives`
    cells: Any  # the module `field.compiled_cells`
