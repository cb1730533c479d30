"""Records the covered ground in a bitmap under the outlets, so that no ground is counted twice.

A cell (0.2 m by default) counts when its centre was passed over. Over whole passes the area is
accurate to about a cell in width, and far better in the mean over headings; see the tests. Bitmap
tiles are allocated where work is done: 100 MB hold 100 ha.

The work of a call is bounded for any positions: a stretch longer than `longest_m` is a jump and not
covered, positions too far from the field's plane are ignored, and a raster has at most
`MAX_RASTER_CELLS`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.geodesy import Place, calc_plane_distance_m, find_unit_vector
from topdress.control.machine.steps import CompiledSteps

from .cell_tests import (
    TILE_CELLS,
    Corners,
    Floats,
    allocate_sides,
    find_side_offset,
    is_passed_again,
    offset_places,
    put_triangle_sides,
)

# Stamp of ground that an earlier run has done.
_EARLIER_STAMP = -math.inf
# Maximum distance from the plane's origin of a position in the field, m.
MAX_DISTANCE_M = 100_000.0
# Maximum number of cells of a raster: 4 km by 4 km at 0.2 m, 400 MB.
MAX_RASTER_CELLS = 400_000_000


class CoveredArea(NamedTuple):
    """Covered area of a run."""

    # Area with each position counted once, ha.
    area_ha: float
    # Area that was passed over again, counted every time, ha.
    overlap_ha: float
    travelled_m: float


class Raster(NamedTuple):
    """A raster of the covered ground: `done[row, column]`, row 0 in the south, column 0 in the
    west."""

    west_m: float
    south_m: float
    cell_m: float
    done: npt.NDArray[np.bool_]


class _OutletBar(NamedTuple):
    """Ends of a row of outlets; `middle`: of the whole machine."""

    middle: Place
    left: Place
    right: Place


class _OutletGroup:
    """Outlets that flow together, with the end of their last stretch. Edges: m to the right of
    the middle."""

    def __init__(self, left_m: float, right_m: float) -> None:
        self.left_m, self.right_m = left_m, right_m
        # End of the last stretch.
        self.bar: _OutletBar | None = None
        # Start and course of a stretch that is still shorter than half a cell, and its length, m.
        self.saved: tuple[Place, float, float] | None = None

    def place_outlets(self, place: Place, east: float, north: float) -> _OutletBar:
        """Return the row of outlets at a position, on a course of this direction."""
        return _OutletBar(
            place,
            (place[0] + self.left_m * north, place[1] - self.left_m * east),
            (place[0] + self.right_m * north, place[1] - self.right_m * east),
        )


class Coverage:
    """Records coverage from the position of the outlets' middle, tick by tick.

    A cell that is passed over again counts as overlap when the machine has travelled more than
    `revisit_m` since (three widths by default), so that a tight turn does not overlap itself. Two
    calls farther apart than `longest_m` are a jump of the position, without coverage between them.
    strips: outlets that flow together, by their edges, m to the right of the middle; the whole
    width by default. Raises ValueError for a width or a cell that is not above 0, or a cell larger
    than half the width.
    """

    def __init__(
        self,
        width_m: float,
        cell_m: float = 0.2,
        revisit_m: float | None = None,
        longest_m: float = 30.0,
        strips: Sequence[tuple[float, float]] = (),
        steps: CompiledSteps | None = None,
    ) -> None:
        """Create an empty coverage. steps: compiled loops for long runs, which take a third of
        the time."""
        if not 0.0 < 2.0 * cell_m <= width_m:
            raise ValueError(
                f"width {width_m:g} m, cell {cell_m:g} m: allowed is a cell above 0, at "
                "most half the "
                "width"
            )
        self.width_m = width_m
        self.cell_m = cell_m
        self.revisit_m = 3.0 * width_m if revisit_m is None else revisit_m
        self.longest_m = longest_m
        # Tiles by row and column.
        self._tiles: dict[tuple[int, int], npt.NDArray[np.float32]] = {}
        # Tile of the last mark.
        self._newest = (0, 0)
        self._cells = self._again = 0
        self._travelled_m = 0.0
        self._last: Place | None = None
        self._strips = [
            _OutletGroup(left, right)
            for left, right in strips or ((-0.5 * width_m, 0.5 * width_m),)
        ]
        self._sides = allocate_sides()
        self._empty = _make_empty_tile()
        self.loops: Any = None if steps is None else steps.cells

    def add_earlier_ground(self, ground: Raster, ours: bool = True) -> None:
        """Add ground that an earlier run has done, with cells of any size: it counts as covered,
        and never as just passed over.

        A cell here counts when its centre is in a done cell there. ours: False for the ground of
        another machine, which does not count as covered area.
        """
        cells = self._cells
        rows, columns = ground.done.shape
        south, west = (math.floor(edge / self.cell_m) for edge in (ground.south_m, ground.west_m))
        north, east = (
            math.floor((edge + count * ground.cell_m) / self.cell_m)
            for edge, count in ((ground.south_m, rows), (ground.west_m, columns))
        )
        there = [
            np.floor(
                ((np.arange(first, last + 1) + 0.5) * self.cell_m - edge) / ground.cell_m
            ).astype(np.int64)
            for first, last, edge in ((south, north, ground.south_m), (west, east, ground.west_m))
        ]
        inside = [
            (index >= 0) & (index < count)
            for index, count in zip(there, (rows, columns), strict=True)
        ]
        done = np.zeros((len(there[0]), len(there[1])), dtype=np.bool_)
        done[np.ix_(*inside)] = ground.done[np.ix_(there[0][inside[0]], there[1][inside[1]])]
        for row in range(south // TILE_CELLS, north // TILE_CELLS + 1):
            for column in range(west // TILE_CELLS, east // TILE_CELLS + 1):
                self._mark_tile(row, column, south, west, done, _EARLIER_STAMP)
        if not ours:
            self._cells = cells

    def extend_to(self, place: Place, heading_deg: float, flowing: bool | Sequence[bool]) -> None:
        """Extend the coverage to the outlets' present middle; `flowing`: whether material has been
        landing since the last call, by strip where the coverage has several.

        Stretches shorter than half a cell are accumulated. A position that is not finite, or too
        far away for the field, is ignored and interrupts the stretch; so does a jump.
        """
        if not (
            abs(place[0]) <= MAX_DISTANCE_M
            and abs(place[1]) <= MAX_DISTANCE_M
            and math.isfinite(heading_deg)
        ):
            self._end_stretches()
            self._last = None
            return
        if self._last is not None:
            step_m = calc_plane_distance_m(self._last, place)
            if step_m > self.longest_m:
                self._end_stretches()
            else:
                self._travelled_m += step_m
        self._last = place
        east, north = find_unit_vector(heading_deg)
        flows = (flowing,) * len(self._strips) if isinstance(flowing, bool) else flowing
        for strip, flowed in zip(self._strips, flows, strict=True):
            if not flowed or strip.bar is None:
                self._end_stretch(strip, strip.place_outlets(place, east, north))
            elif calc_plane_distance_m(strip.bar.middle, place) >= 0.5 * self.cell_m:
                bar = strip.place_outlets(place, east, north)
                self._sweep_stretch(strip.bar, bar)
                strip.bar, strip.saved = bar, None
            else:
                strip.saved = place, east, north

    @property
    def no_flow(self) -> bool | Sequence[bool]:
        """Argument of `extend_to` for no flow."""
        return False if len(self._strips) == 1 else (False,) * len(self._strips)

    @property
    def covered_area(self) -> CoveredArea:
        cell_ha = self.cell_m * self.cell_m / 10_000.0
        return CoveredArea(self._cells * cell_ha, self._again * cell_ha, self._travelled_m)

    def find_covered(self, places: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Tell which positions (n, 2) an earlier pass has covered: (n,). Ground that was just
        passed over does not count.

        The call takes some 20 us for a few hundred neighbouring positions.
        """
        again: npt.NDArray[np.bool_] = is_passed_again(
            self._travelled_m, self._find_stamps(places), self.revisit_m
        )
        return again

    def find_covered_earlier(self, places: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Tell which positions (n, 2) an earlier run has covered and this run has not covered
        since: (n,)."""
        return np.isneginf(self._find_stamps(places))

    def _find_stamps(self, places: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the travelled distance at the last coverage of each position (n, 2), m; NaN
        where never covered."""
        points = np.asarray(places, dtype=np.float64).reshape(-1, 2)
        found = np.full(len(points), np.nan)
        known = np.flatnonzero(
            np.maximum(np.abs(points[:, 0]), np.abs(points[:, 1])) <= MAX_DISTANCE_M
        )
        if not self._tiles or not len(known):
            return found
        cells = np.floor(points[known] / self.cell_m).astype(np.int64)
        west, south = (cells.min(axis=0) // TILE_CELLS).tolist()
        east, north = (cells.max(axis=0) // TILE_CELLS).tolist()
        if west == east and south == north:
            tile = self._tiles.get((south, west))
            if tile is not None:
                found[known] = tile[cells[:, 1] % TILE_CELLS, cells[:, 0] % TILE_CELLS]
            return found
        tiles, rows = cells // TILE_CELLS, north - south + 1
        codes = (tiles[:, 0] - west) * rows + tiles[:, 1] - south
        for code in set(codes.tolist()):
            tile = self._tiles.get((south + code % rows, west + code // rows))
            if tile is None:
                continue
            here = codes == code
            found[known[here]] = tile[cells[here, 1] % TILE_CELLS, cells[here, 0] % TILE_CELLS]
        return found

    def make_raster(self) -> Raster:
        """Return a raster of all covered ground for drawing; a single empty cell for no coverage.

        If the ground is too large for one raster of `MAX_RASTER_CELLS`, the raster shows the
        surroundings of the last position. A stretch shorter than half a cell is included.
        """
        for strip in self._strips:
            if strip.bar is not None and strip.saved is not None:
                self._end_stretch(strip, strip.place_outlets(*strip.saved))
        if not self._tiles:
            return Raster(0.0, 0.0, self.cell_m, np.zeros((1, 1), dtype=np.bool_))
        keys: Collection[tuple[int, int]] = self._tiles.keys()
        south, north, west, east = _find_tile_box(keys)
        if (north - south + 1) * (east - west + 1) * TILE_CELLS * TILE_CELLS > MAX_RASTER_CELLS:
            reach = (math.isqrt(MAX_RASTER_CELLS) // TILE_CELLS - 1) // 2
            keys = {
                key
                for key in keys
                if all(abs(k - new) <= reach for k, new in zip(key, self._newest, strict=True))
            }
            south, north, west, east = _find_tile_box(keys)
        done = np.zeros(
            ((north - south + 1) * TILE_CELLS, (east - west + 1) * TILE_CELLS), dtype=np.bool_
        )
        for row, column in keys:
            r, c = (row - south) * TILE_CELLS, (column - west) * TILE_CELLS
            done[r : r + TILE_CELLS, c : c + TILE_CELLS] = ~np.isnan(self._tiles[row, column])
        return Raster(
            west * TILE_CELLS * self.cell_m, south * TILE_CELLS * self.cell_m, self.cell_m, done
        )

    def _end_stretches(self) -> None:
        for strip in self._strips:
            self._end_stretch(strip, None)

    def _end_stretch(self, strip: _OutletGroup, bar: _OutletBar | None) -> None:
        if strip.bar is not None and strip.saved is not None:
            self._sweep_stretch(strip.bar, strip.place_outlets(*strip.saved))
        strip.bar, strip.saved = bar, None

    def _sweep_stretch(self, before: _OutletBar, now: _OutletBar) -> None:
        corners = (before.left, before.right, now.right, now.left)
        west = math.floor(min([corner[0] for corner in corners]) / self.cell_m)
        east = math.floor(max([corner[0] for corner in corners]) / self.cell_m)
        south = math.floor(min([corner[1] for corner in corners]) / self.cell_m)
        north = math.floor(max([corner[1] for corner in corners]) / self.cell_m)
        if self.loops is not None:
            self._stamp_stretch(corners, (south, west, north, east))
            return
        centre_e: Floats = (np.arange(west, east + 1, dtype=np.float64) + 0.5) * self.cell_m
        centre_n: Floats = ((np.arange(south, north + 1, dtype=np.float64) + 0.5) * self.cell_m)[
            :, None
        ]
        put_triangle_sides(self._sides, corners)
        passed = _find_in_triangles(centre_e, centre_n, self._sides)
        for row in range(south // TILE_CELLS, north // TILE_CELLS + 1):
            for column in range(west // TILE_CELLS, east // TILE_CELLS + 1):
                self._mark_tile(row, column, south, west, passed, self._travelled_m)

    def _stamp_stretch(self, corners: Corners, box: tuple[int, int, int, int]) -> None:
        """Mark a stretch cell by cell. box: its cells, south, west, north, east."""
        for row in range(box[0] // TILE_CELLS, box[2] // TILE_CELLS + 1):
            for column in range(box[1] // TILE_CELLS, box[3] // TILE_CELLS + 1):
                tile = self._tiles.get((row, column))
                entered, new, again = self.loops.stamp_tile_cells(
                    self._empty if tile is None else tile,
                    row * TILE_CELLS,
                    column * TILE_CELLS,
                    box,
                    self.cell_m,
                    corners,
                    self._travelled_m,
                    self.revisit_m,
                )
                if not entered:
                    continue
                self._newest = row, column
                self._cells += new
                self._again += again
                if tile is None:
                    self._tiles[row, column], self._empty = self._empty, _make_empty_tile()

    def count_done_ahead(
        self, place: Place, course: Place, along_m: Floats, aside_m: Floats, earlier: bool
    ) -> Floats | None:
        """Count the positions aside that are over done ground at each distance along: (along,).

        None means that the caller must use `find_covered`, because no compiled loop is available or
        the positions are far apart. place, course: of the outlets' middle, east and north. earlier:
        as for `find_covered_earlier`.
        """
        if self.loops is None:
            return None
        ends = [
            (
                offset_places(place[0], along, course[0], aside, course[1]),
                offset_places(place[1], along, course[1], -aside, course[0]),
            )
            for along in (float(along_m[0]), float(along_m[-1]))
            for aside in (float(aside_m[0]), float(aside_m[-1]))
        ]
        if not all(
            [abs(east) <= MAX_DISTANCE_M and abs(north) <= MAX_DISTANCE_M for east, north in ends]
        ):
            return None
        west, east = (
            math.floor(of([end[0] for end in ends]) / self.cell_m) // TILE_CELLS
            for of in (min, max)
        )
        south, north = (
            math.floor(of([end[1] for end in ends]) / self.cell_m) // TILE_CELLS
            for of in (min, max)
        )
        if east - west > 1 or north - south > 1:
            return None
        tiles = tuple(
            [self._tiles.get((south + k // 2, west + k % 2), self._empty) for k in range(4)]
        )
        found: Floats = self.loops.count_done_ahead(
            tiles,
            south,
            west,
            place,
            course,
            along_m,
            aside_m,
            self.cell_m,
            self._travelled_m,
            self.revisit_m,
            earlier,
        )
        return found

    def _mark_tile(
        self,
        row: int,
        column: int,
        south: int,
        west: int,
        passed: npt.NDArray[np.bool_],
        stamp: float,
    ) -> None:
        """Mark the part of `passed` (its corner at cell south, west) that is in one tile."""
        r0, c0 = row * TILE_CELLS, column * TILE_CELLS
        r = slice(max(south, r0), min(south + passed.shape[0], r0 + TILE_CELLS))
        c = slice(max(west, c0), min(west + passed.shape[1], c0 + TILE_CELLS))
        here = passed[r.start - south : r.stop - south, c.start - west : c.stop - west]
        if not here.any():
            return
        self._newest = row, column
        tile = self._tiles.get((row, column))
        if tile is None:
            tile = self._tiles[row, column] = _make_empty_tile()
        view = tile[r.start - r0 : r.stop - r0, c.start - c0 : c.stop - c0]
        stamps = view[here]
        self._cells += int(np.count_nonzero(np.isnan(stamps)))
        self._again += int(
            np.count_nonzero(is_passed_again(self._travelled_m, stamps, self.revisit_m))
        )
        view[here] = stamp


def _make_empty_tile() -> npt.NDArray[np.float32]:
    return np.full((TILE_CELLS, TILE_CELLS), np.nan, dtype=np.float32)


def _find_tile_box(tiles: Collection[tuple[int, int]]) -> tuple[int, int, int, int]:
    """Return the first and last row, and the first and last column, of the tiles."""
    rows, columns = [row for row, _ in tiles], [column for _, column in tiles]
    return min(rows), max(rows), min(columns), max(columns)


def _find_in_triangles(east: Floats, north: Floats, sides: Floats) -> npt.NDArray[np.bool_]:
    """Tell which positions (columns, rows) are in any of the triangles (k, 3, 6), edges included.

    All sides of all triangles are tested at once, because a call of numpy takes longer than the
    test of a few cells.
    """
    from_east, from_north, de, dn, hand, slack = sides.transpose(2, 0, 1)[..., None, None]
    within = find_side_offset(from_east, from_north, de, dn, hand, east, north) >= slack
    inside: npt.NDArray[np.bool_] = within.all(axis=1).any(axis=0)
    return inside
