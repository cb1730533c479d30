"""How does a driven boundary become the field of a job? It is placed on the job's plane and
simplified.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from topdress.control.field.job import Ground

# Distance of a corner to the straight line between its neighbours below which it is removed, m.
MIN_CORNER_OFFSET_M = 0.1
# Distance from the job's origin beyond which a field gets a plane of its own, m.
MAX_PLANE_DISTANCE_M = 20_000.0


def make_driven_field(
    ground: Ground, ring_deg: tuple[tuple[float, float], ...]
) -> tuple[Ground, float]:
    """Returns the job's field with this edge, and its area, ha.

    `ring_deg` is (lat, lon), not closed. Raises ValueError in one line for too few corners or
    crossing edges.
    """
    from shapely.geometry import Polygon
    from topdress.control.field.boundary import Boundary, find_largest_part
    from topdress.control.geodesy import TangentPlane, calc_ellipsoid_distance_m

    if len(ring_deg) < 3:
        raise ValueError(f"boundary: {len(ring_deg)} corners: allowed is 3 or more")
    origin = ground.origin_lat_deg, ground.origin_lon_deg
    if calc_ellipsoid_distance_m(*origin, *ring_deg[0]) > MAX_PLANE_DISTANCE_M:
        origin = ring_deg[0]
    plane = TangentPlane(*origin)
    # Where the end of the drive crosses its beginning, the enclosed area counts.
    thinned = find_largest_part(
        Polygon([plane.project_to_m(lat, lon) for lat, lon in ring_deg])
    ).simplify(MIN_CORNER_OFFSET_M)
    if thinned.is_empty or thinned.area <= 0.0:
        raise ValueError("boundary: nothing is enclosed by it: allowed is a way round a field")
    corners = tuple(
        (round(east, 2), round(north, 2)) for east, north in thinned.exterior.coords[:-1]
    )
    area_ha = Boundary(corners).area_ha
    return ground.model_copy(
        update={
            "boundary_m": corners,
            "origin_lat_deg": origin[0],
            "origin_lon_deg": origin[1],
            "title": ground.title or "driven",
        }
    ), area_ha
