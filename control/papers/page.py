"""What a page of reproductions is made of: sections with words, tables and pictures, before anybody draws them."""
from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
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


class How(StrEnum):
    """Where the obtained figure comes from. A copied figure has none: an input cannot confirm itself."""

    RECOMPUTED = "recomputed"       # from other figures that the paper prints, by its own definition
    FITTED = "fitted"               # parameters fitted to printed data, next to the printed parameters
    SIMULATED = "simulated"         # by this program's models
    COPIED = "copied"               # taken over as an input, or printed without anything to compute it from


class Claim(NamedTuple):
    """`where`: equation, table, figure or section; `says`: what it tells. `agrees`: None where nothing is compared.
    `within`: how far apart the two may be to agree, and why so far."""

    where: str
    says: str
    published: str
    obtained: str = ""
    how: How = How.COPIED
    agrees: bool | None = None
    remark: str = ""
    within: str = ""


class Section(NamedTuple):
    title: str
    words: tuple[str, ...]
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    claims: tuple[Claim, ...] = ()
