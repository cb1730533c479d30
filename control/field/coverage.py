"""What of the field is done: a bitmap under the outlets, so that nothing is counted twice.

Resolution: a cell (0.2 m unless stated otherwise) counts when its centre was passed over. Over
whole passes the area is right to about a cell in width, in the mean over headings far better;
see the tests. Bitmap tiles come into being where work is done: 100 MB hold 100 ha.

Whatever places are given, a call's work is bounded: a stretch longer than `longest_m` is a jump
and not swept, places without business on a field's plane are left out, and a picture has at
most `MAX_CELLS`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.geodesy import Place, calc_plane_distance_m, find_unit_vector
from topdress.control.machine.steps import CompiledSteps

from .cells import (
    TILE_CELLS,
    Corners,
    Floats,
    allocate_sides,
    find_side_offset,
    is_passed_again,
    offset_places,
    put_triangle_sides,
)

_EARLIER_STAMP = -math.inf  # stamp of what an earlier run has done
# from the plane's origin: no place beyond it is one of the field
MAX_DISTANCE_M = 100_000.0
MAX_RASTER_CELLS = 400_000_000  # of a picture: 4 km by 4 km at 0.2 m, 400 MB


class Covered(NamedTuple):
    area_ha: float  # each place once
    overlap_ha: float  # what was passed over again, every time
    travelled_m: float


class Raster(NamedTuple):
    """A picture of the covered ground: `done[row, column]`, row 0 in the south, column 0 in the
    west."""

    west_m: float
    south_m: float
    cell_m: float
    done: npt.NDArray[np.bool_]


class _OutletBar(NamedTuple):
    """A row of outlets; `middle`: of the whole machine."""

    middle: Place
    left: Place
    right: Place


class _OutletStrip:
    """Outlets that flow together, and where their last stretch ended. Edges: m to the right of
    the middle."""

    def __init__(self, left_m: float, right_m: float) -> None:
        self.left_m, self.right_m = left_m, right_m
        self.bar: _OutletBar | None = None  # where the last stretch ended
        # worked up to this place, on this course, since: less than half a cell on
        self.saved: tuple[Place, float, float] | None = None

    def place_outlets(self, place: Place, east: float, north: float) -> _OutletBar:
        """Here, on a course of this direction."""
        return _OutletBar(
            place,
            (place[0] + self.left_m * north, place[1] - self.left_m * east),
            (place[0] + self.right_m * north, place[1] - self.right_m * east),
        )


class Coverage:
    """Fed with the middle of the outlets, tick by tick.

    A cell passed over again counts as overlap when the machine has travelled more than
    `revisit_m` since (three widths unless stated otherwise), so that a tight turn is not its
    own overlap. Two calls farther apart than `longest_m` are a jump of the position: no ground
    is passed over between them. strips: outlets that flow together, by their edges, m to the
    right of the middle; the whole width unless given otherwise. Raises ValueError for a width
    or a cell that is not above 0, or a cell larger than half the width.
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
        """steps: compiled, for long runs: cell by cell, in a third of the time."""
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
        # by row and column
        self._tiles: dict[tuple[int, int], npt.NDArray[np.float32]] = {}
        self._newest = (0, 0)  # tile that was entered last
        self._cells = self._again = 0
        self._travelled_m = 0.0
        self._last: Place | None = None
        self._strips = [
            _OutletStrip(left, right)
            for left, right in strips or ((-0.5 * width_m, 0.5 * width_m),)
        ]
        self._sides = allocate_sides()
        self._empty = _make_empty_tile()
        self.loops: Any = None if steps is None else steps.cells

    def add_earlier_ground(self, ground: Raster, ours: bool = True) -> None:
        """Ground that an earlier run has done, with cells of any size: covered, and never just
        passed over.

        A cell here counts when its centre lies in a done cell there. ours: False for the ground
        of another machine, which is no area that was covered here.
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
        """The middle of the outlets is here; `flowing`: material has been landing since the
        last call, where the coverage has strips of each of them.

        Stretches shorter than half a cell are saved up. A place that is not finite, or too far
        away to be one of the field, is left out, and breaks the stretch; so does a jump, after
        which it begins anew.
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
        """What `extend_to` is given where nothing flows."""
        return False if len(self._strips) == 1 else (False,) * len(self._strips)

    @property
    def covered_area(self) -> Covered:
        cell_ha = self.cell_m * self.cell_m / 10_000.0
        return Covered(self._cells * cell_ha, self._again * cell_ha, self._travelled_m)

    def find_covered(self, places: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether an earlier pass has covered each place (n, 2) -> (n,); the ground just passed
        over does not count.

        Some 20 us for a few hundred places near each other.
        """
        again: npt.NDArray[np.bool_] = is_passed_again(
            self._travelled_m, self._find_stamps(places), self.revisit_m
        )
        return again

    def find_covered_earlier(self, places: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether an earlier run has covered each place (n, 2) -> (n,), and this run has not
        since."""
        return np.isneginf(self._find_stamps(places))

    def _find_stamps(self, places: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """How far the machine had travelled when each place (n, 2) was covered last; NaN: never."""
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
        """All that is covered, for drawing; one cell of nothing when nothing is.

        Ground too far apart for one picture of `MAX_CELLS`: what lies around the place entered
        last. What is less than half a cell on counts too.
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

    def _end_stretch(self, strip: _OutletStrip, bar: _OutletBar | None) -> None:
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
        """Enter a stretch cell by cell. box: its cells, south, west, north, east."""
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
        """How many places aside are over done ground at each place along: (along,). None: it is
        to be asked by `find_covered`, for want of compiled loops or because the places lie far
        apart.

        place, course: of the outlets' middle, east and north. earlier: as of
        `find_covered_earlier`.
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
        """Enter the part of `passed` (its corner at cell south, west) that lies in one tile."""
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
    """First and last row, first and last column."""
    rows, columns = [row for row, _ in tiles], [column for _, column in tiles]
    return min(rows), max(rows), min(columns), max(columns)


def _find_in_triangles(east: Floats, north: Floats, sides: Floats) -> npt.NDArray[np.bool_]:
    """Which of the places (columns, rows) lie in any of the triangles (k, 3, 6), edges included.

    All sides of all triangles at once: their few cells take numpy less time than a call of it.
    """
    from_east, from_north, de, dn, hand, slack = sides.transpose(2, 0, 1)[..., None, None]
    within = find_side_offset(from_east, from_north, de, dn, hand, east, north) >= slack
    inside: npt.NDArray[np.bool_] = within.all(axis=1).any(axis=0)
    return inside
