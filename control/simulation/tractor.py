"""Where does the tractor drive, and how fast? Passes up and down a field with half-circle turns."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from math import cos, pi, radians, sin
from typing import NamedTuple

import numpy as np
from topdress.control.field.job import Simulated
from topdress.control.readings import AnnouncedSpeeds

# Passes in a block; neighbours in time are four widths apart, so that turns are wide enough.
PASS_BLOCK = 8


class TractorPose(NamedTuple):
    east_m: float
    north_m: float
    heading_deg: float
    in_pass: bool


class PathLeg(NamedTuple):
    """Holds a straight (turn_deg 0) or an arc of some length from a pose on."""

    east_m: float
    north_m: float
    heading_deg: float
    length_m: float
    turn_deg: float


class TractorPath:
    """Holds the way of the outlets' middle by distance driven."""

    def __init__(self, legs: list[PathLeg]) -> None:
        self._legs = legs
        # Distances at which the legs begin make the search by bisection possible.
        self._begin_m: list[float] = [0.0]
        for leg in legs:
            self._begin_m.append(self._begin_m[-1] + leg.length_m)
        self.length_m = self._begin_m[-1]

    def find_pose(self, driven_m: float) -> TractorPose:
        """Returns the pose after a distance; beyond both ends the way continues straight."""
        # Positions beyond both ends use the first or last leg.
        k = min(len(self._legs) - 1, max(0, bisect_right(self._begin_m, driven_m) - 1))
        leg = self._legs[k]
        along = driven_m - self._begin_m[k]
        heading = radians(leg.heading_deg)
        if leg.turn_deg == 0.0:
            return TractorPose(
                leg.east_m + along * sin(heading),
                leg.north_m + along * cos(heading),
                leg.heading_deg,
                True,
            )
        turned = radians(leg.turn_deg) * along / leg.length_m
        # Right turns are positive.
        radius = leg.length_m / radians(leg.turn_deg)
        centre_e = leg.east_m + radius * cos(heading)
        centre_n = leg.north_m - radius * sin(heading)
        angle = heading + turned
        return TractorPose(
            centre_e - radius * cos(angle),
            centre_n + radius * sin(angle),
            (leg.heading_deg + leg.turn_deg * along / leg.length_m) % 360.0,
            False,
        )

    def list_straight_legs(self) -> list[tuple[float, PathLeg]]:
        """Returns each straight leg with the distance driven at its beginning, m."""
        return [
            (begin, leg)
            for begin, leg in zip(self._begin_m, self._legs, strict=False)
            if leg.turn_deg == 0.0
        ]


def order_passes(passes: int) -> list[int]:
    """Returns the order of passes 0, 4, 1, 5, 2, 6, 3, 7, then the next block. Successive passes
    are three or four widths apart, because a tractor cannot turn into the neighbouring pass."""
    order: list[int] = []
    for block in range(0, passes, PASS_BLOCK):
        members = list(range(block, min(block + PASS_BLOCK, passes)))
        half = (len(members) + 1) // 2
        for low, high in zip(members[:half], [*members[half:], None], strict=False):
            order.append(low)
            if high is not None:
                order.append(high)
    return order


def make_field_path(sim: Simulated, width_m: float, heading_deg: float) -> TractorPath:
    """Returns the passes of the simulated field; the first begins at the origin, the others lie
    to its right."""
    north = radians(heading_deg)
    ahead = (sin(north), cos(north))
    # Right of the heading is 90 degrees clockwise.
    right = (cos(north), -sin(north))

    def place(along: float, across: float) -> tuple[float, float]:
        return along * ahead[0] + across * right[0], along * ahead[1] + across * right[1]

    legs: list[PathLeg] = []
    order = order_passes(sim.passes)
    for number, k in enumerate(order):
        up = number % 2 == 0
        across = (k + 0.5) * width_m
        # Every pass begins outside the field, so that the machine is at speed at the edge.
        begin = -sim.run_in_m if up else sim.pass_length_m + sim.run_in_m
        course = heading_deg if up else (heading_deg + 180.0) % 360.0
        e, n = place(begin, across)
        legs.append(PathLeg(e, n, course, sim.pass_length_m + 2.0 * sim.run_in_m, 0.0))
        if number + 1 == len(order):
            break
        sideways = (order[number + 1] - k) * width_m
        # On the way back left and right are exchanged.
        to_right = (sideways > 0.0) == up
        e, n = place(sim.pass_length_m + sim.run_in_m if up else -sim.run_in_m, across)
        # A half circle over the distance of both passes has the length pi d / 2.
        legs.append(PathLeg(e, n, course, pi * abs(sideways) / 2.0, 180.0 if to_right else -180.0))
    return TractorPath(legs)


def make_field_boundary(
    sim: Simulated, width_m: float, heading_deg: float
) -> tuple[tuple[float, float], ...]:
    """Returns the rectangle that the passes cover, east and north, m."""
    north = radians(heading_deg)
    corners = [
        (0.0, 0.0),
        (sim.pass_length_m, 0.0),
        (sim.pass_length_m, sim.passes * width_m),
        (0.0, sim.passes * width_m),
    ]
    return tuple(
        (a * sin(north) + c * cos(north), a * cos(north) - c * sin(north)) for a, c in corners
    )


# Span and step of the announced speeds, s.
ANNOUNCED_AHEAD_S, ANNOUNCED_STEP_S = 5.0, 0.1
# Correlation time of the throttle's wander, s.
WANDER_TAU_S = 8.0


class TractorDriver:
    """Simulates the driver: bounded acceleration, a slow wander of the throttle, stops for
    refills.

    Where the tractor announces all of its drive, its wander is drawn in advance from `seed`."""

    def __init__(self, sim: Simulated, seed: int = 0) -> None:
        self._sim = sim
        self._changes = sorted(sim.speed_changes, key=lambda change: change.at_s)
        self.speed_mps = 0.0
        self._wander = 0.0
        self._time_s = 0.0
        self._stopped = False
        self._dt_s = 0.05
        # Wander of the next ticks.
        self._to_come: deque[float] = deque()
        self._rng = np.random.default_rng(seed)

    def advance_speed(self, time_s: float, stopped: bool, kick: float, dt_s: float) -> float:
        """Returns the speed at the end of the step, m/s; `kick`: a standard normal number."""
        self._time_s, self._stopped, self._dt_s = time_s + dt_s, stopped, dt_s
        # The driver's acceleration limits both braking and accelerating.
        wanted, most = self._find_wanted_speed(time_s)
        if self._sim.speed_told == "drive":
            wander = self._draw_wander_ahead(dt_s)
        else:
            wander = self._wander = self._advance_wander(self._wander, kick, dt_s)
        wanted = 0.0 if stopped else wanted * (1.0 + wander)
        step = min(most * dt_s, max(-most * dt_s, wanted - self.speed_mps))
        self.speed_mps += step
        return self.speed_mps

    def announce_speeds(self) -> AnnouncedSpeeds | None:
        """Returns the tractor's present announcement."""
        how = self._sim.speed_told
        if how == "none":
            return None
        now, most = self._find_wanted_speed(self._time_s)
        if self._stopped or how == "set":
            return AnnouncedSpeeds(self._time_s, ((0.0, 0.0 if self._stopped else now),), most)
        steps = [
            round(k * ANNOUNCED_STEP_S, 3)
            for k in range(round(ANNOUNCED_AHEAD_S / ANNOUNCED_STEP_S))
        ]
        # The announced speeds are those that the driver wants at each later time.
        aims = [self._find_wanted_speed(self._time_s + in_s) for in_s in steps]
        wander = [
            0.0
            if how == "plan"
            else self._to_come[min(len(self._to_come) - 1, round(in_s / self._dt_s))]
            for in_s in steps
        ]
        return AnnouncedSpeeds(
            self._time_s,
            tuple(
                (in_s, aim * (1.0 + more))
                for in_s, (aim, _), more in zip(steps, aims, wander, strict=True)
            ),
            max(a for _, a in aims),
        )

    def _find_wanted_speed(self, time_s: float) -> tuple[float, float]:
        """Returns the driver's wanted speed, m/s, and acceleration, m/s2, at a time."""
        # 0.5 m/s2 holds until a change of speed states another acceleration.
        wanted, most = self._sim.speed_kmh / 3.6, 0.5
        for change in self._changes:
            if change.at_s <= time_s:
                wanted, most = change.speed_kmh / 3.6, change.acceleration_mps2
        return wanted, most

    def _advance_wander(self, before: float, kick: float, dt_s: float) -> float:
        share = self._sim.speed_wander_percent / 100.0
        return float(
            # A first-order process with this step keeps the standard deviation at `share`.
            (1.0 - dt_s / WANDER_TAU_S) * before + share * (2.0 * dt_s / WANDER_TAU_S) ** 0.5 * kick
        )

    def _draw_wander_ahead(self, dt_s: float) -> float:
        while len(self._to_come) * dt_s <= ANNOUNCED_AHEAD_S:
            last = self._to_come[-1] if self._to_come else 0.0
            self._to_come.append(
                self._advance_wander(last, float(self._rng.standard_normal()), dt_s)
            )
        return self._to_come.popleft()
