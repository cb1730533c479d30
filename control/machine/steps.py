"""Which compiled steps replace interpreted ones in a long run? The caller passes them in, so
that modules that use them load no compiler."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple


class CompiledSteps(NamedTuple):
    drives: Callable[..., Any]  # `machine.compiled_tick.CompiledDrives`
    cells: Any  # the module `field.compiled_cells`
