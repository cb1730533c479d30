"""What logs of real drives have, and simulated ones do not: rows far apart, loud readings, a clock that jitters."""
from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from control.diagnosis.runs.diagnose import diagnose_run
from control.diagnosis.runs.quantised import whole_steps
from control.log_row import COMMANDS_HELD
from drivers.files.config import load
from drivers.files.kinds import MACHINE


def test_readings_far_louder_than_the_machine_file_says_are_not_called_noise():
    """A speed loop that hunts: the target stands still, the wheel swings by a fifth of it."""
    drive, rng = load("drive_alone", MACHINE).model, np.random.default_rng(7)
    time_s = np.arange(0.0, 12.0, 0.011)
    swing = lfilter([1.0], [1.0, -1.9, 0.905], rng.standard_normal(len(time_s)))
    read = 200.0 + 45.0 * swing / np.std(swing)
    found = diagnose_run({"time_s": time_s, "shaft_rpm_cmd": np.full(len(time_s), 200.0), "shaft_rpm": read}, drive)
    assert found.verdict == "unexplained"
    left = found.unexplained[0]
    assert left.channel == "shaft" and left.noise == pytest.approx(2.0) and left.rms > 30.0


def test_a_short_log_that_is_off_all_along_is_not_called_noise():
    drive, rng = load("drive_alone", MACHINE).model, np.random.default_rng(8)
    time_s = np.arange(0.0, 6.0, 0.01)
    read = 267.0 + 2.0 * rng.standard_normal(len(time_s))
    found = diagnose_run({"time_s": time_s, "shaft_rpm_cmd": np.full(len(time_s), 300.0), "shaft_rpm": read}, drive)
    assert found.verdict != "none"
    assert found.verdict in ("named", "ambiguous") or found.unexplained[0].hint == "shaft.gain"


def test_settings_with_their_settled_answers_are_judged_however_far_apart_they_are():
    """A staircase of 10 r/min, a row a step: 1.1 s apart; the drive does not turn below 120 r/min."""
    stairs = np.tile(np.arange(20.0, 660.0, 10.0), 2)
    noise = 2.0 * np.random.default_rng(3).standard_normal(len(stairs))
    settled = np.where(stairs < 120.0, 0.0, stairs + noise)
    columns = {"time_s": 1.1 * np.arange(len(stairs) + 1.0), "shaft_rpm_cmd": np.append(stairs, stairs[-1]),
               "shaft_rpm": np.append(0.0, settled)}
    drive, events = load("drive_alone", MACHINE).model, np.full(len(stairs) + 1, "", object)
    assert diagnose_run(columns, drive).verdict == "not_judged"
    events[0] = COMMANDS_HELD
    found = diagnose_run({**columns, "events": events}, drive)
    assert [cause.id for cause in found.causes] == ["shaft.dead_band"]
    assert 110.0 <= found.causes[0].size.value <= 120.0


def test_steps_of_an_encoder_are_seen_through_a_clock_that_jitters():
    rng = np.random.default_rng(9)
    counts = rng.integers(14, 19, 600)
    jitter = 1.0 + 1e-4 * rng.integers(-3, 4, 600)
    steps = whole_steps(np.round(16.667 * counts * jitter, 2))
    assert steps is not None and steps.step_rpm == pytest.approx(16.667, rel=0.001)
    assert whole_steps(np.round(rng.uniform(200.0, 300.0, 4000), 2)) is None


def test_one_staircase_up_is_a_log():
    """26 settings with their settled answers, as a calibration of a wheel is written: it is judged, and none is not
    said of a drive that loses 100 r/min of every command."""
    stairs = np.arange(0.0, 650.0, 25.0)
    settled = np.maximum(0.0, stairs - 100.0) + np.random.default_rng(2).standard_normal(len(stairs))
    events = np.array([COMMANDS_HELD] + [""] * 26, object)
    found = diagnose_run({"time_s": 1.1 * np.arange(27.0), "shaft_rpm_cmd": np.append(stairs, stairs[-1]),
                          "shaft_rpm": np.append(0.0, settled), "events": events}, "drive_alone")
    assert [one.channel for one in found.channels] == ["shaft"] and found.verdict not in ("none", "not_judged")
    with pytest.raises(ValueError, match="at least 40"):
        diagnose_run({"time_s": 1.1 * np.arange(26.0), "shaft_rpm_cmd": stairs, "shaft_rpm": settled}, "drive_alone")


def test_settled_answers_say_nothing_of_dynamics():
    """A sweep of the command, a row a second, of a drive that answers within 0.6 s: no effect of its moves is tried."""
    sweep = np.tile(np.concatenate((np.arange(10.0, 640.0, 15.0), np.arange(640.0, 10.0, -15.0))), 3)
    settled = 0.9 * sweep + np.random.default_rng(5).standard_normal(len(sweep))
    events = np.array([COMMANDS_HELD] + [""] * len(sweep), object)
    found = diagnose_run({"time_s": np.arange(len(sweep) + 1.0), "shaft_rpm_cmd": np.append(sweep, sweep[-1]),
                          "shaft_rpm": np.append(0.0, settled), "events": events}, "drive_alone")
    assert [one.id for one in found.causes] == ["shaft.gain"]
    blind = {one.id for one in found.not_shown if one.smallest_detectable.value is None}
    assert {"shaft.slow", "shaft.dead_time"} <= blind
