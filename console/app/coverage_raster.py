"""What was done where: a raster of the worked ground, in tiles and at several sizes of cell,
bounded in memory.

A map pixel is the mean of the cells under it, taken from the coarsest cells that are not larger
than the pixel, so a picture of a whole day costs as much as one of a minute.
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
# (2 x kinds + 1, rows, columns): sums, counts, passages
Window = npt.NDArray[np.float32]

CELLS_M = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
SPOT_VALUES = 3  # of a spot: applied, target, NDVI
CELL_KINDS = SPOT_VALUES + 1  # and how often the ground was spread on
CELL_PLANES = 2 * CELL_KINDS + 1
# a cell's own plane: how far was driven when it was spread on last, m; 0: never
_DRIVEN_PLANE = CELL_PLANES
# driven since: not the same pass; as control.field.coverage has it
REVISIT_WIDTHS = 3.0
# shorter ways are not entered: standing still weighs nothing
LEAST_STEP_M = 0.4
# of a cell, between places that are entered: below the side of a square that has a place of
# such a lattice in it however it is turned, 1 / sqrt(2)
PLACE_SPACING = 0.7
# places of the pass behind the machine: some 30 m
TRAIL_PLACES = 90
NOTHING_KG_HA = 1.0  # less than this is passage, not application
TURNING_RPM = 2.0  # the lag paper's threshold of a shaft that turns
JUMP_M = 12.0  # places further apart are not joined
MOST_TILES = 1_400  # of one size of cell: 57 MB
_TILE_CELLS = 32  # cells on a side
ALL_OPEN = -1.0
MOST_BITS = 52  # that a float holds exactly


class Spot(NamedTuple):
    """Holds one place of the outlets, m east and north of the field's origin; unknown numbers are
    NaN."""

    east_m: float
    north_m: float
    heading_deg: float
    applied_kg_ha: float
    target_kg_ha: float
    ndvi: float
    open_bits: float = ALL_OPEN  # of the sections, bit 0 the leftmost
    way_m: float = 0.0  # driven until here; Worked says it


def make_spot(frame: Frame) -> Spot | None:
    """The spot of a frame; None: no place. Rates count only where the machine worked: a machine
    that is held owes nothing."""
    if frame.place_m is None or not all(map(isfinite, frame.place_m)):
        return None
    row = frame.row
    at_work = row.state in (None, "working")  # None: a foreign log
    # Out of work, commanded to stop, and the shaft turns: what it gives lies there all the
    # same. What a calibrating run gives lies in a tray.
    lands = at_work or (
        row.state != "calibrating"
        and row.shaft_rpm_cmd == 0.0
        and (row.shaft_rpm or 0.0) > TURNING_RPM
    )

    def replace_unknown(value: float | None) -> float:
        return float("nan") if value is None else value

    return Spot(
        frame.place_m[0],
        frame.place_m[1],
        replace_unknown(row.heading_deg),
        replace_unknown(row.applied_rate_kg_ha) if lands else float("nan"),
        replace_unknown(row.target_rate_kg_ha) if at_work else float("nan"),
        replace_unknown(row.ndvi),
        parse_open_bits(row.sections_cmd),
    )


def parse_open_bits(sections_cmd: str | None) -> float:
    """The log's column of the valves as a number; all open where it is empty."""
    if not sections_cmd:
        return ALL_OPEN
    return float(
        sum(
            1 << k
            for k, command in enumerate(sections_cmd.split(";")[:MOST_BITS])
            if command == "1"
        )
    )


class Box(NamedTuple):
    """Holds ends of a rectangle, m."""

    west_m: float
    south_m: float
    east_m: float
    north_m: float


class WorkedGround:
    """Rasters the worked ground. Takes spots in the order of driving.

    width_m: of the ground that the outlets cover. `version` changes when anything was entered.
    Where the finest cells would need more than `most_tiles` tiles they are given up, and the map is
    as coarse as the next size. Larger cells are summed up when they are needed.
    """

    def __init__(self, width_m: float = 2.4, most_tiles: int = MOST_TILES) -> None:
        self.width_m, self.most_tiles = width_m, most_tiles
        # right ends of the sections, as shares of the width
        self.sections: tuple[float, ...] = ()
        self.clear_ground()

    def clear_ground(self) -> None:
        """Forget all spots."""
        self.version = 0
        self.cells_m: tuple[float, ...] = CELLS_M
        self.box: Box | None = None  # of the outlets' middle
        self.reach_m = 0.0  # to either side of it
        self.rate_ends: tuple[float, float] | None = None  # of applied and target, kg/ha
        self.ndvi_ends: tuple[float, float] | None = None
        self._tiles: dict[float, dict[tuple[int, int], Window]] = {cell: {} for cell in CELLS_M}
        # not yet in larger cells
        self._new: dict[float, set[tuple[int, int]]] = {cell: set() for cell in CELLS_M}
        self._last: Spot | None = None
        self._way_m = 0.0
        self.trail: deque[Spot] = deque(maxlen=TRAIL_PLACES)

    @property
    def tile_count(self) -> int:
        """Number of tiles, of all sizes of cell."""
        return sum(len(tiles) for tiles in self._tiles.values())

    def add_spots(self, spots: Sequence[Spot]) -> None:
        """Enter the next spots. Those that lie less than LEAST_STEP_M from the one before are left
        out."""
        ways = list(self._find_new_ways(spots))
        if not ways:
            return
        self.version += 1
        along = _fill_ways([way for way in ways if way.joined], PLACE_SPACING * self.cells_m[0])
        points = np.array([way.end for way in ways if not way.joined], dtype=np.float64).reshape(
            -1, len(Spot._fields)
        )
        laid = np.concatenate((along, points))
        laid = laid[np.argsort(laid[:, -1], kind="stable")]  # as it was driven
        self.trail.extend(Spot(*row) for row in laid[-TRAIL_PLACES:].tolist())
        self._widen_box(laid)
        middle = np.full((len(laid), 2 + CELL_KINDS + 1), np.nan)
        middle[:, :2], middle[:, -1] = laid[:, :2], 1.0
        self._enter_rows(np.concatenate((self._list_swath_rows(laid), middle)))
        while len(self._tiles[self.cells_m[0]]) > self.most_tiles and len(self.cells_m) > 1:
            self._sum_up_cells(self.cells_m[1])
            del self._tiles[self.cells_m[0]], self._new[self.cells_m[0]]
            self.cells_m = self.cells_m[1:]

    def add_earlier_spots(self, spots: Sequence[Spot]) -> None:
        """Enter spots of an earlier time; the next ones of `add_spots` go on from the last ones."""
        (last, self._last), (trail, self.trail) = (
            (self._last, None),
            (self.trail, deque(maxlen=TRAIL_PLACES)),
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
        planes: Sequence[int] = range(CELL_PLANES),
    ) -> Window:
        """Planes (sums of applied, target, NDVI, how often; their counts; passages) of cells column
        ... column + columns, row south to north; zeros where nothing was entered."""
        self._sum_up_cells(cell_m)
        seen = np.zeros((len(planes), rows, columns), dtype=np.float32)
        tiles = self._tiles[cell_m]
        for tile_row in range(row // _TILE_CELLS, (row + rows - 1) // _TILE_CELLS + 1):
            for tile_column in range(
                column // _TILE_CELLS, (column + columns - 1) // _TILE_CELLS + 1
            ):
                tile = tiles.get((tile_column, tile_row))
                if tile is None:
                    continue
                r0, c0 = tile_row * _TILE_CELLS, tile_column * _TILE_CELLS
                r = slice(max(row, r0), min(row + rows, r0 + _TILE_CELLS))
                c = slice(max(column, c0), min(column + columns, c0 + _TILE_CELLS))
                for k, plane in enumerate(planes):
                    seen[k, r.start - row : r.stop - row, c.start - column : c.stop - column] = (
                        tile[plane, r.start - r0 : r.stop - r0, c.start - c0 : c.stop - c0]
                    )
        return seen

    def choose_cell_m(self, pixel_m: float) -> float:
        """The coarsest cell that is not larger than a pixel, or the finest, m."""
        return max((cell for cell in self.cells_m if cell <= pixel_m), default=self.cells_m[0])

    def list_trail_places(self) -> Floats:
        """East and north of the ground that the trail covers, a place for each of the finest cells
        across."""
        laid = np.array(self.trail, dtype=np.float64).reshape(-1, len(Spot._fields))
        return self._make_swath(laid, self._list_offsets_m())[0].reshape(-1, 2)

    # --- inside
    # ----------------------------------------------------------------------------------------------

    def _find_new_ways(self, spots: Sequence[Spot]) -> Iterator[_SpotWay]:
        for spot in spots:
            last = self._last
            apart_m = (
                2.0 * self._revisit_distance_m
                if last is None
                else hypot(spot.east_m - last.east_m, spot.north_m - last.north_m)
            )
            if last is None or apart_m >= LEAST_STEP_M:
                self._way_m += apart_m
                self._last = spot._replace(way_m=self._way_m)
                yield _SpotWay(
                    last or self._last, self._last, last is not None and apart_m <= JUMP_M
                )

    @property
    def _revisit_distance_m(self) -> float:
        return REVISIT_WIDTHS * self.width_m

    def _widen_box(self, laid: Floats) -> None:
        (west, south), (east, north) = (
            laid[:, :2].min(axis=0).tolist(),
            laid[:, :2].max(axis=0).tolist(),
        )
        old = self.box or Box(west, south, east, north)
        self.reach_m = max(self.reach_m, 0.5 * self.width_m)
        self.box = Box(
            min(old.west_m, west),
            min(old.south_m, south),
            max(old.east_m, east),
            max(old.north_m, north),
        )
        self.rate_ends = _widen_ends(self.rate_ends, laid[:, 3:5], NOTHING_KG_HA)
        self.ndvi_ends = _widen_ends(self.ndvi_ends, laid[:, 5], -1.0)

    def _list_offsets_m(self) -> Floats:
        """Places across the outlets' width, m to the right of their middle."""
        count = max(1, ceil(self.width_m / (PLACE_SPACING * self.cells_m[0])))
        return np.asarray((np.arange(count) + 0.5) / count * self.width_m - 0.5 * self.width_m)

    @staticmethod
    def _make_swath(laid: Floats, aside: Floats) -> tuple[Floats, Floats]:
        """Places (spot, aside, east and north), and the direction to the right (spot, east and
        north)."""
        heading = np.radians(laid[:, 2])
        right = np.stack((np.cos(heading), -np.sin(heading)), axis=1)
        right[~np.isfinite(heading)] = 0.0
        return laid[:, None, :2] + right[:, None, :] * aside[:, None], right

    def _list_swath_rows(self, laid: Floats) -> Floats:
        """Rows of east, north, values, the way driven where something was spread on the cell's
        middle, else NaN, and 0 for no passage: a row for each place across."""
        aside = self._list_offsets_m()
        places, right = self._make_swath(laid, aside)
        count = len(aside)
        values = np.repeat(laid[:, 3 : 3 + SPOT_VALUES], count, axis=0)
        if self.sections:
            of = np.searchsorted(self.sections, aside / self.width_m + 0.5).clip(
                max=len(self.sections) - 1
            )
            bits = laid[:, 3 + SPOT_VALUES].astype(np.int64)
            # nothing from a closed section
            values[(bits[:, None] >> of & 1 == 0).reshape(-1), :2] = np.nan
        middles = (np.floor(places / self.cells_m[0]) + 0.5) * self.cells_m[0]
        off = ((middles - laid[:, None, :2]) * right[:, None, :]).sum(axis=2)
        spread = (np.abs(off) <= 0.5 * self.width_m).reshape(-1) & (values[:, 0] >= NOTHING_KG_HA)
        rows = np.zeros((len(values), 2 + CELL_KINDS + 1))
        rows[:, :2], rows[:, 2 : 2 + SPOT_VALUES] = places.reshape(-1, 2), values
        rows[:, 2 + SPOT_VALUES] = np.where(
            spread, np.repeat(laid[:, 4 + SPOT_VALUES], count), np.nan
        )
        return rows

    def _enter_rows(self, rows: Floats) -> None:
        """Add rows of `_list_swath_rows` to the finest cells."""
        cell_m = self.cells_m[0]
        cells = np.floor(rows[:, :2] / cell_m).astype(np.int64)
        tile = cells // _TILE_CELLS
        order = np.lexsort((tile[:, 1], tile[:, 0]))
        tile, cells, rows = tile[order], cells[order], rows[order]
        begins = np.flatnonzero(np.any(np.diff(tile, axis=0, prepend=tile[:1] - 1) != 0, axis=1))
        for begin, end in zip(begins.tolist(), [*begins[1:].tolist(), len(tile)], strict=True):
            column, row = tile[begin].tolist()
            planes = self._find_or_make_tile(cell_m, (column, row))
            self._new[cell_m].add((column, row))
            inside = cells[begin:end] - np.array((column * _TILE_CELLS, row * _TILE_CELLS))
            flat = inside[:, 1] * _TILE_CELLS + inside[:, 0]
            by_cell = planes.reshape(len(planes), _TILE_CELLS * _TILE_CELLS)
            np.add.at(by_cell[2 * CELL_KINDS], flat, rows[begin:end, -1])
            for kind in range(SPOT_VALUES):
                values = rows[begin:end, 2 + kind]
                known = np.isfinite(values)
                np.add.at(by_cell[kind], flat[known], values[known])
                np.add.at(by_cell[CELL_KINDS + kind], flat[known], 1.0)
            self._count_passes(by_cell, flat, rows[begin:end, 2 + SPOT_VALUES])

    def _count_passes(self, by_cell: Window, cells: npt.NDArray[np.int64], way_m: Floats) -> None:
        """Adds one pass to every cell that the outlets have entered again since they left it."""
        known = np.isfinite(way_m)
        cells, way_m = cells[known], way_m[known]
        order = np.lexsort((way_m, cells))
        cells, way_m = cells[order], way_m[order]
        times, covered, since = (
            by_cell[SPOT_VALUES],
            by_cell[CELL_KINDS + SPOT_VALUES],
            by_cell[_DRIVEN_PLANE],
        )
        before, same = since[cells], cells[1:] == cells[:-1]
        before[1:][same] = way_m[:-1][same]
        anew = cells[(before == 0.0) | (way_m - before > self._revisit_distance_m)]
        covered[anew] = np.maximum(1.0, covered[anew])
        # of a cell that was made of four: all that were covered
        np.add.at(times, anew, covered[anew])
        np.maximum.at(since, cells, way_m)

    def _find_or_make_tile(self, cell_m: float, at: tuple[int, int]) -> Window:
        tile = self._tiles[cell_m].get(at)
        if tile is None:
            tile = self._tiles[cell_m][at] = np.zeros(
                (CELL_PLANES + 1, _TILE_CELLS, _TILE_CELLS), dtype=np.float32
            )
        return tile

    def _sum_up_cells(self, cell_m: float) -> None:
        """Make larger cells, up to this size, of the new tiles of the smaller ones: each the sum of
        four."""
        half = _TILE_CELLS // 2
        for small, large in pairwise(cell for cell in self.cells_m if cell <= cell_m):
            for column, row in self._new[small]:
                tile_of_four = self._tiles[small][column, row].reshape(
                    CELL_PLANES + 1, half, 2, half, 2
                )
                fours = tile_of_four.sum(axis=(2, 4))
                fours[_DRIVEN_PLANE] = tile_of_four[_DRIVEN_PLANE].max(axis=(1, 3))
                tile = self._find_or_make_tile(large, (column // 2, row // 2))
                r, c = half * (row % 2), half * (column % 2)
                tile[:, r : r + half, c : c + half] = fours
                self._new[large].add((column // 2, row // 2))
            self._new[small].clear()


class _SpotWay(NamedTuple):
    begin: Spot
    end: Spot
    joined: bool


def _fill_ways(ways: Sequence[_SpotWay], step_m: float) -> Floats:
    """Rows of Spot values along joined ways, `step_m` apart at most, each way's end in, its begin
    out."""
    if not ways:
        return np.zeros((0, len(Spot._fields)))
    begin = np.array([way.begin for way in ways], dtype=np.float64)
    end = np.array([way.end for way in ways], dtype=np.float64)
    count = np.maximum(1, np.ceil(np.hypot(*(end - begin)[:, :2].T) / step_m)).astype(np.int64)
    which = np.repeat(np.arange(len(ways)), count)
    share = (np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + 1) / count[which]
    way = end - begin
    way[:, 2:-1] = 0.0  # heading and values are those of its end
    return np.asarray(end[which] - (1.0 - share)[:, None] * way[which])


def _widen_ends(
    old: tuple[float, float] | None, values: Floats, least: float
) -> tuple[float, float] | None:
    known = values[np.isfinite(values) & (values >= least)]
    if not known.size:
        return old
    low, high = float(known.min()), float(known.max())
    return (low, high) if old is None else (min(old[0], low), max(old[1], high))
