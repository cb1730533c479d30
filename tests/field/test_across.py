"""What one rate across the width costs: none on an even crop, the known spread on a known one."""
from __future__ import annotations

import datetime as dt

import numpy as np
import pytest

from control.field.across import across, across_words
from drivers.files.setup import load_setup


@pytest.fixture(scope="module")
def setup():
    return load_setup("huanghai_sections", "demo", dt.date(2014, 3, 7))


def test_an_even_crop_costs_nothing(setup):
    found = across(setup.rule, setup.machine, np.full((10, 6), 0.5))
    assert found is not None and found.by_head_kg_ha == 0.0 and found.by_section_kg_ha == 0.0


def test_the_spread_is_that_of_the_need_and_a_section_evens_out_its_own_heads(setup):
    heads = np.tile([0.48, 0.52] * 3, (20, 1))
    found = across(setup.rule, setup.machine, heads)
    smooth = setup.rule.crop.model_copy(update={"grades": False})
    rule = type(setup.rule)(smooth, setup.rule.days, setup.rule.ndvi_nrich)
    low, mid, high = (rule.decide(value).rate_kg_ha for value in (0.48, 0.5, 0.52))
    wanted = np.sqrt(0.5 * ((low - mid) ** 2 + (high - mid) ** 2))
    assert found is not None and found.by_head_kg_ha == pytest.approx(wanted, rel=1e-3)
    assert found.by_section_kg_ha == pytest.approx(abs(0.5 * (low + high) - mid), abs=0.01)
    assert found.noise_kg_ha == pytest.approx(0.01 * (low - high) / 0.04, rel=0.02)
    assert "r.m.s. between the need under each head and the one rate, by section" in across_words(found)


def test_a_silent_head_is_left_out_and_one_alone_says_nothing(setup):
    some = np.array([[0.48, np.nan, 0.52, 0.5, 0.5, 0.5], [0.5] + [np.nan] * 5])
    found = across(setup.rule, setup.machine, some)
    assert found is not None and found.samples == 1
    assert across(setup.rule, setup.machine, np.full((3, 6), np.nan)) is None
