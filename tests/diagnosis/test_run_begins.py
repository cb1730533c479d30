"""When a cause is said to begin."""
from __future__ import annotations

import numpy as np

from control.diagnosis.runs.changes import END_S
from control.diagnosis.runs.diagnose import diagnose_run
from drivers.files.config import load
from drivers.files.kinds import MACHINE


def test_nothing_is_told_to_begin_at_either_end_of_a_log(work):
    """A shaft that turns ever faster from the first row on."""
    columns = {**work, "shaft_rpm": work["shaft_rpm"] * (1.0 + 0.04 * work["time_s"] / 600.0)}
    found = diagnose_run(columns, load("huanghai", MACHINE).model)
    begun = [cause.onset_s for cause in found.causes if cause.onset_s is not None]
    assert begun and np.min(begun) >= END_S and np.max(begun) <= work["time_s"][-1] - END_S
