"""How is a prescription written? Formats are ISO 11783-10 task (zones, grid of type 1 or 2),
GeoJSON and shapefile.
"""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapefile
from topdress.control.targets.prescription import (
    NO_FALLBACKS,
    GridDeg,
    MapData,
    Zone,
    calc_rate_shares,
    separate_zones,
)
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.atomic_files import write_atomically
from topdress.drivers.files.formats.registry import describe_endings, find_writer
from topdress.drivers.files.prescriptions.map_choices import PrescriptionError
from topdress.drivers.files.prescriptions.shapes import TOPDRESS_MEMBER
from topdress.drivers.files.prescriptions.task_files import (
    WGS84_PRJ,
    add_polygon_element,
    clean_task_name,
    format_cell_degrees,
    format_degrees,
    make_task_root,
    write_task_files,
)

# Steps of DDI 6 are mg/m2; 100 of them are 1 kg/ha.
MG_M2_PER_KG_HA = 100.0
# Codes of the task's zones.
DEFAULT_ZONE_CODE, LOST_ZONE_CODE, OUTSIDE_ZONE_CODE, CELL_ZONE_CODE = "0", "1", "2", "3"
# Codes after the three fallbacks belong to rates.
FIRST_RATE_CODE = 3
# Number of codes 0 to 254 minus the three fallbacks.
MAX_RATE_LEVELS = 252


def write_prescription(data: MapData, path: Path) -> None:
    """Writes a prescription in the format of the path's suffix; a folder for a task without one.

    Task files hold integers in mg/m2 (0.01 kg/ha). A shapefile cannot hold fallbacks and field.

    Raises
    ------
    PrescriptionError : the map has more rates than a task file can hold, or the suffix is unknown.
    ValueError : the map is unusable.
    OSError : the file cannot be written.
    """
    path = Path(path)
    found = find_writer(path, "write_map")
    if found is None or found.write_map is None:
        raise PrescriptionError(path, "allowed {endings}", endings=describe_endings("write_map"))
    found.write_map(data, path)


def write_map_task(data: MapData, path: Path) -> None:
    """Writes a task: a zip, or the files of a folder. Raises PrescriptionError, OSError."""
    try:
        root, files = build_prescription_task(data)
    except PrescriptionError as error:
        raise PrescriptionError.from_error(error, path) from None
    write_task_files(path, root, files)


def describe_losses(data: MapData, path: Path) -> str:
    """Returns the content that the format cannot hold, in a sentence; empty where it holds
    everything."""
    lost = (
        [
            f"rates where the map says nothing ({data.fallbacks.default_kg_ha:g} in the field, "
            f"{data.fallbacks.outside_kg_ha:g} outside, {data.fallbacks.lost_kg_ha:g} kg/ha "
            "with the position lost)"
        ]
        if data.fallbacks != NO_FALLBACKS
        else []
    )
    lost += ["the field's outline"] if data.fields_deg else []
    found = find_writer(path, "write_map")
    if not lost or found is None or found.keeps_fallbacks:
        return ""
    return f"{path.suffix} has no place for {' and '.join(lost)}: .geojson and task files keep them"


def build_prescription_task(data: MapData) -> tuple[Element, dict[str, bytes]]:
    """Returns the task file's tree and its other files, valid against the public schema of version
    4.3.

    Zones of the same rate share a code.

    Raises
    ------
    PrescriptionError : the zones have more than MAX_RATE_LEVELS rates.
    """
    root = make_task_root(from_terminal=False)
    SubElement(root, "VPN", A="VPN1", B="0", C="0.01", D="2", E="kg/ha")
    if data.product:
        SubElement(root, "PDT", A="PDT1", B=clean_task_name(data.product))
    task = Element(
        "TSK",
        A="TSK1",
        B=clean_task_name(data.title) or "prescription",
        G="1",
        # H, I and J name the zones for places outside of all others.
        H=DEFAULT_ZONE_CODE,
        I=LOST_ZONE_CODE,
        J=OUTSIDE_ZONE_CODE,
    )
    if data.fields_deg:
        alone = MapData(zones=tuple(Zone(0.0, rings) for rings in data.fields_deg))
        area_m2 = 10_000.0 * sum(share.area_ha for share in calc_rate_shares(alone))
        field = SubElement(
            root, "PFD", A="PFD1", C=clean_task_name(data.title) or "field", D=str(round(area_m2))
        )
        for rings in data.fields_deg:
            add_polygon_element(field, rings, "1")
        task.set("E", "PFD1")
    files: dict[str, bytes] = {}
    fallbacks = data.fallbacks
    for code, title, rate in (
        (DEFAULT_ZONE_CODE, "default", fallbacks.default_kg_ha),
        (LOST_ZONE_CODE, "position lost", fallbacks.lost_kg_ha),
        (OUTSIDE_ZONE_CODE, "out of field", fallbacks.outside_kg_ha),
    ):
        _add_rate_value(SubElement(task, "TZN", A=code, B=title), rate, data)
    if data.grid is not None:
        files["GRD00001.bin"] = _add_rate_grid(task, data.grid, data)
    else:
        _add_rate_zones(task, data)
    root.append(task)
    return root, files


def _add_rate_zones(task: Element, data: MapData) -> None:
    """Adds a zone for each rate, with the polygons of that rate; of overlapping zones only the
    ground where each applies is written."""
    by_rate: dict[int, list[Zone]] = {}
    for zone in separate_zones(data.zones):
        by_rate.setdefault(round(zone.rate_kg_ha * MG_M2_PER_KG_HA), []).append(zone)
    if len(by_rate) > MAX_RATE_LEVELS:
        raise PrescriptionError(
            "",
            "{count} different rates: allowed {most} in a task file of zones",
            "; .geojson and .shp hold any number",
            count=len(by_rate),
            most=MAX_RATE_LEVELS,
        )
    for code, (steps, zones) in enumerate(by_rate.items(), start=FIRST_RATE_CODE):
        titles = {zone.title for zone in zones}
        title = clean_task_name(titles.pop()) if len(titles) == 1 else ""
        element = SubElement(
            task, "TZN", A=str(code), B=title or f"{steps / MG_M2_PER_KG_HA:g} kg/ha"
        )
        for zone in zones:
            add_polygon_element(element, zone.rings_deg, "2")
        _add_rate_value(element, steps / MG_M2_PER_KG_HA, data)


# The cells hold codes (type 1) if those are sufficient, else rates (type 2).
def _add_rate_grid(task: Element, grid: GridDeg, data: MapData) -> bytes:
    """Adds the grid and its zones, and returns the bytes of its cells."""
    rows, columns = grid.rate_kg_ha.shape
    steps = np.round(grid.rate_kg_ha * MG_M2_PER_KG_HA)
    levels = np.unique(steps[np.isfinite(steps)])
    silent = not np.isfinite(steps).all()
    few = len(levels) + silent <= MAX_RATE_LEVELS
    if few:
        for k, level in enumerate(levels.tolist()):
            zone = SubElement(
                task, "TZN", A=str(FIRST_RATE_CODE + k), B=f"{level / MG_M2_PER_KG_HA:g} kg/ha"
            )
            _add_rate_value(zone, level / MG_M2_PER_KG_HA, data)
        nothing = FIRST_RATE_CODE + len(levels)
        if silent:
            SubElement(task, "TZN", A=str(nothing), B="no rate")
        codes = np.where(
            np.isfinite(steps), FIRST_RATE_CODE + np.searchsorted(levels, steps), nothing
        )
        cells = codes.astype("u1").tobytes()
    else:
        elsewhere = (
            data.fallbacks.default_kg_ha if data.fields_deg else data.fallbacks.outside_kg_ha
        )
        _add_rate_value(SubElement(task, "TZN", A=CELL_ZONE_CODE, B="cell"), 0.0, data)
        cells = (
            np.where(np.isfinite(steps), steps, round(elsewhere * MG_M2_PER_KG_HA))
            .astype("<i4")
            .tobytes()
        )
    grid_element = SubElement(
        task,
        "GRD",
        A=format_degrees(grid.south_deg),
        B=format_degrees(grid.west_deg),
        C=format_cell_degrees(grid.cell_lat_deg),
        D=format_cell_degrees(grid.cell_lon_deg),
        E=str(columns),
        F=str(rows),
        G="GRD00001",
        H=str(len(cells)),
        I="1" if few else "2",
    )
    if not few:
        grid_element.set("J", CELL_ZONE_CODE)
    return cells


def _add_rate_value(zone: Element, rate_kg_ha: float, data: MapData) -> None:
    """Adds a zone's rate as process data (DDI 6)."""
    variable = SubElement(
        zone, "PDV", A="0006", B=str(round(rate_kg_ha * MG_M2_PER_KG_HA)), E="VPN1"
    )
    if data.product:
        variable.set("C", "PDT1")


def write_geojson(data: MapData, path: Path) -> None:
    """Writes GeoJSON, with fallbacks and field as a foreign member. Raises OSError."""
    """Writes GeoJSON, with fallbacks and fields in a foreign member."""
    features = [
        {
            "type": "Feature",
            "properties": {"rate_kg_ha": zone.rate_kg_ha, "title": zone.title},
            "geometry": {
                "type": "Polygon",
                "coordinates": [_close_ring_lon_lat(r) for r in zone.rings_deg],
            },
        }
        for zone in list_map_zones(data)
    ]
    ours = {
        "format": "topdress-prescription/1",
        "product": data.product,
        "fallbacks": data.fallbacks._asdict(),
        "fields": [[_close_ring_lon_lat(ring) for ring in rings] for rings in data.fields_deg],
    }
    write_atomically(
        path,
        json.dumps(
            {
                "type": "FeatureCollection",
                "name": data.title,
                TOPDRESS_MEMBER: ours,
                "features": features,
            },
            ensure_ascii=False,
        ),
    )


def write_map_shapefile(data: MapData, path: Path) -> None:
    """Writes a shapefile of the zones with its companions. Raises OSError."""
    with shapefile.Writer(str(path), shapeType=shapefile.POLYGON, encoding="utf-8") as writer:
        # A dBASE number has 18 digits, 8 of them decimals.
        writer.field("rate_kg_ha", "N", 18, 8)
        writer.field("title", "C", 60)
        for zone in list_map_zones(data):
            writer.poly([[*ring, ring[0]] for ring in _orient_rings(zone.rings_deg)])
            writer.record(zone.rate_kg_ha, zone.title)
    write_atomically(path.with_suffix(".prj"), WGS84_PRJ)
    write_atomically(path.with_suffix(".cpg"), "UTF-8")


def list_map_zones(data: MapData) -> tuple[Zone, ...]:
    """Returns the zones, or a zone for each cell of the grid that has a rate."""
    if data.grid is None:
        return data.zones
    grid = data.grid
    zones = []
    for row, column in np.argwhere(np.isfinite(grid.rate_kg_ha)).tolist():
        south, west = (
            grid.south_deg + row * grid.cell_lat_deg,
            grid.west_deg + column * grid.cell_lon_deg,
        )
        north = grid.south_deg + (row + 1) * grid.cell_lat_deg
        east = grid.west_deg + (column + 1) * grid.cell_lon_deg
        corners = np.array([(south, west), (south, east), (north, east), (north, west)])
        zones.append(Zone(float(grid.rate_kg_ha[row, column]), (corners,)))
    return tuple(zones)


def _close_ring_lon_lat(ring: Floats) -> list[list[float]]:
    return [[lon, lat] for lat, lon in [*ring.tolist(), ring[0].tolist()]]


def _orient_rings(rings: tuple[Floats, ...]) -> list[list[tuple[float, float]]]:
    """Returns rings of longitude and latitude, the outline clockwise and holes counter-clockwise,
    as a shapefile requires."""
    found = []
    for k, corners in enumerate(rings):
        lat, lon = corners[:, 0] - corners[0, 0], corners[:, 1] - corners[0, 1]
        clockwise = float(np.sum(lon * np.roll(lat, -1) - np.roll(lon, -1) * lat)) < 0.0
        ordered = corners if clockwise == (k == 0) else corners[::-1]
        found.append([(lon, lat) for lat, lon in ordered.tolist()])
    return found
