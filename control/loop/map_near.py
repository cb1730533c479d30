"""Does the map lie where the machine works? One that lies elsewhere gives its outside rate
everywhere.

Looked at once for each START, at the first place known: from then on ground without a rate is
the map's own affair.
"""

from __future__ import annotations

from collections.abc import Sequence

from topdress.control.field.boundary import Boundary
from topdress.control.geodesy import Place
from topdress.control.orders import BY_MAP, State, TargetSource
from topdress.control.sensing import Sensed
from topdress.control.targets.prescription import Prescription

# a machine that stands next to its field, or on a headland that the map leaves out
NEAR_M = 50.0


class MapNear:
    """`elsewhere_m`: how far the map lies from the machine at this START; None: near, not by a
    map, not known yet."""

    def __init__(self, prescription: Prescription | None, corners: Sequence[Place]) -> None:
        """corners: of the job's field, on the map's plane; none: no field is known."""
        self.elsewhere_m: float | None = None
        self._map = prescription
        self._field = Boundary(corners) if corners and prescription is not None else None
        self._covers_field: bool | None = None  # the map has a rate somewhere in the field
        self._looked = False

    def started(self) -> None:
        """START, or another source while working: look again."""
        self.elsewhere_m, self._looked = None, False

    def look(self, state: State, source: TargetSource, sensed: Sensed) -> None:
        """Once a tick."""
        if not self._looked and state is State.WORKING and source in BY_MAP and sensed.position_ok:
            place = _place(sensed)
            self._looked = place is not None
            self.elsewhere_m = self.away_m(source, sensed)

    def away_m(self, source: TargetSource, sensed: Sensed | None) -> float | None:
        """How far the map lies from the machine where that is elsewhere; None: near, not by a
        map, or not known."""
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
