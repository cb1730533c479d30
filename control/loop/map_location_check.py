"""Is the map at the machine's location? A map of another location gives its outside rate
everywhere.

The map is checked once for each START, at the first known position; afterwards, ground without a
rate is a property of the map.
"""

from __future__ import annotations

from collections.abc import Sequence

from topdress.control.field.boundary import Boundary
from topdress.control.geodesy import Place
from topdress.control.orders import MAP_SOURCES, State, TargetSource
from topdress.control.sensing import SensedMotion
from topdress.control.targets.prescription import Prescription

# Distance within which the map counts as near, m: a machine next to its field, or on a headland
# that the map omits.
NEAR_MAP_DISTANCE_M = 50.0


class MapLocationCheck:
    """Checks the location of the map. `elsewhere_m`: its distance from the machine at this
    START, m; None for a near, unused or unknown map."""

    def __init__(self, prescription: Prescription | None, corners: Sequence[Place]) -> None:
        """Creates the check. corners: of the job's field, on the map's plane; empty for an
        unknown field."""
        self.elsewhere_m: float | None = None
        self._map = prescription
        self._field = Boundary(corners) if corners and prescription is not None else None
        # Whether the map has a rate anywhere in the field.
        self._covers_field: bool | None = None
        self._looked = False

    def record_start(self) -> None:
        """Requests a new check after START, or after another source while working."""
        self.elsewhere_m, self._looked = None, False

    def check_location(self, state: State, source: TargetSource, sensed: SensedMotion) -> None:
        """Checks the map once, at the first known position."""
        if (
            not self._looked
            and state is State.WORKING
            and source in MAP_SOURCES
            and sensed.position_ok
        ):
            place = _find_place(sensed)
            self._looked = place is not None
            self.elsewhere_m = self.find_distance_m(source, sensed)

    def find_distance_m(self, source: TargetSource, sensed: SensedMotion | None) -> float | None:
        """Returns the distance of a map at another location, m; None for a near, unused or
        unknown map."""
        place = None if sensed is None else _find_place(sensed)
        if self._map is None or source not in MAP_SOURCES or place is None:
            return None
        if (
            self._field is not None
            and self._field.calc_distance_m(place) <= NEAR_MAP_DISTANCE_M
            and self._is_covering_field()
        ):
            return None
        away_m = self._map.calc_distance_m(place)
        return away_m if away_m > NEAR_MAP_DISTANCE_M else None

    def _is_covering_field(self) -> bool:
        assert self._map is not None and self._field is not None
        if self._covers_field is None:
            self._covers_field = self._map.has_rate_in(self._field)
        return self._covers_field


def _find_place(sensed: SensedMotion) -> Place | None:
    return (
        None if sensed.east_m is None or sensed.north_m is None else (sensed.east_m, sensed.north_m)
    )
