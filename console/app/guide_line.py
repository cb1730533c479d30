"""Calculates how far the machine is off the nearest parallel of a guidance line from A to B. The
line is shown; nothing steers. Pure.

Positions are east and north, m, in the plane of the frames. The parallels are one working width
apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, degrees, hypot
from typing import NamedTuple

from topdress.console.app.map_camera import MapCamera

# Shortest distance from A to B, m: below it the noise of a fix rotates the line by degrees.
MIN_LINE_LENGTH_M = 10.0
# Distance to which the line is drawn beyond its ends, m.
DRAWN_BEYOND_M = 10_000.0
# Beyond this difference of heading the machine drives from B to A, where left and right are
# exchanged.
OPPOSITE_HEADING_DEG = 90.0

Place = tuple[float, float]


class TrackOffset(NamedTuple):
    """Holds the offset from a track.

    Attributes
    ----------
    right_m
        Distance to the right of the nearest track, m, seen in driving direction.
    number
        Number of the track; tracks to the right of the direction A to B are positive.
    """

    right_m: float
    number: int


@dataclass(slots=True)
class GuideLine:
    """Holds a line; its ends `a` and `b` are None until the operator sets them."""

    a: Place | None = None
    b: Place | None = None
    width_m: float = 0.0

    @property
    def is_set(self) -> bool:
        """Whether both ends are set."""
        return self.a is not None and self.b is not None and self.width_m > 0.0

    def set_begin(self, a: Place, width_m: float) -> None:
        """Set A and remove B."""
        self.a, self.b, self.width_m = a, None, width_m

    def set_end(self, b: Place) -> bool:
        """Set B and return True if it is at least `MIN_LINE_LENGTH_M` from A; otherwise return
        False."""
        if self.a is None or hypot(b[0] - self.a[0], b[1] - self.a[1]) < MIN_LINE_LENGTH_M:
            return False
        self.b = b
        return True

    def clear_ends(self) -> None:
        """Remove the line."""
        self.a = self.b = None

    @property
    def heading_deg(self) -> float:
        """Heading from A to B, degrees clockwise from north."""
        assert self.a is not None and self.b is not None
        return degrees(atan2(self.b[0] - self.a[0], self.b[1] - self.a[1])) % 360.0

    def find_offset(self, place: Place, heading_deg: float | None) -> TrackOffset | None:
        """Return the offset from the nearest track; None without a line.

        Parameters
        ----------
        place
            East and north of the machine, m.
        heading_deg
            Heading of the machine; None assumes the direction from A to B.
        """
        if self.a is None or self.b is None or self.width_m <= 0.0:
            return None
        east, north = self.b[0] - self.a[0], self.b[1] - self.a[1]
        long_m = hypot(east, north)
        # The cross product divided by the length is the distance to the right of the line.
        right_m = ((place[0] - self.a[0]) * north - (place[1] - self.a[1]) * east) / long_m
        number = round(right_m / self.width_m)
        off_m = right_m - number * self.width_m
        if (
            heading_deg is not None
            and abs((heading_deg - self.heading_deg + 180.0) % 360.0 - 180.0) > OPPOSITE_HEADING_DEG
        ):
            off_m = -off_m
        return TrackOffset(off_m, number)

    def list_drawn_lines(self, camera: MapCamera) -> tuple[tuple[Place, ...], ...]:
        """Return the line through A and B across the visible ground, for a map."""
        if self.a is None or self.b is None:
            return ()
        east, north = self.b[0] - self.a[0], self.b[1] - self.a[1]
        far = min(DRAWN_BEYOND_M, 500.0 * camera.metres) / hypot(east, north)
        return (
            (
                (self.a[0] - far * east, self.a[1] - far * north),
                (self.a[0] + far * east, self.a[1] + far * north),
            ),
        )
