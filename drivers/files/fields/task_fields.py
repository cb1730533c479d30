"""Which fields does an ISO 11783-10 task set contain? It has outlines, obstacles and guidance
lines, and further content is listed.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from topdress.control.recordings.finding import Finding, many
from topdress.drivers.files.fields.field_data import FieldError
from topdress.drivers.files.prescriptions.data_dictionary import describe_ddi
from topdress.drivers.files.prescriptions.task_files import TaskSet, find_task_sets, read_task_tree
from topdress.drivers.files.shape_layers import Layer

# Types of polygons (PLN) of a field (PFD) of ISO 11783-10.
OUTLINE_TYPE, OBSTACLE_TYPES, HEADLAND_TYPE = "1", ("3", "4", "5", "6"), "10"
# Types of lines (LSG) of ISO 11783-10.
EXTERIOR_LINE, INTERIOR_LINE, GUIDANCE_LINE = "1", "2", "5"


def read_task_layers(path: Path) -> list[Layer]:
    """Returns the fields of the task set at a path as a layer; none without a task set. Raises
    FieldError, also for several task sets, RefusedInput, OSError."""
    found = find_task_sets(path)
    # The choice would decide about a field, so it is left to the user.
    if len(found) > 1:
        names = ", ".join(one.label for one in found[:12])
        raise FieldError(f"{path}: {len(found)} task sets: allowed is one, of {names}")
    return [_read_task_layer(one) for one in found]


def _read_task_layer(files: TaskSet) -> Layer:
    """Returns names and shapes in longitude and latitude, and findings about the set's contents."""
    root = read_task_tree(files)
    findings = [Finding("task_set", _describe_task_set(root))]
    shapes: list[tuple[str, shapely.Geometry]] = []
    for field in root.findall("PFD"):
        # Designators are optional in ISO 11783-10, ids are not.
        title = field.get("C") or field.get("A") or ""
        where = f"{files.label}: field {title}"
        for polygon in field.findall("PLN"):
            if polygon.get("A") == OUTLINE_TYPE:
                shapes += [(title, one) for one in _build_polygons(polygon, where)]
            elif polygon.get("A") in OBSTACLE_TYPES:
                # Obstacles are distinguished by their name in the job.
                name = polygon.get("B") or "obstacle"
                shapes += [(name, one) for one in _build_polygons(polygon, where)]
        if any(one.get("A") == HEADLAND_TYPE for one in field.findall("PLN")):
            text = f"headland of {title} not taken: a job has one width: say headland_m in it"
            findings.append(Finding("headland", text))
        # Version 4 groups guidance lines into patterns; version 3 lists them directly.
        patterns = [(one.get("B", ""), one) for one in field.iter("GPN")]
        for called, parent in [*patterns, ("", field)]:
            for line in parent.findall("LSG"):
                if line.get("A") == GUIDANCE_LINE:
                    # A guidance line needs two points.
                    places = _parse_places_deg(line, where, 2)
                    shapes.append((called or line.get("B", ""), shapely.LineString(places)))
    if not shapes:
        raise FieldError(f"{files.label}: no outline of a field in it: {findings[0]}")
    rows = tuple({"name": title} for title, _ in shapes)
    return Layer("", rows, np.array([shape for _, shape in shapes], object), tuple(findings))


def _build_polygons(polygon: Element, where: str) -> list[shapely.Geometry]:
    """Returns the polygons (longitude, latitude) of a PLN, each with its holes."""
    rings = {
        kind: [
            _parse_places_deg(one, where, 3)
            for one in polygon.findall("LSG")
            if one.get("A") == kind
        ]
        for kind in (EXTERIOR_LINE, INTERIOR_LINE)
    }
    holes = [shapely.Polygon(ring) for ring in rings[INTERIOR_LINE]]
    outlines = [shapely.Polygon(ring) for ring in rings[EXTERIOR_LINE]]
    return [
        shapely.Polygon(
            outline.exterior,
            # A point inside of the hole decides, because its corners may touch the outline.
            [hole.exterior for hole in holes if outline.contains(hole.representative_point())],
        )
        for outline in outlines
    ]


def _parse_places_deg(line: Element, where: str, least: int) -> np.ndarray:
    """Returns points (n, 2), longitude and latitude."""
    points = line.findall("PNT")
    # Points in a binary file are an option of version 4 that hardly any program uses.
    if any(point.get("J") for point in points):
        raise FieldError(f"{where}: points in a binary file: allowed are points in the XML")
    try:
        found = np.array([(float(one.get("D", "")), float(one.get("C", ""))) for one in points])
    except ValueError:
        raise FieldError(f"{where}: a point without C and D: allowed are degrees") from None
    if len(found) < least:
        raise FieldError(f"{where}: a line of {len(found)} points: allowed {least} or more")
    # Attributes C and D are latitude and longitude, so exchanged values exceed 90 degrees.
    if not (np.isfinite(found).all() and (np.abs(found) <= (180.0, 90.0)).all()):
        raise FieldError(f"{where}: a point beyond 90 or 180: allowed are degrees")
    return found


def _describe_task_set(root: Element) -> str:
    """Returns the contents of a task set in one sentence."""
    maker = root.get("ManagementSoftwareManufacturer") or "a maker that it does not name"
    counts = [
        (len(root.findall("PFD")), "field"),
        (len(root.findall("TSK")), "task"),
        (len(root.findall("PDT")), "product"),
    ]
    # Kinds of content that the set does not have are omitted.
    held = [many(count, what) for count, what in counts if count]
    zones = {
        int(one.get("A", ""), 16)
        for one in root.findall("TSK/TZN/PDV")
        # Only hexadecimal text can be an identifier.
        if one.get("A", "").isalnum() and set(one.get("A", "").lower()) <= set("0123456789abcdef")
    }
    if zones:
        held.append(f"maps of {', '.join(map(describe_ddi, sorted(zones)))} (topdress map)")
    logs = len(root.findall("TSK/TLG"))
    if logs:
        held.append(f"{many(logs, 'log')} of work (topdress import)")
    return f"task set of {maker}: {', '.join(held) or 'nothing'}"
