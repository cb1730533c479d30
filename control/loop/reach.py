"""How far ahead a change of the target must be made; answers `targets.lag_correction.Reach`."""
from __future__ import annotations

from control.loop.moment import Moment
from control.machine.change_lag import ChangeLags, Lag, Settled
from control.machine.fall import drop_s
from control.machine.shaft import dead_s, lag_s
from control.metering.setting import Setting
from control.targets.profile import Change, Target

FARTHEST_S = 4.0                # changes are looked for this far ahead


class Reach:
    """At one tick. opening_mm: expected now; falls_s: of what is released now, as the plan has it; `look_ahead` False:
    changes are made where they belong; open_share: of the working width."""

    def __init__(self, setting: Setting, lags: ChangeLags, opening_mm: float, moment: Moment, look_ahead: bool,
                 falls_s: float, open_share: float = 1.0) -> None:
        self._setting = setting
        self._width_m = open_share * setting.machine.geometry.working_width_m
        self._lags = lags
        self._opening_mm = opening_mm
        self._speed = moment.speed_mps
        self._ahead = moment.ahead
        self._half_tick_s = 0.5 * moment.dt_s       # a change waits that long for its tick, on average
        self._falls_s = falls_s
        self._conditions = moment.conditions
        self._look_ahead = look_ahead
        self._kept: dict[float, Settled] = {}       # lag by rate: a tick asks for the same rate several times
        self.farthest_m = self._speed * FARTHEST_S + 1.0 if look_ahead else 0.0

    def lag(self, before: Target, change: Change) -> Lag:
        """Between two rates the plan's own: the shaft may be turning otherwise than it is going to, and where it makes
        the change alone, what lands is planned from its command to its landing. A start, a stop and a shaft that goes
        straight to its new speed are played through the model."""
        one, other = self._settled(before.rate_kg_ha), self._settled(change.target.rate_kg_ha)
        if one.shaft_rpm <= 0.0 or other.shaft_rpm <= 0.0:
            return self._lags.lag(one, other)
        machine, by_gate = self._setting.machine, self._setting.by_gate(before.rate_kg_ha, change.target.rate_kg_ha)
        fall, shaft = machine.fall, machine.shaft
        if by_gate is not None:
            other = Settled(one.shaft_rpm, by_gate)
        elif self._setting.by_shaft and one.opening_mm == other.opening_mm and (
                machine.stream_carries or machine.falls_singly):
            return Lag(dead_s(shaft), lag_s(shaft),
                       self._falls_s + fall.latency_s)
        lag = self._lags.lag(one, other)
        return Lag(lag.response_s, lag.transition_s,
                   max(0.0, lag.drop_s + self._falls_s - drop_s(fall, one.shaft_rpm)))

    def distance_m(self, lag: Lag) -> float:
        if not self._look_ahead:
            return 0.0
        return self._ahead.way_m(lag.total_s + self._half_tick_s)

    def switch_m(self, in_s: float, lag: Lag, answers_s: float) -> float:
        """Where what is to be released from `in_s` on lands, m ahead: `lag` of the change that the flow makes then,
        of which `answers_s` pass before what it releases is half-way."""
        if not self._look_ahead:
            return 0.0
        return self._ahead.way_m(in_s + max(0.0, lag.total_s - answers_s) + self._half_tick_s)

    def small_change_lag(self, held_kg_ha: float, else_kg_ha: float) -> Lag:
        """Lag of a small change from a rate; where that rate is nothing, from another one."""
        held = self._settled(held_kg_ha)
        if held.shaft_rpm <= 0.0:
            held = self._settled(else_kg_ha)
        return self._lags.lag(held, self._setting.nudged(held))

    def _settled(self, rate_kg_ha: float) -> Settled:
        found = self._kept.get(rate_kg_ha)
        if found is None:
            flow = rate_kg_ha * self._width_m * self._speed / 10_000.0
            pair = self._setting.settled(flow, self._opening_mm, self._conditions)
            found = self._kept[rate_kg_ha] = Settled(pair.shaft_rpm, pair.opening_mm)
        return found
