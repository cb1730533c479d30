"""Weather files: what is read, and the one line said about what is not."""
from __future__ import annotations

import datetime as dt

import pytest

from control.agronomy.crop import Crop
from drivers.files.weather import WeatherError, growing_days, read_weather

TODAY = dt.date(2026, 3, 1)


@pytest.fixture
def file(tmp_path):
    def write(text: str, encoding: str = "utf-8"):
        path = tmp_path / "weather.csv"
        path.write_bytes(text.encode(encoding))
        return path
    return write


def test_mean_temperatures(file):
    weather = read_weather(file("date,rain_mm,mean_temp_c\n2013-11-01,0,12.5\n2013-11-02,3,\n\n2013-11-03,1,-2\n"))
    assert [str(day) for day in weather.dates] == ["2013-11-01", "2013-11-02", "2013-11-03"]
    assert weather.mean_temp_c.tolist()[::2] == [12.5, -2.0]
    assert weather.mean_temp_c[1] != weather.mean_temp_c[1]


def test_lowest_and_highest_with_a_byte_order_mark_and_crlf(file):
    path = file("Date,Min_temp_C,max_temp_c\r\n2013-11-01,2,10\r\n2013-11-02,,10\r\n", "utf-8-sig")
    weather = read_weather(path)
    assert weather.mean_temp_c[0] == 6.0
    assert weather.mean_temp_c[1] != weather.mean_temp_c[1]


@pytest.mark.parametrize(("text", "part"), [
    ("", "is empty"),
    ("date,mean_temp_c\n", "no rows"),
    ("day,mean_temp_c\n2013-11-01,5\n", "no column date; found day, mean_temp_c"),
    ("date,temp\n2013-11-01,5\n", "no column mean_temp_c"),
    ("date,mean_temp_c\n01.11.2013,5\n", r"row 2: date '01\.11\.2013': allowed is year-month-day"),
    ("date,mean_temp_c\n2013-11-01,5\n2013-11-02,warm\n", "row 3: mean_temp_c 'warm': allowed is -90 to 60"),
    ("date,mean_temp_c\n2013-11-01,-999\n", "row 2: mean_temp_c '-999'"),
    ("date,mean_temp_c\n2013-11-01,nan\n", "row 2"),
    ("date,mean_temp_c\n2013-11-01\n", "row 2: 1 cells, the header has 2"),
    ("date,min_temp_c,max_temp_c\n2013-11-01,9,3\n", "min_temp_c 9 is above max_temp_c 3"),
])
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
    folder = file("date,mean_temp_c\n" + "".join(
        f"2013-11-{day:02d},{temp}\n" for day, temp in enumerate([5, 3, 4.4, 4.5, -1, 9], start=1))).parent
    when = {"weather": "weather.csv", "sown": "2013-11-01", "sensed": "2013-11-07"}
    oklahoma = Crop.model_validate(crop_data("osu_winter_wheat_2004") | {"days": when})
    huanghai = Crop.model_validate(crop_data("huanghai_wheat") | {"days": when})
    assert growing_days(oklahoma, folder, TODAY) == 3
    assert growing_days(huanghai, folder, TODAY) == 5
    until_today = Crop.model_validate(crop_data("huanghai_wheat") | {"days": when | {"sensed": None}})
    assert growing_days(until_today, folder, dt.date(2013, 11, 3)) == 2
    with pytest.raises(WeatherError, match=r"weather\.csv: no mean temperature for .* days"):
        growing_days(until_today, folder, dt.date(2013, 12, 1))


def test_a_written_count_needs_no_file(tmp_path, crop_data):
    assert growing_days(Crop.model_validate(crop_data("huanghai_wheat")), tmp_path, TODAY) == 82
