"""Logs with long gaps: nobody knows what was metered meanwhile."""
from __future__ import annotations

import numpy as np

from control.diagnosis.runs.channels import _pieces
from control.diagnosis.runs.diagnose import diagnose_run
from control.diagnosis.runs.log import gate
from control.diagnosis.runs.stages import run_data
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


def test_a_gap_that_ends_while_the_hopper_is_filled_starts_no_new_level(work):
    """150 kg in 20 s at 300 s; rows are missing until 303 s."""
    columns, time_s = {name: column.copy() for name, column in work.items()}, work["time_s"]
    columns["hopper_kg"] += 150.0 * np.clip((time_s - 300.0) / 20.0, 0.0, 1.0) - 100.0
    kept = (time_s < 296.0) | (time_s >= 303.0)
    log = gate({name: column[kept] for name, column in columns.items()})
    hopper = run_data(log, load("huanghai", MACHINE).model).hopper
    assert [end for end, _ in hopper.gaps] == [303] and 303 not in hopper.grid.rows
    assert [begin for begin, _, _ in _pieces(hopper)] == [0]
