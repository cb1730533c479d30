"""How is a GeoPackage (OGC 12-128r19) read by SQLite? Only its tables and views are read, without
writing and within a limited time.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from topdress.drivers.files.limits import GEOPACKAGE_LIMIT, MEGABYTE, check_limit
from topdress.drivers.files.shape_layers import Layer, convert_to_degrees
from topdress.drivers.files.stated_units import StatedUnit, find_markup_units, find_text_units
from topdress.drivers.plain_text import PlaceInFile, RefusedInput

# Time limit for all work of SQLite on a file, s; a file of 256 MB takes 2 s.
MAX_READ_S = 20.0
# Number of instructions of SQLite's virtual machine between two checks of the clock, about a
# millisecond.
CLOCK_CHECK_STEPS = 20_000
# Largest size of a cell, bytes.
MAX_VALUE_BYTES = 64 * MEGABYTE
# Largest memory of SQLite, bytes. A view sorts in memory, and the query is refused beyond this
# size.
MAX_HEAP_BYTES = 256 * MEGABYTE
# Memory that an empty row needs in Python, bytes.
EMPTY_ROW_BYTES = 200
# Length of an envelope by its code in a geometry's header, bytes (OGC 12-128r19, 2.1.3).
ENVELOPE_BYTES = (0, 32, 48, 48, 64)
# The actions that a query of a table needs; SQLite denies all others.
ALLOWED_ACTIONS = (
    sqlite3.SQLITE_SELECT,
    sqlite3.SQLITE_READ,
    sqlite3.SQLITE_FUNCTION,
    sqlite3.SQLITE_RECURSIVE,
)

# Tables of shapes with their coordinate systems.
_LAYER_QUERY = """SELECT c.table_name, g.column_name, s.organization, s.organization_coordsys_id,
s.definition
    FROM gpkg_contents c JOIN gpkg_geometry_columns g ON g.table_name = c.table_name
    LEFT JOIN gpkg_spatial_ref_sys s ON s.srs_id = g.srs_id WHERE c.data_type = 'features' ORDER
    BY c.rowid"""


class _LayerTable(NamedTuple):
    """Describes a table of shapes. `crs` is EPSG:number or similar, None for an unknown system;
    `definition` is the same system as well-known text."""

    name: str
    shape_column: str
    crs: str | None
    definition: str


def read_geopackage(path: Path, longest_s: float = MAX_READ_S) -> list[Layer]:
    """Returns the layers of a GeoPackage. Raises RefusedInput, BeyondLimits, OSError;
    KeyboardInterrupt at once, however long a view would take."""
    with path.open("rb") as file:
        if file.read(16) != b"SQLite format 3\0":
            raise RefusedInput(path, "no GeoPackage: its first bytes are not those of SQLite")
    # SQLite keeps changes that are not yet in the file in a second file, the write-ahead log.
    wal = path.with_name(f"{path.name}-wal")
    if wal.is_file() and wal.stat().st_size:
        raise RefusedInput(
            path,
            "open in another program, which has not yet written all of it: close it there first",
        )
    until_s = time.monotonic() + longest_s
    try:
        with closing(
            # In this mode not even SQLite's own lock files are created.
            sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
        ) as base:
            _restrict_database(base, until_s)
            return [_read_layer(path, base, table) for table in _list_layer_tables(base)]
    except (sqlite3.Error, sqlite3.Warning) as error:
        if getattr(error, "sqlite_errorname", "") != "SQLITE_INTERRUPT":
            raise RefusedInput(
                path, "not readable as GeoPackage: {why}", why=str(error)[:150]
            ) from None
        if time.monotonic() < until_s:
            # The interrupt arrived while SQLite was running, and SQLite then ended the query.
            raise KeyboardInterrupt from None
        raise RefusedInput(
            path,
            "a view or a table in it takes longer than {seconds:g} s: allowed are tables of shapes",
            seconds=longest_s,
        ) from None


def _restrict_database(base: sqlite3.Connection, until_s: float) -> None:
    """Forbids writing, attaching, loading and setting, whatever the file's own schema contains, and
    limits time and memory."""
    for setting in (
        "trusted_schema=OFF",
        "cell_size_check=ON",
        "temp_store=MEMORY",
        f"hard_heap_limit={MAX_HEAP_BYTES}",
    ):
        base.execute(f"PRAGMA {setting}")
    base.text_factory = lambda data: data.decode("utf-8", "replace")
    base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
    base.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
    base.set_authorizer(
        lambda action, one, *_: (
            sqlite3.SQLITE_OK
            if action in ALLOWED_ACTIONS
            or (action == sqlite3.SQLITE_PRAGMA and one == "table_info")
            else sqlite3.SQLITE_DENY
        )
    )
    base.set_progress_handler(lambda: time.monotonic() > until_s, CLOCK_CHECK_STEPS)


def _list_layer_tables(base: sqlite3.Connection) -> list[_LayerTable]:
    return [
        _LayerTable(
            str(name),
            str(column),
            f"{organization}:{number}".upper()
            if organization and number and str(organization).upper() not in ("NONE",)
            else None,
            str(definition or ""),
        )
        for name, column, organization, number, definition in base.execute(_LAYER_QUERY)
    ]


def _read_layer(path: Path, base: sqlite3.Connection, table: _LayerTable) -> Layer:
    """Returns a table's shapes in degrees, with attributes and units."""
    quoted = '"' + table.name.replace('"', '""') + '"'
    keys = {
        row[1]
        for row in base.execute(f"PRAGMA table_info({quoted})")
        # Primary keys are no attributes.
        if row[5] and str(row[2]).upper() == "INTEGER"
    }
    found = base.execute(f"SELECT * FROM {quoted}")
    names = [str(column[0]) for column in found.description]
    where = PlaceInFile(str(path)).go_down("layer {layer}", layer=table.name)
    if table.shape_column not in names:
        raise RefusedInput(
            where, "no column {column}, which it names for its shapes", column=table.shape_column
        )
    at = names.index(table.shape_column)
    rows: list[dict[str, Any]] = []
    geometries: list[bytes | None] = []
    for cells in _iter_limited_rows(path, found):
        geometries.append(_extract_wkb(cells[at], where, len(rows) + 1))
        rows.append(
            {
                name: cell
                for name, cell in zip(names, cells, strict=True)
                if name not in (table.shape_column, *keys) and not isinstance(cell, bytes)
            }
        )
    try:
        shapes = shapely.force_2d(shapely.from_wkb(np.array(geometries, dtype=object)))
    except shapely.errors.GEOSException as error:
        raise RefusedInput(
            where, "a shape is damaged: {why}", why=str(error).splitlines()[0][:150]
        ) from None
    shapes, findings = convert_to_degrees(path, table.name, shapes, table.crs, table.definition)
    return Layer(
        table.name, tuple(rows), shapes, findings, _read_stated_units(base, table.name, names)
    )


def _iter_limited_rows(path: Path, rows: sqlite3.Cursor) -> Iterator[tuple[Any, ...]]:
    """Yields rows up to the number that a file of the largest size can hold. Raises
    BeyondLimits."""
    taken = 0
    for row in rows:
        taken += EMPTY_ROW_BYTES + sum(len(cell) for cell in row if isinstance(cell, str | bytes))
        check_limit(GEOPACKAGE_LIMIT, taken, PlaceInFile(str(path)).go_down("rows of a layer"))
        yield row


def _extract_wkb(blob: Any, where: PlaceInFile, row: int) -> bytes | None:
    """Returns a shape without its header (2.1.3); None for a row without a shape. Raises
    RefusedInput."""
    if blob is None:
        return None
    envelope = (
        blob[3] >> 1 & 7 if isinstance(blob, bytes) and len(blob) >= 8 and blob[:2] == b"GP" else 7
    )
    if envelope >= len(ENVELOPE_BYTES):
        raise RefusedInput(where.go_down("row {row}", row=row), "no shape of a GeoPackage")
    return bytes(blob[8 + ENVELOPE_BYTES[envelope] :])


def _read_stated_units(
    base: sqlite3.Connection, table: str, names: list[str]
) -> dict[str, StatedUnit]:
    """Returns the units that the file states outside of its columns' names: titles and
    descriptions, metadata, QGIS's styles."""
    there = {
        str(row[0]) for row in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
    }
    found: dict[str, StatedUnit] = {}
    if "gpkg_data_columns" in there:
        for column, *texts in base.execute(
            "SELECT column_name, name, title, description FROM gpkg_data_columns "
            "WHERE table_name = ?",
            (table,),
        ):
            found |= find_text_units(
                str(column), [str(text) for text in texts if text], "gpkg_data_columns"
            )
    if "gpkg_metadata" in there:
        for (text,) in base.execute("SELECT metadata FROM gpkg_metadata"):
            found |= find_markup_units(str(text), names, "gpkg_metadata")
    if "layer_styles" in there:
        for (text,) in base.execute(
            "SELECT styleQML FROM layer_styles WHERE f_table_name = ?", (table,)
        ):
            found |= find_markup_units(str(text), names, "layer_styles")
    return found
