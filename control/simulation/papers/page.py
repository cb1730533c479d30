"""What a page of reproductions is made of: sections with words, tables and pictures, before anybody draws them."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

Cell = str | float | None


class Table(NamedTuple):
    """`decimals`: of the numbers, column by column; rows of as many cells as columns."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    decimals: tuple[int, ...]


class Line(NamedTuple):
    """`kind`: published, ours or other; `joined`: a line, otherwise marks."""

    name: str
    kind: str
    x: Sequence[float]
    y: Sequence[float]
    joined: bool = False


class Picture(NamedTuple):
    title: str
    x: str
    y: str
    lines: tuple[Line, ...]


class Section(NamedTuple):
    title: str
    words: tuple[str, ...]
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
