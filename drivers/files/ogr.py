"""Shapes with attributes in formats that GDAL reads and writes (KML, KMZ, GeoPackage), through pyogrio: extra gis."""
from __future__ import annotations

import re
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from drivers.files.extras import install_line
from drivers.files.limits import DAMAGED_ZIP, BeyondLimits, check_file
from drivers.files.prescriptions.projected import TransverseMercator, projection_of
from drivers.plain_text import Refused, Where

FORMATS = {".gpkg": "GPKG", ".kml": "KML", ".kmz": "KML"}
DEGREES = ("EPSG:4326", "OGC:CRS84", "EPSG:4258", "EPSG:4490", "EPSG:4269")     # WGS84, and within 2 m of it
_UTM = re.compile(r"^EPSG:(326|327|258)(\d\d)$")
_OF_KML = frozenset({"Name", "description", "timestamp", "begin", "end", "altitudeMode", "tessellate", "extrude",
                     "visibility", "drawOrder", "icon", "Description", "id"})


class ShapesError(Refused):
    """The file cannot be used."""


class Layer(NamedTuple):
    """`rows`: attributes; `shapes`: (n,) shapely geometries in longitude and latitude; `said`: what was taken how."""

    name: str
    rows: tuple[dict[str, Any], ...]
    shapes: np.ndarray[Any, Any]
    said: str = ""


def read_layers(path: Path) -> list[Layer]:
    """Raises ShapesError, OSError."""
    try:
        check_file(path)
    except BeyondLimits as error:
        raise ShapesError.of(error) from None
    pyogrio = _pyogrio(path)
    if path.suffix.lower() == ".kmz":
        return _of_kmz(path)
    try:
        names = [str(name) for name, _ in pyogrio.list_layers(path)]
        return [_layer(path, name, *_raw(pyogrio, path, name)) for name in names]
    except ShapesError:
        raise
    except pyogrio.errors.DataSourceError as error:
        raise ShapesError(path, "not readable as {kind}: {why}", kind=path.suffix[1:],
                          why=str(error).splitlines()[0][:150]) from None
    except (pyogrio.errors.DataLayerError, ValueError) as error:
        raise ShapesError(path, "{why}", why=str(error).splitlines()[0][:150]) from None


def _pyogrio(path: Path) -> Any:
    try:
        import pyogrio
        import pyogrio.raw
    except ImportError:
        raise ShapesError(path, "{kind} needs the extra gis", f": {install_line('gis')}",
                          kind=path.suffix[1:].upper()) from None
    return pyogrio


def _of_kmz(path: Path) -> list[Layer]:
    try:
        with zipfile.ZipFile(path) as archive:
            inside = next((name for name in archive.namelist() if name.lower().endswith(".kml")), None)
            data = b"" if inside is None else archive.read(inside)
    except DAMAGED_ZIP as error:
        raise ShapesError(path, "not readable as a zip: {why}", why=error) from None
    if not data:
        raise ShapesError(path, "no .kml in it")
    with tempfile.TemporaryDirectory(prefix="topdress-") as folder:
        plain = Path(folder) / f"{path.stem}.kml"
        plain.write_bytes(data)
        try:
            return read_layers(plain)
        except ShapesError as error:
            raise ShapesError.of(error, error.where._replace(file=str(path))) from None


def _raw(pyogrio: Any, path: Path, name: str) -> tuple[Any, Any, Any]:
    meta, _, shapes, columns = pyogrio.raw.read(path, layer=name, datetime_as_string=True, force_2d=True)
    return meta, shapes, columns


def _layer(path: Path, name: str, meta: Any, wkb: Any, columns: Any) -> Layer:
    names = [str(one) for one in meta["fields"]]
    rows = tuple(dict(zip(names, map(_plain, row), strict=True)) for row in zip(*columns, strict=True)) \
        if names else tuple({} for _ in wkb)
    shapes = shapely.from_wkb(wkb)
    shapes, said = _in_degrees(path, name, shapes, meta.get("crs"))
    return Layer(name, rows, shapes, said)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _in_degrees(path: Path, layer: str, shapes: Any, crs: str | None) -> tuple[Any, str]:
    where = Where(str(path)).at("layer {layer}", layer=layer)
    if crs is None or crs in DEGREES:
        if crs is None and len(shapes) and np.abs(shapely.get_coordinates(shapes)).max(initial=0.0) > 180.0:
            raise ShapesError(where, "coordinates in no known system: allowed are degrees, or UTM that the file names")
        return shapes, ""
    found = _UTM.match(crs)
    if found is not None:
        south = found[1] == "327"
        projection = TransverseMercator(f"UTM zone {int(found[2])}{'S' if south else 'N'}", 6.0 * int(found[2]) - 183.0,
                                        0.0, 0.9996, 500_000.0, 1e7 if south else 0.0)
    else:
        try:
            by_text = projection_of(crs)
        except ValueError:
            by_text = None
        if by_text is None:
            raise ShapesError(where, "coordinates in {system}: allowed are degrees on WGS84, or UTM",
                              ": export it again in WGS84 (EPSG:4326)", system=crs[:60])
        projection = by_text

    def turned(places: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        lat, lon = projection.to_deg(places[:, 0], places[:, 1])
        return np.column_stack((lon, lat))
    return shapely.transform(shapes, turned), f"coordinates in {projection.name} taken to degrees"


def write_layer(path: Path, layer: str, shapes: Sequence[shapely.Geometry], columns: Mapping[str, Sequence[Any]],
                append: bool = False) -> None:
    """Shapes in longitude and latitude with their attributes as GeoPackage, KML or KMZ, whole or not at all.

    Raises ShapesError, OSError.
    """
    pyogrio = _pyogrio(path)
    suffix = path.suffix.lower()
    with tempfile.TemporaryDirectory(prefix="topdress-") as folder:
        place = Path(folder) / f"{path.stem}{'.kml' if suffix == '.kmz' else suffix}"
        if append and path.exists():
            place.write_bytes(path.read_bytes())
        fields = [_array(values) for values in columns.values()]
        pyogrio.raw.write(place, shapely.to_wkb(np.asarray(shapes, dtype=object)), fields, list(columns), layer=layer,
                          driver=FORMATS[suffix], geometry_type=_type_of(shapes), crs="EPSG:4326", append=append)
        from drivers.files.atomic import write_atomically
        if suffix == ".kmz":
            packed = Path(folder) / "out.kmz"
            with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
                archive.write(place, "doc.kml")
            place = packed
        write_atomically(path, place.read_bytes())


def _type_of(shapes: Sequence[shapely.Geometry]) -> str:
    kinds = {shape.geom_type for shape in shapes}
    return kinds.pop() if len(kinds) == 1 else "Unknown"


def _array(values: Sequence[Any]) -> Any:
    if all(value is None or isinstance(value, int | float) for value in values):
        return np.array([np.nan if value is None else float(value) for value in values])
    return np.array(["" if value is None else str(value) for value in values], dtype=object)


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
