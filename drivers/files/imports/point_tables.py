"""How are points with attributes read as a table? Many as-applied files are GeoJSON or shapefiles
of points.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapefile
import shapely
from numpy.typing import NDArray
from topdress.control.recordings.finding import Finding, many
from topdress.drivers.files.archives import choose_names
from topdress.drivers.files.columns import make_text_column
from topdress.drivers.files.file_sniffer import POINT_TYPES
from topdress.drivers.files.imports.import_errors import LogImportError, format_list
from topdress.drivers.files.imports.mapping import Source
from topdress.drivers.files.imports.raw_table import RawTable, find_units_in
from topdress.drivers.files.shape_layers import Layer, read_geojson
from topdress.drivers.files.shape_sets import ShapeSet, find_shape_sets, read_shape_layer

# The log's names of a position.
LAT_COLUMN, LON_COLUMN = "lat_deg", "lon_deg"


def read_points(path: Path, said: Source) -> RawTable:
    """Returns the points of a GeoJSON file. Raises LogImportError, RefusedInput, OSError."""
    return _convert_layer(
        path, read_geojson(path, ["Point"]), said.model_copy(update={"kind": "geojson"})
    )


def read_point_shapefile(path: Path, said: Source) -> RawTable:
    """Returns a shapefile of points; in a zip or folder the shapefile that holds points, or that
    `said` names. Raises LogImportError, RefusedInput, OSError."""
    shapes = _choose_shape_set(path, said)
    kind = _read_shape_type(shapes)
    if kind not in POINT_TYPES and kind in shapefile.SHAPETYPE_LOOKUP:
        raise LogImportError(
            path,
            f"shapes of type {shapefile.SHAPETYPE_LOOKUP[kind]}: allowed POINT (a map of areas "
            "is read by topdress map)",
        )
    layer = read_shape_layer(shapes, said.encoding)
    names = _restore_own_names(list(layer.rows[0]) if layer.rows else [])
    rows = tuple(dict(zip(names, row.values(), strict=True)) for row in layer.rows)
    return _convert_layer(
        path, layer._replace(rows=rows), said.model_copy(update={"kind": "shapefile"})
    )


def _choose_shape_set(path: Path, said: Source) -> ShapeSet:
    """Returns the requested shapefile. Raises LogImportError, RefusedInput, OSError."""
    found = find_shape_sets(path)
    if said.inside is not None:
        named = choose_names([one.name for one in found], said.inside)
        found = [one for one in found if one.name in named]
    if len(found) > 1:
        found = [one for one in found if _read_shape_type(one) in POINT_TYPES] or found
    if len(found) != 1:
        several = (
            f"{len(found)} shapefiles of points: say source.inside in the import file; allowed "
            f"{format_list(one.name for one in found)}"
        )
        raise LogImportError(path, f"{several if found else 'no shapefile in it'}")
    return found[0]


def _read_shape_type(shapes: ShapeSet) -> int:
    """Returns the type of a shapefile's shapes, from its header."""
    head = shapes.part(".shp") or b""
    # ESRI's shapefile description, bytes 32 to 35.
    return int.from_bytes(head[32:36], "little") if len(head) >= 36 else 0


def _convert_layer(path: Path, layer: Layer, source: Source) -> RawTable:
    """Returns the points of a layer as a table. Raises LogImportError."""
    kinds = [None if shape is None else shape.geom_type for shape in layer.shapes]
    there = [k for k, kind in enumerate(kinds) if kind == "Point" and not layer.shapes[k].is_empty]
    if not there:
        raise LogImportError(
            path,
            "no point in it"
            if layer.kind
            else "no feature is a point: allowed is a "
            "FeatureCollection of points (a map of areas is read by topdress map)",
        )
    findings = list(layer.findings)
    for id, lost, what in (
        ("empty_shapes", kinds.count(None), "without a place left out"),
        ("not_points", len(kinds) - kinds.count(None) - len(there), "that are no points left out"),
    ):
        if lost:
            findings.append(Finding(id, f"{many(lost)} {what}", rows=lost))
    names = list(dict.fromkeys(name for k in there for name in layer.rows[k]))
    if not names:
        raise LogImportError(path, "no point tells anything: allowed are points with properties")
    columns = {
        name: _build_column([layer.rows[k].get(name) for k in there])
        for name in names
        if name not in (LAT_COLUMN, LON_COLUMN)
    }
    places = shapely.get_coordinates(layer.shapes[there])
    columns |= {LAT_COLUMN: places[:, 1], LON_COLUMN: places[:, 0]}
    units = find_units_in(columns)
    stated = layer.units if layer.kind else {}
    units |= {name: stated[name.casefold()].text for name in names if name.casefold() in stated}
    return RawTable(path, columns, source, units, 1, tuple(findings))


def _restore_own_names(names: list[str]) -> list[str]:
    """Returns the full names of topdress's own as-applied shapefiles, which the format cuts to ten
    letters; other names are unchanged."""
    from topdress.drivers.files.exports.export_columns import EXPORT_COLUMNS, TIME_SHORT_NAME

    long = {column.short: column.name for column in EXPORT_COLUMNS} | {TIME_SHORT_NAME: "utc"}
    return [long.get(name, name) for name in names] if set(long) <= set(names) else names


def _build_column(values: list[Any]) -> NDArray[Any]:
    """Returns a column as numbers or texts (n,)."""
    known = [value for value in values if value is not None]
    if known and all(isinstance(value, int | float) for value in known):
        return np.array([np.nan if value is None else float(value) for value in values], np.float64)
    return make_text_column(["" if value is None else str(value).strip() for value in values])
