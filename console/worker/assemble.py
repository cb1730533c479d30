"""From options to the parts of one run: the only place where the worker meets real devices, loop and log."""
from __future__ import annotations

from console.worker.parts import Assembly
from console.worker.program import Clock, Options


def assemble(options: Options, clock: Clock) -> Assembly:
    """Build bench, loop and writer. Raises ValueError or OSError with one line that says what to put right."""
    raise ValueError("no machine can be assembled yet: the control loop is not there")
