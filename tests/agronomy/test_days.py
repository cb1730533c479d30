"""Growing days: the count, and what is refused rather than guessed."""
from __future__ import annotations

import datetime as dt

import numpy as np
import pytest

from control.agronomy.days import days_above_base

SOWN, SENSED = dt.date(2013, 11, 1), dt.date(2014, 3, 7)


def season(temps: list[float], start: str = "2013-11-01") -> tuple[np.ndarray, np.ndarray]:
    return np.datetime64(start) + np.arange(len(temps)), np.array(temps, dtype=float)


def test_counts_days_strictly_above_the_base():
    dates, temps = season([5.0, 4.4, 4.41, -1.0, 9.0])
    assert days_above_base(dates, temps, SOWN, dt.date(2013, 11, 6), 4.4) == 3
    assert days_above_base(dates, temps, SOWN, dt.date(2013, 11, 6), 0.0) == 4


def test_sowing_day_counts_sensing_day_does_not():
    dates, temps = season([10.0] * 10)
    assert days_above_base(dates, temps, dt.date(2013, 11, 3), dt.date(2013, 11, 7), 0.0) == 4


def test_the_papers_season_has_82_days():
    """126 days from 1 November to 7 March; a made-up winter with 44 of them at or below zero."""
    dates, temps = season([3.0] * 60 + [-2.0] * 44 + [5.0] * 40)
    assert days_above_base(dates, temps, SOWN, SENSED, 0.0) == 82


def test_order_does_not_matter():
    dates, temps = season([5.0, -1.0, 7.0, -3.0])
    shuffled = np.array([2, 0, 3, 1])
    assert days_above_base(dates[shuffled], temps[shuffled], SOWN, dt.date(2013, 11, 5), 0.0) == 2


@pytest.mark.parametrize(("temps", "part"), [
    ([5.0, 5.0], "no mean temperature for 2 of the 4 days from 2013-11-01 to 2013-11-05, the first is 2013-11-03"),
    ([5.0, float("nan"), 5.0, 5.0], "for 1 of the 4 days from 2013-11-01 to 2013-11-05, the first is 2013-11-02"),
    ([-5.0] * 4, "no day .* above 0 degC"),
])
def test_what_is_not_known_is_not_guessed(temps, part):
    dates, values = season(temps)
    with pytest.raises(ValueError, match=part):
        days_above_base(dates, values, SOWN, dt.date(2013, 11, 5), 0.0)


def test_doubled_date_and_backward_span_are_refused():
    dates, temps = season([5.0] * 4)
    dates[2] = dates[1]
    with pytest.raises(ValueError, match="2013-11-02 stands twice"):
        days_above_base(dates, temps, SOWN, dt.date(2013, 11, 5), 0.0)
    with pytest.raises(ValueError, match="not after sown"):
        days_above_base(dates, temps, SENSED, SOWN, 0.0)
    with pytest.raises(ValueError, match="4 dates but 3"):
        days_above_base(dates, temps[:3], SOWN, SENSED, 0.0)
