"""`topdress history`: what was changed, before and after; --undo writes the file without the last of it."""
from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from console.cli import app
from control.machine.history import noted
from control.machine.machine import Machine, effect_sizes, with_effect
from control.machine.terms import Term
from drivers.files.config import load, save
from drivers.files.kinds import MACHINE

TERM = Term.model_validate({"id": "flow.slope_roll_deg", "acts_on": "flow_percent", "form": "slope",
                            "over": ({"name": "roll_deg", "valid": (-4.0, 4.0)},), "coefficients": {"slope": -0.5}})


@pytest.fixture
def extended(tmp_path: Path) -> Path:
    path = tmp_path / "new.yaml"
    after = with_effect(Machine(), "flow.gain", 3.0).model_copy(update={"terms": (TERM,)})
    save(path, noted(Machine(), after, data="run.csv", date="2026-07-09"), MACHINE)
    return path


def test_it_says_both_sides(extended: Path) -> None:
    said = CliRunner().invoke(app, ["history", str(extended)])
    assert said.exit_code == 0
    assert "2026-07-09, from run.csv" in said.output
    assert "flow.gain: 0 -> 3 %" in said.output
    assert f"{TERM.id}: none -> Flow falls by 0.5 % for each deg of roll" in said.output


def test_undo_writes_another_file(extended: Path, tmp_path: Path) -> None:
    before = extended.read_bytes()
    said = CliRunner().invoke(app, ["history", str(extended), "--undo", "--out", str(tmp_path / "back.yaml")])
    assert said.exit_code == 0
    assert extended.read_bytes() == before
    back = load(str(tmp_path / "back.yaml"), MACHINE).model
    assert (effect_sizes(back), back.terms) == ({}, ())
    assert "taken back" in CliRunner().invoke(app, ["history", str(tmp_path / "back.yaml")]).output


@pytest.mark.parametrize("words", [["--undo"], ["--out", "x.yaml"]])
def test_the_file_itself_is_never_written_over(extended: Path, words: list[str]) -> None:
    said = CliRunner().invoke(app, ["history", str(extended), *words])
    assert said.exit_code != 0


def test_a_shipped_machine_has_none() -> None:
    said = CliRunner().invoke(app, ["history", "huanghai"])
    assert said.exit_code == 0
    assert said.output == "huanghai: no diagnosis changed this file\n"
