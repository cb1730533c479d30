"""GeoJSON (RFC 7946): polygons with a rate, in and out. Our own also carry fallbacks and the field."""
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from control.recordings.finding import Finding, many
from control.targets.prescription import NO_FALLBACKS, Fallbacks
from control.targets.rate_map import Floats
from drivers.files.limits import read_json
from drivers.files.prescriptions.features import Feature, imported, ring
from drivers.files.prescriptions.words import Choice, Imported, NotAMap, PrescriptionError, checked_rate
from drivers.files.stated_units import of_json
from drivers.plain_text import Where

OURS = "topdress"            # foreign member with what GeoJSON has no place for
WGS84 = ("crs84", "4326")


def read_geojson(path: Path, choice: Choice) -> Imported:
    """A prescription out of a FeatureCollection of (multi)polygons. Raises PrescriptionError, OSError."""
    try:
        root = read_json(path)
    except ValueError as error:
        raise NotAMap(path, "not readable as JSON: {why}", why=error) from None
    found = root.get("features") if isinstance(root, dict) and root.get("type") == "FeatureCollection" else None
    if not isinstance(found, list):
        raise NotAMap(path, "type {kind}: allowed FeatureCollection",
                      kind=root.get("type") if isinstance(root, dict) else type(root).__name__)
    crs = json.dumps(root.get("crs") or "crs84").lower()
    if not any(name in crs for name in WGS84):
        raise PrescriptionError(path, "crs {crs}: allowed is WGS84 (longitude, latitude)", crs=crs)
    findings: list[Finding] = []
    features: list[Feature] = []
    others = 0
    for number, feature in enumerate(found, start=1):
        polygons = _polygons(feature, Where(str(path)).at("feature {feature}", feature=number))
        if polygons is None:
            others += 1
            continue
        features.append(Feature(number, _properties(feature), polygons))
    if others:
        text = f"{many(others, 'feature')} that are no polygons left out"
        findings.append(Finding("not_polygons", text, rows=others))
    ours = root.get(OURS)
    units = of_json({key: value for key, value in root.items() if key != "features"},
                    {name for feature in features for name in feature.attributes}, path.name)
    fallbacks, fields = _ours(ours, path) if isinstance(ours, dict) else (NO_FALLBACKS, ())
    return imported(path, "geojson", features, choice, findings, fallbacks=fallbacks, fields_deg=fields,
                    title=str(root.get("name", "")), units=units,
                    product=str(ours.get("product", "")) if isinstance(ours, dict) else "")


def _properties(feature: dict[str, Any]) -> dict[str, Any]:
    """What it tells along with its shape; nothing where that is no record."""
    stated = feature.get("properties")
    return stated if isinstance(stated, dict) else {}


def _polygons(feature: Any, where: Where) -> list[tuple[Floats, ...]] | None:
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    if not isinstance(geometry, dict):
        return None
    kind = geometry.get("type")
    if kind not in ("Polygon", "MultiPolygon"):
        return None
    try:
        parts = [geometry["coordinates"]] if kind == "Polygon" else geometry["coordinates"]
        polygons = [tuple(ring(corners) for corners in part) for part in parts]
    except (ArithmeticError, TypeError, ValueError, LookupError):
        raise PrescriptionError(where, "coordinates are not rings of numbers: allowed [[[lon, lat], ...]]") from None
    for rings in polygons:
        if not rings or any(len(corners) < 3 for corners in rings):
            raise PrescriptionError(where, "a ring of less than 3 corners: allowed 3 or more")
    return polygons


def _ours(ours: dict[str, Any], path: Path) -> tuple[Fallbacks, tuple[tuple[Floats, ...], ...]]:
    values = ours.get("fallbacks") or {}
    try:
        fallbacks = Fallbacks(**{name: float(value) for name, value in values.items()})
        fields = tuple(tuple(ring(corners) for corners in rings) for rings in ours.get("fields") or ())
    except (TypeError, ValueError) as error:
        raise PrescriptionError(path, "{member}: {why}", member=OURS, why=error) from None
    for name, value in fallbacks._asdict().items():
        checked_rate(value, lambda name=name: Where(str(path)).at("{key}", key=f"{OURS}: {name}"))  # type: ignore[misc]
    return fallbacks, fields
