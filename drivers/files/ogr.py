"""How are shapes with attributes written to formats of GDAL (KML, KMZ, GeoPackage)? The package
pyogrio (extra gis) calls GDAL.
"""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from topdress.drivers.files.optional_packages import format_extra_line
from topdress.drivers.plain_text import RefusedInput

# GDAL's drivers by suffix.
DRIVER_OF_ENDING = {".gpkg": "GPKG", ".kml": "KML", ".kmz": "KML"}


def write_layer(
    path: Path,
    layer: str,
    shapes: Sequence[shapely.Geometry],
    columns: Mapping[str, Sequence[Any]],
    append: bool = False,
) -> None:
    """Writes shapes with their attributes as GeoPackage, KML or KMZ, completely or not at all.

    Parameters
    ----------
    path : the file; its suffix chooses the format.
    layer : name of the layer.
    shapes : shapes in longitude and latitude.
    columns : attributes by name, each as long as the shapes.
    append : whether the layer is added to an existing file.

    Raises
    ------
    RefusedInput : pyogrio is not installed.
    OSError : the file cannot be written.
    """
    pyogrio = _import_pyogrio(path)
    suffix = path.suffix.lower()
    # GDAL writes in several steps, so it gets a temporary folder.
    with tempfile.TemporaryDirectory(prefix="topdress-") as folder:
        place = Path(folder) / f"{path.stem}{'.kml' if suffix == '.kmz' else suffix}"
        if append and path.exists():
            place.write_bytes(path.read_bytes())
        fields = [_make_field_array(values) for values in columns.values()]
        kinds = {shape.geom_type for shape in shapes}
        pyogrio.raw.write(
            place,
            shapely.to_wkb(np.asarray(shapes, dtype=object)),
            fields,
            list(columns),
            layer=layer,
            driver=DRIVER_OF_ENDING[suffix],
            geometry_type=kinds.pop() if len(kinds) == 1 else "Unknown",
            crs="EPSG:4326",
            append=append,
        )
        from topdress.drivers.files.atomic_files import write_atomically

        if suffix == ".kmz":
            packed = Path(folder) / "out.kmz"
            with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
                archive.write(place, "doc.kml")
            place = packed
        write_atomically(path, place.read_bytes())


def _make_field_array(values: Sequence[Any]) -> Any:
    """Returns attributes as numbers if all are numbers, else as texts."""
    if all(value is None or isinstance(value, int | float) for value in values):
        return np.array([np.nan if value is None else float(value) for value in values])
    return np.array(["" if value is None else str(value) for value in values], dtype=object)


def _import_pyogrio(path: Path) -> Any:
    """Returns the module. Raises RefusedInput where the extra is missing."""
    try:
        import pyogrio
        import pyogrio.raw
    except ImportError:
        raise RefusedInput(
            path,
            "{kind} needs the extra gis",
            f": {format_extra_line('gis')}",
            kind=path.suffix[1:].upper(),
        ) from None
    return pyogrio
