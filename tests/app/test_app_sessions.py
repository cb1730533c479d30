"""The twenty stories of `python -m benchmarks session`: real keys, the simulated machine, what
the ground got."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def session():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        import session

        yield session
        for name in ("session", "loss_table", "rig"):
            sys.modules.pop(name, None)


NAMES = (
    "first_pass",
    "hold_and_on",
    "stop_at_once",
    "start_from_the_map",
    "other_strategy",
    "five_percent_more",
    "taken_back",
    "preset",
    "typed_rate",
    "back_to_canopy",
    "by_the_map",
    "refill",
    "empty_hopper",
    "wheel_sticks",
    "late_on_purpose",
    "without_the_scale",
    "allowed",
    "locked",
    "round_the_pages",
    "night_and_chinese",
)


def test_all_stories_are_played_here(session):
    assert tuple(session.SESSIONS) == NAMES


@pytest.mark.exam
@pytest.mark.parametrize("name", NAMES)
async def test_a_story(session, name):
    await session.play(session.SESSIONS[name])
