"""What bounds a rule's nitrogen: the strip's own yield, a lowest rate, what was given and is credited, the year."""
from __future__ import annotations

import datetime as dt
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from console.cli import app
from control.agronomy.crop import Crop
from control.agronomy.noa import prepare
from control.field.job import Job, rule_of
from drivers.files.config_error import ConfigError
from drivers.files.farm_lines import COLUMNS
from drivers.files.setup import Setup, load_setup
from tests.agronomy.conftest import CROPS

DAY = dt.date(2026, 3, 10)
WHEAT = yaml.safe_load((CROPS / "osu_winter_wheat_2007.yaml").read_text(encoding="utf-8"))
FIELD = {"title": "Long acre", "boundary_m": [[0.0, 0.0], [0.0, 200.0], [100.0, 200.0], [100.0, 0.0]]}     # 2 ha


def wheat(**keys: object) -> Crop:
    return Crop.model_validate(WHEAT | keys)


@pytest.mark.parametrize(("ndvi", "before", "now"), [(0.40, 72.9, 72.9), (0.50, 94.4, 89.8), (0.64, 135.5, 7.1),
                                                     (0.65, 139.0, 0.0), (0.80, 204.8, 0.0)])
def test_no_place_gets_more_than_to_the_strips_own_yield(ndvi, before, now):
    """The strip reads 0.65. A file that says nothing goes on as it did."""
    old = wheat(yield_ceiling="y_max")
    assert "yield_ceiling" not in Crop.model_validate({k: v for k, v in WHEAT.items() if k != "yield_ceiling"}
                                                      ).model_fields_set
    assert prepare(old).decide(ndvi).rate_kg_ha == pytest.approx(before, abs=0.05)
    assert prepare(wheat()).decide(ndvi).rate_kg_ha == pytest.approx(now, abs=0.05)


@given(st.floats(0.0, 1.0), st.floats(0.0, 400.0), st.floats(0.0, 200.0), st.floats(0.0, 2.0))
def test_a_lowest_rate_holds_on_crop_alone(ndvi, least, credit, factor):
    """Nothing on bare soil and in a zone of 0; else at least so much, at most the limit, whatever is credited."""
    rule = prepare(wheat(min_rate_kg_ha=least, taper_ndvi=0.0), n_credit_kg_ha=credit)
    rate = rule.decide(ndvi, factor).rate_kg_ha
    on_crop = ndvi >= rule.crop.ndvi_min and factor > 0.0
    assert (least <= rate <= rule.crop.max_rate_kg_ha) if on_crop else rate == 0.0


def test_what_is_credited_and_what_was_given_comes_off():
    """By a yield curve the canopy shows what was given: only what it does not show yet comes off. 18 kg N: 40 urea."""
    plain, given_n, credited = (prepare(wheat(), n_given_kg_ha=a, n_credit_kg_ha=b).decide(0.5).rate_kg_ha
                                for a, b in ((0.0, 0.0), (60.0, 0.0), (0.0, 18.0)))
    assert given_n == plain and credited == pytest.approx(plain - 40.0)
    keys = {k: v for k, v in WHEAT.items() if k not in (
        "yield_potential", "days", "y_max_t_ha", "response_index", "yield_ceiling", "growth_window")}
    sufficient = Crop.model_validate(keys | {"examples": [], "sufficiency": {
        "n_opt_kg_ha": 150.0, "delta_si": 0.3, "source": "made up for this test"}})
    job = Job.model_validate({"nitrogen": {"given_kg_ha": 40.0, "credit_kg_ha": 20.0}})
    decide = rule_of(sufficient, job).decide
    assert decide(0.65 * 0.7).rate_kg_ha == pytest.approx(90.0 / 0.45)
    assert decide(0.65 * 0.7, 0.8).rate_kg_ha == pytest.approx((150.0 * 0.8 - 60.0) / 0.45)
    assert decide(0.65 * 0.7, 0.3).rate_kg_ha == 0.0


def written(folder: Path, rows: list[dict[str, str]], **nitrogen: object) -> Path:
    if rows:
        lines = [",".join(COLUMNS), *(",".join(row.get(name, "") for name in COLUMNS) for row in rows)]
        (folder / "farm.csv").write_text("\n".join(lines) + "\n")
        nitrogen = {"record": "farm.csv", **nitrogen}
    path = folder / "job.yaml"
    path.write_text(yaml.safe_dump({"format": "topdress-job/1", "id": "acre", "farm": "Hill", "field": FIELD,
                                    "nitrogen": nitrogen}))
    return path


ROW = {"date": "2026-02-20", "field": "long acre", "farm": "Hill", "nitrogen_kg": "100.0", "log": "a.csv"}


def test_a_ceiling_of_the_year_counts_what_earlier_records_gave(tmp_path):
    """2 ha: 100 kg N are 50 kg/ha. Another field, farm, year and a simulated pass count nothing, no date counts."""
    rows = [ROW, ROW | {"field": "Short acre"}, ROW | {"field": ""}, ROW | {"farm": "Dale"},
            ROW | {"date": "2025-11-20"}, ROW | {"simulated": "yes"},
            ROW | {"date": "", "nitrogen_kg": "20.0", "log": "b.csv"}]
    setup = load_setup("huanghai", written(tmp_path, rows, year_max_kg_ha=170.0, given_kg_ha=60.0), DAY)
    assert setup.n_year is not None and setup.n_year.passes == 2
    assert setup.n_year.left_kg_ha == pytest.approx(170.0 - 60.0 - 60.0)
    most = 50.0 / 0.45
    assert (setup.crop.max_rate_kg_ha, setup.crop.fallback_rate_kg_ha) == pytest.approx((most, most))
    assert max(setup.rule.decide(k / 100.0).rate_kg_ha for k in range(100)) == pytest.approx(most)
    later = load_setup("huanghai", written(tmp_path, rows, year_max_kg_ha=170.0, year_from="2025-09-01"), DAY)
    assert later.n_year is not None and later.n_year.earlier_kg_ha == pytest.approx(110.0)
    own = load_setup("huanghai", written(tmp_path, rows, year_max_kg_ha=170.0), DAY, lambda job: ["a.csv"])
    assert own.n_year is not None and own.n_year.earlier_kg_ha == pytest.approx(10.0), "its ground is done"


def test_a_high_ceiling_changes_nothing(tmp_path):
    setup: Setup = load_setup("huanghai", written(tmp_path, [], year_max_kg_ha=400.0), DAY)
    assert setup.crop == load_setup("huanghai", "demo", DAY).crop


@pytest.mark.parametrize(("rows", "nitrogen", "said"), [
    ([ROW | {"nitrogen_kg": "400.0"}], {"year_max_kg_ha": 170.0}, "nothing may be given any more in this year"),
    ([], {"year_max_kg_ha": 170.0, "given_kg_ha": 170.0}, "nothing may be given any more in this year"),
    ([ROW | {"nitrogen_kg": "much"}], {"year_max_kg_ha": 170.0}, "line 2: nitrogen_kg 'much': allowed is a number"),
    ([ROW | {"nitrogen_kg": "-5"}], {"year_max_kg_ha": 170.0}, "allowed is a number from 0"),
    ([], {"year_max_kg_ha": 170.0, "record": "none.csv"}, "is not there: allowed is a farm record"),
    ([], {"record": "farm.csv"}, "goes with year_max_kg_ha"),
], ids=["by_passes", "by_hand", "no_number", "below_0", "no_record", "no_ceiling"])
def test_what_a_ceiling_refuses(rows, nitrogen, said, tmp_path):
    """In one line, by check as by a start."""
    path = written(tmp_path, rows, **nitrogen)
    with pytest.raises(ConfigError, match=said):
        load_setup("huanghai", path, DAY)
    checked = CliRunner().invoke(app, ["check", str(path)])
    assert checked.exit_code != 0 and said in checked.output


def test_check_says_what_is_left(tmp_path):
    result = CliRunner().invoke(app, ["check", str(written(tmp_path, [], year_max_kg_ha=170.0, given_kg_ha=60.0))])
    assert result.exit_code == 0 and "110.0 kg N/ha left, at most 244.4 kg/ha of product" in result.output


@pytest.mark.parametrize(("change", "said"), [
    ({"no_double": False}, "which no place may pass twice"),
    ({"target": {"source": "point", "plants": "rows.csv"}}, "a dose a plant has none"),
])
def test_a_ceiling_needs_rates_and_no_place_twice(change, said):
    with pytest.raises(ValueError, match=said):
        Job.model_validate({"nitrogen": {"year_max_kg_ha": 170.0}} | change)
