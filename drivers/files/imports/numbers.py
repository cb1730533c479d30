"""Cells of a foreign table as numbers: decimal commas, thousands, words and numbers for not known."""
from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import polars as pl

from drivers.files.imports.header import NOTHING


class Numbers(NamedTuple):
    """`values`: Float64, null: not known. `marked`: how many cells hold a number that stands for that. `bad`: how many
    are no number; `row`, `cell`: the first of them."""

    values: pl.Series
    marked: int = 0
    bad: int = 0
    row: int = 0
    cell: str = ""


def numbers(series: pl.Series, decimal_comma: bool, missing: Iterable[float | str] = ()) -> Numbers:
    """A column as numbers; `missing` are numbers and texts that stand for not known."""
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
    cells, bad = _odd_cells(series.filter(odd), words)
    found = _known(values.scatter(rows, cells), marks)
    if not bad.any():
        return found
    first = int(rows.filter(bad)[0])
    return found._replace(bad=int(bad.sum()), row=first, cell=str(series[first]))


def _odd_cells(cells: pl.Series, words: list[str]) -> tuple[pl.Series, pl.Series]:
    """Cells that are no plain number: what they are worth, and which are no number at all.

    Blanks and apostrophes group digits. Of a point and a comma the last is the decimal sign; a comma alone is one.
    """
    text = pl.col("cell").str.strip_chars()
    plain = text.str.replace_all(r"[\s'\u{2019}\u{A0}\u{202F}]", "")
    comma_last, point_last = plain.str.contains(r"\.[^.]*,[^.]*$"), plain.str.contains(r",[^,]*\.[^,]*$")
    plain = pl.when(comma_last).then(plain.str.replace_all(".", "", literal=True)).when(point_last).then(
        plain.str.replace_all(",", "", literal=True)).otherwise(plain)
    plain = plain.str.replace(",", ".", literal=True)
    frame = cells.alias("cell").to_frame().select(
        value=plain.cast(pl.Float64, strict=False),
        nothing=text.str.to_lowercase().is_in(list(NOTHING)) | text.is_in(words))
    values = frame.select(pl.when("nothing").then(None).otherwise("value").alias("value"))["value"]
    return values, frame["value"].is_null() & ~frame["nothing"]


def _known(values: pl.Series, marks: list[float]) -> Numbers:
    known = values.is_finite().fill_null(False)
    marked = values.is_in(marks).fill_null(False) if marks else None
    if marked is None or not marked.any():
        return Numbers(values.set(~known, None))
    return Numbers(values.set(~known | marked, None), int(marked.sum()))
