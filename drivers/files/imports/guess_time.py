"""Which column holds the time, and in which form, by name, by unit, by its texts and by its
numbers?"""

from __future__ import annotations

import re
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.drivers.files.columns import (
    count_differences,
    is_text,
    is_time,
    known_values,
    median_of,
)
from topdress.drivers.files.imports.header import named
from topdress.drivers.files.imports.mapping import Counts, Times
from topdress.drivers.files.imports.numbers import numbers
from topdress.drivers.files.imports.raw import RawTable
from topdress.drivers.files.imports.times import read_texts, texts_for, with_day
from topdress.drivers.files.imports.trouble import TableError
from topdress.drivers.files.imports.units import unit_named
from topdress.drivers.files.imports.words import (
    COMMAND,
    DATE,
    NO_TIME,
    PLAINLY_TIME,
    TIME,
    UTC,
    folded,
    says,
    subject_of,
)

# Forms of days, the usual ones first; of equal readings the first is taken.
_DATES = (
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
# Days whose zeros a spreadsheet has dropped.
_DAYS_AS_NUMBERS = ("%d%m%Y", "%m%d%Y", "%d%m%y", "%m%d%y", "%y%m%d")
# Forms of times of day.
_TIMES = ("%H:%M:%S%.f", "%H:%M", "%I:%M:%S%.f %p", "%I:%M %p", "%H时%M分%S秒", "%H%M%S%.f")
_A_NUMBER = re.compile(r"[-+]?\d+([.,]\d+)?")
# As NMEA writes a time of day: 120959.00.
_CLOCK_DIGITS = "%H%M%S%.f"
# Date and time as fourteen digits.
_RUN_TOGETHER, _AS_RUN = re.compile(r"(19|20)\d{12}([.,]\d+)?"), "%Y%m%d%H%M%S%.f"
# Years 1900 and 2100, microseconds since 1970: no machine's year is 7.
_EARLIEST_US, _LATEST_US = -2_208_988_800_000_000, 4_102_444_800_000_000
# Parts of a format that may stand for one another.
_PART_OF_DAY = re.compile("%[dmy]")
# Rows that are looked at.
_SAMPLE = 2000
# Share of the texts that a format must read.
_READS = 0.95
# No machine logs more rarely, s: whole numbers with larger steps are milliseconds.
_LEAST_STEP_S = 60.0
# Whole numbers with steps from here on are likely milliseconds.
_WHOLE_STEP = 5.0


class TimeGuess(NamedTuple):
    """Holds how times are read, why, and what is not sure."""

    times: Times
    why: str
    doubt: str = ""


def guess_times(raw: RawTable) -> TimeGuess:
    """Returns the best guess of a table's times, with a doubt where it is not sure."""
    names = {name: folded(named(name)[0]) for name in raw.names}
    stamped = [name for name in raw.names if is_time(raw.columns[name])]
    called = [
        name for name in raw.names if says(names[name], TIME) and not says(names[name], NO_TIME)
    ]
    dated = [name for name in raw.names if says(names[name], DATE) and name not in called]
    for name in [*stamped, *sorted(called, key=lambda one: not says(names[one], PLAINLY_TIME))]:
        found = _of_column(raw, name, names[name], dated)
        if found is not None:
            return found
    for name in raw.names:
        if (
            is_text(raw.columns[name])
            and (found := _of_texts(raw, name, names[name], dated)) is not None
        ):
            return found._replace(doubt=f"column {name} is not called a time, but reads as one")
    # a duty cycle that is swept, no time
    # A column named a command is a duty cycle that is swept, no time.
    others = [name for name in raw.names if not says(names[name], COMMAND)]
    for name in others:
        if (
            _by_unit(raw.units.get(name, name)) is not None
            and _grows(raw, name)
            and (found := _of_numbers(raw, name)) is not None
        ):
            # `ms`, `lap (s)`: a unit of time, and more of it in every row
            return found
    for name in others:
        if (
            not _tells_place(names[name])
            and _runs_evenly(raw, name)
            and (found := _of_numbers(raw, name)) is not None
        ):
            return found._replace(
                doubt=f"no column is called a time; {name} alone grows evenly from row to row"
            )
    return TimeGuess(
        Times(counts="rows", step_s=1.0),
        "no column tells the time",
        "no column tells the time: rows counted, one each second; say how far apart they are",
    )


# Returns the times of a column that is called a time; None: it holds none.
def _of_column(raw: RawTable, name: str, plain: str, dated: list[str]) -> TimeGuess | None:
    column = raw.columns[name]
    if is_time(column):
        zone = "UTC" if name not in raw.utc and says(plain, UTC) else None
        return TimeGuess(Times(column=name, zone=zone), "times by type")
    texts = _of_texts(raw, name, plain, dated) if is_text(column) else None
    return texts or _of_clock_digits(raw, name, plain, dated) or _of_numbers(raw, name)


def _of_clock_digits(raw: RawTable, name: str, plain: str, dated: list[str]) -> TimeGuess | None:
    """Returns times of day written as numbers, 120959 and then 121000: as seconds they would
    jump by 41 at each minute's end. None: they are none."""
    if _by_unit(raw.units.get(name, "")) is not None:
        return None
    values = known_values(numbers(raw.columns[name][:_SAMPLE], raw.decimal_comma).values)
    seconds, minutes = values % 100.0, (values // 100.0) % 100.0
    is_clock = (values >= 0.0) & (values < 240_000.0) & (seconds < 60.0) & (minutes < 60.0)
    if not values.size or not is_clock.all():
        return None
    of_day = (values // 10_000.0) * 3600.0 + minutes * 60.0 + seconds
    uneven, even = (_off_the_median(one) for one in (values, of_day))
    if not even < uneven:  # within one minute both readings are the same
        return None
    zone = "UTC" if says(plain, UTC) else None
    texts = texts_for(values, _CLOCK_DIGITS)
    if not _reads(texts, _CLOCK_DIGITS):
        return None
    if dated:
        digits = texts_for(raw.columns[name][:_SAMPLE], _CLOCK_DIGITS)
        found = _with_day(raw, dated[0], digits, name, zone)
        if found is not None:
            return found
    return TimeGuess(Times(column=name, format=_CLOCK_DIGITS), f"reads as {_CLOCK_DIGITS}")


# Returns the times of a column of texts; None: no format reads them.
def _of_texts(raw: RawTable, name: str, plain: str, dated: list[str]) -> TimeGuess | None:
    texts = np.strings.strip(raw.columns[name][:_SAMPLE])
    texts = texts[texts != ""]
    zone = "UTC" if says(plain, UTC) else None
    if _all_are(texts, _RUN_TOGETHER) and _reads(texts, _AS_RUN):
        return TimeGuess(Times(column=name, format=_AS_RUN, zone=zone), f"reads as {_AS_RUN}")
    if not texts.size or _all_are(texts, _A_NUMBER):
        return None
    if _reads(texts, None):
        offset = read_texts(texts, None, None).kind == "utc"
        return TimeGuess(Times(column=name, zone=None if offset else zone), "reads as ISO 8601")
    if dated and not is_time(raw.columns[dated[0]]):
        found_day = _with_day(raw, dated[0], raw.columns[name][:_SAMPLE], name, zone)
        if found_day is not None:
            return found_day
    elif dated:
        found = _formats(texts, list(_TIMES))
        if found:
            times = Times(
                column=name, date_column=dated[0], format=f"%Y-%m-%d {found[0]}", zone=zone
            )
            return TimeGuess(times, "day and time")
    found = _formats(texts, [f"{d}{sep}{t}" for d, t, sep in product(_DATES, _TIMES, (" ", "T"))])
    if found:
        return _dated(Times(column=name, format=found[0], zone=zone), found, texts)
    found = _formats(texts, list(_TIMES[:5]))
    return TimeGuess(Times(column=name, format=found[0]), f"reads as {found[0]}") if found else None


def _all_are(texts: NDArray[Any], pattern: re.Pattern[str]) -> bool:
    return texts.size > 0 and all(map(pattern.fullmatch, texts.tolist()))


def _off_the_median(values: NDArray[np.float64]) -> int:
    """Returns how many steps from row to row differ from the usual step."""
    steps = count_differences(values)
    usual = median_of(steps)
    return int((np.abs(steps - usual) > 0.1 * abs(usual)).sum())


def _with_day(
    raw: RawTable, day_name: str, time: NDArray[Any], name: str, zone: str | None
) -> TimeGuess | None:
    """Returns times with the day in another column: written out, or a number, as run-together
    digits or as spreadsheets count."""
    day = raw.columns[day_name][:_SAMPLE]
    reads: dict[str, NDArray[Any]] = {}
    for day_form in (*_DATES, *_DAYS_AS_NUMBERS):
        texts = with_day(day, time, day_form)
        texts = texts[texts != ""]
        reads |= {
            form: texts for form in _formats(texts, [f"{day_form} {one}" for one in _TIMES])[:1]
        }
    if not reads:
        return None
    us = {form: read_texts(texts, form, None).us for form, texts in reads.items()}
    first, *others = reads
    others = [form for form in others if not np.array_equal(us[form], us[first], equal_nan=True)]
    spans = {form: _span(us[form]) for form in (first, *others)}
    # The day's order with the shortest span is right: a log lasts hours.
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


def _dated(times: Times, found: list[str], texts: NDArray[Any]) -> TimeGuess:
    """Returns times whose day and month may stand either way round: the way with the shorter
    span, with a doubt."""
    other = [
        form
        for form in found[1:]
        if _PART_OF_DAY.sub("%d", form) == _PART_OF_DAY.sub("%d", found[0])
        and not np.array_equal(
            read_texts(texts, form, None).us, read_texts(texts, found[0], None).us, equal_nan=True
        )
    ]
    if not other:
        return TimeGuess(times, f"reads as {times.format}")
    spans = {form: _span(read_texts(texts, form, None).us) for form in (found[0], other[0])}
    best = min(spans, key=lambda form: spans[form])
    return TimeGuess(
        times.model_copy(update={"format": best}),
        f"reads as {best}",
        f"{found[0]} and {other[0]} both read: which is the day?",
    )


# Returns the time between first and last, us.
def _span(us: NDArray[np.float64]) -> float:
    return float(np.nanmax(us) - np.nanmin(us))


# Returns the formats that read the texts; a few texts refuse most formats quickly.
def _formats(texts: NDArray[Any], forms: list[str]) -> list[str]:
    few = texts[:20]
    return [form for form in forms if _reads(few, form) and _reads(texts, form)]


# Tells whether a format reads nearly all texts, as plausible years.
def _reads(texts: NDArray[Any], form: str | None) -> bool:
    try:
        us = read_texts(texts, form, None).us
        count = int(((us >= _EARLIEST_US) & (us <= _LATEST_US)).sum())
        return texts.size > 0 and count >= _READS * texts.size
    except TableError:
        return False


# Returns the times of a column of numbers; None: it holds too many texts.
def _of_numbers(raw: RawTable, name: str) -> TimeGuess | None:
    found = numbers(raw.columns[name], raw.decimal_comma)
    known = known_values(found.values)
    if found.bad > 0.05 * found.values.size or known.size < 2:
        return None
    steps = np.diff(known)
    step = median_of(steps[steps > 0])
    whole = bool((known == np.round(known)).all())
    stated = (
        _since_1970(float(known[0]))
        or _by_unit(raw.units.get(name, name))
        or _spreadsheet_days(float(known[0]), step, whole)
        or _by_name(name)
        or _by_step(step, whole)
    )
    return TimeGuess(Times(column=name, counts=stated.counts), stated.why, stated.doubt)


class _Counted(NamedTuple):
    """Holds what numbers count, and what says so."""

    counts: Counts
    why: str
    doubt: str = ""


def _since_1970(first: float) -> _Counted | None:
    """Returns the unit of times since 1970, by the first: 1e9 s is 2001, 4e9 s is 2096."""
    if 1e9 <= first < 4e9:
        return _Counted("unix_s", "seconds since 1970")
    if 1e12 <= first < 4e12:
        return _Counted("unix_ms", "milliseconds since 1970")
    if 1e15 <= first < 4e15:
        return _Counted("unix_us", "microseconds since 1970")
    return None


# Returns the unit of the header; None: it has none of time.
def _by_unit(stated: str) -> _Counted | None:
    unit = unit_named(stated)
    if unit is None or unit.quantity != "time":
        return None
    counts: Counts = {"s": "s", "ms": "ms", "us": "us", "min": "min", "h": "h"}[unit.name]  # type: ignore[assignment]
    return _Counted(counts, "the unit in the header")


def _spreadsheet_days(first: float, step: float, whole: bool) -> _Counted | None:
    """Returns days since 1900: 30 000 is 1982, 80 000 is 2119. A step of a day or more is no log
    of a machine at work."""
    if 30_000.0 < first < 80_000.0 and 0.0 < step < 0.05 and not whole:
        return _Counted("excel_day", "days as spreadsheets count them")
    return None


def _by_name(name: str) -> _Counted | None:
    if says(folded(name), ("millis",)):
        return _Counted("ms", "the name")
    if says(folded(name), ("micros",)):
        return _Counted("us", "the name")
    return None


def _by_step(step: float, whole: bool) -> _Counted:
    """Returns the unit by the median step from row to row: milliseconds and microseconds are
    whole numbers."""
    if whole and step >= 1000.0 * _LEAST_STEP_S:
        return _Counted(
            "us",
            "whole numbers with large steps",
            f"no unit: steps of {step:g}: microseconds, milliseconds?",
        )
    if whole and step >= _LEAST_STEP_S:
        return _Counted("ms", f"whole numbers, steps of {step:g}")
    if whole and step >= _WHOLE_STEP:
        return _Counted(
            "ms",
            "whole numbers",
            f"no unit: whole numbers with steps of {step:g}: milliseconds or seconds?",
        )
    return _Counted("s", f"numbers with steps of {step:g}")


def _tells_place(plain: str) -> bool:
    """Tells whether a column holds a place: a machine that drives straight on has a longitude
    that grows evenly."""
    subject = subject_of(plain, None)
    return subject is not None and subject.id in ("latitude", "longitude", "altitude")


def _grows(raw: RawTable, name: str) -> bool:
    """Tells whether every row is later than the row before."""
    values = numbers(raw.columns[name][:_SAMPLE], raw.decimal_comma).values
    return values.size > 1 and bool((np.diff(values) > 0).all())


def _runs_evenly(raw: RawTable, name: str) -> bool:
    if not _grows(raw, name):
        return False
    steps = count_differences(numbers(raw.columns[name][:_SAMPLE], raw.decimal_comma).values)
    middle = median_of(steps)
    return bool(np.mean(np.abs(steps - middle) < 0.5 * middle) > 0.9)
