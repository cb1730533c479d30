"""When a cause is said to begin."""
from __future__ import annotations

import numpy as np
import pytest

from control.diagnosis.judgement.evidence import Role
from control.diagnosis.judgement.noise import series_of
from control.diagnosis.runs.changes import END_S
from control.diagnosis.runs.channels import channels
from control.diagnosis.runs.columns import Columns
from control.diagnosis.runs.diagnose import diagnose_run, series_of_log
from control.diagnosis.runs.hypothesis import Part
from control.diagnosis.runs.model import GROUPS, GroupModel
from drivers.files.config import load
from drivers.files.kinds import MACHINE


@pytest.mark.exam
def test_nothing_is_told_to_begin_at_either_end_of_a_log(work):
    """A shaft that turns ever faster from the first row on."""
    columns = {**work, "shaft_rpm": work["shaft_rpm"] * (1.0 + 0.04 * work["time_s"] / 600.0)}
    found = diagnose_run(columns, load("huanghai", MACHINE).model)
    begun = [cause.onset_s for cause in found.causes if cause.onset_s is not None]
    assert begun and np.min(begun) >= END_S and np.max(begun) <= work["time_s"][-1] - END_S


@pytest.mark.parametrize("grows", [False, True])
@pytest.mark.parametrize(("part", "channel"), [(Part("shaft.gain", -3.0), "shaft"),
                                               (Part("flow.zero_offset", -5.0), "scale")])
def test_how_a_cause_may_differ_in_form_is_confined_to_when_it_is_there(work, part, channel, grows):
    """What a part that begins late may be wrong by cannot stand for what was there all along."""
    machine = load("huanghai", MACHINE).model
    _, data, _ = series_of_log(work, machine)
    seen = channels(data, machine)
    columns = Columns(GroupModel([seen[name] for name in next(g for g in GROUPS.values() if channel in g)
                                  if name in seen], machine, data))
    late = part._replace(onset_s=300.0, grows=grows)
    freedom = [c for c in columns.of_hypothesis((late,)) if c.label.role is Role.FORM]
    one = columns.model.channel(channel)
    before = one.grid.even_s < 299.0
    shapes = [series_of(c.coefficients[channel], one.cut) for c in freedom]
    assert shapes and all(np.abs(s[before]).max() < 1e-3 * np.abs(s).max() for s in shapes)
    (own,) = columns.slopes((late,))
    does = np.abs(series_of(own.coefficients[channel], one.cut))
    # the drive follows: a leap would tell one reading
    not_yet = (one.grid.even_s < 301.0) & (does < 1e-3 * does.max())
    assert all(np.abs(s[not_yet]).max() < 1e-2 * np.abs(s).max() for s in shapes)
