"""Which shaft speed and opening are commanded for a wanted rate in this tick?

The answer is in closed form: material released now lands a lag from now, so the flow is the
rate times the width times the ground speed expected then, and the strategy's pair gives that
flow by the inverse of the machine model.

opening first   the gate moves; the shaft stays at its set-point while the gate suffices
                (`strategies`).
speed first     the shaft moves, its changes drawn out (`_draw_out_shaft`) so that granules that
fall
                singly do not overtake; the gate makes abrupt changes (`find_gate_change_mm`).

The drive that moves compensates the error of the drive that rests, and what its own trim
leaves (`trims.Left`).

No strategy moves the shaft for granules that are already falling: nobody has measured the
effect of that (docs/decisions/0007).
"""

from __future__ import annotations

from collections.abc import Callable
from math import log

from topdress.control.machine.change_lag import SettledPair
from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.shaft import calc_dead_time_s, calc_time_constant_s
from topdress.control.orders import Strategy
from topdress.control.readings import DriveCommand

from .inverse_model import (
    Conditions,
    calc_flow_kg_s,
    find_gate_command,
    find_opening_mm,
    find_shaft_command,
)
from .strategies import DrivePair, find_pair
from .trims import NO_ERROR, DriveTrim, UncorrectedError

# A change of strategy is spread over this time, s.
STRATEGY_SWITCH_S = 4.0
# |log| of rate after over rate before, from which the gate makes the change in speed first: the
# edges of a map's zones, but not two grades of a canopy in one second.
ABRUPT_RATE_LOG_RATIO = 0.35
# Share of the opening by which it then returns in a second. The shaft compensates, so slowly that
# no tube shows it (0.6 s x 0.02 / s: 1 % of the flow, where granules fall singly).
RETURN_SHARE_PER_S = 0.02
# Share of the drawing out that granules falling singly need, while the tube is unknown: it
# minimises the worst error of both tubes (2.5 % in steady work, benchmarks other_machines).
DEFAULT_DRAWN_OUT_SHARE = 0.5
# Smaller moves of the shaft are not planned, r/min: the noise of the speed alone would make ten a
# second.
PLAN_BAND_RPM = 0.6
# Lower limit of that band, as a share of the shaft speed.
PLAN_BAND_SHARE = 0.008
# Upper limit of that band, as a share of the shaft speed: 0.6 of a slow shaft's 20 r/min would be 3
# % of the flow.
PLAN_BAND_MAX_SHARE = 0.0136
# Smaller moves of the gate are not planned, mm.
PLAN_BAND_MM = 0.15
# Lower limit of that band, as a share of the opening: each move wears the gate.
PLAN_BAND_MM_SHARE = 0.012
# Smaller changes of the shaft's command are not sent, r/min; they come from the trims.
COMMAND_BAND_RPM = 0.3
# Smaller changes of the gate's command are not sent, mm.
COMMAND_BAND_MM = 0.12


class PairPlanner:
    """Plans shaft speed and opening of a run by the strategy, and the transition while it is
    being changed. `plan_pair` is called once a tick, then `record_command` with the pair that was
    really commanded."""

    def __init__(self, machine: Machine, strategy: Strategy) -> None:
        self.machine = machine
        self.strategy = strategy.in_force
        self._shaft_answers_s = calc_dead_time_s(machine.shaft) + calc_time_constant_s(
            machine.shaft
        )
        self._drawn_out_share = (
            1.0 - machine.fall.carried_share
            if machine.is_tube_measured
            else DEFAULT_DRAWN_OUT_SHARE
        )
        # Pair of the last command; None for a standing shaft.
        self._last: DrivePair | None = None
        self._drawn_rpm: float | None = None
        self._before: Strategy | None = None
        # Opening at which speed first turns its shaft, mm.
        self._at_mm = machine.set_points.opening_mm
        self._switched_s = 0.0
        self.left = NO_ERROR
        # Flow of the pair over that of the pair without errors of the drives.
        self.compensation_factor = 1.0

    def switch_strategy(self, strategy: Strategy, now_s: float) -> None:
        """Changes the strategy from now on; the same one again changes nothing."""
        if strategy.in_force is not self.strategy:
            self._before, self.strategy, self._switched_s = self.strategy, strategy.in_force, now_s
            self._drawn_rpm = None

    def plan_pair(
        self,
        rate_kg_ha: float,
        mps_in: Callable[[float], float],
        now_s: float,
        dt_s: float,
        opening_now_mm: float,
        c: Conditions,
        left: UncorrectedError = NO_ERROR,
    ) -> DrivePair:
        """Returns the true shaft speed and opening to aim at, without small moves.

        Parameters
        ----------
        rate_kg_ha : rate for the material that is released now. mps_in : returns the ground speed
        expected a number of seconds from now, m/s. now_s, dt_s : present time and time since the
        last tick, s. opening_now_mm : expected present opening, mm. c : conditions of the flow.
        left : errors of the drives by their readings.
        """
        self.left = left
        machine, fall = self.machine, self.machine.fall
        shaft_moves = self._last is None or self.is_shaft_metering
        answers_s = self._shaft_answers_s if shaft_moves else machine.gate.dead_time_s
        turns_rpm = machine.set_points.shaft_rpm if self._last is None else self._last.shaft_rpm
        mps = mps_in(
            answers_s
            + 0.5 * dt_s
            + calc_drop_s(fall, (1.0 + left.shaft_share) * turns_rpm)
            + fall.latency_s
        )
        wanted_kg_s = rate_kg_ha * machine.geometry.working_width_m * mps / 10_000.0
        goal = self.find_goal(wanted_kg_s, now_s, opening_now_mm, c)
        self.compensation_factor = self._calc_compensation(goal, wanted_kg_s, opening_now_mm, c)
        if (
            goal.shaft_rpm > 0.0
            and self.is_shaft_metering
            and goal.opening_mm == self._at_mm
            and not goal.limited
        ):
            opening = self._drop_small_moves(goal).opening_mm
            limits, shaft = (
                machine.limits,
                self._draw_out_shaft(goal.shaft_rpm * goal.opening_mm / opening, dt_s),
            )
            goal = DrivePair(min(limits.shaft_high_rpm, max(limits.shaft_low_rpm, shaft)), opening)
        return self._drop_small_moves(goal) if goal.shaft_rpm > 0.0 else goal

    def _calc_compensation(
        self, goal: DrivePair, wanted_kg_s: float, opening_now_mm: float, c: Conditions
    ) -> float:
        if goal.shaft_rpm <= 0.0 or self.left == NO_ERROR:
            return 1.0
        plain = find_pair(self.machine, self.strategy, wanted_kg_s, opening_now_mm, c, self._at_mm)
        return calc_flow_kg_s(self.machine, *goal[:2], c) / calc_flow_kg_s(
            self.machine, *plain[:2], c
        )

    def record_command(self, pair: DrivePair) -> None:
        """Stores the pair that was commanded in this tick; a shaft speed of 0 stopped the flow."""
        self._last = pair if pair.shaft_rpm > 0.0 else None
        if self._last is None:
            self._drawn_rpm = None

    def _draw_out_shaft(self, settled_rpm: float, dt_s: float) -> float:
        """Returns the shaft speed of speed first on its way to the speed that gives the flow.

        Where granules fall singly, material released at n lands with 1 / (1 + drop'(n) dn/dt) of
        its flow: later granules fall faster. That is the flow of `settled_rpm` where dn/dt
        = (1 - n / settled) / -drop'(n)."""
        n, fall = self._drawn_rpm or settled_rpm, self.machine.fall
        sooner_s = (
            self._drawn_out_share * 0.5 * (calc_drop_s(fall, n - 1.0) - calc_drop_s(fall, n + 1.0))
        )
        # The share is at most 1: the shaft never goes past the settled speed.
        share = dt_s / max(dt_s, sooner_s * settled_rpm)
        self._drawn_rpm = n + share * (settled_rpm - n)
        return self._drawn_rpm

    def _drop_small_moves(self, planned: DrivePair) -> DrivePair:
        """Returns the pair without small moves, in steps of the drives' resolution."""
        limits, last = self.machine.limits, self._last
        shaft = opening = None
        if last is not None:
            band = max(
                PLAN_BAND_SHARE * last.shaft_rpm,
                min(PLAN_BAND_RPM, PLAN_BAND_MAX_SHARE * last.shaft_rpm),
            )
            if abs(planned.shaft_rpm - last.shaft_rpm) < band:
                shaft = last.shaft_rpm
            rests = (
                self.is_shaft_metering and planned.opening_mm == self.machine.set_points.opening_mm
            )
            band_mm = max(PLAN_BAND_MM, PLAN_BAND_MM_SHARE * last.opening_mm)
            if not rests and abs(planned.opening_mm - last.opening_mm) < band_mm:
                opening = last.opening_mm
        return DrivePair(
            _round_to_step(planned.shaft_rpm, limits.shaft_resolution_rpm)
            if shaft is None
            else shaft,
            _round_to_step(planned.opening_mm, limits.opening_resolution_mm)
            if opening is None
            else opening,
            planned.limited,
        )

    def find_settled_pair(
        self, wanted_kg_s: float, opening_now_mm: float, c: Conditions
    ) -> DrivePair:
        """Returns the pair of the present strategy as if it had always been in force."""
        return find_pair(
            self.machine, self.strategy, wanted_kg_s, opening_now_mm, c, self._at_mm, self.left
        )

    def find_gate_change_mm(self, before_kg_ha: float, after_kg_ha: float) -> float | None:
        """Returns the opening after a change of the rate that the gate makes in speed first, mm;
        None where the shaft makes it.

        At the edge of a map's zone the shaft would also move the material in the tube: a change
        from 450 to 150 kg/ha came 1.2 m late."""
        if not self.is_shaft_metering or min(before_kg_ha, after_kg_ha) <= 0.0:
            return None
        if abs(log(after_kg_ha / before_kg_ha)) < ABRUPT_RATE_LOG_RATIO:
            return None
        limits = self.machine.limits
        return min(
            limits.opening_high_mm,
            max(limits.opening_low_mm, self._at_mm * after_kg_ha / before_kg_ha),
        )

    def record_rate_change(self, before_kg_ha: float, after_kg_ha: float) -> None:
        """Records a change of the rate: where the gate makes the change, the opening changes
        too."""
        self._at_mm = self.find_gate_change_mm(before_kg_ha, after_kg_ha) or self._at_mm

    def return_opening(self, dt_s: float) -> None:
        """Returns the opening of speed first gradually to its set-point."""
        wanted, most = self.machine.set_points.opening_mm, RETURN_SHARE_PER_S * dt_s * self._at_mm
        self._at_mm += min(most, max(-most, wanted - self._at_mm))

    @property
    def is_shaft_metering(self) -> bool:
        """Returns whether the strategy is speed first and no change of strategy is under way."""
        return self.strategy is Strategy.SPEED_FIRST and self._before is None

    def find_goal(
        self, wanted_kg_s: float, now_s: float, opening_now_mm: float, c: Conditions
    ) -> DrivePair:
        """Returns the settled pair to plan towards. While the strategy changes the shaft goes
        over gradually, and the opening follows it."""
        goal = self.find_settled_pair(wanted_kg_s, opening_now_mm, c)
        if self._before is None:
            return goal
        share = (now_s - self._switched_s) / STRATEGY_SWITCH_S
        if share >= 1.0 or goal.shaft_rpm <= 0.0:
            self._before = None
            return goal
        start = find_pair(
            self.machine, self._before, wanted_kg_s, opening_now_mm, c, self._at_mm, self.left
        )
        limits = self.machine.limits
        shaft = max(limits.shaft_low_rpm, (1.0 - share) * start.shaft_rpm + share * goal.shaft_rpm)
        opening = (
            find_opening_mm(self.machine, wanted_kg_s, (1.0 + self.left.shaft_share) * shaft, c)
            - self.left.gate_mm
        )
        return DrivePair(
            shaft, min(limits.opening_high_mm, max(limits.opening_low_mm, opening)), goal.limited
        )

    def nudge_actuator(self, pair: SettledPair) -> SettledPair:
        """Returns the pair after a small change of rate by this strategy's own actuator."""
        if self.strategy is Strategy.SPEED_FIRST:
            return SettledPair(1.1 * pair.shaft_rpm, pair.opening_mm)
        return SettledPair(pair.shaft_rpm, 1.1 * pair.opening_mm)

    def make_untrimmed_command(self, pair: DrivePair, c: Conditions) -> DriveCommand:
        """Returns the set-points of the drives without trims and rounding; 0 stops the shaft."""
        if pair.shaft_rpm <= 0.0:
            return DriveCommand(0.0, find_gate_command(self.machine, pair.opening_mm, c))
        return DriveCommand(
            find_shaft_command(self.machine, pair.shaft_rpm, pair.opening_mm, c),
            find_gate_command(self.machine, pair.opening_mm, c),
        )

    def make_command(
        self, pair: DrivePair, c: Conditions, trim: DriveTrim, last: DriveCommand | None
    ) -> DriveCommand:
        """Returns the set-points of the drives: trimmed, rounded to the drives' resolution,
        without small moves."""
        bare = self.make_untrimmed_command(pair, c)
        if bare.shaft_rpm <= 0.0:
            stays = (
                last.opening_mm
                if last is not None
                else _round_to_step(bare.opening_mm, self._opening_step_mm)
            )
            return DriveCommand(0.0, stays)
        # A trim is a share of the command beyond the neutral point.
        neutral = self.machine.shaft.neutral_rpm
        shaft = neutral + (bare.shaft_rpm - neutral) * (1.0 + trim.shaft_share)
        opening = bare.opening_mm + trim.gate_mm
        if last is not None and last.shaft_rpm > 0.0:
            if abs(shaft - last.shaft_rpm) < COMMAND_BAND_RPM:
                shaft = last.shaft_rpm
            if abs(opening - last.opening_mm) < COMMAND_BAND_MM:
                opening = last.opening_mm
        return DriveCommand(
            _round_to_step(shaft, self.machine.limits.shaft_resolution_rpm),
            _round_to_step(opening, self._opening_step_mm),
        )

    def make_manual_command(self, shaft_rpm: float, opening_mm: float) -> DriveCommand:
        """Returns the command of a pair without trims and dead bands, in steps of the drives'
        resolution."""
        return DriveCommand(
            _round_to_step(shaft_rpm, self.machine.limits.shaft_resolution_rpm),
            _round_to_step(opening_mm, self._opening_step_mm),
        )

    @property
    def _opening_step_mm(self) -> float:
        return self.machine.limits.opening_resolution_mm


def _round_to_step(value: float, step: float) -> float:
    return round(round(value / step) * step, 6)
