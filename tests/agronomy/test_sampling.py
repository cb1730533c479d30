"""Evenness of a canopy, and the paper's choice of 1 Hz from its own table."""
from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from control.agronomy.sampling import (
    FREQUENCIES_HZ,
    Evenness,
    best_frequency,
    cuc_percent,
    cv_percent,
    evenness,
    frequency_table,
    subsample,
)


def test_by_hand():
    values = [0.4, 0.5, 0.6]
    assert cv_percent(values) == pytest.approx(100 * 0.1 / 0.5)
    assert cuc_percent(values) == pytest.approx(100 * (1 - 0.2 / 1.5))
    assert evenness(values).mean == pytest.approx(0.5)


def test_gaps_are_left_out_and_nothing_gives_nan():
    assert evenness([0.4, math.nan, 0.5, 0.6]) == evenness([0.4, 0.5, 0.6])
    assert math.isnan(cv_percent([0.5]))
    assert math.isnan(cuc_percent([]))
    assert math.isnan(cuc_percent([-0.1, 0.05]))
    assert evenness([]).n == 0


@settings(deadline=None)
@given(st.lists(st.floats(0.1, 0.9), min_size=2, max_size=50), st.floats(0.1, 10.0))
def test_scale_free(values, factor):
    scaled = [value * factor for value in values]
    assert cv_percent(scaled) == pytest.approx(cv_percent(values), abs=1e-9)
    assert cuc_percent(scaled) == pytest.approx(cuc_percent(values), abs=1e-9)
    assert cuc_percent(values) <= 100.0 + 1e-12


def test_subsample():
    assert list(subsample(range(9), 2.0, 0.5)) == [0, 4, 8]
    assert list(subsample(range(3), 2.0, 2.0)) == [0, 1, 2]
    for target in (3.0, 1.5, 0.0, -1.0):
        with pytest.raises(ValueError, match="allowed"):
            subsample(range(9), 2.0, target)


def test_a_column_of_table_1():
    readings = 0.5 + 0.05 * np.random.default_rng(1).standard_normal(400)
    table = frequency_table(readings)
    assert tuple(table) == FREQUENCIES_HZ
    assert [table[hz].n for hz in FREQUENCIES_HZ] == [400, 200, 100, 50, 25]
    assert table[1.0] == evenness(readings[::2])


def test_the_paper_chooses_1_hz(paper_table):
    plots: dict[str, dict[float, Evenness]] = {}
    for row in paper_table("decision_table1_sampling.csv"):
        plots.setdefault(row["plot"], {})[float(row["frequency_hz"])] = Evenness(
            0, math.nan, float(row["cv_percent"]), float(row["cuc_percent"]))
    assert len(plots) == 12
    choice = best_frequency(list(plots.values()))
    assert choice.frequency_hz == 1.0
    assert choice.departure[1.0] == pytest.approx(0.791 + 0.459, abs=0.002)
    assert choice.departure[0.5] == pytest.approx(1.099 + 0.693, abs=0.002)
    assert sorted(choice.departure, key=choice.departure.__getitem__) == [1.0, 0.5, 0.25, 0.125]


def test_a_table_of_our_own_where_the_slowest_is_as_good():
    same = Evenness(10, 0.5, 8.0, 93.0)
    other = Evenness(10, 0.5, 9.0, 93.0)
    assert best_frequency([{2.0: same, 1.0: same, 0.5: same}]).frequency_hz == 0.5
    assert best_frequency([{2.0: same, 1.0: other, 0.5: same}]).frequency_hz == 0.5
    assert best_frequency([{2.0: same, 1.0: same, 0.5: other}]).frequency_hz == 1.0
    with pytest.raises(ValueError, match="lower frequency"):
        best_frequency([{2.0: same}])
    with pytest.raises(ValueError, match="lower frequency"):
        best_frequency([])
