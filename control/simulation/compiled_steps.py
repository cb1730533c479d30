"""The compiled steps for a long run. Importing this loads the compiler and its code, half a
second: from some 6,000 ticks on that is made good."""

from __future__ import annotations

from topdress.control.field import compiled_cells
from topdress.control.machine.compiled_tick import CompiledDrives
from topdress.control.machine.steps import Steps

STEPS = Steps(CompiledDrives, compiled_cells)
