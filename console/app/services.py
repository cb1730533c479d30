"""What screens can have done that needs files or long work. The command line gives it; None: not offered here."""
from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Services:
    """Each field belongs to one screen. Its errors are one-line ValueErrors; long work runs in a thread and asks
    `cancelled` between steps."""
