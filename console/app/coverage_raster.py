"""Accumulates applied rate, target, NDVI and passes in a raster of the worked ground: in tiles, at
several cell sizes, with bounded memory.

A map pixel is the mean of the cells below it. The cells are the coarsest that do not exceed the
pixel, so that a picture of a whole day costs as much as a picture of a minute.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import ceil, hypot, isfinite
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.console.frame import Frame

Floats = npt.NDArray[np.float64]
# Planes of a tile (2 x kinds + 1, rows, columns): sums, counts, passages. float32 halves the
# memory.
Window = npt.NDArray[np.float32]

# Sides of a cell, m. Each size is twice the former, so that four cells add up to a cell of the next
# size.
CELL_SIZES_M = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
# Values of a spot that are averaged: applied rate, target rate, NDVI.
SPOT_VALUE_COUNT = 3
# The fourth kind is the number of passes.
CELL_KIND_COUNT = SPOT_VALUE_COUNT + 1
# A sum and a count for each kind, and the number of passages.
CELL_PLANE_COUNT = 2 * CELL_KIND_COUNT + 1
# Index of an additional plane: way driven when the cell was last spread on, m; 0 means never.
_DRIVEN_PLANE = CELL_PLANE_COUNT
# Working widths driven before ground counts as a new pass, as in `control.field.coverage`.
REVISIT_WIDTHS = 3.0
# Spots closer than this, m, to the former spot are ignored, so that a standing machine does not
# dominate the means.
MIN_SPOT_STEP_M = 0.4
# Spacing of samples, in cells. It is below 1 / sqrt(2), the largest spacing at which every cell
# contains a sample at any rotation of the lattice.
SAMPLE_SPACING_CELLS = 0.7
# Number of spots behind the machine that the trail contains, some 30 m.
MAX_TRAIL_SPOTS = 90
# Lower rates, kg/ha, count as a passage without application.
MIN_APPLIED_KG_HA = 1.0
# A shaft above this speed turns; threshold from the paper on the machine's lag.
MIN_TURNING_RPM = 2.0
# Spots further apart than this, m, are not connected: GNSS was lost between them.
MAX_JOINED_STEP_M = 12.0
# Limit of tiles of one cell size: 1,400 tiles take 57 MB.
MAX_TILES = 1_400
# Cells along a side of a tile.
_TILE_SIDE_CELLS = 32
# Value of `OutletSpot.open_bits` for all sections open: the two's complement of -1 has every bit
# set.
ALL_SECTIONS_OPEN = -1.0
# Number of bits that a float64 represents exactly; the bits travel in an array of floats.
MAX_SECTION_BITS = 52


class OutletSpot(NamedTuple):
    """Holds the state of the outlets at one position, m east and north of the field's origin;
    unknown numbers are NaN."""

    east_m: float
    north_m: float
    heading_deg: float
    applied_kg_ha: float
    target_kg_ha: float
    ndvi: float
    # Open sections as bits; bit 0 is the leftmost section.
    open_bits: float = ALL_SECTIONS_OPEN
    # Distance driven up to this spot, m; `WorkedGround` sets it.
    way_m: float = 0.0


def make_spot(frame: Frame) -> OutletSpot | None:
    """Return the spot of a frame, or None without a position.

    Rates count only where the machine worked, because a machine on hold has no target to fulfil.
    """
    if frame.place_m is None or not all(map(isfinite, frame.place_m)):
        return None
    row = frame.row
    # A foreign log has no state (None).
    at_work = row.state in (None, "working")
    # After a stop a shaft that still turns drops material on the ground. Material of a calibration
    # run falls into a tray instead.
    lands = at_work or (
        row.state != "calibrating"
        and row.shaft_rpm_cmd == 0.0
        and (row.shaft_rpm or 0.0) > MIN_TURNING_RPM
    )

    def replace_unknown(value: float | None) -> float:
        return float("nan") if value is None else value

    return OutletSpot(
        frame.place_m[0],
        frame.place_m[1],
        replace_unknown(row.heading_deg),
        replace_unknown(row.applied_rate_kg_ha) if lands else float("nan"),
        replace_unknown(row.target_rate_kg_ha) if at_work else float("nan"),
        replace_unknown(row.ndvi),
        parse_open_bits(row.sections_cmd),
    )


def parse_open_bits(sections_cmd: str | None) -> float:
    """Convert the log's column of section valves to bits; an empty column means that all sections
    are open."""
    if not sections_cmd:
        return ALL_SECTIONS_OPEN
    return float(
        sum(
            1 << k
            for k, command in enumerate(sections_cmd.split(";")[:MAX_SECTION_BITS])
            if command == "1"
        )
    )


class GroundBox(NamedTuple):
    """Holds the sides of a rectangle, m."""

    west_m: float
    south_m: float
    east_m: float
    north_m: float


class WorkedGround:
    """Accumulates the worked ground. Spots must arrive in driving order.

    Parameters
    ----------
    width_m
        Width that the outlets cover, m.
    most_tiles
        Limit of tiles of the finest cells. Beyond it the finest cells are discarded, and the map
        has the next cell size.

    Notes
    -----
    `version` changes with each addition. Larger cells are calculated on demand.
    """

    def __init__(self, width_m: float = 2.4, most_tiles: int = MAX_TILES) -> None:
        self.width_m, self.most_tiles = width_m, most_tiles
        # Right ends of the sections as shares of the width.
        self.sections: tuple[float, ...] = ()
        self.clear_ground()

    def clear_ground(self) -> None:
        """Remove all spots."""
        self.version = 0
        self.cells_m: tuple[float, ...] = CELL_SIZES_M
        # Bounding box of the middle of the outlets.
        self.box: GroundBox | None = None
        # Half of the working width: ground beyond the box that is also covered, m.
        self.half_width_m = 0.0
        # Lowest and highest applied or target rate, kg/ha.
        self.rate_ends: tuple[float, float] | None = None
        self.ndvi_ends: tuple[float, float] | None = None
        self._tiles: dict[float, dict[tuple[int, int], Window]] = {
            cell: {} for cell in CELL_SIZES_M
        }
        # Tiles that changed since the larger cells were calculated.
        self._changed_tiles: dict[float, set[tuple[int, int]]] = {
            cell: set() for cell in CELL_SIZES_M
        }
        self._last: OutletSpot | None = None
        self._way_m = 0.0
        self.trail: deque[OutletSpot] = deque(maxlen=MAX_TRAIL_SPOTS)

    @property
    def tile_count(self) -> int:
        """Number of tiles of all cell sizes."""
        return sum(len(tiles) for tiles in self._tiles.values())

    def add_spots(self, spots: Sequence[OutletSpot]) -> None:
        """Add spots in driving order. A spot closer than `MIN_SPOT_STEP_M` to the former spot is
        ignored."""
        ways = list(self._find_new_ways(spots))
        if not ways:
            return
        self.version += 1
        # Connected spots are interpolated densely enough that no cell on the way stays empty.
        along = _interpolate_ways(
            [way for way in ways if way.joined], SAMPLE_SPACING_CELLS * self.cells_m[0]
        )
        points = np.array([way.end for way in ways if not way.joined], dtype=np.float64).reshape(
            -1, len(OutletSpot._fields)
        )
        laid = np.concatenate((along, points))
        # Restore driving order, which the count of passes needs.
        laid = laid[np.argsort(laid[:, -1], kind="stable")]
        self.trail.extend(OutletSpot(*row) for row in laid[-MAX_TRAIL_SPOTS:].tolist())
        self._widen_box(laid)
        # Passages count along the middle only, once per sample, whatever the working width.
        middle = np.full((len(laid), 2 + CELL_KIND_COUNT + 1), np.nan)
        middle[:, :2], middle[:, -1] = laid[:, :2], 1.0
        self._enter_rows(np.concatenate((self._list_swath_rows(laid), middle)))
        # Memory stays bounded: where the finest cells exceed the limit, only larger cells remain.
        while len(self._tiles[self.cells_m[0]]) > self.most_tiles and len(self.cells_m) > 1:
            self._build_larger_cells(self.cells_m[1])
            del self._tiles[self.cells_m[0]], self._changed_tiles[self.cells_m[0]]
            self.cells_m = self.cells_m[1:]

    def add_earlier_spots(self, spots: Sequence[OutletSpot]) -> None:
        """Add spots that precede those already added. Later calls of `add_spots` continue from the
        newest spot."""
        (last, self._last), (trail, self.trail) = (
            (self._last, None),
            (self.trail, deque(maxlen=MAX_TRAIL_SPOTS)),
        )
        self.add_spots(spots)
        self._last, self.trail = last, trail

    def sum_window(
        self,
        cell_m: float,
        column: int,
        row: int,
        columns: int,
        rows: int,
        planes: Sequence[int] = range(CELL_PLANE_COUNT),
    ) -> Window:
        """Return planes of a window of cells; cells without entries are zero.

        Parameters
        ----------
        cell_m
            Side of a cell, m; one of `cells_m`.
        column, row
            South-west cell of the window; rows count from south to north.
        columns, rows
            Size of the window in cells.
        planes
            Planes to return: sums of applied, target, NDVI and passes; their counts; passages.

        Returns
        -------
        ndarray
            Float32 of shape (len(planes), rows, columns).
        """
        self._build_larger_cells(cell_m)
        seen = np.zeros((len(planes), rows, columns), dtype=np.float32)
        tiles = self._tiles[cell_m]
        for tile_row in range(row // _TILE_SIDE_CELLS, (row + rows - 1) // _TILE_SIDE_CELLS + 1):
            for tile_column in range(
                column // _TILE_SIDE_CELLS, (column + columns - 1) // _TILE_SIDE_CELLS + 1
            ):
                tile = tiles.get((tile_column, tile_row))
                if tile is None:
                    continue
                r0, c0 = tile_row * _TILE_SIDE_CELLS, tile_column * _TILE_SIDE_CELLS
                r = slice(max(row, r0), min(row + rows, r0 + _TILE_SIDE_CELLS))
                c = slice(max(column, c0), min(column + columns, c0 + _TILE_SIDE_CELLS))
                for k, plane in enumerate(planes):
                    seen[k, r.start - row : r.stop - row, c.start - column : c.stop - column] = (
                        tile[plane, r.start - r0 : r.stop - r0, c.start - c0 : c.stop - c0]
                    )
        return seen

    def choose_cell_m(self, pixel_m: float) -> float:
        """Return the side of the coarsest cells that do not exceed a pixel, else of the finest
        cells, m."""
        return max((cell for cell in self.cells_m if cell <= pixel_m), default=self.cells_m[0])

    def list_trail_places(self) -> Floats:
        """Return east and north of the ground that the trail covers, m; shape (positions, 2), about
        one position per finest cell."""
        laid = np.array(self.trail, dtype=np.float64).reshape(-1, len(OutletSpot._fields))
        return self._make_swath(laid, self._list_offsets_m())[0].reshape(-1, 2)

    # The following methods are private to the raster.

    def _find_new_ways(self, spots: Sequence[OutletSpot]) -> Iterator[_SpotWay]:
        """Yield the way from the last spot to each spot that is far enough from it, and whether
        both are connected."""
        for spot in spots:
            last = self._last
            apart_m = (
                # The first spot starts beyond the revisit distance, so that it counts as a new
                # pass.
                2.0 * self._revisit_distance_m
                if last is None
                else hypot(spot.east_m - last.east_m, spot.north_m - last.north_m)
            )
            if last is None or apart_m >= MIN_SPOT_STEP_M:
                self._way_m += apart_m
                self._last = spot._replace(way_m=self._way_m)
                yield _SpotWay(
                    last or self._last,
                    self._last,
                    last is not None and apart_m <= MAX_JOINED_STEP_M,
                )

    @property
    def _revisit_distance_m(self) -> float:
        return REVISIT_WIDTHS * self.width_m

    def _widen_box(self, laid: Floats) -> None:
        """Extend the bounding box and the ranges of rates and NDVI by new rows."""
        (west, south), (east, north) = (
            laid[:, :2].min(axis=0).tolist(),
            laid[:, :2].max(axis=0).tolist(),
        )
        old = self.box or GroundBox(west, south, east, north)
        self.half_width_m = max(self.half_width_m, 0.5 * self.width_m)
        self.box = GroundBox(
            min(old.west_m, west),
            min(old.south_m, south),
            max(old.east_m, east),
            max(old.north_m, north),
        )
        self.rate_ends = _widen_ends(self.rate_ends, laid[:, 3:5], MIN_APPLIED_KG_HA)
        self.ndvi_ends = _widen_ends(self.ndvi_ends, laid[:, 5], -1.0)

    def _list_offsets_m(self) -> Floats:
        """Return positions across the working width, m to the right of its middle."""
        count = max(1, ceil(self.width_m / (SAMPLE_SPACING_CELLS * self.cells_m[0])))
        return np.asarray((np.arange(count) + 0.5) / count * self.width_m - 0.5 * self.width_m)

    @staticmethod
    def _make_swath(laid: Floats, aside: Floats) -> tuple[Floats, Floats]:
        """Return positions across the outlets and the unit vectors to the right.

        Returns
        -------
        places : ndarray
            East and north, m; shape (spots, len(aside), 2).
        right : ndarray
            East and north of the unit vector to the right; shape (spots, 2).
        """
        heading = np.radians(laid[:, 2])
        right = np.stack((np.cos(heading), -np.sin(heading)), axis=1)
        # Without a heading every position across falls on the middle.
        right[~np.isfinite(heading)] = 0.0
        return laid[:, None, :2] + right[:, None, :] * aside[:, None], right

    def _list_swath_rows(self, laid: Floats) -> Floats:
        """Return a row for each position across each spot: east, north, values, way driven, and 0
        for no passage.

        The way is NaN unless material was spread on the middle of the cell.
        """
        aside = self._list_offsets_m()
        places, right = self._make_swath(laid, aside)
        count = len(aside)
        values = np.repeat(laid[:, 3 : 3 + SPOT_VALUE_COUNT], count, axis=0)
        if self.sections:
            of = np.searchsorted(self.sections, aside / self.width_m + 0.5).clip(
                max=len(self.sections) - 1
            )
            bits = laid[:, 3 + SPOT_VALUE_COUNT].astype(np.int64)
            # A closed section applies nothing and owes nothing; its NDVI still counts.
            values[(bits[:, None] >> of & 1 == 0).reshape(-1), :2] = np.nan
        # The pass is judged at the cell's middle: cells that the edge of the swath only touches
        # would count overlap between neighbouring passes.
        middles = (np.floor(places / self.cells_m[0]) + 0.5) * self.cells_m[0]
        off = ((middles - laid[:, None, :2]) * right[:, None, :]).sum(axis=2)
        spread = (np.abs(off) <= 0.5 * self.width_m).reshape(-1) & (
            values[:, 0] >= MIN_APPLIED_KG_HA
        )
        rows = np.zeros((len(values), 2 + CELL_KIND_COUNT + 1))
        rows[:, :2], rows[:, 2 : 2 + SPOT_VALUE_COUNT] = places.reshape(-1, 2), values
        rows[:, 2 + SPOT_VALUE_COUNT] = np.where(
            spread, np.repeat(laid[:, 4 + SPOT_VALUE_COUNT], count), np.nan
        )
        return rows

    def _enter_rows(self, rows: Floats) -> None:
        """Add rows of `_list_swath_rows` to the finest cells."""
        cell_m = self.cells_m[0]
        cells = np.floor(rows[:, :2] / cell_m).astype(np.int64)
        tile = cells // _TILE_SIDE_CELLS
        # Rows sorted by tile are added by one NumPy call per tile.
        order = np.lexsort((tile[:, 1], tile[:, 0]))
        tile, cells, rows = tile[order], cells[order], rows[order]
        begins = np.flatnonzero(np.any(np.diff(tile, axis=0, prepend=tile[:1] - 1) != 0, axis=1))
        for begin, end in zip(begins.tolist(), [*begins[1:].tolist(), len(tile)], strict=True):
            column, row = tile[begin].tolist()
            planes = self._find_or_make_tile(cell_m, (column, row))
            self._changed_tiles[cell_m].add((column, row))
            inside = cells[begin:end] - np.array(
                (column * _TILE_SIDE_CELLS, row * _TILE_SIDE_CELLS)
            )
            flat = inside[:, 1] * _TILE_SIDE_CELLS + inside[:, 0]
            by_cell = planes.reshape(len(planes), _TILE_SIDE_CELLS * _TILE_SIDE_CELLS)
            # `np.add.at` adds repeated cells correctly, unlike indexed `+=`.
            np.add.at(by_cell[2 * CELL_KIND_COUNT], flat, rows[begin:end, -1])
            for kind in range(SPOT_VALUE_COUNT):
                values = rows[begin:end, 2 + kind]
                known = np.isfinite(values)
                np.add.at(by_cell[kind], flat[known], values[known])
                np.add.at(by_cell[CELL_KIND_COUNT + kind], flat[known], 1.0)
            self._count_passes(by_cell, flat, rows[begin:end, 2 + SPOT_VALUE_COUNT])

    def _count_passes(self, by_cell: Window, cells: npt.NDArray[np.int64], way_m: Floats) -> None:
        """Add a pass to each cell that the outlets entered again after leaving it."""
        known = np.isfinite(way_m)
        cells, way_m = cells[known], way_m[known]
        # Within a cell the rows must be in driving order, so that each row is compared with the row
        # before.
        order = np.lexsort((way_m, cells))
        cells, way_m = cells[order], way_m[order]
        times, covered, since = (
            by_cell[SPOT_VALUE_COUNT],
            by_cell[CELL_KIND_COUNT + SPOT_VALUE_COUNT],
            by_cell[_DRIVEN_PLANE],
        )
        before, same = since[cells], cells[1:] == cells[:-1]
        before[1:][same] = way_m[:-1][same]
        anew = cells[(before == 0.0) | (way_m - before > self._revisit_distance_m)]
        covered[anew] = np.maximum(1.0, covered[anew])
        # A cell summed from four finer cells counts all of them that were covered.
        np.add.at(times, anew, covered[anew])
        np.maximum.at(since, cells, way_m)

    def _find_or_make_tile(self, cell_m: float, at: tuple[int, int]) -> Window:
        """Return a tile; a missing tile is made of zeros."""
        tile = self._tiles[cell_m].get(at)
        if tile is None:
            tile = self._tiles[cell_m][at] = np.zeros(
                (CELL_PLANE_COUNT + 1, _TILE_SIDE_CELLS, _TILE_SIDE_CELLS), dtype=np.float32
            )
        return tile

    def _build_larger_cells(self, cell_m: float) -> None:
        """Calculate larger cells, up to this size, from the changed tiles of smaller cells; each
        larger cell is the sum of four."""
        half = _TILE_SIDE_CELLS // 2
        for small, large in pairwise(cell for cell in self.cells_m if cell <= cell_m):
            for column, row in self._changed_tiles[small]:
                tile_of_four = self._tiles[small][column, row].reshape(
                    CELL_PLANE_COUNT + 1, half, 2, half, 2
                )
                fours = tile_of_four.sum(axis=(2, 4))
                # The way of the last pass is no sum: the latest of the four cells counts.
                fours[_DRIVEN_PLANE] = tile_of_four[_DRIVEN_PLANE].max(axis=(1, 3))
                tile = self._find_or_make_tile(large, (column // 2, row // 2))
                r, c = half * (row % 2), half * (column % 2)
                tile[:, r : r + half, c : c + half] = fours
                self._changed_tiles[large].add((column // 2, row // 2))
            self._changed_tiles[small].clear()


class _SpotWay(NamedTuple):
    """Holds the way between two successive spots; `joined` is False across a gap."""

    begin: OutletSpot
    end: OutletSpot
    joined: bool


def _interpolate_ways(ways: Sequence[_SpotWay], step_m: float) -> Floats:
    """Interpolate spots along connected ways.

    Parameters
    ----------
    ways
        Ways; the end of each is included, the beginning is not.
    step_m
        Largest distance between two results, m.

    Returns
    -------
    ndarray
        Values of `OutletSpot`, one row per interpolated spot.
    """
    if not ways:
        return np.zeros((0, len(OutletSpot._fields)))
    begin = np.array([way.begin for way in ways], dtype=np.float64)
    end = np.array([way.end for way in ways], dtype=np.float64)
    count = np.maximum(1, np.ceil(np.hypot(*(end - begin)[:, :2].T) / step_m)).astype(np.int64)
    which = np.repeat(np.arange(len(ways)), count)
    share = (np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + 1) / count[which]
    way = end - begin
    # Heading and values along a way are those of its end; only the position is interpolated.
    way[:, 2:-1] = 0.0
    return np.asarray(end[which] - (1.0 - share)[:, None] * way[which])


def _widen_ends(
    old: tuple[float, float] | None, values: Floats, least: float
) -> tuple[float, float] | None:
    """Return a range extended by the finite values that are at least `least`."""
    known = values[np.isfinite(values) & (values >= least)]
    if not known.size:
        return old
    low, high = float(known.min()), float(known.max())
    return (low, high) if old is None else (min(old[0], low), max(old[1], high))
