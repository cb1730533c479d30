"""Shapefiles with polygons and a rate column, in longitude and latitude."""
from __future__ import annotations

import struct
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import shapefile

from control.targets.rate_map import Floats
from drivers.files.findings import Finding, many
from drivers.files.prescriptions.features import Feature, imported, ring
from drivers.files.prescriptions.rings import sorted_rings
from drivers.files.prescriptions.words import Choice, Imported, PrescriptionError


def read_shapefile(path: Path, choice: Choice) -> Imported:
    """A prescription out of a shapefile or a zip that holds one. Raises PrescriptionError, OSError."""
    _refuse_projected(path)
    findings: list[Finding] = []
    try:
        with (warnings.catch_warnings(action="ignore"),
              shapefile.Reader(str(path), encoding="utf-8", encodingErrors="replace") as reader):
            if reader.shapeType not in (shapefile.POLYGON, shapefile.POLYGONZ, shapefile.POLYGONM):
                raise PrescriptionError(f"{path}: shapes of type {reader.shapeTypeName}: allowed POLYGON")
            names = [field[0] for field in reader.fields if field[0] != "DeletionFlag"]
            features, empty = _features(path, reader, names)
    except PrescriptionError:
        raise
    except (shapefile.ShapefileException, UnicodeDecodeError, zipfile.BadZipFile) as error:
        raise PrescriptionError(f"{path}: not readable as a shapefile: {str(error).splitlines()[0]}") from None
    except (ValueError, IndexError, OverflowError, MemoryError) as error:
        raise PrescriptionError(f"{path}: damaged shapefile ({type(error).__name__})") from None
    except struct.error as error:
        raise PrescriptionError(f"{path}: cut off: {error}") from None
    if empty:
        findings.append(Finding("empty_shapes", f"{many(empty, 'row')} without a shape left out", rows=empty))
    return imported(path, "shapefile", features, choice, findings, title=path.stem)


def _features(path: Path, reader: Any, names: list[str]) -> tuple[list[Feature], int]:
    features: list[Feature] = []
    empty = 0
    for number, (shape, record) in enumerate(zip(reader.iterShapes(), reader.iterRecords(), strict=True), start=1):
        if not shape.points:
            empty += 1
            continue
        features.append(Feature(number, dict(zip(names, record, strict=True)), _polygons(path, number, shape)))
    return features, empty


def _polygons(path: Path, number: int, shape: Any) -> list[tuple[Floats, ...]]:
    """Outlines run clockwise, holes the other way."""
    rings = [ring(shape.points[begin:end]) for begin, end in
             zip(shape.parts, [*shape.parts[1:], len(shape.points)], strict=True)]
    if any(len(corners) < 3 for corners in rings):
        raise PrescriptionError(f"{path}: row {number}: a ring of less than 3 corners: allowed 3 or more")
    if len(rings) == 1:
        return [(rings[0],)]
    outlines = [corners for corners in rings if _clockwise(corners)]
    if not outlines:
        return [(corners,) for corners in rings]
    return sorted_rings(outlines, [corners for corners in rings if not _clockwise(corners)])


def _clockwise(corners: Floats) -> bool:
    lat, lon = corners[:, 0] - corners[0, 0], corners[:, 1] - corners[0, 1]
    return bool(np.sum(lon * np.roll(lat, -1) - np.roll(lon, -1) * lat) < 0.0)


def _refuse_projected(path: Path) -> None:
    """Metres of some projection are refused, where the file says that it holds them."""
    if path.suffix.lower() == ".zip":
        with zipfile.ZipFile(path) as archive:
            texts = [archive.read(name) for name in archive.namelist() if name.lower().endswith(".prj")]
    else:
        texts = [place.read_bytes() for place in (path.with_suffix(".prj"), path.with_suffix(".PRJ"))
                 if place.is_file()]
    for text in texts:
        words = text.decode("utf-8", "replace").strip()
        if words.upper().startswith("PROJCS"):
            name = words.split('"')[1] if '"' in words else "a projection"
            raise PrescriptionError(f"{path}: coordinates in {name}: allowed is WGS84 (longitude, latitude); export "
                                    "the map again in it")
