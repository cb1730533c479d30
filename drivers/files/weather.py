"""How is daily weather read from a CSV file, and how are a crop's growing days counted from it?

Columns are `date` (2013-11-01) and either `mean_temp_c`, or `min_temp_c` and `max_temp_c`. The mean
is half of their sum, the rule of the published yield curves. Other columns are ignored; an empty
temperature is an unknown day.
"""

from __future__ import annotations

import csv
import datetime as dt
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.growing_days import count_days_above_base
from topdress.drivers.files.limits import CONFIG_LIMIT
from topdress.drivers.plain_text import OneLineError

# Range of air temperatures on earth, degC (WMO records: -89.2 and 56.7).
MIN_TEMP_C, MAX_TEMP_C = -90.0, 60.0


class WeatherError(OneLineError):
    """Reports an unusable weather file; the line names file, row, value and the permitted
    values."""


class Weather(NamedTuple):
    """Holds daily mean temperatures."""

    # Days (n,) in the order of the file.
    dates: npt.NDArray[np.datetime64]
    # Mean temperatures (n,), degC; NaN where unknown.
    mean_temp_c: npt.NDArray[np.float64]


def read_weather(path: Path) -> Weather:
    """Returns a weather file's days (UTF-8, with or without a byte order mark). Raises WeatherError
    in a line."""
    try:
        if path.stat().st_size > CONFIG_LIMIT.most:
            raise WeatherError(
                f"{path}: {path.stat().st_size} bytes: allowed up to {CONFIG_LIMIT.most} bytes"
            )
        lines = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except OSError as error:
        raise WeatherError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise WeatherError(f"{path}: is not a UTF-8 CSV file ({error})") from error
    if not lines:
        raise WeatherError(f"{path}: is empty; columns date and mean_temp_c are needed")
    header = [name.strip().lower() for name in lines[0]]
    wanted = _find_temperature_columns(path, header)
    dates: list[dt.date] = []
    temps: list[float] = []
    for number, cells in enumerate(lines[1:], start=2):
        if not any(cell.strip() for cell in cells):
            continue
        where = f"{path}: row {number}"
        if len(cells) < len(header):
            raise WeatherError(f"{where}: {len(cells)} cells, the header has {len(header)}")
        dates.append(_parse_date(where, cells[header.index("date")]))
        values = [_parse_temperature(where, name, cells[header.index(name)]) for name in wanted]
        # Exchanged columns give the same mean, but the file is wrong.
        if len(values) == 2 and values[0] > values[1]:
            raise WeatherError(
                f"{where}: min_temp_c {values[0]:g} is above max_temp_c {values[1]:g}"
            )
        temps.append(sum(values) / len(values))
    if not dates:
        raise WeatherError(f"{path}: no rows below the header")
    return Weather(np.array(dates, dtype="datetime64[D]"), np.array(temps, dtype=np.float64))


def count_growing_days(crop: Crop, folder: Path, today: dt.date) -> int | None:
    """Returns D of paper A, eq 4, for a crop: the number in its file, or a count by its own day
    rule from its weather file or of every day since sowing.

    Parameters
    ----------
    crop : crop with its rule of days.
    folder : folder of the crop file, where the weather file's relative path begins.
    today : day of work, and of sensing where the crop gives none.

    Returns
    -------
    None for a crop whose rule counts no days.

    Raises
    ------
    WeatherError : the days cannot be counted; the line names the reason.
    """
    days, curve = crop.days, crop.yield_potential
    if days is None or curve is None:
        return None
    if days.count is not None:
        return days.count
    if days.sown is None:
        raise WeatherError(f"crop {crop.id}: days: neither a count nor a date of sowing")
    sensed = days.sensed if days.sensed is not None else today
    if curve.base_temp_c == "every_day":
        if sensed <= days.sown:
            raise WeatherError(
                f"crop {crop.id}: days: sensed {sensed} is not after sown {days.sown}"
            )
        return (sensed - days.sown).days
    if days.weather is None:
        raise WeatherError(f"crop {crop.id}: days: neither a count nor weather with sown")
    path = folder / days.weather
    weather = read_weather(path)
    try:
        return count_days_above_base(
            weather.dates, weather.mean_temp_c, days.sown, sensed, curve.base_temp_c
        )
    except ValueError as error:
        raise WeatherError(f"{path}: {error}") from error


def _find_temperature_columns(path: Path, header: list[str]) -> list[str]:
    if "date" not in header:
        raise WeatherError(f"{path}: no column date; found {', '.join(header)}")
    if "mean_temp_c" in header:
        return ["mean_temp_c"]
    if "min_temp_c" in header and "max_temp_c" in header:
        return ["min_temp_c", "max_temp_c"]
    raise WeatherError(
        f"{path}: no column mean_temp_c, nor min_temp_c and max_temp_c; found {', '.join(header)}"
    )


def _parse_date(where: str, text: str) -> dt.date:
    try:
        return dt.date.fromisoformat(text.strip())
    except ValueError:
        raise WeatherError(
            f"{where}: date {text.strip()!r}: allowed is year-month-day, e.g. 2013-11-01"
        ) from None


def _parse_temperature(where: str, name: str, text: str) -> float:
    if not text.strip():
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not MIN_TEMP_C <= value <= MAX_TEMP_C:
        raise WeatherError(
            f"{where}: {name} {text.strip()!r}: allowed is {MIN_TEMP_C:g} to {MAX_TEMP_C:g} degC, "
            "or nothing"
        )
    return value
