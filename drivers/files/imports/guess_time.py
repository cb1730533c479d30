"""Which column holds the time, and in which format? Name, unit, texts and numbers decide."""

from __future__ import annotations

import re
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.drivers.files.columns import (
    calc_median,
    count_differences,
    is_text_column,
    is_time_column,
    select_known,
)
from topdress.drivers.files.imports.cell_numbers import parse_number_column
from topdress.drivers.files.imports.column_vocabulary import (
    COMMAND_WORDS,
    DATE_WORDS,
    PLAIN_TIME_WORDS,
    TIME_EXCLUDING_WORDS,
    TIME_WORDS,
    UTC_WORDS,
    find_subject,
    fold_column_name,
    has_any_word,
)
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.imports.mapping import CountedTimeUnit, Times
from topdress.drivers.files.imports.raw_table import RawTable
from topdress.drivers.files.imports.table_header import split_unit_name
from topdress.drivers.files.imports.time_cells import (
    format_for_time,
    join_day_texts,
    read_time_texts,
)
from topdress.drivers.files.imports.units import find_named_unit

# Formats of dates, the usual formats first; of formats that fit equally the first is chosen.
_DATE_FORMATS = (
    "%Y-%m-%d",
    "%Y/%m/%d",
    "%d.%m.%Y",
    "%d/%m/%Y",
    "%m/%d/%Y",
    "%d-%m-%Y",
    "%Y.%m.%d",
    "%Y年%m月%d日",
    "%d.%m.%y",
    "%d/%m/%y",
    "%m/%d/%y",
    "%d-%m-%y",
    "%m-%d-%y",
    "%y-%m-%d",
    "%Y%m%d",
)
# Formats of dates whose leading zeros a spreadsheet has dropped.
_NUMBER_DATE_FORMATS = ("%d%m%Y", "%m%d%Y", "%d%m%y", "%m%d%y", "%y%m%d")
# Formats of times of day.
_TIME_FORMATS = ("%H:%M:%S%.f", "%H:%M", "%I:%M:%S%.f %p", "%I:%M %p", "%H时%M分%S秒", "%H%M%S%.f")
_NUMBER_PATTERN = re.compile(r"[-+]?\d+([.,]\d+)?")
# NMEA writes a time of day in this format: 120959.00.
_CLOCK_DIGITS_FORMAT = "%H%M%S%.f"
# Date and time as fourteen digits.
_FOURTEEN_DIGITS, _FOURTEEN_DIGITS_FORMAT = (
    re.compile(r"(19|20)\d{12}([.,]\d+)?"),
    "%Y%m%d%H%M%S%.f",
)
# Years 1900 and 2100 in microseconds since 1970; a year such as 7 is a wrong format.
_EARLIEST_US, _LATEST_US = -2_208_988_800_000_000, 4_102_444_800_000_000
# Parts of a format that are interchangeable.
_DAY_PART = re.compile("%[dmy]")
# Number of rows that are examined.
_SAMPLE_ROWS = 2000
# Share of the texts that a format must read.
_MIN_PARSED_TEXT_SHARE = 0.95
# Longest interval of a machine's log, s; integers with larger steps are milliseconds.
_MAX_LOG_STEP_S = 60.0
# Smallest step of integers that are probably milliseconds.
_MIN_MS_STEP = 5.0


class TimeGuess(NamedTuple):
    """Holds the description of the times, the reason for it, and a doubt."""

    times: Times
    why: str
    doubt: str = ""


def guess_times(raw: RawTable) -> TimeGuess:
    """Returns the best guess of a table's times, with a doubt where it is ambiguous."""
    names = {name: fold_column_name(split_unit_name(name)[0]) for name in raw.names}
    stamped = [name for name in raw.names if is_time_column(raw.columns[name])]
    called = [
        name
        for name in raw.names
        if has_any_word(names[name], TIME_WORDS)
        and not has_any_word(names[name], TIME_EXCLUDING_WORDS)
    ]
    dated = [
        name for name in raw.names if has_any_word(names[name], DATE_WORDS) and name not in called
    ]
    for name in [
        *stamped,
        *sorted(called, key=lambda one: not has_any_word(names[one], PLAIN_TIME_WORDS)),
    ]:
        found = _guess_from_column(raw, name, names[name], dated)
        if found is not None:
            return found
    for name in raw.names:
        if (
            is_text_column(raw.columns[name])
            and (found := _guess_from_texts(raw, name, names[name], dated)) is not None
        ):
            return found._replace(doubt=f"column {name} is not called a time, but reads as one")
    # A column named a command that grows is a duty cycle that is swept, not a time.
    others = [name for name in raw.names if not has_any_word(names[name], COMMAND_WORDS)]
    for name in others:
        if (
            _guess_by_unit(raw.units.get(name, name)) is not None
            and _is_growing(raw, name)
            and (found := _guess_from_numbers(raw, name)) is not None
        ):
            # A name such as `ms` or `lap (s)` is a unit of time, and the column grows in every row.
            return found
    for name in others:
        if (
            not _is_place_column(names[name])
            and _is_evenly_growing(raw, name)
            and (found := _guess_from_numbers(raw, name)) is not None
        ):
            return found._replace(
                doubt=f"no column is called a time; {name} alone grows evenly from row to row"
            )
    return TimeGuess(
        Times(counts="rows", step_s=1.0),
        "no column tells the time",
        "no column tells the time: rows counted, one each second; say how far apart they are",
    )


def _guess_from_column(raw: RawTable, name: str, plain: str, dated: list[str]) -> TimeGuess | None:
    """Returns the times of a column whose name means time; None where it holds none."""
    column = raw.columns[name]
    if is_time_column(column):
        zone = "UTC" if name not in raw.utc and has_any_word(plain, UTC_WORDS) else None
        return TimeGuess(Times(column=name, zone=zone), "times by type")
    texts = _guess_from_texts(raw, name, plain, dated) if is_text_column(column) else None
    return texts or _guess_clock_digits(raw, name, plain, dated) or _guess_from_numbers(raw, name)


def _guess_clock_digits(raw: RawTable, name: str, plain: str, dated: list[str]) -> TimeGuess | None:
    """Returns times of day written as numbers, such as 120959 and then 121000; None for other
    numbers. As seconds they would jump by 41 at each minute's end."""
    if _guess_by_unit(raw.units.get(name, "")) is not None:
        return None
    values = select_known(
        parse_number_column(raw.columns[name][:_SAMPLE_ROWS], raw.decimal_comma).values
    )
    seconds, minutes = values % 100.0, (values // 100.0) % 100.0
    is_clock = (values >= 0.0) & (values < 240_000.0) & (seconds < 60.0) & (minutes < 60.0)
    if not values.size or not is_clock.all():
        return None
    of_day = (values // 10_000.0) * 3600.0 + minutes * 60.0 + seconds
    uneven, even = (_count_odd_steps(one) for one in (values, of_day))
    # Within one minute both readings are the same.
    if not even < uneven:
        return None
    zone = "UTC" if has_any_word(plain, UTC_WORDS) else None
    texts = format_for_time(values, _CLOCK_DIGITS_FORMAT)
    if not _is_readable_as(texts, _CLOCK_DIGITS_FORMAT):
        return None
    if dated:
        digits = format_for_time(raw.columns[name][:_SAMPLE_ROWS], _CLOCK_DIGITS_FORMAT)
        found = _guess_with_day(raw, dated[0], digits, name, zone)
        if found is not None:
            return found
    return TimeGuess(
        Times(column=name, format=_CLOCK_DIGITS_FORMAT), f"reads as {_CLOCK_DIGITS_FORMAT}"
    )


def _guess_from_texts(raw: RawTable, name: str, plain: str, dated: list[str]) -> TimeGuess | None:
    """Returns the times of a column of texts; None where no format reads them."""
    texts = np.strings.strip(raw.columns[name][:_SAMPLE_ROWS])
    texts = texts[texts != ""]
    zone = "UTC" if has_any_word(plain, UTC_WORDS) else None
    if _is_all_matching(texts, _FOURTEEN_DIGITS) and _is_readable_as(
        texts, _FOURTEEN_DIGITS_FORMAT
    ):
        return TimeGuess(
            Times(column=name, format=_FOURTEEN_DIGITS_FORMAT, zone=zone),
            f"reads as {_FOURTEEN_DIGITS_FORMAT}",
        )
    if not texts.size or _is_all_matching(texts, _NUMBER_PATTERN):
        return None
    if _is_readable_as(texts, None):
        offset = read_time_texts(texts, None, None).kind == "utc"
        return TimeGuess(Times(column=name, zone=None if offset else zone), "reads as ISO 8601")
    if dated and not is_time_column(raw.columns[dated[0]]):
        found_day = _guess_with_day(raw, dated[0], raw.columns[name][:_SAMPLE_ROWS], name, zone)
        if found_day is not None:
            return found_day
    elif dated:
        found = _find_formats(texts, list(_TIME_FORMATS))
        if found:
            times = Times(
                column=name, date_column=dated[0], format=f"%Y-%m-%d {found[0]}", zone=zone
            )
            return TimeGuess(times, "day and time")
    found = _find_formats(
        texts, [f"{d}{sep}{t}" for d, t, sep in product(_DATE_FORMATS, _TIME_FORMATS, (" ", "T"))]
    )
    if found:
        return _resolve_day_order(Times(column=name, format=found[0], zone=zone), found, texts)
    found = _find_formats(texts, list(_TIME_FORMATS[:5]))
    return TimeGuess(Times(column=name, format=found[0]), f"reads as {found[0]}") if found else None


def _is_all_matching(texts: NDArray[Any], pattern: re.Pattern[str]) -> bool:
    return texts.size > 0 and all(map(pattern.fullmatch, texts.tolist()))


def _count_odd_steps(values: NDArray[np.float64]) -> int:
    """Returns the number of steps between rows that differ from the usual step."""
    steps = count_differences(values)
    usual = calc_median(steps)
    return int((np.abs(steps - usual) > 0.1 * abs(usual)).sum())


def _guess_with_day(
    raw: RawTable, day_name: str, time: NDArray[Any], name: str, zone: str | None
) -> TimeGuess | None:
    """Returns times whose date is in another column: as text, as a number of eight digits, or as a
    day number of spreadsheets."""
    day = raw.columns[day_name][:_SAMPLE_ROWS]
    reads: dict[str, NDArray[Any]] = {}
    for day_form in (*_DATE_FORMATS, *_NUMBER_DATE_FORMATS):
        texts = join_day_texts(day, time, day_form)
        texts = texts[texts != ""]
        reads |= {
            form: texts
            for form in _find_formats(texts, [f"{day_form} {one}" for one in _TIME_FORMATS])[:1]
        }
    if not reads:
        return None
    us = {form: read_time_texts(texts, form, None).us for form, texts in reads.items()}
    first, *others = reads
    others = [form for form in others if not np.array_equal(us[form], us[first], equal_nan=True)]
    spans = {form: _calc_span_us(us[form]) for form in (first, *others)}
    # The order of day and month with the shortest span is right, because a log lasts hours.
    best = min(spans, key=lambda form: spans[form])
    doubt = (
        f"{' and '.join((first, *others))} {'both' if len(others) == 1 else 'all'} read: "
        "which is the day?"
    )
    return TimeGuess(
        Times(column=name, date_column=day_name, format=best, zone=zone),
        f"reads as {best}",
        doubt if others else "",
    )


def _resolve_day_order(times: Times, found: list[str], texts: NDArray[Any]) -> TimeGuess:
    """Returns times with an ambiguous order of day and month: the order with the shorter span, with
    a doubt."""
    other = [
        form
        for form in found[1:]
        if _DAY_PART.sub("%d", form) == _DAY_PART.sub("%d", found[0])
        and not np.array_equal(
            read_time_texts(texts, form, None).us,
            read_time_texts(texts, found[0], None).us,
            equal_nan=True,
        )
    ]
    if not other:
        return TimeGuess(times, f"reads as {times.format}")
    spans = {
        form: _calc_span_us(read_time_texts(texts, form, None).us) for form in (found[0], other[0])
    }
    best = min(spans, key=lambda form: spans[form])
    return TimeGuess(
        times.model_copy(update={"format": best}),
        f"reads as {best}",
        f"{found[0]} and {other[0]} both read: which is the day?",
    )


def _calc_span_us(us: NDArray[np.float64]) -> float:
    """Returns the time between the first and the last row, microseconds."""
    return float(np.nanmax(us) - np.nanmin(us))


def _find_formats(texts: NDArray[Any], forms: list[str]) -> list[str]:
    """Returns the formats that read the texts; a few texts exclude most formats quickly."""
    few = texts[:20]
    return [form for form in forms if _is_readable_as(few, form) and _is_readable_as(texts, form)]


def _is_readable_as(texts: NDArray[Any], form: str | None) -> bool:
    """Returns whether a format reads nearly all texts with plausible years."""
    try:
        us = read_time_texts(texts, form, None).us
        count = int(((us >= _EARLIEST_US) & (us <= _LATEST_US)).sum())
        return texts.size > 0 and count >= _MIN_PARSED_TEXT_SHARE * texts.size
    except TableError:
        return False


def _guess_from_numbers(raw: RawTable, name: str) -> TimeGuess | None:
    """Returns the times of a column of numbers; None for too many texts."""
    found = parse_number_column(raw.columns[name], raw.decimal_comma)
    known = select_known(found.values)
    if found.bad > 0.05 * found.values.size or known.size < 2:
        return None
    steps = np.diff(known)
    step = calc_median(steps[steps > 0])
    whole = bool((known == np.round(known)).all())
    stated = (
        find_count_since_1970(float(known[0]))
        or _guess_by_unit(raw.units.get(name, name))
        or _guess_spreadsheet_days(float(known[0]), step, whole)
        or _guess_by_name(name)
        or _guess_by_step(step, whole)
    )
    return TimeGuess(Times(column=name, counts=stated.counts), stated.why, stated.doubt)


class CountedUnit(NamedTuple):
    """Holds the unit that numbers count, and the reason."""

    counts: CountedTimeUnit
    why: str
    doubt: str = ""


def find_count_since_1970(first: float) -> CountedUnit | None:
    """Returns the unit of times since 1970, by the first time: 1e9 s is 2001, 4e9 s is 2096."""
    if 1e9 <= first < 4e9:
        return CountedUnit("unix_s", "seconds since 1970")
    if 1e12 <= first < 4e12:
        return CountedUnit("unix_ms", "milliseconds since 1970")
    if 1e15 <= first < 4e15:
        return CountedUnit("unix_us", "microseconds since 1970")
    if 1e18 <= first < 4e18:
        return CountedUnit("unix_ns", "nanoseconds since 1970")
    return None


def _guess_by_unit(stated: str) -> CountedUnit | None:
    """Returns the unit of the header; None without a unit of time."""
    unit = find_named_unit(stated)
    if unit is None or unit.quantity != "time":
        return None
    counts: CountedTimeUnit = {"s": "s", "ms": "ms", "us": "us", "min": "min", "h": "h"}[unit.name]  # type: ignore[assignment]
    return CountedUnit(counts, "the unit in the header")


def _guess_spreadsheet_days(first: float, step: float, whole: bool) -> CountedUnit | None:
    """Returns the unit for days since 1900: 30 000 is 1982, 80 000 is 2119. A step of a day or more
    excludes a log of a working machine."""
    if 30_000.0 < first < 80_000.0 and 0.0 < step < 0.05 and not whole:
        return CountedUnit("excel_day", "days as spreadsheets count them")
    return None


def _guess_by_name(name: str) -> CountedUnit | None:
    if has_any_word(fold_column_name(name), ("millis",)):
        return CountedUnit("ms", "the name")
    if has_any_word(fold_column_name(name), ("micros",)):
        return CountedUnit("us", "the name")
    return None


def _guess_by_step(step: float, whole: bool) -> CountedUnit:
    """Returns the unit by the median step between rows; milliseconds and microseconds are
    integers."""
    if whole and step >= 1000.0 * _MAX_LOG_STEP_S:
        return CountedUnit(
            "us",
            "whole numbers with large steps",
            f"no unit: steps of {step:g}: microseconds, milliseconds?",
        )
    if whole and step >= _MAX_LOG_STEP_S:
        return CountedUnit("ms", f"whole numbers, steps of {step:g}")
    if whole and step >= _MIN_MS_STEP:
        return CountedUnit(
            "ms",
            "whole numbers",
            f"no unit: whole numbers with steps of {step:g}: milliseconds or seconds?",
        )
    return CountedUnit("s", f"numbers with steps of {step:g}")


def _is_place_column(plain: str) -> bool:
    """Returns whether a column holds a position. The longitude of a machine that drives straight
    grows evenly, as a time does."""
    subject = find_subject(plain, None)
    return subject is not None and subject.id in ("lat_deg", "lon_deg", "altitude")


def _is_growing(raw: RawTable, name: str) -> bool:
    """Returns whether every row is later than the row before."""
    values = parse_number_column(raw.columns[name][:_SAMPLE_ROWS], raw.decimal_comma).values
    return values.size > 1 and bool((np.diff(values) > 0).all())


def _is_evenly_growing(raw: RawTable, name: str) -> bool:
    """Returns whether the column grows by nearly equal steps."""
    if not _is_growing(raw, name):
        return False
    steps = count_differences(
        parse_number_column(raw.columns[name][:_SAMPLE_ROWS], raw.decimal_comma).values
    )
    middle = calc_median(steps)
    return bool(np.mean(np.abs(steps - middle) < 0.5 * middle) > 0.9)
