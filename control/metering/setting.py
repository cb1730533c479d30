"""Which shaft speed and opening are commanded for a wanted rate in this tick?

The answer is in closed form: material released now lands a lag from now, so the flow is the
rate times the width times the ground speed expected then, and the strategy's pair gives that
flow by the inverse of the machine model.

opening first   the gate moves; the shaft stays at its set-point while the gate suffices
                (`strategies`).
speed first     the shaft moves, its changes drawn out (`_drawn_out`) so that granules that fall
                singly do not overtake; the gate makes abrupt changes (`by_gate`).

The drive that moves compensates the error of the drive that rests, and what its own trim
leaves (`trims.Left`).

No strategy moves the shaft for granules that are already falling: nobody has measured the
effect of that (docs/decisions/0007).
"""

from __future__ import annotations

from collections.abc import Callable
from math import log

from topdress.control.machine.change_lag import Settled
from topdress.control.machine.fall import drop_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.shaft import dead_s, lag_s
from topdress.control.orders import Strategy
from topdress.control.readings import DriveCommand

from .inverse import Conditions, flow_kg_s, gate_command, opening_for, shaft_command
from .strategies import Pair, pair_for
from .trims import NOTHING_LEFT, DriveTrim, Left

# A change of strategy is spread over this time, s.
SWITCH_S = 4.0
# |log| of rate after over rate before, from which the gate makes the change in speed first: the
# edges of a map's zones, but not two grades of a canopy in one second.
ABRUPT = 0.35
# Share of the opening by which it then returns in a second. The shaft compensates, so slowly that
# no tube shows it (0.6 s x 0.02 / s: 1 % of the flow, where granules fall singly).
BACK_PER_S = 0.02
# Share of the drawing out that granules falling singly need, while the tube is unknown: it
# minimises the worst error of both tubes (2.5 % in steady work, benchmarks other_machines).
UNSETTLED_SHARE = 0.5
# Smaller moves of the shaft are not planned, r/min: the noise of the speed alone would make ten a
# second.
PLAN_BAND_RPM = 0.6
# Lower limit of that band, as a share of the shaft speed.
PLAN_BAND_SHARE = 0.008
# Upper limit of that band, as a share of the shaft speed: 0.6 of a slow shaft's 20 r/min would be 3
# % of the flow.
PLAN_BAND_MOST = 0.0136
# Smaller moves of the gate are not planned, mm.
PLAN_BAND_MM = 0.15
# Lower limit of that band, as a share of the opening: each move wears the gate.
PLAN_BAND_MM_SHARE = 0.012
# Smaller changes of the shaft's command are not sent, r/min; they come from the trims.
SHAFT_BAND_RPM = 0.3
# Smaller changes of the gate's command are not sent, mm.
OPENING_BAND_MM = 0.12


class Setting:
    """Plans shaft speed and opening of a run by the strategy, and the transition while it is
    being changed. `pair` is called once a tick, then `made` with the pair that was really
    commanded."""

    def __init__(self, machine: Machine, strategy: Strategy) -> None:
        self.machine = machine
        self.strategy = strategy.in_force
        self._shaft_answers_s = dead_s(machine.shaft) + lag_s(machine.shaft)
        self._drawn_out_share = (
            1.0 - machine.fall.carried_share if machine.tube_is_settled else UNSETTLED_SHARE
        )
        # The pair last commanded; None: the shaft stands.
        self._last: Pair | None = None
        self._drawn_rpm: float | None = None
        self._before: Strategy | None = None
        # Opening at which speed first turns its shaft, mm.
        self._at_mm = machine.set_points.opening_mm
        self._switched_s = 0.0
        self.left = NOTHING_LEFT
        # Flow of the pair over that of the pair without errors of the drives.
        self.made_up = 1.0

    def switch(self, strategy: Strategy, now_s: float) -> None:
        """Changes the strategy from now on; the same one again changes nothing."""
        if strategy.in_force is not self.strategy:
            self._before, self.strategy, self._switched_s = self.strategy, strategy.in_force, now_s
            self._drawn_rpm = None

    def pair(
        self,
        rate_kg_ha: float,
        mps_in: Callable[[float], float],
        now_s: float,
        dt_s: float,
        opening_now_mm: float,
        c: Conditions,
        left: Left = NOTHING_LEFT,
    ) -> Pair:
        """Returns true shaft speed and opening to aim at, without small moves.

        Parameters
        ----------
        rate_kg_ha : for the material that is released now.
        mps_in : ground speed expected so many seconds from now, m/s.
        now_s, dt_s : present time and time since the last tick, s.
        opening_now_mm : expected present opening, mm.
        c : what the flow depends on in addition.
        left : errors of the drives by their readings."""
        self.left = left
        machine, fall = self.machine, self.machine.fall
        shaft_moves = self._last is None or self.by_shaft
        answers_s = self._shaft_answers_s if shaft_moves else machine.gate.dead_time_s
        turns_rpm = machine.set_points.shaft_rpm if self._last is None else self._last.shaft_rpm
        mps = mps_in(
            answers_s
            + 0.5 * dt_s
            + drop_s(fall, (1.0 + left.shaft_share) * turns_rpm)
            + fall.latency_s
        )
        wanted_kg_s = rate_kg_ha * machine.geometry.working_width_m * mps / 10_000.0
        goal = self.goal(wanted_kg_s, now_s, opening_now_mm, c)
        self.made_up = self._made_up(goal, wanted_kg_s, opening_now_mm, c)
        if (
            goal.shaft_rpm > 0.0
            and self.by_shaft
            and goal.opening_mm == self._at_mm
            and not goal.limited
        ):
            opening = self._quiet(goal).opening_mm
            limits, shaft = (
                machine.limits,
                self._drawn_out(goal.shaft_rpm * goal.opening_mm / opening, dt_s),
            )
            goal = Pair(min(limits.shaft_high_rpm, max(limits.shaft_low_rpm, shaft)), opening)
        return self._quiet(goal) if goal.shaft_rpm > 0.0 else goal

    def _made_up(
        self, goal: Pair, wanted_kg_s: float, opening_now_mm: float, c: Conditions
    ) -> float:
        if goal.shaft_rpm <= 0.0 or self.left == NOTHING_LEFT:
            return 1.0
        plain = pair_for(self.machine, self.strategy, wanted_kg_s, opening_now_mm, c, self._at_mm)
        return flow_kg_s(self.machine, *goal[:2], c) / flow_kg_s(self.machine, *plain[:2], c)

    def made(self, pair: Pair) -> None:
        """Takes the pair that was commanded in this tick; a shaft speed of 0 stopped the flow."""
        self._last = pair if pair.shaft_rpm > 0.0 else None
        if self._last is None:
            self._drawn_rpm = None

    def _drawn_out(self, settled_rpm: float, dt_s: float) -> float:
        """Returns the shaft speed of speed first on its way to the speed that gives the flow.

        Where granules fall singly, material released at n lands with 1 / (1 + drop'(n) dn/dt) of
        its flow: later granules fall faster. That is the flow of `settled_rpm` where dn/dt
        = (1 - n / settled) / -drop'(n)."""
        n, fall = self._drawn_rpm or settled_rpm, self.machine.fall
        sooner_s = self._drawn_out_share * 0.5 * (drop_s(fall, n - 1.0) - drop_s(fall, n + 1.0))
        # The share is at most 1: the shaft never goes past the settled speed.
        share = dt_s / max(dt_s, sooner_s * settled_rpm)
        self._drawn_rpm = n + share * (settled_rpm - n)
        return self._drawn_rpm

    def _quiet(self, planned: Pair) -> Pair:
        """Returns the pair without small moves, in steps of the drives' resolution."""
        limits, last = self.machine.limits, self._last
        shaft = opening = None
        if last is not None:
            band = max(
                PLAN_BAND_SHARE * last.shaft_rpm,
                min(PLAN_BAND_RPM, PLAN_BAND_MOST * last.shaft_rpm),
            )
            if abs(planned.shaft_rpm - last.shaft_rpm) < band:
                shaft = last.shaft_rpm
            rests = self.by_shaft and planned.opening_mm == self.machine.set_points.opening_mm
            band_mm = max(PLAN_BAND_MM, PLAN_BAND_MM_SHARE * last.opening_mm)
            if not rests and abs(planned.opening_mm - last.opening_mm) < band_mm:
                opening = last.opening_mm
        return Pair(
            _rounded(planned.shaft_rpm, limits.shaft_resolution_rpm) if shaft is None else shaft,
            _rounded(planned.opening_mm, limits.opening_resolution_mm)
            if opening is None
            else opening,
            planned.limited,
        )

    def settled(self, wanted_kg_s: float, opening_now_mm: float, c: Conditions) -> Pair:
        """Returns the pair of the present strategy as if it had always been in force."""
        return pair_for(
            self.machine, self.strategy, wanted_kg_s, opening_now_mm, c, self._at_mm, self.left
        )

    def by_gate(self, before_kg_ha: float, after_kg_ha: float) -> float | None:
        """Returns the opening after a change of the rate that the gate makes in speed first, mm;
        None where the shaft makes it.

        At the edge of a map's zone the shaft would also move the material in the tube: a change
        from 450 to 150 kg/ha came 1.2 m late."""
        if not self.by_shaft or min(before_kg_ha, after_kg_ha) <= 0.0:
            return None
        if abs(log(after_kg_ha / before_kg_ha)) < ABRUPT:
            return None
        limits = self.machine.limits
        return min(
            limits.opening_high_mm,
            max(limits.opening_low_mm, self._at_mm * after_kg_ha / before_kg_ha),
        )

    def changed(self, before_kg_ha: float, after_kg_ha: float) -> None:
        """Takes note of a change of the rate: where the gate makes it, the opening changes too."""
        self._at_mm = self.by_gate(before_kg_ha, after_kg_ha) or self._at_mm

    def rests(self, dt_s: float) -> None:
        """Returns the opening of speed first slowly to its set-point."""
        wanted, most = self.machine.set_points.opening_mm, BACK_PER_S * dt_s * self._at_mm
        self._at_mm += min(most, max(-most, wanted - self._at_mm))

    @property
    def by_shaft(self) -> bool:
        """Returns whether the strategy is speed first and no change of strategy is under way."""
        return self.strategy is Strategy.SPEED_FIRST and self._before is None

    def goal(self, wanted_kg_s: float, now_s: float, opening_now_mm: float, c: Conditions) -> Pair:
        """Returns the settled pair to plan towards. While the strategy changes the shaft goes
        over gradually, and the opening follows it."""
        goal = self.settled(wanted_kg_s, opening_now_mm, c)
        if self._before is None:
            return goal
        share = (now_s - self._switched_s) / SWITCH_S
        if share >= 1.0 or goal.shaft_rpm <= 0.0:
            self._before = None
            return goal
        start = pair_for(
            self.machine, self._before, wanted_kg_s, opening_now_mm, c, self._at_mm, self.left
        )
        limits = self.machine.limits
        shaft = max(limits.shaft_low_rpm, (1.0 - share) * start.shaft_rpm + share * goal.shaft_rpm)
        opening = (
            opening_for(self.machine, wanted_kg_s, (1.0 + self.left.shaft_share) * shaft, c)
            - self.left.gate_mm
        )
        return Pair(
            shaft, min(limits.opening_high_mm, max(limits.opening_low_mm, opening)), goal.limited
        )

    def nudged(self, pair: Settled) -> Settled:
        """Returns the pair after a small change of rate by this strategy's own actuator."""
        if self.strategy is Strategy.SPEED_FIRST:
            return Settled(1.1 * pair.shaft_rpm, pair.opening_mm)
        return Settled(pair.shaft_rpm, 1.1 * pair.opening_mm)

    def wire(self, pair: Pair, c: Conditions) -> DriveCommand:
        """Returns the set-points of the drives without trims and rounding; 0 stops the shaft."""
        if pair.shaft_rpm <= 0.0:
            return DriveCommand(0.0, gate_command(self.machine, pair.opening_mm, c))
        return DriveCommand(
            shaft_command(self.machine, pair.shaft_rpm, pair.opening_mm, c),
            gate_command(self.machine, pair.opening_mm, c),
        )

    def command(
        self, pair: Pair, c: Conditions, trim: DriveTrim, last: DriveCommand | None
    ) -> DriveCommand:
        """Returns the set-points of the drives: trimmed, rounded to the drives' resolution,
        without small moves."""
        bare = self.wire(pair, c)
        if bare.shaft_rpm <= 0.0:
            stays = (
                last.opening_mm if last is not None else _rounded(bare.opening_mm, self._step_mm)
            )
            return DriveCommand(0.0, stays)
        # A trim is a share of the command beyond the neutral point.
        neutral = self.machine.shaft.neutral_rpm
        shaft = neutral + (bare.shaft_rpm - neutral) * (1.0 + trim.shaft_share)
        opening = bare.opening_mm + trim.gate_mm
        if last is not None and last.shaft_rpm > 0.0:
            if abs(shaft - last.shaft_rpm) < SHAFT_BAND_RPM:
                shaft = last.shaft_rpm
            if abs(opening - last.opening_mm) < OPENING_BAND_MM:
                opening = last.opening_mm
        return DriveCommand(
            _rounded(shaft, self.machine.limits.shaft_resolution_rpm),
            _rounded(opening, self._step_mm),
        )

    def by_hand(self, shaft_rpm: float, opening_mm: float) -> DriveCommand:
        """Returns the command of a pair without trims and dead bands, in steps of the drives'
        resolution."""
        return DriveCommand(
            _rounded(shaft_rpm, self.machine.limits.shaft_resolution_rpm),
            _rounded(opening_mm, self._step_mm),
        )

    @property
    def _step_mm(self) -> float:
        return self.machine.limits.opening_resolution_mm


def _rounded(value: float, step: float) -> float:
    return round(round(value / step) * step, 6)
