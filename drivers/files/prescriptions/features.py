"""How do polygons with attributes become zones? The column of the rate and its unit are determined
for shapefile and GeoJSON.
"""

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
from topdress.drivers.files.imports.column_vocabulary import find_rate_role
from topdress.drivers.files.imports.import_errors import format_list
from topdress.drivers.files.imports.units import find_named_unit
from topdress.drivers.files.prescriptions.column_words import (
    BOUND_WORDS,
    NUTRIENT_NAMES,
    Cell,
    find_unit_columns,
    find_word_kind,
    parse_cell,
    split_name_words,
    split_own_unit,
)
from topdress.drivers.files.prescriptions.map_choices import (
    NITROGEN_UNITS,
    RATE_UNITS,
    UNIT_NOT_NAMED,
    ImportedMap,
    NoPolygonsError,
    PrescriptionError,
    RateChoice,
    RateQuestion,
    apply_fallback_choice,
    calc_factor_kg_ha,
    check_degrees,
    check_index_value,
    check_rate_kg_ha,
)
from topdress.drivers.files.stated_units import (
    ANY_COLUMN,
    NO_UNITS,
    StatedUnit,
    merge_units,
    read_side_units,
)
from topdress.drivers.plain_text import PlaceInFile

# A wrong column is a wrong dose on a whole field. Therefore only a column whose name means a rate
# is chosen by name, type and range, and the choice is reported; all other cases are a question to
# the operator. This is the unit of a rate where neither file nor operator names a unit.
DEFAULT_RATE_UNIT = "kg/ha"
# Largest number of columns listed in a message.
MAX_SHOWN_COLUMNS = 12
# Units of a rate of nitrogen, by the unit that its column names.
NITROGEN_UNIT_OF: dict[str | None, str] = {None: "kg N/ha", "kg/ha": "kg N/ha", "lb/ac": "lb N/ac"}
# Number of consecutive integers that may be numbers of classes; 1 and 2 alone do not show classes.
MIN_CLASS_LEVELS = 3


class RateColumn(NamedTuple):
    """Holds the column of the rate. `cells` are numbers or empty, one for each row. `unit` is the
    unit of the numbers, `unit_from` its source. `why` is the reason of the choice."""

    name: str
    cells: tuple[Cell, ...]
    unit: str
    unit_from: str
    why: str
    # The column that holds the unit; empty for a unit outside of the table.
    unit_column: str = ""


class _NumberColumn(NamedTuple):
    """Holds a column of numbers. `is_rate` tells whether its name means a rate. `doubt` is the
    reason why it may nevertheless be another quantity."""

    name: str
    cells: tuple[Cell, ...]
    words: frozenset[str]
    is_rate: bool
    doubt: str
    unit: str | None
    # Units in the name, none or more than one of which is a unit of a rate.
    unread: str

    @property
    def text(self) -> str:
        """Returns the column with its range, for a message."""
        known = [cell.value for cell in self.cells if not math.isnan(cell.value)]
        return (
            f"{self.name} ({min(known):g} to "
            f"{max(known):g}{', ' + self.doubt if self.doubt else ''})"
        )


def find_rate_column(
    path: Path,
    numbered: Sequence[tuple[int, Mapping[str, Any]]],
    choice: RateChoice,
    side_units: Mapping[str, StatedUnit],
) -> RateColumn:
    """Returns the column of the rate, with its unit.

    Parameters
    ----------
    path : the file, for messages.
    numbered : rows with the numbers by which people count them.
    choice : the operator's choice.
    side_units : units by column, in small letters.

    Raises
    ------
    RateQuestion : the file does not show which column it is.
    PrescriptionError : no column can be the rate.
    """
    # The columns keep the order of the file, which the user knows.
    names = list(dict.fromkeys(name for _, row in numbered for name in row))
    texts = {
        name: {cell for _, row in numbered if isinstance(cell := row.get(name), str)}
        for name in names
    }
    # Units in the table are preferred to units in companion files.
    side_units = merge_units(side_units, find_unit_columns(texts))
    # An index has no unit, so its column is chosen by the name alone.
    if choice.index is not None:
        return _take_chosen_column(
            path,
            numbered,
            names,
            choice,
            choice.column or _find_index_column(path, names, choice.index),
            side_units,
        )
    # The user's choice is never replaced by a guess.
    if choice.column is not None:
        return _take_chosen_column(path, numbered, names, choice, choice.column, side_units)
    columns = {name: _read_cells(numbered, name) for name in names}
    numbers = [
        _classify_column(name, cells)
        for name, cells in columns.items()
        # Columns without any number cannot be the rate.
        if cells is not None and not all(math.isnan(cell.value) for cell in cells)
    ]
    rates = [one for one in numbers if one.is_rate]
    best = _find_only_rate(rates)
    # The rejected columns are reported, so that a wrong choice is visible.
    if best is not None:
        others = ", ".join(one.name for one in rates if one is not best)
        return _assign_unit(
            path, best, choice, "by its name" + (f", not {others}" if others else ""), side_units
        )
    if not numbers:
        raise PrescriptionError(
            path,
            "rate column not chosen: allowed a column of numbers (columns: {columns_there})",
            columns_there=", ".join(names) or "-",
        )
    # The reason of the question helps the user to choose.
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
        f" ({why}: {'; '.join(one.text for one in numbers[:MAX_SHOWN_COLUMNS])}; "
        "--column says which)",
        tuple(one.name for one in numbers),
        of_numbers=", ".join(one.name for one in numbers[:MAX_SHOWN_COLUMNS]),
    )


def _find_index_column(path: Path, names: Sequence[str], index: str) -> str:
    """Returns the column of an index: by its name regardless of case, else the only column. Raises
    RateQuestion."""
    # The exact name is preferred to a name that only contains the index.
    named_so = [name for name in names if name.casefold() == index.casefold()]
    found = named_so or [name for name in names if index.casefold() in name.casefold()] or names
    # Two columns of one index may be different dates, and a guess would be a wrong dose.
    if len(found) != 1:
        raise RateQuestion(
            path,
            "{index} not found: allowed is a column (or band) of this name, of {columns_there}",
            columns=tuple(names),
            index=index,
            columns_there=", ".join(names[:MAX_SHOWN_COLUMNS]) or "-",
        )
    return found[0]


def _take_chosen_column(
    path: Path,
    numbered: Sequence[tuple[int, Mapping[str, Any]]],
    names: Sequence[str],
    choice: RateChoice,
    column: str,
    side_units: Mapping[str, StatedUnit],
) -> RateColumn:
    """Returns the column that the operator chose. Raises PrescriptionError where it is missing or
    holds a text."""
    if column not in names:
        raise PrescriptionError(
            path,
            "column {column}: allowed {columns_there}",
            column=column,
            columns_there=", ".join(names) or "-",
        )
    cells = _read_cells(numbered, column)
    if cells is None:
        # The first wrong cell is shown, because all others are probably equal in kind.
        number, row = next(row for row in numbered if parse_cell(row[1].get(column)) is None)
        raise PrescriptionError(
            PlaceInFile(str(path)).go_down("row {row}", row=number),
            "{column} {value}: allowed is a number",
            column=column,
            value=repr(row.get(column)),
        )
    return _assign_unit(path, _classify_column(column, cells), choice, "chosen", side_units)


def _find_only_rate(rates: Sequence[_NumberColumn]) -> _NumberColumn | None:
    """Returns the only rate; among a target rate and applied rates or bounds, the target. None
    where several are possible."""
    # A single doubtful column makes every choice uncertain.
    if any(one.doubt for one in rates):
        return None
    no_target = [
        one for one in rates if one.words & BOUND_WORDS or find_rate_role(one.name) == "done"
    ]
    wanted = [one for one in rates if one not in no_target and find_rate_role(one.name) == "wanted"]
    # The target is chosen only if all others are certainly something else.
    left = wanted if len(wanted) == 1 and len(no_target) == len(rates) - 1 else rates
    return left[0] if len(left) == 1 else None


def _read_cells(
    numbered: Sequence[tuple[int, Mapping[str, Any]]], name: str
) -> tuple[Cell, ...] | None:
    """Returns the column's cells; None where a cell is no number."""
    cells = []
    for _, row in numbered:
        cell = parse_cell(row.get(name))
        if cell is None:
            # One text makes the whole column a column of texts.
            return None
        cells.append(cell)
    return tuple(cells)


def _classify_column(name: str, cells: tuple[Cell, ...]) -> _NumberColumn:
    plain, text = split_own_unit(name)
    written = {cell.unit for cell in cells if cell.unit} | ({text} if text else set())
    units = {_find_rate_unit(one) for one in written}
    # Several units in one column cannot be converted by one factor.
    unread = ", ".join(sorted(written)) if len(units) > 1 or None in units else ""
    spelled = split_name_words(plain if text and not unread else name)
    kinds = [find_word_kind(word) for word in spelled]
    # A measured quantity, such as a yield, may have the unit of a rate.
    is_rate = ("rate" in kinds or bool(units - {None})) and "a measurement" not in kinds
    if is_rate and {"a number or a class", "a size"} & set(kinds):
        # `Rate_Class` is a class, `Class_Rate` a rate: the last word is the noun.
        is_rate = kinds[-1] == "rate"
    other = next((kind for kind in kinds if kind not in ("", "rate")), "")
    doubt = f"in {unread}" if unread else "" if units else _describe_doubt(cells)
    return _NumberColumn(
        name,
        cells,
        frozenset(spelled),
        is_rate,
        # The doubt about a column without a rate name is its other meaning.
        doubt if is_rate else other or doubt,
        None if unread else next(iter(units), None),
        unread,
    )


def _find_rate_unit(text: str) -> str | None:
    """Returns the unit of a rate that a text names; None for another text."""
    found = find_named_unit(text)
    return found.name if found is not None and found.name in RATE_UNITS else None


def _describe_doubt(cells: Sequence[Cell]) -> str:
    """Returns a description of what the numbers may be instead of a rate; empty without a doubt."""
    known = sorted({cell.value for cell in cells if not math.isnan(cell.value)})
    if not known:
        return ""
    if (
        # Consecutive integers are typical for numbers of zones.
        len(known) >= MIN_CLASS_LEVELS
        and known[0] in (0.0, 1.0)
        and known == [known[0] + k for k in range(len(known))]
    ):
        return "counts 0, 1, 2 ... as numbers of classes or rows do"
    # Rates in kg/ha are hardly ever all below 1.
    if len(known) >= MIN_CLASS_LEVELS and known[-1] <= 1.0:
        return "nothing above 1, as an index or a share"
    return ""


def _locate_column(path: Path, one: _NumberColumn) -> PlaceInFile:
    """Returns the place of a column, for messages."""
    return PlaceInFile(str(path)).go_down("column {column}", column=one.name)


def _assign_unit(
    path: Path, one: _NumberColumn, choice: RateChoice, why: str, stated: Mapping[str, StatedUnit]
) -> RateColumn:
    """Returns the column with the operator's unit, else with the unit from the file or its
    companion files. A rate of a nutrient is no rate of the product. Raises RateQuestion."""
    # The operator's unit overrides all other sources.
    if choice.unit is not None:
        return RateColumn(one.name, one.cells, choice.unit, "chosen", why)
    unit, source, unit_column = one.unit, "the file", ""
    if one.unread:
        raise _ask_for_unit(path, one, StatedUnit(one.unread, "its own name"), None)
    for said in (stated.get(one.name.casefold()), stated.get(ANY_COLUMN)):
        if said is None:
            continue
        meant = _find_rate_unit(said.text)
        # Two sources that contradict each other need a decision of the operator.
        if meant is None or unit not in (None, meant):
            raise _ask_for_unit(path, one, said, unit)
        if unit is None or source == "the file":
            source, unit_column = said.source, said.unit_column
        unit = meant
    nutrient = next(
        (nutrient for word in sorted(one.words) if (nutrient := NUTRIENT_NAMES.get(word))), ""
    )
    # The share of nitrogen converts a rate of nitrogen to a rate of the product.
    if nutrient == "nitrogen" and choice.n_fraction is not None and unit in NITROGEN_UNIT_OF:
        unit = NITROGEN_UNIT_OF[unit]
        return RateColumn(one.name, one.cells, unit, f"named in {source}", why, unit_column)
    # Without that share the rate of the product would be wrong by a factor of two.
    if nutrient and unit not in NITROGEN_UNITS:
        raise RateQuestion(
            _locate_column(path, one),
            "kg of {nutrient} or of the product: say the unit",
            ": allowed with --unit "
            + (
                f"{unit or DEFAULT_RATE_UNIT} (product), or --nitrogen SHARE of N in the product"
                if nutrient == "nitrogen"
                else f"{unit or DEFAULT_RATE_UNIT}, and --scale where the product holds "
                "only a share of it"
            ),
            nutrient=nutrient,
        )
    # Without any unit kg/ha is assumed, and the report says so.
    if unit is None:
        return RateColumn(one.name, one.cells, DEFAULT_RATE_UNIT, UNIT_NOT_NAMED, why)
    return RateColumn(one.name, one.cells, unit, f"named in {source}", why, unit_column)


def _ask_for_unit(
    path: Path, one: _NumberColumn, said: StatedUnit, unit: str | None
) -> RateQuestion:
    return RateQuestion(
        _locate_column(path, one),
        "unit {stated} in {source}: say which unit holds"
        if unit is None
        else "unit {stated} in {source}, {named} by its own name: say which unit holds",
        " (--unit)",
        stated=said.text,
        source=said.source,
        named=unit,
    )


# Columns of topdress's own files that are no rate.
KNOWN_EXTRA_COLUMNS = ("title",)


class Feature(NamedTuple):
    """Holds a shape. `number` counts from 1. `polygons_deg` has for each polygon its outline, then
    holes, in latitude and longitude."""

    number: int
    attributes: Mapping[str, Any]
    polygons_deg: Sequence[tuple[Floats, ...]]


def build_imported_map(
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
) -> ImportedMap:
    """Returns the zones of features, by the operator's choice.

    Parameters
    ----------
    path : the file; units in its companion files are read too.
    format_name : name of the format in reports.
    features : shapes with the attributes of each.
    choice : the operator's choice.
    findings : findings of the reading so far; more are added.
    fallbacks : rates of the file outside of all zones, kg/ha.
    fields_deg : outlines of fields, (k, 2) latitude and longitude.
    title : title of the map.
    product : product that the file names.
    units : units of columns that the file states outside of their names.

    Returns
    -------
    the prescription as read.

    Raises
    ------
    RefusedInput : the map cannot be used, or a question is open.
    OSError : a companion file cannot be read.
    """
    if not features:
        raise NoPolygonsError(path, "no polygons: allowed is at least one")
    # A folder or zip was read with its companion files before.
    if path.is_file():
        columns = {name for feature in features for name in feature.attributes}
        units = merge_units(
            units, read_side_units(Folder(path.parent, deep=False), path.name, columns)
        )
    chosen = find_rate_column(
        path, [(feature.number, feature.attributes) for feature in features], choice, units
    )
    column, unit = chosen.name, chosen.unit
    where = PlaceInFile(str(path))
    factor = calc_factor_kg_ha(choice, unit, where.go_down("column {column}", column=column))
    zones: list[Zone] = []
    empty = 0
    for feature, cell in zip(features, chosen.cells, strict=True):
        # A zone without a rate is a gap of the map, not a rate of 0.
        if math.isnan(cell.value):
            empty += 1
            continue
        rate = _check_number(
            choice,
            cell.value * factor,
            where.go_down("row {row}: {column}", row=feature.number, column=column),
        )
        zones += [Zone(rate, rings) for rings in feature.polygons_deg]
    unused = [
        name
        for name in dict.fromkeys(name for feature in features for name in feature.attributes)
        if name not in (column, chosen.unit_column) and name not in KNOWN_EXTRA_COLUMNS
    ]
    # Unused columns are listed, because one of them may be the intended rate.
    if unused:
        findings.append(
            Finding(
                "unused_columns", f"{many(len(unused), 'column')} not used: {format_list(unused)}"
            )
        )
    if empty:
        findings.append(
            Finding(
                "empty_rates", f"{many(empty, 'polygon')} without a rate left out", column, empty
            )
        )
    # An empty column would apply nothing on the whole field.
    if not zones:
        raise PrescriptionError(
            where.go_down("column {column}", column=column), "empty everywhere: allowed is a number"
        )
    # Degrees are verified at the end, when all zones are known.
    check_degrees(path, np.concatenate([rings[0] for _, rings, _ in zones]))
    data = MapData(
        tuple(zones),
        None,
        apply_fallback_choice(fallbacks, choice, where),
        fields_deg,
        title,
        product,
    )
    return ImportedMap(
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


def _check_number(choice: RateChoice, value: float, where: PlaceInFile) -> float:
    """Returns a rate or an index within its range. Raises PrescriptionError."""
    if choice.index is not None:
        return check_index_value(value, choice.index, lambda: where)
    return check_rate_kg_ha(value, lambda: where)


def convert_ring_deg(corners: Sequence[Sequence[float]] | Floats) -> Floats:
    """Returns a ring (k, 2) in latitude and longitude, not closed, from corners in longitude and
    latitude."""
    lon_lat = np.asarray([corner[:2] for corner in corners], dtype=np.float64).reshape(-1, 2)
    # Most formats repeat the first corner at the end of a ring.
    if len(lon_lat) > 1 and (lon_lat[0] == lon_lat[-1]).all():
        lon_lat = lon_lat[:-1]
    return np.ascontiguousarray(lon_lat[:, ::-1])
