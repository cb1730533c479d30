"""How are prescriptions read and written as polygons with attributes? Formats are GeoPackage, KML,
KMZ, and GeoJSON (RFC 7946), where topdress's own files also hold fallbacks and the field.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import shapely
from topdress.control.recordings.finding import Finding, many
from topdress.control.targets.prescription import NO_FALLBACKS, Fallbacks, MapData
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.imports.import_errors import format_list
from topdress.drivers.files.ogr import write_layer
from topdress.drivers.files.prescriptions.features import (
    Feature,
    build_imported_map,
    convert_ring_deg,
)
from topdress.drivers.files.prescriptions.map_choices import (
    ImportedMap,
    NoPolygonsError,
    PrescriptionError,
    RateChoice,
    RateQuestion,
    check_rate_kg_ha,
)
from topdress.drivers.files.shape_layers import (
    Layer,
    drop_kml_attributes,
    find_shape_name,
    read_geojson,
    read_layers,
)
from topdress.drivers.plain_text import PlaceInFile

# Types of shapes that are zones, as GeoJSON names them.
POLYGON_TYPES = ("Polygon", "MultiPolygon")


def read_map_layers(path: Path, choice: RateChoice) -> ImportedMap:
    """Returns the prescription of a file with layers. Raises RefusedInput, OSError."""
    layers = read_layers(path)
    if choice.inside is not None:
        layers = [layer for layer in layers if layer.name.casefold() == choice.inside.casefold()]
    held = [layer for layer in layers if any(_is_polygon_shape(shape) for shape in layer.shapes)]
    if len(held) > 1:
        raise RateQuestion(
            path,
            "{count} layers of polygons: allowed is one of {names}",
            " (--inside says which)",
            count=len(held),
            names=format_list(layer.name for layer in held),
        )
    if not held:
        raise NoPolygonsError(
            path,
            "no layer of polygons: allowed is at least one polygon"
            if choice.inside is None
            else "no layer of polygons named {name}: allowed is at least one polygon",
            name=choice.inside,
        )
    named = tuple(
        {**drop_kml_attributes(row), "title": find_shape_name(row)} for row in held[0].rows
    )
    return convert_map_layer(
        path, path.suffix[1:].lower(), held[0]._replace(rows=named), choice, title=path.stem
    )


def convert_map_layer(
    path: Path, format_name: str, layer: Layer, choice: RateChoice, **more: Any
) -> ImportedMap:
    """Returns a layer's polygons as zones.

    Parameters
    ----------
    path : the file.
    format_name : name of the format in reports.
    layer : shapes with their attributes.
    choice : the operator's choice.
    more : further arguments of `build_imported_map`.

    Returns
    -------
    the prescription as read.

    Raises
    ------
    RefusedInput : the map cannot be used.
    OSError : a companion file cannot be read.
    """
    features = _list_features(layer)
    findings = list(layer.findings)
    nothing = sum(shape is None for shape in layer.shapes)
    if nothing:
        findings.append(
            Finding("empty_shapes", f"{many(nothing)} without a shape left out", rows=nothing)
        )
    if others := len(layer.shapes) - len(features) - nothing:
        findings.append(
            Finding(
                "not_polygons",
                f"{many(others, 'shape')} that are no polygons left out",
                rows=others,
            )
        )
    if not features and layer.kind and "POLYGON" not in layer.kind:
        raise NoPolygonsError(path, "shapes of type {kind}: allowed POLYGON", kind=layer.kind)
    return build_imported_map(
        path, format_name, features, choice, findings, units=layer.units, **more
    )


def _is_polygon_shape(shape: shapely.Geometry | None) -> bool:
    return shape is not None and shape.geom_type in POLYGON_TYPES and not shape.is_empty


def _list_features(layer: Layer) -> list[Feature]:
    """Returns the layer's polygons, numbered as its shapes."""
    found = []
    for number, (row, shape) in enumerate(zip(layer.rows, layer.shapes, strict=True), start=1):
        if not _is_polygon_shape(shape):
            continue
        polygons = [
            tuple(
                convert_ring_deg(shapely.get_coordinates(edge))
                for edge in (part.exterior, *part.interiors)
            )
            for part in shapely.get_parts(shape)
            if not part.is_empty
        ]
        found.append(Feature(number, row, polygons))
    return found


def write_map_layers(data: MapData, path: Path) -> None:
    """Writes a polygon for each zone, or for each cell of a grid; fallbacks and field are lost.
    Raises RefusedInput, OSError."""
    # This import is local, because `map_writer` imports this module.
    from topdress.drivers.files.prescriptions.map_writer import list_map_zones

    zones = list_map_zones(data)
    shapes = [
        shapely.Polygon(zone.rings_deg[0][:, ::-1], [hole[:, ::-1] for hole in zone.rings_deg[1:]])
        for zone in zones
    ]
    name = "title" if path.suffix.lower() == ".gpkg" else "Name"
    write_layer(
        path,
        "prescription",
        shapes,
        {name: [zone.title for zone in zones], "rate_kg_ha": [zone.rate_kg_ha for zone in zones]},
    )


# Foreign member for content that GeoJSON cannot express.
TOPDRESS_MEMBER = "topdress"


def read_geojson_map(path: Path, choice: RateChoice) -> ImportedMap:
    """Returns the prescription of a FeatureCollection of (multi)polygons. Raises RefusedInput,
    OSError."""
    layer = read_geojson(path, POLYGON_TYPES, strict=True)
    ours = layer.about.get(TOPDRESS_MEMBER)
    fallbacks, fields = (
        _read_own_member(ours, path) if isinstance(ours, dict) else (NO_FALLBACKS, ())
    )
    return convert_map_layer(
        path,
        "geojson",
        layer,
        choice,
        fallbacks=fallbacks,
        fields_deg=fields,
        title=layer.name,
        product=str(ours.get("product", "")) if isinstance(ours, dict) else "",
    )


def _read_own_member(
    ours: dict[str, Any], path: Path
) -> tuple[Fallbacks, tuple[tuple[Floats, ...], ...]]:
    """Returns fallbacks and fields of the foreign member. Raises PrescriptionError."""
    values = ours.get("fallbacks") or {}
    try:
        fallbacks = Fallbacks(**{name: float(value) for name, value in values.items()})
        fields = tuple(
            tuple(convert_ring_deg(corners) for corners in rings)
            for rings in ours.get("fields") or ()
        )
    except (TypeError, ValueError) as error:
        raise PrescriptionError(
            path, "{member}: {why}", member=TOPDRESS_MEMBER, why=error
        ) from None
    for name, value in fallbacks._asdict().items():
        place = PlaceInFile(str(path))
        key = f"{TOPDRESS_MEMBER}: {name}"
        check_rate_kg_ha(value, partial(place.go_down, "{key}", key=key))
    return fallbacks, fields
