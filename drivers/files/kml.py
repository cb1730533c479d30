"""How are KML (OGC 12-007r2) and KMZ read? Placemarks give polygons, lines and attributes; linked
files are never fetched.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from topdress.control.recordings.finding import Finding, many
from topdress.drivers.files.limits import DAMAGED_ZIP
from topdress.drivers.files.shape_layers import (
    Layer,
    build_polygon,
    combine_shapes,
    convert_to_degrees,
)
from topdress.drivers.files.stated_units import find_element_units
from topdress.drivers.files.xml_text import XmlError, find_local_name, parse_xml_root
from topdress.drivers.plain_text import PlaceInFile, RefusedInput

# Elements that may contain placemarks.
CONTAINER_TAGS = ("kml", "Document", "Folder")


def read_kml(path: Path) -> list[Layer]:
    """Returns a layer for each document or folder with placemarks. Raises RefusedInput,
    BeyondLimits, OSError."""
    data = path.read_bytes() if path.suffix.lower() == ".kml" else _read_kmz_bytes(path)
    try:
        root = parse_xml_root(data, path)
    except XmlError as error:
        raise RefusedInput(path, "not readable as KML: {why}", why=error) from None
    if find_local_name(root) not in CONTAINER_TAGS:
        raise RefusedInput(
            path, "not readable as KML: root element {tag}: allowed kml", tag=find_local_name(root)
        )
    return [
        _read_layer(path, root, container, placemarks)
        for container in root.iter()
        if find_local_name(container) in CONTAINER_TAGS
        and (placemarks := _find_children(container, "Placemark"))
    ]


def _read_kmz_bytes(path: Path) -> bytes:
    """Returns the first KML of a KMZ. Raises RefusedInput."""
    try:
        with zipfile.ZipFile(path) as archive:
            inside = next(
                (name for name in archive.namelist() if name.lower().endswith(".kml")), None
            )
            if inside is not None:
                return archive.read(inside)
    except DAMAGED_ZIP as error:
        raise RefusedInput(path, "not readable as a zip: {why}", why=error) from None
    raise RefusedInput(path, "no .kml in it")


def _read_layer(path: Path, root: Element, container: Element, placemarks: list[Element]) -> Layer:
    """Returns a container's placemarks as a layer."""
    name = _find_child_text(container, "name") or path.stem
    rows, shapes, closed = [], [], 0
    for number, placemark in enumerate(placemarks, start=1):
        where = (
            PlaceInFile(str(path))
            .go_down("layer {layer}", layer=name)
            .go_down("placemark {number}", number=number)
        )
        parts, unclosed = _read_shapes(placemark, where)
        closed += unclosed
        shapes.append(combine_shapes(parts))
        rows.append(
            {
                "Name": _find_child_text(placemark, "name"),
                "description": _find_child_text(placemark, "description"),
                **dict(_iter_attributes(placemark)),
            }
        )
    degrees, _ = convert_to_degrees(path, name, np.array(shapes, dtype=object), None)
    units = find_element_units(root, [column for row in rows for column in row], path.name)
    said = Finding(
        "closed_rings", f"{many(closed, 'ring')} without its closing corner closed", rows=closed
    )
    return Layer(name, tuple(rows), degrees, (said,) if closed else (), units)


def _iter_attributes(placemark: Element) -> Iterator[tuple[str, str]]:
    """Yields names and texts of `Data` with a `value`, and of `SimpleData` of a schema."""
    for extended in _find_children(placemark, "ExtendedData"):
        for inner in extended.iter():
            if find_local_name(inner) in ("Data", "SimpleData") and inner.get("name"):
                text = (
                    _find_child_text(inner, "value")
                    if find_local_name(inner) == "Data"
                    else inner.text or ""
                )
                yield inner.get("name", ""), text.strip()


def _read_shapes(placemark: Element, where: PlaceInFile) -> tuple[list[shapely.Geometry], int]:
    """Returns shapes in longitude and latitude, and the number of their rings that were
    not closed."""
    found, unclosed = [], 0
    for one in placemark.iter():
        kind = find_local_name(one)
        if kind == "Polygon":
            rings = [
                places
                for side in ("outerBoundaryIs", "innerBoundaryIs")
                for edge in _find_children(one, side)
                for ring in _find_children(edge, "LinearRing")
                if len(places := _read_places(ring, where))
            ]
            if rings:
                unclosed += sum(bool((places[0] != places[-1]).any()) for places in rings)
                found.append(build_polygon(rings, where))
        elif kind in ("LineString", "Point") and len(places := _read_places(one, where)):
            found.append(
                shapely.LineString(places) if len(places) > 1 else shapely.Point(places[0])
            )
    return found, unclosed


def _read_places(element: Element, where: PlaceInFile) -> np.ndarray:
    """Returns points (n, 2), longitude and latitude. Raises RefusedInput."""
    # Blanks separate points, but some programs also write them after commas.
    text = re.sub(r"\s*,\s*", ",", _find_child_text(element, "coordinates"))
    try:
        places = np.array(
            [[float(part) for part in place.split(",")[:2]] for place in text.split()]
        ).reshape(-1, 2)
    except ValueError:
        places = np.array([[np.nan, np.nan]])
    if not np.isfinite(places).all():
        raise RefusedInput(
            where, "coordinates are not pairs of numbers: allowed lon,lat[,height] parted by blanks"
        )
    return places


def _find_children(element: Element, name: str) -> list[Element]:
    return [child for child in element if find_local_name(child) == name]


def _find_child_text(element: Element, name: str) -> str:
    """Returns the text of a child; empty for a missing child."""
    return next(
        ((child.text or "").strip() for child in element if find_local_name(child) == name), ""
    )
