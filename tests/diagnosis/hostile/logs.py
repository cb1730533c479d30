"""Hostile logs by number and seed: a plain machine, and one to three things that went wrong
with its recording."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .machines import MACHINES, Table
from .spoil import SPOILERS, Spoiler

# of the spoilers, at most, on top of the one that the number names
FURTHER = 2


class Hostile(NamedTuple):
    name: str
    text: str  # the file
    refusable: bool  # a program may refuse it in one line


def hostile_log(number: int, seed: int = 1) -> Hostile:
    """One of a series without end: every spoiler and every machine in turn, further spoilers
    drawn."""
    rng = np.random.default_rng((seed, number))
    machine = MACHINES[(number + number // len(MACHINES)) % len(MACHINES)]
    spoilers = [SPOILERS[number % len(SPOILERS)]]
    spoilers += [_further(rng, spoilers) for _ in range(int(rng.integers(0, FURTHER + 1)))]
    table = machine(rng)
    for one in spoilers:
        table = one.apply(rng, table)
    words = "+".join((machine.__name__, *(one.name for one in spoilers)))
    return Hostile(f"{number:03d} {words}", text_of(table), any(one.refusable for one in spoilers))


def _further(rng: np.random.Generator, had: list[Spoiler]) -> Spoiler:
    """Another one; the wide and those that end the numbers are applied alone or first."""
    left = [
        one for one in SPOILERS if one not in had and one.name not in ("wide", "words_in_numbers")
    ]
    return left[int(rng.integers(len(left)))]


def text_of(table: Table) -> str:
    """A CSV file, an empty cell for what is not a number."""
    header = ",".join(name.split("\0")[0] for name in table)
    columns = [_cells(column) for column in table.values()]
    return "\n".join((header, *map(",".join, zip(*columns, strict=True)))) + "\n"


def _cells(column: np.ndarray) -> list[str]:
    if column.dtype == object:
        return [str(cell) for cell in column]
    return [
        "" if value != value else repr(round(value, 4) if 1e-3 < abs(value) < 1e12 else value)
        for value in column.tolist()
    ]
