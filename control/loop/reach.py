"""How far ahead a change of the target must be made; answers `targets.lag_correction.Reach`."""
from __future__ import annotations

from control.loop.moment import Moment
from control.machine.change_lag import ChangeLags, Lag, Settled
from control.machine.fall import thinned
from control.metering.setting import Setting
from control.sensing import travelled_ahead_m
from control.targets.profile import Change, Profile, Target

FARTHEST_S = 4.0                # changes are looked for this far ahead


class Reach:
    """At one tick. opening_mm: expected now; `look_ahead` False: changes are made where they belong."""

    def __init__(self, setting: Setting, lags: ChangeLags, opening_mm: float, moment: Moment, look_ahead: bool) -> None:
        self._setting = setting
        self._width_m = setting.machine.geometry.working_width_m
        self._lags = lags
        self._opening_mm = opening_mm
        self._speed = moment.speed_mps
        self._acceleration = moment.sensed.acceleration_mps2
        self._conditions = moment.conditions
        self._look_ahead = look_ahead
        self._dt_s = moment.dt_s
        self._kept: dict[float, Settled] = {}       # lag by rate: a tick asks for the same rate several times
        self.farthest_m = self._speed * FARTHEST_S + 1.0 if look_ahead else 0.0

    def lag(self, before: Target, change: Change) -> Lag:
        return self._lags.lag(self._settled(before.rate_kg_ha), self._settled(change.target.rate_kg_ha))

    def distance_m(self, lag: Lag) -> float:
        """A command holds until the next tick: of the two ticks about the right moment the nearer one is taken."""
        if not self._look_ahead:
            return 0.0
        return travelled_ahead_m(self._speed, self._acceleration, lag.total_s + 0.5 * self._dt_s)

    def thinned(self, profile: Profile, track_m: float, held: Target, lag: Lag) -> float:
        """Flow that lands over flow released now: when this lands, the target further ahead sets the shaft's speed.

        1 without look-ahead, and where what lies there is not known to go on from here.
        """
        if not self._look_ahead or held.rate_kg_ha <= 0.0:
            return 1.0
        later = profile.at(track_m + self.distance_m(lag) + self._speed * lag.drop_s)
        if later.source is not held.source or later.rate_kg_ha <= 0.0:
            return 1.0
        return thinned(self._setting.machine.fall, self._settled(held.rate_kg_ha).shaft_rpm,
                       self._settled(later.rate_kg_ha).shaft_rpm)

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
