"""Which units does a file state outside of a column's name and cells? Programs write them into
metadata.

The keys and tags that name a unit are similar everywhere (`unit`, `UnitType`, `attrunit`,
`rate_unit`, ...). For a named column any text counts, and unknown texts become questions. Without a
column only units of a rate count, because other metadata contain the metres of their coordinates.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

from topdress.drivers.files.archives import ArchiveFiles
from topdress.drivers.files.imports.column_vocabulary import SHAPEFILE_NAME_LENGTH, fold_column_name
from topdress.drivers.files.imports.table_header import split_unit_name
from topdress.drivers.files.imports.units import find_named_unit, is_rate_unit
from topdress.drivers.files.limits import SIDE_FILE_LIMIT
from topdress.drivers.files.xml_text import XmlError, find_local_name, parse_xml_root
from topdress.drivers.plain_text import RefusedInput

# This name means the rate, whichever column holds it.
ANY_COLUMN = ""
# Endings of files with metadata, after the stem.
SIDE_ENDINGS = ("-deere-metadata.json", "-metadata.json", ".xml", ".aux.xml", ".qml", ".qmd")
# Number of levels below the element that names a column in which its unit may be; Esri's
# attr/attrdomv/rdom/attrunit has three.
MAX_UNIT_DEPTH = 3
# The word "unit" in the languages of manufacturers.
UNIT_WORDS = frozenset(
    """unit units uom einheit einheiten masseinheit mengeneinheit unite unites unidad unidades unita
    eenheid eenheden jednostka 单位 单位名称 计量单位 единица""".split()
)
# A line such as `unit: l/ha`.
_UNIT_LINE = re.compile(r"^\s*#?\s*(?P<key>[^:=]{1,40})[:=]\s*(?P<unit>\S.{0,30}?)\s*$")


class StatedUnit(NamedTuple):
    """Holds a unit. `text` is the unit as written; `source` is the file, or its part, that states
    it."""

    text: str
    source: str
    # The column of the table that holds the unit; empty for a unit outside of the table.
    unit_column: str = ""


NO_UNITS: Mapping[str, StatedUnit] = {}


class StatedUnits(dict[str, StatedUnit]):
    """Collects units by column in small letters, or ANY_COLUMN. Two different units of one column
    are kept together, as a text that is no known unit."""

    def add(
        self, column: str, text: str, source: str, sure: bool = False, unit_column: str = ""
    ) -> None:
        """Adds a unit. `sure` means that the table itself states the unit, so that it belongs to
        the rate even if it is unknown."""
        if not text.strip() or (column == ANY_COLUMN and not sure and not is_rate_unit(text)):
            return
        before = self.get(column)
        if before is None:
            self[column] = StatedUnit(text.strip(), source, unit_column)
        elif _find_known_name(before.text) != _find_known_name(text):
            self[column] = StatedUnit(f"{before.text}, {text.strip()}", source)


def merge_units(*several: Mapping[str, StatedUnit]) -> dict[str, StatedUnit]:
    """Returns all units of several collections."""
    found = StatedUnits()
    for one in several:
        for column, unit in one.items():
            found.add(column, unit.text, unit.source, True, unit.unit_column)
    return dict(found)


def _find_known_name(text: str) -> str:
    """Returns a unit's name, or the text of an unknown unit."""
    found = find_named_unit(text)
    return text.strip() if found is None else found.name


def is_unit_name(key: str) -> bool:
    """Returns whether a key, tag or column announces a unit."""
    plain = fold_column_name(key)
    return bool(UNIT_WORDS & set(plain.split("_"))) or plain.endswith(("unit", "units", "_uom"))


def read_side_units(
    files: ArchiveFiles, name: str, columns: Collection[str]
) -> dict[str, StatedUnit]:
    """Returns units from the companion files that programs write for `name`. Raises RefusedInput,
    OSError."""
    plain = name.casefold()
    stem = plain.removesuffix(PurePosixPath(plain).suffix)
    found: dict[str, StatedUnit] = {}
    for there in files.names:
        if there.casefold() in {
            start + ending for start in (stem, plain) for ending in SIDE_ENDINGS
        }:
            data = files.read(there)
            if len(data) > SIDE_FILE_LIMIT.most:
                raise RefusedInput(
                    files.label(there),
                    "{found} bytes: allowed up to {most}",
                    found=len(data),
                    most=SIDE_FILE_LIMIT.most,
                )
            found |= find_markup_units(data, columns, PurePosixPath(there).name)
    return found


def find_markup_units(
    data: bytes | str, columns: Collection[str], source: str
) -> dict[str, StatedUnit]:
    """Returns units in JSON or XML; none for other data."""
    text = data.encode() if isinstance(data, str) else data
    try:
        if text.lstrip(b"\xef\xbb\xbf \r\n\t").startswith((b"{", b"[")):
            return find_json_units(json.loads(text.decode("utf-8-sig")), columns, source)
        return find_element_units(parse_xml_root(text, source), columns, source)
    except (XmlError, ValueError, RecursionError):
        return {}


def find_json_units(root: Any, columns: Collection[str], source: str) -> dict[str, StatedUnit]:
    """Returns units by column: from a record that names a column, a key that does, or a list of
    units by column."""
    found = StatedUnits()
    # A list replaces recursion, because metadata may be nested deeply.
    left: list[tuple[Any, str]] = [(root, ANY_COLUMN)]
    while left:
        node, about = left.pop()
        if isinstance(node, list):
            left += [(one, about) for one in node]
        if not isinstance(node, Mapping):
            continue
        texts = [value for value in node.values() if isinstance(value, str)]
        about = next(filter(None, (_find_column(text, columns) for text in texts)), about)
        for key, value in node.items():
            if is_unit_name(key) and isinstance(value, str):
                found.add(about, _write_with_slash(value), source)
            elif is_unit_name(key) and isinstance(value, Mapping):
                for name, unit in value.items():
                    if isinstance(unit, str) and (column := _find_column(name, columns)):
                        found.add(column, _write_with_slash(unit), source)
            else:
                left.append((value, _find_column(key, columns) or about))
    return dict(found)


def find_element_units(
    root: Element, columns: Collection[str], source: str
) -> dict[str, StatedUnit]:
    """Returns units of elements that name a column in an attribute or a child's text. The unit may
    be in the element, or in another element that has the same name."""
    found = StatedUnits()
    for element in root.iter():
        texts = [
            *element.attrib.values(),
            *(child.text for child in element if not len(child) and child.text),
        ]
        column = next(filter(None, (_find_column(text, columns) for text in texts)), ANY_COLUMN)
        if column:
            for text in texts:
                if (
                    (unit := split_unit_name(text)[1]) is not None
                    and is_rate_unit(unit)
                    and not _find_column(text, columns)
                ):
                    found.add(column, unit, source)
        for inner in _iter_below(element, MAX_UNIT_DEPTH) if column else (element,):
            if is_unit_name(find_local_name(inner)) or any(
                map(is_unit_name, inner.attrib.values())
            ):
                found.add(column, _write_with_slash(inner.text or ""), source)
            for key, value in inner.attrib.items():
                if is_unit_name(key):
                    found.add(column, _write_with_slash(value), source)
    return dict(found)


def find_text_units(column: str, texts: Iterable[str], source: str) -> dict[str, StatedUnit]:
    """Returns units in lines and cells of text: `unit: l/ha`, `Target rate (l/ha)`. `column` is
    ANY_COLUMN where the units belong to no particular column."""
    found = StatedUnits()
    for text in texts:
        said = _UNIT_LINE.match(text)
        unit = (
            said["unit"]
            if said is not None and is_unit_name(said["key"])
            else split_unit_name(text)[1]
        )
        if unit is not None and is_rate_unit(unit):
            found.add(column.casefold(), unit, source)
    return dict(found)


def _find_column(text: str, columns: Collection[str]) -> str:
    """Returns the column that a text names, in small letters, as a shapefile cuts it; empty for no
    column."""
    plain = text.strip().casefold()
    return (
        next(
            (
                name
                for column in columns
                if (name := column.casefold()) == plain
                or (len(name) == SHAPEFILE_NAME_LENGTH and plain.startswith(name))
            ),
            "",
        )
        if plain
        else ""
    )


def _iter_below(element: Element, levels: int) -> Iterator[Element]:
    yield element
    for child in element if levels else ():
        yield from _iter_below(child, levels - 1)


def _write_with_slash(unit: str) -> str:
    """Returns `lb1ac-1` as lb/ac and `g1[m2]-1` as g/m2, the notation of John Deere."""
    found = re.fullmatch(r"([A-Za-z]+)1?\[?([A-Za-z]+\d?)\]?-1", unit.strip())
    return f"{found[1]}/{found[2]}" if found else unit.strip()
