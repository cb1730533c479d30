"""A log that could not show a usual fault is not called healthy, and says what would not show."""
from __future__ import annotations

from typing import Any

import numpy as np

from console.reports.diagnosis_text import summary
from console.reports.said import sentence
from control.diagnosis.runs.diagnose import diagnose_run
from control.machine.machine import Machine, Noise
from tests.diagnosis.test_drive_curves import DRIVE, lagged


def set_point(settles: float) -> dict[str, Any]:
    """A controlled speed, 1.5 s of 10 ms rows at one set-point: it overshoots, then stands at so much of it."""
    rng = np.random.default_rng(1)
    time_s = np.arange(0.0, 1.5, 0.01)
    read = 100.0 * settles + (40.0 * np.exp(-time_s / 0.05) + 8.0 * rng.standard_normal(len(time_s)))
    return {"time_s": time_s, "shaft_rpm_cmd": np.full(len(time_s), 100.0), "shaft_rpm": read}


def sheet(noise_rpm: float, **shaft: float) -> Machine:
    return DRIVE.model_copy(update={"shaft": DRIVE.shaft._replace(**shaft), "noise": Noise(shaft_rpm=noise_rpm)})


def test_a_set_point_that_is_not_reached_is_not_called_healthy() -> None:
    found = diagnose_run(set_point(0.86), sheet(5.6))
    assert found.verdict != "none"
    if found.verdict == "not_judged":
        assert found.channels and any("shaft.gain" in note and "would not show" in note for note in found.findings)
        assert "too short" in sentence(found) and "too short" in summary(found)[0]


def test_a_long_healthy_log_is_none() -> None:
    rng = np.random.default_rng(2)
    time_s = np.arange(0.0, 120.0, 0.05)
    commanded = np.repeat(rng.uniform(60.0, 600.0, 120), 20)
    noise = 2.0 * rng.standard_normal(len(commanded))
    read = lagged(np.concatenate((commanded[:1], commanded[:-1])), 0.06, 0.05) + noise
    columns = {"time_s": time_s, "shaft_rpm_cmd": commanded, "shaft_rpm": read}
    assert diagnose_run(columns, sheet(2.0, dead_time_s=0.05)).verdict == "none"
