"""Which compiled steps does a long run use? Importing them loads the compiler, half a second:
worth it from some 6,000 ticks on."""

from __future__ import annotations

from topdress.control.field import compiled_cells
from topdress.control.machine.compiled_tick import CompiledDrives
from topdress.control.machine.steps import CompiledSteps

COMPILED_STEPS = CompiledSteps(CompiledDrives, compiled_cells)
