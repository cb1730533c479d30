"""A column that changes its unit in the middle of a log is no fault of the machine."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.diagnosis.runs.log import clean_run_log
from topdress.control.diagnosis.runs.unit_change import find_unit_change
from topdress.control.machine.machine import Machine

ROWS, CHANGE = 6000, 3137


def make_log(seed: int, gain: float = 1.0) -> dict[str, Any]:
    """A drive, a gate, two speeds and a scale that follow their commands with noise of their own;
    gain : of the shaft from the middle on."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(ROWS) * 0.1
    asked_rpm = 60.0 + 15.0 * np.sign(np.sin(time_s / 19.0))
    asked_mm = 20.0 + 6.0 * np.sign(np.sin(time_s / 31.0))
    lag = np.exp(-np.arange(40) / 3.0) / np.exp(-np.arange(40) / 3.0).sum()
    turned_rpm = np.convolve(np.pad(asked_rpm, (39, 0), "edge"), lag, "valid")
    turned_rpm = turned_rpm * np.where(np.arange(ROWS) < CHANGE, 1.0, gain)
    speed_mps = 1.4 + 0.3 * np.sin(time_s / 47.0)
    flow_kg_s = 0.6 * turned_rpm / 60.0 * asked_mm / 20.0 / 5.0
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": asked_rpm,
        "shaft_rpm": turned_rpm + 0.3 * rng.standard_normal(ROWS),
        "opening_mm_cmd": asked_mm,
        "opening_mm": asked_mm + 0.1 * rng.standard_normal(ROWS),
        "speed_mps": speed_mps + 0.03 * rng.standard_normal(ROWS),
        "wheel_speed_mps": speed_mps + 0.01 * rng.standard_normal(ROWS),
        "hopper_kg": 240.0 - np.cumsum(flow_kg_s) * 0.1 + 0.1 * rng.standard_normal(ROWS),
    }


@pytest.mark.parametrize(
    ("column", "factor", "units"),
    [
        ("hopper_kg", 1.0 / 0.45359237, "kg that become lb"),
        ("shaft_rpm", 1.0 / 60.0, "r/min that become r/s"),
        ("shaft_rpm_cmd", 1.0 / 60.0, "r/min that become r/s"),
        ("speed_mps", 3.6, "m/s that become km/h"),
        ("wheel_speed_mps", 1.0 / 3.6, "km/h that become m/s"),
        ("opening_mm", 0.1, "mm that become cm"),
    ],
)
def test_a_change_of_unit_is_said_with_its_row_and_taken_back(
    column: str, factor: float, units: str
) -> None:
    log, same = make_log(3), clean_run_log(make_log(3))
    log[column] = np.where(np.arange(ROWS) < CHANGE, log[column], log[column] * factor)
    clean = clean_run_log(log)
    said = [text for text in clean.findings if units in text]
    assert len(said) == 1
    assert said[0].startswith(f"column {column}: from row {CHANGE + 1} (313.7 s)")
    assert clean.columns[column] == pytest.approx(same.columns[column], abs=1e-3, nan_ok=True)


def test_a_change_of_unit_names_no_fault() -> None:
    same = {name: make_log(3)[name] for name in ("time_s", "shaft_rpm_cmd", "shaft_rpm")}
    turned_rpm = np.where(np.arange(ROWS) < CHANGE, same["shaft_rpm"], same["shaft_rpm"] / 60)
    found, same = (diagnose_run(one, Machine()) for one in (same | {"shaft_rpm": turned_rpm}, same))
    assert [cause.id for cause in found.causes] == [cause.id for cause in same.causes]


@pytest.mark.parametrize("gain", [1.0, 0.8, 1.25, 0.5])
def test_a_shaft_that_turns_otherwise_is_no_change_of_unit(gain: float) -> None:
    log = make_log(4, gain)
    for column in ("shaft_rpm", "shaft_rpm_cmd", "hopper_kg", "speed_mps", "wheel_speed_mps"):
        assert find_unit_change(log, column) is None


def test_a_refill_is_no_change_of_unit() -> None:
    log = make_log(5)
    level = log["hopper_kg"]
    # 2.2046 times what the hopper held
    log["hopper_kg"] = level + np.where(np.arange(ROWS) < CHANGE, 0.0, 1.2046 * level[CHANGE])
    assert find_unit_change(log, "hopper_kg") is None


@pytest.mark.parametrize("read_rpm", [0.4, 1.0, 2.0, 6.0])
def test_a_shaft_that_starts_late_is_no_change_of_unit(read_rpm: float) -> None:
    """It is commanded and stands: noise alone becomes some 60 times as large in a row."""
    log, rng = make_log(6), np.random.default_rng(7)
    stands = np.arange(ROWS) < 168
    noise = np.abs(read_rpm * rng.standard_normal(ROWS))
    log["shaft_rpm"] = np.where(stands, noise, log["shaft_rpm"])
    assert find_unit_change(log, "shaft_rpm") is None
