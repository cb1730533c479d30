"""Which compiled steps replace interpreted ones in a long run? The caller passes them in, so
that modules that use them do not load a compiler.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple


class CompiledSteps(NamedTuple):
    """Compiled replacements of interpreted steps."""

    # Class `machine.compiled_tick.CompiledDrives`.
    drives: Callable[..., Any]
    # Module `field.compiled_cells`.
    cells: Any
