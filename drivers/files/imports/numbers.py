"""Cells of a foreign table as numbers: decimal commas, thousands, words and numbers for not known."""
from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import polars as pl

from drivers.files.table import NOTHING


class Numbers(NamedTuple):
    """`values`: Float64, null: not known. `bad`: how many cells are no number; `row`, `cell`: the first of them."""

    values: pl.Series
    bad: int = 0
    row: int = 0
    cell: str = ""


def numbers(series: pl.Series, decimal_comma: bool, missing: Iterable[float | str] = ()) -> Numbers:
    """A column as numbers; `missing` are numbers and texts that stand for not known."""
    words = [word for word in missing if isinstance(word, str)]
    marks = [float(mark) for mark in missing if not isinstance(mark, str)]
    if series.dtype != pl.String:
        return Numbers(_finite(series.cast(pl.Float64), marks))
    plain = series.str.replace(",", ".", literal=True) if decimal_comma else series
    values = plain.cast(pl.Float64, strict=False)
    odd = values.is_null() & series.is_not_null()
    if words:
        odd = odd | series.str.strip_chars().is_in(words).fill_null(False)
    rows = odd.arg_true()
    if not rows.len():
        return Numbers(_finite(values, marks))
    cells, bad = _odd_cells(series.filter(odd), decimal_comma, words)
    values = _finite(values.scatter(rows, cells), marks)
    if not bad.any():
        return Numbers(values)
    first = int(rows.filter(bad)[0])
    return Numbers(values, int(bad.sum()), first, str(series[first]))


def _odd_cells(cells: pl.Series, decimal_comma: bool, words: list[str]) -> tuple[pl.Series, pl.Series]:
    """Cells that are no plain number: what they are worth, and which are no number at all.

    Blanks and apostrophes group digits; so does a point before a decimal comma, or a comma before a decimal point.
    """
    text = pl.col("cell").str.strip_chars()
    plain = text.str.replace_all(r"[\s'\u{2019}\u{A0}\u{202F}]", "")
    point, comma = plain.str.contains(".", literal=True), plain.str.contains(",", literal=True)
    group, sign = (".", ",") if decimal_comma else (",", ".")
    plain = pl.when(point & comma).then(plain.str.replace_all(group, "", literal=True)).otherwise(plain)
    plain = plain.str.replace(",", ".", literal=True) if sign == "," else pl.when(point).then(plain).otherwise(
        plain.str.replace(",", ".", literal=True))
    frame = cells.alias("cell").to_frame().select(
        value=plain.cast(pl.Float64, strict=False),
        nothing=text.str.to_lowercase().is_in(list(NOTHING)) | text.is_in(words))
    values = frame.select(pl.when("nothing").then(None).otherwise("value").alias("value"))["value"]
    return values, frame["value"].is_null() & ~frame["nothing"]


def _finite(values: pl.Series, marks: list[float]) -> pl.Series:
    known = values.is_finite()
    if marks:
        known = known & ~values.is_in(marks)
    return values.set(~known.fill_null(False), None)
