"""Which targets of the prescription lie ahead of the outlets? A profile along the track (lag
paper, section 1.3)."""

from __future__ import annotations

from bisect import bisect_right

from topdress.control.geodesy import Place, TangentPlane, direction, offset

from .prescription import Prescription, TargetAhead
from .profile import Target, TargetChange

# Targets are looked for this far ahead, m.
LOOK_M = 40.0
# In sharper turns, degrees/m, the way ahead is cut into straight pieces along the arc.
BEND_DEG_M = 2.0
# Length of such a piece, m.
PIECE_M = 1.5
# An edge this close to the place of a change that was made is that change, m.
SAME_M = 2.0
# A target that holds this near by is accepted, m: driving along an edge causes no chatter.
NEAR_BY_M = 0.2


class MapProfile:
    """Holds the places along the track, in the machine's heading, where the rate changes;
    updated once a tick.

    Changes that were made keep their place; the way beyond them is read anew."""

    def __init__(self, prescription: Prescription, plane: TangentPlane) -> None:
        self.prescription = prescription
        self.plane = plane
        self._places_m: list[float] = [float("-inf")]
        self._targets: list[Target] = [prescription.lost]
        self._lost = True

    def look(
        self,
        track_m: float,
        east_m: float,
        north_m: float,
        heading_deg: float,
        fired_to_m: float,
        turn_deg_m: float = 0.0,
    ) -> None:
        """Looks from the outlet ahead. `turn_deg_m`: change of heading for each metre (0:
        straight on)."""
        seen = [
            TargetAhead(track_m + d, target)
            for d, target in self._ahead((east_m, north_m), heading_deg, turn_deg_m)
        ]
        kept = bisect_right(self._places_m, fired_to_m)
        if self._lost or kept == 0 or fired_to_m < track_m - LOOK_M:
            self._put(seen)
            return
        begin = max(fired_to_m, track_m)
        first = max(k for k, stretch in enumerate(seen) if k == 0 or stretch.distance_m <= begin)
        beyond = [TargetAhead(begin, seen[first].target), *seen[first + 1 :]]
        held = self._targets[kept - 1]
        while (
            beyond
            and beyond[0].target != held
            and self._is_made(
                held,
                beyond,
                begin,
                offset((east_m, north_m), heading_deg, beyond[0].distance_m - track_m),
                heading_deg,
            )
        ):
            del beyond[0]
        self._places_m[kept:] = [place for place, _ in beyond]
        self._targets[kept:] = [target for _, target in beyond]
        self._forget(track_m)

    def lost(self) -> None:
        """Sets the rate for a lost position everywhere, because no place is known."""
        self._lost = True
        self._places_m, self._targets = [float("-inf")], [self.prescription.lost]

    def at(self, place_m: float) -> Target:
        return self._targets[max(0, bisect_right(self._places_m, place_m) - 1)]

    def next_change(self, after_m: float, before_m: float, holding: Target) -> TargetChange | None:
        if self.at(after_m) != holding:
            return TargetChange(after_m, self.at(after_m))
        for k in range(bisect_right(self._places_m, after_m), len(self._places_m)):
            if self._places_m[k] > before_m:
                return None
            if self._targets[k] != holding:
                return TargetChange(self._places_m[k], self._targets[k])
        return None

    def _ahead(self, start: Place, heading_deg: float, turn_deg_m: float) -> list[TargetAhead]:
        if abs(turn_deg_m) < BEND_DEG_M:
            return self.prescription.ahead(start, heading_deg, LOOK_M)
        stretches: list[TargetAhead] = []
        started = 0.0
        while started < LOOK_M and abs(turn_deg_m) * started < 180.0:
            heading = heading_deg + turn_deg_m * (started + 0.5 * PIECE_M)
            for distance, target in self.prescription.ahead(start, heading, PIECE_M):
                if not stretches or stretches[-1].target != target:
                    stretches.append(TargetAhead(started + distance, target))
            east, north = direction(heading)
            start = (start[0] + PIECE_M * east, start[1] + PIECE_M * north)
            started += PIECE_M
        return stretches

    def _is_made(
        self,
        held: Target,
        beyond: list[TargetAhead],
        begin_m: float,
        place: Place,
        heading_deg: float,
    ) -> bool:
        """Returns whether the first target seen, at `place`, is a change already made: the
        target in force begins a little further on, or holds near by."""
        if len(beyond) > 1 and beyond[1].target == held and beyond[1].distance_m < begin_m + SAME_M:
            return True
        return beyond[
            0
        ].distance_m < begin_m + 2.0 * NEAR_BY_M and held in self.prescription.targets_at(
            [
                offset(place, heading_deg, ahead, aside)
                for ahead in (-NEAR_BY_M, NEAR_BY_M)
                for aside in (-NEAR_BY_M, NEAR_BY_M)
            ]
        )

    def _put(self, seen: list[TargetAhead]) -> None:
        self._lost = False
        self._places_m = [place for place, _ in seen]
        self._targets = [target for _, target in seen]

    def _forget(self, track_m: float) -> None:
        behind = bisect_right(self._places_m, track_m - LOOK_M) - 1
        if behind > 0:
            del self._places_m[:behind], self._targets[:behind]
