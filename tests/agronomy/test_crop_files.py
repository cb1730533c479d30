"""Crop files: what is shipped is sound, and what must not be mixed cannot be."""
from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from control.agronomy.crop import Crop
from control.agronomy.noa import rate_table
from control.agronomy.yield_potential import YIELD_SETS, YieldPotential

CROPS = Path(__file__).parents[2] / "configs" / "crops"
NAMES = sorted(path.stem for path in CROPS.glob("*.yaml"))


def message(data: dict) -> str:
    with pytest.raises(ValidationError) as caught:
        Crop.model_validate(data)
    return "; ".join(error["msg"] for error in caught.value.errors())


def test_every_published_set_has_a_crop_file(crop_data):
    used = {Crop.model_validate(crop_data(name)).yield_potential.set for name in NAMES}
    assert used == set(YIELD_SETS)


@pytest.mark.parametrize("name", NAMES)
def test_shipped_crop_works_at_once(name, crop_data):
    crop = Crop.model_validate(crop_data(name))
    rates = [line.rate_kg_ha for line in rate_table(crop)]
    assert crop.id == name
    assert len(rates) == 10
    assert max(rates) < crop.max_rate_kg_ha          # the limit is a limit, not the agronomy
    assert max(rates) > 50.0
    assert rates[-1] == 0.0
    assert crop.examples                             # a shipped file is of nobody's field, and says so
    assert any("example values" in line for line in crop.warnings)


@pytest.mark.parametrize("name", NAMES)
def test_resolved_crop_reads_back_the_same(name, crop_data):
    crop = Crop.model_validate(crop_data(name))
    assert Crop.model_validate(crop.model_dump(mode="json")) == crop


@pytest.mark.parametrize(("name", "a_t_ha", "b_days", "base_c"), [
    ("huanghai_2015", 0.359, 324.4, 0.0),
    ("osu_winter_wheat_2004", 0.359, 324.4, 4.4),
    ("osu_winter_wheat_2005", 0.522, 274.7, 4.4),
    ("osu_winter_wheat_2006", 0.532, 270.1, 4.4),
    ("osu_winter_wheat_2007", 0.590, 258.2, 4.4),
    ("osu_durum_2006", 0.322, 211.5, 4.4),
])
def test_published_sets(name, a_t_ha, b_days, base_c):
    curve = YieldPotential.model_validate({"set": name})
    assert (curve.a_t_ha, curve.b_days, curve.base_temp_c) == (a_t_ha, b_days, base_c)
    assert len(YIELD_SETS) == 6


def test_constants_of_one_set_with_the_day_rule_of_another_are_refused(crop_data):
    data = crop_data("osu_winter_wheat_2004")
    data["yield_potential"] = {"set": "osu_winter_wheat_2004", "base_temp_c": 0.0}
    assert "contradicts set osu_winter_wheat_2004" in message(data)
    data["yield_potential"] = {"set": "osu_winter_wheat_2005", "a_t_ha": 0.359}
    assert "contradicts set" in message(data)
    data["yield_potential"] = {"a_t_ha": 0.359, "b_days": 324.4, "base_temp_c": 0.0, "source": "my own reading"}
    assert "published for days above 4.4 degC" in message(data)


def test_days_counted_over_another_base_are_refused(crop_data):
    data = crop_data("osu_winter_wheat_2004")
    data["days"]["above_c"] = 0.0
    assert "days above 4.4 degC" in message(data)


def test_the_papers_pairing_stays_in_the_papers_crop(crop_data):
    data = crop_data("huanghai_wheat") | {"id": "my_wheat"}
    assert "belongs to crop huanghai_wheat alone" in message(data)
    assert "flag missing" in message(crop_data("huanghai_wheat") | {"flag": ""})


def test_own_constants_carry_source_and_day_rule(crop_data):
    data = crop_data("osu_durum_2006")
    data["yield_potential"] = {"a_t_ha": 0.58, "b_days": 244.94}
    assert "base_temp_c, source missing" in message(data)
    data["yield_potential"] |= {"base_temp_c": 4.4, "source": "own trials, three seasons"}
    assert Crop.model_validate(data).yield_potential.a_t_ha == 0.58


def test_unknown_set_names_those_allowed(crop_data):
    data = crop_data("osu_durum_2006")
    data["yield_potential"] = {"set": "osu_barley"}
    assert "osu_barley" in message(data) and "osu_durum_2006" in message(data)


@pytest.mark.parametrize(("change", "part"), [
    ({"efficiency": 0.8}, "less than or equal to 0.7"),
    ({"efficiency": 0.4}, "greater than or equal to 0.5"),
    ({"y_max_t_ha": None}, "valid number"),
    ({"fixed_yield_t_ha": 9.0}, "at most y_max_t_ha 7.13"),
    ({"response_index_max": 2.5}, "less than or equal to 2"),
    ({"fallback_rate_kg_ha": 600.0}, "at most max_rate_kg_ha 500"),
    ({"grade_width": 0.07}, "whole part of the span"),
    ({"ndvi_min": 0.8}, "below ndvi_max"),
    ({"max_rate_kg_ha": float("nan")}, "finite number"),
    ({"examples": ["dayz"]}, "no such key"),
    ({"colour": "green"}, "Extra inputs"),
    ({"days": {"count": 0, "above_c": 0.0}}, "greater than or equal to 1"),
    ({"days": {"count": 82.5, "above_c": 0.0}}, "valid integer"),
    ({"days": {"count": 82}}, "above_c missing"),
    ({"days": {"weather": "w.csv"}}, "sown missing"),
    ({"days": {"weather": "w.csv", "count": 82, "above_c": 0.0}}, "one of count"),
    ({"days": {"weather": "w.csv", "sown": "2014-03-07", "sensed": "2013-11-01"}}, "not after sown"),
])
def test_refusals_say_what_is_allowed(change, part, crop_data):
    assert part in message(crop_data("huanghai_wheat") | change)


def test_y_max_is_mandatory(crop_data):
    data = crop_data("huanghai_wheat")
    del data["y_max_t_ha"]
    with pytest.raises(ValidationError, match="y_max_t_ha"):
        Crop.model_validate(data)
