"""Where does a table begin, and how is a column's name separated from its unit? Title rows, header,
a row of units and the first row of numbers are located.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from typing import NamedTuple

from topdress.drivers.files.imports.units import find_named_unit

# Cells that mean "empty", in lower case, as programs write them.
EMPTY_CELLS = frozenset(
    {"", "-", "--", "na", "n/a", "nan", "null", "none", "nil", "#n/a", "inf", "-inf"}
)


# A number with a decimal mark and digit groups of either kind.
_NUMBER_CELL = re.compile(
    r"^[-+]?(\d+([.,]\d*)?|[.,]\d+|\d{1,3}([.,   ]\d{3})+[.,]\d+)([eE][-+]?\d+)?$"
)
# A date or a time of day.
_TIME_CELL = re.compile(
    r"^\d{1,4}[-./年]\d{1,2}[-./月]\d{1,4}日?([T ,;]+\d|$)|^\d{1,2}[:时]\d{2}([:分]\d{2})?"
    r"|^\d{8}T?\d{0,6}$"
)
# A name with its unit in brackets.
_NAME_WITH_UNIT = re.compile(r"^(?P<name>.*?)\s*[(\[{<]\s*(?P<unit>[^()\[\]{}<>]+?)\s*[)\]}>]\s*$")
# A name whose last word may be a unit.
_NAME_WITH_LAST_WORD = re.compile(r"^(?P<name>.*[^\s,_/])(?:[\s,_]+|\s*/\s+)(?P<unit>[^\s,_]+)$")
# The boundary of words in `leftRpm` and `SpeedMPH`.
_WORD_JOINT = re.compile(r"(?<=[a-z])(?=[A-Z][a-z]+$|[A-Z]{2,}$)")
# Endings that are units, because no word ends with them.
_UNIT_ENDING = re.compile(
    r"^(?P<name>.*[^\W\d_]{2})(?P<unit>kmh|kmph|kph|mph|rpm|kgha|lbac)$", re.I
)
# Share of the cells of a header or a row of data that are filled.
_MIN_FILLED_CELL_SHARE = 0.5


class TableLayout(NamedTuple):
    """Holds the rows (from 0) of header, units and first data. `header` -1 means no header."""

    header: int
    units: int | None
    body: int


def split_unit_name(text: str) -> tuple[str, str | None]:
    """Returns a header cell as name and unit, in the file's words: `Speed [km/h]`, `speed_kmh`,
    `Drehzahl in U/min`, `leftRpm`.

    The name is the whole cell where the unit cannot be separated from it.
    """
    plain = unicodedata.normalize("NFKC", text).strip()
    found = _NAME_WITH_UNIT.match(plain)
    if found and find_named_unit(found["unit"]) is not None and found["name"]:
        return found["name"].strip(), found["unit"]
    words = _WORD_JOINT.sub(" ", plain) if plain.isascii() and "_" not in plain else plain
    # A shapefile changes `Speed(mph)` to `Speed_mph_`.
    words = words.rstrip(" _")
    for candidate in (
        _match_last_two(words),
        _NAME_WITH_LAST_WORD.match(words),
        _UNIT_ENDING.match(words),
    ):
        if candidate is None:
            continue
        unit = find_named_unit(candidate["unit"]) or find_named_unit(
            candidate["unit"].replace("_", "/")
        )
        # A single letter is a unit only after `_` or a comma: `Rate t` is no tonne.
        stated = (
            candidate["unit"] == "%" or len(candidate["unit"]) > 1 or "_" in plain or "," in plain
        )
        if unit is not None and stated:
            return re.sub(r"\s+in$", "", candidate["name"]).strip(" _,"), candidate["unit"]
    return plain, None


def _match_last_two(words: str) -> re.Match[str] | None:
    """Returns the match of a unit of two parts without brackets: `rate_kg_ha`, `speed_km_per_h`,
    `drehzahl_1_min`."""
    return re.match(
        r"^(?P<name>.*?)[_ ]+(?P<unit>([A-Za-z]{1,6}|1)([_/]|[_ ]per[_ ])[A-Za-z0-9]{1,4})$", words
    )


def is_value_cell(cell: str) -> bool:
    """Returns whether a cell is a number or a time instead of a name."""
    text = cell.strip()
    return bool(_NUMBER_CELL.match(text)) or bool(_TIME_CELL.match(text))


def find_table_layout(rows: Sequence[Sequence[str]]) -> TableLayout | None:
    """Returns the rows of header, units and data among the first rows; None where no row holds
    data."""
    width = _find_usual_width(rows)
    body = next((k for k, row in enumerate(rows) if len(row) == width and _is_data_row(row)), None)
    if body is None:
        return None
    above = [
        k
        for k in range(body)
        if len(rows[k]) == width
        and (_count_filled(rows[k]) > _MIN_FILLED_CELL_SHARE * width or is_unit_row(rows[k]))
    ]
    near = [
        k
        for k in above
        if all(_is_blank_row(rows[j]) for j in range(k + 1, body) if j not in above)
    ]
    if not near:
        return TableLayout(-1, None, body)
    last = near[-1]
    units = last if len(near) > 1 and is_unit_row(rows[last]) else None
    return TableLayout(near[-2] if units is not None else last, units, body)


def is_unit_row(row: Sequence[str]) -> bool:
    """Returns whether most filled cells are units, and none is a number. A dash, a 1 or empty
    brackets mean that a column has no unit."""
    cells = [cell.strip() for cell in row if cell.strip()]
    if any(is_value_cell(cell) for cell in cells if cell != "1"):
        return False
    units = [cell for cell in cells if find_named_unit(cell) is not None]
    nothing = [cell for cell in cells if cell.strip("()[]- 1") == ""]
    return bool(units) and len(units) + len(nothing) > _MIN_FILLED_CELL_SHARE * len(cells)


def find_tag_row(rows: Sequence[Sequence[str]], width: int) -> tuple[str, ...] | None:
    """Returns the tags that name the columns of a plant's export, whose head ends with other rows:
    the first row of the width with `.PV` and `.MV` or `.OP` of a loop; None without one."""
    for row in rows:
        ends = {cell.strip().lower().rpartition(".")[2] for cell in row if "." in cell}
        if len(row) == width == len({*row}) and "pv" in ends and ends & {"mv", "op"}:
            return tuple(cell.strip() for cell in row)
    return None


def _find_usual_width(rows: Sequence[Sequence[str]]) -> int:
    """Returns the most frequent number of cells of rows with more than one cell, because titles
    have one."""
    widths = [len(row) for row in rows if not _is_blank_row(row)] or [0]
    several = [width for width in widths if width > 1] or widths
    return max(set(several), key=lambda w: (several.count(w), w))


def _is_data_row(row: Sequence[str]) -> bool:
    """Returns whether a row holds a value, and half of its cells are values or empty."""
    cells = [cell for cell in row if cell.strip()]
    values = sum(is_value_cell(cell) or cell.strip().lower() in EMPTY_CELLS for cell in cells)
    return bool(cells) and any(is_value_cell(cell) for cell in cells) and 2 * values >= len(cells)


def _count_filled(row: Sequence[str]) -> int:
    return sum(bool(cell.strip()) for cell in row)


def _is_blank_row(row: Sequence[str]) -> bool:
    return _count_filled(row) == 0
