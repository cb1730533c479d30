"""How is a CSV read that has a polygon in a cell of each row? QGIS and PostGIS write polygons as
WKT, with attributes in the other cells.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import shapely
from topdress.control.recordings.finding import Finding, many
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.imports.dialect import find_encoding
from topdress.drivers.files.imports.table_header import is_unit_row
from topdress.drivers.files.limits import check_file
from topdress.drivers.files.prescriptions.features import (
    Feature,
    build_imported_map,
    convert_ring_deg,
)
from topdress.drivers.files.prescriptions.map_choices import (
    ImportedMap,
    PrescriptionError,
    RateChoice,
)
from topdress.drivers.files.stated_units import StatedUnit
from topdress.drivers.plain_text import PlaceInFile

# Number of bytes at the beginning of a file that are searched for a polygon.
SEARCHED_BYTES = 65_536
# Largest number of letters of a cell: a field's outline of 400 000 corners.
MAX_CELL_LENGTH = 1 << 24
_POLYGON_TEXT = re.compile(r"^\s*(SRID=(?P<srid>\d+)\s*;)?\s*(MULTI)?POLYGON\b", re.IGNORECASE)
_POLYGON_BYTES = re.compile(rb"POLYGON\s*(ZM?|M)?\s*\(", re.IGNORECASE)


def has_polygon_text(path: Path) -> bool:
    """Returns whether a text file begins as a table of polygons instead of a log. Raises
    BeyondLimits, OSError."""
    check_file(path)
    with path.open("rb") as file:
        # UTF-16 has a zero byte next to each ASCII letter.
        return _POLYGON_BYTES.search(file.read(SEARCHED_BYTES).replace(b"\0", b"")) is not None


def read_csv_zones(path: Path, choice: RateChoice) -> ImportedMap:
    """Returns the prescription of a CSV of polygons. Raises PrescriptionError, OSError."""
    # The file was checked for its size before, so it is read at once.
    data = path.read_bytes()
    # A byte order mark is no part of the first name.
    text = data.decode(find_encoding(data), errors="replace").lstrip("\ufeff")
    header = text.partition("\n")[0]
    # The separator is the sign that occurs most often in the header.
    sign = max(";\t|,", key=lambda one: header.count(one))
    # The limit is global to the csv module, so it is restored.
    before = csv.field_size_limit(MAX_CELL_LENGTH)
    try:
        # The csv module must see the line ends, because quoted cells may contain them.
        rows = list(csv.reader(text.splitlines(keepends=True), delimiter=sign, strict=True))
    except csv.Error as error:
        raise PrescriptionError(path, "not readable as CSV: {why}", why=error) from None
    finally:
        csv.field_size_limit(before)
    names = [name.strip() for name in rows[0]] if rows else []
    # Row numbers begin at 2, because the header is row 1.
    numbered = [
        (number, row)
        for number, row in enumerate(rows[1:], start=2)
        if any(cell.strip() for cell in row)
    ]
    where = next(
        (
            k
            for k in range(len(names))
            # The first rows show which column has the polygon.
            for _, row in numbered[:50]
            if len(row) > k and _POLYGON_TEXT.match(row[k])
        ),
        None,
    )
    if where is None:
        raise PrescriptionError(
            path, "no column of polygons (WKT) is in it", ": e.g. POLYGON ((lon lat, ...))"
        )
    findings: list[Finding] = []
    features, others = [], 0
    units: dict[str, StatedUnit] = {}
    # Some programs write a row of units below the header.
    if numbered and is_unit_row(numbered[0][1]):
        units = {
            name.casefold(): StatedUnit(cell.strip("()[] "), "the file's row of units")
            for name, cell in zip(names, numbered.pop(0)[1], strict=False)
            if cell.strip("()[]- ")
        }
    for number, row in numbered:
        # A polygon without quotes is split at its commas, which changes the number of cells.
        if len(row) != len(names):
            raise PrescriptionError(
                _locate_row(path, number),
                "{cells} cells: allowed {header_cells}, as in the header",
                cells=len(row),
                header_cells=len(names),
            )
        # Rows with points or remarks are counted, and the finding reports them.
        if not _POLYGON_TEXT.match(row[where]):
            others += 1
            continue
        attributes = {
            name: cell for k, (name, cell) in enumerate(zip(names, row, strict=True)) if k != where
        }
        features.append(Feature(number, attributes, _parse_polygons(path, number, row[where])))
    if others:
        text = f"{many(others, 'row')} without a polygon left out"
        findings.append(Finding("not_polygons", text, names[where], others))
    return build_imported_map(path, "csv", features, choice, findings, title=path.stem, units=units)


def _locate_row(path: Path, number: int) -> PlaceInFile:
    """Returns the place of a row, for messages."""
    return PlaceInFile(str(path)).go_down("row {row}", row=number)


def _parse_polygons(path: Path, number: int, text: str) -> list[tuple[Floats, ...]]:
    """Returns the polygons of a cell, each as its outline, then holes, (k, 2) latitude and
    longitude."""
    found = _POLYGON_TEXT.match(text)
    # Other coordinate systems would need a transformation that WKT does not describe.
    if found is not None and found["srid"] not in (None, "4326"):
        raise PrescriptionError(
            _locate_row(path, number),
            "SRID {srid}: allowed 4326 (WGS84 degrees)",
            srid=found["srid"],
        )
    try:
        shape = shapely.from_wkt(
            text.partition(";")[2] if found is not None and found["srid"] else text
        )
    except shapely.errors.GEOSException as error:
        raise PrescriptionError(
            _locate_row(path, number), "not readable as WKT: {why}", why=str(error).splitlines()[0]
        ) from None
    # Empty parts come from operations in a geographic information system.
    parts = [part for part in shapely.get_parts(shape) if not part.is_empty]
    return [
        tuple(
            convert_ring_deg(shapely.get_coordinates(edge))
            for edge in (part.exterior, *part.interiors)
        )
        for part in parts
    ]
