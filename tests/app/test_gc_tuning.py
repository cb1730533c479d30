"""What lives is set apart from sweeps, a bounded number of times."""

from __future__ import annotations

import gc

import pytest
from topdress.console.gc_tuning import MAX_FREEZES, FreezeSchedule

LIVES = 4000  # more than pytest itself makes meanwhile


class Living:
    def __init__(self):
        self.me = [self]


# a sweep through all of a session takes seconds
@pytest.fixture(scope="module", autouse=True)
def thawed():
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()
    gc.collect()
    gc.freeze()  # as tests/conftest.py left it


def test_what_lives_is_not_swept_again():
    one = FreezeSchedule(LIVES)
    lives = [Living() for _ in range(LIVES)]
    one.freeze_after_sweep()
    assert one.left == MAX_FREEZES, "before a sweep nobody knows what lives"
    gc.collect()
    assert len(gc.get_objects(generation=2)) > LIVES
    one.freeze_after_sweep()
    assert len(gc.get_objects(generation=2)) < LIVES and len(lives) == LIVES


def test_once_after_a_sweep_and_not_for_ever():
    one = FreezeSchedule(LIVES)
    kept = []
    for look in range(2 * MAX_FREEZES):
        kept.append([Living() for _ in range(LIVES)])
        gc.collect()
        one.freeze_after_sweep()
        one.freeze_after_sweep()
        assert one.left == max(0, MAX_FREEZES - 1 - look)


@pytest.mark.exam
def test_little_is_left_to_the_sweeps_of_python():
    one = FreezeSchedule(LIVES)
    gc.collect()
    one.freeze_after_sweep()
    assert one.left == MAX_FREEZES
