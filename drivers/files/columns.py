"""How are tables stored in memory? A table is a mapping from column names to numpy arrays of equal
length.

Numbers are float64 (NaN: unknown), times datetime64[us] (NaT: unknown). Texts are objects or, in
foreign tables, numpy's strings of any length, which need a quarter of the memory ("": unknown).
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Columns = dict[str, NDArray[Any]]

# Numpy's type for strings of any length.
TEXT_TYPE = np.dtypes.StringDType()
# Microseconds are the finest resolution that foreign programs write.
TIME_TYPE = np.dtype("datetime64[us]")
# Number of rows whose cells exist as Python objects at the same time; a million rows would need a
# gigabyte.
MAX_BLOCK_ROWS = 20_000


def is_text_column(column: NDArray[Any]) -> bool:
    """Returns whether a column holds texts."""
    return column.dtype.kind in "OT"


def is_number_column(column: NDArray[Any]) -> bool:
    """Returns whether a column holds numbers."""
    return column.dtype.kind == "f"


def is_time_column(column: NDArray[Any]) -> bool:
    """Returns whether a column holds times."""
    return column.dtype.kind == "M"


def count_rows(columns: Columns) -> int:
    """Returns the number of rows."""
    return len(next(iter(columns.values()))) if columns else 0


def select_rows(columns: Columns, rows: Any) -> Columns:
    """Returns the rows that a slice, a mask or row numbers select."""
    return {name: column[rows] for name, column in columns.items()}


def make_text_column(cells: Iterable[str]) -> NDArray[Any]:
    """Returns texts as a column (n,)."""
    return np.array(cells if isinstance(cells, Sequence) else list(cells), TEXT_TYPE)


def map_texts(change: Callable[[str], str], column: NDArray[Any]) -> NDArray[Any]:
    """Returns a text column with `change` applied to each different text."""
    return make_text_column([change(text) for text in column.tolist()])


def make_texts_array(values: Sequence[str | None]) -> NDArray[Any]:
    """Returns texts without surrounding blanks. Equal texts share one object, so that a million
    states need only a million references."""
    shared: dict[str, str] = {}
    array = np.empty(len(values), object)
    array[:] = [
        shared.setdefault(text, text) if (text := (value or "").strip()) else "" for value in values
    ]
    return array


def count_microseconds(times: NDArray[Any]) -> NDArray[np.float64]:
    """Returns microseconds since 1970 (n,); NaN for unknown times. A double represents them exactly
    until the year 2255."""
    times = times.astype(TIME_TYPE)
    return np.where(np.isnat(times), np.nan, times.astype(np.int64))


def count_differences(column: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the differences between consecutive rows, where both are known."""
    steps = np.diff(column)
    return steps[~np.isnan(steps)]


def select_known(column: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the known values of a column."""
    return column[~np.isnan(column)]


def calc_median(values: NDArray[np.float64]) -> float:
    """Returns the median; 0 for no values."""
    return float(np.median(values)) if values.size else 0.0


def list_known_or_none(column: NDArray[Any]) -> list[Any]:
    """Returns a column as Python values; None for unknown."""
    if is_text_column(column):
        return [text or None for text in column.tolist()]
    # NaN, which means unknown, is not equal to itself.
    return [None if value != value else value for value in column.tolist()]


def format_numbers(column: NDArray[np.float64]) -> list[str]:
    """Returns the shortest texts that read back as the same numbers."""
    return ["" if math.isnan(value) else repr(value) for value in column.tolist()]


def make_unknown_like(column: NDArray[Any], rows: int) -> NDArray[Any]:
    """Returns a column of the same type with `rows` unknown values."""
    if is_text_column(column):
        return np.full(rows, "", TEXT_TYPE)
    return np.full(rows, "NaT", TIME_TYPE) if is_time_column(column) else np.full(rows, np.nan)


def stack_tables(tables: Sequence[Columns]) -> Columns:
    """Returns several tables as one, row after row, matched by column names. Values of a missing
    column are unknown. A column that holds texts in one table and numbers in another becomes a text
    column."""
    stacked: Columns = {}
    for name in dict.fromkeys(name for table in tables for name in table):
        there = [table[name] for table in tables if name in table]
        like = next(filter(is_text_column, there), there[0])
        parts = [
            table[name] if name in table else make_unknown_like(like, count_rows(table))
            for table in tables
        ]
        if is_text_column(like):
            parts = [
                part.astype(TEXT_TYPE)
                if is_text_column(part)
                else make_text_column(format_numbers(part))
                for part in parts
            ]
        stacked[name] = np.concatenate(parts)
    return stacked


def format_csv(
    columns: Columns, cell_texts: Callable[[str, NDArray[Any]], Sequence[str | None]]
) -> str:
    """Returns header and rows as text in the format of a run log. `cell_texts` returns the texts of
    some rows of a named column."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for start in range(0, count_rows(columns), MAX_BLOCK_ROWS):
        block = select_rows(columns, slice(start, start + MAX_BLOCK_ROWS))
        cells = [cell_texts(name, column) for name, column in block.items()]
        writer.writerows(zip(*cells, strict=True))
    return text.getvalue()
