"""Logs with long gaps: nobody knows what was metered meanwhile."""
from __future__ import annotations

import numpy as np

from control.diagnosis.runs.diagnose import diagnose_run
from drivers.files.config import load
from drivers.files.kinds import MACHINE


def test_a_hopper_that_would_have_run_empty_over_gaps_goes_on_from_what_was_read(work):
    """It stood in three gaps of a minute each; bridged by lines, 30 kg are metered there that were not."""
    columns, time_s = {name: column.copy() for name, column in work.items()}, work["time_s"]
    kept = np.ones(len(time_s), bool)
    for begin_s in (100.0, 250.0, 400.0):
        gap = (time_s >= begin_s) & (time_s < begin_s + 60.0)
        kept &= ~gap
        columns["hopper_kg"] += np.where(time_s >= begin_s + 60.0, np.ptp(work["hopper_kg"][gap]), 0.0)
    columns["hopper_kg"] -= columns["hopper_kg"][-1] - 5.0
    found = diagnose_run({name: column[kept] for name, column in columns.items()}, load("huanghai", MACHINE).model)
    assert found.verdict == "none", (found.causes, found.unexplained)
