"""How are fields read from and written to shapes (KML, KMZ, GeoPackage, GeoJSON, shapefile)?
Polygons are outlines, lines are guidance lines.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from topdress.control.recordings.finding import Finding
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.atomic_files import write_atomically
from topdress.drivers.files.fields.field_data import FieldData, FieldError, FieldLine
from topdress.drivers.files.fields.task_fields import read_task_layers
from topdress.drivers.files.ogr import DRIVER_OF_ENDING, write_layer
from topdress.drivers.files.shape_layers import Layer, find_shape_name, read_layers

# Share of a polygon's area within another polygon from which it counts as a hole, because drawn
# edges overlap a little.
MIN_CONTAINED_AREA_SHARE = 0.999


def read_field_shapes(path: Path, name: str | None = None) -> FieldData:
    """Returns a field from a file of shapes.

    Parameters
    ----------
    path : a file, folder or zip in a known format.
    name : name of the field, where the file has several.

    Returns
    -------
    outline, holes and lines in degrees.

    Raises
    ------
    FieldError : the file has no polygon and no line, or several fields and no name is given.
    OSError : the file cannot be opened.
    """
    named, said = _read_shapes_and_findings(path)
    polygons = [
        (title, part)
        for title, shape in named
        for part in shapely.get_parts(shape)
        if part.geom_type == "Polygon" and not part.is_empty
    ]
    # Names that occur several times are numbered, so that each can be chosen.
    count = Counter(title for title, _ in polygons)
    polygons = [
        (
            title
            if (title and count[title] == 1) or len(polygons) == 1
            else f"{title or 'polygon'} {k}",
            shape,
        )
        for k, (title, shape) in enumerate(polygons, start=1)
    ]
    lines = [
        (title, part)
        for title, shape in named
        for part in shapely.get_parts(shape)
        if part.geom_type == "LineString" and not part.is_empty
    ]
    # Points alone cannot describe a field.
    if not polygons and not lines:
        raise FieldError(
            f"{path}: neither a polygon nor a line in it: allowed is a field's outline, or "
            "guidance lines"
        )
    title, outline, holes, findings = _choose_outline(path, polygons, name)
    return FieldData(
        title or path.stem,
        outline,
        holes,
        tuple(
            # Shapely has the longitude first, fields of this program the latitude.
            FieldLine(line_title or f"line {k}", shapely.get_coordinates(line)[:, ::-1].copy())
            for k, (line_title, line) in enumerate(lines, start=1)
        ),
        None,
        (*said, *findings),
    )


def read_named_shapes(path: Path) -> list[tuple[str, Any]]:
    """Returns names and shapes in longitude and latitude. Raises FieldError, RefusedInput,
    OSError."""
    return _read_shapes_and_findings(path)[0]


def _read_shapes_and_findings(path: Path) -> tuple[list[tuple[str, Any]], list[Finding]]:
    """Returns names and shapes, and findings about the other contents. Raises FieldError,
    RefusedInput, OSError."""
    # A folder or zip without shapefiles may hold a task set.
    layers = read_layers(path) or read_task_layers(path)
    findings = [finding for layer in layers if not layer.kind for finding in layer.findings]
    return _collect_layer_shapes(path, layers), findings


def _collect_layer_shapes(path: Path, layers: Sequence[Layer]) -> list[tuple[str, Any]]:
    """Returns names and shapes of layers. Raises FieldError."""
    if not layers and (path.is_dir() or path.suffix.lower() == ".zip"):
        raise FieldError(
            f"{path}: no shapefile, task set or field of AgOpenGPS in it: allowed is a .shp, "
            "TASKDATA.XML, or Field.txt with Boundary.txt"
        )
    # Points are positions of a machine or samples, not the edge of a field.
    if len(layers) == 1 and layers[0].kind.startswith(("POINT", "MULTI")):
        raise FieldError(
            f"{path}: shapes of type {layers[0].kind}: allowed are polygons (an outline) and lines "
            "(guidance)"
        )
    for layer in layers:
        where = path if len(layers) == 1 else f"{path}: {layer.name}"
        # One number beyond 180 shows that the coordinates are in metres.
        highest = np.abs(shapely.get_coordinates(layer.shapes)).max(initial=0.0)
        if not highest <= 180.0:
            said = (
                (" and no .prj that says in what", ", or UTM that the .prj names")
                if layer.kind
                else ("", "")
            )
            raise FieldError(
                f"{where}: coordinates up to {highest:.0f}{said[0]}: allowed are degrees "
                f"(WGS84){said[1]}"
            )
    return [
        (find_shape_name(row) or layer.name, shape)
        for layer in layers
        for row, shape in zip(layer.rows, layer.shapes, strict=True)
        if shape is not None
    ]


def _choose_outline(
    path: Path, polygons: Sequence[tuple[str, Any]], name: str | None
) -> tuple[str, Floats | None, tuple[Floats, ...], list[Finding]]:
    """Returns the outline's title, corners and holes, and findings. Raises FieldError where several
    fields are possible."""
    if name is not None:
        # Names are compared without case, because users type them by hand.
        polygons = [
            one for one in polygons if one[0].casefold() == name.casefold()
        ] or _refuse_unclear_field(path, polygons, name)
    if not polygons:
        # A file with lines only is valid: it has no outline.
        return "", None, (), []
    # The largest polygon is the field; the other polygons must be inside of it.
    title, outer = max(polygons, key=lambda one: one[1].area)
    others = [shape for _, shape in polygons if shape is not outer]
    # Polygons next to each other are several fields, and one must be chosen.
    if not all(_is_inside_outline(outer, shape) for shape in others):
        _refuse_unclear_field(path, polygons, name)
    holes = [ring for ring in outer.interiors] + [shape.exterior for shape in others]
    findings = (
        [
            Finding(
                "holes",
                f"{len(others)} polygon that lies in the field taken for ground that is not worked",
            )
        ]
        if others
        else []
    )
    return title, _extract_ring_deg(outer.exterior), tuple(map(_extract_ring_deg, holes)), findings


def _is_inside_outline(outer: Any, shape: Any) -> bool:
    """Returns whether a shape is inside of another; False where GEOS cannot intersect them because
    edges cross."""
    try:
        return bool(
            shapely.intersection(outer, shape).area >= MIN_CONTAINED_AREA_SHARE * shape.area
        )
    except shapely.errors.GEOSException:
        return False


def _refuse_unclear_field(
    path: Path, polygons: Sequence[tuple[str, Any]], name: str | None
) -> list[tuple[str, Any]]:
    """Raises FieldError with the list of possible fields."""
    # About a dozen names fit into a message.
    said = ", ".join(f"{title} ({_calc_area_ha(shape):.2f} ha)" for title, shape in polygons[:12])
    which = f"field {name}" if name is not None else f"{len(polygons)} fields"
    raise FieldError(f"{path}: {which}: allowed with --name is one of {said}")


def _calc_area_ha(shape: Any) -> float:
    """Returns a polygon's area, ha."""
    # The area is computed on a plane, because degrees have no common length.
    ring = _extract_ring_deg(shape.exterior)
    data = FieldData("", ring)
    places = data.plane().project_many_to_m(ring[:, 0], ring[:, 1])
    return float(shapely.Polygon(places).area) / 10_000.0


def _extract_ring_deg(ring: Any) -> Floats:
    """Returns corners (k, 2) in latitude and longitude, not closed."""
    # The last point repeats the first and is removed.
    return np.ascontiguousarray(shapely.get_coordinates(ring)[:-1, ::-1], dtype=np.float64)


def _list_drawn_shapes(data: FieldData) -> tuple[list[Any], list[Any]]:
    """Returns the outline, if there is one, and the guidance lines."""
    polygons = (
        []
        if data.outline_deg is None
        else [
            shapely.Polygon(data.outline_deg[:, ::-1], [hole[:, ::-1] for hole in data.holes_deg])
        ]
    )
    return polygons, [shapely.LineString(line.places_deg[:, ::-1]) for line in data.lines]


def write_field_geojson(data: FieldData, path: Path) -> None:
    """Writes a field as GeoJSON, which needs no library. Raises OSError."""
    polygons, lines = _list_drawn_shapes(data)
    titles = [*([data.title] * len(polygons)), *(line.title for line in data.lines)]
    features = [
        {
            "type": "Feature",
            "properties": {"name": title},
            "geometry": json.loads(shapely.to_geojson(shape)),
        }
        for title, shape in zip(titles, [*polygons, *lines], strict=True)
    ]
    root = {"type": "FeatureCollection", "name": data.title, "features": features}
    write_atomically(path, json.dumps(root, ensure_ascii=False))


def write_field_layers(data: FieldData, path: Path) -> None:
    """Writes a field as shapes in a format of GDAL, by the path's suffix. Raises RefusedInput,
    OSError."""
    polygons, lines = _list_drawn_shapes(data)
    # In KML this attribute is a placemark's title.
    column = "Name" if DRIVER_OF_ENDING[path.suffix.lower()] == "KML" else "name"
    shapes, titles = (
        [*polygons, *lines],
        [*([data.title] * len(polygons)), *(line.title for line in data.lines)],
    )
    # A layer of a GeoPackage holds one type of shapes.
    if path.suffix.lower() == ".gpkg" and polygons and lines:
        write_layer(path, "field", polygons, {column: [data.title]})
        write_layer(
            path, "lines", lines, {column: [line.title for line in data.lines]}, append=True
        )
    else:
        write_layer(path, "field", shapes, {column: titles})
