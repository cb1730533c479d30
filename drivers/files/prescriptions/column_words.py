"""What do the words of a column's name mean? They may mean a rate, an id, a size, a measurement or
a unit; the column's own unit is separated.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

from topdress.drivers.files.imports.column_vocabulary import (
    MAP_COLUMN_KINDS,
    SHAPEFILE_NAME_LENGTH,
    fold_column_name,
    has_any_word,
)
from topdress.drivers.files.imports.table_header import EMPTY_CELLS, split_unit_name
from topdress.drivers.files.imports.units import find_named_unit, is_rate_unit
from topdress.drivers.files.stated_units import ANY_COLUMN, StatedUnit, StatedUnits, is_unit_name

_NUMBER_WITH_UNIT = re.compile(
    r"^(?P<number>[-+]?[\d.,'’\s]*\d[.,]?(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\d\s].*)?$"
)


class Cell(NamedTuple):
    """Holds a cell's number. `value` is NaN for an empty cell. `unit` is the text after the number,
    as written."""

    value: float
    unit: str = ""


def parse_cell(value: Any) -> Cell | None:
    """Returns a cell's number and unit; None for a text that is no number."""
    # Spreadsheets export empty cells as NaN.
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return Cell(math.nan)
    # Python's booleans are integers too.
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        # An infinite rate is no number that a machine can apply.
        return Cell(float(value)) if math.isfinite(value) else None
    if not isinstance(value, str):
        return None
    text = value.strip()
    if text.casefold() in EMPTY_CELLS:
        return Cell(math.nan)
    found = _NUMBER_WITH_UNIT.match(text)
    # Apostrophes and blanks group digits in several countries.
    number = None if found is None else _parse_number(re.sub(r"['’\s]", "", found["number"]))
    return None if found is None or number is None else Cell(number, (found["unit"] or "").strip())


def _parse_number(text: str) -> float | None:
    """Returns the number of a text. If it has a point and a comma, the last of them is the decimal
    mark and the other groups digits; a comma alone is the decimal mark."""
    # The sign that comes last separates the decimals.
    if "," in text and "." in text:
        group = "," if text.rfind(".") > text.rfind(",") else "."
        text = text.replace(group, "")
    text = text.replace(",", ".")
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


# Words of columns that hold no rate to be applied.
BOUND_WORDS = frozenset("min max minimum maximum mean avg default base previous prev last".split())
# Whole words that name a rate, to complete a name that a shapefile has cut.
RATE_WORDS = sorted(word[1:] for word in dict(MAP_COLUMN_KINDS)["rate"] if word[0] == "=")
# Words for nutrients with their names in messages.
NUTRIENT_NAMES = {
    "n": "nitrogen",
    "nitrogen": "nitrogen",
    "stickstoff": "nitrogen",
    "azote": "nitrogen",
    "纯氮": "nitrogen",
    "p2o5": "P2O5",
    "k2o": "K2O",
    "phosphate": "P2O5",
    "potash": "K2O",
}

# A unit at the end of a name that resembles the unit of a rate but is not in the table of units.
_UNKNOWN_UNIT = re.compile(
    r"[(\[{]\s*([^()\[\]{}]*/[^()\[\]{}]*?)\s*[)\]}]\s*$"
    r"|[\s_]([^\W_]+[\s_/](?:ha|ac|acre|hectare|mu))$",
    re.IGNORECASE,
)
# Quantities with a unit of a single letter, such as tonnes (Rate_t); a rate is never in A or V.
_SINGLE_LETTER_QUANTITIES = ("mass", "share")


def split_own_unit(name: str) -> tuple[str, str | None]:
    """Returns a column's name without its unit, and that unit as written, known or not; None
    without a unit."""
    plain, text = split_unit_name(name)
    # A name may consist of a unit only, so the rate has no other name.
    if text is None and is_rate_unit(name):
        # The name `l/ha` consists of the unit alone.
        return "", name
    if text is None or not is_rate_unit(text):
        # An unknown unit must become a question, because it changes the dose.
        unread = _UNKNOWN_UNIT.search(name)
        if unread is not None:
            return name[: unread.start()], unread[1] or unread[2]
    found = None if text is None else find_named_unit(text)
    if (
        text is None
        or found is None
        or found.quantity
        not in ("rate", "volume", "nitrogen", "count", "mass", "share", "flow", "other")
    ):
        # The end of `Rate_min` is no minute.
        return plain, None
    # A single letter is a unit only for masses and litres.
    return (
        (plain, text)
        if len(text) > 1 or found.quantity in _SINGLE_LETTER_QUANTITIES or found.name == "l"
        else (name, None)
    )


def find_word_kind(word: str) -> str:
    """Returns the kind of column that a word of a name means; empty for a word without a
    meaning."""
    return next((kind for kind, words in MAP_COLUMN_KINDS if has_any_word(word, words)), "")


def split_name_words(name: str) -> list[str]:
    """Returns the words of a name: `Tgt_Rate1`, `tgtRate` and `TGT RATE` give tgt and rate. A name
    cut by a shapefile, such as `TARGET_RAT`, is completed."""
    plain = unicodedata.normalize("NFKC", name)
    # The word boundary is also a change from small to capital letters.
    parted = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", plain).casefold()
    whole = [word for word in re.split(r"[\W_]+", parted) if word]
    words = [
        # Numbers at the end count columns, as in Rate1, and have no meaning of their own.
        word if word in NUTRIENT_NAMES else re.sub(r"\d+$", "", word) or word
        for word in whole
    ]
    # A name that consists of digits keeps them.
    words = [word for word in words if not word.isdigit()] or words
    words = [
        part
        # The word `nrate` consists of n and rate.
        for word in words
        for part in (["n", word[1:]] if word in ("nrate", "ndose", "nmenge", "ngabe") else [word])
    ]
    # A shapefile cuts names after ten letters.
    if (
        len(name) == SHAPEFILE_NAME_LENGTH
        and words
        and len(words[-1]) > 1
        and not find_word_kind(words[-1])
    ):
        # The first rate word with the same beginning completes the cut word.
        words[-1] = next((word for word in RATE_WORDS if word.startswith(words[-1])), words[-1])
    return words


# Largest number of different texts in a column of units; a column with more has no units.
MAX_UNIT_TEXTS = 20


def find_unit_columns(texts: Mapping[str, Collection[str]]) -> dict[str, StatedUnit]:
    """Returns units by the column that they belong to, in small letters; ANY_COLUMN where the table
    does not assign them.

    A column holds units in two cases: its name says so and its cells are units or a single word
    throughout, or all its cells are units of rates. A column whose name means ground (Mgmt_Unit:
    North, South) holds none.

    Parameters
    ----------
    texts : the different texts of each column.
    """
    found = StatedUnits()
    for name, written in texts.items():
        # Blanks around a unit differ between exports of the same program.
        cells = sorted({cell.strip() for cell in written} - {""})
        if not 0 < len(cells) <= MAX_UNIT_TEXTS or any(
            parse_cell(cell) is not None for cell in cells
        ):
            continue
        # The words besides "unit" show to which column the units belong.
        of = [word for word in split_name_words(name) if not is_unit_name(word)]
        said = is_unit_name(name) and (
            any(map(is_rate_unit, cells))
            or (len(cells) == 1 and not of)
            or all(map(find_named_unit, cells))
        )
        # Cells that are all units of rates identify the column without any name.
        if not said and not all(map(is_rate_unit, cells)):
            continue
        column = next(
            (other for other in texts if other != name and _is_unit_column_of(other, name)),
            ANY_COLUMN,
        )
        kinds = set(map(find_word_kind, of))
        # Units of an area or of a measurement must not become units of the rate.
        if column != ANY_COLUMN or "rate" in kinds or not kinds & {"a measurement", "a size"}:
            for cell in cells:
                found.add(column.casefold(), cell, f"column {name}", True, name)
    return dict(found)


def _is_unit_column_of(column: str, unit_column: str) -> bool:
    """Returns whether a column of units belongs to a column: `Rate_Unit` and `rateUnit` to `Rate`,
    `Unit2` to `Rate2`."""
    # A number at the end of the name is separated, because it may be the only common part.
    parts = re.sub(r"(?<=\D)(?=\d+$)", "_", fold_column_name(unit_column)).split("_")
    left = "_".join(part for part in parts if not is_unit_name(part))
    plain = fold_column_name(column)
    return bool(left) and (
        plain == left or (left.isdigit() and re.search(rf"\D{left}$", plain) is not None)
    )
