"""How are shapes with attributes read from GeoJSON, shapefiles, GeoPackage, KML and KMZ? Maps,
fields and points are all read here, in longitude and latitude.

GeoPackage is read by SQLite and KML by an XML reader of this package, never by GDAL. GDAL chooses
its reader by the bytes, whatever the name, and a virtual data source under `.gpkg` could read other
files and run SQL.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from topdress.control.recordings.finding import Finding
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.formats.registry import describe_able, find_format
from topdress.drivers.files.limits import check_file, read_json
from topdress.drivers.files.optional_packages import format_install_line
from topdress.drivers.files.prescriptions.map_choices import NotAMapError
from topdress.drivers.files.prescriptions.map_projection import (
    Projection,
    TransverseMercator,
    find_national_grid,
    parse_projection,
)
from topdress.drivers.files.stated_units import NO_UNITS, StatedUnit, find_json_units
from topdress.drivers.plain_text import PlaceInFile, RefusedInput
from topdress.drivers.plugins import PluginFault

# Coordinate systems in degrees on WGS84, or within 2 m of WGS84.
DEGREE_SYSTEMS = ("EPSG:4326", "OGC:CRS84", "EPSG:4258", "EPSG:4490", "EPSG:4269")
# Names of WGS84 in GeoJSON.
WGS84_SPELLINGS = ("crs84", "4326")
# Types of shapes in GeoJSON.
GEOJSON_TYPES = ("Point", "LineString", "MultiLineString", "Polygon", "MultiPolygon")
# UTM north and south on WGS84, and north on ETRS89 (EPSG register).
_UTM_CODE = re.compile(r"^EPSG:(326|327|258)(\d\d)$")
# Attributes that every KML has.
_KML_ATTRIBUTES = frozenset({"Name", "description", "Description", "id"})


class Layer(NamedTuple):
    """Holds shapes with attributes. `rows` holds the attributes. `shapes` holds (n,) shapely
    geometries in longitude and latitude, None for a row without a shape. `findings` describes how
    the file was read. `units` holds units of columns that the file states outside of their names.
    `kind` is the type of all shapes where the file states it. `about` holds the members of GeoJSON
    besides its features."""

    name: str
    rows: tuple[Mapping[str, Any], ...]
    shapes: np.ndarray[Any, Any]
    findings: tuple[Finding, ...] = ()
    units: Mapping[str, StatedUnit] = NO_UNITS
    kind: str = ""
    about: Mapping[str, Any] = {}


def read_layers(path: Path) -> list[Layer]:
    """Returns the layers of a file, folder or zip. Raises RefusedInput, OSError."""
    check_file(path)
    suffix = "" if path.is_dir() else path.suffix.lower()
    if suffix in (".zip", ""):
        from topdress.drivers.files.shape_sets import read_shape_layers

        return read_shape_layers(path)
    found = find_format(path, "read_layers")
    if found is None or found.read_layers is None:
        allowed = describe_able("read_layers")
        raise NotAMapError(path, "no layers: allowed is {formats}", formats=allowed)
    return found.read_layers(path)


def read_geojson_layers(path: Path) -> list[Layer]:
    """Returns the features of a GeoJSON file as a layer. Raises RefusedInput, OSError."""
    return [read_geojson(path)]


def read_geojson(path: Path, kinds: Collection[str] = GEOJSON_TYPES, strict: bool = False) -> Layer:
    """Returns the layer of a FeatureCollection (RFC 7946).

    Parameters
    ----------
    path : the file.
    kinds : types of shapes that are read; others become empty points.
    strict : whether a single feature, and features in a root without a type, are refused.

    Raises
    ------
    NotAMapError : the file is no FeatureCollection.
    RefusedInput : coordinates are wrong.
    OSError : the file cannot be opened.
    """
    try:
        root = read_json(path)
    except ValueError as error:
        # The content is JSON of another kind, or none, so the error is about the map.
        raise NotAMapError(path, "not readable as JSON: {why}", why=error) from None
    return _build_layer(path, root, kinds, strict)


def read_plugin_layers(path: Path) -> list[Layer]:
    """Returns the layer that the plug-in of the suffix reads. Raises NotAMapError for every failure
    of the plug-in."""
    from topdress.drivers.plugin_process import read_format

    try:
        root = read_format(path.suffix[1:].lower(), path)
    except PluginFault as fault:
        raise NotAMapError(
            path,
            "not readable by the plug-in of {suffix}: {why}",
            suffix=path.suffix,
            why=fault.why,
        ) from None
    return [_build_layer(path, root, GEOJSON_TYPES, strict=True)]


def _build_layer(path: Path, root: Any, kinds: Collection[str], strict: bool) -> Layer:
    """Returns features as a layer. Raises NotAMapError, RefusedInput."""
    kind = root.get("type") if isinstance(root, dict) else type(root).__name__
    found = None
    # A strict reader accepts only a FeatureCollection, because other JSON may have a list too.
    if isinstance(root, dict) and (kind == "FeatureCollection" or not strict):
        found = [root] if kind == "Feature" else root.get("features")
    if not isinstance(found, list):
        raise NotAMapError(
            path,
            "type {kind}: allowed FeatureCollection"
            if strict
            else "no features: allowed is a FeatureCollection",
            kind=kind,
        )
    crs = json.dumps(root.get("crs") or "crs84").lower()
    # RFC 7946 permits WGS84 only; older files may name another system.
    if not any(name in crs for name in WGS84_SPELLINGS):
        raise RefusedInput(path, "crs {crs}: allowed is WGS84 (longitude, latitude)", crs=crs)
    shapes = np.empty(len(found), dtype=object)
    rows: list[Mapping[str, Any]] = []
    for k, feature in enumerate(found):
        # A damaged feature becomes a row without shape, so that row numbers stay right.
        feature = feature if isinstance(feature, dict) else {}
        geometry, stated = feature.get("geometry"), feature.get("properties")
        rows.append(stated if isinstance(stated, dict) else {})
        if isinstance(geometry, dict):
            shapes[k] = (
                _build_geometry(
                    geometry, PlaceInFile(str(path)).go_down("feature {feature}", feature=k + 1)
                )
                if geometry.get("type") in kinds
                # An empty point keeps the row but covers no ground.
                else shapely.Point()
            )
    about = {key: value for key, value in root.items() if key != "features"}
    units = find_json_units(about, {name for row in rows for name in row}, path.name)
    return Layer(str(root.get("name", "")), tuple(rows), shapes, (), units, "", about)


def _build_geometry(geometry: Mapping[str, Any], where: PlaceInFile) -> shapely.Geometry | None:
    """Returns a shape of GeoJSON; None for an empty shape. Raises RefusedInput."""
    kind = geometry["type"]
    area = kind.endswith("Polygon")
    try:
        parts = geometry["coordinates"] if kind.startswith("Multi") else [geometry["coordinates"]]
        if area:
            made = [
                build_polygon([_convert_places(ring) for ring in part], where) for part in parts
            ]
        else:
            made = (
                [shapely.Point(*_convert_places(parts)[0])]
                if kind == "Point"
                else [shapely.LineString(_convert_places(part)) for part in parts]
            )
    except RefusedInput:
        raise
    # Foreign numbers fail in many ways, and all of them mean wrong coordinates.
    except (ArithmeticError, TypeError, ValueError, LookupError, shapely.errors.GEOSException):
        raise RefusedInput(
            where,
            "coordinates are not rings of numbers: allowed [[[lon, lat], ...]]"
            if area
            else "coordinates are no two numbers: allowed [lon, lat]",
        ) from None
    return combine_shapes(made)


def _convert_places(corners: Sequence[Sequence[float]]) -> Floats:
    """Returns points (n, 2), longitude and latitude."""
    # A third number is a height.
    return np.asarray([corner[:2] for corner in corners], dtype=np.float64).reshape(-1, 2)


def build_polygon(rings: Sequence[Floats], where: PlaceInFile) -> shapely.Geometry:
    """Returns a polygon of an outline and its holes, (n, 2) longitude and latitude, closed or open.
    Raises RefusedInput."""
    if not rings or any(len(drop_closing_corner(ring)) < 3 for ring in rings):
        raise RefusedInput(where, "a ring of less than 3 corners: allowed 3 or more")
    return shapely.Polygon(rings[0], rings[1:])


def drop_closing_corner(corners: Floats) -> Floats:
    """Returns a ring without the corner that closes it."""
    # GeoJSON repeats the first corner at the end, shapely does so by itself.
    return corners[:-1] if len(corners) > 1 and (corners[0] == corners[-1]).all() else corners


def combine_shapes(parts: Sequence[shapely.Geometry]) -> shapely.Geometry | None:
    """Returns several shapes as one shape; None without shapes."""
    kinds = {part.geom_type for part in parts}
    if len(parts) < 2:
        return parts[0] if parts else None
    if kinds == {"Polygon"}:
        return shapely.multipolygons(parts)
    return (
        shapely.multilinestrings(parts)
        if kinds == {"LineString"}
        else shapely.geometrycollections(parts)
    )


def convert_to_degrees(
    path: Path, layer: str, shapes: Any, crs: str | None, text: str = ""
) -> tuple[Any, tuple[Finding, ...]]:
    """Returns shapes in degrees, and findings.

    Parameters
    ----------
    path : the file, for messages.
    layer : the layer's name, for messages.
    shapes : (n,) shapely geometries.
    crs : coordinate system as `EPSG:...`; None for an unknown system.
    text : the same system as well-known text.

    Raises
    ------
    RefusedInput : the coordinate system cannot be converted.
    """
    where = PlaceInFile(str(path)).go_down("layer {layer}", layer=layer)
    if crs is None or crs in DEGREE_SYSTEMS:
        # Numbers beyond 180 cannot be degrees, so the missing system is an error.
        if (
            crs is None
            and len(shapes)
            and not np.abs(shapely.get_coordinates(shapes)).max(initial=0.0) <= 180.0
        ):
            raise RefusedInput(
                where,
                "coordinates in no known system: allowed are degrees, or UTM that the file names",
            )
        return shapes, ()
    found = _UTM_CODE.match(crs)
    if found is None:
        return apply_projection(
            shapes, find_projection(text, where, shapely.get_coordinates(shapes), crs)
        )
    # The southern zones have a false northing of 10 000 km.
    south = found[1] == "327"
    return apply_projection(
        shapes,
        TransverseMercator(
            f"UTM zone {int(found[2])}{'S' if south else 'N'}",
            # UTM has zones of 6 degrees from 180 W, scale 0.9996 and false origins in metres.
            6.0 * int(found[2]) - 183.0,
            0.0,
            0.9996,
            500_000.0,
            1e7 if south else 0.0,
        ),
    )


def find_projection(
    text: str, where: PlaceInFile | Path | str, places: Floats, crs: str = ""
) -> Projection | None:
    """Returns the projection of a well-known text; None for degrees.

    Parameters
    ----------
    places : (n, 2) points in its coordinates.
    crs : name of a system that must be more than degrees.

    Raises
    ------
    RefusedInput : the projection is not supported.
    """
    try:
        found = parse_projection(text)
        # A text without a projection is in degrees.
        if found is not None or not crs:
            return found
    except ValueError as error:
        crs = crs or str(error)
    # The EPSG register knows many systems that the short parser refuses.
    if (grid := find_national_grid(text, places)) is not None:
        return grid
    raise RefusedInput(
        where,
        "coordinates in {system}: allowed are degrees on WGS84, or UTM",
        f": export it again in WGS84 (EPSG:4326), or {format_install_line('pyproj')}",
        system=crs[:120],
    )


def apply_projection(shapes: Any, projection: Projection | None) -> tuple[Any, tuple[Finding, ...]]:
    """Returns shapes in longitude and latitude, and findings."""
    if projection is None:
        return shapes, ()
    said = Finding(
        "projected", f"coordinates in {projection.name} taken to degrees{projection.how}"
    )
    return shapely.transform(
        shapes, lambda places: np.column_stack(projection.to_deg(places[:, 0], places[:, 1])[::-1])
    ), (said,)


def drop_kml_attributes(row: Mapping[str, Any]) -> dict[str, Any]:
    """Returns attributes without those that every KML has."""
    return {name: value for name, value in row.items() if name not in _KML_ATTRIBUTES}


def find_shape_name(row: Mapping[str, Any]) -> str:
    """Returns a shape's name; empty for a shape without a name. A shapefile cuts names of columns
    to ten letters."""
    # The names are tried in the order of how specific they are.
    for wanted in ("name", "title", "field", "field_name", "fieldname", "designator"):
        for name, value in row.items():
            if name.casefold() == wanted and value not in (None, ""):
                return str(value)
    return ""
