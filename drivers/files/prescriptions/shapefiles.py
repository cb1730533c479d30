"""Shapefiles with polygons and a rate column, in degrees or in metres of a transverse Mercator projection."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapefile

from control.recordings.finding import Finding, many
from control.targets.rate_map import Floats
from drivers.files.prescriptions.features import Feature, imported, ring, sorted_rings
from drivers.files.prescriptions.projected import TransverseMercator, projection_of
from drivers.files.prescriptions.words import Choice, Imported, NoPolygons, PrescriptionError
from drivers.files.shape_sets import ShapeSet, column_names, damage_said
from drivers.files.stated_units import NO_UNITS
from drivers.plain_text import Where

POLYGONS = (shapefile.POLYGON, shapefile.POLYGONZ, shapefile.POLYGONM)


def read_shapefile(shapes: ShapeSet, choice: Choice, findings: list[Finding]) -> Imported:
    """A prescription out of a shapefile. Raises PrescriptionError, OSError."""
    path = shapes.label
    with damage_said(path):
        projection = projection_in(shapes)
        with shapes.reader() as reader:
            if reader.shapeType not in POLYGONS:
                raise NoPolygons(path, "shapes of type {kind}: allowed POLYGON", kind=reader.shapeTypeName)
            names = column_names(reader)
            features, empty = _features(path, reader, names)
        units = NO_UNITS if Path(path).is_file() else shapes.units(names)
    if projection is not None:
        features = _in_degrees(features, projection)
        findings.append(Finding("projected", f"coordinates in {projection.name} taken to degrees"))
    if empty:
        findings.append(Finding("empty_shapes", f"{many(empty, 'row')} without a shape left out", rows=empty))
    return imported(Path(path), "shapefile", features, choice, findings, title=shapes.stem, units=units)


def _features(path: str, reader: Any, names: list[str]) -> tuple[list[Feature], int]:
    features: list[Feature] = []
    empty = 0
    for number, (shape, record) in enumerate(zip(reader.iterShapes(), reader.iterRecords(), strict=True), start=1):
        if not shape.points:
            empty += 1
            continue
        features.append(Feature(number, dict(zip(names, record, strict=True)), _polygons(path, number, shape)))
    return features, empty


def _polygons(path: str, number: int, shape: Any) -> list[tuple[Floats, ...]]:
    """Outlines run clockwise, holes the other way."""
    rings = [ring(shape.points[begin:end]) for begin, end in
             zip(shape.parts, [*shape.parts[1:], len(shape.points)], strict=True)]
    if any(len(corners) < 3 for corners in rings):
        raise PrescriptionError(Where(path).at("row {row}", row=number),
                                "a ring of less than 3 corners: allowed 3 or more")
    if len(rings) == 1:
        return [(rings[0],)]
    outlines = [corners for corners in rings if _clockwise(corners)]
    if not outlines:
        return [(corners,) for corners in rings]
    return sorted_rings(outlines, [corners for corners in rings if not _clockwise(corners)])


def _clockwise(corners: Floats) -> bool:
    lat, lon = corners[:, 0] - corners[0, 0], corners[:, 1] - corners[0, 1]
    return bool(np.sum(lon * np.roll(lat, -1) - np.roll(lon, -1) * lat) < 0.0)


def projection_in(shapes: ShapeSet) -> TransverseMercator | None:
    """What the `.prj` next to the file says; None for degrees, or without one. Raises PrescriptionError."""
    text = shapes.part(".prj")
    if text is None:
        return None
    try:
        return projection_of(text.decode("utf-8", "replace"))
    except ValueError as error:
        raise PrescriptionError(
            shapes.label, "coordinates in {system}: allowed are longitude and latitude on WGS84, or UTM",
            " and other transverse Mercator on it", system=error) from None


def _in_degrees(features: list[Feature], projection: TransverseMercator) -> list[Feature]:
    """The features with their rings, which hold north and east, in latitude and longitude: all corners at once."""
    rings = [corners for feature in features for polygon in feature.polygons_deg for corners in polygon]
    if not rings:
        return features
    flat = np.concatenate(rings)
    lat, lon = projection.to_deg(flat[:, 1], flat[:, 0])
    ready = iter(np.split(np.column_stack((lat, lon)), np.cumsum([len(corners) for corners in rings])[:-1]))
    return [feature._replace(polygons_deg=[tuple(next(ready) for _ in polygon) for polygon in feature.polygons_deg])
            for feature in features]
