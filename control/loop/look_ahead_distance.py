"""How far ahead must a change of the target be made? The class answers
`targets.lag_correction.LookAheadDistance`.
"""

from __future__ import annotations

from topdress.control.loop.tick_state import MeasuredState
from topdress.control.machine.change_lag import ChangeLags, LagParts, SettledPair
from topdress.control.metering.pair_planner import PairPlanner
from topdress.control.targets.target_profile import Target, TargetChange

# Maximum look-ahead time for changes, s.
MAX_LOOK_AHEAD_S = 4.0


class TickLookAhead:
    """Calculates lags and distances of one tick. opening_mm: expected now; `look_ahead`: False
    makes changes at their position; open_share: open share of the working width."""

    def __init__(
        self,
        setting: PairPlanner,
        lags: ChangeLags,
        opening_mm: float,
        moment: MeasuredState,
        look_ahead: bool,
        open_share: float = 1.0,
    ) -> None:
        self._setting = setting
        self._width_m = open_share * setting.machine.geometry.working_width_m
        self._lags = lags
        self._opening_mm = opening_mm
        self._speed = moment.speed_mps
        self._ahead = moment.ahead
        # Mean waiting time of a change for its tick, s.
        self._half_tick_s = 0.5 * moment.dt_s
        self._conditions = moment.conditions
        self._look_ahead = look_ahead
        # Settled pairs by rate, because a tick needs the same rate several times.
        self._kept: dict[float, SettledPair] = {}
        self.max_reach_m = self._speed * MAX_LOOK_AHEAD_S + 1.0 if look_ahead else 0.0

    def find_lag(self, before: Target, change: TargetChange) -> LagParts:
        """Returns the lag of a change between two settled pairs, simulated with the model."""
        one, other = (
            self._find_settled(before.rate_kg_ha),
            self._find_settled(change.target.rate_kg_ha),
        )
        by_gate = self._setting.find_gate_change_mm(before.rate_kg_ha, change.target.rate_kg_ha)
        if by_gate is not None and one.shaft_rpm > 0.0 and other.shaft_rpm > 0.0:
            other = SettledPair(one.shaft_rpm, by_gate)
        return self._lags.find_lag(one, other)

    def find_distance_m(self, lag: LagParts) -> float:
        if not self._look_ahead:
            return 0.0
        return self._ahead.predict_way_m(lag.total_s + self._half_tick_s)

    def find_switch_m(self, in_s: float, lag: LagParts, answers_s: float) -> float:
        """Returns the landing distance ahead of material released from `in_s` on, m.

        `find_lag` gives the lag of the change of flow; `answers_s` of it pass before the release is
        half-way.
        """
        if not self._look_ahead:
            return 0.0
        return self._ahead.predict_way_m(
            in_s + max(0.0, lag.total_s - answers_s) + self._half_tick_s
        )

    def find_small_change_lag(self, held_kg_ha: float, else_kg_ha: float) -> LagParts:
        """Returns the lag of a small change from a rate, or, where that rate is 0, from another
        rate."""
        held = self._find_settled(held_kg_ha)
        if held.shaft_rpm <= 0.0:
            held = self._find_settled(else_kg_ha)
        return self._lags.find_lag(held, self._setting.nudge_actuator(held))

    def _find_settled(self, rate_kg_ha: float) -> SettledPair:
        found = self._kept.get(rate_kg_ha)
        if found is None:
            flow = rate_kg_ha * self._width_m * self._speed / 10_000.0
            pair = self._setting.find_settled_pair(flow, self._opening_mm, self._conditions)
            turns_rpm = (1.0 + self._setting.left.shaft_share) * pair.shaft_rpm
            found = self._kept[rate_kg_ha] = SettledPair(turns_rpm, pair.opening_mm)
        return found
