"""Shapes with attributes out of GeoPackage, KML and KMZ: by SQLite and an XML reader of our own, never by GDAL.

GDAL opens what it finds in the bytes, whatever the name: a virtual data source under `.gpkg` reads other files and runs
SQL.
"""
from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from control.recordings.finding import Finding
from drivers.files.limits import check_file
from drivers.files.prescriptions.projected import TransverseMercator, projection_of
from drivers.files.stated_units import NO_UNITS, Unit
from drivers.plain_text import Refused, Where

KML_KINDS = (".kml", ".kmz")
DEGREES = ("EPSG:4326", "OGC:CRS84", "EPSG:4258", "EPSG:4490", "EPSG:4269")     # WGS84, and within 2 m of it
_UTM = re.compile(r"^EPSG:(326|327|258)(\d\d)$")
_OF_KML = frozenset({"Name", "description", "Description", "id"})


class Layer(NamedTuple):
    """`rows`: attributes; `shapes`: (n,) shapely geometries in longitude and latitude, None where a row has none;
    `findings`: what was taken how; `units`: of columns, as the file says besides their names."""

    name: str
    rows: tuple[dict[str, Any], ...]
    shapes: np.ndarray[Any, Any]
    findings: tuple[Finding, ...] = ()
    units: Mapping[str, Unit] = NO_UNITS


def read_layers(path: Path) -> list[Layer]:
    """Raises Refused, OSError."""
    check_file(path)
    if path.suffix.lower() in KML_KINDS:
        from drivers.files.kml import read_kml
        return read_kml(path)
    from drivers.files.geopackage import read_geopackage
    return read_geopackage(path)


def in_degrees(path: Path, layer: str, shapes: Any, crs: str | None, text: str = "") -> tuple[Any, tuple[Finding, ...]]:
    """The shapes in degrees, and what was done. crs: `EPSG:...`, None: not known. text: the same as well-known text.

    Raises Refused.
    """
    where = Where(str(path)).at("layer {layer}", layer=layer)
    if crs is None or crs in DEGREES:
        if crs is None and len(shapes) and not np.abs(shapely.get_coordinates(shapes)).max(initial=0.0) <= 180.0:
            raise Refused(where, "coordinates in no known system: allowed are degrees, or UTM that the file names")
        return shapes, ()
    found = _UTM.match(crs)
    if found is not None:
        south = found[1] == "327"
        projection = TransverseMercator(f"UTM zone {int(found[2])}{'S' if south else 'N'}", 6.0 * int(found[2]) - 183.0,
                                        0.0, 0.9996, 500_000.0, 1e7 if south else 0.0)
    else:
        try:
            by_text = projection_of(text)
        except ValueError:
            by_text = None
        if by_text is None:
            raise Refused(where, "coordinates in {system}: allowed are degrees on WGS84, or UTM",
                              ": export it again in WGS84 (EPSG:4326)", system=crs[:60])
        projection = by_text

    def turned(places: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        lat, lon = projection.to_deg(places[:, 0], places[:, 1])
        return np.column_stack((lon, lat))
    said = Finding("projected", f"coordinates in {projection.name} taken to degrees")
    return shapely.transform(shapes, turned), (said,)


def stated(row: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes without those that every KML has."""
    return {name: value for name, value in row.items() if name not in _OF_KML}


def name_of(row: Mapping[str, Any]) -> str:
    """What a shape is called. The names of a shapefile's columns have ten letters."""
    for wanted in ("name", "title", "field", "field_name", "fieldname", "designator"):
        for name, value in row.items():
            if name.casefold() == wanted and value not in (None, ""):
                return str(value)
    return ""
