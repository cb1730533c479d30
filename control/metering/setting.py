"""Which strategy plans, bumpless switching between them, and a pair to what goes on the wire: trims, rounding."""
from __future__ import annotations

from math import log

from control.machine.change_lag import Settled
from control.machine.machine import Machine
from control.orders import Strategy
from control.readings import DriveCommand

from .inverse import Conditions, gate_command, opening_for, shaft_command
from .strategies import Pair, pair_for
from .trims import DriveTrim

SWITCH_S = 4.0              # a change of strategy is spread over this long
ABRUPT = 0.35               # |log| of rate after over rate before, from which on speed first's gate makes the change:
                            # no two grades of a canopy in one second, but the edges of a map's zones
BACK_PER_S = 0.02           # share of the opening by which it then returns: the shaft makes up for it, so slowly that
                            # no tube shows it (0.6 s x 0.02 / s: 1 % of the flow, where granules fall singly)
SHAFT_BAND_RPM = 0.3        # smaller moves are not sent: the plan leaves out what it need not do, this is for the trims
OPENING_BAND_MM = 0.12


class Setting:
    """Holds the strategy and, while it is being changed, the one it comes from."""

    def __init__(self, machine: Machine, strategy: Strategy) -> None:
        self.machine = machine
        self.strategy = strategy
        self._before: Strategy | None = None
        self._at_mm = machine.set_points.opening_mm     # at which speed first turns its shaft
        self._switched_s = 0.0

    def switch(self, strategy: Strategy, now_s: float) -> None:
        if strategy is not self.strategy:
            self._before, self.strategy, self._switched_s = self.strategy, strategy, now_s

    def settled(self, wanted_kg_s: float, opening_now_mm: float, c: Conditions) -> Pair:
        """The pair of the present strategy, as if it had always been in force."""
        return pair_for(self.machine, self.strategy, wanted_kg_s, opening_now_mm, c, at_mm=self._at_mm)

    def by_gate(self, before_kg_ha: float, after_kg_ha: float) -> float | None:
        """Opening after a change of the rate that speed first leaves to the gate; None: the shaft makes it.

        Where a zone of a map ends, the shaft would take what is in the tube along: 450 to 150 kg/ha came 1.2 m late.
        """
        if not self.by_shaft or min(before_kg_ha, after_kg_ha) <= 0.0:
            return None
        if abs(log(after_kg_ha / before_kg_ha)) < ABRUPT:
            return None
        limits = self.machine.limits
        return min(limits.opening_high_mm, max(limits.opening_low_mm, self._at_mm * after_kg_ha / before_kg_ha))

    def changed(self, before_kg_ha: float, after_kg_ha: float) -> None:
        """A change of the rate was made: where the gate makes it, the opening goes along."""
        self._at_mm = self.by_gate(before_kg_ha, after_kg_ha) or self._at_mm

    def rests(self, dt_s: float) -> None:
        """The opening of speed first goes back to its set-point, slowly."""
        wanted, most = self.machine.set_points.opening_mm, BACK_PER_S * dt_s * self._at_mm
        self._at_mm += min(most, max(-most, wanted - self._at_mm))

    @property
    def at_mm(self) -> float:
        """Opening at which speed first turns its shaft: its set-point, or on the way back to it."""
        return self._at_mm

    @property
    def by_shaft(self) -> bool:
        """Speed first, and no change of strategy under way."""
        return self.strategy is Strategy.SPEED_FIRST and self._before is None

    @property
    def by_both(self) -> bool:
        """Balanced, no change of strategy under way, and known what the shaft does to what falls."""
        return self.strategy is Strategy.BALANCED and self._before is None and self.machine.stream_carries

    def goal(self, wanted_kg_s: float, now_s: float, opening_now_mm: float, c: Conditions) -> Pair:
        """The settled pair to plan towards. While a strategy is being changed the shaft glides over, and the opening
        goes with it."""
        goal = self.settled(wanted_kg_s, opening_now_mm, c)
        if self._before is None:
            return goal
        share = (now_s - self._switched_s) / SWITCH_S
        if share >= 1.0 or goal.shaft_rpm <= 0.0:
            self._before = None
            return goal
        start = pair_for(self.machine, self._before, wanted_kg_s, opening_now_mm, c, at_mm=self._at_mm)
        limits = self.machine.limits
        shaft = max(limits.shaft_low_rpm, (1.0 - share) * start.shaft_rpm + share * goal.shaft_rpm)
        opening = opening_for(self.machine, wanted_kg_s, shaft, c)
        return Pair(shaft, min(limits.opening_high_mm, max(limits.opening_low_mm, opening)), goal.limited)

    def nudged(self, pair: Settled) -> Settled:
        """The pair after a small change of rate, made by this strategy's own actuator."""
        if self.strategy is Strategy.SPEED_FIRST:
            return Settled(1.1 * pair.shaft_rpm, pair.opening_mm)
        return Settled(pair.shaft_rpm, 1.1 * pair.opening_mm)

    def wire(self, pair: Pair, c: Conditions) -> DriveCommand:
        """Set-points for the drives without trims and rounding; a stopped shaft is 0."""
        if pair.shaft_rpm <= 0.0:
            return DriveCommand(0.0, gate_command(self.machine, pair.opening_mm, c))
        return DriveCommand(shaft_command(self.machine, pair.shaft_rpm, pair.opening_mm, c),
                            gate_command(self.machine, pair.opening_mm, c))

    def command(self, pair: Pair, c: Conditions, trim: DriveTrim, last: DriveCommand | None) -> DriveCommand:
        """Set-points for the drives: trimmed, rounded to the drives' resolution, small moves left out."""
        bare = self.wire(pair, c)
        if bare.shaft_rpm <= 0.0:
            stays = last.opening_mm if last is not None else _rounded(bare.opening_mm, self._step_mm)
            return DriveCommand(0.0, stays)
        shaft = bare.shaft_rpm * (1.0 + trim.shaft_share)
        opening = bare.opening_mm + trim.gate_mm
        if last is not None and last.shaft_rpm > 0.0:
            if abs(shaft - last.shaft_rpm) < SHAFT_BAND_RPM:
                shaft = last.shaft_rpm
            if abs(opening - last.opening_mm) < OPENING_BAND_MM:
                opening = last.opening_mm
        return DriveCommand(_rounded(shaft, self.machine.limits.shaft_resolution_rpm), _rounded(opening, self._step_mm))

    def by_hand(self, shaft_rpm: float, opening_mm: float) -> DriveCommand:
        """A pair wanted as it is, in steps of the drives' resolution: no trims, no dead bands."""
        return DriveCommand(_rounded(shaft_rpm, self.machine.limits.shaft_resolution_rpm),
                            _rounded(opening_mm, self._step_mm))

    @property
    def _step_mm(self) -> float:
        return self.machine.limits.opening_resolution_mm


def _rounded(value: float, step: float) -> float:
    return round(round(value / step) * step, 6)
