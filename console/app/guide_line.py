"""A guidance line from A to B: how far the machine is off the nearest of its parallels. It
shows; it does not steer. Pure.

Places are east and north, m, of the plane on which the frames tell them. The parallels lie a
working width apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, degrees, hypot
from typing import NamedTuple

from topdress.console.app.camera import MapCamera

# from A to B: below it the noise of a fix turns the line by degrees
LEAST_LENGTH_M = 10.0
DRAWN_BEYOND_M = 10_000.0  # so far the line is drawn beyond its ends
# driven the other way round, left and right change sides
TURNED_DEG = 90.0

Place = tuple[float, float]


class TrackOffset(NamedTuple):
    """Holds the distance from a track. right_m: how far the machine is to the right of the nearest
    track, as it drives; number: of that track, to the right of A to B positive."""

    right_m: float
    number: int


@dataclass(slots=True)
class GuideLine:
    """Holds a line. a, b: its ends, None while they are not set."""

    a: Place | None = None
    b: Place | None = None
    width_m: float = 0.0

    @property
    def is_set(self) -> bool:
        """Whether both ends are set."""
        return self.a is not None and self.b is not None and self.width_m > 0.0

    def set_begin(self, a: Place, width_m: float) -> None:
        """Set A, and forget B."""
        self.a, self.b, self.width_m = a, None, width_m

    def set_end(self, b: Place) -> bool:
        """Set B and return true, if it is far enough from A; else false."""
        if self.a is None or hypot(b[0] - self.a[0], b[1] - self.a[1]) < LEAST_LENGTH_M:
            return False
        self.b = b
        return True

    def clear_ends(self) -> None:
        """Forget the line."""
        self.a = self.b = None

    @property
    def heading_deg(self) -> float:
        """Heading from A to B, degrees from north."""
        assert self.a is not None and self.b is not None
        return degrees(atan2(self.b[0] - self.a[0], self.b[1] - self.a[1])) % 360.0

    def find_offset(self, place: Place, heading_deg: float | None) -> TrackOffset | None:
        """Distance from the nearest track; None while there is no line."""
        if self.a is None or self.b is None or self.width_m <= 0.0:
            return None
        east, north = self.b[0] - self.a[0], self.b[1] - self.a[1]
        long_m = hypot(east, north)
        right_m = ((place[0] - self.a[0]) * north - (place[1] - self.a[1]) * east) / long_m
        number = round(right_m / self.width_m)
        off_m = right_m - number * self.width_m
        if (
            heading_deg is not None
            and abs((heading_deg - self.heading_deg + 180.0) % 360.0 - 180.0) > TURNED_DEG
        ):
            off_m = -off_m
        return TrackOffset(off_m, number)

    def list_drawn_lines(self, camera: MapCamera) -> tuple[tuple[Place, ...], ...]:
        """The line through A and B over the ground in sight, for a map."""
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
