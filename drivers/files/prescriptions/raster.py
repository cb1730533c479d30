"""How do rasters (GeoTIFF, Cloud Optimized GeoTIFF) become prescriptions? Each cell with a value
becomes a zone (extra raster).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from topdress.control.geodesy import SEMI_MAJOR_M
from topdress.control.recordings.finding import Finding, many
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.limits import RASTER_CELLS_LIMIT, check_limit
from topdress.drivers.files.optional_packages import format_extra_line
from topdress.drivers.files.prescriptions.features import Feature, build_imported_map
from topdress.drivers.files.prescriptions.map_choices import (
    ImportedMap,
    NotAMapError,
    PrescriptionError,
    RateChoice,
)
from topdress.drivers.files.prescriptions.map_projection import Projection
from topdress.drivers.files.shape_layers import find_projection
from topdress.drivers.files.stated_units import StatedUnit, find_json_units, merge_units
from topdress.drivers.plain_text import PlaceInFile

# First bytes of TIFF 6.0 and of BigTIFF, in both byte orders.
TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
# Cells with a value, a zone each: a field of 100 ha in cells of 3 m.
MAX_CELL_COUNT = 100_000
# Largest number of different values of a band that may hold classes.
MAX_CLASS_LEVELS = 12


def read_raster(path: Path, choice: RateChoice) -> ImportedMap:
    """Returns the prescription of a GeoTIFF. Its bands are the columns: by their description, else
    `band 1`, `band 2`. Raises PrescriptionError, OSError."""
    try:
        # An extra: few machines get rasters.
        import rasterio
    except ImportError:
        raise PrescriptionError(
            path,
            "this is a GeoTIFF, a raster: install the extra raster",
            f": {format_extra_line('raster')}",
        ) from None
    data = path.read_bytes()
    if data[:4] not in TIFF_MAGIC:
        raise NotAMapError(path, "not readable as GeoTIFF: its first bytes are not those of a TIFF")
    try:
        # Its bytes and this driver alone: GDAL opens what lies next to a file (.msk, .ovr) as
        # whatever it is.
        with rasterio.MemoryFile(data) as kept, kept.open(driver="GTiff") as file:
            return _read_open_raster(path, file, choice)
    except rasterio.errors.RasterioError as error:
        raise NotAMapError(
            path, "not readable as GeoTIFF: {why}", why=str(error).splitlines()[0][:150]
        ) from None


def _read_open_raster(path: Path, file: Any, choice: RateChoice) -> ImportedMap:
    if file.crs is None:
        raise PrescriptionError(
            path,
            "the raster does not say where it lies (no coordinate system): allowed are "
            "degrees on WGS84, or UTM",
        )
    west, south, east, north = file.bounds
    projection = find_projection(
        file.crs.to_wkt(version="WKT1_GDAL"), path, np.array([(west, south), (east, north)])
    )
    check_limit(RASTER_CELLS_LIMIT, file.width * file.height * file.count, path)
    check_limit(
        RASTER_CELLS_LIMIT,
        max(high * wide for high, wide in file.block_shapes),
        PlaceInFile(str(path)).go_down("a tile"),
    )
    # Bands without a description are numbered from 1, as GDAL does.
    names = [stated or f"band {k}" for k, stated in enumerate(file.descriptions, start=1)]
    bands = [_read_band_values(file, k) for k in range(1, file.count + 1)]
    said: list[Finding] = []
    known = _find_known_cells(bands)
    cell_m = _calc_cell_m(file.transform, (south + north) / 2.0, projection)
    step = _find_averaging_step(known, cell_m, choice.width_m)
    if step > 1:
        bands = [_average_cells(band, step) for band in bands]
        reason = (
            f"the working width is {choice.width_m:g} m"
            if choice.width_m is not None and step == math.floor(choice.width_m / cell_m)
            else f"a map has at most {MAX_CELL_COUNT} cells"
        )
        text = (
            f"{many(int(known.sum()), 'cell')} of {cell_m:.3g} m, each {step} x {step} of them "
            f"averaged to one: {reason}"
        )
        said.append(Finding("averaged", text, rows=int(known.sum())))
    rows, columns = np.nonzero(_find_known_cells(bands))
    if not len(rows):
        raise PrescriptionError(path, "no cell has a value")
    transform = file.transform * file.transform.scale(step, step)
    corners = _calc_corners_deg(transform, rows, columns, projection)
    features = [
        Feature(
            k + 1,
            {name: float(band[row, column]) for name, band in zip(names, bands, strict=True)},
            [(corners[k],)],
        )
        for k, (row, column) in enumerate(zip(rows.tolist(), columns.tolist(), strict=True))
    ]
    wide, high = (
        np.hypot(transform.a, transform.d),
        np.hypot(transform.b, transform.e),
    )
    # The size of a cell is given in the raster's own unit.
    unit = "deg" if projection is None else "m"
    findings = [
        *said,
        Finding("raster", f"{many(len(rows), 'cell')} of {wide:g} x {high:g} {unit}"),
    ]
    if projection is not None:
        findings.append(Finding("projected", f"coordinates in {projection.name} taken to degrees"))
    return build_imported_map(
        path,
        "raster",
        features,
        choice,
        findings,
        title=path.stem,
        units=_find_band_units(path, file, names),
    )


def _find_known_cells(bands: Sequence[Floats]) -> np.ndarray:
    """Returns which cells (height, width) have a value in any band."""
    known: np.ndarray = np.any([np.isfinite(band) for band in bands], axis=0)
    return known


def _calc_cell_m(transform: Any, lat_deg: float, projection: Projection | None) -> float:
    """Returns the shorter side of a cell, m; a raster in degrees lies at `lat_deg`."""
    per_x, per_y = (1.0, 1.0)
    if projection is None:
        per_y = math.radians(1.0) * SEMI_MAJOR_M
        per_x = per_y * math.cos(math.radians(lat_deg))
    return min(
        math.hypot(transform.a * per_x, transform.d * per_y),
        math.hypot(transform.b * per_x, transform.e * per_y),
    )


def _find_averaging_step(known: np.ndarray, cell_m: float, width_m: float | None) -> int:
    """Returns how many cells on a side become a single cell. A raster of up to MAX_CELL_COUNT
    cells stays as it is; beyond, cells become as wide as the working width, which is the least
    that the machine can follow, and wider where that is too many still."""
    if int(known.sum()) <= MAX_CELL_COUNT:
        return 1
    step = max(
        1,
        math.isqrt(int(known.sum()) // MAX_CELL_COUNT),
        0 if width_m is None else math.floor(width_m / cell_m),
    )
    while int(_sum_cell_blocks(known.astype(np.float64), step)[1].sum()) > MAX_CELL_COUNT:
        step += 1
    return step


def _sum_cell_blocks(values: Floats, step: int) -> tuple[Floats, np.ndarray]:
    """Returns sums of blocks of `step` x `step` cells, and which blocks are half full or more,
    where a value of 1 is a cell that counts."""
    high, wide = (-size % step for size in values.shape)
    # The last blocks reach over the edge.
    padded = np.pad(values, ((0, high), (0, wide)))
    rows, columns = (size // step for size in padded.shape)
    sums = padded.reshape(rows, step, columns, step).sum(axis=(1, 3))
    return sums, 2.0 * sums >= step * step


def _average_cells(band: Floats, step: int) -> Floats:
    """Returns means of each block of cells; NaN where less than half of the cells have a value.

    A band of few values may hold classes, between which nothing lies: the most frequent class is
    taken.
    """
    known = np.isfinite(band)
    count, is_known = _sum_cell_blocks(known.astype(np.float64), step)
    levels = np.unique(band[known])
    if len(levels) <= MAX_CLASS_LEVELS:
        shares = [_sum_cell_blocks((band == level).astype(np.float64), step)[0] for level in levels]
        found = levels[np.argmax(shares, axis=0)] if len(levels) else np.zeros_like(count)
    else:
        sums = _sum_cell_blocks(np.where(known, band, 0.0), step)[0]
        found = sums / np.maximum(count, 1.0)
    return np.where(is_known, found, np.nan)


def _read_band_values(file: Any, number: int) -> Floats:
    """Returns a band (height, width) by its own scale and offset; NaN where it has no value."""
    read = file.read(number, masked=True)
    values: Floats = np.ma.filled(read.astype(np.float64), np.nan)
    return np.asarray(values * file.scales[number - 1] + file.offsets[number - 1])


def _find_band_units(path: Path, file: Any, names: list[str]) -> Mapping[str, StatedUnit]:
    """Returns units of the bands: their own, or those of their or the file's tags."""
    found = [find_json_units(file.tags(), names, path.name)]
    for k, name in enumerate(names, start=1):
        found.append(
            {name.casefold(): StatedUnit(unit, path.name)} if (unit := file.units[k - 1]) else {}
        )
        found.append(find_json_units({"name": name, **file.tags(k)}, [name], path.name))
    return merge_units(*found)


def _calc_corners_deg(
    transform: Any, rows: Any, columns: Any, projection: Projection | None
) -> Floats:
    """Returns latitude and longitude (n, 4, 2) of the cells' corners."""
    across = columns[:, None] + np.array([0.0, 1.0, 1.0, 0.0])
    down = rows[:, None] + np.array([0.0, 0.0, 1.0, 1.0])
    east = transform.a * across + transform.b * down + transform.c
    north = transform.d * across + transform.e * down + transform.f
    if projection is None:
        return np.stack((north, east), axis=-1)
    lat, lon = projection.to_deg(east.ravel(), north.ravel())
    return np.stack((lat.reshape(east.shape), lon.reshape(east.shape)), axis=-1)
