"""Defines the part of the ground that a map shows: its middle and the size of a pixel in metres. A
terminal cell has two square pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.console.app.coverage_raster import GroundBox

Floats = npt.NDArray[np.float64]
# Sizes of a pixel in metres that zooming offers; round values keep the scale bar readable.
PIXEL_SIZES_M = (
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
# A box smaller than this, m, is not magnified further: GNSS noise would fill the picture.
MIN_MAP_SPAN_M = 40.0
# While the map follows the machine, the map moves when the machine comes closer to an edge than
# this share of the picture.
FOLLOW_EDGE_SHARE = 0.25


class PixelGrid(NamedTuple):
    """Describes a grid of pixels on the ground.

    Attributes
    ----------
    columns, rows
        Number of pixels.
    metres
        Height of a pixel, m, and its width where `halved` is False.
    west_m, north_m
        Upper left corner of the upper left pixel, m.
    halved
        True if a pixel is half as wide as high (a quarter of a terminal cell).
    """

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
        """Return a grid of the same ground with pixels of half the width."""
        return self._replace(columns=2 * self.columns, halved=True)

    def find_pixel(self, east_m: float, north_m: float) -> tuple[int, int]:
        """Return column and row of the pixel at a position, which may lie outside the grid."""
        return int((east_m - self.west_m) // self.pixel_width_m), int(
            (self.north_m - north_m) // self.metres
        )

    def find_middle(self, column: float, row: float) -> tuple[float, float]:
        """Return east and north of a pixel's centre, m."""
        return self.west_m + (column + 0.5) * self.pixel_width_m, self.north_m - (
            row + 0.5
        ) * self.metres

    def list_middles(self) -> tuple[Floats, Floats]:
        """Return the east coordinate of every column's centre and the north coordinate of every
        row's centre, m."""
        columns, rows = (
            np.arange(self.columns, dtype=np.float64),
            np.arange(self.rows, dtype=np.float64),
        )
        return self.west_m + (columns + 0.5) * self.pixel_width_m, self.north_m - (
            rows + 0.5
        ) * self.metres


class MapCamera(NamedTuple):
    """Holds the position in the middle of a map and the size of a pixel, m."""

    east_m: float
    north_m: float
    metres: float

    def make_grid(self, columns: int, rows: int) -> PixelGrid:
        """Return the grid of the visible ground in columns x rows pixels.

        Pixel edges lie on multiples of the pixel size, so that a moving map does not flicker.
        """
        # Rounding to whole pixels keeps cells and pixels aligned while the map moves.
        west = round(self.east_m / self.metres - columns / 2) * self.metres
        north = round(self.north_m / self.metres + rows / 2) * self.metres
        return PixelGrid(columns, rows, self.metres, west, north)

    def zoom_steps(self, steps: int) -> MapCamera:
        """Return the camera zoomed by steps of `PIXEL_SIZES_M`; positive steps magnify."""
        # A camera fitted to a box has a size between two steps.
        at = min(range(len(PIXEL_SIZES_M)), key=lambda k: abs(PIXEL_SIZES_M[k] - self.metres))
        return self._replace(metres=PIXEL_SIZES_M[max(0, min(len(PIXEL_SIZES_M) - 1, at - steps))])

    def move_pixels(self, columns: float, rows: float) -> MapCamera:
        """Return the camera moved to the right and up by a number of pixels."""
        return self._replace(
            east_m=self.east_m + columns * self.metres, north_m=self.north_m + rows * self.metres
        )

    def follow_place(self, place: tuple[float, float], columns: int, rows: int) -> MapCamera:
        """Return the camera itself while the position is well inside the picture, else the camera
        centred on the position."""
        column, row = self.make_grid(columns, rows).find_pixel(*place)
        # Well inside means at least a quarter of the picture from each edge.
        inside = (FOLLOW_EDGE_SHARE * columns <= column < (1 - FOLLOW_EDGE_SHARE) * columns) and (
            FOLLOW_EDGE_SHARE * rows <= row < (1 - FOLLOW_EDGE_SHARE) * rows
        )
        return self if inside else self._replace(east_m=place[0], north_m=place[1])


def fit_box(box: GroundBox | None, columns: int, rows: int, snug: bool = False) -> MapCamera:
    """Return the camera that shows a whole box on columns x rows pixels.

    Parameters
    ----------
    box
        Ground to show; None means the origin.
    columns, rows
        Size of the picture in pixels.
    snug
        True: the box fills the picture. False: the next round scale, so that a growing box rarely
        changes the scale.
    """
    # The margin of two pixels on each side keeps the outline visible.
    box, edge = box or GroundBox(0.0, 0.0, 0.0, 0.0), 1 if snug else 4
    need = max(
        (box.east_m - box.west_m) / max(1, columns - edge),
        (box.north_m - box.south_m) / max(1, rows - edge),
        MIN_MAP_SPAN_M / max(1, min(columns, rows)),
    )
    metres = need if snug else next((scale for scale in PIXEL_SIZES_M if scale >= need), need)
    return MapCamera(0.5 * (box.west_m + box.east_m), 0.5 * (box.south_m + box.north_m), metres)


def unite_boxes(*boxes: GroundBox | None) -> GroundBox | None:
    """Return the smallest box that contains all given boxes, or None without a box."""
    known = [box for box in boxes if box is not None]
    if not known:
        return None
    wests, souths, easts, norths = zip(*known, strict=True)
    return GroundBox(min(wests), min(souths), max(easts), max(norths))
