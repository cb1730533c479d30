"""`topdress machine --from LOG`: a first machine file of one stage; what it has not got is not
told of."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from topdress.control.calibration.first_machine import round_up, suggest_machine
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.log_row import COMMANDS_HELD_EVENT
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND
from topdress.drivers.files.read_log import read_nonempty_log

from tests.command import topdress

Array = npt.NDArray[np.float64]


def log_of(path: Path, one_way: bool = False, steps: int = 80) -> Path:
    """A drive with a dead time of 0.05 s and a time constant of 0.1 s, 4 r/min of noise, 20 %
    faster than told."""
    rng, time_s = np.random.default_rng(5), 0.01 * np.arange(150 * steps)
    command = np.repeat(rng.uniform(0.0 if one_way else -1200.0, 1200.0, steps).round(), 150)
    told, speed, rows = np.concatenate((np.full(5, command[0]), command[:-5])), command[0], []
    for t, c, w in zip(time_s, command, told, strict=True):
        rows.append(f"{t:.2f},{c:g},{1.2 * speed + 4.0 * rng.standard_normal():.2f}\n")
        speed += (w - speed) * (1.0 - np.exp(-0.01 / 0.1))
    path.write_text("time_s,shaft_rpm_cmd,shaft_rpm\n" + "".join(rows))
    return path


def test_four_questions_make_a_file_of_a_few_lines(tmp_path: Path) -> None:
    log, out = log_of(tmp_path / "pump-log.csv"), tmp_path / "pump.yaml"
    words = ["machine", "--from", str(log), "--out", str(out), "--kind", "pump"]
    done = topdress(*words, input="1250\n\n\n\n")
    assert done.exit_code == 0, done.output
    assert "4 questions" in done.output
    lines = [line for line in out.read_text().splitlines() if not line.startswith("#")]
    assert len(lines) <= 7 and "stages: [shaft]" in lines
    made = load_config(str(out), MACHINE_KIND).model
    assert (made.id, made.limits.shaft_high_rpm, made.shaft.one_way) == ("pump", 1250.0, 0.0)
    assert made.noise.shaft_rpm == pytest.approx(4.0, rel=0.15)
    assert made.shaft.dead_time_s + made.shaft.time_constant_s == pytest.approx(0.15, abs=0.02)
    again = topdress("machine", "--from", log, "--out", out, "--yes")
    assert again.exit_code == 2 and "exists already" in again.output
    beside = topdress("machine", "--from", log, "--out", log.with_suffix(".yaml"), "--yes")
    assert beside.exit_code == 2 and "allowed is another name" in beside.output


@pytest.mark.exam
def test_what_the_drive_takes_for_itself_is_in_the_file_where_the_log_says_it(
    tmp_path: Path,
) -> None:
    """20 % dry and 0.03 % for each r/min, planted; asked as a fifth question, left out where
    nobody says its unit."""
    log, out = log_of(tmp_path / "pump-log.csv", one_way=True, steps=40), tmp_path / "pump.yaml"
    head, *rows = log.read_text().splitlines()
    noise = np.random.default_rng(6).standard_normal(len(rows))
    log.write_text(
        "\n".join(
            (
                f"{head},shaft_effort",
                *(
                    f"{row},{20.0 + 0.03 * float(row.split(',')[2]) + one:.3f}"
                    for row, one in zip(rows, noise, strict=True)
                ),
            )
        )
    )
    words = ["machine", "--from", str(log), "--out", str(out), "--kind", "pump"]
    done = topdress(*words, input="1500\n\n\n\n\n")
    assert done.exit_code == 0 and "5 questions" in done.output, done.output
    made = load_config(str(out), MACHINE_KIND).model
    assert (
        made.has_stage("effort")
        and made.effort_unit == "%"
        and made.noise.effort == pytest.approx(1.0, rel=0.2)
    )
    assert (made.effort.coulomb, made.effort.viscous) == (
        pytest.approx(20.0, rel=0.05),
        pytest.approx(0.03, rel=0.1),
    )
    found = diagnose_run(dict(read_nonempty_log(log).columns), made)
    assert [one.channel for one in found.channels] == ["shaft", "effort"] and found.data.stages == (
        "shaft",
        "effort",
    )
    assert topdress(*words, "--yes", "--force").exit_code == 0
    assert not load_config(str(out), MACHINE_KIND).model.has_stage("effort")


@pytest.mark.exam
def test_what_it_has_not_got_is_not_told_of(tmp_path: Path) -> None:
    log, out = log_of(tmp_path / "fan-log.csv", one_way=True, steps=30), tmp_path / "fan.yaml"
    done = topdress("machine", "--from", log, "--out", out, "--kind", "fan", "--yes")
    assert done.exit_code == 0, done.output
    made = load_config(str(out), MACHINE_KIND).model
    assert made.shaft.one_way == 0.0, (
        "a log that goes one way does not say that the drive cannot go back"
    )
    topdress("machine", "--from", log, "--out", out, "--yes", "--one-way", "--force")
    assert load_config(str(out), MACHINE_KIND).model.shaft.one_way == 1.0
    found = diagnose_run(dict(read_nonempty_log(log).columns), made)
    assert found.data.stages == ("shaft",) and [one.channel for one in found.channels] == ["shaft"]
    assert not [one for one in found.findings if "is left out: column" in one]
    assert {one.id.split(".")[0] for one in found.not_shown} == {"shaft"}
    said = topdress("diagnose", log, "--machine", out).output
    for word in ("gate", "hopper", "ndvi", "canopy", "speed_mps", "scale"):
        assert word not in said, said


def test_what_it_cannot_be_made_of_is_refused(tmp_path: Path) -> None:
    log, out = tmp_path / "none.csv", tmp_path / "x.yaml"
    log.write_text("time_s,speed_mps,shaft_rpm\n" + "".join(f"{k},1,2\n" for k in range(50)))
    done = topdress("machine", "--from", log, "--out", out, "--yes")
    assert (
        done.exit_code == 2 and "column shaft_rpm_cmd: missing" in done.output and not out.exists()
    )


def test_a_time_constant_that_the_log_does_not_show_is_asked_for(tmp_path: Path) -> None:
    """At one command all along nothing answers: no figure of the grid is written as if it had
    been seen."""
    rng, log, out = np.random.default_rng(8), tmp_path / "held-log.csv", tmp_path / "held.yaml"
    log.write_text(
        "time_s,shaft_rpm_cmd,shaft_rpm\n"
        + "".join(
            f"{0.1 * k:.1f},900,{860 - 0.2 * k * (k > 300) + 5 * rng.standard_normal():.1f}\n"
            for k in range(600)
        )
    )
    words = ["machine", "--from", str(log), "--out", str(out), "--running"]
    asked = topdress(*words, input="\n\n\n0.3\n")
    assert asked.exit_code == 0 and "this log does not show it" in asked.output
    assert load_config(str(out), MACHINE_KIND).model.shaft.time_constant_s == 0.3
    given = ["--time-constant", "2"]
    for more, tau_s, source in (([], 0.05, "a small drive's"), (given, 2.0, "as answered")):
        said = topdress(*words, "--yes", "--force", *more).output
        assert f"time constant {tau_s:g} s, {source}: the log does not show it" in said
        assert load_config(str(out), MACHINE_KIND).model.shaft.time_constant_s == tau_s


def test_a_heater_has_a_time_constant_of_minutes(tmp_path: Path) -> None:
    """150 s and 15 s of dead time, rows of a second, 21 degrees where nothing heats."""
    rng, log, out = np.random.default_rng(9), tmp_path / "heater-log.csv", tmp_path / "heater.yaml"
    command = np.repeat([0.0, 60.0, 20.0, 80.0, 0.0, 50.0], 200)
    warm, rows = 0.0, []
    for k, duty in enumerate(command):
        rows.append(f"{k},{duty:g},{21.0 + warm + 0.1 * rng.standard_normal():.2f}\n")
        warm += (0.6 * command[max(0, k - 15)] - warm) * -np.expm1(-1.0 / 150.0)
    log.write_text("time_s,shaft_rpm_cmd,shaft_rpm\n" + "".join(rows))
    done = topdress("machine", "--from", log, "--out", out, "--yes", "--running")
    assert "as the log shows them" in done.output
    made = load_config(str(out), MACHINE_KIND).model
    assert made.shaft.time_constant_s == pytest.approx(150.0, rel=0.1)
    assert made.shaft.dead_time_s == pytest.approx(15.0, abs=4.0)
    assert made.tolerance.time_constant_s == pytest.approx(
        0.05 * made.shaft.time_constant_s, rel=0.01
    )


@pytest.mark.parametrize(
    ("goal", "low_rpm", "neutral_rpm", "gain_percent", "zero_stops"),
    [
        (lambda u: u, 0.0, 0.0, 0.0, 1.0),
        (lambda u: 1.1 * np.maximum(0.0, u - 60.0), 0.0, 0.0, 0.0, 1.0),
        (lambda u: 610.0 * -np.expm1(-u / 300.0), 60.0, 0.0, 0.0, 1.0),
        (lambda u: 30.0 + 1.2 * u, 0.0, -25.0, 0.0, 0.0),
        (lambda u: 1.2 * (u - 250.0), 60.0, 250.0, 0.0, 1.0),
        (lambda u: 560.0 - 1.1 * u, 60.0, 509.1, -200.0, 1.0),
    ],
    ids=["through zero", "a zone", "a curve", "an offset", "a servo", "falls"],
)
def test_where_it_stands_is_measured(
    goal: Callable[[Array], Array],
    low_rpm: float,
    neutral_rpm: float,
    gain_percent: float,
    zero_stops: float,
    tmp_path: Path,
) -> None:
    rng, log, out = np.random.default_rng(4), tmp_path / "own-log.csv", tmp_path / "own.yaml"
    command = np.repeat(rng.uniform(60.0, 500.0, 60).round(1), 50)
    command[:500] = low_rpm
    speed, rows = float(goal(command[:1])[0]), []
    for k, goal_rpm in enumerate(goal(command)):
        rows.append(f"{0.02 * k:.2f},{command[k]:g},{speed + 2.0 * rng.standard_normal():.2f}\n")
        speed += (float(goal_rpm) - speed) * -float(np.expm1(-0.02 / 0.1))
    log.write_text("time_s,shaft_rpm_cmd,shaft_rpm\n" + "".join(rows))
    done = topdress("machine", "--from", log, "--out", out, "--yes")
    assert ("stands at a command of" in done.output) == (neutral_rpm != 0.0), done.output
    shaft = load_config(str(out), MACHINE_KIND).model.shaft
    assert shaft.neutral_rpm == pytest.approx(neutral_rpm, abs=1.5)
    assert (shaft.gain_percent, shaft.zero_stops) == (gain_percent, zero_stops)


def test_settled_answers_have_no_times() -> None:
    steps = np.arange(0.0, 60.0)
    found = suggest_machine(
        {"time_s": 1.1 * steps, "shaft_rpm_cmd": 10.0 * steps, "shaft_rpm": 11.0 * steps}
    )
    assert found.settled and (found.dead_s, found.tau_s) == (0.0, 0.0)
    assert [round_up(one) for one in (637.0, 100.0, 101.0, 0.93, 8200.0)] == [
        650.0,
        100.0,
        150.0,
        1.0,
        10_000.0,
    ]


@pytest.mark.parametrize("tau_s", [0.1, 0.25, 0.7])
def test_a_drive_that_moves_on_after_its_row_has_a_time_constant(tau_s: float) -> None:
    """A row that holds a command and the beginning of its answer, every 20 ms: no settled
    answers."""
    rng, time_s = np.random.default_rng(3), np.arange(0.0, 60.0, 0.02)
    command = np.repeat(rng.choice([0.0, 200.0, 400.0, 900.0, 1500.0], 20), 150)
    speed_rpm = np.zeros(len(command))
    for k in range(1, len(command)):
        speed_rpm[k] = speed_rpm[k - 1] + (command[k - 1] - speed_rpm[k - 1]) * -np.expm1(
            -0.02 / tau_s
        )
    events = np.full(len(time_s), COMMANDS_HELD_EVENT, object)
    found = suggest_machine(
        {
            "time_s": time_s,
            "shaft_rpm_cmd": command,
            "events": events,
            "shaft_rpm": speed_rpm + rng.normal(0.0, 4.0, len(time_s)),
        }
    )
    assert (
        not found.settled and found.tau_s == pytest.approx(tau_s, rel=0.05) and found.dead_s < 0.02
    )


def test_numbers_that_no_machine_file_may_have_are_not_written(tmp_path: Path) -> None:
    """A converter's counts for a command: standstill at 17,140 of them."""
    log, out = tmp_path / "counts-log.csv", tmp_path / "counts.yaml"
    counts = [1000 * (k // 40) for k in range(1600)]
    log.write_text(
        "time_s,shaft_rpm_cmd,shaft_rpm\n"
        + "".join(f"{0.1 * k:.1f},{count},{17140 - count}\n" for k, count in enumerate(counts))
    )
    done = topdress(
        "machine", "--from", log, "--out", out, "--yes", "--running", "--full-speed", 50
    )
    assert done.exit_code == 2 and not out.exists()
    assert "not written: shaft.neutral_rpm: allowed" in done.output
