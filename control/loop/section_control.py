"""Which sections are on when material released then lands, and when do their valves switch?

Every switch is decided `prepare_s` before its effect at the valves, because the slowest valve and
the shaft answer within that time. Each then acts with its own lead, so that the valve and the flow
of the open outlets arrive together. The ground is judged at the landing position of material that
passes the valve at that moment.
"""

from __future__ import annotations

from collections import deque
from math import inf, radians, sin
from typing import NamedTuple

from topdress.control.geodesy import Place, offset_place
from topdress.control.machine.machine import Machine
from topdress.control.machine.shaft import calc_dead_time_s, calc_time_constant_s
from topdress.control.orders import SectionState
from topdress.control.sensing import SensedMotion
from topdress.control.targets.section_ground import (
    WHY_OUTSIDE,
    JudgedStrip,
    SectionGround,
    SectionRates,
    SectionsGround,
)

# Reasons for a closed section besides those of `targets.section_ground`.
WHY_BY_HAND, WHY_NO_FLOW = "hand", "no_flow"
# Minimum distance between two switches of a section, m: shorter stretches are cut corners.
MIN_STRETCH_M = 0.5
# In sharper turns, degrees/m, the position ahead is on the arc.
SHARP_TURN_DEG_M = 2.0
# Times closer than this are equal, s.
TIME_TOLERANCE_S = 1e-6


class SectionLeads(NamedTuple):
    """Holds how far ahead of the outlets material released `prepare_s` from now lands, m."""

    running_m: float
    # Distance where the first section opens and the shaft starts to turn.
    start_m: float
    # Distance where the last section closes and the shaft stops.
    stop_m: float


class _SwitchTime(NamedTuple):
    """Holds a state of the valve from `from_s` on, s."""

    from_s: float
    on: bool


class _SectionSwitch:
    """Holds one section: its decisions, the commands of its valve, and its present state."""

    def __init__(self, open_s: float, close_s: float) -> None:
        self.open_s, self.close_s = open_s, close_s
        # Reason of the newest decision.
        self.why = WHY_NO_FLOW
        # Whether the newest decision is inside the field.
        self.inside = False
        # Decided states.
        self.planned: deque[_SwitchTime] = deque([_SwitchTime(-inf, False)])
        # Commanded states.
        self.stands: deque[_SwitchTime] = deque([_SwitchTime(-inf, False)])
        # Position of the track from which the newest decision applies, m.
        self.switched_m = -inf

    @property
    def is_decided_on(self) -> bool:
        return self.planned[-1].on

    def decide_switch(self, from_s: float, on: bool) -> None:
        while len(self.planned) > 1 and self.planned[-1].from_s >= from_s:
            self.planned.pop()
        if on is not self.is_decided_on:
            self.planned.append(_SwitchTime(from_s, on))

    def forget_past(self, now_s: float) -> None:
        for turns in (self.planned, self.stands):
            while len(turns) > 1 and turns[1].from_s <= now_s - 1.0:
                turns.popleft()

    def is_valve_wanted(self, by_s: float) -> bool:
        """Returns the command of the valve at a time, such that the valve arrives in time."""
        return next(
            turn.on
            for turn in reversed(self.planned)
            if turn.from_s - (self.open_s if turn.on else self.close_s) <= by_s
        )

    def record_command(self, now_s: float, on: bool) -> None:
        if on is not self.stands[-1].on:
            self.stands.append(_SwitchTime(now_s + (self.open_s if on else self.close_s), on))


def _is_on_at(turns: deque[_SwitchTime], time_s: float) -> bool:
    return next(turn.on for turn in reversed(turns) if turn.from_s <= time_s + TIME_TOLERANCE_S)


class SectionControl:
    """Switches the sections of a run. The order in each tick is `decide_switches`, `find_share_at`,
    `find_valves`, `record_commands`.

    A machine without valves has no strips: it is open over its whole width, and nothing is decided.
    """

    def __init__(self, machine: Machine, overlap_percent: float, edge_m: float) -> None:
        shaft = machine.shaft
        self.strips = machine.switched_strips
        self._ground = SectionGround(self.strips, overlap_percent, edge_m)
        self._switches = [
            _SectionSwitch(section.valve.open_s, section.valve.close_s)
            for section in machine.sections
            if section.valve is not None
        ]
        self.shaft_answers_s = calc_dead_time_s(shaft) + calc_time_constant_s(shaft)
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

    # The following methods decide.

    def record_start(self) -> None:
        """Releases ground under the machine that was done in this run, because the operator
        wants flow."""
        self._started = [True] * len(self.strips)

    def cancel_decisions(self) -> None:
        """Cancels all decisions, because the position has jumped or the direction has changed.
        All sections are off until the next decisions."""
        for one in self._switches:
            one.planned = deque([_SwitchTime(-inf, False)])
            one.inside, one.switched_m = False, -inf

    @property
    def is_any_decided(self) -> bool:
        return not self.strips or any(one.is_decided_on for one in self._switches)

    def mark_started(self, ground: SectionsGround) -> SectionsGround:
        """Returns the ground with the operator's START marked."""
        return ground._replace(started=tuple(self._started))

    def decide_switches(
        self,
        sensed: SensedMotion,
        dt_s: float,
        leads: SectionLeads,
        ground: SectionsGround,
        off_by_hand: tuple[int, ...],
        everywhere: bool = False,
    ) -> None:
        """Judges the ground at the landing position and switches the sections.

        off_by_hand: sections counted from 1, left to right. `everywhere`: whether the ground is
        ignored (point mode).
        """
        now = sensed.time_s
        if sensed.backwards is not self._backwards:
            self._backwards = sensed.backwards
            self.cancel_decisions()
        judged, ahead_m = self._judge_ground(sensed, leads, self.mark_started(ground), everywhere)
        way_m = ahead_m - sensed.track_m if sensed.backwards else ahead_m + sensed.track_m
        for k, (one, found) in enumerate(zip(self._switches, judged, strict=True)):
            one.forget_past(now)
            one.inside = found.why != WHY_OUTSIDE
            if k + 1 in off_by_hand:
                one.why = WHY_BY_HAND
                one.decide_switch(now + one.close_s, False)
                continue
            self._started[k] = self._started[k] and found.done
            on = found.wanted
            if on is one.is_decided_on:
                one.why = found.why
            elif way_m >= one.switched_m + (0.0 if found.why == WHY_OUTSIDE else MIN_STRETCH_M):
                one.why, one.switched_m = found.why, way_m
                one.decide_switch(now + self.prepare_s, on)

    def _judge_ground(
        self, sensed: SensedMotion, leads: SectionLeads, ground: SectionsGround, everywhere: bool
    ) -> tuple[tuple[JudgedStrip, ...], float]:
        """Returns the verdict on every section, and the distance ahead at which it applies, m."""
        self._judged_at = None
        if everywhere:
            return (JudgedStrip(True, "", 0.0, False),) * len(self.strips), leads.running_m
        if (
            not sensed.position_ok
            or sensed.east_m is None
            or sensed.north_m is None
            or sensed.heading_deg is None
        ):
            return self._ground.judge_unknown_place(ground), leads.running_m
        if not self.is_any_decided:
            return self._judge_ahead(sensed, leads.start_m, ground), leads.start_m
        ends = self._judge_ahead(sensed, leads.stop_m, ground)
        if not any(
            found.wanted
            for one, found in zip(self._switches, ends, strict=True)
            if one.is_decided_on
        ):
            return ends, leads.stop_m
        return self._judge_ahead(sensed, leads.running_m, ground), leads.running_m

    def _judge_ahead(
        self, sensed: SensedMotion, ahead_m: float, ground: SectionsGround
    ) -> tuple[JudgedStrip, ...]:
        assert (
            sensed.east_m is not None
            and sensed.north_m is not None
            and sensed.heading_deg is not None
        )
        way_m = -ahead_m if sensed.backwards else ahead_m
        bend_deg_m = sensed.turn_deg_s / max(0.3, sensed.speed_mps or 0.0)
        turned = bend_deg_m * way_m if abs(bend_deg_m) > SHARP_TURN_DEG_M else 0.0
        half = radians(0.5 * turned)
        chord_m = way_m * (sin(half) / half if half else 1.0)
        place = offset_place(
            (sensed.east_m, sensed.north_m), sensed.heading_deg + 0.5 * turned, chord_m
        )
        self._judged_at = place, sensed.heading_deg + turned
        return self._ground.judge_sections(place, sensed.heading_deg + turned, ground)

    def find_map_rate_kg_ha(self, rates: SectionRates) -> float:
        """Returns the mean rate of a map under the open sections at the judged position, kg/ha."""
        if self._judged_at is None:
            return 0.0
        return self._ground.find_mean_rate_kg_ha(
            *self._judged_at, [one.is_decided_on for one in self._switches], rates
        )

    def is_any_inside(self, now_s: float) -> bool:
        """Returns whether any section is inside the field or about to enter, so that material
        flowing now lands inside."""
        return not self.strips or any(
            one.inside or _is_on_at(one.planned, now_s) for one in self._switches
        )

    # The following methods convert the decisions to commands.

    def find_metering_s(self, by_shaft: bool, standing: bool, opening_mm: float) -> float:
        """Returns the time from a new set-point until half of the change of flow, s: the lead of
        the metering before a switch."""
        if by_shaft or standing:
            return self.shaft_answers_s
        move_mm = opening_mm / max(1, sum(one.is_decided_on for one in self._switches))
        return min(self.prepare_s, self._gate_dead_s + 0.5 * move_mm / self._slew_mm_s)

    def find_share_at(self, time_s: float) -> float:
        """Returns the planned open share of the working width at a time, at most `prepare_s`
        ahead."""
        return (
            sum(
                strip.share
                for strip, one in zip(self.strips, self._switches, strict=True)
                if _is_on_at(one.planned, time_s)
            )
            if self.strips
            else 1.0
        )

    def find_valves(
        self, now_s: float, dt_s: float, off_by_hand: tuple[int, ...]
    ) -> tuple[bool, ...]:
        """Returns the wanted commands of the valves in this tick, before safety."""
        return tuple(
            one.is_valve_wanted(now_s + 0.5 * dt_s + TIME_TOLERANCE_S) and k + 1 not in off_by_hand
            for k, one in enumerate(self._switches)
        )

    def record_commands(self, now_s: float, valves: tuple[bool, ...]) -> None:
        """Records the commands of the valves after the last safety check."""
        for one, on in zip(self._switches, valves, strict=True):
            one.record_command(now_s, on)

    def find_open_valves(self, now_s: float) -> tuple[bool, ...]:
        """Returns the expected present positions of the valves."""
        return (
            tuple(_is_on_at(one.stands, now_s) for one in self._switches)
            if self.strips
            else (True,)
        )

    def find_open_share(self, now_s: float) -> float:
        return (
            sum(
                strip.share
                for strip, on in zip(self.strips, self.find_open_valves(now_s), strict=True)
                if on
            )
            if self.strips
            else 1.0
        )

    def describe_states(
        self, valves: tuple[bool, ...], off_by_hand: tuple[int, ...]
    ) -> tuple[SectionState, ...]:
        """Returns the states of the sections for the screen."""
        return tuple(
            SectionState(True)
            if on
            else SectionState(
                False, WHY_BY_HAND if k + 1 in off_by_hand else one.why or WHY_NO_FLOW
            )
            for k, (one, on) in enumerate(zip(self._switches, valves, strict=True))
        )
