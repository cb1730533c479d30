"""Units that stand in a column of their own: `unit` with l/ha in every row, `Rate_Unit` next to `Rate`."""
from __future__ import annotations

import re
from collections.abc import Collection, Mapping

from drivers.files.imports.units import of_a_rate, unit_named
from drivers.files.imports.words import folded
from drivers.files.prescriptions.cells import cell_of
from drivers.files.prescriptions.column_words import kind_of, words_of
from drivers.files.stated_units import ANY, Stated, StatedUnit, names_unit

MOST_UNITS = 20                 # different texts of a column of units


def unit_columns(texts: Mapping[str, Collection[str]]) -> dict[str, StatedUnit]:
    """Units by the column that they are of, in small letters; ANY where that is not said. texts: the different ones of
    each column.

    A column holds units by its name, where its cells are units or one word all along, or by its cells, where all are
    units of rates. One that names ground (Mgmt_Unit: North, South) is none.
    """
    found = Stated()
    for name, written in texts.items():
        cells = sorted({cell.strip() for cell in written} - {""})
        if not 0 < len(cells) <= MOST_UNITS or any(cell_of(cell) is not None for cell in cells):
            continue
        of = [word for word in words_of(name) if not names_unit(word)]
        said = names_unit(name) and (any(map(of_a_rate, cells)) or (len(cells) == 1 and not of)
                                     or all(map(unit_named, cells)))
        if not said and not all(map(of_a_rate, cells)):
            continue
        column = next((other for other in texts if other != name and _is_of(other, name)), ANY)
        kinds = set(map(kind_of, of))
        if column != ANY or "rate" in kinds or not kinds & {"a measurement", "a size"}:
            for cell in cells:
                found.add(column.casefold(), cell, f"column {name}", sure=True)
    return dict(found)


def _is_of(column: str, unit_column: str) -> bool:
    """`Rate_Unit` and `rateUnit` are of `Rate`, `Unit2` is of `Rate2`."""
    parts = re.sub(r"(?<=\D)(?=\d+$)", "_", folded(unit_column)).split("_")
    left = "_".join(part for part in parts if not names_unit(part))
    plain = folded(column)
    return bool(left) and (plain == left or (left.isdigit() and re.search(rf"\D{left}$", plain) is not None))
