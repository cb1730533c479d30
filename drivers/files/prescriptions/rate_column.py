"""Which column of a map's attributes is the rate, and in which unit: by name, by type, by range.

A wrong column is a wrong dose on a whole field. So only a column whose name says that it is a rate is taken, and that
is said; all else is a question to the operator.
"""
from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from drivers.files.imports.header import named
from drivers.files.imports.units import unit_named
from drivers.files.imports.words import wanted_or_done
from drivers.files.prescriptions.cells import Cell, cell_of
from drivers.files.prescriptions.words import UNIT_NOT_NAMED, UNITS, Choice, PrescriptionError, RateQuestion
from drivers.files.shape_sets import Unit
from drivers.plain_text import Where

PLAIN_UNIT = "kg/ha"
MOST_SHOWN = 12
SHAPEFILE_NAME = 10             # letters that a shapefile leaves of a name
LEAST_LEVELS = 3                # 1, 2, 3 may be numbers of classes; 1 and 2 alone are too few to tell

# Words of a name. One of `RATE` makes it a rate, unless another, or the last one, says that it is something else.
RATE = frozenset("""
    rate rates rx rx1 dose doses dosis dosen dosage dosierung tgt target targetrate tgtrate targetrat tgtrat applrate
    apprate applicationrate appliedrate appliedrat vrate vrt vra prescription prescribed prescr recommendation recomm
    recommended appl application applied menge sollmenge zielmenge aufwandmenge ausbringmenge streumenge gabe
    düngemenge duengemenge soll sollwert setpoint debit débit taux cantidad dosi norma aufwand
    """.split())
BOUNDS = frozenset("min max minimum maximum mean avg default base previous prev last".split())   # no rate to be spread
COUNTED = frozenset("""id fid oid objectid gid uid pk key idx index nr no num number nummer numero seq row col column
    code gridcode zone zones zona zonen class classes klasse clase classe cls cluster category kategorie level group grp
    rank type""".split())
SIZED = frozenset("""area areas flaeche fläche surface superficie acres acre hectare hectares hektar ha ac m2 perimeter
    length leng len shape total sum kg mass weight amount tons""".split())
MEASURED = frozenset("""ec eca ecsh ecdp conductivity cond leitfähigkeit ph om soc cec clay sand silt elev elevation
    alt altitude height slope aspect ndvi ndre ndmi evi lai yield ertrag rendement moisture feuchte date time year day
    count pixels x y lat lon latitude longitude width speed price cost seed seeds seeding planting population
    growth infiltration temperature rain erntemenge""".split())
# Chinese names have no blanks between their words.
RATE_IN = ("施肥量", "用量", "处方", "推荐量", "推荐施", "目标量", "目标施", "追肥量")
COUNTED_IN, SIZED_IN = ("编号", "序号", "等级", "类别", "分区"), ("面积", "周长", "总量")
MEASURED_IN = ("产量", "电导率", "有机质", "高程", "坡度", "水分")
RATE_ENDS = ("rate", "menge", "gabe")
NO_RATES = frozenset("nitrate substrate moderate separate corporate accurate calibrate operate carbonate "
                     "elaborate erntemenge regenmenge".split())
NUTRIENTS = {"n": "nitrogen", "nitrogen": "nitrogen", "stickstoff": "nitrogen", "azote": "nitrogen",
             "纯氮": "nitrogen", "p2o5": "P2O5", "k2o": "K2O", "phosphate": "P2O5", "potash": "K2O"}


class RateColumn(NamedTuple):
    """`cells`: of every row, a number or nothing. `unit`: of the numbers; `unit_from`: who says so. `why`: this one."""

    name: str
    cells: tuple[Cell, ...]
    unit: str
    unit_from: str
    why: str


class _Seen(NamedTuple):
    """A column of numbers. `is_rate`: its name says so. `doubt`: why it may be something else all the same."""

    name: str
    cells: tuple[Cell, ...]
    words: frozenset[str]
    is_rate: bool
    doubt: str
    unit: str | None

    @property
    def text(self) -> str:
        known = [cell.value for cell in self.cells if not math.isnan(cell.value)]
        return f"{self.name} ({min(known):g} to {max(known):g}{', ' + self.doubt if self.doubt else ''})"


def rate_column(path: Path, numbered: Sequence[tuple[int, Mapping[str, Any]]], choice: Choice,
                side_units: Mapping[str, Unit]) -> RateColumn:
    """`numbered`: rows with the numbers by which people find them. `side_units`: units by column, in small letters.

    Raises RateQuestion where the file does not say which column it is, PrescriptionError where none can be.
    """
    names = list(dict.fromkeys(name for _, row in numbered for name in row))
    if choice.index is not None:
        return _chosen(path, numbered, names, choice, choice.column or _index_of(path, names, choice.index), side_units)
    if choice.column is not None:
        return _chosen(path, numbered, names, choice, choice.column, side_units)
    columns = {name: _cells(numbered, name) for name in names}
    numbers = [_seen(name, cells) for name, cells in columns.items() if cells is not None
               and not all(math.isnan(cell.value) for cell in cells)]
    rates = [one for one in numbers if one.is_rate]
    best = _best(rates)
    if best is not None:
        others = ", ".join(one.name for one in rates if one is not best)
        return _with_unit(path, best, choice, "by its name" + (f", not {others}" if others else ""), side_units)
    if not numbers:
        raise PrescriptionError(path, "rate column not chosen: allowed a column of numbers (columns: {columns_there})",
                                columns_there=", ".join(names) or "-")
    why = f"{len(rates)} are named as rates" if len(rates) > 1 else \
        f"{rates[0].name}: {rates[0].doubt}" if rates else "none is named as a rate"
    raise RateQuestion(path, "rate column not chosen: allowed {of_numbers}",
                       f" ({why}: {'; '.join(one.text for one in numbers[:MOST_SHOWN])}; --column says which)",
                       tuple(one.name for one in numbers),
                       of_numbers=", ".join(one.name for one in numbers[:MOST_SHOWN]))


def _index_of(path: Path, names: Sequence[str], index: str) -> str:
    """The column of an index: by its name in whatever letters, else the only one. Raises RateQuestion."""
    named_so = [name for name in names if name.casefold() == index.casefold()]
    found = named_so or [name for name in names if index.casefold() in name.casefold()] or names
    if len(found) != 1:
        raise RateQuestion(path, "{index} not found: allowed is a column (or band) of this name, of {columns_there}",
                           columns=tuple(names), index=index, columns_there=", ".join(names[:MOST_SHOWN]) or "-")
    return found[0]


def _chosen(path: Path, numbered: Sequence[tuple[int, Mapping[str, Any]]], names: Sequence[str], choice: Choice,
            column: str, side_units: Mapping[str, Unit]) -> RateColumn:
    if column not in names:
        raise PrescriptionError(path, "column {column}: allowed {columns_there}", column=column,
                                columns_there=", ".join(names) or "-")
    cells = _cells(numbered, column)
    if cells is None:
        number, row = next(row for row in numbered if cell_of(row[1].get(column)) is None)
        raise PrescriptionError(Where(str(path)).at("row {row}", row=number), "{column} {value}: allowed is a number",
                                column=column, value=repr(row.get(column)))
    return _with_unit(path, _seen(column, cells), choice, "chosen", side_units)


def _best(rates: Sequence[_Seen]) -> _Seen | None:
    """The one rate; of a wanted one and of those that were applied, or bounds, the wanted one. None: not given."""
    if any(one.doubt for one in rates):
        return None
    no_target = [one for one in rates if one.words & BOUNDS or wanted_or_done(one.name) == "done"]
    wanted = [one for one in rates if one not in no_target and wanted_or_done(one.name) == "wanted"]
    left = wanted if len(wanted) == 1 and len(no_target) == len(rates) - 1 else rates
    return left[0] if len(left) == 1 else None


def _cells(numbered: Sequence[tuple[int, Mapping[str, Any]]], name: str) -> tuple[Cell, ...] | None:
    """The column's cells; None where one of them is no number."""
    cells = []
    for _, row in numbered:
        cell = cell_of(row.get(name))
        if cell is None:
            return None
        cells.append(cell)
    return tuple(cells)


def _seen(name: str, cells: tuple[Cell, ...]) -> _Seen:
    plain, unit = named(name)
    found = None if unit is None else _unit(unit)
    spelled = _words(plain if found else name)
    kinds = [_kind(word) for word in spelled]
    units = {_unit(cell.unit) for cell in cells if cell.unit} | ({found} if found else set())
    is_rate = ("rate" in kinds or bool(units)) and "a measurement" not in kinds
    if is_rate and {"a number or a class", "a size"} & set(kinds):
        is_rate = kinds[-1] == "rate"
    other = next((kind for kind in kinds if kind not in ("", "rate")), "")
    doubt = "several units" if len(units) > 1 or None in units else "" if units else _looks_like(cells)
    return _Seen(name, cells, frozenset(spelled), is_rate, doubt if is_rate else other or doubt,
                 next(iter(units)) if len(units) == 1 else None)


def _unit(text: str) -> str | None:
    """The unit of a rate that a text names; None: no such unit."""
    plain = " ".join(text.split())
    if plain in UNITS:
        return plain
    found = unit_named(text)
    return found.name if found is not None and found.name in UNITS else None


def _kind(word: str) -> str:
    """What a word of a name says that the column is; empty: nothing."""
    if word in MEASURED or any(part in word for part in MEASURED_IN):
        return "a measurement"
    if word in RATE or any(part in word for part in RATE_IN) or (word.endswith(RATE_ENDS) and word not in NO_RATES):
        return "rate"
    if word in COUNTED or any(part in word for part in COUNTED_IN):
        return "a number or a class"
    return "a size" if word in SIZED or any(part in word for part in SIZED_IN) else ""


def _words(name: str) -> list[str]:
    """`Tgt_Rate1`, `tgtRate` and `TGT RATE` are tgt and rate; so is `TARGET_RAT`, which a shapefile has cut."""
    plain = unicodedata.normalize("NFKC", name)
    parted = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", plain).casefold()
    whole = [word for word in re.split(r"[\W_]+", parted) if word]
    words = [word if word in NUTRIENTS else re.sub(r"\d+$", "", word) or word for word in whole]
    words = [word for word in words if not word.isdigit()] or words
    words = [part for word in words for part in _without_n(word)]
    if len(name) == SHAPEFILE_NAME and words and len(words[-1]) > 1 and not _kind(words[-1]):
        words[-1] = next((word for word in sorted(RATE) if word.startswith(words[-1])), words[-1])
    return words


def _without_n(word: str) -> list[str]:
    """`nrate` is n and rate."""
    return ["n", word[1:]] if word[:1] == "n" and word[1:] in ("rate", "dose", "menge", "gabe") else [word]


def _looks_like(cells: Sequence[Cell]) -> str:
    """What the numbers rather are than a rate; empty: nothing else."""
    known = sorted({cell.value for cell in cells if not math.isnan(cell.value)})
    if not known:
        return ""
    if len(known) >= LEAST_LEVELS and known[0] in (0.0, 1.0) and known == [known[0] + k for k in range(len(known))]:
        return "counts 0, 1, 2 ... as numbers of classes or rows do"
    if len(known) >= LEAST_LEVELS and known[-1] <= 1.0:
        return "nothing above 1, as an index or a share"
    return ""


def _column(path: Path, one: _Seen) -> Where:
    return Where(str(path)).at("column {column}", column=one.name)


def _with_unit(path: Path, one: _Seen, choice: Choice, why: str, side_units: Mapping[str, Unit]) -> RateColumn:
    """The operator's unit, else the one that the file or one next to it names; a nutrient's rate is no rate of the
    product."""
    if choice.unit is not None:
        return RateColumn(one.name, one.cells, choice.unit, "chosen", why)
    stated = side_units.get(one.name.casefold())
    if stated is not None:
        unit = _unit(stated.text)
        if unit is None or one.unit not in (None, unit):
            raise RateQuestion(_column(path, one), "unit {stated} in {source}: say which unit holds" if one.unit is None
                               else "unit {stated} in {source}, {named} by its own name: say which unit holds",
                               " (--unit)", stated=stated.text, source=stated.source, named=one.unit)
        return RateColumn(one.name, one.cells, unit, f"named in {stated.source}", why)
    nutrient = next((nutrient for word in sorted(one.words) if (nutrient := NUTRIENTS.get(word))), "")
    if nutrient == "nitrogen" and choice.n_fraction is not None:
        unit = {"lb/ac": "lb N/ac"}.get(one.unit or "", "kg N/ha")
        return RateColumn(one.name, one.cells, unit, "named in the file", why)
    if nutrient:
        raise RateQuestion(
            _column(path, one), "kg of {nutrient} or of the product: say the unit", ": allowed with --unit "
            + (f"{one.unit or PLAIN_UNIT} (product), or --nitrogen SHARE of N in the product" if nutrient == "nitrogen"
               else f"{one.unit or PLAIN_UNIT}, and --scale where the product holds only a share of it"),
            nutrient=nutrient)
    if one.unit is not None:
        return RateColumn(one.name, one.cells, one.unit, "named in the file", why)
    return RateColumn(one.name, one.cells, PLAIN_UNIT, UNIT_NOT_NAMED, why)
