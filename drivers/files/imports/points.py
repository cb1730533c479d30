"""Points with attributes: GeoJSON and shapefiles, as many as-applied files are."""
from __future__ import annotations

import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import shapefile

from drivers.files.findings import Finding, many
from drivers.files.imports.header import named
from drivers.files.imports.mapping import Source
from drivers.files.imports.raw import RawTable
from drivers.files.imports.trouble import ImportTrouble
from drivers.files.limits import read_json
from drivers.files.prescriptions.projected import projection_of

LAT, LON = "lat_deg", "lon_deg"     # what places are called here
POINTS = (shapefile.POINT, shapefile.POINTZ, shapefile.POINTM)


def read_geojson(path: Path, said: Source) -> RawTable:
    """Features that are points. Raises ImportTrouble, OSError."""
    try:
        root = read_json(path)
    except ValueError as error:
        raise ImportTrouble(f"{path}: not readable as JSON: {error}") from None
    features = root.get("features") if isinstance(root, dict) else None
    if not isinstance(features, list) or not features:
        raise ImportTrouble(f"{path}: no features: allowed is a FeatureCollection of points")
    points = [(feature["geometry"]["coordinates"], told if isinstance(told := feature.get("properties"), dict) else {})
              for feature in features
              if isinstance(feature, dict) and isinstance(feature.get("geometry"), dict)
              and feature["geometry"].get("type") == "Point"]
    if not points:
        raise ImportTrouble(f"{path}: no feature is a point: allowed is a FeatureCollection of points (a map of areas "
                            "is read by topdress map)")
    names = list(dict.fromkeys(name for _, properties in points for name in properties))
    try:
        lon, lat = np.array([place[:2] for place, _ in points], np.float64).T
    except (ArithmeticError, TypeError, ValueError):
        raise ImportTrouble(f"{path}: coordinates of a point are no two numbers: allowed [lon, lat]") from None
    if not names:
        raise ImportTrouble(f"{path}: no point tells anything: allowed are points with properties")
    columns = [_column(name, [properties.get(name) for _, properties in points]) for name in names]
    others = len(features) - len(points)
    left_out = (Finding("not_points", f"{many(others, 'feature')} that are no points left out", rows=others),)
    source = said.model_copy(update={"kind": "geojson"})
    return _with_places(path, columns, lat, lon, source, left_out if others else ())


def read_shapefile(path: Path, said: Source) -> RawTable:
    """A shapefile of points, or a zip that holds one. Raises ImportTrouble, OSError."""
    findings: list[Finding] = []
    try:
        with shapefile.Reader(str(path), encoding=said.encoding or "utf-8", encodingErrors="replace") as reader:
            if reader.shapeType not in POINTS:
                raise ImportTrouble(f"{path}: shapes of type {reader.shapeTypeName}: allowed POINT (a map of areas is "
                                    "read by topdress map)")
            names = [field[0] for field in reader.fields if field[0] != "DeletionFlag"]
            shapes, records = reader.shapes(), reader.records()
    except (shapefile.ShapefileException, zipfile.BadZipFile, struct.error, UnicodeDecodeError) as error:
        raise ImportTrouble(f"{path}: not readable as a shapefile: {str(error).splitlines()[0]}") from None
    there = [k for k, shape in enumerate(shapes) if shape.points]
    if not there:
        raise ImportTrouble(f"{path}: no point in it")
    if len(there) < len(shapes):
        lost = len(shapes) - len(there)
        findings.append(Finding("empty_shapes", f"{many(lost)} without a place left out", rows=lost))
    lon, lat = np.array([shapes[k].points[0][:2] for k in there], np.float64).T
    if (projection := _projection(path)) is not None:
        lat, lon = projection.to_deg(lon, lat)
        findings.append(Finding("projected", f"places in {projection.name} taken to degrees"))
    by_column = zip(*(records[k] for k in there), strict=True)
    columns = [_column(name, list(values)) for name, values in zip(names, by_column, strict=True)]
    return _with_places(path, columns, lat, lon, said.model_copy(update={"kind": "shapefile"}), tuple(findings))


def _projection(path: Path) -> Any:
    if path.suffix.lower() == ".zip":
        with zipfile.ZipFile(path) as archive:
            texts = [archive.read(name) for name in archive.namelist() if name.lower().endswith(".prj")]
    else:
        places = (path.with_suffix(".prj"), path.with_suffix(".PRJ"))
        texts = [place.read_bytes() for place in places if place.is_file()]
    try:
        return projection_of(texts[0].decode("utf-8", "replace")) if texts else None
    except ValueError as error:
        raise ImportTrouble(f"{path}: places in {error}: allowed are degrees on WGS84, or UTM and other transverse "
                            "Mercator on it") from None


def _column(name: str, values: list[Any]) -> pl.Series:
    known = [value for value in values if value is not None]
    if known and all(isinstance(value, int | float) for value in known):
        return pl.Series(name, [None if value is None else float(value) for value in values], pl.Float64)
    return pl.Series(name, ["" if value is None else str(value).strip() for value in values], pl.String)


def _with_places(path: Path, columns: list[pl.Series], lat: np.ndarray, lon: np.ndarray, source: Source,
                 findings: tuple[Finding, ...]) -> RawTable:
    frame = pl.DataFrame([column for column in columns if column.name not in (LAT, LON)])
    frame = frame.with_columns(pl.Series(LAT, lat), pl.Series(LON, lon))
    units = {name: unit for name in frame.columns if (unit := named(name)[1]) is not None}
    return RawTable(path, frame, source, units, 1, findings)
