"""The look-ahead: changes of the target ahead are made early enough to land where they belong (lag papers).

A change has its own lag: the response of the actuator that makes it (dead time and half its transition) plus the drop
time at the shaft speed of release. It fires when the distance to its place is at most the lag distance (lag paper,
section 1.3: "when the distance to the cell's boundary equals L"), fires once, and is not withdrawn: otherwise speed
first chases itself, the lag depending on the shaft speed that depends on the target that depends on the lag.
"""
from __future__ import annotations

from math import log
from typing import NamedTuple, Protocol

from control.machine.fall import drop_s
from control.machine.machine import Machine
from control.metering.strategies import Pair

from .profile import Change, Profile, Target


class Lag(NamedTuple):
    """`response_s`: dead time of the slowest actuator that moves; `transition_s`: half of its travel; `drop_s`."""

    response_s: float
    transition_s: float
    drop_s: float

    @property
    def total_s(self) -> float:
        return self.response_s + self.transition_s + self.drop_s


STILL_RPM = 0.5         # smaller moves of the shaft, r/min, and of the gate, mm, are not what makes a change
STILL_MM = 0.2


def change_lag(machine: Machine, before: Pair, after: Pair) -> Lag:
    """Lag of a change from one settled pair to another, s.

    Half a transition is what passes until the released rate is half-way; the landed step's half-way point is then
    where it belongs. A start from zero lands its first half at the new shaft speed, a stop its last half at the old.
    """
    shaft = machine.shaft
    gate = machine.gate
    response = transition = 0.0
    moved_rpm = abs(after.shaft_rpm - before.shaft_rpm)
    if moved_rpm > STILL_RPM:
        response = shaft.dead_time_s + shaft.extra_dead_time_s
        transition = _half_rise_s(moved_rpm, shaft.time_constant_s + shaft.slow_s, shaft.acceleration_rpm_s)
    moved_mm = abs(after.opening_mm - before.opening_mm)
    if after.shaft_rpm > 0.0 and before.shaft_rpm > 0.0 and (moved_mm > STILL_MM or moved_rpm <= STILL_RPM):
        half = 0.5 * moved_mm / max(0.5, gate.slew_mm_s - gate.slow_mm_s)
        if gate.dead_time_s + half > response + transition:
            response, transition = gate.dead_time_s, half
    release_rpm = 0.5 * (before.shaft_rpm + after.shaft_rpm)
    if before.shaft_rpm <= 0.0 or after.shaft_rpm <= 0.0:
        release_rpm = max(before.shaft_rpm, after.shaft_rpm)
    fall = machine.fall
    drop = drop_s(fall, release_rpm) + fall.latency_s
    if before.shaft_rpm <= 0.0:
        drop += fall.first_fill_s
    rising = after.shaft_rpm * after.opening_mm > before.shaft_rpm * before.opening_mm
    drop += -0.5 * fall.asymmetry_s if rising else 0.5 * fall.asymmetry_s
    return Lag(response, transition, max(0.0, drop))


def _half_rise_s(moved_rpm: float, tau_s: float, acceleration_rpm_s: float) -> float:
    """Time for half of a first-order step whose slope is limited, s."""
    ramp_rpm = max(0.0, moved_rpm - acceleration_rpm_s * tau_s)      # ramps until the limit no longer binds
    half = 0.5 * moved_rpm
    if half <= ramp_rpm:
        return half / acceleration_rpm_s
    rest = moved_rpm - ramp_rpm
    return ramp_rpm / acceleration_rpm_s + tau_s * log(rest / (moved_rpm - half))


class Reach(Protocol):
    """How far ahead a change must be made at the present speed: asked by the queue, answered by the loop."""

    farthest_m: float           # beyond it no change is looked for

    def lag(self, before: Target, change: Change) -> Lag: ...

    def distance_m(self, lag: Lag) -> float: ...


class Fired(NamedTuple):
    """A change that was made: when, where it belongs, from what to what, and how far it was from there."""

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
        self.fired_to_m = float("-inf")        # changes up to here have been made

    def restart(self, target: Target, place_m: float) -> None:
        """Begin anew: what holds at `place_m` is taken as it is (start of a pass, another source)."""
        self.holding = target
        self.fired_to_m = place_m

    def advance(self, profile: Profile, now_s: float, track_m: float, reach: Reach) -> list[Fired]:
        """Make every change whose distance is at most its lag distance; in order, each once."""
        fired: list[Fired] = []
        while True:
            change = profile.next_change(max(self.fired_to_m, track_m), track_m + reach.farthest_m, self.holding)
            if change is None:
                return fired
            lag = reach.lag(self.holding, change)
            if change.place_m - track_m > reach.distance_m(lag):
                return fired
            fired.append(Fired(now_s, change.place_m, self.holding, change.target, track_m, lag))
            self.holding = change.target
            self.fired_to_m = change.place_m
