"""Does the map lie where the machine works? A map elsewhere gives its outside rate everywhere.

It is checked once for each START, at the first known place: from then on ground without a rate
belongs to the map."""

from __future__ import annotations

from collections.abc import Sequence

from topdress.control.field.boundary import Boundary
from topdress.control.geodesy import Place
from topdress.control.orders import BY_MAP, State, TargetSource
from topdress.control.sensing import Sensed
from topdress.control.targets.prescription import Prescription

# Distance within which the map is near, m: a machine next to its field, or on a headland that the
# map leaves out.
NEAR_M = 50.0


class MapNear:
    """Checks where the map lies. `elsewhere_m`: its distance from the machine at this START, m;
    None: near, not used, or unknown."""

    def __init__(self, prescription: Prescription | None, corners: Sequence[Place]) -> None:
        """Starts unchecked. corners: of the job's field, on the map's plane; empty: no field is
        known."""
        self.elsewhere_m: float | None = None
        self._map = prescription
        self._field = Boundary(corners) if corners and prescription is not None else None
        # Whether the map has a rate somewhere in the field.
        self._covers_field: bool | None = None
        self._looked = False

    def started(self) -> None:
        """Requests a new check after START, or after another source while working."""
        self.elsewhere_m, self._looked = None, False

    def look(self, state: State, source: TargetSource, sensed: Sensed) -> None:
        """Checks the map once, at the first known place."""
        if not self._looked and state is State.WORKING and source in BY_MAP and sensed.position_ok:
            place = _place(sensed)
            self._looked = place is not None
            self.elsewhere_m = self.away_m(source, sensed)

    def away_m(self, source: TargetSource, sensed: Sensed | None) -> float | None:
        """Returns the distance of a map that lies elsewhere, m; None: near, not used, or
        unknown."""
        place = None if sensed is None else _place(sensed)
        if self._map is None or source not in BY_MAP or place is None:
            return None
        if self._field is not None and self._field.away_m(place) <= NEAR_M and self._covers():
            return None
        away_m = self._map.away_m(place)
        return away_m if away_m > NEAR_M else None

    def _covers(self) -> bool:
        assert self._map is not None and self._field is not None
        if self._covers_field is None:
            self._covers_field = self._map.has_rate_in(self._field)
        return self._covers_field


def _place(sensed: Sensed) -> Place | None:
    return (
        None if sensed.east_m is None or sensed.north_m is None else (sensed.east_m, sensed.north_m)
    )
