"""How do polygons with attributes, as shapefile and GeoJSON have them, become zones: which
column is the rate, in which unit?"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from topdress.control.recordings.finding import Finding, many
from topdress.control.targets.prescription import NO_FALLBACKS, Fallbacks, MapData, Zone
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.archives import Folder
from topdress.drivers.files.imports.trouble import listed
from topdress.drivers.files.imports.units import unit_named
from topdress.drivers.files.imports.words import wanted_or_done
from topdress.drivers.files.prescriptions.column_words import (
    BOUNDS,
    NUTRIENTS,
    Cell,
    cell_of,
    kind_of,
    own_unit,
    unit_columns,
    words_of,
)
from topdress.drivers.files.prescriptions.words import (
    NITROGEN_UNITS,
    UNIT_NOT_NAMED,
    UNITS,
    Imported,
    NoPolygons,
    PrescriptionError,
    RateChoice,
    RateQuestion,
    check_degrees,
    checked_index,
    checked_rate,
    factor_kg_ha,
    with_choice,
)
from topdress.drivers.files.stated_units import ANY, NO_UNITS, StatedUnit, side_units, together
from topdress.drivers.plain_text import PlaceInFile

# Which column of a map's attributes is the rate, and in which unit: by name, by type, by range.
#
# A wrong column is a wrong dose on a whole field. So only a column whose name says that it is a
# rate is taken, and that is said; all else is a question to the operator.
# The unit of a rate where nothing names a unit.
PLAIN_UNIT = "kg/ha"
# Columns listed in a message.
MOST_SHOWN = 12
# Units of a rate of nitrogen, by the unit that its column names.
OF_NITROGEN: dict[str | None, str] = {None: "kg N/ha", "kg/ha": "kg N/ha", "lb/ac": "lb N/ac"}
# 1, 2, 3 may be numbers of classes; 1 and 2 alone do not show it.
LEAST_LEVELS = 3


class RateColumn(NamedTuple):
    """Holds the column of the rate. `cells`: of every row, a number or nothing. `unit`: of the
    numbers; `unit_from`: who names it. `why`: why this column was taken."""

    name: str
    cells: tuple[Cell, ...]
    unit: str
    unit_from: str
    why: str
    # The column that holds the unit; empty: the unit stands elsewhere.
    unit_column: str = ""


class _NumberColumn(NamedTuple):
    """Holds a column of numbers. `is_rate`: its name says so. `doubt`: why it may be something
    else all the same."""

    name: str
    cells: tuple[Cell, ...]
    words: frozenset[str]
    is_rate: bool
    doubt: str
    unit: str | None
    # units that it names, of which none, or not one alone, is one of a rate
    unread: str

    @property
    def text(self) -> str:
        """Returns the column with its range, for a message."""
        known = [cell.value for cell in self.cells if not math.isnan(cell.value)]
        return (
            f"{self.name} ({min(known):g} to "
            f"{max(known):g}{', ' + self.doubt if self.doubt else ''})"
        )


def rate_column(
    path: Path,
    numbered: Sequence[tuple[int, Mapping[str, Any]]],
    choice: RateChoice,
    side_units: Mapping[str, StatedUnit],
) -> RateColumn:
    """Returns the column of the rate, with its unit.

    Parameters
    ----------
    path : the file, for messages.
    numbered : rows with the numbers by which people find them.
    choice : the operator's.
    side_units : units by column, in small letters.

    Raises
    ------
    RateQuestion : the file does not say which column it is.
    PrescriptionError : no column can be the rate.
    """
    names = list(dict.fromkeys(name for _, row in numbered for name in row))
    texts = {
        name: {cell for _, row in numbered if isinstance(cell := row.get(name), str)}
        for name in names
    }
    side_units = together(side_units, unit_columns(texts))
    if choice.index is not None:
        return _chosen(
            path,
            numbered,
            names,
            choice,
            choice.column or _index_of(path, names, choice.index),
            side_units,
        )
    if choice.column is not None:
        return _chosen(path, numbered, names, choice, choice.column, side_units)
    columns = {name: _cells(numbered, name) for name in names}
    numbers = [
        _seen(name, cells)
        for name, cells in columns.items()
        if cells is not None and not all(math.isnan(cell.value) for cell in cells)
    ]
    rates = [one for one in numbers if one.is_rate]
    best = _best(rates)
    if best is not None:
        others = ", ".join(one.name for one in rates if one is not best)
        return _with_unit(
            path, best, choice, "by its name" + (f", not {others}" if others else ""), side_units
        )
    if not numbers:
        raise PrescriptionError(
            path,
            "rate column not chosen: allowed a column of numbers (columns: {columns_there})",
            columns_there=", ".join(names) or "-",
        )
    why = (
        f"{len(rates)} are named as rates"
        if len(rates) > 1
        else f"{rates[0].name}: {rates[0].doubt}"
        if rates
        else "none is named as a rate"
    )
    raise RateQuestion(
        path,
        "rate column not chosen: allowed {of_numbers}",
        f" ({why}: {'; '.join(one.text for one in numbers[:MOST_SHOWN])}; --column says which)",
        tuple(one.name for one in numbers),
        of_numbers=", ".join(one.name for one in numbers[:MOST_SHOWN]),
    )


def _index_of(path: Path, names: Sequence[str], index: str) -> str:
    """Returns the column of an index: by its name in whatever letters, else the only one. Raises
    RateQuestion."""
    named_so = [name for name in names if name.casefold() == index.casefold()]
    found = named_so or [name for name in names if index.casefold() in name.casefold()] or names
    if len(found) != 1:
        raise RateQuestion(
            path,
            "{index} not found: allowed is a column (or band) of this name, of {columns_there}",
            columns=tuple(names),
            index=index,
            columns_there=", ".join(names[:MOST_SHOWN]) or "-",
        )
    return found[0]


# Returns the column that the operator chose. Raises PrescriptionError where it is missing or holds
# a text.
def _chosen(
    path: Path,
    numbered: Sequence[tuple[int, Mapping[str, Any]]],
    names: Sequence[str],
    choice: RateChoice,
    column: str,
    side_units: Mapping[str, StatedUnit],
) -> RateColumn:
    if column not in names:
        raise PrescriptionError(
            path,
            "column {column}: allowed {columns_there}",
            column=column,
            columns_there=", ".join(names) or "-",
        )
    cells = _cells(numbered, column)
    if cells is None:
        number, row = next(row for row in numbered if cell_of(row[1].get(column)) is None)
        raise PrescriptionError(
            PlaceInFile(str(path)).at("row {row}", row=number),
            "{column} {value}: allowed is a number",
            column=column,
            value=repr(row.get(column)),
        )
    return _with_unit(path, _seen(column, cells), choice, "chosen", side_units)


def _best(rates: Sequence[_NumberColumn]) -> _NumberColumn | None:
    """Returns the only rate; of a target rate next to applied ones or bounds, the target. None:
    several are possible."""
    if any(one.doubt for one in rates):
        return None
    no_target = [one for one in rates if one.words & BOUNDS or wanted_or_done(one.name) == "done"]
    wanted = [one for one in rates if one not in no_target and wanted_or_done(one.name) == "wanted"]
    left = wanted if len(wanted) == 1 and len(no_target) == len(rates) - 1 else rates
    return left[0] if len(left) == 1 else None


def _cells(numbered: Sequence[tuple[int, Mapping[str, Any]]], name: str) -> tuple[Cell, ...] | None:
    """Returns the column's cells; None where a cell is no number."""
    cells = []
    for _, row in numbered:
        cell = cell_of(row.get(name))
        if cell is None:
            return None
        cells.append(cell)
    return tuple(cells)


def _seen(name: str, cells: tuple[Cell, ...]) -> _NumberColumn:
    plain, text = own_unit(name)
    written = {cell.unit for cell in cells if cell.unit} | ({text} if text else set())
    units = {_unit(one) for one in written}
    unread = ", ".join(sorted(written)) if len(units) > 1 or None in units else ""
    spelled = words_of(plain if text and not unread else name)
    kinds = [kind_of(word) for word in spelled]
    is_rate = ("rate" in kinds or bool(units - {None})) and "a measurement" not in kinds
    if is_rate and {"a number or a class", "a size"} & set(kinds):
        # `Rate_Class` is a class, `Class_Rate` a rate: the last word is the noun.
        is_rate = kinds[-1] == "rate"
    other = next((kind for kind in kinds if kind not in ("", "rate")), "")
    doubt = f"in {unread}" if unread else "" if units else _looks_like(cells)
    return _NumberColumn(
        name,
        cells,
        frozenset(spelled),
        is_rate,
        doubt if is_rate else other or doubt,
        None if unread else next(iter(units), None),
        unread,
    )


def _unit(text: str) -> str | None:
    """Returns the unit of a rate that a text names; None: no such unit."""
    found = unit_named(text)
    return found.name if found is not None and found.name in UNITS else None


def _looks_like(cells: Sequence[Cell]) -> str:
    """Returns what the numbers are rather than a rate; empty: nothing else."""
    known = sorted({cell.value for cell in cells if not math.isnan(cell.value)})
    if not known:
        return ""
    if (
        len(known) >= LEAST_LEVELS
        and known[0] in (0.0, 1.0)
        and known == [known[0] + k for k in range(len(known))]
    ):
        return "counts 0, 1, 2 ... as numbers of classes or rows do"
    if len(known) >= LEAST_LEVELS and known[-1] <= 1.0:
        return "nothing above 1, as an index or a share"
    return ""


# Returns the place of a column, for messages.
def _column(path: Path, one: _NumberColumn) -> PlaceInFile:
    return PlaceInFile(str(path)).at("column {column}", column=one.name)


def _with_unit(
    path: Path, one: _NumberColumn, choice: RateChoice, why: str, stated: Mapping[str, StatedUnit]
) -> RateColumn:
    """Returns the column with the operator's unit, else with the unit that the file or a file
    next to it names. A nutrient's rate is no rate of the product. Raises RateQuestion."""
    if choice.unit is not None:
        return RateColumn(one.name, one.cells, choice.unit, "chosen", why)
    unit, source, unit_column = one.unit, "the file", ""
    if one.unread:
        raise _which_unit(path, one, StatedUnit(one.unread, "its own name"), None)
    for said in (stated.get(one.name.casefold()), stated.get(ANY)):
        if said is None:
            continue
        meant = _unit(said.text)
        if meant is None or unit not in (None, meant):
            raise _which_unit(path, one, said, unit)
        if unit is None or source == "the file":
            source, unit_column = said.source, said.unit_column
        unit = meant
    nutrient = next(
        (nutrient for word in sorted(one.words) if (nutrient := NUTRIENTS.get(word))), ""
    )
    if nutrient == "nitrogen" and choice.n_fraction is not None and unit in OF_NITROGEN:
        unit = OF_NITROGEN[unit]
        return RateColumn(one.name, one.cells, unit, f"named in {source}", why, unit_column)
    if nutrient and unit not in NITROGEN_UNITS:
        raise RateQuestion(
            _column(path, one),
            "kg of {nutrient} or of the product: say the unit",
            ": allowed with --unit "
            + (
                f"{unit or PLAIN_UNIT} (product), or --nitrogen SHARE of N in the product"
                if nutrient == "nitrogen"
                else f"{unit or PLAIN_UNIT}, and --scale where the product holds only a share of it"
            ),
            nutrient=nutrient,
        )
    if unit is None:
        return RateColumn(one.name, one.cells, PLAIN_UNIT, UNIT_NOT_NAMED, why)
    return RateColumn(one.name, one.cells, unit, f"named in {source}", why, unit_column)


def _which_unit(path: Path, one: _NumberColumn, said: StatedUnit, unit: str | None) -> RateQuestion:
    return RateQuestion(
        _column(path, one),
        "unit {stated} in {source}: say which unit holds"
        if unit is None
        else "unit {stated} in {source}, {named} by its own name: say which unit holds",
        " (--unit)",
        stated=said.text,
        source=said.source,
        named=unit,
    )


# Columns of our own files that are no rate.
KNOWN_EXTRA = ("title",)


class Feature(NamedTuple):
    """Holds a shape. `number` counts from 1 as people do. polygons_deg: for each polygon its
    outline, then holes, latitude and longitude."""

    number: int
    attributes: Mapping[str, Any]
    polygons_deg: Sequence[tuple[Floats, ...]]


def imported(
    path: Path,
    format_name: str,
    features: Sequence[Feature],
    choice: RateChoice,
    findings: list[Finding],
    *,
    fallbacks: Fallbacks = NO_FALLBACKS,
    fields_deg: tuple[tuple[Floats, ...], ...] = (),
    title: str = "",
    product: str = "",
    units: Mapping[str, StatedUnit] = NO_UNITS,
) -> Imported:
    """Returns the zones of features, by the operator's choice.

    Parameters
    ----------
    path : the file; units in files next to it are read too.
    format_name : as reports name it.
    features : with the attributes of each.
    choice : the operator's.
    findings : those of the reading so far; more are added.
    fallbacks : rates of the file where no zone lies, kg/ha.
    fields_deg : outlines of fields, (k, 2) latitude and longitude.
    title : of the map.
    product : that the file names.
    units : of columns, as the file says besides their names.

    Returns
    -------
    the prescription as read.

    Raises
    ------
    Refused : the map cannot be used, or a question is open.
    OSError : a file next to it cannot be read.
    """
    if not features:
        raise NoPolygons(path, "no polygons: allowed is at least one")
    if path.is_file():
        columns = {name for feature in features for name in feature.attributes}
        units = together(units, side_units(Folder(path.parent, deep=False), path.name, columns))
    chosen = rate_column(
        path, [(feature.number, feature.attributes) for feature in features], choice, units
    )
    column, unit = chosen.name, chosen.unit
    where = PlaceInFile(str(path))
    factor = factor_kg_ha(choice, unit, where.at("column {column}", column=column))
    zones: list[Zone] = []
    empty = 0
    for feature, cell in zip(features, chosen.cells, strict=True):
        if math.isnan(cell.value):
            empty += 1
            continue
        rate = _checked(
            choice,
            cell.value * factor,
            where.at("row {row}: {column}", row=feature.number, column=column),
        )
        zones += [Zone(rate, rings) for rings in feature.polygons_deg]
    unused = [
        name
        for name in dict.fromkeys(name for feature in features for name in feature.attributes)
        if name not in (column, chosen.unit_column) and name not in KNOWN_EXTRA
    ]
    if unused:
        findings.append(
            Finding("unused_columns", f"{many(len(unused), 'column')} not used: {listed(unused)}")
        )
    if empty:
        findings.append(
            Finding(
                "empty_rates", f"{many(empty, 'polygon')} without a rate left out", column, empty
            )
        )
    if not zones:
        raise PrescriptionError(
            where.at("column {column}", column=column), "empty everywhere: allowed is a number"
        )
    check_degrees(path, np.concatenate([rings[0] for _, rings, _ in zones]))
    data = MapData(
        tuple(zones), None, with_choice(fallbacks, choice, where), fields_deg, title, product
    )
    return Imported(
        path,
        format_name,
        data,
        unit,
        factor,
        (column,),
        tuple(findings),
        f"{column} ({chosen.why})",
        chosen.unit_from,
    )


def _checked(choice: RateChoice, value: float, where: PlaceInFile) -> float:
    """Returns a rate or an index within its range. Raises PrescriptionError."""
    if choice.index is not None:
        return checked_index(value, choice.index, lambda: where)
    return checked_rate(value, lambda: where)


def ring(corners: Sequence[Sequence[float]] | Floats) -> Floats:
    """Returns a ring (k, 2) in latitude and longitude, not closed, of corners in longitude and
    latitude."""
    lon_lat = np.asarray([corner[:2] for corner in corners], dtype=np.float64).reshape(-1, 2)
    if len(lon_lat) > 1 and (lon_lat[0] == lon_lat[-1]).all():
        lon_lat = lon_lat[:-1]
    return np.ascontiguousarray(lon_lat[:, ::-1])
