"""NDRE as the index of dense canopies: heads and rule must speak of the same one, and the log
says which it was."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from topdress.console.app.pages.job.strip_measurement import StripRun
from topdress.console.services.replay_rerun import rerun_loop
from topdress.console.worker.assemble import assemble_run
from topdress.console.worker.options import Options
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.nitrogen_rate import prepare_rule
from topdress.control.log_row import HEAD_COLUMNS, NDRE_COLUMNS, LogRow
from topdress.control.simulation.simulated_canopy import convert_to_ndre
from topdress.drivers.devices.canopy_heads import HeadsConfig
from topdress.drivers.files.config import load_config, save_config
from topdress.drivers.files.config_kinds import CROP_KIND, JOB_KIND
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.run_log import write_whole_log
from topdress.drivers.files.run_meta import make_run_meta

from tests.command import topdress
from tests.control_loop.closed import SETUP, Closed

CURVE = {"a_t_ha": 0.9, "b_days": 400.0, "base_temp_c": 4.4, "source": "made up for this test"}


def dense(huanghai: Crop) -> Crop:
    return Crop.model_validate(
        huanghai.model_dump(mode="json")
        | {
            "id": "dense",
            "index": "ndre",
            "yield_potential": CURVE,
            "days": {"count": 100, "above_c": 4.4},
            "grades": False,
            "ndvi_min": 0.1,
            "ndvi_max": 0.6,
            "taper_ndvi": 0.05,
            "examples": [],
        }
    )


@pytest.fixture(scope="module")
def worked():
    """A run on a dense canopy, heads that read NDRE."""
    crop = dense(SETUP.crop)
    rule = prepare_rule(crop)
    canopy = SETUP.job.simulated.canopy.model_dump() | {"mean_ndvi": 0.86, "cv_percent": 4.0}
    closed = Closed(
        sim={"begin_m": 30.0, "heads_index": "ndre", "canopy": canopy},
        known={"crop": crop, "rule": rule},
    )
    return SETUP, crop, rule, closed.job, [step.tick.row for step in closed.through(40.0)]


def test_dense_canopies_differ_by_red_edge_long_after_ndvi():
    """From leaf area 3 to 5: NDVI rises by some 5 %, NDRE by a third."""
    low, high = (0.95 - 0.8 * np.exp(-0.7 * leaf) for leaf in (3.0, 5.0))
    assert high / low - 1.0 < 0.10 and convert_to_ndre(high) / convert_to_ndre(low) - 1.0 > 0.25
    assert [
        convert_to_ndre(a) < convert_to_ndre(b) for a, b in ((0.1, 0.3), (0.3, 0.6), (0.6, 0.9))
    ] == [True] * 3
    assert 0.0 < convert_to_ndre(0.0) < convert_to_ndre(0.99) < 0.6


def test_the_row_names_what_the_heads_read(worked):
    _, _, rule, _, rows = worked
    last = rows[-1]
    assert last.ndre is not None and last.ndvi is None and last.target_source == "canopy"
    assert all(getattr(last, name) is not None for name in NDRE_COLUMNS)
    assert all(getattr(last, name) is None for name in HEAD_COLUMNS)
    assert 0.3 < last.ndre < 0.55 and last.target_rate_kg_ha > 0.0
    rates = [row.target_rate_kg_ha for row in rows if row.time_s > 20.0]
    assert np.std(rates) > 5.0 and max(rates) <= rule.crop.max_rate_kg_ha


def test_a_log_of_red_edge_is_run_again(worked, tmp_path):
    setup, crop, rule, job, rows = worked
    log = read_log(
        write_whole_log(tmp_path / "run.csv", make_run_meta(setup.machine, crop, job), rows)
    )
    again = [
        tick.row
        for tick in rerun_loop(log, type(setup)(setup.machine, crop, rule, job, {}, tmp_path, None))
    ]
    late = [(a, b) for a, b in zip(again, rows, strict=True) if b.time_s > 20.0]
    assert {a.target_source for a, _ in late} == {"canopy"}
    assert np.mean([abs(a.ndre - b.ndre) for a, b in late]) < 0.005


def test_another_index_than_the_rules_is_as_none():
    crop = dense(SETUP.crop)
    closed = Closed(sim={"begin_m": 30.0}, known={"crop": crop, "rule": prepare_rule(crop)})
    last = closed.through(15.0)[-1].tick
    assert last.row.target_source == "fallback" and "heads_few" in (last.row.alarms or "")


def test_a_strip_is_measured_in_the_index_that_there_is():
    run = StripRun()
    for k in range(200):
        run.add_row(LogRow(0.2 * k, ndre=0.4, speed_used_mps=1.0))
    assert run.strip.ndvi == pytest.approx(0.4)


@pytest.fixture
def files(tmp_path):
    save_config(tmp_path / "crop.yaml", dense(SETUP.crop), CROP_KIND)
    save_config(
        tmp_path / "job.yaml",
        load_config("demo", JOB_KIND).model.model_copy(update={"crop": "crop.yaml"}),
        JOB_KIND,
    )
    cab = "format: topdress-cab/1\nheads:\n  protocol: {protocol}\n  ports: [COM1]\n{more}"
    (tmp_path / "greenseeker.yaml").write_text(cab.format(protocol="greenseeker", more=""))
    (tmp_path / "acs.yaml").write_text(cab.format(protocol="acs430", more="  index: ndre\n"))
    (tmp_path / "wrong.yaml").write_text(cab.format(protocol="greenseeker", more="  index: ndre\n"))
    return tmp_path


def test_heads_of_another_index_are_refused_in_one_line(files):
    def said(*names: str) -> tuple[int, str]:
        result = topdress("check", *(str(files / name) for name in names))
        return result.exit_code, result.output

    code, output = said("job.yaml", "greenseeker.yaml")
    lines = [line for line in output.splitlines() if "heads.index" in line]
    assert (
        code != 0
        and len(lines) == 1
        and "value ndvi: allowed ndre" in lines[0]
        and "crop dense" in lines[0]
    )
    assert said("job.yaml", "acs.yaml")[0] == 0
    code, output = said("wrong.yaml")
    assert (
        code != 0
        and "heads of protocol greenseeker give NDVI: allowed with acs430, acs435" in output
    )
    code, output = said("job.yaml")
    assert code != 0 and "simulated.heads_index" in output
    with pytest.raises(ValueError, match=r"simulated\.heads_index: value ndvi: allowed ndre"):
        assemble_run(
            Options((str(files / "job.yaml"),), files / "w.json", log=str(files / "a.csv")),
            lambda: 0.0,
        )


def test_a_layout_of_ones_own_says_which_field_it_is():
    layout = {"fields": 4, "ndvi": 2, "index_2": 3}
    assert HeadsConfig(protocol="own", ports=("COM1",), layout=layout, index="ndre").index == "ndre"
    with pytest.raises(ValidationError, match="give NDVI"):
        HeadsConfig(protocol="own", ports=("COM1",), layout=layout | {"index_2": 0}, index="ndre")


def test_ndvi_curves_stay_with_ndvi(worked):
    setup = worked[0]
    with pytest.raises(ValidationError, match="was published for NDVI"):
        Crop.model_validate(setup.crop.model_dump(mode="json") | {"index": "ndre"})
