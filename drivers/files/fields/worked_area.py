"""Which ground has another program marked as worked? It comes from AgOpenGPS's Sections.txt, or
from polygons in any format of a field.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from topdress.control.field.done_ground import DoneGround, rasterise_ground
from topdress.control.geodesy import TangentPlane
from topdress.drivers.files.fields.agopengps import read_worked_triangles
from topdress.drivers.files.fields.field_data import FieldError
from topdress.drivers.files.fields.shapes import read_named_shapes
from topdress.drivers.files.file_sniffer import sniff_file_kind
from topdress.drivers.files.outline_overlaps import check_outlines

# AgOpenGPS's file of worked ground, compared in small letters.
SECTIONS_FILE = "sections.txt"


def read_worked_area(path: Path, plane: TangentPlane | None = None) -> DoneGround:
    """Returns ground that is already worked.

    Parameters
    ----------
    path : a field of AgOpenGPS (its folder, or Sections.txt in it), or a file of polygons.
    plane : plane of the field; None: a plane in the middle of this ground.

    Returns
    -------
    the ground on the plane.

    Raises
    ------
    FieldError : the file has no ground, or cannot be read.
    RefusedInput : an outline cannot be used, in one line.
    OSError : a file cannot be opened.
    """
    # Polygons are kept in degrees until the plane is known.
    shapes = _read_polygons_deg(path)
    places = shapely.get_coordinates(shapes)
    if plane is None:
        # Any plane near the ground is accurate enough.
        east, north = places.mean(axis=0)
        plane = TangentPlane(float(north), float(east))
    on = plane
    try:
        return rasterise_ground(
            shapely.transform(shapes, lambda at: on.project_many_to_m(at[:, 1], at[:, 0])), plane
        )
    except ValueError as error:
        raise FieldError(f"{path}: {error}") from None


def _read_polygons_deg(path: Path) -> np.ndarray:
    """Returns polygons (n,) in longitude and latitude."""
    if not path.exists():
        raise FieldError(
            f"{path}: no such file: allowed is a field of AgOpenGPS, or a file of polygons"
        )
    # The name decides for a single file, the content for a folder.
    if path.name.lower() == SECTIONS_FILE or (path.is_dir() and sniff_file_kind(path).id == "aog"):
        triangles = read_worked_triangles(path if path.is_dir() else path.parent)
        if not len(triangles):
            raise FieldError(f"{path}: no ground is marked as worked in Sections.txt")
        # Shapely expects the longitude first.
        return np.asarray(shapely.polygons(triangles[..., ::-1]), dtype=object)
    parts = [
        part
        for _, shape in read_named_shapes(path)
        for part in shapely.get_parts(shape)
        if part.geom_type == "Polygon" and not part.is_empty
    ]
    if not parts:
        raise FieldError(f"{path}: no polygon in it: allowed is ground that is done")
    # Outlines that cross themselves too often would take minutes to rasterise.
    check_outlines(
        [
            [shapely.get_coordinates(ring)[:-1] for ring in (one.exterior, *one.interiors)]
            for one in parts
        ],
        path,
    )
    return np.array(parts, dtype=object)
