"""Shipped crop files against the equations of their sources, as the sources print them.

The expected figures come from the text below, typed from the pages, by arithmetic written here: nothing of
control/agronomy is used for them. Winter wheat gets no more than to the yield of the curve at the strip's own NDVI: the
"NRate VRN" sheet of Oklahoma State, as R/SBNRC_Algorithm.R of github.com/beardon/ninja-active-mapper has it
(`yld_fert_field[yld_fert_field>yld_ptnl_nRich]=yld_ptnl_nRich`).
Read: nue.okstate.edu/Yield_Potential.htm (its rows down to corn of 2004),
nue.okstate.edu/Managing_N_Fertilizer_NRS.htm (RI_NDVI at most 2.0, YP_N at most YP_MAX), Chen et al. 2015, eq 2 to 5.
"""
from __future__ import annotations

import math
import random
import re
from pathlib import Path

import pytest
import yaml

from control.field.job import Job, rule_of
from drivers.files.config import load
from drivers.files.kinds import CROP

ROOT = Path(__file__).parents[2]
CROPS = ROOT / "configs" / "crops"

# file: the row's equation (kg/ha) and its RI adjustment, character by character; INSEY as the page defines it
LIBRARY = {
    "osu_winter_wheat_2002": ("YP0=344*EXP(INSEY*267.65)", ""),
    "osu_winter_wheat_2003": ("YP0=500*EXP(INSEY*267.65)", ""),
    "osu_winter_wheat_2004": ("YP0=359*EXP(INSEY*324.4)", ""),
    "osu_winter_wheat_2005": ("YP0=522*EXP(INSEY*274.7)", "RI Harvest = 1.69(RI-NDVI) -0.70"),
    "osu_winter_wheat_2006": ("YP0=532*EXP(INSEY*270.1)", "RI Harvest = 1.69(RI-NDVI) -0.70"),
    "osu_winter_wheat_2007": ("YP0=590*EXP(INSEY*258.2)", "RI Harvest = 1.69(RI-NDVI) -0.70"),
    "osu_durum_2006": ("YP0=322*EXP(INSEY*211.5)", "RI Harvest = 1.69(RI-NDVI) -0.70"),
    "osu_wheat_southern_australia_2006": ("YP0=1800*EXP(INSEY*85)", "RI Harvest = 1.69(RI-NDVI) -0.70"),
    "osu_wheat_eastern_australia_2006": ("YP0=580*EXP(INSEY*244.94)", "RI Harvest = 1.69(RI-NDVI) -0.70"),
    "osu_corn_irrigated_2003": ("YP0=2332.9*(EXP(INSEY*132.46)", ""),
    "osu_corn_dryland_2003": ("YP0=1633*(EXP(INSEY*132.46)", ""),
    "osu_corn_2004": ("YP0=1565*(EXP(INSEY*154.7)", "RI Harvest = 1.64(RI-NDVI) - 0.5287"),
}
GRAIN_N = {"corn": 0.0125}          # of the grain: NDSU SF1176-5; wheat 23.9 kg/t, Chen et al. 2015, eq 2
WHEAT_N = 0.0239
TAKEN_UP = 0.6                      # eta, eq 2
UREA_N = 0.45                       # eq 2


def by_the_page(name: str, ndvi: float, days: float, rich: float, check: float, most_kg_ha: float,
                ceiling: str = "") -> dict[str, float]:
    """Yields kg/ha, N and urea kg/ha, as one would with page and sheet next to a pocket calculator."""
    equation, adjustment = LIBRARY[name]
    front, back = (float(n) for n in re.fullmatch(r"YP0=([\d.]+)\*\(?EXP\(INSEY\*([\d.]+)\)", equation).groups())
    index = min(rich / check, 2.0)
    harvest = index
    if adjustment:
        slope, less = re.fullmatch(r"RI Harvest = ([\d.]+)\(RI-NDVI\) - ?([\d.]+)", adjustment).groups()
        harvest = float(slope) * index - float(less)
    without = min(front * math.exp(ndvi / days * back), most_kg_ha)
    by_strip = (ceiling or ("nrich" if "winter_wheat" in name else "y_max")) == "nrich"
    strips = front * math.exp(rich / days * back) if by_strip else math.inf
    with_n = min(without * harvest, most_kg_ha, strips)
    grain = GRAIN_N["corn"] if "corn" in name else WHEAT_N
    n = max(0.0, (with_n - without) * grain / TAKEN_UP)
    return {"YP0": without, "RI": rich / check, "RI harvest": harvest, "YPN": with_n, "N": n, "urea": n / UREA_N}


def ours(name: str, ndvi: float, days: int | None, rich: float | None, check: float | None, **other: str) -> float:
    """Product, kg/ha, that the shipped file gives, read as the worker reads it. other: keys that it says otherwise."""
    crop = load(CROPS / f"{name}.yaml", CROP).model.model_copy(update=other)
    job = Job.model_validate({"crop": name, "days": days, "ndvi_nrich": rich, "ndvi_check": check})
    return rule_of(crop, job, None).decide(ndvi).rate_kg_ha


def test_every_shipped_file_is_held_against_its_source():
    assert {path.stem for path in CROPS.glob("*.yaml")} == {*LIBRARY, "huanghai_wheat"}


@pytest.mark.parametrize("name", LIBRARY)
def test_a_dozen_rates_of_each_file(name):
    """288 rates, by the strip's own yield and, as files of before, by Y_max alone:
    any stand above the low end's taper, dense ones too, any strips, any season."""
    deal = random.Random(name)
    most = 1000.0 * yaml.safe_load((CROPS / f"{name}.yaml").read_text(encoding="utf-8"))["y_max_t_ha"]
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
    """The paper's grades: ten steps of 0.05 at their upper edges, nothing outside 0.25 to 0.75, 6.73 t/ha in all."""
    for step in range(1, 11):
        edge = 0.25 + 0.05 * step
        without = 0.359 * math.exp(324.4 * edge / 82)
        expected = max(0.0, 23.9 * (6.73 - without) / (0.45 * 0.6))
        for ndvi in (edge - 0.0499, edge - 0.02, edge):
            assert ours("huanghai_wheat", ndvi, None, None, None) == pytest.approx(expected, abs=1e-6), ndvi
    assert [ours("huanghai_wheat", ndvi, None, None, None) for ndvi in (0.2, 0.25, 0.7501, 0.9)] == [0.0] * 4


def worked_examples() -> list[list[str]]:
    """Rows of the table of docs/agronomy.md, each cell as it stands there."""
    text = (ROOT / "docs" / "agronomy.md").read_text(encoding="utf-8")
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()
            if line.startswith("| `osu_")]


def test_every_file_has_its_worked_example():
    assert [row[0].strip("`") for row in worked_examples()] == list(LIBRARY)


@pytest.mark.parametrize("row", worked_examples(), ids=lambda row: row[0].strip("`"))
def test_worked_example(row):
    """By hand, as printed in docs/agronomy.md; and the shipped file with what stands in it gives the same."""
    name = row[0].strip("`")
    equation, line, days, ndvi, rich, check, *printed = row[1:]
    assert (equation.strip("`"), line.strip("`")) == LIBRARY[name]
    file = yaml.safe_load((CROPS / f"{name}.yaml").read_text(encoding="utf-8"))
    assert (int(days), float(rich), float(check)) == (file["days"]["count"], file["ndvi_nrich"], file["ndvi_check"])
    found = by_the_page(name, float(ndvi), int(days), float(rich), float(check), 1000.0 * file["y_max_t_ha"])
    keys = ("YP0", "RI", "RI harvest", "YPN", "N", "urea")
    assert [f"{found[key]:.{3 if 'RI' in key else 1 if key in ('N', 'urea') else 0}f}" for key in keys] == printed
    assert ours(name, float(ndvi), None, None, None) == pytest.approx(float(printed[-1]), abs=0.05)
