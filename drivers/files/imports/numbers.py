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
    text = pl.col("cell").str.strip_chars()
    plain = text.str.replace_all(r"[\s ' ]", "")
    if decimal_comma:
        both = plain.str.contains(".", literal=True) & plain.str.contains(",", literal=True)
        plain = pl.when(both).then(plain.str.replace_all(".", "", literal=True)).otherwise(plain)
        plain = plain.str.replace(",", ".", literal=True)
    frame = series.alias("cell").to_frame().with_columns(
        value=plain.cast(pl.Float64, strict=False),
        nothing=text.is_null() | text.str.to_lowercase().is_in(list(NOTHING)) | text.is_in(words))
    frame = frame.with_columns(bad=pl.col("value").is_null() & ~pl.col("nothing"))
    if not decimal_comma and frame["bad"].any():
        grouped = plain.str.replace_all(",", "", literal=True)
        swapped = plain.str.replace(",", ".", literal=True)
        again = pl.when(plain.str.contains(".", literal=True)).then(grouped).otherwise(swapped)
        frame = frame.with_columns(value=pl.when("bad").then(again.cast(pl.Float64, strict=False)).otherwise("value"))
        frame = frame.with_columns(bad=pl.col("value").is_null() & ~pl.col("nothing"))
    values = _finite(frame.select(pl.when("nothing").then(None).otherwise("value").alias("value"))["value"], marks)
    count = int(frame["bad"].sum())
    row = int(frame["bad"].arg_true()[0]) if count else 0
    return Numbers(values, count, row, str(series[row]) if count else "")


def _finite(values: pl.Series, marks: list[float]) -> pl.Series:
    known = values.is_finite()
    if marks:
        known = known & ~values.is_in(marks)
    return values.set(~known.fill_null(False), None)
