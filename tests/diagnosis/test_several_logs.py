"""Several logs of one machine: what they share is named once, what differs is told by log."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from topdress.console.cli import app
from topdress.control.diagnosis.result import Diagnosis, Size, SourceSummary
from topdress.control.diagnosis.runs.several import (
    JointDiagnosis,
    SharedEffect,
    diagnose_runs,
    join_logs,
    note_differing_columns,
)
from topdress.control.log_row import COMMANDS_HELD_EVENT
from topdress.control.machine.machine import Machine
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND
from typer.testing import CliRunner

from tests.diagnosis.logs import Columns, drive, followed, planted_in, speeds, taken

WHEEL = drive(1500.0, 4.0, dead_time_s=0.0, time_constant_s=0.25)


def wheel_log(seed: int, wheel: float, gnss_late_s: float = 0.0, seconds: float = 240.0) -> Columns:
    """Wheel against GNSS speed, ten rows a second; the wheel reads `wheel` times the ground's
    speed."""
    time_s, period_s = np.arange(0.0, seconds, 0.1), 4.0 + 0.3 * seed
    true, late = (1.3 + 0.4 * np.sin(at / period_s) for at in (time_s, time_s - gnss_late_s))
    return speeds(seed, time_s, true, wheel, late)


@cache
def pair(*wheels: float) -> JointDiagnosis:
    """Two logs, each with its own share that the wheel reads more."""
    return diagnose_runs(
        [wheel_log(k + 1, wheel) for k, wheel in enumerate(wheels)], Machine(), paths=("a", "b")
    )


def written(folder: Path, *logs: Columns) -> list[str]:
    """Paths of the logs as files."""
    paths = [folder / f"log{k + 1}.csv" for k in range(len(logs))]
    for path, log in zip(paths, logs, strict=True):
        rows = zip(*log.values(), strict=True)
        path.write_text(
            "\n".join((",".join(log), *(",".join(f"{value:.4f}" for value in row) for row in rows)))
            + "\n"
        )
    return [str(path) for path in paths]


def drive_log(seed: int, top_rpm: float, comes_from_rpm: float | None) -> Columns:
    """A wheel 10 % slow in rows of 20 ms, at another speed every three seconds."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, 60.0, 0.02)
    command = np.repeat(rng.choice([200.0, 400.0, 600.0, 900.0, 1200.0, top_rpm], 20), 150)
    if comes_from_rpm is not None:
        command[:150] = top_rpm
    speed_rpm = followed(0.9 * command, -float(np.expm1(-0.02 / 0.25)), start=comes_from_rpm)
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": command,
        "shaft_rpm": speed_rpm + rng.normal(0.0, 4.0, len(time_s)),
    }


@pytest.mark.exam
def test_what_they_share_is_named_once_and_what_differs_by_log() -> None:
    found = diagnose_runs(
        [wheel_log(1, 1.03), wheel_log(2, 1.03), wheel_log(3, 1.03, gnss_late_s=0.8)],
        Machine(),
        paths=("a", "b", "c"),
    )
    assert "speed.wheel_radius" in [cause.id for cause in found.together.causes]
    size = next(one.size.value for one in found.together.causes if one.id == "speed.wheel_radius")
    assert size == pytest.approx(
        3.0, abs=0.4
    ) and found.machine.speed.radius_percent == pytest.approx(size)
    assert [one.data.path for one in found.each] == ["a", "b", "c"]
    assert "speed.wheel_radius" not in [cause.id for one in found.each for cause in one.causes]
    told = found.to_json()
    assert told["format"] == "topdress-diagnosis/1" and [
        one["data"]["path"] for one in told["logs"]
    ] == ["a", "b", "c"]


def test_on_the_command_line(tmp_path: Path) -> None:
    paths = written(tmp_path, *(wheel_log(seed, 1.03, seconds=180.0) for seed in (1, 2)))
    new, found = tmp_path / "new.yaml", tmp_path / "found.json"
    done = CliRunner().invoke(app, ["diagnose", *paths, "--adopt", str(new), "--json", str(found)])
    assert done.exit_code == 0, done.output
    assert done.stdout.count("speed.wheel_radius: ") == 1
    own = done.stdout[done.stdout.index("each log by itself, beyond what they share:") :]
    assert own.count("nothing beyond noise") == 2 and all(path in own for path in paths)
    assert load_config(str(new), MACHINE_KIND).model.speed.radius_percent == pytest.approx(
        3.0, abs=0.5
    )
    assert [one["verdict"] for one in json.loads(found.read_text())["logs"]] == ["none", "none"]
    twice = CliRunner().invoke(app, ["diagnose", paths[0], paths[0]])
    assert twice.exit_code == 2 and "named twice" in twice.output


def test_logs_are_put_one_after_the_other_with_what_they_lack_empty() -> None:
    first = {
        "time_s": np.array([5.0, 6.0]),
        "shaft_rpm": np.array([1.0, 2.0]),
        "x_torque": np.array([7.0, 8.0]),
    }
    later = {
        "time_s": np.arange(0.0, 5.0),
        "shaft_rpm": np.arange(10.0, 15.0),
        "state": np.full(5, "working", object),
    }
    found = join_logs([first, later], ["a", "b"], Machine())
    assert found["time_s"].tolist() == [0.0, 1.0, 61.0, 62.0, 63.0, 64.0, 65.0]
    assert (
        np.isnan(found["x_torque"][2:]).all()
        and found["state"].tolist() == ["", ""] + ["working"] * 5
    )
    assert found["shaft_rpm"][:2].tolist() == [1.0, 2.0] and np.isnan(found["shaft_rpm"][2]), (
        "it comes to its speed"
    )
    held = {**first, "events": np.array([COMMANDS_HELD_EVENT, ""], object)}
    with pytest.raises(ValueError, match="b holds settled answers, a does not"):
        join_logs([first, held], ["a", "b"], Machine())
    with pytest.raises(ValueError, match="allowed two or more"):
        join_logs([first], ["a"], Machine())


@pytest.mark.parametrize(
    ("volts", "gains", "said"),
    [
        (
            (14.0, 16.0, 18.0),
            (4.0, 8.0, 12.0),
            "line over it gives the sizes of shaft.gain",
        ),
        (
            (14.0, 16.0, 18.0),
            (4.0, 12.0, 4.0),
            "supply_v differs between the logs as well (14,",
        ),
        ((14.0, 14.0, 14.0), (4.0, 8.0, 12.0), ""),
    ],
)
def test_columns_that_differ_between_logs_are_asked_before_machines_of_a_kind(
    volts: tuple[float, ...], gains: tuple[float, ...], said: str
) -> None:
    data = SourceSummary("run.csv", "run", 600, 60.0, "drive")
    logs = [
        Diagnosis(
            data, (), "named", (), (), (), None, (), None,
            excited={"supply_v": (volt - 0.1, volt + 0.1), "time_s": (0.0, volt)},
        )
        for volt in volts
    ]  # fmt: skip
    sizes = tuple(Size(gain, gain - 0.2, gain + 0.2, "%") for gain in gains)
    found = note_differing_columns(logs, (SharedEffect("shaft.gain", None, sizes, 1e-9),))
    assert len(found) == bool(said) and said in "".join(found)
    assert ("straight line" in "".join(found)) is (gains == (4.0, 8.0, 12.0) and bool(said))


@pytest.mark.exam
def test_two_machines_of_a_kind_have_the_same_by_sizes_of_their_own(tmp_path: Path) -> None:
    found = pair(1.03, 1.08)
    (one,) = found.of_a_kind
    assert one.id == "speed.wheel_radius" and one.p < 1e-6 and found.machine == Machine()
    assert [size.value for size in one.sizes] == pytest.approx([3.0, 8.0], abs=0.5)
    assert [[cause.id for cause in each.causes] for each in found.each] == [
        ["speed.wheel_radius"]
    ] * 2
    assert found.to_json()["of_a_kind"][0]["sizes"][1]["unit"] == "%"
    assert pair(1.03, 1.03).of_a_kind == ()
    paths = written(tmp_path, wheel_log(1, 1.03), wheel_log(2, 1.08))
    done = CliRunner().invoke(app, ["diagnose", *paths, "--adopt", str(tmp_path / "new.yaml")])
    assert (
        done.exit_code == 2
        and "machines of a kind" in done.stdout
        and not (tmp_path / "new.yaml").exists()
    )
    assert "allowed is one log, or logs of one machine" in done.output


@pytest.mark.exam
def test_logs_whose_rows_hold_the_beginning_of_an_answer_are_joined_with_time_to_settle() -> None:
    """The second log begins at a speed that its first command did not make: that is no change
    of the machine."""
    logs = [drive_log(seed, 1500.0, 0.0) for seed in (1, 2)]
    for log in logs:
        log["events"] = np.array([COMMANDS_HELD_EVENT] + [""] * (len(log["time_s"]) - 1), object)
    found = diagnose_runs(logs, WHEEL)
    assert [cause.id for cause in found.together.causes] == [
        "shaft.gain"
    ] and not found.together.unexplained
    assert [one.verdict for one in found.each] == ["none", "none"]


@pytest.mark.exam
def test_the_machine_that_logs_are_held_against_takes_up_only_what_predicts_them_better() -> None:
    """A file adopts so from one log. Steps of an encoder, in a prediction, add their rounding
    where speeds are off."""
    logs = [
        planted_in(
            drive_log(seed, 1400.0, None), shaft_rpm=lambda c: 20.0 * np.round(c.shaft_rpm / 20.0)
        )
        for seed in (1, 2)
    ]
    late = WHEEL.model_copy(update={"shaft": WHEEL.shaft._replace(dead_time_s=0.02)})
    found = diagnose_runs(logs, late)
    assert [cause.id for cause in found.together.causes] == ["shaft.gain", "shaft.coarse_encoder"]
    assert found.machine.shaft.gain_percent == pytest.approx(-10.0, abs=0.2)
    assert found.machine.shaft.encoder_step_rpm == 0.0
    assert [one for one in found.together.findings if one.startswith("shaft.coarse_encoder")] == [
        "shaft.coarse_encoder: not in the machine that each log is held against: "
        "the log itself is predicted no better with it"
    ]


@pytest.mark.exam
def test_no_rows_are_missing_between_logs() -> None:
    first, lost = wheel_log(1, 1.03), taken(wheel_log(2, 1.03), np.r_[0:500, 520:2400])
    findings = pair(1.03, 1.03).together.findings
    assert findings[0] == "2 files in one log, 60 s from one to the next: no rows are missing there"
    assert not [one for one in findings if "gap" in one]
    assert any(
        one.startswith("1 gap in the times, the longest 2.1 s") and "about 20 rows missing" in one
        for one in diagnose_runs([first, lost], Machine()).together.findings
    )
