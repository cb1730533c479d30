"""What does a table hold as its file has it, before its meaning is known?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from topdress.control.recordings.finding import Finding
from topdress.drivers.files.columns import Columns
from topdress.drivers.files.imports.header import split_unit_name
from topdress.drivers.files.imports.mapping import Source


@dataclass(frozen=True, eq=False)
class RawTable:
    """Holds a table as read. `columns`: texts (as written), numbers, or times where the file itself
    has types; those of `utc` are in UTC, others in the local time of the file.

    `units`: of columns, in the file's own words, where the header or a unit row names them.
    `first_row`: the line or row of the file that is row 0 here, for messages. `source`: how it was
    read, with everything that was found.
    """

    path: Path
    columns: Columns
    source: Source
    units: Mapping[str, str] = field(default_factory=dict)
    first_row: int = 1
    findings: tuple[Finding, ...] = ()
    above: tuple[str, ...] = ()  # what stands above the header, line by line
    utc: frozenset[str] = frozenset()
    width_m: float | None = None  # working width, where the file says one

    @property
    def names(self) -> tuple[str, ...]:
        """Returns the names of the columns, in their order."""
        return tuple(self.columns)

    @property
    def decimal_comma(self) -> bool:
        """Tells whether numbers have a decimal comma."""
        return self.source.decimal == ","


def find_units_in(names: Iterable[str]) -> dict[str, str]:
    """Returns units of columns whose own name has one, in the file's words."""
    return {name: unit for name in names if (unit := split_unit_name(name)[1]) is not None}


def split_header(cells: list[str], units: Sequence[str] | None) -> tuple[list[str], dict[str, str]]:
    """Returns names, each once, and units of columns, from the header's cells and those of a row
    of units below it."""
    # Spreadsheets write empty cells behind the last name.
    while cells and not cells[-1]:
        cells = cells[:-1]
    names = make_unique(cells)
    found = {
        name: unit
        for name, cell in zip(names, cells, strict=True)
        if (unit := split_unit_name(cell)[1]) is not None
    }
    return names, found | {
        name: cell.strip("()[] ")
        for name, cell in zip(names, units or (), strict=False)
        if cell.strip("()[]- ")
    }


def make_unique(names: list[str]) -> list[str]:
    """Returns the names with a number behind the second of equal names, and names for those that
    have none."""
    seen: set[str] = set()
    out = []
    for place, name in enumerate(names, start=1):
        wanted = name or f"column {place}"
        number, free = 1, wanted
        while free in seen:
            number += 1
            free = f"{wanted} ({number})"
        seen.add(free)
        out.append(free)
    return out
