"""How are the times of a foreign table read as whole microseconds? They may be texts of any format
and zone, or counts of seconds or days.
"""

from __future__ import annotations

import datetime as dt
import re
from typing import Any, Literal, NamedTuple
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray
from topdress.control.recordings.row_times import SPREADSHEET_DAYS, SPREADSHEET_EPOCH_DAYS
from topdress.drivers.files.columns import (
    MAX_BLOCK_ROWS,
    count_microseconds,
    count_rows,
    format_numbers,
    is_number_column,
    is_text_column,
    is_time_column,
    make_text_column,
    map_texts,
)
from topdress.drivers.files.imports.cell_numbers import parse_number_column, parse_plain_numbers
from topdress.drivers.files.imports.import_errors import LogImportError
from topdress.drivers.files.imports.mapping import Times
from topdress.drivers.files.imports.raw_table import RawTable
from topdress.drivers.files.imports.time_format import DAY_PARTS, parse_times

# ISO 8601 with a blank in place of its T.
ISO_FORMAT = "%Y-%m-%d %H:%M:%S%.f"
# An offset from UTC after a time.
_ZONE_OFFSET = re.compile(r"(:\d{2}(?:\.\d+)?)?\s*(Z|z|[+-]\d{2}:?\d{2})$")
# Seconds with a decimal comma.
_DECIMAL_COMMA = re.compile(r"(\d{2}),(\d{1,6})")
# A date with hours and minutes.
_WITHOUT_SECONDS = re.compile(r"(\S+ \d{1,2}:\d{2})")
_DAY_US = 86_400_000_000
_MINUTE_US = 60_000_000
# Microseconds of each unit.
_US_OF_UNIT = {
    "s": 1e6,
    "ms": 1e3,
    "us": 1.0,
    "min": 60e6,
    "h": 3600e6,
    "unix_s": 1e6,
    "unix_ms": 1e3,
    "unix_us": 1.0,
    "unix_ns": 1e-3,
}
_FORMAT_PARTS = re.compile(r"%\.?[A-Za-z]")
# Number of digits of each part of a format without separators.
_PART_DIGITS = {"%Y": 4, "%y": 2, "%m": 2, "%d": 2, "%H": 2, "%M": 2, "%S": 2}
# Share of readable times below which the format is wrong.
_MIN_READABLE_TIME_SHARE = 0.5

Floats = NDArray[np.float64]


class FileClock(NamedTuple):
    """Holds a file's times. `us` are whole microseconds, NaN for unknown. `kind` is "utc" (since
    1970 in UTC), "local" (since 1970 in local time of an unknown zone) or "relative" (since an
    unknown start)."""

    us: Floats
    kind: Literal["utc", "local", "relative"]


def read_row_times(table: RawTable, times: Times) -> FileClock:
    """Returns the times of a table's rows.

    Parameters
    ----------
    table : the table as the file holds it.
    times : the column with the time, and its format.

    Returns
    -------
    (n,) whole microseconds.

    Raises
    ------
    LogImportError : most cells of the column are no such time.
    """
    if times.counts == "rows":
        assert times.step_s is not None
        step_us = round(times.step_s * 1e6)
        return FileClock(
            np.arange(count_rows(table.columns), dtype=np.float64) * step_us, "relative"
        )
    assert times.column is not None
    column = table.columns[times.column]
    if is_time_column(column):
        us = count_microseconds(column)
        return (
            FileClock(us, "utc") if times.column in table.utc else _apply_time_zone(us, times.zone)
        )
    if times.counts == "text":
        found = read_time_texts(_join_day_and_time(table, times), times.format, times.zone)
        _check_read_times(table, times, found.us)
        return found
    found_numbers = parse_number_column(column, table.decimal_comma).values
    if times.counts == "excel_day":
        # Days as doubles are exact to microseconds; rounding to milliseconds removes their error.
        ms = np.round((found_numbers - SPREADSHEET_EPOCH_DAYS) * (_DAY_US / 1000))
        found = _apply_time_zone(ms * 1000.0, times.zone)
    else:
        us = np.round(found_numbers * _US_OF_UNIT[times.counts])
        found = FileClock(us, "utc" if times.counts.startswith("unix") else "relative")
    _check_read_times(table, times, found.us)
    return found


def read_time_texts(column: NDArray[Any], form: str | None, zone: str | None) -> FileClock:
    """Returns times written as texts; an offset at their end (Z, +08:00) overrides `zone`. `form`
    None means ISO 8601."""
    starts = range(0, max(len(column), 1), MAX_BLOCK_ROWS)
    blocks = [_read_time_block(column[start : start + MAX_BLOCK_ROWS], form) for start in starts]
    us = np.concatenate([block.us for block in blocks])
    if not DAY_PARTS.search(form or ISO_FORMAT):
        # Times of day continue after midnight with the next day.
        days = np.cumsum(np.diff(_fill_forward(us), prepend=np.nan) < -_DAY_US // 2)
        return FileClock(us + days * float(_DAY_US), "relative")
    offsets_us = np.concatenate([block.offsets_us for block in blocks])
    if np.isnan(offsets_us).all():
        return _apply_time_zone(us, zone)
    return FileClock(us - np.nan_to_num(offsets_us), "utc")


class _TimeBlock(NamedTuple):
    """Holds times of a block. `offsets_us` is (n,), NaN where a text has none."""

    us: Floats
    offsets_us: Floats


def _read_time_block(column: NDArray[Any], form: str | None) -> _TimeBlock:
    """Returns the times of a block of texts, with their offsets."""
    texts = [text.strip() for text in convert_to_texts(column).tolist()]
    if any("," in text for text in texts):
        texts = [_DECIMAL_COMMA.sub(r"\1.\2", text, count=1) for text in texts]
    ends = [_ZONE_OFFSET.search(text) for text in texts]
    offsets = [end[2] if end and end[1] else "" for end in ends]
    bases = [
        text[: end.start()] + (end[1] or "") if end and (end[1] or end[2] in "Zz") else text
        for text, end in zip(texts, ends, strict=True)
    ]
    if form is None:
        bases = [text.replace("T", " ", 1).replace("/", "-") for text in bases]
        bases = [f"{text}:00" if _WITHOUT_SECONDS.fullmatch(text) else text for text in bases]
    worth = {offset: _parse_offset_us(offset) if offset else np.nan for offset in set(offsets)}
    return _TimeBlock(
        parse_times(bases, form or ISO_FORMAT), np.array([worth[one] for one in offsets])
    )


def convert_to_texts(column: NDArray[Any]) -> NDArray[Any]:
    """Returns a column as texts."""
    return make_text_column(format_numbers(column)) if is_number_column(column) else column


def _fill_forward(us: Floats) -> Floats:
    """Returns values (n,) with the last known value in place of unknown values."""
    last = np.maximum.accumulate(np.where(np.isnan(us), 0, np.arange(len(us))))
    return us[last]


def _join_day_and_time(table: RawTable, times: Times) -> NDArray[Any]:
    """Returns the texts of times, joined with their date where it has its own column."""
    assert times.column is not None
    day_form, _, time_form = (times.format or ISO_FORMAT).rpartition(" ")
    column = format_for_time(table.columns[times.column], time_form)
    if times.date_column is None:
        return column
    return join_day_texts(table.columns[times.date_column], column, day_form)


def join_day_texts(day: NDArray[Any], time: NDArray[Any], day_form: str) -> NDArray[Any]:
    """Returns texts of date and time of day joined, empty where either is unknown; `day_form` is
    the format of the date."""
    if is_time_column(day):
        texts = _format_iso_days(day)
    else:
        whole = _find_whole_numbers(day) if _FORMAT_PARTS.sub("", day_form) else None
        texts = (
            format_for_time(day, day_form) if whole is None else _convert_spreadsheet_days(whole)
        )
    return make_text_column(
        [
            f"{one.strip()} {other.strip()}" if one and other else ""
            for one, other in zip(texts.tolist(), time.tolist(), strict=True)
        ]
    )


def format_for_time(column: NDArray[Any], form: str) -> NDArray[Any]:
    """Returns texts unchanged, and numbers without separators (%Y%m%d, %H%M%S) with
    leading zeros."""
    width = sum(_PART_DIGITS.get(part, 0) for part in _FORMAT_PARTS.findall(form))
    if not width or _FORMAT_PARTS.sub("", form):
        return convert_to_texts(column)
    if "%.f" in form and is_number_column(column):
        return map_texts(
            lambda ms: ms and f"{ms[:-3]}.{ms[-3:]}", _format_digits(column * 1e3, width + 3)
        )
    whole = _find_whole_numbers(column)
    return convert_to_texts(column) if whole is None else _format_digits(whole, width)


def _format_digits(column: Floats, width: int) -> NDArray[Any]:
    """Returns integers with leading zeros, as texts."""
    return make_text_column(
        ["" if value != value else f"{round(value):0{width}d}" for value in column.tolist()]
    )


def _find_whole_numbers(column: NDArray[Any]) -> Floats | None:
    """Returns non-negative integers; None where the column holds other values."""
    if is_text_column(column):
        found = parse_plain_numbers([text.strip() for text in column.tolist()])
        if found is None:
            return None
        column = found
    known = column[~np.isnan(column)]
    if not known.size or not ((known == np.round(known)) & (known >= 0)).all():
        return None
    return column


def _convert_spreadsheet_days(whole: Floats) -> NDArray[Any]:
    """Returns ISO dates of spreadsheet day numbers."""
    first, last = SPREADSHEET_DAYS
    days = np.where((whole >= first) & (whole <= last), whole - SPREADSHEET_EPOCH_DAYS, np.nan)
    return _format_iso_days(_convert_to_dates(days))


def _convert_to_dates(days: Floats) -> NDArray[np.datetime64]:
    """Returns dates of days since 1970."""
    known = np.nan_to_num(days).astype(np.int64).astype("datetime64[D]")
    return np.where(np.isnan(days), np.datetime64("NaT", "D"), known)


def _format_iso_days(times: NDArray[Any]) -> NDArray[Any]:
    """Returns dates in ISO 8601; empty for unknown dates."""
    days = np.datetime_as_string(times.astype("datetime64[D]"))
    return make_text_column(["" if day == "NaT" else day for day in days.tolist()])


def _parse_offset_us(offset: str) -> float:
    """Returns an offset such as +08:00, -0330 or Z, microseconds."""
    digits = offset.replace(":", "")[1:]
    if not digits:
        return 0.0
    minutes = int(digits[:2]) * 60 + int(digits[2:])
    return float(-minutes if offset.startswith("-") else minutes) * _MINUTE_US


def _apply_time_zone(us: Floats, zone: str | None) -> FileClock:
    """Returns times of a zone in UTC; without a zone they stay local."""
    if zone is None:
        return FileClock(us, "local")
    fixed = re.fullmatch(r"([-+])(\d{2}):(\d{2})", zone)
    if fixed:
        return FileClock(us - _parse_offset_us(zone), "utc")
    # In autumn an hour occurs twice: rows before the step back belong to its first occurrence, rows
    # after it to its second.
    is_second = np.cumsum(np.diff(us, prepend=np.nan) < 0.0) > 0
    # Clocks are changed at whole minutes.
    minutes, place = np.unique(us // _MINUTE_US, return_inverse=True)
    first, second = (
        np.array([_find_zone_offsets_us(minute, ZoneInfo(zone)) for minute in minutes.tolist()])
        .reshape(-1, 2)[place]
        .T
    )
    return FileClock(us - np.where(is_second, second, first), "utc")


def _find_zone_offsets_us(minute: float, zone: ZoneInfo) -> tuple[float, float]:
    """Returns the offsets from UTC to a local minute since 1970, microseconds, for its first and
    its second occurrence in the zone; NaN where it never occurs."""
    try:
        local = dt.datetime(1970, 1, 1) + dt.timedelta(minutes=minute)
    except (OverflowError, ValueError):
        return np.nan, np.nan
    first, second = (
        (local.replace(tzinfo=zone, fold=fold).utcoffset() or dt.timedelta()).total_seconds() * 1e6
        for fold in (0, 1)
    )
    return (first, second) if first >= second else (np.nan, np.nan)


def _check_read_times(table: RawTable, times: Times, us: Floats) -> None:
    """Refuses times of which most cannot be read. Raises LogImportError."""
    unknown = np.isnan(us)
    if (~unknown).sum() > _MIN_READABLE_TIME_SHARE * us.size:
        return
    assert times.column is not None
    row = int(np.flatnonzero(unknown)[0])
    cell = table.columns[times.column][row]
    cell = "(empty)" if cell == "" else cell
    form = times.format or (
        "ISO 8601, e.g. 2026-03-20T08:00:00Z" if times.counts == "text" else "a number"
    )
    said = " (time.format says so)" if times.format else ""
    raise LogImportError(
        table.path,
        f"row {table.first_row + row}: column {times.column}: value {cell}: allowed {form}{said}",
    )
