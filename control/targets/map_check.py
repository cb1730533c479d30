"""Which part of a prescription will not be applied as it stands? Outside the field, above the
crop's limit, or covered twice."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from topdress.control.field.boundary import Boundary
from topdress.control.geodesy import TangentPlane

from .prescription import MIN_GROUND_M2, MapData, find_rated_ground, project_fields

M2_PER_HA = 10_000.0


class MapCheck(NamedTuple):
    """Holds the areas, ha, each place once, and rates of a checked map. None: unknown."""

    # Ground with a rate in the map, ha.
    mapped_ha: float
    # Area of the field, ha.
    field_ha: float | None
    # Mapped ground outside the field, which is not used, ha.
    outside_ha: float
    # Ground of the field without a rate in the map, ha.
    uncovered_ha: float
    # Distance between map and field, m; 0 where they touch, or without a field.
    away_m: float
    # Ground in several zones, where the first in the file applies, ha.
    overlap_ha: float
    # Limit of the crop, kg/ha.
    limit_kg_ha: float | None
    # Ground of the field with a rate above the limit, ha.
    above_ha: float
    # Mass that the limit removes there, kg.
    above_kg: float
    # Highest rate of the map in the field, kg/ha.
    highest_kg_ha: float
    # Rate on mapped ground outside the field, kg/ha; a field edge in the job stops it.
    beyond_kg_ha: float = 0.0
    # Rate in the field where the map has none, kg/ha.
    uncovered_kg_ha: float = 0.0
    # Rate in the field when the map is elsewhere, kg/ha.
    away_kg_ha: float = 0.0
    # Whether the map is elsewhere, but on the field after exchange of latitude and longitude.
    swapped: bool = False


def check_map(
    data: MapData,
    limit_kg_ha: float | None = None,
    field: Boundary | None = None,
    plane: TangentPlane | None = None,
) -> MapCheck:
    """Checks a map against a field and a limit.

    Parameters
    ----------
    data : the map.
    limit_kg_ha : the crop's highest rate.
    field : of the job, on `plane`; None: the map's own fields, if any, on the map's own plane.
    plane : tangent plane of the field.

    Raises
    ------
    ValueError : in one line, where a field's outline of the map is unusable."""
    plane = plane or data.make_plane()
    ground = find_rated_ground(data, plane)
    shape = (
        shapely.union_all([one.shape for one in project_fields(data, plane)])
        if data.fields_deg
        else None
    )
    if field is not None:
        shape = field.shape if shape is None else shapely.intersection(shape, field.shape)
    inside_m2 = ground.areas_m2 if shape is None else ground.calc_areas_inside_m2(shape)
    mapped = float(ground.areas_m2.sum())
    inside = float(inside_m2.sum())
    here = inside_m2 > MIN_GROUND_M2
    above = (
        here & (ground.rates > limit_kg_ha)
        if limit_kg_ha is not None
        else np.zeros(len(here), np.bool_)
    )
    over = ground.rates[above] - (limit_kg_ha or 0.0)
    limit = float("inf") if limit_kg_ha is None else limit_kg_ha
    outside, default = (
        min(limit, data.fallbacks.outside_kg_ha),
        min(limit, data.fallbacks.default_kg_ha),
    )
    away_m = 0.0 if shape is None or here.any() else ground.calc_distance_m(shape)
    return MapCheck(
        mapped / M2_PER_HA,
        None if shape is None else float(shape.area) / M2_PER_HA,
        max(0.0, mapped - inside) / M2_PER_HA,
        0.0 if shape is None else max(0.0, float(shape.area) - inside) / M2_PER_HA,
        away_m,
        ground.overlap_m2 / M2_PER_HA,
        limit_kg_ha,
        float(inside_m2[above].sum()) / M2_PER_HA,
        float((inside_m2[above] * over).sum()) / M2_PER_HA,
        float(ground.rates[here].max()) if here.any() else 0.0,
        0.0 if field is not None else outside,
        default if data.fields_deg else outside,
        outside,
        away_m > 0.0 and field is not None and _is_swapped(data, plane, field),
    )


def _is_swapped(data: MapData, plane: TangentPlane, field: Boundary) -> bool:
    """Returns whether the map lies on the field once latitude and longitude are exchanged."""
    south, west, north, east = data.box_deg
    if max(abs(west), abs(east)) > 90.0:
        return False
    low, high = plane.project_to_m(west, south), plane.project_to_m(east, north)
    return bool(field.shape.intersects(shapely.box(*low, *high)))
