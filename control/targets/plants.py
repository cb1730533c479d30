"""Plants to be given a dose each: from a list in degrees, or seen by a camera; their places
along the track."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from topdress.control.geodesy import Place, TangentPlane, direction

Floats = npt.NDArray[np.float64]


class PlantList:
    """Plants on the field's plane. lat_lon_deg: (n, 2)."""

    def __init__(self, lat_lon_deg: npt.ArrayLike, plane: TangentPlane) -> None:
        degrees = np.asarray(lat_lon_deg, dtype=np.float64).reshape(-1, 2)
        self.places_m: Floats = plane.many_to_m(degrees[:, 0], degrees[:, 1])
        self.plane = plane
        self._tree = shapely.STRtree(shapely.points(self.places_m))

    def ahead_m(
        self, place: Place, heading_deg: float, farthest_m: float, half_width_m: float
    ) -> list[float]:
        """Distances along the heading of the plants in a strip ahead, rising; those next to the
        strip are not ours."""
        east, north = direction(heading_deg)
        far = (place[0] + farthest_m * east, place[1] + farthest_m * north)
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


class SeenPlant(NamedTuple):
    """A plant in a camera's picture: how far ahead of the outlet, when the outlet was at `track_m`.

    The stamp takes the camera's computing time (point paper: 1.5 s) out of the lag: what was
    driven since is known.
    """

    track_m: float
    ahead_m: float


class PlantRow:
    """Plants along the track, each once, rising; reported again and again by a list or a
    camera, ever more exactly."""

    SAME_M = 0.08  # nearer than this is the same plant seen again
    # weight of a new look at the place of a plant known already
    NEWER = 0.3

    def __init__(self) -> None:
        self.places_m: list[float] = []

    def look(self, seen: Sequence[SeenPlant], fixed_to_m: float, newer: float = NEWER) -> None:
        """Take in what is seen; plants up to `fixed_to_m`, dosed already, stay as they are.
        `newer`: see NEWER."""
        for plant in seen:
            place = plant.track_m + plant.ahead_m
            k = bisect_left(self.places_m, place)
            near = [
                j
                for j in (k - 1, k)
                if 0 <= j < len(self.places_m) and abs(self.places_m[j] - place) < self.SAME_M
            ]
            if near:
                j = min(near, key=lambda i: abs(self.places_m[i] - place))
                if self.places_m[j] > fixed_to_m:
                    self.places_m[j] += newer * (place - self.places_m[j])
            elif place > fixed_to_m + self.SAME_M:
                self.places_m.insert(k, place)

    def only(self, seen: Sequence[SeenPlant], from_m: float, to_m: float) -> None:
        """Forget the plants between two places of the track that a look which tells them all
        did not tell."""
        reported = sorted(plant.track_m + plant.ahead_m for plant in seen)
        self.places_m = [
            place
            for place in self.places_m
            if not from_m < place <= to_m or _is_near(reported, place, self.SAME_M)
        ]

    def after(self, place_m: float) -> float | None:
        """The first plant beyond a place of the track."""
        k = bisect_left(self.places_m, place_m + 1e-9)
        return self.places_m[k] if k < len(self.places_m) else None

    def forget(self, before_m: float) -> None:
        del self.places_m[: bisect_left(self.places_m, before_m)]


def _is_near(places_m: Sequence[float], place_m: float, within_m: float) -> bool:
    """Whether one of the places, rising, is nearer than `within_m`."""
    k = bisect_left(places_m, place_m)
    return any(abs(places_m[j] - place_m) < within_m for j in (k - 1, k) if 0 <= j < len(places_m))
