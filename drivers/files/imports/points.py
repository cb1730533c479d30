"""Points with attributes: GeoJSON and shapefiles, as many as-applied files are."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import shapefile

from control.recordings.finding import Finding, many
from drivers.files.archives import chosen
from drivers.files.imports.header import named
from drivers.files.imports.mapping import Source
from drivers.files.imports.raw import RawTable
from drivers.files.imports.trouble import ImportTrouble, listed
from drivers.files.limits import read_json
from drivers.files.prescriptions.projected import TransverseMercator, projection_of
from drivers.files.shape_sets import ShapeSet, column_names, damage_said, shape_sets

LAT, LON = "lat_deg", "lon_deg"     # what places are called here
POINTS = (shapefile.POINT, shapefile.POINTZ, shapefile.POINTM)


def read_geojson(path: Path, said: Source) -> RawTable:
    """Features that are points. Raises ImportTrouble, OSError."""
    try:
        root = read_json(path)
    except ValueError as error:
        raise ImportTrouble(path, f"not readable as JSON: {error}") from None
    features = root.get("features") if isinstance(root, dict) else None
    if not isinstance(features, list) or not features:
        raise ImportTrouble(path, "no features: allowed is a FeatureCollection of points")
    points = [(feature["geometry"].get("coordinates"),
               stated if isinstance(stated := feature.get("properties"), dict) else {}) for feature in features
              if isinstance(feature, dict) and isinstance(feature.get("geometry"), dict)
              and feature["geometry"].get("type") == "Point"]
    if not points:
        raise ImportTrouble(path, "no feature is a point: allowed is a FeatureCollection of points (a map of areas "
                            "is read by topdress map)")
    names = list(dict.fromkeys(name for _, properties in points for name in properties))
    try:
        lon, lat = np.array([place[:2] for place, _ in points], np.float64).T
    except (ArithmeticError, TypeError, ValueError):
        raise ImportTrouble(path, "coordinates of a point are no two numbers: allowed [lon, lat]") from None
    if not names:
        raise ImportTrouble(path, "no point tells anything: allowed are points with properties")
    columns = [_column(name, [properties.get(name) for _, properties in points]) for name in names]
    others = len(features) - len(points)
    left_out = (Finding("not_points", f"{many(others, 'feature')} that are no points left out", rows=others),)
    source = said.model_copy(update={"kind": "geojson"})
    return _with_places(path, columns, lat, lon, source, left_out if others else ())


def read_shapefile(path: Path, said: Source) -> RawTable:
    """A shapefile of points; of a zip or folder the one that is, or the one that `said` names. Raises ImportTrouble,
    OSError."""
    with damage_said(str(path)):
        return _of_points(path, _one_of(path, said), said)


def _one_of(path: Path, said: Source) -> ShapeSet:
    """Of several the one that holds points. Raises ImportTrouble, Refused, OSError."""
    found = shape_sets(path)
    if said.inside is not None:
        named = chosen([one.name for one in found], said.inside)
        found = [one for one in found if one.name in named]
    if len(found) > 1:
        found = [one for one in found if _kind_of(one) in POINTS] or found
    if len(found) != 1:
        several = f"{len(found)} shapefiles of points: say source.inside in the import file; allowed " \
            f"{listed(one.name for one in found)}"
        raise ImportTrouble(path, f"{several if found else 'no shapefile in it'}")
    return found[0]


def _kind_of(shapes: ShapeSet) -> int:
    head = shapes.part(".shp") or b""
    return int.from_bytes(head[32:36], "little") if len(head) >= 36 else 0


def _of_points(path: Path, shapes: ShapeSet, said: Source) -> RawTable:
    findings: list[Finding] = []
    with shapes.reader(said.encoding) as reader:
        if reader.shapeType not in POINTS:
            raise ImportTrouble(path, f"shapes of type {reader.shapeTypeName}: allowed POINT (a map of areas is "
                                "read by topdress map)")
        names = _own_names(column_names(reader))
        found, records = reader.shapes(), reader.records()
    there = [k for k, shape in enumerate(found) if shape.points]
    if not there:
        raise ImportTrouble(path, "no point in it")
    if len(there) < len(found):
        lost = len(found) - len(there)
        findings.append(Finding("empty_shapes", f"{many(lost)} without a place left out", rows=lost))
    lon, lat = np.array([found[k].points[0][:2] for k in there], np.float64).T
    if (projection := _projection(shapes)) is not None:
        lat, lon = projection.to_deg(lon, lat)
        findings.append(Finding("projected", f"places in {projection.name} taken to degrees"))
    by_column = zip(*(records[k] for k in there), strict=True)
    columns = [_column(name, list(values)) for name, values in zip(names, by_column, strict=True)]
    source = said.model_copy(update={"kind": "shapefile"})
    side_units = shapes.units(names)
    units = {name: side_units[name.casefold()].text for name in names if name.casefold() in side_units}
    return _with_places(path, columns, lat, lon, source, tuple(findings), units)


def _own_names(names: list[str]) -> list[str]:
    """Of our own as-applied shapefiles the names that ten letters have cut, with their units; else as they stand."""
    from drivers.files.exports.columns import COLUMNS, TIME_SHORT
    long = {column.short: column.name for column in COLUMNS} | {TIME_SHORT: "utc"}
    return [long.get(name, name) for name in names] if set(long) <= set(names) else names


def _projection(shapes: ShapeSet) -> TransverseMercator | None:
    text = shapes.part(".prj")
    try:
        return None if text is None else projection_of(text.decode("utf-8", "replace"))
    except ValueError as error:
        raise ImportTrouble(shapes.label, f"places in {error}: allowed are degrees on WGS84, or UTM and other "
                            "transverse Mercator on it") from None


def _column(name: str, values: list[Any]) -> pl.Series:
    known = [value for value in values if value is not None]
    if known and all(isinstance(value, int | float) for value in known):
        return pl.Series(name, [None if value is None else float(value) for value in values], pl.Float64)
    return pl.Series(name, ["" if value is None else str(value).strip() for value in values], pl.String)


def _with_places(path: Path, columns: list[pl.Series], lat: np.ndarray, lon: np.ndarray, source: Source,
                 findings: tuple[Finding, ...], side_units: dict[str, str] | None = None) -> RawTable:
    frame = pl.DataFrame([column for column in columns if column.name not in (LAT, LON)])
    frame = frame.with_columns(pl.Series(LAT, lat), pl.Series(LON, lon))
    units = {name: unit for name in frame.columns if (unit := named(name)[1]) is not None}
    return RawTable(path, frame, source, units | (side_units or {}), 1, findings)
