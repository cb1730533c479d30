"""The look-ahead: changes of the target ahead are made early enough to land where they belong
(lag papers).

A change has its own lag: the response of the actuator that makes it (dead time and half its
transition) plus the drop time at the shaft speed of release. It fires when the distance to its
place is at most the lag distance (lag paper, section 1.3: "when the distance to the cell's
boundary equals L"), fires once, and is not withdrawn: otherwise speed first chases itself, the
lag depending on the shaft speed that depends on the target that depends on the lag.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from topdress.control.machine.change_lag import Lag

from .profile import Profile, Target, TargetChange


class Reach(Protocol):
    """How far ahead a change must be made at the present speed: asked by the queue, answered by
    the loop."""

    farthest_m: float  # beyond it no change is looked for

    def lag(self, before: Target, change: TargetChange) -> Lag: ...

    def distance_m(self, lag: Lag) -> float: ...


class Fired(NamedTuple):
    """A change that was made: when, where it belongs, from what to what, and how far it was
    from there."""

    time_s: float
    place_m: float
    before: Target
    after: Target
    track_m: float
    lag: Lag


class ChangeQueue:
    """Holds the target that commands follow, and moves it from change to change along a profile."""

    def __init__(self, start: Target) -> None:
        self.holding = start
        self.fired_to_m = float("-inf")  # changes up to here have been made

    def restart(self, target: Target, place_m: float) -> None:
        """Begin anew: what holds at `place_m` is taken as it is (start of a pass, another
        source)."""
        self.holding = target
        self.fired_to_m = place_m

    def advance(self, profile: Profile, now_s: float, track_m: float, reach: Reach) -> list[Fired]:
        """Make every change whose distance is at most its lag distance; in order, each once."""
        fired: list[Fired] = []
        while True:
            change = profile.next_change(
                max(self.fired_to_m, track_m), track_m + reach.farthest_m, self.holding
            )
            if change is None:
                return fired
            lag = reach.lag(self.holding, change)
            if change.place_m - track_m > reach.distance_m(lag):
                return fired
            fired.append(Fired(now_s, change.place_m, self.holding, change.target, track_m, lag))
            self.holding = change.target
            self.fired_to_m = change.place_m
