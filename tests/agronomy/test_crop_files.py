"""Crop files: what is shipped is sound, and what must not be mixed cannot be."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.nitrogen_rate import make_rate_table, prepare_rule
from topdress.control.agronomy.reference_strips import StripMean
from topdress.control.agronomy.yield_potential import PUBLISHED_YIELD_CURVES, YieldPotential
from topdress.control.field.job import Job, make_rule
from topdress.drivers.files.config_error import ConfigError
from topdress.drivers.files.farm_lines import RECORD_COLUMNS
from topdress.drivers.files.run_setup import Setup, load_setup

from tests.command import topdress

CROPS = Path(__file__).parents[2] / "configs" / "crops"
NAMES = sorted(path.stem for path in CROPS.glob("*.yaml"))


def message(data: dict) -> str:
    with pytest.raises(ValidationError) as caught:
        Crop.model_validate(data)
    return "; ".join(error["msg"] for error in caught.value.errors())


def test_every_published_set_has_a_crop_file(crop_data):
    used = {Crop.model_validate(crop_data(name)).yield_potential.set for name in NAMES}
    assert used == set(PUBLISHED_YIELD_CURVES)


@pytest.mark.parametrize("name", NAMES)
def test_shipped_crop_works_at_once(name, crop_data):
    crop = Crop.model_validate(crop_data(name))
    rates = [line.rate_kg_ha for line in make_rate_table(crop)]
    assert crop.id == name
    assert max(rates) < crop.max_rate_kg_ha  # the limit is a limit, not the agronomy
    assert max(rates) > 35.0
    if crop.grades:
        assert len(rates) == 10 and rates[-1] == 0.0, (
            "the paper's own: nothing is needed at NDVI 0.75"
        )
    else:
        assert len(rates) == 15 and crop.ndvi_max is None, "Oklahoma State's table has no upper end"
        greener = crop.model_copy(update={"yield_ceiling": "y_max"})
        assert prepare_rule(greener).decide_rate(0.76).rate_kg_ha > 0.0
        assert (prepare_rule(crop).decide_rate(0.76).rate_kg_ha == 0.0) == (
            "winter_wheat" in name
        ), "greener than the strip"
        assert rates[4] == pytest.approx(crop.fallback_rate_kg_ha, rel=0.5), (
            "a rate of this file's own order"
        )
    # a shipped file is of nobody's field, and says so
    assert crop.examples
    assert any("example values" in line for line in crop.warnings)


@pytest.mark.parametrize("name", NAMES)
def test_resolved_crop_reads_back_the_same(name, crop_data):
    crop = Crop.model_validate(crop_data(name))
    assert Crop.model_validate(crop.model_dump(mode="json")) == crop


@pytest.mark.parametrize(
    ("name", "base_c"),
    [
        ("huanghai_2015", 0.0),
        ("osu_winter_wheat_2004", 4.4),
        ("osu_winter_wheat_2007", 4.4),
        ("osu_durum_2006", 4.4),
        ("osu_corn_2004", "every_day"),
    ],
)
def test_a_set_brings_its_day_rule(name, base_c):
    """Constants and lines themselves: test_response."""
    assert YieldPotential.model_validate({"set": name}).base_temp_c == base_c


def test_the_line_of_another_row_is_refused(crop_data):
    wheat = crop_data("osu_winter_wheat_2007")
    assert "has slope 1.69, intercept -0.7" in message(
        wheat | {"harvest_line": {"slope": 1.64, "intercept": -0.5287}}
    )
    older = crop_data("osu_winter_wheat_2004")
    assert "has none" in message(older | {"harvest_line": {"slope": 1.69, "intercept": -0.70}})
    same = Crop.model_validate(wheat | {"harvest_line": {"slope": 1.69, "intercept": -0.70}})
    assert same.response_line == Crop.model_validate(wheat).response_line
    plain = Crop.model_validate(wheat | {"harvest_line": {"slope": 1.0, "intercept": 0.0}})
    assert any("canopy's own response index counts" in line for line in plain.warnings)
    assert not any("response index" in line for line in Crop.model_validate(wheat).warnings)


def test_days_of_corn_are_all_days(crop_data):
    corn = crop_data("osu_corn_2004")
    assert Crop.model_validate(corn | {"days": {"sown": "2026-04-20"}}).days.count is None
    assert "leave the key out" in message(corn | {"days": {"count": 50, "above_c": 4.4}})
    assert "needs no weather" in message(
        corn | {"days": {"weather": "w.csv", "sown": "2026-04-20"}}
    )
    wheat = crop_data("osu_winter_wheat_2007")
    assert "which a weather file tells" in message(wheat | {"days": {"sown": "2025-10-01"}})


def sufficient(crop_data, **changes):
    return (
        {
            key: value
            for key, value in crop_data("osu_winter_wheat_2007").items()
            if key
            not in (
                "yield_potential",
                "days",
                "y_max_t_ha",
                "response_index",
                "yield_ceiling",
                "growth_window",
            )
        }
        | {
            "id": "leafy",
            "index": "ndre",
            "ndvi_min": 0.1,
            "ndvi_nrich": 0.40,
            "examples": [],
            "sufficiency": {
                "n_opt_kg_ha": 150.0,
                "delta_si": 0.3,
                "source": "made up for this test",
            },
        }
        | changes
    )


def test_the_sufficiency_index(crop_data):
    """150 sqrt((1 - SI) / 0.3) kg N/ha: SI 1 nothing, 0.925 half, 0.7 and below all of it; urea
    of 45 % N."""
    rule = prepare_rule(Crop.model_validate(sufficient(crop_data)))
    for reading, share in ((0.42, 0.0), (0.40, 0.0), (0.37, 0.5), (0.28, 1.0), (0.20, 1.0)):
        decision = rule.decide_rate(reading)
        assert decision.rate_kg_ha == pytest.approx(150.0 / 0.45 * share, abs=1e-6), reading
        assert decision.sufficiency_index == pytest.approx(reading / 0.40)
    waiting = prepare_rule(Crop.model_validate(sufficient(crop_data, ndvi_nrich=None)))
    assert not waiting.is_ready and waiting.decide_rate(0.3).why == "no_strips"
    assert waiting.replace_strip(StripMean("nrich", 0.40)).decide_rate(
        0.37
    ).rate_kg_ha == pytest.approx(75.0 / 0.45)
    with pytest.raises(ValueError, match="goes with yield_potential, not with sufficiency"):
        prepare_rule(Crop.model_validate(sufficient(crop_data)), response_rule="field")


def test_check_tells_of_a_strip_that_is_missing(crop_data, tmp_path):
    for strip, said in ((0.40, False), (None, True)):
        (tmp_path / "leafy.yaml").write_text(
            yaml.safe_dump(sufficient(crop_data, ndvi_nrich=strip))
        )
        (tmp_path / "job.yaml").write_text(
            "format: topdress-job/1\ncrop: leafy.yaml\nsimulated: {heads_index: ndre}\n"
        )
        result = topdress("check", tmp_path / "leafy.yaml", tmp_path / "job.yaml")
        assert result.exit_code == 0 and ("N-rich strip missing" in result.output) == said, (
            result.output
        )


def test_days_since_sowing(crop_data, tmp_path):
    """Corn sown 55 days before: the same rate as with the count; of the day of work where
    nothing else is said."""
    (tmp_path / "corn.yaml").write_text(
        yaml.safe_dump(crop_data("osu_corn_2004") | {"days": {"sown": "2026-04-20"}})
    )
    (tmp_path / "job.yaml").write_text("format: topdress-job/1\ncrop: corn.yaml\n")
    setup = load_setup("huanghai", tmp_path / "job.yaml", dt.date(2026, 6, 14))
    assert setup.rule.days == 55 and setup.weather is None
    assert (
        setup.rule.decide_rate(0.68).rate_kg_ha
        == prepare_rule(Crop.model_validate(crop_data("osu_corn_2004")))
        .decide_rate(0.68)
        .rate_kg_ha
    )
    with pytest.raises(ConfigError, match="is not after sown"):
        load_setup("huanghai", tmp_path / "job.yaml", dt.date(2026, 4, 20))


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"sufficiency": {"n_opt_kg_ha": 150.0, "delta_si": 0.3}}, "Field required"),
        (
            {"sufficiency": {"n_opt_kg_ha": 150.0, "delta_si": 0.0, "source": "nobody at all"}},
            "greater than 0.01",
        ),
        ({"y_max_t_ha": 7.0}, "y_max_t_ha: goes with yield_potential"),
        ({"response_index": "field"}, "goes with yield_potential"),
        ({"yield_ceiling": "nrich"}, "yield_ceiling: nrich: goes with yield_potential"),
        ({"sufficiency": None}, "yield_potential, days, y_max_t_ha missing"),
        ({"ndvi_min": ...}, "its default, 0.25, is one of NDVI"),
    ],
)
def test_what_the_sufficiency_index_needs(change, part, crop_data):
    data = {
        key: value for key, value in sufficient(crop_data, **change).items() if value is not ...
    }
    assert part in message(data)


def test_constants_of_one_set_with_the_day_rule_of_another_are_refused(crop_data):
    data = crop_data("osu_winter_wheat_2004")
    data["yield_potential"] = {"set": "osu_winter_wheat_2004", "base_temp_c": 0.0}
    assert "contradicts set osu_winter_wheat_2004" in message(data)
    data["yield_potential"] = {"set": "osu_winter_wheat_2005", "a_t_ha": 0.359}
    assert "contradicts set" in message(data)
    data["yield_potential"] = {
        "a_t_ha": 0.359,
        "b_days": 324.4,
        "base_temp_c": 0.0,
        "source": "my own reading",
    }
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


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"efficiency": 0.8}, "less than or equal to 0.7"),
        ({"efficiency": 0.4}, "greater than or equal to 0.5"),
        ({"y_max_t_ha": None}, "y_max_t_ha missing"),
        ({"ndvi_max": None}, "grades need an upper end"),
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
        (
            {"days": {"weather": "w.csv", "sown": "2014-03-07", "sensed": "2013-11-01"}},
            "not after sown",
        ),
    ],
)
def test_refusals_say_what_is_allowed(change, part, crop_data):
    assert part in message(crop_data("huanghai_wheat") | change)


def test_y_max_is_mandatory(crop_data):
    data = crop_data("huanghai_wheat")
    del data["y_max_t_ha"]
    with pytest.raises(ValidationError, match="y_max_t_ha"):
        Crop.model_validate(data)


# --- What bounds a rule's nitrogen: the strip's own yield, a lowest rate, what was given and is
# credited, the year.

DAY = dt.date(2026, 3, 10)
WHEAT = yaml.safe_load((CROPS / "osu_winter_wheat_2007.yaml").read_text(encoding="utf-8"))
# 2 ha
FIELD = {
    "title": "Long acre",
    "boundary_m": [[0.0, 0.0], [0.0, 200.0], [100.0, 200.0], [100.0, 0.0]],
}


def wheat(**keys: object) -> Crop:
    return Crop.model_validate(WHEAT | keys)


@pytest.mark.parametrize(
    ("ndvi", "before", "now"),
    [
        (0.40, 72.9, 72.9),
        (0.50, 94.4, 89.8),
        (0.64, 135.5, 7.1),
        (0.65, 139.0, 0.0),
        (0.80, 204.8, 0.0),
    ],
)
def test_no_place_gets_more_than_to_the_strips_own_yield(ndvi, before, now):
    """The strip reads 0.65. A file that says nothing goes on as it did."""
    old = wheat(yield_ceiling="y_max")
    assert (
        "yield_ceiling"
        not in Crop.model_validate(
            {k: v for k, v in WHEAT.items() if k != "yield_ceiling"}
        ).model_fields_set
    )
    assert prepare_rule(old).decide_rate(ndvi).rate_kg_ha == pytest.approx(before, abs=0.05)
    assert prepare_rule(wheat()).decide_rate(ndvi).rate_kg_ha == pytest.approx(now, abs=0.05)


@given(st.floats(0.0, 1.0), st.floats(0.0, 400.0), st.floats(0.0, 200.0), st.floats(0.0, 2.0))
def test_a_lowest_rate_holds_on_crop_alone(ndvi, least, credit, factor):
    """Nothing on bare soil and in a zone of 0; else at least so much, at most the limit,
    whatever is credited."""
    rule = prepare_rule(wheat(min_rate_kg_ha=least, taper_ndvi=0.0), n_credit_kg_ha=credit)
    rate = rule.decide_rate(ndvi, factor).rate_kg_ha
    on_crop = ndvi >= rule.crop.ndvi_min and factor > 0.0
    assert (least <= rate <= rule.crop.max_rate_kg_ha) if on_crop else rate == 0.0


def test_what_is_credited_and_what_was_given_comes_off():
    """By a yield curve the canopy shows what was given: only what it does not show yet comes
    off. 18 kg N: 40 urea."""
    plain, given_n, credited = (
        prepare_rule(wheat(), n_given_kg_ha=a, n_credit_kg_ha=b).decide_rate(0.5).rate_kg_ha
        for a, b in ((0.0, 0.0), (60.0, 0.0), (0.0, 18.0))
    )
    assert given_n == plain and credited == pytest.approx(plain - 40.0)
    keys = {
        k: v
        for k, v in WHEAT.items()
        if k
        not in (
            "yield_potential",
            "days",
            "y_max_t_ha",
            "response_index",
            "yield_ceiling",
            "growth_window",
        )
    }
    sufficient = Crop.model_validate(
        keys
        | {
            "examples": [],
            "sufficiency": {
                "n_opt_kg_ha": 150.0,
                "delta_si": 0.3,
                "source": "made up for this test",
            },
        }
    )
    job = Job.model_validate({"nitrogen": {"given_kg_ha": 40.0, "credit_kg_ha": 20.0}})
    decide = make_rule(sufficient, job).decide_rate
    assert decide(0.65 * 0.7).rate_kg_ha == pytest.approx(90.0 / 0.45)
    assert decide(0.65 * 0.7, 0.8).rate_kg_ha == pytest.approx((150.0 * 0.8 - 60.0) / 0.45)
    assert decide(0.65 * 0.7, 0.3).rate_kg_ha == 0.0


def written(folder: Path, rows: list[dict[str, str]], **nitrogen: object) -> Path:
    if rows:
        lines = [
            ",".join(RECORD_COLUMNS),
            *(",".join(row.get(name, "") for name in RECORD_COLUMNS) for row in rows),
        ]
        (folder / "farm.csv").write_text("\n".join(lines) + "\n")
        nitrogen = {"record": "farm.csv", **nitrogen}
    path = folder / "job.yaml"
    path.write_text(
        yaml.safe_dump(
            {
                "format": "topdress-job/1",
                "id": "acre",
                "farm": "Hill",
                "field": FIELD,
                "nitrogen": nitrogen,
            }
        )
    )
    return path


ROW = {
    "date": "2026-02-20",
    "field": "long acre",
    "farm": "Hill",
    "nitrogen_kg": "100.0",
    "log": "a.csv",
}


def test_a_ceiling_of_the_year_counts_what_earlier_records_gave(tmp_path):
    """2 ha: 100 kg N are 50 kg/ha. Another field, farm, year and a simulated pass count
    nothing, no date counts."""
    rows = [
        ROW,
        ROW | {"field": "Short acre"},
        ROW | {"field": ""},
        ROW | {"farm": "Dale"},
        ROW | {"date": "2025-11-20"},
        ROW | {"simulated": "yes"},
        ROW | {"date": "", "nitrogen_kg": "20.0", "log": "b.csv"},
    ]
    setup = load_setup(
        "huanghai", written(tmp_path, rows, year_max_kg_ha=170.0, given_kg_ha=60.0), DAY
    )
    assert setup.n_year is not None and setup.n_year.passes == 2
    assert setup.n_year.left_kg_ha == pytest.approx(170.0 - 60.0 - 60.0)
    most = 50.0 / 0.45
    assert (setup.crop.max_rate_kg_ha, setup.crop.fallback_rate_kg_ha) == pytest.approx(
        (most, most)
    )
    assert max(setup.rule.decide_rate(k / 100.0).rate_kg_ha for k in range(100)) == pytest.approx(
        most
    )
    later = load_setup(
        "huanghai", written(tmp_path, rows, year_max_kg_ha=170.0, year_from="2025-09-01"), DAY
    )
    assert later.n_year is not None and later.n_year.earlier_kg_ha == pytest.approx(110.0)
    own = load_setup(
        "huanghai", written(tmp_path, rows, year_max_kg_ha=170.0), DAY, lambda job: ["a.csv"]
    )
    assert own.n_year is not None and own.n_year.earlier_kg_ha == pytest.approx(10.0), (
        "its ground is done"
    )


def test_a_high_ceiling_changes_nothing(tmp_path):
    setup: Setup = load_setup("huanghai", written(tmp_path, [], year_max_kg_ha=400.0), DAY)
    assert setup.crop == load_setup("huanghai", "demo", DAY).crop


@pytest.mark.parametrize(
    ("rows", "nitrogen", "said"),
    [
        (
            [ROW | {"nitrogen_kg": "400.0"}],
            {"year_max_kg_ha": 170.0},
            "nothing may be given any more in this year",
        ),
        (
            [],
            {"year_max_kg_ha": 170.0, "given_kg_ha": 170.0},
            "nothing may be given any more in this year",
        ),
        (
            [ROW | {"nitrogen_kg": "much"}],
            {"year_max_kg_ha": 170.0},
            "line 2: nitrogen_kg 'much': allowed is a number",
        ),
        ([ROW | {"nitrogen_kg": "-5"}], {"year_max_kg_ha": 170.0}, "allowed is a number from 0"),
        (
            [],
            {"year_max_kg_ha": 170.0, "record": "none.csv"},
            "is not there: allowed is a farm record",
        ),
        ([], {"record": "farm.csv"}, "goes with year_max_kg_ha"),
    ],
    ids=["by_passes", "by_hand", "no_number", "below_0", "no_record", "no_ceiling"],
)
def test_what_a_ceiling_refuses(rows, nitrogen, said, tmp_path):
    """In one line, by check as by a start."""
    path = written(tmp_path, rows, **nitrogen)
    with pytest.raises(ConfigError, match=said):
        load_setup("huanghai", path, DAY)
    checked = topdress("check", path)
    assert checked.exit_code != 0 and said in checked.output


def test_check_says_what_is_left(tmp_path):
    result = topdress("check", written(tmp_path, [], year_max_kg_ha=170.0, given_kg_ha=60.0))
    assert (
        result.exit_code == 0
        and "110.0 kg N/ha left, at most 244.4 kg/ha of product" in result.output
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"no_double": False}, "which no place may pass twice"),
        ({"target": {"source": "point", "plants": "rows.csv"}}, "a dose a plant has none"),
    ],
)
def test_a_ceiling_needs_rates_and_no_place_twice(change, said):
    with pytest.raises(ValueError, match=said):
        Job.model_validate({"nitrogen": {"year_max_kg_ha": 170.0}} | change)
