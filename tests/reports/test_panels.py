"""What is drawn is what it says: the series behind each legend entry."""
from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from console.reports.binned import Axis, binned
from console.reports.figure import drawn, svg
from console.reports.panels import EXTENDED, NOMINAL, residual_panel, smooth_line
from console.reports.run_pictures import _most_telling
from console.reports.table_pictures import table_picture
from console.reports.table_views import table_views
from control.calibration.bench_table import BenchTable
from control.diagnosis.result import Cause
from control.machine.machine import Machine

X = np.linspace(0.0, 4.0, 400)
AXIS = Axis("x", X)


def lines(axes: Any) -> dict[str, np.ndarray]:
    return {line.get_label(): np.asarray(line.get_ydata()) for line in axes.get_lines()}


def test_nominal_is_before_and_extended_is_after() -> None:
    with drawn(4.0, 3.0) as (_, grid):
        residual_panel(grid[0, 0], AXIS, binned(AXIS, X - 5.0), binned(AXIS, 0.0 * X + 0.1), "kg")
        found = lines(grid[0, 0])
    assert found[NOMINAL].min() == pytest.approx(-5.0, abs=0.2) and found[NOMINAL].max() == pytest.approx(-1.0, abs=0.2)
    assert found[EXTENDED] == pytest.approx(0.1)


def test_nothing_named_draws_nothing_extended() -> None:
    with drawn(4.0, 3.0) as (_, grid):
        residual_panel(grid[0, 0], AXIS, binned(AXIS, X), None, "kg")
        assert EXTENDED not in lines(grid[0, 0])


def test_smooth_line_follows_what_is_there() -> None:
    with drawn(4.0, 3.0) as (_, grid):
        smooth_line(grid[0, 0], X, 2.0 * np.cos(np.pi * X / 4.0))
        found = lines(grid[0, 0])["smooth function"]
    assert found == pytest.approx(2.0 * np.cos(np.pi * np.linspace(0.04, 3.96, len(found)) / 4.0), abs=0.05)


def test_stretch_is_where_the_effect_changes() -> None:
    effect = np.where((np.arange(1000) >= 600) & (np.arange(1000) < 620), 1.0, 0.2)
    assert 500 < _most_telling(effect, 100) <= 600
    assert _most_telling(np.where(np.arange(1000) < 500, 1.0, 2.0) + 0.0, 2000) == 0


def test_table_picture_shows_both_machines(bench_tables: dict[str, BenchTable], machine: Machine,
                                           cause_of: Callable[..., Cause]) -> None:
    view, = table_views([bench_tables["place"]], machine, [cause_of("place.lever_arm", 0.4)])
    picture = table_picture(view, "t")
    for words in ("before", "after", NOMINAL, EXTENDED, "measured", "miss_m, m", "residual, m"):
        assert words in picture.svg
    bare, = table_views([bench_tables["place"]], machine, [])
    assert EXTENDED not in table_picture(bare, "t").svg


def test_colours_are_the_pages_own() -> None:
    with drawn(4.0, 3.0) as (figure, grid):
        residual_panel(grid[0, 0], AXIS, binned(AXIS, X - 5.0), binned(AXIS, 0.0 * X), "kg")
        text = svg(figure, "one", "said")
    assert all(f"var(--{name})" in text for name in ("before", "after", "ink", "grid"))
    assert not re.search(r"(?:fill|stroke): #", text)
