"""What the owner of machines is told of a course: where it was repaired, whether it wears, what it is at a time."""
from __future__ import annotations

import math

import pytest

from control.diagnosis.season.courses import Course, Piece
from control.diagnosis.season.owner import REPAIR_SHARE, WEAR_P, at, repaired_d, wears


def piece(begin_d: float, end_d: float, begin: float, end: float, *, half: float = 0.1,
          per_day_p: float = 1.0) -> Piece:
    return Piece(begin_d, end_d, begin, end, half, half, (end - begin) / (end_d - begin_d), per_day_p)


def course(*pieces: Piece) -> Course:
    return Course("m01", "flow.gain", 30.0, (), (), (), pieces, 0.0, 0.1, 0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_jump_towards_zero_by_more_than_both_intervals_is_a_repair(sign: float) -> None:
    worn = piece(0.0, 30.0, 0.0, sign * 1.0, half=0.3)
    assert repaired_d(course(worn, piece(34.0, 60.0, sign * 0.39, sign * 0.39, half=0.3))) == [32.0]
    assert repaired_d(course(worn, piece(34.0, 60.0, sign * 0.41, sign * 0.41, half=0.3))) == [], "0.59 of 0.3 + 0.3"


def test_a_little_less_or_more_is_no_repair() -> None:
    worn = piece(0.0, 30.0, 0.0, 10.0, half=0.01)
    left = (1.0 - REPAIR_SHARE) * 10.0
    assert repaired_d(course(worn, piece(34.0, 60.0, left - 0.1, 0.0, half=0.01))) == [32.0]
    assert repaired_d(course(worn, piece(34.0, 60.0, left + 0.1, 0.0, half=0.01))) == []
    assert repaired_d(course(worn, piece(34.0, 60.0, 12.0, 12.0, half=0.01))) == [], "away from zero"
    assert repaired_d(course(worn, piece(34.0, 60.0, -9.0, -9.0, half=0.01))) == [], "as wrong the other way"


def test_it_wears_where_its_last_piece_surely_grows_away_from_zero() -> None:
    sure, unsure = 0.5 * WEAR_P, 2.0 * WEAR_P
    assert wears(course(piece(0.0, 10.0, 1.0, 2.0, per_day_p=sure)))
    assert wears(course(piece(0.0, 10.0, -1.0, -2.0, per_day_p=sure)))
    assert not wears(course(piece(0.0, 10.0, 1.0, 2.0, per_day_p=unsure)))
    assert not wears(course(piece(0.0, 10.0, 2.0, 1.0, per_day_p=sure))), "it gets better"
    assert not wears(course(piece(0.0, 10.0, 1.0, 2.0, per_day_p=sure), piece(12.0, 20.0, 0.5, 0.4, per_day_p=sure)))


@pytest.mark.parametrize(("time_d", "size"), [
    (-5.0, 1.0), (0.0, 1.0), (2.5, 1.5), (10.0, 3.0), (10.5, 8.0), (12.0, 8.0), (14.0, 7.0), (16.0, 6.0), (99.0, 6.0)])
def test_a_size_at_a_time_lies_on_its_piece(time_d: float, size: float) -> None:
    """Before the first and after the last as there; between two pieces as the next begins."""
    one = course(piece(0.0, 10.0, 1.0, 3.0), piece(12.0, 16.0, 8.0, 6.0))
    assert math.isclose(at(one, time_d), size)


def test_a_piece_of_one_log_has_one_size() -> None:
    assert at(course(Piece(3.0, 3.0, 2.0, 2.0, 0.1, 0.1, 0.0, 1.0)), 7.0) == 2.0
