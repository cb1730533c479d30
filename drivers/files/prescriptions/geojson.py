"""GeoJSON (RFC 7946): polygons with a rate, in and out. Our own also carry fallbacks and the field."""
from __future__ import annotations

from pathlib import Path
from typing import Any

from control.targets.prescription import NO_FALLBACKS, Fallbacks
from control.targets.rate_map import Floats
from drivers.files.layers import read_geojson
from drivers.files.prescriptions.features import ring
from drivers.files.prescriptions.shapes import POLYGONS, of_layer
from drivers.files.prescriptions.words import Imported, PrescriptionError, RateChoice, checked_rate
from drivers.plain_text import PlaceInFile

OURS = "topdress"            # foreign member with what GeoJSON has no place for


def read_map(path: Path, choice: RateChoice) -> Imported:
    """A prescription out of a FeatureCollection of (multi)polygons. Raises Refused, OSError."""
    layer = read_geojson(path, POLYGONS, strict=True)
    ours = layer.about.get(OURS)
    fallbacks, fields = _ours(ours, path) if isinstance(ours, dict) else (NO_FALLBACKS, ())
    return of_layer(path, "geojson", layer, choice, fallbacks=fallbacks, fields_deg=fields, title=layer.name,
                    product=str(ours.get("product", "")) if isinstance(ours, dict) else "")


def _ours(ours: dict[str, Any], path: Path) -> tuple[Fallbacks, tuple[tuple[Floats, ...], ...]]:
    values = ours.get("fallbacks") or {}
    try:
        fallbacks = Fallbacks(**{name: float(value) for name, value in values.items()})
        fields = tuple(tuple(ring(corners) for corners in rings) for rings in ours.get("fields") or ())
    except (TypeError, ValueError) as error:
        raise PrescriptionError(path, "{member}: {why}", member=OURS, why=error) from None
    for name, value in fallbacks._asdict().items():
        checked_rate(value, lambda name=name: PlaceInFile(str(path)).at("{key}", key=f"{OURS}: {name}"))  # type: ignore[misc]
    return fallbacks, fields
