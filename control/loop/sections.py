"""Which sections are on when material released then lands, and when do their valves switch?

Every switch is decided `prepare_s` before it is to take effect at the valves: the slowest valve
and the shaft answer within that time. Then each acts in its own time, so that the valve and the
flow of the open outlets arrive together. The ground is judged where material that passes the
valve at that moment will land."""

from __future__ import annotations

from collections import deque
from math import inf, radians, sin
from typing import NamedTuple

from topdress.control.geodesy import Place, offset
from topdress.control.machine.machine import Machine
from topdress.control.machine.shaft import dead_s, lag_s
from topdress.control.orders import SectionState
from topdress.control.sensing import Sensed
from topdress.control.targets.section_ground import (
    OUTSIDE,
    JudgedStrip,
    SectionGround,
    SectionRates,
    SectionsGround,
)

# Reasons of a closed section besides those of `targets.section_ground`.
BY_HAND, NO_FLOW = "hand", "no_flow"
# Least way between two switches of a section, m: shorter stretches are cut corners.
SHORTEST_M = 0.5
# In sharper turns, degrees/m, the place ahead lies on the arc.
BEND_DEG_M = 2.0
# Times closer than this are equal, s.
TIE_S = 1e-6


class Leads(NamedTuple):
    """Holds how far ahead of the outlets material released `prepare_s` from now lands, m."""

    running_m: float
    # Where the first section opens, the shaft begins to turn.
    start_m: float
    # Where the last section closes, the shaft stops.
    stop_m: float


class _Turn(NamedTuple):
    """Holds a state of the valve from `from_s` on."""

    from_s: float
    on: bool


class _Switch:
    """Holds one section: the decisions, the commands of its valve, and its present state."""

    def __init__(self, open_s: float, close_s: float) -> None:
        self.open_s, self.close_s = open_s, close_s
        self.why = NO_FLOW  # of the newest decision
        self.inside = False  # the newest decision is not outside the field
        self.planned: deque[_Turn] = deque([_Turn(-inf, False)])  # decided
        self.stands: deque[_Turn] = deque([_Turn(-inf, False)])  # as commanded
        # place of the track from which the newest decision holds
        self.switched_m = -inf

    @property
    def decided(self) -> bool:
        return self.planned[-1].on

    def decide(self, from_s: float, on: bool) -> None:
        while len(self.planned) > 1 and self.planned[-1].from_s >= from_s:
            self.planned.pop()
        if on is not self.decided:
            self.planned.append(_Turn(from_s, on))

    def forget(self, now_s: float) -> None:
        for turns in (self.planned, self.stands):
            while len(turns) > 1 and turns[1].from_s <= now_s - 1.0:
                turns.popleft()

    def wanted_of_valve(self, by_s: float) -> bool:
        """Returns the command of the valve by then, so that it arrives in time."""
        return next(
            turn.on
            for turn in reversed(self.planned)
            if turn.from_s - (self.open_s if turn.on else self.close_s) <= by_s
        )

    def tell(self, now_s: float, on: bool) -> None:
        if on is not self.stands[-1].on:
            self.stands.append(_Turn(now_s + (self.open_s if on else self.close_s), on))


def _at(turns: deque[_Turn], time_s: float) -> bool:
    return next(turn.on for turn in reversed(turns) if turn.from_s <= time_s + TIE_S)


class Sections:
    """Switches the sections of a run. In each tick: `decide`, `share_at`, `valves`, `commanded`.
    A machine without valves has no strips: it is open over its whole width, and nothing is
    decided."""

    def __init__(self, machine: Machine, overlap_percent: float, edge_m: float) -> None:
        shaft = machine.shaft
        self.strips = machine.switched
        self._ground = SectionGround(self.strips, overlap_percent, edge_m)
        self._switches = [
            _Switch(section.valve.open_s, section.valve.close_s)
            for section in machine.sections
            if section.valve is not None
        ]
        self.shaft_answers_s = dead_s(shaft) + lag_s(shaft)
        self.prepare_s = max(
            [self.shaft_answers_s, *(max(one.open_s, one.close_s) for one in self._switches)]
        )
        self._gate_dead_s, self._slew_mm_s = (
            machine.gate.dead_time_s,
            max(0.5, machine.gate.slew_mm_s),
        )
        self._started = [False] * len(self.strips)
        self._judged_at: tuple[Place, float] | None = None
        self._backwards = False

    # -- what is decided
    # -------------------------------------------------------------------------------------------

    def started(self) -> None:
        """Releases the ground under the machine that was done in this run, because the operator
        wants flow."""
        self._started = [True] * len(self.strips)

    def moved(self) -> None:
        """Cancels all decisions, because the position has jumped or the direction has changed.
        All sections are off until they are decided anew."""
        for one in self._switches:
            one.planned = deque([_Turn(-inf, False)])
            one.inside, one.switched_m = False, -inf

    @property
    def any_decided(self) -> bool:
        return not self.strips or any(one.decided for one in self._switches)

    def ground(self, ground: SectionsGround) -> SectionsGround:
        """Returns the ground with the operator's START."""
        return ground._replace(started=tuple(self._started))

    def decide(
        self,
        sensed: Sensed,
        dt_s: float,
        leads: Leads,
        ground: SectionsGround,
        off_by_hand: tuple[int, ...],
        everywhere: bool = False,
    ) -> None:
        """Judges the ground at the landing place and switches the sections. off_by_hand:
        sections counted from 1, left to right. `everywhere`: the ground does not count (point
        mode)."""
        now = sensed.time_s
        if sensed.backwards is not self._backwards:
            self._backwards = sensed.backwards
            self.moved()
        judged, ahead_m = self._judged(sensed, leads, self.ground(ground), everywhere)
        way_m = ahead_m - sensed.track_m if sensed.backwards else ahead_m + sensed.track_m
        for k, (one, found) in enumerate(zip(self._switches, judged, strict=True)):
            one.forget(now)
            one.inside = found.why != OUTSIDE
            if k + 1 in off_by_hand:
                one.why = BY_HAND
                one.decide(now + one.close_s, False)
                continue
            self._started[k] = self._started[k] and found.done
            on = found.wanted
            if on is one.decided:
                one.why = found.why
            elif way_m >= one.switched_m + (0.0 if found.why == OUTSIDE else SHORTEST_M):
                one.why, one.switched_m = found.why, way_m
                one.decide(now + self.prepare_s, on)

    def _judged(
        self, sensed: Sensed, leads: Leads, ground: SectionsGround, everywhere: bool
    ) -> tuple[tuple[JudgedStrip, ...], float]:
        """Returns the verdict on every section, and how far ahead it holds, m."""
        self._judged_at = None
        if everywhere:
            return (JudgedStrip(True, "", 0.0, False),) * len(self.strips), leads.running_m
        if (
            not sensed.position_ok
            or sensed.east_m is None
            or sensed.north_m is None
            or sensed.heading_deg is None
        ):
            return self._ground.unknown(ground), leads.running_m
        if not self.any_decided:
            return self._look(sensed, leads.start_m, ground), leads.start_m
        ends = self._look(sensed, leads.stop_m, ground)
        if not any(
            found.wanted for one, found in zip(self._switches, ends, strict=True) if one.decided
        ):
            return ends, leads.stop_m
        return self._look(sensed, leads.running_m, ground), leads.running_m

    def _look(
        self, sensed: Sensed, ahead_m: float, ground: SectionsGround
    ) -> tuple[JudgedStrip, ...]:
        assert (
            sensed.east_m is not None
            and sensed.north_m is not None
            and sensed.heading_deg is not None
        )
        way_m = -ahead_m if sensed.backwards else ahead_m
        bend_deg_m = sensed.turn_deg_s / max(0.3, sensed.speed_mps or 0.0)
        turned = bend_deg_m * way_m if abs(bend_deg_m) > BEND_DEG_M else 0.0
        half = radians(0.5 * turned)
        chord_m = way_m * (sin(half) / half if half else 1.0)
        place = offset((sensed.east_m, sensed.north_m), sensed.heading_deg + 0.5 * turned, chord_m)
        self._judged_at = place, sensed.heading_deg + turned
        return self._ground.look(place, sensed.heading_deg + turned, ground)

    def map_rate_kg_ha(self, rates: SectionRates) -> float:
        """Returns the mean rate of a map under the open sections at the judged place, kg/ha."""
        if self._judged_at is None:
            return 0.0
        return self._ground.rate_kg_ha(
            *self._judged_at, [one.decided for one in self._switches], rates
        )

    def inside(self, now_s: float) -> bool:
        """Returns whether some section is inside the field or about to be, so that material
        flowing now lands inside."""
        return not self.strips or any(
            one.inside or _at(one.planned, now_s) for one in self._switches
        )

    # -- what follows from it
    # --------------------------------------------------------------------------------------

    def metering_s(self, by_shaft: bool, standing: bool, opening_mm: float) -> float:
        """Returns the time from a new set-point until the flow is half-way there, s: the lead of
        the metering over a switch."""
        if by_shaft or standing:
            return self.shaft_answers_s
        move_mm = opening_mm / max(1, sum(one.decided for one in self._switches))
        return min(self.prepare_s, self._gate_dead_s + 0.5 * move_mm / self._slew_mm_s)

    def share_at(self, time_s: float) -> float:
        """Returns the share of the working width that is to be open at a time, at most
        `prepare_s` ahead."""
        return (
            sum(
                strip.share
                for strip, one in zip(self.strips, self._switches, strict=True)
                if _at(one.planned, time_s)
            )
            if self.strips
            else 1.0
        )

    def valves(self, now_s: float, dt_s: float, off_by_hand: tuple[int, ...]) -> tuple[bool, ...]:
        """Returns the wanted commands of the valves in this tick, before safety."""
        return tuple(
            one.wanted_of_valve(now_s + 0.5 * dt_s + TIE_S) and k + 1 not in off_by_hand
            for k, one in enumerate(self._switches)
        )

    def commanded(self, now_s: float, valves: tuple[bool, ...]) -> None:
        """Records the commands of the valves after the last gate."""
        for one, on in zip(self._switches, valves, strict=True):
            one.tell(now_s, on)

    def open_now(self, now_s: float) -> tuple[bool, ...]:
        """Returns the expected present positions of the valves."""
        return tuple(_at(one.stands, now_s) for one in self._switches) if self.strips else (True,)

    def open_share(self, now_s: float) -> float:
        return (
            sum(
                strip.share
                for strip, on in zip(self.strips, self.open_now(now_s), strict=True)
                if on
            )
            if self.strips
            else 1.0
        )

    def states(
        self, valves: tuple[bool, ...], off_by_hand: tuple[int, ...]
    ) -> tuple[SectionState, ...]:
        """Returns the states of the sections for the screen."""
        return tuple(
            SectionState(True)
            if on
            else SectionState(False, BY_HAND if k + 1 in off_by_hand else one.why or NO_FLOW)
            for k, (one, on) in enumerate(zip(self._switches, valves, strict=True))
        )
