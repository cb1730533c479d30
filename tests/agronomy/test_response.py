"""The response index of the field (Oklahoma State), beside the paper's; tapered ends; strips as
they are ordered."""

from __future__ import annotations

import math
import random
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.nitrogen_rate import calc_yield_without_t_ha, prepare_rule
from topdress.control.agronomy.nitrogen_response import HarvestLine, calc_field_response
from topdress.control.agronomy.reference_strips import (
    ReferenceStrips,
    StripMean,
    calc_measured_index,
    find_index_doubt,
    parse_strip,
)
from topdress.control.field.job import Job, make_rule
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import CROP_KIND


@pytest.fixture
def field_crop(crop_data) -> Crop:
    """By the field's index of the canopy alone, no strip known, hard ends."""
    return Crop.model_validate(
        crop_data("osu_winter_wheat_2007")
        | {
            "yield_ceiling": "y_max",
            "ndvi_nrich": None,
            "ndvi_check": None,
            "taper_ndvi": 0.0,
            "harvest_line": {"slope": 1.0, "intercept": 0.0},
        }
    )


def test_one_index_for_the_field_whatever_the_place(field_crop):
    """N-rich 0.66 over check 0.55: RI 1.2 at every place; the paper's rule gives 0.66 over the
    place."""
    rule = prepare_rule(field_crop, 100, 0.66, 0.55)
    decisions = [rule.decide_rate(ndvi) for ndvi in (0.3, 0.45, 0.6)]
    assert [round(one.response_index, 9) for one in decisions] == [1.2, 1.2, 1.2]
    for one, ndvi in zip(decisions, (0.3, 0.45, 0.6), strict=True):
        without = calc_yield_without_t_ha(ndvi / 100, 0.590, 258.2)
        assert one.rate_kg_ha == pytest.approx(23.9 * 0.2 * without / (0.45 * 0.6))
    by_place = prepare_rule(field_crop, 100, 0.66, 0.55, "paper")
    assert by_place.decide_rate(0.3).response_index == 2.0 and by_place.decide_rate(
        0.6
    ).response_index == pytest.approx(1.1)


def test_the_two_rules_lean_opposite_ways(field_crop):
    """A thin place: the paper sees much to gain there, Oklahoma little yield to be had."""
    field, paper = (
        prepare_rule(field_crop, 100, 0.66, 0.55, which) for which in ("field", "paper")
    )
    assert field.decide_rate(0.35).rate_kg_ha < field.decide_rate(0.6).rate_kg_ha
    assert paper.decide_rate(0.35).rate_kg_ha > paper.decide_rate(0.6).rate_kg_ha


def test_as_long_as_a_strip_is_missing_nothing_is_decided(field_crop, huanghai):
    for strips in ((None, None), (0.66, None), (None, 0.55)):
        rule = prepare_rule(field_crop, 100, *strips)
        assert not rule.is_ready and rule.decide_rate(0.5).why == "no_strips"
    rule = prepare_rule(field_crop, 100, 0.66)
    assert rule.replace_strip(StripMean("check", 0.55)).decide_rate(
        0.5
    ).response_index == pytest.approx(1.2)
    fixed = prepare_rule(huanghai, response_rule="field")
    assert fixed.is_ready and fixed.decide_rate(0.5) == prepare_rule(huanghai).decide_rate(0.5), (
        "a fixed yield stands in"
    )


def test_no_response_gives_nothing_and_is_doubted(field_crop):
    assert prepare_rule(field_crop, 100, 0.5, 0.55).decide_rate(0.5).rate_kg_ha == 0.0
    assert [
        find_index_doubt(ReferenceStrips(*one))
        for one in ((0.5, 0.55), (0.55, 0.55), (0.9, 0.301), (0.9, 0.299), (0.9, None))
    ] == ["below_1", "", "", "above_3", ""]
    assert (
        calc_measured_index(ReferenceStrips(0.9, 0.299)) > 3.0
        and calc_field_response(ReferenceStrips(0.9, 0.299), 2.0, None) == 2.0
    )


def test_the_harvest_line_is_oklahomas(field_crop, crop_data):
    crop = field_crop.model_copy(update={"harvest_line": None})
    assert prepare_rule(crop, 100, 0.66, 0.55).decide_rate(0.5).response_index == pytest.approx(
        1.69 * 1.2 - 0.70
    )
    older = Crop.model_validate(crop_data("osu_winter_wheat_2004"))
    assert prepare_rule(older, 100, 0.66, 0.55).decide_rate(0.5).response_index == pytest.approx(
        1.2
    ), "its row has no line"
    with pytest.raises(ValidationError, match=r"RI 1 becomes 0\.1"):
        HarvestLine(slope=1.64, intercept=-1.54)
    with pytest.raises(ValidationError, match="goes with response_index: field"):
        Crop.model_validate(
            crop_data("huanghai_wheat") | {"harvest_line": {"slope": 1.0, "intercept": 0.0}}
        )


def test_the_papers_own_crop_knows_nothing_of_it(huanghai):
    assert huanghai.response_index == "paper" and huanghai.taper_ndvi == 0.0 and huanghai.grades
    assert prepare_rule(huanghai, ndvi_check=0.5).decide_rate(0.511) == prepare_rule(
        huanghai
    ).decide_rate(0.511)


def test_the_cap_is_one_of_the_canopys_index(field_crop):
    """RI_NDVI at most 2.0, then the line: Oklahoma State caps the former, and the yield."""
    lined = field_crop.model_copy(update={"harvest_line": None})
    assert prepare_rule(lined, 100, 0.9, 0.4).decide_rate(0.4).response_index == pytest.approx(
        1.69 * 2.0 - 0.70
    )
    assert prepare_rule(lined, 100, 0.9, 0.4).decide_rate(0.9).yield_with_t_ha == lined.y_max_t_ha


def test_tapered_ends(crop_data):
    tapered = prepare_rule(
        Crop.model_validate(crop_data("osu_winter_wheat_2007") | {"ndvi_max": 0.75})
    )
    hard = prepare_rule(tapered.crop.model_copy(update={"taper_ndvi": 0.0}))
    for ndvi, share in (
        (0.25, 0.0),
        (0.26, 0.2),
        (0.275, 0.5),
        (0.3, 1.0),
        (0.5, 1.0),
        (0.7, 1.0),
        (0.74, 0.2),
        (0.75, 0.0),
    ):
        assert tapered.decide_rate(ndvi).rate_kg_ha == pytest.approx(
            share * hard.decide_rate(ndvi).rate_kg_ha
        ), ndvi
    assert (
        tapered.decide_rate(0.2499).why == "below_cutoff"
        and hard.decide_rate(0.2501).rate_kg_ha > 20.0
    )
    open_ended = prepare_rule(Crop.model_validate(crop_data("osu_winter_wheat_2007")))
    assert open_ended.decide_rate(0.26).rate_kg_ha == tapered.decide_rate(0.26).rate_kg_ha
    assert (
        open_ended.decide_rate(0.9).why == "yield_reached"
        and hard.decide_rate(0.9).why == "above_cutoff"
    )


@settings(deadline=None)
@given(st.floats(0.0, 1.0), st.floats(-0.01, 0.01))
def test_a_tapered_rate_has_no_step(ndvi, more):
    """Neighbouring readings get neighbouring rates: at most the slope of the taper and of the
    curve."""
    rule = prepare_rule(_tapered())
    assert (
        abs(rule.decide_rate(ndvi).rate_kg_ha - rule.decide_rate(ndvi + more).rate_kg_ha)
        <= 2500.0 * abs(more) + 1e-9
    )


def _tapered() -> Crop:
    return Crop.model_validate(
        {
            "format": "topdress-crop/1",
            "id": "any",
            "name": "any",
            "yield_potential": {"set": "osu_winter_wheat_2007"},
            "days": {"count": 100, "above_c": 4.4},
            "y_max_t_ha": 7.0,
            "ndvi_nrich": 0.65,
            "ndvi_check": 0.5,
            "response_index": "field",
            "grades": False,
            "taper_ndvi": 0.05,
            "fallback_rate_kg_ha": 50.0,
            "max_rate_kg_ha": 300.0,
        }
    )


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"taper_ndvi": 0.05}, "which are steps"),
        ({"taper_ndvi": 0.26, "grades": False}, "at most half of the span"),
    ],
)
def test_what_does_not_go_together_says_so(crop_data, change, part):
    with pytest.raises(ValidationError, match=part):
        Crop.model_validate(crop_data("huanghai_wheat") | change)


def test_a_file_that_says_nothing_of_grades_is_told(crop_data):
    data = crop_data("huanghai_wheat")
    del data["grades"]
    crop = Crop.model_validate(data)
    assert not crop.grades and any("grades is not said" in line for line in crop.warnings)
    assert not any(
        "grades" in line for line in Crop.model_validate(crop_data("huanghai_wheat")).warnings
    )


@pytest.mark.parametrize(
    "value", [StripMean("nrich", 0.7121, 0.0041, 38), StripMean("check", 0.55)]
)
def test_a_strip_is_ordered_as_it_is_logged(value):
    assert parse_strip(value.event_text) == value


@pytest.mark.parametrize(
    "text",
    [
        None,
        0.7,
        "",
        "nrich",
        "rich 0.7",
        "nrich 0",
        "nrich 1.01",
        "nrich nan",
        "check -0.5",
        "nrich 0.7 0.01",
        "nrich 0.7 -0.01 5",
        "nrich 0.7 inf 5",
        "nrich 0.7 0.1 -1",
        "nrich x",
    ],
)
def test_what_is_no_strip(text):
    assert parse_strip(text) is None


def test_values_stay_finite():
    assert math.isfinite(
        calc_field_response(
            ReferenceStrips(1.0, 1e-6), 2.0, HarvestLine(slope=1.64, intercept=-0.53)
        )
        or math.nan
    )


# --- Shipped crop files against the equations of their sources, as the sources print them.
# The expected figures come from the text below, typed from the pages, by arithmetic written
# here: nothing of control/agronomy is used for them. Winter wheat gets no more than to the
# yield of the curve at the strip's own NDVI: the "NRate VRN" sheet of Oklahoma State, as
# R/SBNRC_Algorithm.R of github.com/beardon/ninja-active-mapper has it
# (`yld_fert_field[yld_fert_field>yld_ptnl_nRich]=yld_ptnl_nRich`). Read:
# nue.okstate.edu/Yield_Potential.htm (its rows down to corn of 2004),
# nue.okstate.edu/Managing_N_Fertilizer_NRS.htm (RI_NDVI at most 2.0, YP_N at most YP_MAX), Chen
# et al. 2015, eq 2 to 5.

ROOT = Path(__file__).parents[2]
CROPS = ROOT / "configs" / "crops"

# file: the row's equation (kg/ha) and its RI adjustment, character by character; INSEY as the
# page defines it
LIBRARY = {
    "osu_winter_wheat_2002": ("YP0=344*EXP(INSEY*267.65)", ""),
    "osu_winter_wheat_2003": ("YP0=500*EXP(INSEY*267.65)", ""),
    "osu_winter_wheat_2004": ("YP0=359*EXP(INSEY*324.4)", ""),
    "osu_winter_wheat_2005": ("YP0=522*EXP(INSEY*274.7)", "RI Harvest = 1.69(RI-NDVI) -0.70"),
    "osu_winter_wheat_2006": ("YP0=532*EXP(INSEY*270.1)", "RI Harvest = 1.69(RI-NDVI) -0.70"),
    "osu_winter_wheat_2007": ("YP0=590*EXP(INSEY*258.2)", "RI Harvest = 1.69(RI-NDVI) -0.70"),
    "osu_durum_2006": ("YP0=322*EXP(INSEY*211.5)", "RI Harvest = 1.69(RI-NDVI) -0.70"),
    "osu_wheat_southern_australia_2006": (
        "YP0=1800*EXP(INSEY*85)",
        "RI Harvest = 1.69(RI-NDVI) -0.70",
    ),
    "osu_wheat_eastern_australia_2006": (
        "YP0=580*EXP(INSEY*244.94)",
        "RI Harvest = 1.69(RI-NDVI) -0.70",
    ),
    "osu_corn_irrigated_2003": ("YP0=2332.9*(EXP(INSEY*132.46)", ""),
    "osu_corn_dryland_2003": ("YP0=1633*(EXP(INSEY*132.46)", ""),
    "osu_corn_2004": ("YP0=1565*(EXP(INSEY*154.7)", "RI Harvest = 1.64(RI-NDVI) - 0.5287"),
}
# of the grain: NDSU SF1176-5; wheat 23.9 kg/t, Chen et al. 2015, eq 2
GRAIN_N = {"corn": 0.0125}
WHEAT_N = 0.0239
TAKEN_UP = 0.6  # eta, eq 2
UREA_N = 0.45  # eq 2


def by_the_page(
    name: str,
    ndvi: float,
    days: float,
    rich: float,
    check: float,
    most_kg_ha: float,
    ceiling: str = "",
) -> dict[str, float]:
    """Yields kg/ha, N and urea kg/ha, as one would with page and sheet next to a pocket
    calculator."""
    equation, adjustment = LIBRARY[name]
    front, back = (
        float(n)
        for n in re.fullmatch(r"YP0=([\d.]+)\*\(?EXP\(INSEY\*([\d.]+)\)", equation).groups()
    )
    index = min(rich / check, 2.0)
    harvest = index
    if adjustment:
        slope, less = re.fullmatch(
            r"RI Harvest = ([\d.]+)\(RI-NDVI\) - ?([\d.]+)", adjustment
        ).groups()
        harvest = float(slope) * index - float(less)
    without = min(front * math.exp(ndvi / days * back), most_kg_ha)
    by_strip = (ceiling or ("nrich" if "winter_wheat" in name else "y_max")) == "nrich"
    strips = front * math.exp(rich / days * back) if by_strip else math.inf
    with_n = min(without * harvest, most_kg_ha, strips)
    grain = GRAIN_N["corn"] if "corn" in name else WHEAT_N
    n = max(0.0, (with_n - without) * grain / TAKEN_UP)
    return {
        "YP0": without,
        "RI": rich / check,
        "RI harvest": harvest,
        "YPN": with_n,
        "N": n,
        "urea": n / UREA_N,
    }


def ours(
    name: str, ndvi: float, days: int | None, rich: float | None, check: float | None, **other: str
) -> float:
    """Product, kg/ha, that the shipped file gives, read as the worker reads it. other: keys
    that it says otherwise."""
    crop = load_config(CROPS / f"{name}.yaml", CROP_KIND).model.model_copy(update=other)
    job = Job.model_validate({"crop": name, "days": days, "ndvi_nrich": rich, "ndvi_check": check})
    return make_rule(crop, job, None).decide_rate(ndvi).rate_kg_ha


def test_every_shipped_file_is_held_against_its_source():
    assert {path.stem for path in CROPS.glob("*.yaml")} == {*LIBRARY, "huanghai_wheat"}


@pytest.mark.parametrize("name", LIBRARY)
def test_a_dozen_rates_of_each_file(name):
    """288 rates, by the strip's own yield and, as files of before, by Y_max alone:
    any stand above the low end's taper, dense ones too, any strips, any season."""
    deal = random.Random(name)
    most = (
        1000.0 * yaml.safe_load((CROPS / f"{name}.yaml").read_text(encoding="utf-8"))["y_max_t_ha"]
    )
    limit = yaml.safe_load((CROPS / f"{name}.yaml").read_text(encoding="utf-8"))["max_rate_kg_ha"]
    for _ in range(12):
        check = deal.uniform(0.35, 0.75)
        rich = min(0.95, check * deal.uniform(0.95, 2.2))
        ndvi = deal.uniform(0.31, 0.95)
        days = deal.randint(40, 70) if "corn" in name else deal.randint(60, 120)
        for ceiling in ("nrich", "y_max"):
            expected = by_the_page(name, ndvi, days, rich, check, most, ceiling)["urea"]
            assert expected <= limit, "a shipped limit is a limit, not the agronomy"
            given = ours(name, ndvi, days, rich, check, yield_ceiling=ceiling)
            assert given == pytest.approx(expected, abs=1e-6), (ndvi, days, rich, check)


def test_the_papers_own_crop_by_eq_2_to_5():
    """The paper's grades: ten steps of 0.05 at their upper edges, nothing outside 0.25 to 0.75,
    6.73 t/ha in all."""
    for step in range(1, 11):
        edge = 0.25 + 0.05 * step
        without = 0.359 * math.exp(324.4 * edge / 82)
        expected = max(0.0, 23.9 * (6.73 - without) / (0.45 * 0.6))
        for ndvi in (edge - 0.0499, edge - 0.02, edge):
            assert ours("huanghai_wheat", ndvi, None, None, None) == pytest.approx(
                expected, abs=1e-6
            ), ndvi
    assert [
        ours("huanghai_wheat", ndvi, None, None, None) for ndvi in (0.2, 0.25, 0.7501, 0.9)
    ] == [0.0] * 4


def worked_examples() -> list[list[str]]:
    """Rows of the table of docs/agronomy.md, each cell as it stands there."""
    text = (ROOT / "docs" / "agronomy.md").read_text(encoding="utf-8")
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("| `osu_")
    ]


def test_every_file_has_its_worked_example():
    assert [row[0].strip("`") for row in worked_examples()] == list(LIBRARY)


@pytest.mark.parametrize("row", worked_examples(), ids=lambda row: row[0].strip("`"))
def test_worked_example(row):
    """By hand, as printed in docs/agronomy.md; and the shipped file with what stands in it
    gives the same."""
    name = row[0].strip("`")
    equation, line, days, ndvi, rich, check, *printed = row[1:]
    assert (equation.strip("`"), line.strip("`")) == LIBRARY[name]
    file = yaml.safe_load((CROPS / f"{name}.yaml").read_text(encoding="utf-8"))
    assert (int(days), float(rich), float(check)) == (
        file["days"]["count"],
        file["ndvi_nrich"],
        file["ndvi_check"],
    )
    found = by_the_page(
        name, float(ndvi), int(days), float(rich), float(check), 1000.0 * file["y_max_t_ha"]
    )
    keys = ("YP0", "RI", "RI harvest", "YPN", "N", "urea")
    assert [
        f"{found[key]:.{3 if 'RI' in key else 1 if key in ('N', 'urea') else 0}f}" for key in keys
    ] == printed
    assert ours(name, float(ndvi), None, None, None) == pytest.approx(float(printed[-1]), abs=0.05)
