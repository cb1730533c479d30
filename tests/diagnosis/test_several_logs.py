"""Several logs of one machine: what they share is named once, what differs is told by log."""
from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from console.cli import app
from control.diagnosis.runs.several import diagnose_runs, joined
from control.log_row import COMMANDS_HELD
from control.machine.machine import Machine
from drivers.files.config import load
from drivers.files.kinds import MACHINE

Log = dict[str, np.ndarray]


def wheel_log(seed: int, wheel: float, gnss_late_s: float = 0.0, seconds: float = 240.0) -> Log:
    """Wheel against GNSS speed, ten rows a second; the wheel reads `wheel` times the ground's speed."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, seconds, 0.1)

    def speed(at: np.ndarray) -> np.ndarray:
        return 1.3 + 0.4 * np.sin(at / (4.0 + 0.3 * seed))
    return {"time_s": time_s, "speed_mps": speed(time_s - gnss_late_s) + 0.03 * rng.standard_normal(len(time_s)),
            "wheel_speed_mps": wheel * speed(time_s) + 0.02 * rng.standard_normal(len(time_s))}


def test_what_they_share_is_named_once_and_what_differs_by_log() -> None:
    found = diagnose_runs([wheel_log(1, 1.03), wheel_log(2, 1.03), wheel_log(3, 1.03, gnss_late_s=0.8)], Machine(),
                          paths=("a", "b", "c"))
    assert "speed.wheel_radius" in [cause.id for cause in found.together.causes]
    size = next(one.size.value for one in found.together.causes if one.id == "speed.wheel_radius")
    assert size == pytest.approx(3.0, abs=0.4) and found.machine.speed.radius_percent == pytest.approx(size)
    assert [one.data.path for one in found.each] == ["a", "b", "c"]
    assert "speed.wheel_radius" not in [cause.id for one in found.each for cause in one.causes]
    told = found.to_json()
    assert told["format"] == "topdress-diagnosis/1" and [one["data"]["path"] for one in told["logs"]] == ["a", "b", "c"]


def test_on_the_command_line(tmp_path: Path) -> None:
    paths = []
    for seed in (1, 2):
        log, path = wheel_log(seed, 1.03, seconds=180.0), tmp_path / f"log{seed}.csv"
        path.write_text(",".join(log) + "\n" + "".join(
            ",".join(f"{value:.4f}" for value in row) + "\n" for row in zip(*log.values(), strict=True)))
        paths.append(str(path))
    new = tmp_path / "new.yaml"
    done = CliRunner().invoke(app, ["diagnose", *paths, "--adopt", str(new)])
    assert done.exit_code == 0, done.output
    assert done.stdout.count("speed.wheel_radius: ") == 1
    own = done.stdout[done.stdout.index("each log by itself, beyond what they share:"):]
    assert own.count("nothing beyond noise") == 2 and all(path in own for path in paths)
    assert load(str(new), MACHINE).model.speed.radius_percent == pytest.approx(3.0, abs=0.5)
    told = json.loads(CliRunner().invoke(app, ["diagnose", *paths, "--json", "-"]).stdout)
    assert [one["verdict"] for one in told["logs"]] == ["none", "none"]
    twice = CliRunner().invoke(app, ["diagnose", paths[0], paths[0]])
    assert twice.exit_code == 2 and "named twice" in twice.output


def test_logs_are_put_one_after_the_other_with_what_they_lack_empty() -> None:
    first = {"time_s": np.array([5.0, 6.0]), "shaft_rpm": np.array([1.0, 2.0]), "x_torque": np.array([7.0, 8.0])}
    later = {"time_s": np.arange(0.0, 5.0), "shaft_rpm": np.arange(10.0, 15.0), "state": np.full(5, "working", object)}
    found = joined([first, later], ["a", "b"], Machine())
    assert found["time_s"].tolist() == [0.0, 1.0, 61.0, 62.0, 63.0, 64.0, 65.0]
    assert np.isnan(found["x_torque"][2:]).all() and found["state"].tolist() == ["", ""] + ["working"] * 5
    assert found["shaft_rpm"][:2].tolist() == [1.0, 2.0] and np.isnan(found["shaft_rpm"][2]), "it comes to its speed"
    held = {**first, "events": np.array([COMMANDS_HELD, ""], object)}
    with pytest.raises(ValueError, match="b holds settled answers, a does not"):
        joined([first, held], ["a", "b"], Machine())
    with pytest.raises(ValueError, match="allowed two or more"):
        joined([first], ["a"], Machine())


def test_two_machines_of_a_kind_have_the_same_by_sizes_of_their_own(tmp_path: Path) -> None:
    found = diagnose_runs([wheel_log(1, 1.03), wheel_log(2, 1.08)], Machine(), paths=("a", "b"))
    (one,) = found.of_a_kind
    assert one.id == "speed.wheel_radius" and one.p < 1e-6 and found.machine == Machine()
    assert [size.value for size in one.sizes] == pytest.approx([3.0, 8.0], abs=0.5)
    assert [[cause.id for cause in each.causes] for each in found.each] == [["speed.wheel_radius"]] * 2
    assert found.to_json()["of_a_kind"][0]["sizes"][1]["unit"] == "%"
    assert diagnose_runs([wheel_log(1, 1.03), wheel_log(2, 1.03)], Machine()).of_a_kind == ()
    paths = []
    for seed, wheel in ((1, 1.03), (2, 1.08)):
        log, path = wheel_log(seed, wheel), tmp_path / f"log{seed}.csv"
        path.write_text(",".join(log) + "\n" + "".join(
            ",".join(f"{value:.4f}" for value in row) + "\n" for row in zip(*log.values(), strict=True)))
        paths.append(str(path))
    done = CliRunner().invoke(app, ["diagnose", *paths, "--adopt", str(tmp_path / "new.yaml")])
    assert done.exit_code == 2 and "machines of a kind" in done.stdout and not (tmp_path / "new.yaml").exists()
    assert "allowed is one log, or logs of one machine" in done.output


def test_logs_whose_rows_hold_the_beginning_of_an_answer_are_joined_with_time_to_settle() -> None:
    """The second log begins at a speed that its first command did not make: that is no change of the machine."""
    def drive_log(seed: int) -> Log:
        rng, time_s = np.random.default_rng(seed), np.arange(0.0, 60.0, 0.02)
        command = np.repeat(rng.choice([200.0, 400.0, 600.0, 900.0, 1200.0, 1500.0], 20), 150)
        command[:150] = 1500.0
        speed_rpm = np.zeros(len(command))
        for k in range(1, len(command)):
            speed_rpm[k] = speed_rpm[k - 1] + (0.9 * command[k - 1] - speed_rpm[k - 1]) * -np.expm1(-0.02 / 0.25)
        events = np.full(len(time_s), "", object)
        events[0] = COMMANDS_HELD
        return {"time_s": time_s, "shaft_rpm_cmd": command, "events": events,
                "shaft_rpm": speed_rpm + rng.normal(0.0, 4.0, len(time_s))}
    machine = Machine.model_validate({"id": "wheel", "stages": ["shaft"], "noise": {"shaft_rpm": 4.0},
                                      "shaft": {"full_rpm": 1500, "acceleration_rpm_s": 1e6, "dead_time_s": 0.0,
                                                "time_constant_s": 0.25},
                                      "limits": {"shaft_low_rpm": 0, "shaft_high_rpm": 1500}})
    found = diagnose_runs([drive_log(1), drive_log(2)], machine)
    assert [cause.id for cause in found.together.causes] == ["shaft.gain"] and not found.together.unexplained
    assert [one.verdict for one in found.each] == ["none", "none"]


def test_the_machine_that_logs_are_held_against_takes_up_only_what_predicts_them_better() -> None:
    """A file adopts so from one log. Steps of an encoder, in a prediction, add their rounding where speeds are off."""
    def drive_log(seed: int) -> Log:
        rng, time_s = np.random.default_rng(seed), np.arange(0.0, 60.0, 0.02)
        command = np.repeat(rng.choice([200.0, 400.0, 600.0, 900.0, 1200.0, 1400.0], 20), 150)
        speed_rpm = np.full(len(command), 0.9 * command[0])
        for k in range(1, len(command)):
            speed_rpm[k] = speed_rpm[k - 1] + (0.9 * command[k - 1] - speed_rpm[k - 1]) * -np.expm1(-0.02 / 0.25)
        return {"time_s": time_s, "shaft_rpm_cmd": command,
                "shaft_rpm": 20.0 * np.round((speed_rpm + rng.normal(0.0, 4.0, len(time_s))) / 20.0)}
    machine = Machine.model_validate({"id": "wheel", "stages": ["shaft"], "noise": {"shaft_rpm": 4.0},
                                      "shaft": {"full_rpm": 1500, "acceleration_rpm_s": 1e6, "dead_time_s": 0.02,
                                                "time_constant_s": 0.25},
                                      "limits": {"shaft_low_rpm": 0, "shaft_high_rpm": 1500}})
    found = diagnose_runs([drive_log(1), drive_log(2)], machine)
    assert [cause.id for cause in found.together.causes] == ["shaft.gain", "shaft.coarse_encoder"]
    assert found.machine.shaft.gain_percent == pytest.approx(-10.0, abs=0.2)
    assert found.machine.shaft.encoder_step_rpm == 0.0
    assert [one for one in found.together.findings if one.startswith("shaft.coarse_encoder")] == [
        "shaft.coarse_encoder: not in the machine that each log is held against: "
        "the log itself is predicted no better with it"]


def test_no_rows_are_missing_between_logs() -> None:
    first, second = wheel_log(1, 1.03), wheel_log(2, 1.03)
    lost = {name: np.delete(values, slice(500, 520)) for name, values in second.items()}
    findings = diagnose_runs([first, second], Machine()).together.findings
    assert findings[0] == "2 files in one log, 60 s from one to the next: no rows are missing there"
    assert not [one for one in findings if "gap" in one]
    assert any(one.startswith("1 gap in the times, the longest 2.1 s") and "about 20 rows missing" in one
               for one in diagnose_runs([first, lost], Machine()).together.findings)
