"""Odd things that were given to the commands: one line each, and never a wait without an end."""
from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from console.cli import app

ROWS = "time_s,speed_mps,shaft_rpm\n" + "".join(f"{k / 10},1.5,{40 + k % 5}\n" for k in range(60))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
@pytest.mark.parametrize("command", [["map"], ["import", "--guess"], ["diagnose"]], ids=lambda one: one[0])
@pytest.mark.parametrize("name", ["pipe.csv", "pipe.geojson"])
def test_a_pipe_is_no_file(tmp_path: Path, command: list[str], name: str) -> None:
    os.mkfifo(tmp_path / name)
    done = CliRunner().invoke(app, [*command, str(tmp_path / name)])
    assert done.exit_code == 2 and "a pipe or a device: allowed is a file" in done.output, done.output


def test_the_same_file_twice_counts_once_or_not_at_all(tmp_path: Path) -> None:
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    log.write_text(ROWS)
    (tmp_path / "sub").mkdir()
    done = CliRunner().invoke(app, ["import", str(log), str(tmp_path / "sub" / ".." / "log.csv"), "--out", str(out)])
    assert done.exit_code == 2 and "named twice" in done.output and not out.exists()
