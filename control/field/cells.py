"""What is asked of a cell of the bitmap: whether a stretch passed over it, whether it was done
before.

Each is written once. Over arrays numpy runs it (`coverage`), cell by cell the compiled loops do
(`compiled_cells`); both come to the same bits.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from topdress.control.geodesy import Place

Floats = npt.NDArray[np.float64]
Corners = tuple[Place, Place, Place, Place]

TILE_CELLS = 256  # cells on a side
# a cell centre this far outside still counts, so that touching stretches leave no gap
_EDGE_TOLERANCE_M = 1e-9


def allocate_sides() -> Floats:
    """For the sides of the two triangles of a stretch: (2, 3, 6), see `put_triangle_sides`."""
    return np.empty((2, 3, 6))


def put_triangle_sides(sides: Floats, corners: Corners) -> None:
    """The sides of the two triangles that a stretch is made of.

    corners : of the stretch, around it. sides : (2, 3, 6), written: of each side where it
    begins (east, north, m), its way (east, north, m), on which hand its triangle lies (1: left,
    -1: right), and how far, in m2, a place may lie on the other hand. A triangle without area
    holds no place.
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
    """How far places lie on their hand of a side, times its length, m2; numbers, or arrays that
    go together."""
    return hand * (de * (north - from_north) - dn * (east - from_east))


def is_passed_again(travelled_m: Any, stamp: Any, revisit_m: Any) -> Any:
    """Whether a cell that was covered at `stamp` of the way has been left for long enough to be
    covered again."""
    return travelled_m - stamp > revisit_m


def offset_places(place: float, along_m: Any, way: float, aside_m: Any, side: float) -> Any:
    """East or north, m, of places so far ahead and aside. way, side : that of the course, and
    of what lies aside."""
    return place + along_m * way + aside_m * side
