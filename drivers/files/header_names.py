"""Which topdress columns does a header name? Case, units in brackets and well-known synonyms are
ignored.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

from topdress.control.recordings.finding import Finding
from topdress.drivers.files.imports.table_header import split_unit_name
from topdress.drivers.files.imports.units import (
    UNIT_OF_ENDING,
    ColumnUnit,
    find_column_unit,
    find_named_unit,
)


class RenamedHeader(NamedTuple):
    """Holds a header's names. `factors` holds, by name, the number of units of the topdress column
    in one unit of the file, where it is not 1. `trouble` describes a unit of a wrong quantity in a
    line."""

    names: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
    factors: Mapping[str, float] = {}
    # One line about a unit of a wrong quantity; empty without such a unit.
    trouble: str = ""


def rename_header(
    names: tuple[str, ...], known: Collection[str], others: Mapping[str, str]
) -> RenamedHeader:
    """Returns a header with topdress's names.

    Parameters
    ----------
    names : the names in the file.
    known : the published names.
    others : further spellings, in small letters with underscores.

    Returns
    -------
    names, findings and factors.
    """
    taken, ours, findings, factors = set(names), [], [], {}
    for name in names:
        bare, unit = _split_known_unit(name, known, others)
        plain = "_".join(bare.lower().split())
        other = plain if plain in known else others.get(plain) or _complete_by_unit(name, known)
        if (
            unit is not None
            and other.endswith("_mps")
            and f"{other[:-4]}_kmh" in others
            and unit.name == "km/h"
        ):
            other, unit = f"{other[:-4]}_kmh", None
        if other == name or other in taken:
            ours.append(name)
            continue
        factor = 1.0 if unit is None else _calc_unit_factor(unit, other)
        if factor is None:
            return RenamedHeader(
                names,
                trouble=f"column {name}: unit {unit.name if unit else ''}: allowed "
                f"{ours_in.name if (ours_in := find_column_unit(other)) else 'none'}",
            )
        if factor != 1.0:
            factors[other] = factor
        taken.add(other)
        said = "" if factor == 1.0 else f", times {factor:.6g}"
        findings.append(Finding("other_name", f"column {name} taken for {other}{said}", other))
        ours.append(other)
    return RenamedHeader(tuple(ours), tuple(findings), factors)


def _complete_by_unit(name: str, known: Collection[str]) -> str:
    """Returns the known name that a unit completes, such as `shaft_rpm` for `shaft [r/min]`; else
    the name itself."""
    bare, text = split_unit_name(name)
    unit = None if text is None else find_named_unit(text)
    if unit is None or bare == name:
        return name
    plain = "_".join(bare.lower().split())
    return next(
        (
            plain + ending
            for ending, word in UNIT_OF_ENDING.items()
            if word == unit.name and plain + ending in known
        ),
        name,
    )


def _split_known_unit(
    name: str, known: Collection[str], others: Mapping[str, str]
) -> tuple[str, ColumnUnit | None]:
    """Returns name and unit, where the name without the unit is known."""
    bare, text = split_unit_name(name)
    plain = "_".join(bare.lower().split())
    if text is None or "_".join(name.lower().split()) in {*known, *others}:
        return name, None
    return (bare, find_named_unit(text)) if plain in known or plain in others else (name, None)


def _calc_unit_factor(unit: ColumnUnit, column: str) -> float | None:
    """Returns the factor from `unit` to the column's unit; None for another quantity."""
    ours = find_column_unit(column)
    if ours is None:
        return 1.0 if unit.name == "%" else None
    return unit.factor / ours.factor if ours.quantity == unit.quantity else None
