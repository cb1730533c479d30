"""A field's boundary by driving round it: the places of the antenna, moved to the side where
the edge is. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from topdress.control.geodesy import Place, TangentPlane, calc_plane_distance_m, offset_place
from topdress.control.log_row import LogRow

# of two corners: finer than any edge of a field, and 20,000 of them are 40 km
CORNER_GAP_M = 2.0
LEAST_CORNERS = 4
# no dead reckoning: the edge is where the receiver says
FIX_QUALITIES = (1, 2, 4, 5)


class Corner(NamedTuple):
    """Holds a corner of the antenna's way."""

    lat_deg: float
    lon_deg: float
    heading_deg: float


@dataclass(slots=True)
class BoundaryDrive:
    """Records a boundary. right_m: the edge lies so far to the right of the antenna's way;
    negative: to the left."""

    right_m: float
    corners: list[Corner] = field(default_factory=list)
    way_m: float = 0.0
    _plane: TangentPlane | None = None

    def add_row(self, row: LogRow) -> None:
        """Add a row of the run; those without a fix or a course, and those too near to the last
        corner, are left out."""
        if (
            row.lat_deg is None
            or row.lon_deg is None
            or row.heading_deg is None
            or row.fix_quality not in FIX_QUALITIES
        ):
            return
        self.add_corner(Corner(row.lat_deg, row.lon_deg, row.heading_deg))

    def add_corner(self, corner: Corner) -> None:
        """Add a corner; it is left out where it is too near to the last one."""
        if self._plane is None:
            self._plane = TangentPlane(corner.lat_deg, corner.lon_deg)
        if self.corners:
            step_m = calc_plane_distance_m(
                self._convert_to_m(self.corners[-1]), self._convert_to_m(corner)
            )
            if step_m < CORNER_GAP_M:
                return
            self.way_m += step_m
        self.corners.append(corner)

    def _convert_to_m(self, corner: Corner) -> Place:
        assert self._plane is not None
        return self._plane.project_to_m(corner.lat_deg, corner.lon_deg)

    @property
    def closing_gap_m(self) -> float:
        """Distance from the end back to the beginning, m."""
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
        return len(self.corners) >= LEAST_CORNERS and self.way_m > 2.0 * self.closing_gap_m

    def make_ring_deg(self) -> tuple[tuple[float, float], ...]:
        """The edge as latitude and longitude, in the order in which it was driven."""
        plane = self._plane
        if plane is None:
            return ()
        return tuple(
            plane.convert_to_deg(
                *offset_place(self._convert_to_m(one), one.heading_deg, 0.0, self.right_m)
            )
            for one in self.corners
        )
