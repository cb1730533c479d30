"""Rules that the tests themselves keep."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

LONGEST_S = 300.0
LOOPS = """
import pytest

def test_that_loops():
    while True:
        pass

@pytest.mark.exam
def test_of_the_exam(request):
    assert request.node.get_closest_marker("timeout").args[0] > 300.0

def test_that_follows():
    pass
"""


def test_every_test_has_a_time_limit(request: pytest.FixtureRequest) -> None:
    """One that a fault made loop held all others up for four minutes."""
    assert 0.0 < float(request.config.getini("timeout")) <= LONGEST_S
    assert request.config.pluginmanager.hasplugin("timeout")


def test_a_test_that_loops_fails_and_the_others_run(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    for name in ("conftest.py", "repeated_cases.txt"):
        (tmp_path / name).write_text(
            Path(__file__).with_name(name).read_text(encoding="utf-8"), encoding="utf-8"
        )
    (tmp_path / "test_loops.py").write_text(LOOPS)
    began_s = time.monotonic()
    ended = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-c",
            str(request.config.inipath),
            "--rootdir",
            str(tmp_path),
            "-p",
            "no:cacheprovider",
            "-o",
            "timeout=2",
            "-m",
            "",
            str(tmp_path),
        ],
        cwd=request.config.rootpath,
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
    )
    assert "1 failed, 2 passed" in ended.stdout and "Timeout (>2.0s)" in ended.stdout, ended.stdout[
        -2000:
    ]
    assert time.monotonic() - began_s < 60.0


def test_no_name_of_a_test_floods_a_terminal(request: pytest.FixtureRequest) -> None:
    assert [item.nodeid[:200] for item in request.session.items if len(item.nodeid) > 300] == []


def test_repeated_cases_are_cases_of_tests_that_are_there() -> None:
    """A case that is renamed would come back to the quick set without a word."""
    for line in (
        (Path(__file__).parent / "repeated_cases.txt").read_text(encoding="utf-8").splitlines()
    ):
        if line.startswith("#"):
            continue
        path, name = line.split("[")[0].split("::")
        assert f"def {name}(" in (Path(__file__).parents[1] / path).read_text(encoding="utf-8"), (
            line
        )
