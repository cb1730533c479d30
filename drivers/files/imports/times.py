"""The times of a foreign table: texts of any format and zone, counts of seconds or days, as
whole microseconds."""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

import polars as pl

from control.recordings.times import SPREADSHEET_DAYS, SPREADSHEET_EPOCH_DAYS
from drivers.files.imports.mapping import Times
from drivers.files.imports.numbers import numbers
from drivers.files.imports.raw import RawTable
from drivers.files.imports.trouble import ImportTrouble

ISO = "%Y-%m-%d %H:%M:%S%.f"
_OFFSET = r":\d{2}(?:\.\d+)?\s*(Z|z|[+-]\d{2}:?\d{2})$"
_DAY_US = 86_400_000_000
_STEPS_US = {
    "s": 1e6,
    "ms": 1e3,
    "us": 1.0,
    "min": 60e6,
    "h": 3600e6,
    "unix_s": 1e6,
    "unix_ms": 1e3,
    "unix_us": 1.0,
}
_PARTS = re.compile(r"%\.?[A-Za-z]")
_DIGITS = {"%Y": 4, "%y": 2, "%m": 2, "%d": 2, "%H": 2, "%M": 2, "%S": 2}
# fewer readable times than this share: the format is wrong
_GOOD = 0.5


class FileClock(NamedTuple):
    """`us`: Int64, null: not known. `kind`: since 1970 in UTC; since 1970 in local time of no
    known zone; or counted from some moment of the file's own."""

    us: pl.Series
    kind: Literal["utc", "local", "relative"]


def clock(table: RawTable, times: Times) -> FileClock:
    """Raises ImportTrouble where the column is not there or most of its cells are no such time."""
    if times.counts == "rows":
        assert times.step_s is not None
        step_us = round(times.step_s * 1e6)
        return FileClock(pl.Series("us", range(table.frame.height), pl.Int64) * step_us, "relative")
    assert times.column is not None
    series = table.frame[times.column]
    if series.dtype.is_temporal() and series.dtype != pl.Time:
        return _of_datetimes(series, times.zone)
    if times.counts == "text":
        found = read_texts(_joined(table, times), times.format, times.zone)
        _check(table, times, found.us)
        return found
    found_numbers = numbers(series, table.decimal_comma).values
    if times.counts == "excel_day":
        ms = (
            ((found_numbers - SPREADSHEET_EPOCH_DAYS) * (_DAY_US / 1000))
            .round(0)
            .cast(pl.Int64, strict=False)
        )
        found = _of_naive(ms * 1000, times.zone)
    else:
        us = (found_numbers * _STEPS_US[times.counts]).round(0).cast(pl.Int64, strict=False)
        found = FileClock(us, "utc" if times.counts.startswith("unix") else "relative")
    _check(table, times, found.us)
    return found


def read_texts(texts: pl.Series, form: str | None, zone: str | None) -> FileClock:
    """Times written as texts; an offset at their end (Z, +08:00) stands above `zone`. `form`
    None: ISO 8601."""
    frame = (
        texts.cast(pl.String)
        .alias("t")
        .to_frame()
        .select(pl.col("t").str.strip_chars().str.replace(r"(\d{2}),(\d{1,6})", "${1}.${2}"))
    )
    frame = frame.with_columns(
        offset=pl.col("t").str.extract(_OFFSET, 1),
        base=pl.col("t").str.replace(r"\s*(Z|z|(:\d{2}(?:\.\d+)?)\s*[+-]\d{2}:?\d{2})$", "${2}"),
    )
    base = frame["base"]
    if form is None:
        base = base.str.replace("T", " ", literal=True).str.replace_all("/", "-", literal=True)
        base = base.str.replace(r"^(\S+ \d{1,2}:\d{2})$", "${1}:00")
    if not re.search(r"%[djyYF]", form or ISO):
        us = _parsed("1970-01-01 " + base, f"%Y-%m-%d {form}")
        days = (us.forward_fill().diff().fill_null(0) < -_DAY_US // 2).cast(pl.Int64).cum_sum()
        # times of day go on past midnight
        return FileClock(us + days * _DAY_US, "relative")
    us = _parsed(base, form or ISO)
    if frame["offset"].is_not_null().any():
        return FileClock(us - _offset_us(frame["offset"]), "utc")
    return _of_naive(us, zone)


def _joined(table: RawTable, times: Times) -> pl.Series:
    assert times.column is not None
    day_form, _, time_form = (times.format or ISO).rpartition(" ")
    column = texts_for(table.frame[times.column], time_form)
    if times.date_column is None:
        return column
    return with_day(table.frame[times.date_column], column, day_form)


def with_day(day: pl.Series, time: pl.Series, day_form: str) -> pl.Series:
    """Texts of a day and of a time of day as one; `day_form`: how the day is written."""
    if day.dtype.is_temporal():
        texts = day.dt.strftime("%Y-%m-%d")
    else:
        whole = _whole(day) if _PARTS.sub("", day_form) else None
        texts = texts_for(day, day_form) if whole is None else _of_spreadsheet(whole)
    both = pl.DataFrame({"day": texts.str.strip_chars(), "time": time.str.strip_chars()})
    return both.select((pl.col("day") + " " + pl.col("time")).alias(time.name)).to_series()


def texts_for(series: pl.Series, form: str) -> pl.Series:
    """Texts as they stand. Numbers that stand for digits run together (%Y%m%d, %H%M%S) with the
    zeros before them."""
    width = sum(_DIGITS.get(part, 0) for part in _PARTS.findall(form))
    if not width or _PARTS.sub("", form):
        return series.cast(pl.String)
    if "%.f" in form and series.dtype == pl.Float64:
        ms = (
            (series * 1000.0)
            .round(0)
            .cast(pl.Int64, strict=False)
            .cast(pl.String)
            .str.zfill(width + 3)
        )
        return ms.str.head(-3) + "." + ms.str.tail(3)
    whole = _whole(series)
    return series.cast(pl.String) if whole is None else whole.cast(pl.String).str.zfill(width)


def _whole(series: pl.Series) -> pl.Series | None:
    """Whole numbers, of which none is below 0; None where the column holds others."""
    if series.dtype == pl.String:
        texts = series.str.strip_chars()
        series = texts.set(texts == "", None).cast(pl.Float64, strict=False)
        if series.null_count() > (texts == "").sum() + texts.null_count():
            return None
    known = series.drop_nulls()
    if not known.len() or not ((known == known.round(0)) & (known >= 0)).all():
        return None
    return series.cast(pl.Int64, strict=False)


def _of_spreadsheet(whole: pl.Series) -> pl.Series:
    """Numbers where the form has a day with signs between: days as spreadsheets count them."""
    whole = whole.set(~whole.is_between(*SPREADSHEET_DAYS).fill_null(True), None)
    return (
        (whole - SPREADSHEET_EPOCH_DAYS)
        .cast(pl.Int32, strict=False)
        .cast(pl.Date)
        .dt.strftime("%Y-%m-%d")
    )


def _parsed(texts: pl.Series, form: str) -> pl.Series:
    try:
        return texts.str.to_datetime(form, time_unit="us", strict=False).cast(pl.Int64)
    except pl.exceptions.PolarsError:
        raise ImportTrouble(
            "", f"time.format {form}: not a format; allowed e.g. %d.%m.%Y %H:%M:%S"
        ) from None


def _offset_us(offsets: pl.Series) -> pl.Series:
    digits = offsets.str.replace_all(r"[^0-9]", "")
    minutes = digits.str.slice(0, 2).cast(pl.Int64, strict=False).fill_null(
        0
    ) * 60 + digits.str.slice(2, 2).cast(pl.Int64, strict=False).fill_null(0)
    sign = pl.select(pl.when(offsets.str.starts_with("-")).then(-1).otherwise(1)).to_series()
    return minutes * sign * 60_000_000


def _of_datetimes(series: pl.Series, zone: str | None) -> FileClock:
    stamped = (
        series.cast(pl.Datetime("us"))
        if series.dtype == pl.Date
        else series.dt.cast_time_unit("us")
    )
    aware = isinstance(stamped.dtype, pl.Datetime) and stamped.dtype.time_zone is not None
    us = stamped.dt.timestamp("us")
    return FileClock(us, "utc") if aware else _of_naive(us, zone)


def _of_naive(us: pl.Series, zone: str | None) -> FileClock:
    if zone is None:
        return FileClock(us, "local")
    fixed = re.fullmatch(r"([-+])(\d{2}):(\d{2})", zone)
    if fixed:
        minutes = int(fixed[2]) * 60 + int(fixed[3])
        return FileClock(us - (-1 if fixed[1] == "-" else 1) * minutes * 60_000_000, "utc")
    # In autumn an hour comes twice: what stands before the step back is its first, what follows
    # its second.
    back = (us.diff().fill_null(0) < 0).cast(pl.Int64).cum_sum() > 0
    frame = pl.DataFrame({"t": us.cast(pl.Datetime("us")), "back": back})
    which = pl.when(pl.col("back")).then(pl.lit("latest")).otherwise(pl.lit("earliest"))
    placed = frame.select(
        pl.col("t").dt.replace_time_zone(zone, ambiguous=which, non_existent="null")
    )["t"]
    return FileClock(placed.dt.timestamp("us"), "utc")


def _check(table: RawTable, times: Times, us: pl.Series) -> None:
    known = us.is_not_null().sum()
    if known > _GOOD * us.len():
        return
    assert times.column is not None
    row = int(us.is_null().arg_true()[0])
    cell = table.frame[times.column][row]
    form = times.format or (
        "ISO 8601, e.g. 2026-03-20T08:00:00Z" if times.counts == "text" else "a number"
    )
    said = " (time.format says so)" if times.format else ""
    raise ImportTrouble(
        table.path,
        f"row {table.first_row + row}: column {times.column}: value {cell}: allowed {form}{said}",
    )
