"""A clock of which no date can be made costs no start and no tick."""

from __future__ import annotations

import datetime as dt
import re
import subprocess
import sys
from pathlib import Path

import pytest
from topdress.drivers import day_clock

ROOT = Path(__file__).parents[2]
ROOMS = ("console", "control", "drivers")
ASKED_ELSEWHERE = re.compile(
    r"datetime\.now\(|date\.today\(|\btime\.time\(|\btime_ns\(|fromtimestamp\(|\.localtime\("
)
YEAR_7000_S = 158_740_000_000.0


def raises() -> float:
    """As Python says it of any clock after 2262."""
    raise OverflowError("timestamp too large to convert to C _PyTime_t")


@pytest.fixture
def clock_is(monkeypatch):
    return lambda asked: monkeypatch.setattr(day_clock, "_read_epoch_s", asked)


@pytest.mark.parametrize(
    "asked",
    [raises, lambda: 400e9, lambda: -1e15, lambda: float("nan")],
    ids=["after 2262", "after 9999", "before the year 1", "no number"],
)
def test_what_no_date_can_be_made_of_is_a_clock_that_is_not_set(clock_is, asked):
    clock_is(asked)
    assert (
        day_clock.read_utc_now() == day_clock.DATE_OF_UNSET_CLOCK
        and day_clock.read_today() == dt.date(1970, 1, 1)
    )
    assert day_clock.read_local_now().year == 1970 and day_clock.read_utc_now().tzinfo is dt.UTC


def test_what_can_be_said_is_said(clock_is):
    for epoch_s, year in ((-1.2e9, 1931), (1.79e9, 2026), (YEAR_7000_S, 7000)):
        clock_is(lambda epoch_s=epoch_s: epoch_s)
        assert (
            day_clock.read_utc_now().year == day_clock.read_today().year == year
            and day_clock.is_clock_set()
        )
    assert (
        day_clock.format_file_time(1.79e9).startswith("2026-")
        and day_clock.format_file_time(1e15) == ""
    )
    assert (
        day_clock.convert_to_utc(YEAR_7000_S).year == 7000
        and day_clock.convert_to_utc(1e15) == day_clock.DATE_OF_UNSET_CLOCK
    )


def test_nobody_else_asks_the_clock():
    """One that asks by himself raises where this one does not."""
    asked = {
        path.relative_to(ROOT).as_posix()
        for room in ROOMS
        for path in (ROOT / room).rglob("*.py")
        if ASKED_ELSEWHERE.search(path.read_text(encoding="utf-8"))
    }
    assert asked == {"drivers/day_clock.py"}


@pytest.mark.parametrize(
    "words",
    [
        [
            "-c",
            "from topdress.console.cli import main; main()",
            "simulate",
            "--seconds",
            "5",
            "--out",
            "run.csv",
        ],
        [
            "-c",
            "import topdress.console.app.app, topdress.console.serve.server; "
            "import topdress.console.worker.assemble; from "
            "drivers import day_clock; "
            "print(day_clock.read_utc_now())",
        ],
    ],
    ids=["simulate", "console and worker"],
)
def test_a_program_starts_whatever_the_clock_says(tmp_path, words):
    """The interpreter's own clock raises here as in the year 7000: libraries ask it while they
    are loaded."""
    (tmp_path / "sitecustomize.py").write_text(
        "import time\n\ndef _raises():\n    raise OverflowError('timestamp too large to "
        "convert to C _PyTime_t')\n\n"
        "time.time = _raises\n"
    )
    done = subprocess.run(
        [sys.executable, *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        env={"PYTHONPATH": f"{tmp_path}:{ROOT}", "HOME": str(tmp_path), "PATH": ""},
        timeout=120,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert "Traceback" not in done.stderr
