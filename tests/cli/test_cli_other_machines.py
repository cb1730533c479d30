"""Machines of other scale at the commands: their bounds, a run of the spreader, a log of a drive alone."""
from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from console.cli import app
from control.machine.compiled import shaft_run
from control.machine.machine import with_effect
from control.machine.over_log import MOST_STEP_S, input_rows, no_switch
from control.machine.shaft import ShaftInput, ShaftOutput, shaft_start
from drivers.files.config import load, shipped
from drivers.files.kinds import MACHINE

runner = CliRunner()


@pytest.mark.parametrize("name", ["drive_alone", "planter", "spreader"])
def test_check_accepts_them(name: str) -> None:
    result = runner.invoke(app, ["check", str(shipped("machines")[name])])
    assert result.exit_code == 0 and "ok (topdress-machine/1)" in result.output
    assert "typical figures" in shipped("machines")[name].read_text(encoding="utf-8")


def test_effects_of_a_machine_have_its_bounds(tmp_path: Path) -> None:
    plain = runner.invoke(app, ["effects", "--machine", "drive_alone"]).output
    assert "shaft.dead_band  (r/min; 0 to 390)" in plain and "(% lost at 650 r/min; -10 to 60)" in plain
    assert "shaft.dead_band  (r/min; 0 to 60)" in runner.invoke(app, ["effects"]).output
    listed = {one["id"]: one for one in json.loads(
        runner.invoke(app, ["effects", "--json", "--machine", str(shipped("machines")["spreader"])]).output)}
    assert (listed["gate.slow"]["low"], listed["gate.slow"]["high"]) == (-40.0, 39.0)
    page = tmp_path / "page.md"
    assert runner.invoke(app, ["effects", "--machine", "spreader", "--markdown", str(page)]).exit_code == 0
    assert "Ranges are those of machine `spreader`" in page.read_text(encoding="utf-8")
    assert "| mm/s lost | -40 to 39, a share of gate.slew_mm_s |" in page.read_text(encoding="utf-8")


def test_effects_writes_over_no_machine_file(tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_bytes(shipped("machines")["spreader"].read_bytes())
    result = runner.invoke(app, ["effects", "--machine", str(own), "--markdown", str(own), "--force"])
    assert result.exit_code != 0 and own.read_bytes() == shipped("machines")["spreader"].read_bytes()


def test_a_size_out_of_bounds_is_refused_with_the_machines_range() -> None:
    result = runner.invoke(app, ["simulate", "--machine", "spreader", "--job", "spreader_demo", "--seconds", "5",
                                 "--effect", "gate.offset=70"])
    assert result.exit_code != 0
    assert "gate.offset: size 70: allowed -66.6667 to 66.6667" in result.output
    assert "where limits.opening_high_mm is 200" in result.output


@pytest.mark.exam
def test_a_spreader_meters_and_places_what_is_wanted() -> None:
    result = runner.invoke(app, ["simulate", "--machine", "spreader", "--job", "spreader_demo", "--seconds", "240",
                                 "--summary", "--json"])
    assert result.exit_code == 0, result.output
    told = json.loads(result.output)
    assert told["rate_error_percent"] < 4.0 and told["released_kg"] == pytest.approx(told["landed_kg"])
    assert told["area_ha"] > 1.0


@pytest.mark.exam
def test_a_log_of_a_shaft_alone_is_diagnosed(tmp_path: Path) -> None:
    drive = load("drive_alone", MACHINE).model
    rng, time = np.random.default_rng(4), np.arange(0.0, 240.0, 0.05)
    asked = np.round(rng.uniform(0.0, 600.0, 200)[(time / 1.5).astype(int)], 1)
    inputs = input_rows(ShaftInput, len(time), command_rpm=asked, opening_mm=0.0, supply_v=7.4)
    turns = shaft_run((with_effect(drive, "shaft.gain", -6.0).shaft,), no_switch(), shaft_start(),
                      ShaftOutput(0.0, 0.0), inputs, time, MOST_STEP_S)[:, 0]
    place = tmp_path / "drive.csv"
    read = turns + 2.0 * rng.standard_normal(len(time))
    place.write_text("time_s,shaft_rpm_cmd,shaft_rpm\n" + "".join(
        f"{t:.3f},{c:g},{r:.2f}\n" for t, c, r in zip(time, asked, read, strict=True)), encoding="utf-8")
    result = runner.invoke(app, ["diagnose", str(place), "--machine", "drive_alone", "--json", "-"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert [one["channel"] for one in found["channels"]] == ["shaft"] and found["data"]["machine"] == "drive_alone"
    gain = next(one for one in found["causes"] if one["id"] == "shaft.gain")
    assert gain["size"]["value"] == pytest.approx(-6.0, abs=1.0)
