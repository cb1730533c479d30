"""Which targets of the prescription lie ahead of the outlets? A profile along the track (lag
paper, section 1.3)."""

from __future__ import annotations

from bisect import bisect_right

from topdress.control.geodesy import Place, TangentPlane, find_unit_vector, offset_place

from .prescription import Prescription, TargetAhead
from .target_profile import Target, TargetChange

# Targets are looked for this far ahead, m.
LOOK_AHEAD_M = 40.0
# In sharper turns, degrees/m, the way ahead is cut into straight pieces along the arc.
SHARP_TURN_DEG_M = 2.0
# Length of such a piece, m.
ARC_PIECE_M = 1.5
# An edge this close to the place of a change that was made is that change, m.
SAME_EDGE_M = 2.0
# A target that holds this near by is accepted, m: driving along an edge causes no chatter.
NEARBY_TARGET_M = 0.2


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

    def look_ahead(
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
            for d, target in self._find_targets_ahead((east_m, north_m), heading_deg, turn_deg_m)
        ]
        kept = bisect_right(self._places_m, fired_to_m)
        if self._lost or kept == 0 or fired_to_m < track_m - LOOK_AHEAD_M:
            self._store_targets(seen)
            return
        begin = max(fired_to_m, track_m)
        first = max(k for k, stretch in enumerate(seen) if k == 0 or stretch.distance_m <= begin)
        beyond = [TargetAhead(begin, seen[first].target), *seen[first + 1 :]]
        held = self._targets[kept - 1]
        while (
            beyond
            and beyond[0].target != held
            and self._is_change_made(
                held,
                beyond,
                begin,
                offset_place((east_m, north_m), heading_deg, beyond[0].distance_m - track_m),
                heading_deg,
            )
        ):
            del beyond[0]
        self._places_m[kept:] = [place for place, _ in beyond]
        self._targets[kept:] = [target for _, target in beyond]
        self._forget_behind(track_m)

    def forget_place(self) -> None:
        """Sets the rate for a lost position everywhere, because no place is known."""
        self._lost = True
        self._places_m, self._targets = [float("-inf")], [self.prescription.lost]

    def find_target(self, place_m: float) -> Target:
        return self._targets[max(0, bisect_right(self._places_m, place_m) - 1)]

    def find_next_change(
        self, after_m: float, before_m: float, holding: Target
    ) -> TargetChange | None:
        if self.find_target(after_m) != holding:
            return TargetChange(after_m, self.find_target(after_m))
        for k in range(bisect_right(self._places_m, after_m), len(self._places_m)):
            if self._places_m[k] > before_m:
                return None
            if self._targets[k] != holding:
                return TargetChange(self._places_m[k], self._targets[k])
        return None

    def _find_targets_ahead(
        self, start: Place, heading_deg: float, turn_deg_m: float
    ) -> list[TargetAhead]:
        if abs(turn_deg_m) < SHARP_TURN_DEG_M:
            return self.prescription.find_targets_ahead(start, heading_deg, LOOK_AHEAD_M)
        stretches: list[TargetAhead] = []
        started = 0.0
        while started < LOOK_AHEAD_M and abs(turn_deg_m) * started < 180.0:
            heading = heading_deg + turn_deg_m * (started + 0.5 * ARC_PIECE_M)
            for distance, target in self.prescription.find_targets_ahead(
                start, heading, ARC_PIECE_M
            ):
                if not stretches or stretches[-1].target != target:
                    stretches.append(TargetAhead(started + distance, target))
            east, north = find_unit_vector(heading)
            start = (start[0] + ARC_PIECE_M * east, start[1] + ARC_PIECE_M * north)
            started += ARC_PIECE_M
        return stretches

    def _is_change_made(
        self,
        held: Target,
        beyond: list[TargetAhead],
        begin_m: float,
        place: Place,
        heading_deg: float,
    ) -> bool:
        """Returns whether the first target seen, at `place`, is a change already made: the
        target in force begins a little further on, or holds near by."""
        if (
            len(beyond) > 1
            and beyond[1].target == held
            and beyond[1].distance_m < begin_m + SAME_EDGE_M
        ):
            return True
        return beyond[
            0
        ].distance_m < begin_m + 2.0 * NEARBY_TARGET_M and held in self.prescription.find_targets(
            [
                offset_place(place, heading_deg, ahead, aside)
                for ahead in (-NEARBY_TARGET_M, NEARBY_TARGET_M)
                for aside in (-NEARBY_TARGET_M, NEARBY_TARGET_M)
            ]
        )

    def _store_targets(self, seen: list[TargetAhead]) -> None:
        self._lost = False
        self._places_m = [place for place, _ in seen]
        self._targets = [target for _, target in seen]

    def _forget_behind(self, track_m: float) -> None:
        behind = bisect_right(self._places_m, track_m - LOOK_AHEAD_M) - 1
        if behind > 0:
            del self._places_m[:behind], self._targets[:behind]
