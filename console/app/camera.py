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
EDGE = 0.25


class Pixels(NamedTuple):
    """columns x rows pixels; west and north: of the upper left pixel's corner, m; metres: of a
    pixel. halved: it is half as wide as high, a quarter of a cell of the terminal."""

    columns: int
    rows: int
    metres: float
    west_m: float
    north_m: float
    halved: bool = False

    @property
    def wide_m(self) -> float:
        return 0.5 * self.metres if self.halved else self.metres

    def quarters(self) -> Pixels:
        """The same ground in pixels of half the width."""
        return self._replace(columns=2 * self.columns, halved=True)

    def at(self, east_m: float, north_m: float) -> tuple[int, int]:
        """Column and row of the pixel of a place; it may lie outside."""
        return int((east_m - self.west_m) // self.wide_m), int(
            (self.north_m - north_m) // self.metres
        )

    def place(self, column: float, row: float) -> tuple[float, float]:
        """East and north of a pixel's middle, m."""
        return self.west_m + (column + 0.5) * self.wide_m, self.north_m - (row + 0.5) * self.metres

    def middles(self) -> tuple[Floats, Floats]:
        """East of every column and north of every row, m."""
        columns, rows = (
            np.arange(self.columns, dtype=np.float64),
            np.arange(self.rows, dtype=np.float64),
        )
        return self.west_m + (columns + 0.5) * self.wide_m, self.north_m - (
            rows + 0.5
        ) * self.metres


class MapCamera(NamedTuple):
    east_m: float
    north_m: float
    metres: float

    def pixels(self, columns: int, rows: int) -> Pixels:
        """What is seen on columns x rows pixels; edges of pixels lie on multiples of their size."""
        west = round(self.east_m / self.metres - columns / 2) * self.metres
        north = round(self.north_m / self.metres + rows / 2) * self.metres
        return Pixels(columns, rows, self.metres, west, north)

    def zoomed(self, steps: int) -> MapCamera:
        """steps > 0: nearer."""
        at = min(range(len(SCALES_M)), key=lambda k: abs(SCALES_M[k] - self.metres))
        return self._replace(metres=SCALES_M[max(0, min(len(SCALES_M) - 1, at - steps))])

    def moved(self, columns: float, rows: float) -> MapCamera:
        """By pixels, to the right and up."""
        return self._replace(
            east_m=self.east_m + columns * self.metres, north_m=self.north_m + rows * self.metres
        )

    def following(self, place: tuple[float, float], columns: int, rows: int) -> MapCamera:
        """The same while the place is well inside; else with the place in the middle."""
        column, row = self.pixels(columns, rows).at(*place)
        inside = (EDGE * columns <= column < (1 - EDGE) * columns) and (
            EDGE * rows <= row < (1 - EDGE) * rows
        )
        return self if inside else self._replace(east_m=place[0], north_m=place[1])


def fit(box: Box | None, columns: int, rows: int, snug: bool = False) -> MapCamera:
    """The nearest round scale at which a box is seen whole on columns x rows pixels, and calm
    while it grows. snug: as large as it can be."""
    box, edge = box or Box(0.0, 0.0, 0.0, 0.0), 1 if snug else 4
    need = max(
        (box.east_m - box.west_m) / max(1, columns - edge),
        (box.north_m - box.south_m) / max(1, rows - edge),
        LEAST_SPAN_M / max(1, min(columns, rows)),
    )
    metres = need if snug else next((scale for scale in SCALES_M if scale >= need), need)
    return MapCamera(0.5 * (box.west_m + box.east_m), 0.5 * (box.south_m + box.north_m), metres)


def around(*boxes: Box | None) -> Box | None:
    """One box round all of them."""
    known = [box for box in boxes if box is not None]
    if not known:
        return None
    wests, souths, easts, norths = zip(*known, strict=True)
    return Box(min(wests), min(souths), max(easts), max(norths))
