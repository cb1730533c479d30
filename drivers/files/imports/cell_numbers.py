"""Which numbers do the cells of a foreign table hold? Decimal commas, digit groups, and words or
numbers for "unknown" are recognised.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.drivers.files.columns import is_text_column
from topdress.drivers.files.imports.table_header import EMPTY_CELLS

# Blanks and apostrophes that group digits.
_GROUP_SIGNS = re.compile("[\\s'\u2019\u00a0\u202f]")
# Words of a switch, and its numbers.
SWITCH_WORDS = {"false": 0.0, "true": 1.0}
# A number in Python's notation.
_PLAIN_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


def parse_number(cell: str | None, words: Collection[str] = ()) -> float | None:
    """Returns the number of a cell.

    True and False are 1 and 0. Blanks and apostrophes group digits. If a cell has a point and a
    comma, the last of them is the decimal mark; a comma alone is the decimal mark.

    Parameters
    ----------
    cell : text of the cell.
    words : texts that mean "unknown".

    Returns
    -------
    the number, NaN for unknown, None for a text that is no number.
    """
    text = (cell or "").strip()
    if text in words or text.lower() in EMPTY_CELLS:
        return float("nan")
    if text.lower() in SWITCH_WORDS:
        return SWITCH_WORDS[text.lower()]
    if not _PLAIN_NUMBER.fullmatch(text):
        text = _GROUP_SIGNS.sub("", text)
        if "." in text and "," in text:
            text = text.replace("." if text.rfind(",") > text.rfind(".") else ",", "")
        text = text.replace(",", ".", 1)
        if not _PLAIN_NUMBER.fullmatch(text):
            return None
    return float(text)


class ParsedNumbers(NamedTuple):
    """Holds a column's numbers. `values` is (n,), NaN for unknown. `marked` counts the cells with a
    number that means "unknown", `bad` the cells that are no numbers; `row` and `cell` are the first
    of the bad cells."""

    values: NDArray[np.float64]
    marked: int = 0
    bad: int = 0
    row: int = 0
    cell: str = ""


def parse_number_column(
    column: NDArray[Any], decimal_comma: bool, missing: Iterable[float | str] = ()
) -> ParsedNumbers:
    """Returns a column's numbers; `missing` lists numbers and texts that mean "unknown"."""
    words = [word for word in missing if isinstance(word, str)]
    marks = [float(mark) for mark in missing if not isinstance(mark, str)]
    found = (
        parse_number_cells(column.tolist(), decimal_comma, words)
        if is_text_column(column)
        else ParsedNumbers(np.array(column, np.float64))
    )
    values = found.values
    marked = np.isin(values, marks)
    values[marked | np.isinf(values)] = np.nan
    return found._replace(marked=int(marked.sum()))


def parse_number_cells(
    cells: Sequence[str], decimal_comma: bool = False, words: Collection[str] = ()
) -> ParsedNumbers:
    """Returns the numbers of a text table's cells; most are in Python's notation and are converted
    at once."""
    values = None if words else parse_plain_numbers(cells)
    if values is None and decimal_comma and not words:
        values = parse_plain_numbers([cell.replace(",", ".", 1) for cell in cells])
    if values is not None:
        return ParsedNumbers(values)
    # Each different text is parsed once.
    worth = {
        cell: _parse_cell_text(cell, decimal_comma, words) if cell else np.nan
        for cell in dict.fromkeys(cells)
    }
    values = np.array([worth[cell] for cell in cells], np.float64)
    bad = [row for row, cell in enumerate(cells) if worth[cell] is None]
    return (
        ParsedNumbers(values, 0, len(bad), bad[0], cells[bad[0]]) if bad else ParsedNumbers(values)
    )


def _parse_cell_text(cell: str, decimal_comma: bool, words: Collection[str]) -> float | None:
    """Returns the number of a text; None for a text that is no number."""
    plain = cell.replace(",", ".", 1) if decimal_comma else cell
    if _PLAIN_NUMBER.fullmatch(plain) and cell.strip() not in words:
        return float(plain)
    return parse_number(cell, words)


def parse_plain_numbers(cells: Sequence[str]) -> NDArray[np.float64] | None:
    """Returns numbers (n,) of texts in Python's notation; None where a text is no such number."""
    together = "".join(cells)
    # Python also accepts underscores between digits, and digits of other scripts.
    if "_" in together or not together.isascii():
        return None
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells], np.float64)
    except ValueError:
        return None
