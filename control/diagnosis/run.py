"""The path under which the entry for run logs was published first; new code imports it from `control.diagnosis`."""
from __future__ import annotations

from .runs.diagnose import diagnose_run
from .runs.guard import Cancelled

__all__ = ["Cancelled", "diagnose_run"]
