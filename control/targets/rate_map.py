"""Which rate does a map have at a place, and where along a straight line may it change? Maps of
cells and of polygons.

Both answer on the field's tangent plane, m. A grid in degrees stays a grid in degrees: its cells
are found through a frame that bends as meridians do, so that the projection cuts no cell anew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
import shapely
from topdress.control.geodesy import Place, TangentPlane, find_unit_vector

Floats = npt.NDArray[np.float64]

# Points on a side to which a frame is fitted.
_FRAME_POINTS_PER_SIDE = 5
# Share of an outline's area by which sums over its corners differ by rounding alone: cells of 3 m
# in degrees as doubles keep ten digits.
AREA_ROUNDING = 1e-7


class RateMap(Protocol):
    """Defines rates on the plane, without the fallbacks."""

    @property
    def cell_m(self) -> float:
        """Returns the shorter side of its cells, m; infinity where it has none."""
        ...

    def find_rates(self, places: npt.ArrayLike) -> Floats:
        """Returns the rates (n,), kg/ha, of places (n, 2), m; NaN where the map has none."""
        ...

    def calc_distance_m(self, place: Place) -> float:
        """Returns the distance from a place to the nearest ground with a rate, m; 0 on it,
        infinity where the map has none."""
        ...

    def find_crossings_m(self, start: Place, heading_deg: float, farthest_m: float) -> Floats:
        """Returns the distances (k,) ahead, above 0 and up to `farthest_m`, at which the rate
        may change, in any order."""
        ...


class MapFrame(NamedTuple):
    """Maps the plane to columns and rows by quadratics in east and north; in a cell both have
    the same floor.

    `column`, `row`: six factors each, of 1, e, n, e^2, e n, n^2."""

    column: tuple[float, ...]
    row: tuple[float, ...]

    def find_cells(self, east_m: Floats, north_m: Floats) -> tuple[Floats, Floats]:
        """Returns column and row, with their fractions, of places (n,)."""
        return _evaluate_quadratic(self.column, east_m, north_m), _evaluate_quadratic(
            self.row, east_m, north_m
        )


def _evaluate_quadratic(factors: tuple[float, ...], e: Floats, n: Floats) -> Floats:
    # The order of evaluation needs the fewest products, because this runs for each place of each
    # tick.
    a, b, c, d, f, g = factors
    return np.asarray(a + e * (b + d * e + f * n) + n * (c + g * n), dtype=np.float64)


def make_frame_m(
    corner: Place, cell_east_m: float, cell_north_m: float, heading_deg: float = 0.0
) -> MapFrame:
    """Returns the frame of cells in metres; rows follow one another along the heading, columns
    to its right.

    Parameters
    ----------
    corner : outer corner of the first cell.
    cell_east_m, cell_north_m : size of a cell, m.
    heading_deg : direction of the rows, degrees.

    Raises
    ------
    ValueError : a cell is not above 0."""
    # A cell without size would divide by zero below.
    if not (cell_east_m > 0.0 and cell_north_m > 0.0):
        raise ValueError(f"cell {cell_east_m:g} x {cell_north_m:g} m: allowed is above 0")
    ahead, right = find_unit_vector(heading_deg), find_unit_vector(heading_deg + 90.0)

    def factors(axis: Place, cell_m: float) -> tuple[float, ...]:
        return (
            -(corner[0] * axis[0] + corner[1] * axis[1]) / cell_m,
            axis[0] / cell_m,
            axis[1] / cell_m,
            0.0,
            0.0,
            0.0,
        )

    return MapFrame(factors(right, cell_east_m), factors(ahead, cell_north_m))


def make_frame_deg(
    plane: TangentPlane,
    south_deg: float,
    west_deg: float,
    cell_lat_deg: float,
    cell_lon_deg: float,
    rows: int,
    columns: int,
) -> MapFrame:
    """Returns the frame of cells in degrees, from the south-western corner on: exact to a
    millimetre over 2 km.

    Raises
    ------
    ValueError : a cell is not above 0, or the grid has no cells."""
    if not (cell_lat_deg > 0.0 and cell_lon_deg > 0.0 and rows > 0 and columns > 0):
        raise ValueError(
            f"grid of {rows} rows and {columns} columns, cell {cell_lat_deg:g} x "
            f"{cell_lon_deg:g} deg: "
            "allowed is above 0"
        )
    row, column = (
        values.ravel()
        for values in np.meshgrid(
            # Five points on each side determine six factors and leave enough to average rounding.
            np.linspace(0.0, rows, _FRAME_POINTS_PER_SIDE),
            np.linspace(0.0, columns, _FRAME_POINTS_PER_SIDE),
        )
    )
    east, north = plane.project_many_to_m(
        south_deg + row * cell_lat_deg, west_deg + column * cell_lon_deg
    ).T
    # Scaling to about 1 keeps the least squares well conditioned.
    size = max(1.0, float(np.abs((east, north)).max()))
    e, n = east / size, north / size
    terms = np.column_stack((np.ones_like(e), e, n, e * e, e * n, n * n))
    back = np.array([1.0, size, size, size * size, size * size, size * size])
    factors = np.linalg.lstsq(terms, np.column_stack((column, row)), rcond=None)[0] / back[:, None]
    return MapFrame(tuple(factors[:, 0].tolist()), tuple(factors[:, 1].tolist()))


class GridMap:
    """Holds the cells of a frame. rate_kg_ha: (rows, columns), NaN: no rate; row 0 begins at the
    corner."""

    def __init__(self, frame: MapFrame, rate_kg_ha: npt.ArrayLike) -> None:
        self.frame = frame
        self.rate_kg_ha: Floats = np.asarray(rate_kg_ha, dtype=np.float64)
        if self.rate_kg_ha.ndim != 2:
            raise ValueError(
                f"a grid's rates have {self.rate_kg_ha.ndim} axes: allowed 2 (rows, columns)"
            )

    @property
    def cell_m(self) -> float:
        # The frame's factors are cells per metre, so their inverse is the size of a cell.
        return 1.0 / max(math.hypot(*self.frame.column[1:3]), math.hypot(*self.frame.row[1:3]))

    def find_rates(self, places: npt.ArrayLike) -> Floats:
        points = np.asarray(places, dtype=np.float64).reshape(-1, 2)
        column, row = self.frame.find_cells(points[:, 0], points[:, 1])
        rows, columns = self.rate_kg_ha.shape
        inside = (column >= 0.0) & (column < columns) & (row >= 0.0) & (row < rows)
        # Places outside the grid keep NaN, which means no rate.
        found = np.full(len(points), np.nan)
        found[inside] = self.rate_kg_ha[
            row[inside].astype(np.int64), column[inside].astype(np.int64)
        ]
        return found

    def calc_distance_m(self, place: Place) -> float:
        """Returns the distance by the frame at the place: right to the share by which the frame
        bends, below 1 % over 10 km."""
        row, column = np.nonzero(np.isfinite(self.rate_kg_ha))
        if not len(row):
            return math.inf
        at = (
            # A metre east and a metre north give the frame's local slope.
            np.array([place[0], place[0] + 1.0, place[0]]),
            np.array([place[1], place[1], place[1] + 1.0]),
        )
        columns, rows = self.frame.find_cells(*at)
        cells = np.stack((_calc_cells_beyond(columns[0], column), _calc_cells_beyond(rows[0], row)))
        per_m = (
            np.array([np.diff(columns[:2]), columns[2] - columns[:1]]).T,
            np.array([np.diff(rows[:2]), rows[2] - rows[:1]]).T,
        )
        # Cells become metres by the inverse of the local slope.
        metres = np.linalg.solve(np.concatenate(per_m), cells)
        return float(np.hypot(*metres).min())

    def find_crossings_m(self, start: Place, heading_deg: float, farthest_m: float) -> Floats:
        """Returns every edge of a column or row on the way. Within 40 m a line is straight in
        the frame to 0.03 mm."""
        east, north = find_unit_vector(heading_deg)
        column, row = self.frame.find_cells(
            np.array([start[0], start[0] + farthest_m * east]),
            np.array([start[1], start[1] + farthest_m * north]),
        )
        rows, columns = self.rate_kg_ha.shape
        return (
            np.concatenate((_list_step_shares(column, columns), _list_step_shares(row, rows)))
            * farthest_m
        )


def _calc_cells_beyond(at: float, cell: npt.NDArray[np.intp]) -> Floats:
    """Returns how far each cell (n,) lies from a place, in cells with a sign; 0 within it."""
    return np.asarray(
        np.where(at < cell, cell - at, np.where(at > cell + 1.0, cell + 1.0 - at, 0.0)),
        dtype=np.float64,
    )


def _list_step_shares(ends: Floats, count: int) -> Floats:
    """Returns the shares of the way between two ends at which whole numbers from 0 to `count`
    are met."""
    begin, end = float(ends[0]), float(ends[1])
    # A line along a column crosses none of its edges.
    if begin == end:
        return np.zeros(0)
    low, high = max(0, math.ceil(min(begin, end))), min(count, math.floor(max(begin, end)))
    share = (np.arange(low, high + 1, dtype=np.float64) - begin) / (end - begin)
    # The start itself is no crossing ahead.
    return np.asarray(share[share > 0.0], dtype=np.float64)


class ZoneMap:
    """Holds polygons with a rate each. Where several overlap, the first in order holds.

    rings: for each zone its outline and its holes, each (k, 2) east and north, m; an outline
    that crosses itself is replaced by the ground that it encloses. rate_kg_ha: (zones,)."""

    def __init__(self, rings: Sequence[Sequence[Floats]], rate_kg_ha: npt.ArrayLike) -> None:
        self.rate_kg_ha: Floats = np.asarray(rate_kg_ha, dtype=np.float64).reshape(-1)
        if len(rings) != len(self.rate_kg_ha):
            raise ValueError(
                f"{len(rings)} zones, {len(self.rate_kg_ha)} rates: allowed as many as zones"
            )
        self.shapes = make_polygons(rings)
        self.cell_m = math.inf
        # Edges and tree are made once, since every tick asks for crossings.
        self._edges = shapely.boundary(self.shapes)
        self._tree = shapely.STRtree(self.shapes)

    def find_rates(self, places: npt.ArrayLike) -> Floats:
        points = np.asarray(places, dtype=np.float64).reshape(-1, 2)
        # An index past the last zone stands for "no zone" and reads NaN below.
        none = len(self.rate_kg_ha)
        point, zone = self._tree.query(shapely.points(points), predicate="intersects")
        first = np.full(len(points), none)
        # The smallest index wins, because the first zone in order holds.
        np.minimum.at(first, point, zone)
        return np.asarray(np.append(self.rate_kg_ha, np.nan)[first], dtype=np.float64)

    def calc_distance_m(self, place: Place) -> float:
        if not len(self.shapes):
            return math.inf
        point = shapely.Point(place)
        return float(shapely.distance(self.shapes[self._tree.nearest(point)], point))

    def find_crossings_m(self, start: Place, heading_deg: float, farthest_m: float) -> Floats:
        east, north = find_unit_vector(heading_deg)
        end = (start[0] + farthest_m * east, start[1] + farthest_m * north)
        line = shapely.linestrings([start, end])
        # Most lines meet few zones; the tree saves the exact intersection with all others.
        met = self._tree.query(line)
        if not len(met):
            return np.zeros(0)
        corners = shapely.get_coordinates(shapely.intersection(self._edges[met], line))
        # The component along the heading is the distance ahead.
        ahead = (corners[:, 0] - start[0]) * east + (corners[:, 1] - start[1]) * north
        return np.asarray(ahead[(ahead > 0.0) & (ahead <= farthest_m)], dtype=np.float64)


def make_polygons(rings: Sequence[Sequence[Floats]]) -> npt.NDArray[np.object_]:
    """Returns shapes (zones,) of outlines with holes; outlines that cross themselves are
    replaced by what they enclose."""
    shapes = make_polygons_as_drawn(rings)
    # Valid outlines, nearly all, are not touched.
    wrong = np.flatnonzero(~shapely.is_valid(shapes))
    crossing = wrong[are_self_crossing(shapes[wrong])]
    shapes[wrong] = _repair_touching(shapes[wrong])
    # A crossing outline is rebuilt from its corners as drawn.
    shapes[crossing] = shapely.make_valid(make_polygons_as_drawn([rings[k] for k in crossing]))
    return shapes


def are_self_crossing(shapes: npt.NDArray[np.object_]) -> npt.NDArray[np.bool_]:
    """Returns which outlines (n,) enclose ground more than once or run backwards.

    The area of an outline as drawn counts ground as often as the outline goes round it. An
    outline that only touches itself, at a corner or along an edge, goes once round all of its
    ground, however often it touches."""
    drawn, repaired = shapely.area(shapes), shapely.area(_repair_touching(shapes))
    crossing: npt.NDArray[np.bool_] = np.abs(drawn - repaired) > AREA_ROUNDING * repaired
    return crossing


def _repair_touching(shapes: npt.NDArray[np.object_]) -> npt.NDArray[np.object_]:
    """Returns shapes (n,) of all ground that an outline goes round: the ground as drawn where it
    only touches itself."""
    return np.asarray(shapely.make_valid(shapes, method="structure"), dtype=object)


def make_polygons_as_drawn(rings: Sequence[Sequence[Floats]]) -> npt.NDArray[np.object_]:
    """Returns the shapes of outlines whether they cross themselves or not."""
    flat = [ring for zone in rings for ring in zone]
    if not flat:
        return np.zeros(0, dtype=object)
    # All rings are built in one call; indices assign corners to rings and rings to zones.
    lines = shapely.linearrings(
        np.concatenate(flat), indices=np.repeat(np.arange(len(flat)), [len(r) for r in flat])
    )
    shapes = shapely.polygons(
        lines, indices=np.repeat(np.arange(len(rings)), [len(zone) for zone in rings])
    )
    return np.asarray(shapes, dtype=object)
