"""Outlines and lines of a field out of shapefiles: polygons and poly-lines, in degrees or transverse Mercator."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapely

from drivers.files.fields.field_data import FieldError
from drivers.files.layers import name_of
from drivers.files.prescriptions.projected import TransverseMercator
from drivers.files.prescriptions.shapefiles import projection_in
from drivers.files.shape_sets import ShapeSet, column_names, damage_said, shape_sets

TAKEN = (3, 5, 13, 15, 23, 25)      # types of shapes: poly-lines and polygons, with height, with measure


def is_shapefile(path: Path) -> bool:
    return path.suffix.lower() in (".shp", ".zip") or path.is_dir()


def read_named(path: Path) -> list[tuple[str, Any]]:
    """Names and shapes, longitude and latitude, of a .shp, or of all shapefiles in a zip or folder that hold areas or
    lines. Raises FieldError, Refused, OSError."""
    sets = shape_sets(path)
    if not sets:
        raise FieldError(f"{path}: no shapefile and no field of AgOpenGPS in it: allowed is a .shp, or Field.txt with "
                         "Boundary.txt")
    return [one for shapes in sets for one in _of_set(shapes, alone=len(sets) == 1)]


def _of_set(shapes: ShapeSet, alone: bool) -> list[tuple[str, Any]]:
    """alone: the only one, so that points in it are an error."""
    with damage_said(shapes.label):
        projection = projection_in(shapes)
        with shapes.reader() as reader:
            if reader.shapeType not in TAKEN:
                if not alone:
                    return []
                raise FieldError(f"{shapes.label}: shapes of type {reader.shapeTypeName}: allowed are polygons (an "
                                 "outline) and lines (guidance)")
            names = column_names(reader)
            found = [(name_of(dict(zip(names, record, strict=True))), shapely.geometry.shape(shape.__geo_interface__))
                     for shape, record in zip(reader.iterShapes(), reader.iterRecords(), strict=True) if shape.points]
    return [(title or shapes.stem, _in_degrees(shapes.label, shapely.force_2d(one), projection))
            for title, one in found]


def _in_degrees(label: str, shape: Any, projection: TransverseMercator | None) -> Any:
    if projection is None:
        highest = np.abs(shapely.get_coordinates(shape)).max(initial=0.0)
        if not highest <= 180.0:
            raise FieldError(f"{label}: coordinates up to {highest:.0f} and no .prj that says in what: allowed are "
                             "degrees (WGS84), or UTM that the .prj names")
        return shape

    def turned(places: Any) -> Any:
        lat, lon = projection.to_deg(places[:, 0], places[:, 1])
        return np.column_stack((lon, lat))
    return shapely.transform(shape, turned)
