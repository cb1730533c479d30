"""Is the lag paper's geometry on the prescription map right? Eq 2 (index of a cell) and eq 4 and
5 (intersection of a line and an edge).
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, cos, floor, hypot, radians, sin

from topdress.control.geodesy import TangentPlane

from .page import Table

# Longitude X and latitude Y, degrees, as in the paper.
Point = tuple[float, float]
# Cell size of the paper's field, m.
CELL_M = 10.0
# Latitude and longitude of a place near Beijing, degrees.
PLACE_DEG = (40.0, 116.0)
# Distance of the tested edge, m.
EDGE_AHEAD_M = 20.0
# Name of each case, heading of the working line, and direction of the edge, degrees.
TEST_CASES = (
    ("heading 30, edge east-west", 30.0, 90.0),
    ("heading 30, edge north-south", 30.0, 0.0),
    ("heading 60, slanting edge", 60.0, 150.0),
    ("heading 0, edge east-west", 0.0, 90.0),
)


def find_paper_cell(distance_m: float, half_m: float) -> int:
    """Returns the column or row of a place by its distance from the middle of cell 0 (eq 2).
    ValueError for a place before cell 0."""
    if distance_m >= half_m:
        return ceil((distance_m - half_m) / (2.0 * half_m))
    if distance_m > -half_m:
        return floor(abs(distance_m - half_m) / (2.0 * half_m))
    raise ValueError(f"{distance_m:g} m: eq 2 has no cell before the first")


def count_agreeing_cells(
    count: int = 1001, cell: Callable[[float, float], int] = find_paper_cell
) -> tuple[int, int]:
    """Returns the number of `count` distances up to 100 m at which eq 2, `cell`, gives the right
    cell; an edge belongs to the cell before it."""
    half = 0.5 * CELL_M
    places = [k * 100.0 / (count - 1) for k in range(count)]
    return sum(cell(at, half) == max(0, ceil(at / CELL_M - 0.5)) for at in places), count


def find_crossing(of: Point, towards: Point, a: Point, b: Point) -> Point:
    """Returns the intersection of the line through `of` and `towards` with that through a and b,
    by vectors: without slopes, so for any direction. ZeroDivisionError for parallel lines."""
    (dx, dy), (ex, ey) = (towards[0] - of[0], towards[1] - of[1]), (b[0] - a[0], b[1] - a[1])
    share = ((a[0] - of[0]) * ey - (a[1] - of[1]) * ex) / (dx * ey - dy * ex)
    return of[0] + share * dx, of[1] + share * dy


def find_paper_crossing(of: Point, towards: Point, a: Point, b: Point) -> Point | None:
    """Returns the intersection by eq 4 and 5 as printed; None where a slope does not exist (eq 4
    requires X1 other than X2)."""
    if of[0] == towards[0]:
        return None
    k1 = (of[1] - towards[1]) / (of[0] - towards[0])
    b1 = of[1] - k1 * of[0]
    if a[0] == b[0]:
        x = of[0]
    else:
        k2 = (a[1] - b[1]) / (a[0] - b[0])
        x = ((a[1] - k2 * a[0]) - b1) / (k1 - k2)
    return x, k1 * of[0] + b1


def make_boundary_table() -> Table:
    """Returns the distance to an edge 20 m ahead along the working line, as printed and by
    vectors, m."""
    plane = TangentPlane(*PLACE_DEG)

    def point(east_m: float, north_m: float) -> Point:
        lat, lon = plane.convert_to_deg(east_m, north_m)
        return lon, lat

    rows: list[tuple[str | float | None, ...]] = []
    for name, heading_deg, edge_deg in TEST_CASES:
        way = (sin(radians(heading_deg)), cos(radians(heading_deg)))
        along = (sin(radians(edge_deg)), cos(radians(edge_deg)))
        middle = (EDGE_AHEAD_M * way[0], EDGE_AHEAD_M * way[1])
        ends = [
            (middle[0] + side * 30.0 * along[0], middle[1] + side * 30.0 * along[1])
            for side in (-1.0, 1.0)
        ]
        a, b = (point(*end) for end in ends)
        if edge_deg == 0.0:
            # The edge is a meridian to the last digit.
            b = (a[0], b[1])
        towards = point(*way)
        here = point(0.0, 0.0)
        towards = (here[0], towards[1]) if heading_deg == 0.0 else towards
        printed = find_paper_crossing(here, towards, a, b)
        right = find_crossing(here, towards, a, b)
        rows.append(
            (
                name,
                None if printed is None else hypot(*plane.project_to_m(printed[1], printed[0])),
                hypot(*plane.project_to_m(right[1], right[0])),
            )
        )
    return Table(
        f"Eq 4 and 5 at 40 N: distance to an edge {EDGE_AHEAD_M:g} m ahead along the working "
        "line, m; eq 5 as "
        f"printed "
        "takes X1 where the crossing's X belongs",
        ("case", "as printed", "by vectors"),
        tuple(rows),
        (0, 2, 2),
    )
