"""A package that adds a canopy head, a receiver, a file format and an effect to topdress."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from topdress.control.readings import GnssFix
from topdress.drivers.devices.canopy_heads import HeadFields
from topdress.drivers.devices.lines import LineDecoder
from topdress.drivers.plugins import EffectPlugin

HEAD = HeadFields(fields=2, ndvi=2)
FAST = EffectPlugin(
    "Flutes fill less when it goes fast",
    "flow_percent bend speed_mps bend={size} at=1.2",
    "drive slower",
)


class PlainFix(LineDecoder[GnssFix]):
    """Lines `LAT LON`, in degrees."""

    def _line(self, line: bytes, time_s: float) -> list[GnssFix]:
        try:
            lat_deg, lon_deg = map(float, line.split())
        except ValueError:
            self.counts.reject("not_a_place")
            return []
        self.counts.accept()
        return [GnssFix(time_s, lat_deg, lon_deg, fix_quality=1)]


def squares(path: Path) -> dict[str, Any]:
    """Lines `LON LAT DEGREES RATE`: the south-west corner of a square, its side, kg/ha."""
    features = []
    for text in path.read_text(encoding="utf-8").splitlines():
        x, y, side, rate = map(float, text.split())
        ring = [[x, y], [x + side, y], [x + side, y + side], [x, y + side], [x, y]]
        features.append(
            {
                "type": "Feature",
                "properties": {"rate_kg_ha": rate},
                "geometry": {"type": "Polygon", "coordinates": [ring]},
            }
        )
    return {"type": "FeatureCollection", "features": features}
