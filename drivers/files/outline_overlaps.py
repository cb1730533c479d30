"""How often do a map's outlines overlap or cross? The count comes before their repair, which may
take minutes for a few bytes.

The count is made in pieces and stops at the limit. Pairs of edges are searched by their extents
first (an STR tree).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from topdress.control.targets.rate_map import (
    Floats,
    are_self_crossing,
    make_polygons,
    make_polygons_as_drawn,
)
from topdress.drivers.files.limits import (
    CROSSINGS_LIMIT,
    NEAR_EDGES_LIMIT,
    OVERLAPS_LIMIT,
    SHARED_CROSSINGS_LIMIT,
    TOUCHES_LIMIT,
    check_limit,
)
from topdress.drivers.plain_text import PlaceInFile

# Number of corners of a large outline; the edges of a smaller outline make no more pairs than the
# limit.
LARGE_CORNERS = 500
# Number of corners of small zones, of which two cross at most 400 times.
SMALL_ZONE_CORNERS = 20
# Where an outline returns to one of its corners, two of its edges meet two others.
PAIRS_PER_CORNER = 4
# A corner may lie off its neighbour's edge by rounding; the edges on both of its sides then cross
# that edge.
CROSSINGS_PER_CORNER = 2
# Predicates of GEOS by which zones overlap.
OVERLAP_PREDICATES = ("overlaps", "contains", "within")
# Share of the smaller of two zones below which an intersection is no overlap: corners rounded to 1
# cm, in cells of 10 m.
SLIVER_AREA_SHARE = 1e-3
# Number of zones compared with all others at once, and of pairs.
MAX_ZONE_STEP, PAIRS_AT_ONCE = 64, 100_000
# Number of pairs of extents at once (8 MB), and smallest number of shapes at once (100 MB against
# 400 000 others).
EXTENTS_AT_ONCE, MIN_SHAPE_STEP = 500_000, 16


def check_zones(zones: Sequence[Sequence[Floats]], label: PlaceInFile | Path | str) -> int:
    """Counts zones that overlap and outlines that cross themselves.

    Parameters
    ----------
    zones : for each zone its outline and holes, (k, 2).
    label : the map, for messages.

    Returns
    -------
    the number of zones that cross themselves.

    Raises
    ------
    BeyondLimits : the map has more crossings than can be repaired.
    """
    crossed = check_outlines(zones, label)
    shapes = make_polygons(zones)
    low, high = np.split(shapely.bounds(shapes), 2, axis=1)
    less = 0.5 * SLIVER_AREA_SHARE * (high - low)
    extents = shapely.box(*(low + less).T, *(high - less).T)
    _check_shared_crossings(zones, label)
    if _count_meeting_extents(extents, OVERLAPS_LIMIT.most) <= OVERLAPS_LIMIT.most:
        # Neighbouring cells of a grid only touch.
        return crossed
    areas, tree, found = shapely.area(shapes), shapely.STRtree(shapes), 0
    step = max(1, min(MAX_ZONE_STEP, PAIRS_AT_ONCE // len(shapes)))
    for begin in range(0, len(shapes), step):
        asked = shapes[begin : begin + step]
        later, earlier = np.concatenate(
            [tree.query(asked, predicate=how) for how in OVERLAP_PREDICATES], axis=1
        )
        later += begin
        later, earlier = later[later > earlier], earlier[later > earlier]
        shared = shapely.area(shapely.intersection(shapes[later], shapes[earlier]))
        found += int((shared > SLIVER_AREA_SHARE * np.minimum(areas[later], areas[earlier])).sum())
        check_limit(OVERLAPS_LIMIT, found, label)
    return crossed


def check_outlines(zones: Sequence[Sequence[Floats]], label: PlaceInFile | Path | str) -> int:
    """Counts outlines that cross themselves.

    An outline that only touches itself does not cross itself; zones made from a raster touch at
    their corners.

    Parameters
    ----------
    zones : for each zone its outline and holes, (k, 2).
    label : the map, for messages.

    Returns
    -------
    the number of zones that cross themselves.

    Raises
    ------
    BeyondLimits : the map has more crossings than can be repaired.
    """
    shapes = make_polygons_as_drawn(zones)
    wrong = np.flatnonzero(~shapely.is_valid(shapes)).tolist()
    large = [k for k, zone in enumerate(zones) if sum(map(len, zone)) > LARGE_CORNERS]
    near = crossings = crossed = 0
    for k in sorted({*large, *wrong}):
        near += _count_near_pairs(zones[k], NEAR_EDGES_LIMIT.most - near)
        check_limit(NEAR_EDGES_LIMIT, near, label)
    for k in wrong:
        met, through = _count_meetings(zones[k])
        check_limit(CROSSINGS_LIMIT, crossings + through, label)
        check_limit(TOUCHES_LIMIT, (met - through) // PAIRS_PER_CORNER, label)
        if are_self_crossing(shapes[k : k + 1])[0]:
            crossed += 1
            crossings += through + (met - through) // PAIRS_PER_CORNER
            check_limit(CROSSINGS_LIMIT, crossings, label)
    return crossed


def _check_shared_crossings(
    zones: Sequence[Sequence[Floats]], label: PlaceInFile | Path | str
) -> None:
    """Refuses zones whose outlines cross each other too often, because two outlines of a few
    hundred corners can cross a hundred thousand times. `OVERLAPS_LIMIT` limits zones with few
    corners. Raises BeyondLimits."""
    large = [zone for zone in zones if sum(map(len, zone)) > SMALL_ZONE_CORNERS]
    if len(large) < 2:
        return
    ends = np.concatenate([_list_edge_ends(zone) for zone in large])
    edges = shapely.linestrings(ends)
    owner = np.repeat(np.arange(len(large)), [sum(map(len, zone)) for zone in large])
    tree, found, step = (
        shapely.STRtree(edges),
        0,
        max(MIN_SHAPE_STEP, EXTENTS_AT_ONCE // len(edges)),
    )
    for begin in range(0, len(edges), step):
        asked, met = tree.query(edges[begin : begin + step])
        asked += begin
        # Each pair is found from both of its sides.
        once = owner[asked] < owner[met]
        found += int(_are_crossing(ends[asked[once]], ends[met[once]]).sum())
        # Zones with a common border cross at its corners by rounding alone.
        check_limit(SHARED_CROSSINGS_LIMIT, found - CROSSINGS_PER_CORNER * len(edges), label)


def _are_crossing(one: Floats, other: Floats) -> np.ndarray:
    """Returns which edges (n, 2, 2) cross others (n, 2, 2), each between the ends of the other."""

    def turns(edge: Floats, point: Floats) -> Floats:
        way, to = edge[:, 1] - edge[:, 0], point - edge[:, 0]
        side: Floats = np.sign(way[:, 0] * to[:, 1] - way[:, 1] * to[:, 0])
        return side

    apart: np.ndarray = (turns(one, other[:, 0]) * turns(one, other[:, 1]) < 0.0) & (
        turns(other, one[:, 0]) * turns(other, one[:, 1]) < 0.0
    )
    return apart


def _list_edge_ends(zone: Sequence[Floats]) -> Floats:
    """Returns both ends (n, 2, 2) of each edge of a zone's closed rings."""
    return np.concatenate([np.stack((ring, np.roll(ring, -1, axis=0)), axis=1) for ring in zone])


def _count_near_pairs(zone: Sequence[Floats], most: int) -> int:
    """Returns the number of pairs of a zone's edges whose extents meet, except neighbours; the
    count stops soon after `most`."""
    return _count_meeting_extents(shapely.linestrings(_list_edge_ends(zone)), most, followers=2)


def _count_meetings(zone: Sequence[Floats]) -> tuple[int, int]:
    """Returns the number of pairs of a zone's edges that meet, except neighbours, and the number of
    pairs that cross."""
    ends = _list_edge_ends(zone)
    edges = shapely.linestrings(ends)
    one, other = shapely.STRtree(edges).query(edges, predicate="intersects")
    once = one < other
    through = int(_are_crossing(ends[one[once]], ends[other[once]]).sum())
    return max(0, int(once.sum()) - len(edges)), through


def _count_meeting_extents(shapes: np.ndarray, most: int, followers: int = 0) -> int:
    """Returns the number of pairs whose extents meet. For each shape, the shape itself and the next
    `followers` shapes are skipped."""
    tree, found = shapely.STRtree(shapes), 0
    step = max(MIN_SHAPE_STEP, EXTENTS_AT_ONCE // len(shapes))
    for begin in range(0, len(shapes), step):
        asked = shapes[begin : begin + step]
        found += len(tree.query(asked)[0]) - (1 + followers) * len(asked)
        if found > 2 * most:
            break
    return max(0, found) // 2
