"""Plant lists: CSV with lat_deg and lon_deg, or GeoJSON points."""
from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from control.targets.rate_map import Floats
from drivers.files.limits import check_file
from drivers.files.prescriptions.words import PrescriptionError
from drivers.plain_text import PlaceInFile


def read_plants(path: Path) -> Floats:
    """Places (n, 2), latitude and longitude, in the file's order. Raises Refused in one line, OSError."""
    if not path.exists():
        raise PrescriptionError(path, "not there", ": allowed is a CSV with lat_deg and lon_deg, or GeoJSON points")
    check_file(path)
    rows = _geojson(path) if path.suffix.lower() in (".geojson", ".json") else _csv(path)
    if not rows:
        raise PrescriptionError(path, "no plants: allowed is at least one")
    places = np.array(rows, dtype=np.float64)
    bad = np.flatnonzero(~((np.abs(places[:, 0]) <= 90.0) & (np.abs(places[:, 1]) <= 180.0)))
    if len(bad):
        lat, lon = places[bad[0]]
        raise PrescriptionError(PlaceInFile(str(path)).at("plant {plant}", plant=bad[0] + 1),
                                "{lat:g}, {lon:g}: allowed are "
                                "degrees, latitude -90 to 90, longitude -180 to 180", lat=lat, lon=lon)
    return places


def _csv(path: Path) -> list[tuple[float, float]]:
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        reader = csv.DictReader(file)
        names = reader.fieldnames or []
        for name in ("lat_deg", "lon_deg"):
            if name not in names:
                raise PrescriptionError(path, "column {column} missing: allowed is a header with lat_deg and lon_deg",
                                        column=name)
        rows = []
        for number, row in enumerate(reader, start=2):
            try:
                rows.append((float(row["lat_deg"] or ""), float(row["lon_deg"] or "")))
            except ValueError:
                raise PrescriptionError(PlaceInFile(str(path)).at("line {line}", line=number),
                                        "{lat}, {lon}: allowed are "
                                        "numbers", lat=row["lat_deg"], lon=row["lon_deg"]) from None
        return rows


def _geojson(path: Path) -> list[tuple[float, float]]:
    from drivers.files.layers import read_geojson  # most jobs name no plants
    points = read_geojson(path, ["Point"]).shapes
    return [(point.y, point.x) for point in points if point is not None and not point.is_empty]
