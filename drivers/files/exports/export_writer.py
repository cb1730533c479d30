"""How is an as-applied export written in the format of the path's suffix? CSV, GeoJSON, shapefile
and GeoPackage contain points or the ground of each segment (`isoxml` writes the task).
"""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import shapefile
import shapely
from topdress.drivers.files.atomic_files import write_atomically
from topdress.drivers.files.exports.as_applied import AsApplied, ExportError
from topdress.drivers.files.exports.export_columns import (
    EXPORT_COLUMNS,
    TIME_SHORT_NAME,
    iter_export_records,
    summarise_export,
)
from topdress.drivers.files.formats.registry import describe_endings, find_writer
from topdress.drivers.files.prescriptions.task_files import WGS84_PRJ


def write_as_applied(applied: AsApplied, path: str | Path, polygons: bool = False) -> None:
    """Writes an as-applied export in the format of the path's suffix.

    Parameters
    ----------
    applied : the job as it was done.
    path : the suffix of this path chooses the format.
    polygons : whether the ground of each segment is written instead of its middle (GeoJSON,
    shapefile, GeoPackage).

    Raises
    ------
    ExportError : the suffix is unknown.
    OSError : the file cannot be written.
    """
    path = Path(path)
    # The suffix is checked before the folder is created.
    found = find_writer(path, "write_export")
    if found is None or found.write_export is None:
        raise ExportError(
            f"{path}: ending {path.suffix.lower()}: allowed {describe_endings('write_export')}, or "
            ".html (the report, which a browser prints to a PDF)"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    found.write_export(applied, path, polygons)


def write_export_csv(applied: AsApplied, path: Path, polygons: bool = False) -> None:
    """Writes UTF-8 with a header row; an empty cell is unknown. Raises OSError."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["utc", *(column.name for column in EXPORT_COLUMNS)])
    for utc, values in iter_export_records(applied):
        writer.writerow(
            # Unknown values are empty cells, which spreadsheets ignore in sums.
            [
                utc,
                *(
                    "" if value is None else f"{value:.{column.decimals}f}"
                    for column, value in zip(EXPORT_COLUMNS, values, strict=True)
                ),
            ]
        )
    write_atomically(path, text.getvalue())


def write_export_geojson(applied: AsApplied, path: Path, polygons: bool = False) -> None:
    """Writes RFC 7946; the foreign member `topdress` holds the sums. Raises OSError."""
    # Nine decimals are 0.1 mm, and fewer digits make the file smaller.
    corners = applied.stretches.corners_deg.round(9).tolist()
    features = []
    for k, (utc, values) in enumerate(iter_export_records(applied)):
        properties: dict[str, Any] = dict(
            zip((column.name for column in EXPORT_COLUMNS), values, strict=True)
        )
        if polygons:
            # GeoJSON expects longitude before latitude.
            ring = [[lon, lat] for lat, lon in corners[k]]
            geometry: dict[str, Any] = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        else:
            geometry = {
                "type": "Point",
                "coordinates": [properties["lon_deg"], properties["lat_deg"]],
            }
        features.append(
            {
                "type": "Feature",
                # A missing time is null, because an empty text is no time.
                "properties": {"utc": utc or None, **properties},
                "geometry": geometry,
            }
        )
    write_atomically(
        path,
        json.dumps(
            {
                "type": "FeatureCollection",
                "name": applied.title,
                "topdress": summarise_export(applied),
                "features": features,
            }
        ),
    )


def write_export_geopackage(applied: AsApplied, path: Path, polygons: bool = False) -> None:
    """Writes a GeoPackage with a layer `as_applied` by pyogrio (extra gis). Raises RefusedInput,
    OSError."""
    from topdress.drivers.files.ogr import write_layer

    s = applied.stretches
    shapes = (
        [shapely.Polygon(ring[:, ::-1]) for ring in s.corners_deg]
        if polygons
        else list(shapely.points(s.lon_deg, s.lat_deg))
    )
    rows = list(iter_export_records(applied))
    columns: dict[str, list[Any]] = {"utc": [utc for utc, _ in rows]}
    columns |= {
        column.name: [values[k] for _, values in rows] for k, column in enumerate(EXPORT_COLUMNS)
    }
    columns["product"] = [applied.product.name] * len(rows)
    write_layer(path, "as_applied", shapes, columns)


def write_export_shapefile(applied: AsApplied, path: Path, polygons: bool = False) -> None:
    """Writes a shapefile with names of at most ten characters and its companions .dbf, .shx, .prj
    (WGS84), .cpg. Raises OSError."""
    corners = applied.stretches.corners_deg.tolist()
    kind = shapefile.POLYGON if polygons else shapefile.POINT
    with shapefile.Writer(str(path), shapeType=kind, encoding="utf-8") as writer:
        writer.field(TIME_SHORT_NAME, "C", 24)
        for column in EXPORT_COLUMNS:
            writer.field(column.short, "N", column.width, column.decimals)
        # Text cells of a dBASE file have a fixed length.
        writer.field("PRODUCT", "C", 30)
        for k, (utc, values) in enumerate(iter_export_records(applied)):
            if polygons:
                # A shapefile's outlines run clockwise.
                ring = [(lon, lat) for lat, lon in reversed(corners[k])]
                writer.poly([[*ring, ring[0]]])
            else:
                writer.point(applied.stretches.lon_deg[k], applied.stretches.lat_deg[k])
            writer.record(utc, *values, applied.product.name[:30])
    # Without the .prj many programs would not place the file on a map.
    write_atomically(path.with_suffix(".prj"), WGS84_PRJ)
    write_atomically(path.with_suffix(".cpg"), "UTF-8")
