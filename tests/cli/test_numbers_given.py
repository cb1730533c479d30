"""Numbers on the command line: nan and inf are none, whichever option takes one."""
from __future__ import annotations

import pytest
from typer.testing import CliRunner

from console.cli import app

runner = CliRunner()


@pytest.mark.parametrize("given", [
    "simulate --seconds inf", "calibrate lag table.csv --out new.yaml --from-rpm nan",
    "map in.zip --out out.geojson --scale inf", "map in.zip --out out.geojson --outside nan"])
def test_what_is_no_number_is_refused_in_one_line(given: str) -> None:
    """`simulate --seconds inf` was a fault of ours, OverflowError."""
    said = runner.invoke(app, given.split())
    assert said.exit_code == 2 and said.output.count("\n") == 1, said.output
    assert "allowed is a number, not" in said.output


@pytest.mark.parametrize("given", ["simulate --seconds 12,5", "simulate --seconds 5 --effect flow.gain=8,5"])
def test_a_comma_is_refused_and_never_dropped(given: str) -> None:
    said = runner.invoke(app, given.split())
    assert said.exit_code == 2 and ("12,5" in said.output or "8,5" in said.output or "number" in said.output)
