"""Cells of a foreign table as numbers: decimal commas, thousands, words and numbers for not
known."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, NamedTuple

from drivers.files.imports.header import NOTHING

if TYPE_CHECKING:
    import polars as pl

_GROUPING = re.compile("[\\s'\u2019\u00a0\u202f]")
_PLAIN = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


def number_of(cell: str | None, words: Collection[str] = ()) -> float | None:
    """What a cell is worth; NaN: not known (`words` stand for that too), None: no number.

    Blanks and apostrophes group digits. Of a point and a comma the last is the decimal sign; a
    comma alone is one.
    """
    text = (cell or "").strip()
    if text in words or text.lower() in NOTHING:
        return float("nan")
    if not _PLAIN.fullmatch(text):
        text = _GROUPING.sub("", text)
        if "." in text and "," in text:
            text = text.replace("." if text.rfind(",") > text.rfind(".") else ",", "")
        text = text.replace(",", ".", 1)
        if not _PLAIN.fullmatch(text):
            return None
    return float(text)


class Numbers(NamedTuple):
    """`values`: Float64, null: not known. `marked`: how many cells hold a number that stands
    for that. `bad`: how many are no number; `row`, `cell`: the first of them."""

    values: pl.Series
    marked: int = 0
    bad: int = 0
    row: int = 0
    cell: str = ""


def numbers(series: pl.Series, decimal_comma: bool, missing: Iterable[float | str] = ()) -> Numbers:
    """A column as numbers; `missing` are numbers and texts that stand for not known."""
    import polars as pl

    words = [word for word in missing if isinstance(word, str)]
    marks = [float(mark) for mark in missing if not isinstance(mark, str)]
    if series.dtype != pl.String:
        return _known(series.cast(pl.Float64), marks)
    plain = series.str.replace(",", ".", literal=True) if decimal_comma else series
    values = plain.cast(pl.Float64, strict=False)
    odd = values.is_null() & series.is_not_null()
    if words:
        odd = odd | series.str.strip_chars().is_in(words).fill_null(False)
    rows = odd.arg_true()
    if not rows.len():
        return _known(values, marks)
    cells = series.filter(odd)
    worth = {cell: number_of(cell, words) for cell in cells.unique()}
    found = _known(
        values.scatter(rows, pl.Series([worth[cell] for cell in cells], dtype=pl.Float64)), marks
    )
    bad = [row for row, cell in zip(rows, cells, strict=True) if worth[cell] is None]
    return found._replace(bad=len(bad), row=bad[0], cell=str(series[bad[0]])) if bad else found


def _known(values: pl.Series, marks: list[float]) -> Numbers:
    known = values.is_finite().fill_null(False)
    marked = values.is_in(marks).fill_null(False) if marks else None
    if marked is None or not marked.any():
        return Numbers(values.set(~known, None))
    return Numbers(values.set(~known | marked, None), int(marked.sum()))
