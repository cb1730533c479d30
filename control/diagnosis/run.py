"""The path under which the entry for run logs was published first; new code imports it from `control.diagnosis`."""
from __future__ import annotations

from .runs.diagnose import Cancelled, diagnose_run

__all__ = ["Cancelled", "diagnose_run"]
