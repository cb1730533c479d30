"""Records a field's boundary while the machine drives round the field: antenna positions, moved
sideways to the edge. Pure.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from topdress.control.geodesy import Place, TangentPlane, calc_plane_distance_m, offset_place
from topdress.control.log_row import LogRow

# Distance between two corners, m: finer than any edge of a field, and 20,000 corners still cover 40
# km.
MIN_CORNER_GAP_M = 2.0
# A ring of fewer corners encloses no usable area.
MIN_CORNERS = 4
# Dead reckoning (NMEA quality 6) and manual input (7) are excluded, because the edge must come from
# measured positions.
MEASURED_FIX_QUALITIES = (1, 2, 4, 5)


class Corner(NamedTuple):
    """Holds one antenna position with the heading of the machine, deg."""

    lat_deg: float
    lon_deg: float
    heading_deg: float


@dataclass(slots=True)
class BoundaryDrive:
    """Records the boundary that the machine drives along.

    Attributes
    ----------
    right_m
        Distance of the edge to the right of the antenna's way, m; negative means to the left.
    corners
        Antenna positions so far.
    way_m
        Length of the way so far, m.
    """

    right_m: float
    corners: list[Corner] = field(default_factory=list)
    way_m: float = 0.0
    _plane: TangentPlane | None = None

    def add_row(self, row: LogRow) -> None:
        """Add the position of a log row. A row without fix or heading is ignored, and so is a
        position closer than `MIN_CORNER_GAP_M` to the last corner."""
        if (
            row.lat_deg is None
            or row.lon_deg is None
            or row.heading_deg is None
            or row.fix_quality not in MEASURED_FIX_QUALITIES
        ):
            return
        self.add_corner(Corner(row.lat_deg, row.lon_deg, row.heading_deg))

    def add_corner(self, corner: Corner) -> None:
        """Add a corner, unless the distance to the last corner is less than `MIN_CORNER_GAP_M`."""
        # The first corner is the origin of the plane: fields are small enough for one tangent
        # plane.
        if self._plane is None:
            self._plane = TangentPlane(corner.lat_deg, corner.lon_deg)
        if self.corners:
            step_m = calc_plane_distance_m(
                self._convert_to_m(self.corners[-1]), self._convert_to_m(corner)
            )
            if step_m < MIN_CORNER_GAP_M:
                return
            self.way_m += step_m
        self.corners.append(corner)

    def _convert_to_m(self, corner: Corner) -> Place:
        assert self._plane is not None
        return self._plane.project_to_m(corner.lat_deg, corner.lon_deg)

    @property
    def closing_gap_m(self) -> float:
        """Distance from the end of the way back to its beginning, m."""
        return (
            calc_plane_distance_m(
                self._convert_to_m(self.corners[-1]), self._convert_to_m(self.corners[0])
            )
            if len(self.corners) > 1
            else 0.0
        )

    @property
    def is_closable(self) -> bool:
        """Whether the way is long enough to be closed to a ring."""
        # A straight way has a closing gap as long as itself; the factor 2 excludes a way that has
        # not turned back.
        return len(self.corners) >= MIN_CORNERS and self.way_m > 2.0 * self.closing_gap_m

    def make_edge_ring_deg(self) -> tuple[tuple[float, float], ...]:
        """Return the edge as latitude and longitude, deg, in driving order."""
        plane = self._plane
        if plane is None:
            return ()
        return tuple(
            plane.convert_to_deg(
                *offset_place(self._convert_to_m(one), one.heading_deg, 0.0, self.right_m)
            )
            for one in self.corners
        )
