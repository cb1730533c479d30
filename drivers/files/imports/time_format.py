"""How are many times in a format of `strptime` read at once? The format becomes one regular
expression.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.drivers.files.imports.import_errors import LogImportError

Floats = NDArray[np.float64]
WholeNumbers = NDArray[np.int64]

# Parts of a format that contain the date.
DAY_PARTS = re.compile("%[djeyYFDs]")
# Abbreviations for several parts (POSIX).
_EXPANSION_OF_PART = {"%F": "%Y-%m-%d", "%D": "%m/%d/%y", "%T": "%H:%M:%S", "%R": "%H:%M"}
# Parts that are read as another part.
_SYNONYM_OF_PART = {"e": "d", "k": "H", "l": "I", "P": "p", "h": "b"}
_MONTHS = (
    "january february march april may june july august september october november december"
).split()
# Months in English, whole or by three letters.
_MONTH_PATTERN = f"((?i:{'|'.join((*_MONTHS, *(name[:3] for name in _MONTHS)))}))"
# A possessive quantifier keeps the digits of a part, so that matching needs no backtracking.
_TWO_DIGITS = r"\s*+(\d{1,2}+)"
# Each part as a regular expression.
_PATTERN_OF_PART = {
    "Y": r"\s*+([+-]\d++|\d{1,4}+)",
    **dict.fromkeys(("y", "m", "d", "H", "I", "M", "S"), _TWO_DIGITS),
    "j": r"\s*+(\d{1,3}+)",
    "s": r"\s*+(-?\d++)",
    "p": "((?i:[ap]m))",
    "b": _MONTH_PATTERN,
    "B": _MONTH_PATTERN,
    # A fraction of a second, with or without its point.
    ".f": r"(?:\.(\d++))?+",
    "f": r"(\d++)",
    **{f".{digits}f": rf"(?:\.(\d{{{digits}}}))?+" for digits in (3, 6, 9)},
    **{f"{digits}f": rf"(\d{{{digits}}})" for digits in (3, 6, 9)},
}
# Parts that are ignored: the day's name, and the zone's name (offsets are removed before).
_IGNORED_PARTS = {"a": "[^\\W\\d]+", "A": "[^\\W\\d]+", "Z": r"\S*", "z": "", "%": "%"}
# A part, blanks, or any other letter.
_FORMAT_PART = re.compile(r"%(\.?[369]?f|[A-Za-z%])|(\s+)|(.)", re.DOTALL)
# Bounds of each part; a leap second is 60.
_MIN_OF_PART = {"Y": -9999, "y": 0, "m": 1, "d": 1, "j": 1, "H": 0, "I": 1, "M": 0, "S": 0}
_MAX_OF_PART = {"Y": 9999, "y": 99, "m": 12, "d": 31, "j": 366, "H": 23, "I": 12, "M": 59, "S": 60}
# First year in two digits that belongs to the previous century (strptime: 69).
_CENTURY_PIVOT = 70


class _FormatPattern(NamedTuple):
    """Holds a format as a pattern, and its parts in the order of the groups."""

    pattern: re.Pattern[str]
    parts: tuple[str, ...]


def parse_times(texts: Sequence[str], form: str) -> Floats:
    """Returns times of texts in a format.

    Parameters
    ----------
    texts : (n,) texts.
    form : format of `strptime`, with %.f for fractions of a second.

    Returns
    -------
    microseconds since 1970 (n,), NaN where a text does not fit; parts that the format lacks are
    those of 1970-01-01 00:00.

    Raises
    ------
    LogImportError : the format is invalid.
    """
    layout = _compile_format(form)
    us = np.full(len(texts), np.nan)
    match = layout.pattern.fullmatch
    found = [match(text) for text in texts]
    rows = [row for row, one in enumerate(found) if one is not None]
    if rows:
        cells = zip(*[one.groups("0") for one in found if one is not None], strict=True)
        us[rows] = _calc_microseconds(
            dict(zip(layout.parts, map(list, cells), strict=True)), len(rows)
        )
    return us


# Formats repeat for every block of rows, so the compiled patterns are cached.
@lru_cache(maxsize=512)
def _compile_format(form: str) -> _FormatPattern:
    """Returns the pattern of a format. Raises LogImportError."""
    for short, long in _EXPANSION_OF_PART.items():
        form = form.replace(short, long)
    pattern, parts = "", list[str]()
    for part, space, letter in _FORMAT_PART.findall(form):
        part = _SYNONYM_OF_PART.get(part, part)
        if part in _PATTERN_OF_PART:
            pattern += _PATTERN_OF_PART[part]
            parts.append("f" if part.endswith("f") else "b" if part == "B" else part)
        elif part in _IGNORED_PARTS:
            pattern += _IGNORED_PARTS[part]
        elif space:
            pattern += r"\s*+"
        else:
            pattern += re.escape(part or letter)
        if (part and part not in (*_PATTERN_OF_PART, *_IGNORED_PARTS)) or (
            not part and letter == "%"
        ):
            raise _make_format_error(form)
    if len(set(parts)) < len(parts) or not parts or _is_half_given(set(parts)):
        raise _make_format_error(form)
    return _FormatPattern(re.compile(pattern), tuple(parts))


def _is_half_given(parts: set[str]) -> bool:
    """Returns whether a format has hours without minutes or the reverse, or 12-hour times without
    AM or PM."""
    return bool(parts & {"H", "I"}) != ("M" in parts) or ("I" in parts) != ("p" in parts)


def _make_format_error(form: str) -> LogImportError:
    return LogImportError("", f"time.format {form}: not a format; allowed e.g. %d.%m.%Y %H:%M:%S")


def _calc_microseconds(cells: dict[str, list[str]], rows: int) -> Floats:
    """Returns microseconds (rows,) of the parts' texts; NaN where a part is out of its bounds."""
    found = {
        part: np.array(list(map(int, texts)), np.int64)
        for part, texts in cells.items()
        if part not in ("f", "b", "p")
    }
    good = np.ones(rows, np.bool_)
    for part, values in found.items():
        if part in _MIN_OF_PART:
            good &= (values >= _MIN_OF_PART[part]) & (values <= _MAX_OF_PART[part])
    fraction_us = [int(text[:6].ljust(6, "0")) for text in cells.get("f", ())]
    if "s" in found:
        seconds = found["s"]
    else:
        days, is_day = _calc_days(found, cells.get("b"), rows)
        good &= is_day
        seconds = days * 86_400 + _calc_seconds_of_day(found, cells.get("p"), rows)
    us = seconds * 1e6 + np.array(fraction_us or [0], np.float64)
    return np.where(good, us, np.nan)


def _calc_days(
    found: dict[str, WholeNumbers], names: list[str] | None, rows: int
) -> tuple[WholeNumbers, NDArray[np.bool_]]:
    """Returns days since 1970, and whether each day exists in its month or year."""
    one = np.ones(rows, np.int64)
    year = found.get("Y", 1970 * one)
    if "y" in found:
        year = found["y"] + np.where(found["y"] < _CENTURY_PIVOT, 2000, 1900)
    month = found.get("m", one)
    if names is not None:
        months = {name[:3]: number for number, name in enumerate(_MONTHS, start=1)}
        month = np.array([months[name[:3].lower()] for name in names], np.int64)
    day = found.get("d", one)
    begin, end = (year - 1970) * 12 + month - 1, (year - 1970) * 12 + month
    if "j" in found:
        day, begin, end = found["j"], (year - 1970) * 12, (year - 1969) * 12
    first, beyond = (
        months_since.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)
        for months_since in (begin, end)
    )
    days = first + day - 1
    return days, (days >= first) & (days < beyond)


def _calc_seconds_of_day(
    found: dict[str, WholeNumbers], halves: list[str] | None, rows: int
) -> WholeNumbers:
    zero = np.zeros(rows, np.int64)
    hours = found.get("H", zero)
    if halves is not None:
        is_second = np.array([half.lower() == "pm" for half in halves])
        hours = found["I"] % 12 + np.where(is_second, 12, 0)
    return hours * 3600 + found.get("M", zero) * 60 + found.get("S", zero)
