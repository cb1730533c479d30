"""When is a change of the target made so that it lands at its place? The look-ahead (lag
papers).

A change has its own lag: the response of the actuator that makes it (dead time and half its
transition) plus the drop time at the shaft speed of release. It fires when the distance to its
place is at most the lag distance (lag paper, section 1.3: "when the distance to the cell's
boundary equals L"). It fires once and is not withdrawn: otherwise speed first would oscillate,
because the lag depends on the shaft speed, the shaft speed on the target and the target on the
lag.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from topdress.control.machine.change_lag import LagParts

from .target_profile import Target, TargetChange, TargetProfile


class LookAheadDistance(Protocol):
    """Returns how far ahead a change must be made at the present speed: the queue asks, the loop
    answers."""

    # Beyond this distance no change is looked for, m.
    max_reach_m: float

    def find_lag(self, before: Target, change: TargetChange) -> LagParts: ...

    def find_distance_m(self, lag: LagParts) -> float: ...


class FiredChange(NamedTuple):
    """Holds a change that was made: when, its place, the targets before and after, and where the
    outlet was."""

    time_s: float
    place_m: float
    before: Target
    after: Target
    track_m: float
    lag: LagParts


class ChangeQueue:
    """Holds the target that commands follow, and moves it from change to change along a profile."""

    def __init__(self, start: Target) -> None:
        self.holding = start
        # Changes up to this place have been made, m.
        self.fired_to_m = float("-inf")

    def restart_queue(self, target: Target, place_m: float) -> None:
        """Starts anew with the target that holds at `place_m`, as at the start of a pass or with
        another source."""
        self.holding = target
        self.fired_to_m = place_m

    def fire_changes(
        self, profile: TargetProfile, now_s: float, track_m: float, reach: LookAheadDistance
    ) -> list[FiredChange]:
        """Makes every change whose distance is at most its lag distance, in order, each once."""
        fired: list[FiredChange] = []
        while True:
            change = profile.find_next_change(
                max(self.fired_to_m, track_m), track_m + reach.max_reach_m, self.holding
            )
            if change is None:
                return fired
            lag = reach.find_lag(self.holding, change)
            if change.place_m - track_m > reach.find_distance_m(lag):
                return fired
            fired.append(
                FiredChange(now_s, change.place_m, self.holding, change.target, track_m, lag)
            )
            self.holding = change.target
            self.fired_to_m = change.place_m
