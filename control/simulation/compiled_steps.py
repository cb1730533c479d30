"""The compiled steps for a long run. Importing this loads the compiler and its code, half a
second: from some 6,000 ticks on that is made good."""

from __future__ import annotations

from control.field import compiled_cells
from control.machine.compiled_tick import CompiledDrives
from control.machine.steps import Steps

STEPS = Steps(CompiledDrives, compiled_cells)
