"""One tick of control: measurements in, commands and a log row out."""

from __future__ import annotations

from topdress.control.loop.loop import ControlLoop
from topdress.control.loop.tick import Tick

__all__ = ["ControlLoop", "Tick"]
