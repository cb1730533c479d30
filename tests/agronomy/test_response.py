"""The response index of the field (Oklahoma State), beside the paper's; tapered ends; strips as they are ordered."""
from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from control.agronomy.crop import Crop
from control.agronomy.noa import prepare, yield_without
from control.agronomy.response import HarvestLine, field_response
from control.agronomy.strips import Strips, StripValue, doubt, measured_index, read_strip


@pytest.fixture
def field_crop(crop_data) -> Crop:
    """By the field's index of the canopy alone, no strip known, hard ends."""
    return Crop.model_validate(crop_data("osu_winter_wheat_2007") | {"yield_ceiling": "y_max",
        "ndvi_nrich": None, "ndvi_check": None, "taper_ndvi": 0.0, "harvest_line": {"slope": 1.0, "intercept": 0.0}})


def test_one_index_for_the_field_whatever_the_place(field_crop):
    """N-rich 0.66 over check 0.55: RI 1.2 at every place; the paper's rule gives 0.66 over the place."""
    rule = prepare(field_crop, 100, 0.66, 0.55)
    decisions = [rule.decide(ndvi) for ndvi in (0.3, 0.45, 0.6)]
    assert [round(one.response_index, 9) for one in decisions] == [1.2, 1.2, 1.2]
    for one, ndvi in zip(decisions, (0.3, 0.45, 0.6), strict=True):
        without = yield_without(ndvi / 100, 0.590, 258.2)
        assert one.rate_kg_ha == pytest.approx(23.9 * 0.2 * without / (0.45 * 0.6))
    by_place = prepare(field_crop, 100, 0.66, 0.55, "paper")
    assert by_place.decide(0.3).response_index == 2.0 and by_place.decide(0.6).response_index == pytest.approx(1.1)


def test_the_two_rules_lean_opposite_ways(field_crop):
    """A thin place: the paper sees much to gain there, Oklahoma little yield to be had."""
    field, paper = (prepare(field_crop, 100, 0.66, 0.55, which) for which in ("field", "paper"))
    assert field.decide(0.35).rate_kg_ha < field.decide(0.6).rate_kg_ha
    assert paper.decide(0.35).rate_kg_ha > paper.decide(0.6).rate_kg_ha


def test_as_long_as_a_strip_is_missing_nothing_is_decided(field_crop, huanghai):
    for strips in ((None, None), (0.66, None), (None, 0.55)):
        rule = prepare(field_crop, 100, *strips)
        assert not rule.is_ready and rule.decide(0.5).why == "no_strips"
    rule = prepare(field_crop, 100, 0.66)
    assert rule.with_strip(StripValue("check", 0.55)).decide(0.5).response_index == pytest.approx(1.2)
    fixed = prepare(huanghai, response_rule="field")
    assert fixed.is_ready and fixed.decide(0.5) == prepare(huanghai).decide(0.5), "a fixed yield stands in"


def test_no_response_gives_nothing_and_is_doubted(field_crop):
    assert prepare(field_crop, 100, 0.5, 0.55).decide(0.5).rate_kg_ha == 0.0
    assert [doubt(Strips(*one)) for one in ((0.5, 0.55), (0.55, 0.55), (0.9, 0.301), (0.9, 0.299), (0.9, None))] == [
        "below_1", "", "", "above_3", ""]
    assert measured_index(Strips(0.9, 0.299)) > 3.0 and field_response(Strips(0.9, 0.299), 2.0, None) == 2.0


def test_the_harvest_line_is_oklahomas(field_crop, crop_data):
    crop = field_crop.model_copy(update={"harvest_line": None})
    assert prepare(crop, 100, 0.66, 0.55).decide(0.5).response_index == pytest.approx(1.69 * 1.2 - 0.70)
    older = Crop.model_validate(crop_data("osu_winter_wheat_2004"))
    assert prepare(older, 100, 0.66, 0.55).decide(0.5).response_index == pytest.approx(1.2), "its row has no line"
    with pytest.raises(ValidationError, match=r"RI 1 becomes 0\.1"):
        HarvestLine(slope=1.64, intercept=-1.54)
    with pytest.raises(ValidationError, match="goes with response_index: field"):
        Crop.model_validate(crop_data("huanghai_wheat") | {"harvest_line": {"slope": 1.0, "intercept": 0.0}})


def test_the_papers_own_crop_knows_nothing_of_it(huanghai):
    assert huanghai.response_index == "paper" and huanghai.taper_ndvi == 0.0 and huanghai.grades
    assert prepare(huanghai, ndvi_check=0.5).decide(0.511) == prepare(huanghai).decide(0.511)


def test_the_cap_is_one_of_the_canopys_index(field_crop):
    """RI_NDVI at most 2.0, then the line: Oklahoma State caps the former, and the yield."""
    lined = field_crop.model_copy(update={"harvest_line": None})
    assert prepare(lined, 100, 0.9, 0.4).decide(0.4).response_index == pytest.approx(1.69 * 2.0 - 0.70)
    assert prepare(lined, 100, 0.9, 0.4).decide(0.9).yield_with_t_ha == lined.y_max_t_ha


def test_tapered_ends(crop_data):
    tapered = prepare(Crop.model_validate(crop_data("osu_winter_wheat_2007") | {"ndvi_max": 0.75}))
    hard = prepare(tapered.crop.model_copy(update={"taper_ndvi": 0.0}))
    for ndvi, share in ((0.25, 0.0), (0.26, 0.2), (0.275, 0.5), (0.3, 1.0), (0.5, 1.0), (0.7, 1.0), (0.74, 0.2),
                        (0.75, 0.0)):
        assert tapered.decide(ndvi).rate_kg_ha == pytest.approx(share * hard.decide(ndvi).rate_kg_ha), ndvi
    assert tapered.decide(0.2499).why == "below_cutoff" and hard.decide(0.2501).rate_kg_ha > 20.0
    open_ended = prepare(Crop.model_validate(crop_data("osu_winter_wheat_2007")))
    assert open_ended.decide(0.26).rate_kg_ha == tapered.decide(0.26).rate_kg_ha
    assert open_ended.decide(0.9).why == "yield_reached" and hard.decide(0.9).why == "above_cutoff"


@settings(deadline=None)
@given(st.floats(0.0, 1.0), st.floats(-0.01, 0.01))
def test_a_tapered_rate_has_no_step(ndvi, more):
    """Neighbouring readings get neighbouring rates: at most the slope of the taper and of the curve."""
    rule = prepare(_tapered())
    assert abs(rule.decide(ndvi).rate_kg_ha - rule.decide(ndvi + more).rate_kg_ha) <= 2500.0 * abs(more) + 1e-9


def _tapered() -> Crop:
    return Crop.model_validate({
        "format": "topdress-crop/1", "id": "any", "name": "any", "yield_potential": {"set": "osu_winter_wheat_2007"},
        "days": {"count": 100, "above_c": 4.4}, "y_max_t_ha": 7.0, "ndvi_nrich": 0.65, "ndvi_check": 0.5,
        "response_index": "field", "grades": False, "taper_ndvi": 0.05, "fallback_rate_kg_ha": 50.0,
        "max_rate_kg_ha": 300.0})


@pytest.mark.parametrize(("change", "part"), [
    ({"taper_ndvi": 0.05}, "which are steps"),
    ({"taper_ndvi": 0.26, "grades": False}, "at most half of the span"),
])
def test_what_does_not_go_together_says_so(crop_data, change, part):
    with pytest.raises(ValidationError, match=part):
        Crop.model_validate(crop_data("huanghai_wheat") | change)


def test_a_file_that_says_nothing_of_grades_is_told(crop_data):
    data = crop_data("huanghai_wheat")
    del data["grades"]
    crop = Crop.model_validate(data)
    assert not crop.grades and any("grades is not said" in line for line in crop.warnings)
    assert not any("grades" in line for line in Crop.model_validate(crop_data("huanghai_wheat")).warnings)


@pytest.mark.parametrize("value", [StripValue("nrich", 0.7121, 0.0041, 38), StripValue("check", 0.55)])
def test_a_strip_is_ordered_as_it_is_logged(value):
    assert read_strip(value.text) == value


@pytest.mark.parametrize("text", [None, 0.7, "", "nrich", "rich 0.7", "nrich 0", "nrich 1.01", "nrich nan",
                                  "check -0.5", "nrich 0.7 0.01", "nrich 0.7 -0.01 5", "nrich 0.7 inf 5",
                                  "nrich 0.7 0.1 -1", "nrich x"])
def test_what_is_no_strip(text):
    assert read_strip(text) is None


def test_values_stay_finite():
    assert math.isfinite(field_response(Strips(1.0, 1e-6), 2.0, HarvestLine(slope=1.64, intercept=-0.53)) or math.nan)
