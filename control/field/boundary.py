"""Defines the field's edge: whether a position is inside, and the distance to the edge along the
machine's heading.

All calculations use vectors, so that a line due north is no special case (paper B, eq 4 and 5 use
slopes, and fail there).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import MultiPolygon, Polygon
from topdress.control.geodesy import Place, find_unit_vector

Floats = npt.NDArray[np.float64]

# Minimum margin, m: thinner margins are lost in the rounding of polygons.
_MIN_MARGIN_M = 0.001
# Number of corners up to which plain Python is faster than numpy's calls.
_MAX_PLAIN_PYTHON_CORNERS = 24


class Boundary:
    """A field's edge on its tangent plane, m: one outline, with or without holes; immutable.

    outline, holes: rings of at least three positions (east_m, north_m), in either direction, closed
    automatically. Raises ValueError in one line for a ring that is too short, a position that is
    not finite, crossing edges, or a hole outside the outline.
    """

    def __init__(self, outline: Sequence[Place], holes: Sequence[Sequence[Place]] = ()) -> None:
        named = {"outline": outline, **{f"hole {k}": hole for k, hole in enumerate(holes, start=1)}}
        rings = [_validate_ring(name, ring) for name, ring in named.items()]
        shape = Polygon(rings[0], rings[1:])
        if not shape.is_valid:
            raise ValueError(
                f"holes: {shapely.is_valid_reason(shape)}; each must lie inside the "
                "outline, and apart"
            )
        self._set_shape(MultiPolygon([shape]))

    def _set_shape(self, shape: MultiPolygon) -> None:
        shapely.prepare(shape)
        self.shape = shape
        rings = [
            np.asarray(ring.coords)[:-1]
            for part in shape.geoms
            for ring in (part.exterior, *part.interiors)
        ]
        corners = np.concatenate(rings) if rings else np.zeros((0, 2))
        self._east: Floats = corners[:, 0].copy()
        self._north: Floats = corners[:, 1].copy()
        self._next = _index_next_corners([len(ring) for ring in rings])
        self._few = (
            list(zip(self._east.tolist(), self._north.tolist(), self._next.tolist(), strict=True))
            if len(self._next) <= _MAX_PLAIN_PYTHON_CORNERS
            else []
        )

    @property
    def area_ha(self) -> float:
        return float(self.shape.area) / 10_000.0

    @property
    def is_empty(self) -> bool:
        """Whether nothing is left; possible only after an inset larger than the field."""
        return bool(self.shape.is_empty)

    @property
    def rings(self) -> tuple[tuple[Place, ...], ...]:
        """Corners of the outline and of the holes, not closed, for drawing."""
        return tuple(
            tuple((float(east), float(north)) for east, north in ring.coords[:-1])
            for part in self.shape.geoms
            for ring in (part.exterior, *part.interiors)
        )

    def contains_place(self, east_m: float, north_m: float) -> bool:
        """Tell whether a position is inside or on the edge; False for a position that is not
        finite. The call takes about 3 us."""
        return bool(shapely.intersects_xy(self.shape, east_m, north_m))

    def calc_distance_m(self, place: Place) -> float:
        """Return the distance from a position to the field, m; 0 inside."""
        return float(shapely.distance(self.shape, shapely.Point(place)))

    def contains_places(self, places: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Tell which positions (n, 2) are inside, as `contains_place` does: (n,)."""
        points = np.asarray(places, dtype=np.float64).reshape(-1, 2)
        return np.asarray(
            shapely.intersects_xy(self.shape, points[:, 0], points[:, 1]), dtype=np.bool_
        )

    def find_crossings_m(
        self, east_m: float, north_m: float, heading_deg: float, farthest_m: float = math.inf
    ) -> list[float]:
        """Return the distances ahead, increasing, at which a straight line from this position
        crosses the edge, up to `farthest_m`.

        Each corner is assigned to one side of the line, once for both its edges, and an edge is
        crossed when its corners are on different sides. So a line through a corner crosses once
        where it passes from inside to outside, and twice or not at all where it only touches; a
        line along an edge does not cross the edge. The result is empty where the position or the
        heading is not finite. The call takes 2 us for four corners, 15 us for many.
        """
        if not (math.isfinite(east_m) and math.isfinite(north_m) and math.isfinite(heading_deg)):
            return []
        crossed = self._cross_few_edges if self._few else self._cross_many_edges
        ahead = [
            along + side / (side - next_side) * (next_along - along)
            for side, along, next_side, next_along in crossed(
                east_m, north_m, *find_unit_vector(heading_deg)
            )
        ]
        return sorted([distance for distance in ahead if 0.0 < distance <= farthest_m])

    def _cross_few_edges(
        self, east_m: float, north_m: float, east: float, north: float
    ) -> list[tuple[float, float, float, float]]:
        """Return the edges that a line through a position in the direction (east, north)
        crosses: lateral and longitudinal distance of both corners."""
        seen = [
            (
                east * (n - north_m) - north * (e - east_m),
                north * (n - north_m) + east * (e - east_m),
                following,
            )
            for e, n, following in self._few
        ]
        return [
            (side, along, *seen[following][:2])
            for side, along, following in seen
            if (side > 0.0) is not (seen[following][0] > 0.0)
        ]

    def _cross_many_edges(
        self, east_m: float, north_m: float, east: float, north: float
    ) -> list[tuple[float, float, float, float]]:
        de, dn = self._east - east_m, self._north - north_m
        side, along = east * dn - north * de, north * dn + east * de
        left = side > 0.0
        start = np.flatnonzero(left != left[self._next])
        end = self._next[start]
        return list(
            zip(
                side[start].tolist(),
                along[start].tolist(),
                side[end].tolist(),
                along[end].tolist(),
                strict=True,
            )
        )

    def subtract_strips(self, strips: Sequence[tuple[Sequence[Place], float]]) -> Boundary:
        """Return the field without all ground nearer to a line of positions than its distance;
        the result may be empty or consist of several parts."""
        near = shapely.union_all(
            [shapely.buffer(shapely.LineString(line), margin_m) for line, margin_m in strips]
        )
        smaller = Boundary.__new__(Boundary)
        smaller._set_shape(_collect_polygons(shapely.difference(self.shape, near)))
        return smaller

    def inset_margin(self, margin_m: float) -> Boundary:
        """Return the field without a margin along every edge and hole (the headland); the result
        may be empty or consist of several parts.

        A margin below 1 mm is ignored. Raises ValueError for a negative margin.
        """
        if not margin_m >= 0.0:
            raise ValueError(f"headland {margin_m:g} m: allowed is 0 or more")
        smaller = Boundary.__new__(Boundary)
        shrunk = (
            self.shape.buffer(-margin_m, join_style="mitre")
            if margin_m >= _MIN_MARGIN_M
            else self.shape
        )
        smaller._set_shape(_collect_polygons(shrunk))
        return smaller


def find_largest_part(shape: Polygon) -> Polygon:
    """Return the largest polygon of those into which crossing edges divide a shape; ground
    inside two loops counts once."""
    parts = shapely.get_parts(shapely.make_valid(shape, method="structure", keep_collapsed=False))
    return max(
        (one for one in parts if isinstance(one, Polygon)),
        key=lambda one: float(one.area),
        default=Polygon(),
    )


def _validate_ring(name: str, ring: Sequence[Place]) -> list[Place]:
    places = [(float(east), float(north)) for east, north in ring]
    if len(places) > 1 and places[0] == places[-1]:
        places = places[:-1]
    for k, place in enumerate(places, start=1):
        if not all(map(math.isfinite, place)):
            raise ValueError(f"{name}, corner {k}: {place} is not a place")
    if len(places) < 3:
        raise ValueError(f"{name}: {len(places)} corners; allowed is 3 or more")
    shape = Polygon(places)
    if not shape.is_valid or shape.area == 0.0:
        raise ValueError(
            f"{name}: {shapely.is_valid_reason(shape) if not shape.is_valid else 'no area'}; "
            "the edges must enclose an area and not cross"
        )
    return places


def _index_next_corners(lengths: Sequence[int]) -> npt.NDArray[np.intp]:
    """Return the index of the next corner of each corner, within its ring, for concatenated
    rings of these lengths."""
    following: list[int] = []
    for length in lengths:
        first = len(following)
        following.extend(first + (k + 1) % length for k in range(length))
    return np.array(following, dtype=np.intp)


def _collect_polygons(shape: shapely.Geometry) -> MultiPolygon:
    parts = shape.geoms if isinstance(shape, MultiPolygon) else [shape]
    return MultiPolygon([part for part in parts if isinstance(part, Polygon) and not part.is_empty])
