"""The stage for which a crop's rule was made: warned of at check, at START and in the report;
never a stop."""

from __future__ import annotations

import datetime as dt

import numpy as np
import pytest
from pydantic import ValidationError
from topdress.console.app.pages.job.checklist import LOOK, OK, list_checks
from topdress.console.app.units import METRIC
from topdress.console.reports.job_metadata import JobMetadata, find_job_events, format_names
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.growing_days import count_days_above_base
from topdress.control.agronomy.growth_stage import (
    GrowthStage,
    GrowthStageComparison,
    GrowthWindow,
    assess_growth,
)
from topdress.control.log_row import LogRow
from topdress.control.orders import Do, Order
from topdress.drivers.files.config import load_config, save_config
from topdress.drivers.files.config_kinds import JOB_KIND
from topdress.drivers.files.run_setup import load_setup
from topdress.drivers.files.weather import WeatherError, count_growing_days, read_weather

from tests.app.made_up.job import facts_of
from tests.command import topdress
from tests.control_loop.closed import SETUP, Closed

FEEKES = GrowthWindow(scale="feekes", first=4, last=6)


def test_in_the_crop_files_own_terms():
    def stage(scale: str, at: float) -> GrowthStage:
        return GrowthStage(scale=scale, stage=at)

    assert assess_growth(None, stage("feekes", 5), 90) is None
    assert [
        assess_growth(FEEKES, stage("feekes", at), 90).is_outside for at in (3.9, 4, 5, 6, 6.1)
    ] == [True, False, False, False, True]
    assert (
        assess_growth(FEEKES, stage("bbch", 31), 90)
        == assess_growth(FEEKES, None, 90)
        == GrowthStageComparison("feekes", 4, 6, None)
    )
    days = GrowthWindow(scale="days", first=87, last=112)
    assert [assess_growth(days, None, count).is_outside for count in (86, 87, 112, 113)] == [
        True,
        False,
        False,
        True,
    ]


@pytest.mark.parametrize(
    "wrong",
    [
        {"scale": "feekes", "first": 6, "last": 4},
        {"scale": "bbch", "first": 20, "last": 120},
        {"scale": "weeks", "first": 1, "last": 2},
    ],
)
def test_windows_that_are_none(wrong):
    with pytest.raises(ValidationError):
        GrowthWindow.model_validate(wrong)


def ticks(growth: GrowthStage | None):
    crop = SETUP.crop.model_copy(update={"growth_window": FEEKES})
    closed = Closed(sim={"begin_m": 30.0}, known={"crop": crop}, growth=growth)
    return [
        step.tick for step in closed.through(25.0, [(0.2, Order(Do.READY)), (3.0, Order(Do.START))])
    ]


@pytest.mark.exam
def test_a_start_beyond_the_window_is_said_and_works():
    seen = ticks(GrowthStage(scale="feekes", stage=8))
    events = [tick.row.events for tick in seen if tick.row.events and "growth" in tick.row.events]
    assert events == ["growth_stage_outside feekes 8 (4 to 6);start"]
    noted = [tick.row.time_s for tick in seen if "growth_stage_outside" in tick.notes]
    assert 2.9 < noted[0] < 3.2 and 17.0 < noted[-1] < 18.5
    assert seen[-1].row.state == "working" and seen[-1].command.shaft_rpm > 5.0, "never a stop"
    for stage in (None, GrowthStage(scale="feekes", stage=5)):
        assert not [
            tick
            for tick in ticks(stage)
            if "growth" in (tick.row.events or "") or tick.notes == ("growth_stage_outside",)
        ]


def test_the_report_says_it():
    class Log:
        def rows(self):
            return iter(
                [
                    LogRow(0.0, state="ready"),
                    LogRow(
                        1.0, state="working", events="growth_stage_outside feekes 8 (4 to 6);start"
                    ),
                ]
            )

    told = find_job_events(Log())
    assert told.growth == "feekes 8 (4 to 6)"
    assert "rule: feekes 8 (4 to 6)" in format_names(JobMetadata(happened=told), "urea")
    assert "Growth stage" not in format_names(JobMetadata(), "urea")


def test_check_says_it(tmp_path):
    demo = load_config("demo", JOB_KIND).model.model_copy(update={"crop": "osu_winter_wheat_2007"})
    for growth, said in (
        (None, "growth stage not said"),
        (GrowthStage(scale="feekes", stage=8), "feekes 8 is outside"),
        (GrowthStage(scale="feekes", stage=5), ""),
    ):
        save_config(tmp_path / "job.yaml", demo.model_copy(update={"growth": growth}), JOB_KIND)
        result = topdress("check", tmp_path / "job.yaml")
        assert (
            result.exit_code == 0
            and ("growth stage" in result.output) == bool(said)
            and said in result.output
        )
    save_config(
        tmp_path / "job.yaml",
        demo.model_copy(update={"ndvi_nrich": 0.5, "ndvi_check": 0.55}),
        JOB_KIND,
    )
    assert "response index 0.91: no response" in topdress("check", tmp_path / "job.yaml").output


def test_the_list_before_work_says_it():
    for stage, level in ((None, LOOK), (8.0, LOOK), (5.0, OK)):
        seen = None if stage is None else GrowthStage(scale="feekes", stage=stage)
        facts = facts_of(
            {"growth_window": GrowthWindow(scale="feekes", first=4, last=6)}, {"growth": seen}
        )
        line = next(
            one
            for one in list_checks(None, 0.0, facts, "", None, METRIC)
            if one.label == "growth stage"
        )
        assert line.level == level and "Feekes" in line.text


def test_the_jobs_dates_count_with_the_crops_weather(tmp_path):
    crop = load_setup("huanghai", "demo", dt.date(2014, 3, 7)).crop
    from topdress.drivers.files.config_kinds import CROP_KIND

    rows = "".join(f"{dt.date(2025, 11, 1) + dt.timedelta(days=k)},8.0\n" for k in range(150))
    (tmp_path / "w.csv").write_text("date,mean_temp_c\n" + rows)
    days = crop.days.model_copy(
        update={"count": None, "above_c": None, "weather": "w.csv", "sown": dt.date(2025, 11, 1)}
    )
    save_config(tmp_path / "crop.yaml", crop.model_copy(update={"days": days}), CROP_KIND)
    demo = load_config("demo", JOB_KIND).model.model_copy(update={"crop": "crop.yaml"})
    for dates, count in (
        ({}, 100),
        ({"sown": dt.date(2025, 11, 11)}, 90),
        ({"sensed": dt.date(2026, 1, 30)}, 90),
    ):
        save_config(tmp_path / "job.yaml", demo.model_copy(update=dates), JOB_KIND)
        assert (
            load_setup("huanghai", str(tmp_path / "job.yaml"), dt.date(2026, 2, 9)).rule.days
            == count
        )


# --- Growing days: the count, and what is refused rather than guessed
# ------------------------------------------------

SOWN, SENSED = dt.date(2013, 11, 1), dt.date(2014, 3, 7)


def season(temps: list[float], start: str = "2013-11-01") -> tuple[np.ndarray, np.ndarray]:
    return np.datetime64(start) + np.arange(len(temps)), np.array(temps, dtype=float)


def test_counts_days_strictly_above_the_base():
    dates, temps = season([5.0, 4.4, 4.41, -1.0, 9.0])
    assert count_days_above_base(dates, temps, SOWN, dt.date(2013, 11, 6), 4.4) == 3
    assert count_days_above_base(dates, temps, SOWN, dt.date(2013, 11, 6), 0.0) == 4


def test_sowing_day_counts_sensing_day_does_not():
    dates, temps = season([10.0] * 10)
    assert count_days_above_base(dates, temps, dt.date(2013, 11, 3), dt.date(2013, 11, 7), 0.0) == 4


def test_the_papers_season_has_82_days():
    """126 days from 1 November to 7 March; a made-up winter with 44 of them at or below zero."""
    dates, temps = season([3.0] * 60 + [-2.0] * 44 + [5.0] * 40)
    assert count_days_above_base(dates, temps, SOWN, SENSED, 0.0) == 82


def test_order_does_not_matter():
    dates, temps = season([5.0, -1.0, 7.0, -3.0])
    shuffled = np.array([2, 0, 3, 1])
    assert (
        count_days_above_base(dates[shuffled], temps[shuffled], SOWN, dt.date(2013, 11, 5), 0.0)
        == 2
    )


@pytest.mark.parametrize(
    ("temps", "part"),
    [
        (
            [5.0, 5.0],
            "no mean temperature for 2 of the 4 days from 2013-11-01 to 2013-11-05, the "
            "first is 2013-11-03",
        ),
        (
            [5.0, float("nan"), 5.0, 5.0],
            "for 1 of the 4 days from 2013-11-01 to 2013-11-05, the first is 2013-11-02",
        ),
        ([-5.0] * 4, "no day .* above 0 degC"),
    ],
)
def test_what_is_not_known_is_not_guessed(temps, part):
    dates, values = season(temps)
    with pytest.raises(ValueError, match=part):
        count_days_above_base(dates, values, SOWN, dt.date(2013, 11, 5), 0.0)


def test_doubled_date_and_backward_span_are_refused():
    dates, temps = season([5.0] * 4)
    dates[2] = dates[1]
    with pytest.raises(ValueError, match="2013-11-02 stands twice"):
        count_days_above_base(dates, temps, SOWN, dt.date(2013, 11, 5), 0.0)
    with pytest.raises(ValueError, match="not after sown"):
        count_days_above_base(dates, temps, SENSED, SOWN, 0.0)
    with pytest.raises(ValueError, match="4 dates but 3"):
        count_days_above_base(dates, temps[:3], SOWN, SENSED, 0.0)


# --- Weather files: what is read, and the one line said about what is not
# --------------------------------------------

TODAY = dt.date(2026, 3, 1)


@pytest.fixture
def file(tmp_path):
    def write(text: str, encoding: str = "utf-8"):
        path = tmp_path / "weather.csv"
        path.write_bytes(text.encode(encoding))
        return path

    return write


def test_mean_temperatures(file):
    weather = read_weather(
        file("date,rain_mm,mean_temp_c\n2013-11-01,0,12.5\n2013-11-02,3,\n\n2013-11-03,1,-2\n")
    )
    assert [str(day) for day in weather.dates] == ["2013-11-01", "2013-11-02", "2013-11-03"]
    assert weather.mean_temp_c.tolist()[::2] == [12.5, -2.0]
    assert weather.mean_temp_c[1] != weather.mean_temp_c[1]


def test_lowest_and_highest_with_a_byte_order_mark_and_crlf(file):
    path = file("Date,Min_temp_C,max_temp_c\r\n2013-11-01,2,10\r\n2013-11-02,,10\r\n", "utf-8-sig")
    weather = read_weather(path)
    assert weather.mean_temp_c[0] == 6.0
    assert weather.mean_temp_c[1] != weather.mean_temp_c[1]


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "is empty"),
        ("date,mean_temp_c\n", "no rows"),
        ("day,mean_temp_c\n2013-11-01,5\n", "no column date; found day, mean_temp_c"),
        ("date,temp\n2013-11-01,5\n", "no column mean_temp_c"),
        (
            "date,mean_temp_c\n01.11.2013,5\n",
            r"row 2: date '01\.11\.2013': allowed is year-month-day",
        ),
        (
            "date,mean_temp_c\n2013-11-01,5\n2013-11-02,warm\n",
            "row 3: mean_temp_c 'warm': allowed is -90 to 60",
        ),
        ("date,mean_temp_c\n2013-11-01,-999\n", "row 2: mean_temp_c '-999'"),
        ("date,mean_temp_c\n2013-11-01,nan\n", "row 2"),
        ("date,mean_temp_c\n2013-11-01\n", "row 2: 1 cells, the header has 2"),
        ("date,min_temp_c,max_temp_c\n2013-11-01,9,3\n", "min_temp_c 9 is above max_temp_c 3"),
    ],
)
def test_refusals_name_file_and_row(file, text, part):
    path = file(text)
    with pytest.raises(WeatherError, match=part) as caught:
        read_weather(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_no_file_and_no_text(tmp_path, file):
    with pytest.raises(WeatherError, match="cannot be read"):
        read_weather(tmp_path / "none.csv")
    with pytest.raises(WeatherError, match="not a UTF-8"):
        read_weather(file("date,mean_temp_c\n2013-11-01,5\n", "utf-16"))


def test_a_crop_counts_by_its_own_day_rule(file, crop_data):
    folder = file(
        "date,mean_temp_c\n"
        + "".join(
            f"2013-11-{day:02d},{temp}\n"
            for day, temp in enumerate([5, 3, 4.4, 4.5, -1, 9], start=1)
        )
    ).parent
    when = {"weather": "weather.csv", "sown": "2013-11-01", "sensed": "2013-11-07"}
    oklahoma = Crop.model_validate(crop_data("osu_winter_wheat_2004") | {"days": when})
    huanghai = Crop.model_validate(crop_data("huanghai_wheat") | {"days": when})
    assert count_growing_days(oklahoma, folder, TODAY) == 3
    assert count_growing_days(huanghai, folder, TODAY) == 5
    until_today = Crop.model_validate(
        crop_data("huanghai_wheat") | {"days": when | {"sensed": None}}
    )
    assert count_growing_days(until_today, folder, dt.date(2013, 11, 3)) == 2
    with pytest.raises(WeatherError, match=r"weather\.csv: no mean temperature for .* days"):
        count_growing_days(until_today, folder, dt.date(2013, 12, 1))


def test_a_written_count_needs_no_file(tmp_path, crop_data):
    assert (
        count_growing_days(Crop.model_validate(crop_data("huanghai_wheat")), tmp_path, TODAY) == 82
    )
