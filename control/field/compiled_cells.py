"""Compiled loops over the bitmap's cells, for long simulated runs.

Importing this module loads the compiler in a third of a second, so a console that must start
immediately does not use it.
"""

from __future__ import annotations

from math import floor
from typing import Any

import numpy as np
from topdress.control.machine.compiled import compile_function, mark_compilable

from .cell_tests import (
    TILE_CELLS,
    find_side_offset,
    is_passed_again,
    offset_places,
    put_triangle_sides,
)

for _piece in (put_triangle_sides, find_side_offset, is_passed_again, offset_places):
    mark_compilable(_piece)


@mark_compilable
def _is_in_triangle(triangle: Any, east_m: float, north_m: float) -> bool:
    """Tell whether a position is in a triangle (3, 6), edges included."""
    for j in range(3):
        if (
            not find_side_offset(
                triangle[j, 0],
                triangle[j, 1],
                triangle[j, 2],
                triangle[j, 3],
                triangle[j, 4],
                east_m,
                north_m,
            )
            >= triangle[j, 5]
        ):
            return False
    return True


@compile_function
def stamp_tile_cells(
    tile: Any,
    first_row: int,
    first_column: int,
    box: Any,
    cell_m: float,
    corners: Any,
    travelled_m: float,
    revisit_m: float,
) -> tuple[int, int, int]:
    """Mark the cells of a covered stretch in one tile, and return the number of cells, of new
    cells, and of cells done before.

    tile : stamps (TILE, TILE) float32, written. first_row, first_column : its first cell. box :
    cells of the stretch, south, west, north, east. corners : as for `put_triangle_sides`.
    """
    sides = np.empty((2, 3, 6))
    put_triangle_sides(sides, corners)
    stamp, revisit, new, again = np.float32(travelled_m), np.float32(revisit_m), 0, 0
    entered = 0
    for row in range(max(box[0], first_row), min(box[2] + 1, first_row + TILE_CELLS)):
        north_m = (row + 0.5) * cell_m
        for column in range(max(box[1], first_column), min(box[3] + 1, first_column + TILE_CELLS)):
            east_m = (column + 0.5) * cell_m
            if not (
                _is_in_triangle(sides[0], east_m, north_m)
                or _is_in_triangle(sides[1], east_m, north_m)
            ):
                continue
            entered += 1
            before = tile[row - first_row, column - first_column]
            if np.isnan(before):
                new += 1
            elif is_passed_again(stamp, before, revisit):
                again += 1
            tile[row - first_row, column - first_column] = stamp
    return entered, new, again


@compile_function
def count_done_ahead(
    tiles: Any,
    south: int,
    west: int,
    place: Any,
    course: Any,
    along_m: Any,
    aside_m: Any,
    cell_m: float,
    travelled_m: float,
    revisit_m: float,
    earlier: bool,
) -> Any:
    """Count the outlets over done ground at each step ahead: (steps,).

    tiles : stamps of the tiles (south, west), (south, west + 1), (south + 1, west) and (south + 1,
    west + 1), which contain all positions. place, course : of the outlets' middle, east and north.
    earlier : whether only an earlier run counts, otherwise any earlier pass.
    """
    found = np.zeros(len(along_m))
    for step in range(len(along_m)):
        for outlet in range(len(aside_m)):
            east_m = offset_places(place[0], along_m[step], course[0], aside_m[outlet], course[1])
            north_m = offset_places(place[1], along_m[step], course[1], -aside_m[outlet], course[0])
            column, row = (
                floor(east_m / cell_m) - west * TILE_CELLS,
                floor(north_m / cell_m) - south * TILE_CELLS,
            )
            stamp = np.float64(
                tiles[2 * (row // TILE_CELLS) + column // TILE_CELLS][
                    row % TILE_CELLS, column % TILE_CELLS
                ]
            )
            if stamp == -np.inf if earlier else is_passed_again(travelled_m, stamp, revisit_m):
                found[step] += 1.0
    return found
