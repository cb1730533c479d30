"""Recordings of real drives: what their owner has to say of them, and what comes out."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import Result

from drivers.files.read_log import read_log
from tests.places import DRIVES

STAIRS = {"shaft_rpm_cmd": {"from": "motorCommand", "scale": 2.5}, "shaft_rpm": {"from": "rightSpeedRpm"}}
LOOP = {"shaft_rpm_cmd": {"from": "targetSpeed"}, "shaft_rpm": {"from": "leftSpeed"}}

# File, unsure lines of the guess, rows in the log, what is said by hand.
FILES = [
    ("wheelSpeedCalibration1.csv", 3, 27, {"columns": STAIRS}),
    ("wheelSpeedCalibration2.csv", 3, 103, {"columns": STAIRS}),
    ("wheelSpeedCalibration3.csv", 3, 511,
     {"columns": STAIRS | {"supply_v": {"from": "batteryVoltage", "unit": "mV"}}}),
    ("testPid1.csv", 4, 872, {"columns": LOOP}), ("testPid2.csv", 3, 748, {"columns": LOOP}),
    ("testPid3.csv", 3, 476, {"columns": LOOP}),
]


@pytest.mark.parametrize(("name", "unsure", "rows", "by_hand"), FILES, ids=[one[0] for one in FILES])
def test_a_recording_of_a_drive(name: str, unsure: int, rows: int, by_hand: dict[str, Any],
                                topdress: Callable[..., Result], tmp_path: Path) -> None:
    place, out = tmp_path / "m.yaml", tmp_path / "log.csv"
    refused = topdress("import", DRIVES / name, "--out", out)
    assert refused.exit_code == 2 and not out.exists() and len(refused.output.splitlines()) == unsure + 1
    assert topdress("import", DRIVES / name, "--guess", "--mapping", place).exit_code == 0
    guessed = yaml.safe_load(place.read_text(encoding="utf-8"))
    assert set(guessed["columns"]) == set(by_hand["columns"])
    place.write_text(yaml.safe_dump(guessed | by_hand), encoding="utf-8")
    result = topdress("import", DRIVES / name, "--mapping", place, "--out", out)
    assert result.exit_code == 0, result.output
    log = read_log(out)
    assert len(log) == rows
    raw = np.genfromtxt(DRIVES / name, delimiter=",", names=True)
    command, reading = by_hand["columns"]["shaft_rpm_cmd"], by_hand["columns"]["shaft_rpm"]
    assert guessed["rows"] == ("answer_in_row" if command["from"] == "motorCommand" else "answer_next_row")
    first = 1 if guessed["rows"] == "answer_in_row" else 0
    assert np.array_equal(log.numbers("shaft_rpm")[first:], raw[reading["from"]])
    assert np.allclose(log.numbers("shaft_rpm_cmd")[:len(raw)], command.get("scale", 1.0) * raw[command["from"]])
    assert np.median(np.diff(log.time_s)) == pytest.approx({"w": 1.1, "t": 0.011}[name[0]], rel=1.0)
    if "supply_v" in by_hand["columns"]:
        assert 7.0 < np.nanmedian(log.numbers("supply_v")) < 9.0


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


ROWS = [(0.02 * k, 100 * (k // 20 % 3), 40 * (k // 20 % 3)) for k in range(120)]


def test_a_log_without_a_header_is_asked_about_by_every_command(topdress: Callable[..., Result],
                                                                tmp_path: Path) -> None:
    """Import reads it, so that no other command may say that it must name its columns."""
    log = written(tmp_path / "bare.csv", "".join(f"{t:.2f},{u},{y}\n" for t, u, y in ROWS))
    for words in (("machine", "--from", log, "--out", tmp_path / "m.yaml", "--yes"), ("diagnose", log),
                  ("compare", "drive_alone", "drive_alone", log)):
        said = topdress(*words)
        assert said.exit_code == 2 and "--guess" in said.output and "must name" not in said.output, said.output


def test_a_command_by_name_is_seen_where_the_time_is_called_as_ours(topdress: Callable[..., Result],
                                                                   tmp_path: Path) -> None:
    log = written(tmp_path / "mixed.csv", "time_s,commanded_rpm,feedback_rpm\n"
                  + "".join(f"{t:.2f},{u},{y}\n" for t, u, y in zip(
                      [row[0] for row in ROWS], [row[1] for row in ROWS], [0] * 3 + [row[1] for row in ROWS[:-3]],
                      strict=True)))
    said = topdress("machine", "--from", log, "--out", tmp_path / "m.yaml", "--yes")
    assert said.exit_code == 0, said.output


def test_where_no_command_is_the_next_step_is_said(topdress: Callable[..., Result], tmp_path: Path) -> None:
    log = written(tmp_path / "reading.csv", "Time (s),Motor Speed (RPM)\n"
                  + "".join(f"{t:.2f},{y + k % 2}\n" for k, (t, _, y) in enumerate(ROWS)))
    said = topdress("machine", "--from", log, "--out", tmp_path / "m.yaml", "--yes")
    assert said.exit_code != 0 and "shaft_rpm_cmd: missing" in said.output and "--guess" in said.output


def test_times_in_another_unit_than_the_header_says(topdress: Callable[..., Result], tmp_path: Path) -> None:
    log = written(tmp_path / "us.csv", "time_us,pwm,w\n" + "".join(f"{t / 40:.5f},{u},{y}\n" for t, u, y in ROWS))
    said = topdress("import", log, "--guess", "--mapping", tmp_path / "g.yaml")
    assert "are the times in another unit?" in said.output and "sort the log" not in said.output


def test_a_command_that_is_not_seen_is_no_sure_guess(topdress: Callable[..., Result], tmp_path: Path) -> None:
    """A setpoint in turns a second is read as nothing known; the g of an acceleration is no gram; u and y are asked."""
    rows = range(60)
    brake, shaken, plain = (tmp_path / f"{name}.csv" for name in ("brake", "shaken", "plain"))
    brake.write_text("time [s],velocity setpoint [Hz],velocity measured [Hz],load cell weight [g]\n" + "".join(
        f"{0.1 * k:.1f},{15 + k % 3},{14.2 + k % 3},{5 * k}\n" for k in rows))
    shaken.write_text("time [s],acceleration x [g],acceleration y [g]\n" + "".join(
        f"{0.1 * k:.1f},{0.01 * (k % 7):.2f},{1 + 0.01 * (k % 5):.2f}\n" for k in rows))
    plain.write_text("t,u,y\n" + "".join(f"{0.02 * k:.2f},{(k * 7) % 5},{40 - k % 11}\n" for k in rows))
    said = topdress("import", brake, "--guess", "--mapping", tmp_path / "b.yaml").output
    assert "nothing is unsure" not in said and "velocity setpoint [Hz]" in said
    assert topdress("import", shaken, "--guess", "--mapping", tmp_path / "s.yaml").exit_code == 0
    assert "hopper_kg" not in yaml.safe_load((tmp_path / "s.yaml").read_text(encoding="utf-8"))["columns"]
    said = topdress("import", plain, "--guess", "--mapping", tmp_path / "p.yaml").output
    assert "y follows u: is that the command of a drive and this its reading?" in said
    assert '# shaft_rpm_cmd: {from: "u", scale: }' in (tmp_path / "p.yaml").read_text(encoding="utf-8")
