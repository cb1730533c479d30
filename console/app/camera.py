"""Where a map looks: its middle and how many metres a pixel is; a cell of the terminal is two
square pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.console.app.coverage_raster import Box

Floats = npt.NDArray[np.float64]
SCALES_M = (
    0.25,
    0.5,
    1.0,
    1.5,
    2.0,
    3.0,
    4.0,
    5.0,
    7.5,
    10.0,
    15.0,
    20.0,
    30.0,
    50.0,
    75.0,
    100.0,
    200.0,
)
LEAST_SPAN_M = 40.0
# following, the middle moves when the machine comes this near to an edge
EDGE_SHARE = 0.25


class PixelGrid(NamedTuple):
    """Describes columns x rows pixels. west and north: of the upper left pixel's corner, m; metres:
    of a pixel. halved: it is half as wide as high, a quarter of a cell of the terminal."""

    columns: int
    rows: int
    metres: float
    west_m: float
    north_m: float
    halved: bool = False

    @property
    def pixel_width_m(self) -> float:
        """Width of a pixel, m."""
        return 0.5 * self.metres if self.halved else self.metres

    def halve_pixels(self) -> PixelGrid:
        """The same ground in pixels of half the width."""
        return self._replace(columns=2 * self.columns, halved=True)

    def find_pixel(self, east_m: float, north_m: float) -> tuple[int, int]:
        """Column and row of the pixel of a place; it may lie outside."""
        return int((east_m - self.west_m) // self.pixel_width_m), int(
            (self.north_m - north_m) // self.metres
        )

    def find_middle(self, column: float, row: float) -> tuple[float, float]:
        """East and north of a pixel's middle, m."""
        return self.west_m + (column + 0.5) * self.pixel_width_m, self.north_m - (
            row + 0.5
        ) * self.metres

    def list_middles(self) -> tuple[Floats, Floats]:
        """East of every column and north of every row, m."""
        columns, rows = (
            np.arange(self.columns, dtype=np.float64),
            np.arange(self.rows, dtype=np.float64),
        )
        return self.west_m + (columns + 0.5) * self.pixel_width_m, self.north_m - (
            rows + 0.5
        ) * self.metres


class MapCamera(NamedTuple):
    """Holds the place at which a map looks."""

    east_m: float
    north_m: float
    metres: float

    def make_grid(self, columns: int, rows: int) -> PixelGrid:
        """The ground seen on columns x rows pixels; edges of pixels lie on multiples of their
        size."""
        west = round(self.east_m / self.metres - columns / 2) * self.metres
        north = round(self.north_m / self.metres + rows / 2) * self.metres
        return PixelGrid(columns, rows, self.metres, west, north)

    def zoom_steps(self, steps: int) -> MapCamera:
        """The camera zoomed; steps > 0: nearer."""
        at = min(range(len(SCALES_M)), key=lambda k: abs(SCALES_M[k] - self.metres))
        return self._replace(metres=SCALES_M[max(0, min(len(SCALES_M) - 1, at - steps))])

    def move_pixels(self, columns: float, rows: float) -> MapCamera:
        """The camera moved by pixels, to the right and up."""
        return self._replace(
            east_m=self.east_m + columns * self.metres, north_m=self.north_m + rows * self.metres
        )

    def follow_place(self, place: tuple[float, float], columns: int, rows: int) -> MapCamera:
        """The same camera while the place is well inside; else with the place in the middle."""
        column, row = self.make_grid(columns, rows).find_pixel(*place)
        inside = (EDGE_SHARE * columns <= column < (1 - EDGE_SHARE) * columns) and (
            EDGE_SHARE * rows <= row < (1 - EDGE_SHARE) * rows
        )
        return self if inside else self._replace(east_m=place[0], north_m=place[1])


def fit_box(box: Box | None, columns: int, rows: int, snug: bool = False) -> MapCamera:
    """The nearest round scale at which a box is seen whole on columns x rows pixels, and calm while
    it grows. snug: as large as it can be."""
    box, edge = box or Box(0.0, 0.0, 0.0, 0.0), 1 if snug else 4
    need = max(
        (box.east_m - box.west_m) / max(1, columns - edge),
        (box.north_m - box.south_m) / max(1, rows - edge),
        LEAST_SPAN_M / max(1, min(columns, rows)),
    )
    metres = need if snug else next((scale for scale in SCALES_M if scale >= need), need)
    return MapCamera(0.5 * (box.west_m + box.east_m), 0.5 * (box.south_m + box.north_m), metres)


def unite_boxes(*boxes: Box | None) -> Box | None:
    """One box round all of them."""
    known = [box for box in boxes if box is not None]
    if not known:
        return None
    wests, souths, easts, norths = zip(*known, strict=True)
    return Box(min(wests), min(souths), max(easts), max(norths))
