"""What the host's trim of the shaft learns from a shaft that is jammed: nothing."""
from __future__ import annotations

import pytest

from control.metering.trims import DriveTrim, TrimLimits
from control.readings import Reading


@pytest.mark.parametrize(("measured_rpm", "learnt"), [(0.0, 0.0), (45.0, 0.0), (55.0, 0.1), (66.5, 0.03), (95.0, 0.0)])
def test_a_jammed_shaft_teaches_nothing_and_a_slow_one_does(measured_rpm: float, learnt: float) -> None:
    trim = DriveTrim(TrimLimits(), still=1.0)
    for tick in range(72):                              # 3 s after it has settled
        now_s = 0.05 * tick
        trim.update(now_s, 0.05, 70.0, Reading(measured_rpm, now_s), 25.0, Reading(25.0, now_s))
    assert trim.shaft_share == pytest.approx(learnt, abs=0.002)
