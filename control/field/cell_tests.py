"""Defines the tests of a cell of the bitmap: whether a stretch covers the cell, and whether the
cell was done before.

Each test is written once. numpy runs it over arrays (`coverage`), compiled loops run it cell by
cell (`compiled_cells`); both give identical bits.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from topdress.control.geodesy import Place

Floats = npt.NDArray[np.float64]
Corners = tuple[Place, Place, Place, Place]

# Number of cells on a side of a tile.
TILE_CELLS = 256
# Distance outside a stretch, m, at which a cell centre still counts, so that adjacent stretches
# leave no gap.
_EDGE_TOLERANCE_M = 1e-9


def allocate_sides() -> Floats:
    """Allocate the sides of the two triangles of a stretch: (2, 3, 6), see `put_triangle_sides`."""
    return np.empty((2, 3, 6))


def put_triangle_sides(sides: Floats, corners: Corners) -> None:
    """Write the sides of the two triangles of a stretch.

    corners : of the stretch, in order around it. sides : (2, 3, 6), written: for each side its
    start (east, north, m), its vector (east, north, m), the hand on which its triangle is (1: left,
    -1: right), and a tolerance for positions on the other hand, m2. A triangle without area
    contains no position.
    """
    for k in range(2):
        triangle = (corners[0], corners[k + 1], corners[k + 2])
        a, b, c = triangle
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        for j in range(3):
            one, other = triangle[j], triangle[(j + 1) % 3]
            de, dn = other[0] - one[0], other[1] - one[1]
            sides[k, j, 0] = one[0]
            sides[k, j, 1] = one[1]
            sides[k, j, 2] = de
            sides[k, j, 3] = dn
            sides[k, j, 4] = math.copysign(1.0, area)
            sides[k, j, 5] = (
                -_EDGE_TOLERANCE_M * (abs(de) + abs(dn)) if abs(area) > 1e-12 else math.inf
            )


def find_side_offset(
    from_east: Any, from_north: Any, de: Any, dn: Any, hand: Any, east: Any, north: Any
) -> Any:
    """Return the distance of positions from a side, on the triangle's hand, times the length of
    the side, m2; for numbers or arrays."""
    return hand * (de * (north - from_north) - dn * (east - from_east))


def is_passed_again(travelled_m: Any, stamp: Any, revisit_m: Any) -> Any:
    """Return whether driving over a cell now is a second pass: since the cell was covered, at path
    length `stamp`, the machine has travelled more than `revisit_m`."""
    return travelled_m - stamp > revisit_m


def offset_places(place: float, along_m: Any, way: float, aside_m: Any, side: float) -> Any:
    """Return east or north, m, of positions at distances ahead and aside. way, side : the
    component of the course, and of the lateral direction."""
    return place + along_m * way + aside_m * side
