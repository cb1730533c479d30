"""What content does a table have before its meaning is known?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from topdress.control.recordings.finding import Finding
from topdress.drivers.files.columns import Columns
from topdress.drivers.files.imports.mapping import Source
from topdress.drivers.files.imports.table_header import split_unit_name


@dataclass(frozen=True, eq=False)
class RawTable:
    """Holds a table as read. `columns` are texts (as written), numbers, or times where the file
    itself has types; the columns in `utc` are in UTC, others in the local time of the file.

    `units` holds units of columns, in the file's own words, where the header or a row of units
    names them. `first_row` is the line or row of the file that is row 0 here, for messages.
    `source` describes how the table was read, with all detected properties.
    """

    path: Path
    columns: Columns
    source: Source
    units: Mapping[str, str] = field(default_factory=dict)
    first_row: int = 1
    findings: tuple[Finding, ...] = ()
    # The lines above the header.
    above: tuple[str, ...] = ()
    utc: frozenset[str] = frozenset()
    # Working width, m; None where the file states none.
    width_m: float | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in their order."""
        return tuple(self.columns)

    @property
    def decimal_comma(self) -> bool:
        """Whether numbers have a decimal comma."""
        return self.source.decimal == ","


def find_units_in(names: Iterable[str]) -> dict[str, str]:
    """Returns units of columns whose own name has one, in the file's words."""
    return {name: unit for name in names if (unit := split_unit_name(name)[1]) is not None}


def split_header(cells: list[str], units: Sequence[str] | None) -> tuple[list[str], dict[str, str]]:
    """Returns unique names and units of columns, from the header's cells and the cells of a row of
    units below it."""
    # Spreadsheets write empty cells after the last name.
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
    """Returns the names with a number after the second of equal names, and with names for unnamed
    columns."""
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
