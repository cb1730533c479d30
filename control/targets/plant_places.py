"""Where along the track do the plants stand? From a list in degrees, or from a camera."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from topdress.control.geodesy import Place, TangentPlane, find_unit_vector

Floats = npt.NDArray[np.float64]


class PlantList:
    """Holds plants on the field's plane. lat_lon_deg: (n, 2)."""

    def __init__(self, lat_lon_deg: npt.ArrayLike, plane: TangentPlane) -> None:
        degrees = np.asarray(lat_lon_deg, dtype=np.float64).reshape(-1, 2)
        self.places_m: Floats = plane.project_many_to_m(degrees[:, 0], degrees[:, 1])
        self.plane = plane
        # The tree finds the plants near a machine among hundreds of thousands.
        self._tree = shapely.STRtree(shapely.points(self.places_m))

    def find_plants_ahead_m(
        self, place: Place, heading_deg: float, farthest_m: float, half_width_m: float
    ) -> list[float]:
        """Returns the distances ahead of the plants in a strip along the heading, m, rising;
        plants next to the strip are left out."""
        east, north = find_unit_vector(heading_deg)
        far = (place[0] + farthest_m * east, place[1] + farthest_m * north)
        # A box around the way is a fast first selection; the exact strip follows.
        reach = shapely.box(
            min(place[0], far[0]) - half_width_m,
            min(place[1], far[1]) - half_width_m,
            max(place[0], far[0]) + half_width_m,
            max(place[1], far[1]) + half_width_m,
        )
        offset = self.places_m[self._tree.query(reach)] - np.asarray(place)
        ahead = offset[:, 0] * east + offset[:, 1] * north
        aside = offset[:, 0] * north - offset[:, 1] * east
        return sorted(
            ahead[(ahead > 0.0) & (ahead <= farthest_m) & (np.abs(aside) <= half_width_m)].tolist()
        )


class TrackedPlant(NamedTuple):
    """Holds a plant in a camera's picture: its distance ahead of the outlet at the moment
    when the outlet was at `track_m`.

    The time stamp removes the camera's computing time (point paper: 1.5 s) from the lag, because
    the way driven since is known."""

    track_m: float
    ahead_m: float


class PlantRow:
    """Holds the plants along the track, each once, rising; a list or a camera reports them again
    and again with growing accuracy."""

    # A plant closer than this, m, is the same one seen again.
    SAME_PLANT_M = 0.08
    # Weight of a new report in the place of a known plant.
    NEW_LOOK_WEIGHT = 0.3

    def __init__(self) -> None:
        self.places_m: list[float] = []

    def add_plants(
        self, seen: Sequence[TrackedPlant], fixed_to_m: float, newer: float = NEW_LOOK_WEIGHT
    ) -> None:
        """Adds reported plants; plants up to `fixed_to_m` are dosed and keep their place.
        `newer`: see NEW_LOOK_WEIGHT."""
        for plant in seen:
            place = plant.track_m + plant.ahead_m
            k = bisect_left(self.places_m, place)
            near = [
                # Only the two neighbours of the place can be the same plant.
                j
                for j in (k - 1, k)
                if 0 <= j < len(self.places_m) and abs(self.places_m[j] - place) < self.SAME_PLANT_M
            ]
            if near:
                j = min(near, key=lambda i: abs(self.places_m[i] - place))
                if self.places_m[j] > fixed_to_m:
                    # A weighted mean lets the position improve without jumps.
                    self.places_m[j] += newer * (place - self.places_m[j])
            # A plant behind the fixed place would come too late for a dose.
            elif place > fixed_to_m + self.SAME_PLANT_M:
                self.places_m.insert(k, place)

    def drop_unseen(self, seen: Sequence[TrackedPlant], from_m: float, to_m: float) -> None:
        """Drops the plants between two places of the track that a complete report does not
        contain."""
        reported = sorted(plant.track_m + plant.ahead_m for plant in seen)
        self.places_m = [
            place
            for place in self.places_m
            if not from_m < place <= to_m or _has_place_near(reported, place, self.SAME_PLANT_M)
        ]

    def find_next_m(self, place_m: float) -> float | None:
        """Returns the first plant beyond a place of the track."""
        # 1e-9 m excludes the plant at the place itself.
        k = bisect_left(self.places_m, place_m + 1e-9)
        return self.places_m[k] if k < len(self.places_m) else None

    def forget_behind(self, before_m: float) -> None:
        """Drops the plants before a place of the track."""
        del self.places_m[: bisect_left(self.places_m, before_m)]


def _has_place_near(places_m: Sequence[float], place_m: float, within_m: float) -> bool:
    """Returns whether one of the rising places is closer than `within_m`."""
    k = bisect_left(places_m, place_m)
    return any(abs(places_m[j] - place_m) < within_m for j in (k - 1, k) if 0 <= j < len(places_m))
