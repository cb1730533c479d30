"""`topdress calibrate lag --rig` against `serve-machine --lag-rig`: real sockets, real time;
and what it refuses."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from topdress.console.cli import bench_session, drop_test
from topdress.control.machine.fall import Fall, find_start_drop_s

from tests.command import TOPDRESS, serving, topdress


@pytest.mark.exam
def test_one_run_on_real_bytes_gives_a_table_that_is_read(tmp_path: Path) -> None:
    table = tmp_path / "lag.csv"
    with serving("--lag-rig") as urls:
        done = subprocess.run(
            [
                *TOPDRESS,
                "calibrate",
                "lag",
                "--rig",
                *urls["lag_rig"],
                "--board",
                *urls["board"],
                "--rpm",
                "40",
                "--repeats",
                "1",
                "--no-key",
                "--out",
                str(table),
            ],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=60,
        )
    assert (done.returncode, done.stdout, done.stderr) == (0, f"1 of 1 runs: {table}\n", "")
    header, row = table.read_text().splitlines()
    assert header == "shaft_rpm,replicate,response_s,drop_s"
    rpm, _, response_s, drop_s = map(float, row.split(","))
    assert rpm == 40.0 and 0.37 < response_s < 0.50
    # out of a standing shaft, eq 6
    assert drop_s == pytest.approx(find_start_drop_s(Fall(), 40.0), abs=0.08)


SILENT = "socket://127.0.0.1:9"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--rig", SILENT, "--board", SILENT], "only while the space bar is held down"),
        (["--rig", SILENT, "--board", SILENT, "--no-key"], f"board at {SILENT} is silent"),
        (["--rig", SILENT], f"lag_rig at {SILENT} is silent"),
    ],
    ids=["no key", "silent board", "no board, silent rig"],
)
def test_what_is_missing_is_said_and_writes_nothing(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (bench_session, drop_test):
        monkeypatch.setattr(module, "DEVICE_TIMEOUT_S", 0.5)
    table = tmp_path / "lag.csv"
    result = topdress("calibrate", "lag", *words, "--out", table)
    assert result.exit_code == 2 and said in result.output and not table.exists()
    assert len(result.stderr.splitlines()) == 1


def test_a_table_that_exists_is_not_overwritten(tmp_path: Path) -> None:
    table = tmp_path / "lag.csv"
    table.write_text("mine")
    result = topdress("calibrate", "lag", "--rig", "x", "--board", "y", "--no-key", "--out", table)
    assert (
        result.exit_code == 2 and "exists already" in result.output and table.read_text() == "mine"
    )


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["lag", "t.csv", "--rig", "x"], "or --rig URL and no table"),
        (["lag"], "or --rig URL and no table"),
        (["catch", "--rig", "x"], "No such option: --rig"),
    ],
)
def test_either_a_table_or_a_rig(arguments: list[str], why: str, tmp_path: Path) -> None:
    result = topdress("calibrate", *arguments, "--out", tmp_path / "x")
    assert result.exit_code == 2 and why in result.output
