"""The stage for which a crop's rule was made: warned of at check, at START and in the report; never a stop."""
from __future__ import annotations

import datetime as dt
from dataclasses import replace

import pytest
from pydantic import ValidationError
from typer.testing import CliRunner

from console.app.pages.job.day import LOOK, OK, checks
from console.app.pages.job.sample import FACTS
from console.app.units import METRIC
from console.cli import app
from console.reports.job_about import About, happened, named
from control.agronomy.growth import Growth, GrowthStage, GrowthWindow, growth_of
from control.log_row import LogRow
from control.orders import Do, Order
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.closed_loop import simulated_run
from drivers.files.config import load, save
from drivers.files.kinds import JOB
from drivers.files.setup import load_setup

FEEKES = GrowthWindow(scale="feekes", first=4, last=6)


def test_in_the_crop_files_own_terms():
    def stage(scale: str, at: float) -> GrowthStage:
        return GrowthStage(scale=scale, stage=at)
    assert growth_of(None, stage("feekes", 5), 90) is None
    assert [growth_of(FEEKES, stage("feekes", at), 90).is_outside for at in (3.9, 4, 5, 6, 6.1)] == [
        True, False, False, False, True]
    assert growth_of(FEEKES, stage("bbch", 31), 90) == growth_of(FEEKES, None, 90) == Growth("feekes", 4, 6, None)
    days = GrowthWindow(scale="days", first=87, last=112)
    assert [growth_of(days, None, count).is_outside for count in (86, 87, 112, 113)] == [True, False, False, True]


@pytest.mark.parametrize("wrong", [
    {"scale": "feekes", "first": 6, "last": 4}, {"scale": "bbch", "first": 20, "last": 120},
    {"scale": "weeks", "first": 1, "last": 2}])
def test_windows_that_are_none(wrong):
    with pytest.raises(ValidationError):
        GrowthWindow.model_validate(wrong)


def ticks(growth: GrowthStage | None):
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    job = with_simulated_field(setup.job.model_copy(update={
        "growth": growth, "simulated": setup.job.simulated.model_copy(update={"begin_m": 30.0})}), setup.machine)
    crop = setup.crop.model_copy(update={"growth_window": FEEKES})
    loop = control_loop(setup.machine, crop, setup.rule, job)
    plant = simulated_machine(setup.machine, job, 1, 0.05)
    return [step.tick for step in simulated_run(plant, loop, 25.0, [(0.2, Order(Do.READY)), (3.0, Order(Do.START))])]


def test_a_start_beyond_the_window_is_said_and_works():
    seen = ticks(GrowthStage(scale="feekes", stage=8))
    events = [tick.row.events for tick in seen if tick.row.events and "growth" in tick.row.events]
    assert events == ["growth_stage_outside feekes 8 (4 to 6);start"]
    noted = [tick.row.time_s for tick in seen if "growth_stage_outside" in tick.notes]
    assert 2.9 < noted[0] < 3.2 and 17.0 < noted[-1] < 18.5
    assert seen[-1].row.state == "working" and seen[-1].command.shaft_rpm > 5.0, "never a stop"
    for stage in (None, GrowthStage(scale="feekes", stage=5)):
        assert not [tick for tick in ticks(stage) if "growth" in (tick.row.events or "") or tick.notes == (
            "growth_stage_outside",)]


def test_the_report_says_it():
    class Log:
        def rows(self):
            return iter([LogRow(0.0, state="ready"),
                         LogRow(1.0, state="working", events="growth_stage_outside feekes 8 (4 to 6);start")])
    told = happened(Log())
    assert told.growth == "feekes 8 (4 to 6)"
    assert "rule: feekes 8 (4 to 6)" in named(About(happened=told), "urea")
    assert "Growth stage" not in named(About(), "urea")


def test_check_says_it(tmp_path):
    demo = load("demo", JOB).model.model_copy(update={"crop": "osu_winter_wheat_2007"})
    for growth, said in ((None, "growth stage not said"), (GrowthStage(scale="feekes", stage=8), "feekes 8 is outside"),
                         (GrowthStage(scale="feekes", stage=5), "")):
        save(tmp_path / "job.yaml", demo.model_copy(update={"growth": growth}), JOB)
        result = CliRunner().invoke(app, ["check", str(tmp_path / "job.yaml")])
        assert result.exit_code == 0 and ("growth stage" in result.output) == bool(said) and said in result.output
    save(tmp_path / "job.yaml", demo.model_copy(update={"ndvi_nrich": 0.5, "ndvi_check": 0.55}), JOB)
    assert "response index 0.91: no response" in CliRunner().invoke(app, ["check", str(tmp_path / "job.yaml")]).output


def test_the_list_before_work_says_it():
    for stage, level in ((None, LOOK), (8.0, LOOK), (5.0, OK)):
        facts = replace(FACTS, growth=Growth("feekes", 4, 6, stage))
        line = next(one for one in checks(None, 0.0, facts, "", None, METRIC) if one.label == "growth stage")
        assert line.level == level and "Feekes" in line.text


def test_the_jobs_dates_count_with_the_crops_weather(tmp_path):
    crop = load_setup("huanghai", "demo", dt.date(2014, 3, 7)).crop
    from drivers.files.kinds import CROP
    rows = "".join(f"{dt.date(2025, 11, 1) + dt.timedelta(days=k)},8.0\n" for k in range(150))
    (tmp_path / "w.csv").write_text("date,mean_temp_c\n" + rows)
    days = crop.days.model_copy(update={
        "count": None, "above_c": None, "weather": "w.csv", "sown": dt.date(2025, 11, 1)})
    save(tmp_path / "crop.yaml", crop.model_copy(update={"days": days}), CROP)
    demo = load("demo", JOB).model.model_copy(update={"crop": "crop.yaml"})
    for dates, count in (({}, 100), ({"sown": dt.date(2025, 11, 11)}, 90), ({"sensed": dt.date(2026, 1, 30)}, 90)):
        save(tmp_path / "job.yaml", demo.model_copy(update=dates), JOB)
        assert load_setup("huanghai", str(tmp_path / "job.yaml"), dt.date(2026, 2, 9)).rule.days == count
