"""Rasters (GeoTIFF, Cloud Optimized GeoTIFF) as prescriptions: each cell with a value is a
zone. Extra raster."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from control.recordings.finding import Finding, many
from control.targets.rate_map import Floats
from drivers.files.extras import extra_line
from drivers.files.layers import projection_in
from drivers.files.limits import RASTER_CELLS, held_to
from drivers.files.prescriptions.features import Feature, imported
from drivers.files.prescriptions.projected import Projection
from drivers.files.prescriptions.words import Imported, NotAMap, PrescriptionError, RateChoice
from drivers.files.stated_units import StatedUnit, of_json, together
from drivers.plain_text import PlaceInFile

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")  # TIFF 6.0, and BigTIFF
# with a value: a zone each; a field of 100 ha in cells of 3 m
MOST_CELLS = 100_000


def read_raster(path: Path, choice: RateChoice) -> Imported:
    """The bands are the columns: by their description, else `band 1`, `band 2`. Raises
    PrescriptionError, OSError."""
    try:
        import rasterio
    except ImportError:
        raise PrescriptionError(
            path,
            "this is a GeoTIFF, a raster: install the extra raster",
            f": {extra_line('raster')}",
        ) from None
    data = path.read_bytes()
    if data[:4] not in MAGIC:
        raise NotAMap(path, "not readable as GeoTIFF: its first bytes are not those of a TIFF")
    try:
        # Its bytes and this driver alone: GDAL opens what lies next to a file (.msk, .ovr) as
        # whatever it is.
        with rasterio.MemoryFile(data) as kept, kept.open(driver="GTiff") as file:
            return _read(path, file, choice)
    except rasterio.errors.RasterioError as error:
        raise NotAMap(
            path, "not readable as GeoTIFF: {why}", why=str(error).splitlines()[0][:150]
        ) from None


def _read(path: Path, file: Any, choice: RateChoice) -> Imported:
    if file.crs is None:
        raise PrescriptionError(
            path,
            "the raster does not say where it lies (no coordinate system): allowed are "
            "degrees on WGS84, or UTM",
        )
    west, south, east, north = file.bounds
    projection = projection_in(
        file.crs.to_wkt(version="WKT1_GDAL"), path, np.array([(west, south), (east, north)])
    )
    held_to(RASTER_CELLS, file.width * file.height * file.count, path)
    held_to(
        RASTER_CELLS,
        max(high * wide for high, wide in file.block_shapes),
        PlaceInFile(str(path)).at("a tile"),
    )
    names = [stated or f"band {k}" for k, stated in enumerate(file.descriptions, start=1)]
    bands = [_band(file, k) for k in range(1, file.count + 1)]
    known = np.zeros((file.height, file.width), dtype=bool)
    for band in bands:
        known |= np.isfinite(band)
    rows, columns = np.nonzero(known)
    if not len(rows):
        raise PrescriptionError(path, "no cell has a value")
    if len(rows) > MOST_CELLS:
        raise PrescriptionError(
            path,
            "{cells} cells: allowed up to {most}: resample it to cells of the working width first",
            " (in QGIS: Warp, average)",
            cells=len(rows),
            most=MOST_CELLS,
        )
    corners = _corners(file.transform, rows, columns, projection)
    features = [
        Feature(
            k + 1,
            {name: float(band[row, column]) for name, band in zip(names, bands, strict=True)},
            [(corners[k],)],
        )
        for k, (row, column) in enumerate(zip(rows.tolist(), columns.tolist(), strict=True))
    ]
    wide, high = (
        np.hypot(file.transform.a, file.transform.d),
        np.hypot(file.transform.b, file.transform.e),
    )
    unit = "deg" if projection is None else "m"
    findings = [Finding("raster", f"{many(len(rows), 'cell')} of {wide:g} x {high:g} {unit}")]
    if projection is not None:
        findings.append(Finding("projected", f"coordinates in {projection.name} taken to degrees"))
    return imported(
        path, "raster", features, choice, findings, title=path.stem, units=_units(path, file, names)
    )


def _band(file: Any, number: int) -> Floats:
    """(height, width), NaN where there is no value, by the band's own scale and offset."""
    read = file.read(number, masked=True)
    values: Floats = np.ma.filled(read.astype(np.float64), np.nan)
    return np.asarray(values * file.scales[number - 1] + file.offsets[number - 1])


def _units(path: Path, file: Any, names: list[str]) -> Mapping[str, StatedUnit]:
    """Of the bands: their own unit, or what their or the file's tags say."""
    found = [of_json(file.tags(), names, path.name)]
    for k, name in enumerate(names, start=1):
        found.append(
            {name.casefold(): StatedUnit(unit, path.name)} if (unit := file.units[k - 1]) else {}
        )
        found.append(of_json({"name": name, **file.tags(k)}, [name], path.name))
    return together(*found)


def _corners(transform: Any, rows: Any, columns: Any, projection: Projection | None) -> Floats:
    """(n, 4, 2) latitude and longitude of the cells' corners."""
    across = columns[:, None] + np.array([0.0, 1.0, 1.0, 0.0])
    down = rows[:, None] + np.array([0.0, 0.0, 1.0, 1.0])
    east = transform.a * across + transform.b * down + transform.c
    north = transform.d * across + transform.e * down + transform.f
    if projection is None:
        return np.stack((north, east), axis=-1)
    lat, lon = projection.to_deg(east.ravel(), north.ravel())
    return np.stack((lat.reshape(east.shape), lon.reshape(east.shape)), axis=-1)
