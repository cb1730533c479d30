"""Maps in GeoJSON as a test writes them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def feature(coordinates: Any, kind: str = "Polygon", /, **properties: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def collection(*features: dict[str, Any], **more: Any) -> str:
    return json.dumps({"type": "FeatureCollection", "features": features, **more})


def geojson(path: Path, *features: dict[str, Any], **more: Any) -> Path:
    path.write_text(collection(*features, **more), encoding="utf-8")
    return path
