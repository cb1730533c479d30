"""Rings to polygons: which hole lies in which outline."""
from __future__ import annotations

from collections.abc import Sequence

import shapely

from control.targets.rate_map import Floats


def sorted_rings(outlines: Sequence[Floats], holes: Sequence[Floats]) -> list[tuple[Floats, ...]]:
    """Each outline with the holes that lie in it; holes that lie in none are left out."""
    if len(outlines) == 1 or not holes:
        return [(outline, *(holes if len(outlines) == 1 else ())) for outline in outlines]
    polygons = [shapely.make_valid(shapely.Polygon(outline)) for outline in outlines]
    inside: list[list[Floats]] = [[] for _ in outlines]
    for hole in holes:
        place = shapely.Polygon(hole).representative_point()
        for k, polygon in enumerate(polygons):
            if shapely.contains(polygon, place):
                inside[k].append(hole)
                break
    return [(outline, *inside[k]) for k, outline in enumerate(outlines)]
