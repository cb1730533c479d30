"""An encoder that begins to read in steps within a log: named from when on, and nothing else is blamed for it."""
from __future__ import annotations

import numpy as np
import pytest

from control.diagnosis.runs.diagnose import diagnose_run
from drivers.files.config import load
from drivers.files.kinds import MACHINE


@pytest.mark.parametrize("step_rpm", [1.5, 5.0])
def test_an_encoder_that_turns_coarse_at_240_s_is_named_with_its_time(work, step_rpm):
    coarse = np.round(np.round(work["shaft_rpm"] / step_rpm) * step_rpm, 3)
    columns = {**work, "shaft_rpm": np.where(work["time_s"] >= 240.0, coarse, work["shaft_rpm"])}
    found = diagnose_run(columns, load("huanghai", MACHINE).model)
    assert [cause.id for cause in found.causes] == ["shaft.coarse_encoder"], (found.causes, found.unexplained)
    assert found.causes[0].size.value == pytest.approx(step_rpm, abs=0.01)
    assert found.causes[0].onset_s == pytest.approx(240.0, abs=8.0)


def test_a_shaft_held_at_few_speeds_and_read_in_steps_blames_no_flow(work):
    """Near the middle between two steps a reading's mean goes five times as fast as the speed: 0.2 % of the speed, that
    the shaft may be off, would be 1 %. Within half a step the shaft turned as asked."""
    speeds = np.array([38.0, 54.1, 61.9, 77.9])
    level = speeds[np.searchsorted(speeds, work["shaft_rpm_cmd"]).clip(0, 3)]
    turned = 0.998 * np.concatenate((np.full(7, level[0]), level[:-7]))
    rng = np.random.default_rng(2)
    metered_kg = np.cumsum(5.5e-3 * turned * work["opening_mm"] / 60.0) * 0.05
    read = np.round((290.0 - metered_kg + rng.normal(0.0, 0.05, len(level))) / 0.05) * 0.05
    shaft = np.round(np.round((turned + rng.normal(0.0, 0.3, len(level))) / 4.0) * 4.0, 3)
    found = diagnose_run({**work, "shaft_rpm_cmd": level, "shaft_rpm": shaft, "hopper_kg": read},
                         load("huanghai", MACHINE).model)
    assert "shaft.coarse_encoder" in [cause.id for cause in found.causes]
    assert not [cause.id for cause in found.causes if cause.id.startswith(("flow", "scale"))]
    assert not [one for one in found.unexplained if one.channel in ("flow", "scale")]
