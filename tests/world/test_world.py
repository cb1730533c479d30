"""The simulated world: one seed is one run, and each day that once broke a promise holds."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from world.plan import FAULTS_END_S, Day, Event, draw_day
from world.run import run_day

# The world cuts and removes open files, which Windows refuses.
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="open files are cut and removed")
FOUND = sorted((Path(__file__).parent / "found").glob("*.json"))
# End of the faults of a short day, s.
SHORT_S = 25.0


@pytest.mark.exam
def test_one_seed_is_one_run_to_the_last_byte() -> None:
    first, again = (run_day(draw_day(1, ("cut",), SHORT_S)) for _ in range(2))
    assert first.broken == "" and first.parts > 1
    assert first.digests == again.digests


@pytest.mark.parametrize("seed", [2, 3])
def test_a_short_day_holds(seed: int) -> None:
    assert run_day(draw_day(seed, faults_end_s=SHORT_S)).broken == ""


@pytest.mark.parametrize("path", FOUND, ids=lambda path: path.stem)
def test_a_day_that_once_broke_a_promise_holds(path: Path) -> None:
    assert run_day(Day.from_json(path.read_text(encoding="utf-8"))).broken == ""


@pytest.mark.exam
@pytest.mark.parametrize("seed", range(15))
def test_many_days_hold(seed: int) -> None:
    """A minute of a processor; `python -m benchmarks world --minutes 10` runs more."""
    assert run_day(draw_day(seed)).broken == ""


def test_a_day_is_read_as_it_was_written() -> None:
    day = draw_day(3, ("lie:wheel_times", "farm:sections"))
    assert Day.from_json(day.to_json()) == day
    assert day.farm == "sections" and any(one.kind == "lie" for one in day.events)


def test_events_after_the_end_of_all_faults_are_left_out() -> None:
    assert all(isinstance(one, Event) and one.at_s < FAULTS_END_S for one in draw_day(5).events)
