"""How are degrees converted to metres on WGS84, and how are headings and offsets calculated?

A place is (east_m, north_m) on a tangent plane; a heading is degrees clockwise from north."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

# East and north on a tangent plane, m.
Place = tuple[float, float]
Floats = npt.NDArray[np.float64]

# Semi-major axis of the WGS84 ellipsoid, m.
SEMI_MAJOR_M = 6_378_137.0
# Flattening of the WGS84 ellipsoid.
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)
# Earth radius of paper B, eq 3, m: the polar radius.
PAPER_RADIUS_M = 6_356_755.0


@dataclass(frozen=True)
class TangentPlane:
    """Projects places to the plane that touches the WGS84 ellipsoid at an origin: east and north
    in metres, height taken as zero.

    The projection is rigorous (earth-centred coordinates, rotated), so that no limit of validity
    has to be watched: lengths on the plane are shorter than on the ellipsoid by d^3 / 6R^2, 0.03
    mm over 2 km, 4 mm over 10 km. Raises ValueError for an origin outside -90 to 90 and -180 to
    180 degrees."""

    lat_deg: float
    lon_deg: float

    def __post_init__(self) -> None:
        if not (-90.0 <= self.lat_deg <= 90.0 and -180.0 <= self.lon_deg <= 180.0):
            raise ValueError(
                f"origin {self.lat_deg}, {self.lon_deg}: allowed is latitude -90 to 90, "
                "longitude -180 to 180"
            )

    @cached_property
    def _trigonometry(self) -> tuple[float, float, float]:
        lat = math.radians(self.lat_deg)
        return (
            math.sin(lat),
            math.cos(lat),
            math.sqrt(1.0 - ECCENTRICITY_SQUARED * math.sin(lat) ** 2),
        )

    def project_to_m(self, lat_deg: float, lon_deg: float) -> Place:
        """Returns east and north of a place, m."""
        sin0, cos0, root0 = self._trigonometry
        lat, turn = math.radians(lat_deg), math.radians(lon_deg - self.lon_deg)
        sin1, cos1 = math.sin(lat), math.cos(lat)
        normal0 = SEMI_MAJOR_M / root0
        normal1 = SEMI_MAJOR_M / math.sqrt(1.0 - ECCENTRICITY_SQUARED * sin1 * sin1)
        outward = normal1 * cos1 * math.cos(turn) - normal0 * cos0
        upward = (1.0 - ECCENTRICITY_SQUARED) * (normal1 * sin1 - normal0 * sin0)
        return normal1 * cos1 * math.sin(turn), cos0 * upward - sin0 * outward

    def project_many_to_m(self, lat_deg: npt.ArrayLike, lon_deg: npt.ArrayLike) -> Floats:
        """Projects the places of a whole log: (n,), (n,) degrees -> (n, 2) east and north, m.
        NaN stays NaN."""
        sin0, cos0, root0 = self._trigonometry
        lat = np.radians(np.asarray(lat_deg, dtype=np.float64))
        turn = np.radians(np.asarray(lon_deg, dtype=np.float64) - self.lon_deg)
        normal0 = SEMI_MAJOR_M / root0
        normal1 = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(lat) ** 2)
        outward = normal1 * np.cos(lat) * np.cos(turn) - normal0 * cos0
        upward = (1.0 - ECCENTRICITY_SQUARED) * (normal1 * np.sin(lat) - normal0 * sin0)
        return np.column_stack(
            (normal1 * np.cos(lat) * np.sin(turn), cos0 * upward - sin0 * outward)
        )

    def convert_to_deg(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Returns latitude and longitude of a place on the plane, degrees. The inverse of
        `project_to_m` to better than 1 um in 20 km.

        Raises
        ------
        ValueError : the place is beyond 100 km, where no field's plane reaches."""
        if not math.hypot(east_m, north_m) <= 100_000.0:
            raise ValueError(
                f"place {east_m:g}, {north_m:g} m: allowed is within 100 km of the origin"
            )
        meridian, parallel = self._metres_per_degree
        lat, lon = self.lat_deg, self.lon_deg
        for _ in range(6):
            east, north = self.project_to_m(lat, lon)
            lat += (north_m - north) / meridian
            lon += (east_m - east) / parallel
        return lat, math.remainder(lon, 360.0)

    @cached_property
    def _metres_per_degree(self) -> tuple[float, float]:
        _, cos0, root0 = self._trigonometry
        meridian = SEMI_MAJOR_M * (1.0 - ECCENTRICITY_SQUARED) / root0**3
        parallel = SEMI_MAJOR_M / root0 * max(cos0, 1e-6)
        return math.radians(meridian), math.radians(parallel)


def calc_ellipsoid_distance_m(
    lat1_deg: float, lon1_deg: float, lat2_deg: float, lon2_deg: float
) -> float:
    """Returns the distance of two places on the WGS84 ellipsoid, m: the straight chord,
    lengthened to its arc.

    Keeps its digits at millimetres; within 1 mm of the geodesic up to 20 km."""
    dx, dy, dz = (
        b - a
        for a, b in zip(
            _convert_to_earth_centred(lat1_deg, lon1_deg),
            _convert_to_earth_centred(lat2_deg, lon2_deg),
            strict=True,
        )
    )
    chord = math.sqrt(dx * dx + dy * dy + dz * dz)
    sin_mid = math.sin(math.radians(0.5 * (lat1_deg + lat2_deg)))
    radius = (
        SEMI_MAJOR_M
        * math.sqrt(1.0 - ECCENTRICITY_SQUARED)
        / (1.0 - ECCENTRICITY_SQUARED * sin_mid**2)
    )
    return 2.0 * radius * math.asin(min(1.0, 0.5 * chord / radius))


def calc_paper_distance_m(
    lat1_deg: float, lon1_deg: float, lat2_deg: float, lon2_deg: float
) -> float:
    """Returns the distance by paper B, eq 3, as printed: R arccos(sinY1 sinY2 cos(X1 - X2) +
    cosY1 cosY2). For reproduction only.

    The cosine of the longitude difference stands with the wrong product, so that east-west
    distances become tan(latitude) of the true ones: 8.39 m for 10 m at 40 N. The radius is the
    polar one, and the arccosine loses digits at metre distances. Nothing in control uses it; see
    `distance_m`."""
    y1, y2 = math.radians(lat1_deg), math.radians(lat2_deg)
    turn = math.radians(lon1_deg - lon2_deg)
    cosine = math.sin(y1) * math.sin(y2) * math.cos(turn) + math.cos(y1) * math.cos(y2)
    return PAPER_RADIUS_M * math.acos(max(-1.0, min(1.0, cosine)))


def calc_corrected_paper_distance_m(
    lat1_deg: float, lon1_deg: float, lat2_deg: float, lon2_deg: float
) -> float:
    """Returns the distance by paper B, eq 3, with its products corrected, on the paper's own
    polar radius. For reproduction only.

    East-west distances are still 0.47 % short at 40 N, because of the radius."""
    y1, y2 = math.radians(lat1_deg), math.radians(lat2_deg)
    turn = math.radians(lon1_deg - lon2_deg)
    cosine = math.sin(y1) * math.sin(y2) + math.cos(y1) * math.cos(y2) * math.cos(turn)
    return PAPER_RADIUS_M * math.acos(max(-1.0, min(1.0, cosine)))


def calc_turn_deg(from_deg: float, to_deg: float) -> float:
    """Returns the shorter turn from one heading to another, above -180 to 180 degrees; clockwise
    is positive."""
    turn = math.remainder(to_deg - from_deg, 360.0)
    return 180.0 if turn == -180.0 else turn


def find_unit_vector(heading: float) -> Place:
    """Returns the unit vector (east, north) of a heading in degrees."""
    angle = math.radians(heading)
    return math.sin(angle), math.cos(angle)


def offset_place(place: Place, heading: float, forward_m: float, right_m: float = 0.0) -> Place:
    """Returns the place so far ahead and to the right of another along a heading in degrees
    (lever arms)."""
    east, north = find_unit_vector(heading)
    return (
        place[0] + forward_m * east + right_m * north,
        place[1] + forward_m * north - right_m * east,
    )


def calc_plane_distance_m(one: Place, other: Place) -> float:
    """Returns the distance of two places on the plane, m."""
    return math.hypot(other[0] - one[0], other[1] - one[1])


def _convert_to_earth_centred(lat_deg: float, lon_deg: float) -> tuple[float, float, float]:
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    normal = SEMI_MAJOR_M / math.sqrt(1.0 - ECCENTRICITY_SQUARED * math.sin(lat) ** 2)
    return (
        normal * math.cos(lat) * math.cos(lon),
        normal * math.cos(lat) * math.sin(lon),
        normal * (1.0 - ECCENTRICITY_SQUARED) * math.sin(lat),
    )
