"""The pair of this tick, planned over the lag: what is released now for its landing, the shaft also for what lands now.

What lands is what was released, compressed or stretched by the shaft: with c = flow x drop time at release, the flow on
the ground is c / drop time at landing (`metering.tube`). So a machine has two hands of different length. The gate sets
what will land a whole lag later. The shaft sets that as well, and also, within its own 0.4 s, how fast everything
that is in the tube comes down: at 70 r/min six tenths of a change of shaft speed land at once. Each strategy plans
with the hands that it has:

opening first   the gate for the speed expected at landing; the shaft stays.
balanced        the same, and the shaft puts right what lands now: where the ground speed has become another one than
                what is landing was metered for, the tube comes down quicker or slower. Then it returns by itself to
                its set-point, because what was released meanwhile was metered for the new speed.
speed first     the shaft alone, over three falls ahead: what lands now and what will land of it pull at the same speed,
                least squares over both decide (`_shaft_alone`). Abrupt changes are the gate's (`Setting.by_gate`).

That is so where the stream in the tube carries what falls, and no test of starts tells whether it does. Where it is not
known (`Machine.tube_is_settled`) no plan counts on it: balanced keeps its shaft still, speed first goes straight to the
settled speed of what is released. Where granules are known to fall singly, the shaft changes nothing of what has left
it: balanced keeps it still, and speed first's changes are drawn out so that nothing overtakes (`_stretched`). Why:
docs/decisions/0007.

Limits are kept by clamping: what is released is noted as it was commanded, so that what a limit or a dead band took
away is made good by the shaft where it may. Why this and no solver: docs/decisions/0006.
"""
from __future__ import annotations

from collections.abc import Callable
from math import exp, log
from typing import NamedTuple, Protocol

from control.machine.fall import Fall, drop_s
from control.machine.machine import Machine
from control.machine.shaft import dead_s, lag_s

from .inverse import Conditions, flow_kg_s, opening_for
from .setting import Setting
from .strategies import Pair
from .tube import Tube

SHAFT_BAND_RPM = 0.6            # smaller moves are not made: the noise of the speed alone would make ten a second
SHAFT_BAND_SHARE = 0.008        # of the shaft speed: not less than this ...
SHAFT_BAND_MOST = 0.0136        # ... nor more: 0.6 of a slow shaft's 20 r/min would be 3 % of the flow
OPENING_BAND_MM = 0.15
OPENING_BAND_SHARE = 0.012      # of the opening; the gate's moves are what wears ...
OPENING_BAND_BOTH_SHARE = 0.025     # ... and where the shaft makes good what it leaves out
SHAFT_LOW_SHARE = 0.65          # of its set-point, to which the shaft may fall while it puts right what lands: the gate
                                # cannot open as fast as it would have to for a slower shaft
FALLS_AHEAD = 3                 # of speed first's plan
STATIC_WEIGHT = 0.03            # against the plan's wish to leave the settled shaft speed
UNSETTLED_SHARE = 0.5           # of the drawing out that granules which fall singly need, while nobody knows
LEAST_ELASTICITY = 0.05         # of drop time over shaft speed: below, the shaft changes nothing of what falls
TURNING_SHARE = 0.8             # of the shaft speed meant: slower, it is still running up


class SpeedForecast(Protocol):
    def mps(self, in_s: float) -> float: ...

    def way_m(self, in_s: float) -> float: ...


class Wanted(NamedTuple):
    """At one tick. `rate_at`: kg/ha that are to lie at a distance ahead of the outlets, nudge and limit included."""

    time_s: float
    dt_s: float
    rate_kg_ha: float                       # for what is released now
    rate_at: Callable[[float], float]
    ahead: SpeedForecast


class Planner:
    """One of a run. `pair` once a tick, then `made` with what was really commanded."""

    def __init__(self, machine: Machine, setting: Setting) -> None:
        shaft = machine.shaft
        self._machine = machine
        self._setting = setting
        self._width_m = machine.geometry.working_width_m
        self._shaft_answers_s = dead_s(shaft) + lag_s(shaft)
        self._tube = Tube(machine.fall, self._shaft_answers_s)
        self._last: Pair | None = None          # as commanded; None: the shaft stands
        self._noted: tuple[float, float] | None = None
        self._by_shaft = False
        self._stretched_rpm: float | None = None
        self._running_drop_s = drop_s(machine.fall, machine.set_points.shaft_rpm)

    def falls_s(self, now_s: float) -> float:
        """How long what is released now will fall, as the shaft was commanded so far."""
        return self._tube.lands_s(now_s) - now_s

    def pair(self, wanted: Wanted, expected: Pair, c: Conditions) -> Pair:
        """True shaft speed and opening to aim at, small moves left out."""
        by_shaft = self._setting.by_shaft
        if by_shaft is not self._by_shaft:
            self._by_shaft = by_shaft
            self._tube.empty()              # the notes of the one mean nothing to the other
            self._stretched_rpm = None
        gate, half_s = self._machine.gate, 0.5 * wanted.dt_s
        turns_s = wanted.time_s + self._shaft_answers_s + half_s
        released_s = turns_s if by_shaft else wanted.time_s + gate.dead_time_s + half_s
        lands_s = self._machine.fall.latency_s + (
            self._tube.lands_s(released_s) if self._last is not None else turns_s + self._running_drop_s)
        mps = wanted.ahead.mps(lands_s - wanted.time_s)
        flow = self._flow(wanted.rate_kg_ha, mps)
        goal = self._setting.goal(flow, wanted.time_s, expected.opening_mm, c)
        self._noted = None
        if goal.shaft_rpm <= 0.0:
            return goal
        self._running_drop_s = drop_s(self._machine.fall, goal.shaft_rpm)
        if by_shaft and goal.opening_mm == self._setting.at_mm and not goal.limited:
            planned = self._quiet(self._by_the_shaft(wanted, turns_s, goal, c))
            self._noted = turns_s, planned.shaft_rpm * planned.opening_mm / self._machine.set_points.opening_mm
            return planned
        shaft = goal.shaft_rpm
        if self._setting.by_both and self._last is not None:
            shaft = self._paced(wanted, turns_s, goal.shaft_rpm)
        turning = self._tube.rpm_at(released_s)
        if turning < TURNING_SHARE * goal.shaft_rpm:
            planned = self._quiet(Pair(shaft, goal.opening_mm, goal.limited))
            self._noted = released_s, mps * drop_s(self._machine.fall, goal.shaft_rpm)
            return planned
        planned = self._quiet(Pair(shaft, self._opening(flow, turning, goal, c), goal.limited))
        per_rate = self._flow(wanted.rate_kg_ha, 1.0)
        given = flow_kg_s(self._machine, turning, planned.opening_mm, c)
        self._noted = released_s, given * drop_s(self._machine.fall, turning) / per_rate
        return planned

    def made(self, now_s: float, pair: Pair) -> None:
        """What was commanded in this tick; a shaft of 0: flow was stopped."""
        self._tube.command(now_s, pair.shaft_rpm)
        if pair.shaft_rpm <= 0.0:
            self._last = self._stretched_rpm = None
            self._tube.empty()
            return
        self._last = pair
        if self._noted is not None:
            self._tube.release(*self._noted)

    def _flow(self, rate_kg_ha: float, mps: float) -> float:
        return rate_kg_ha * self._width_m * mps / 10_000.0

    def _opening(self, flow: float, turning_rpm: float, goal: Pair, c: Conditions) -> float:
        """For a shaft that turns otherwise at release than it is meant to at landing: c = flow x drop time counts."""
        fall, limits = self._machine.fall, self._machine.limits
        if turning_rpm == goal.shaft_rpm:
            return goal.opening_mm
        released = flow * drop_s(fall, goal.shaft_rpm) / max(1e-3, drop_s(fall, turning_rpm))
        return min(limits.opening_high_mm,
                   max(limits.opening_low_mm, opening_for(self._machine, released, turning_rpm, c)))

    def _paced(self, wanted: Wanted, turns_s: float, goal_rpm: float) -> float:
        """The shaft speed at which what lands when the shaft has answered suits the ground speed of then."""
        suits = self._tube.landing(turns_s)
        mps = wanted.ahead.mps(turns_s + self._machine.fall.latency_s - wanted.time_s)
        if suits is None or not mps > 0.0:
            return goal_rpm
        low = max(self._machine.limits.shaft_low_rpm, SHAFT_LOW_SHARE * goal_rpm)
        return _rpm_for_drop(self._machine.fall, suits / mps, goal_rpm, low, self._machine.limits.shaft_high_rpm)

    def _by_the_shaft(self, wanted: Wanted, turns_s: float, goal: Pair, c: Conditions) -> Pair:
        """Speed first's pair: the shaft goes with the flow, the opening is where it is, or on its way back."""
        if self._machine.stream_carries and goal.opening_mm == self._machine.set_points.opening_mm:
            return Pair(self._shaft_alone(wanted, turns_s, goal, c), goal.opening_mm)
        opening = self._quiet(goal).opening_mm
        shaft = goal.shaft_rpm * goal.opening_mm / opening
        if not self._machine.stream_carries:
            shaft = self._stretched(shaft, wanted.dt_s)
        return Pair(min(self._machine.limits.shaft_high_rpm, max(self._machine.limits.shaft_low_rpm, shaft)), opening)

    def _stretched(self, settled_rpm: float, dt_s: float) -> float:
        """The shaft speed of the next tick where granules fall singly, for what is to land when this tick's does.

        What is released at n lands with 1 / (1 + drop'(n) dn/dt) of its flow: later granules come down sooner. That is
        the flow of `settled_rpm` where dn/dt = (1 - n / settled) / -drop'(n). While nobody knows, half of that: the
        least that the worst of the two is then off (2.5 % in steady work, benchmarks/other_machines.py).
        """
        n, fall = self._stretched_rpm or settled_rpm, self._machine.fall
        drawn_out = 1.0 if self._machine.falls_singly else UNSETTLED_SHARE
        sooner = drawn_out * 0.5 * (drop_s(fall, n - 1.0) - drop_s(fall, n + 1.0))
        share = dt_s / max(dt_s, sooner * settled_rpm)          # never past it
        self._stretched_rpm = n + share * (settled_rpm - n)
        return self._stretched_rpm

    def _shaft_alone(self, wanted: Wanted, turns_s: float, goal: Pair, c: Conditions) -> float:
        """The shaft speed to command where the opening stays.

        A shaft speed u held at time T makes a share e of what lands at T (its pace) and 1 - e of what lands a fall
        later (its flow x drop time); e is the elasticity of the drop time. In logarithms, for T, T + D, T + 2D ...:
        e u_j + (1 - e) u_(j-1) = s_j, the settled speed that gives what is to land; u_(-1) is what is in the tube.
        Solved by least squares with a small weight that holds u_j at s_j: for e near one half the equations alone
        would swing.
        """
        machine, limits = self._machine, self._machine.limits
        rpm = goal.shaft_rpm if self._last is None else self._last.shaft_rpm
        falls_s, e = drop_s(machine.fall, rpm), _elasticity(machine.fall, rpm)
        in_s = turns_s + machine.fall.latency_s - wanted.time_s
        mps = [wanted.ahead.mps(in_s + j * falls_s) for j in range(FALLS_AHEAD + 1)]
        rates = [wanted.rate_at(wanted.ahead.way_m(in_s + j * falls_s)) for j in range(FALLS_AHEAD + 1)]
        rates[1] = wanted.rate_kg_ha
        rates = [rate if self._setting.by_gate(rates[1], rate) is None else rates[1] for rate in rates]
        settled = [min(limits.shaft_high_rpm, max(limits.shaft_low_rpm, self._setting.settled(
            self._flow(rate, v), goal.opening_mm, c).shaft_rpm)) for rate, v in zip(rates, mps, strict=True)]
        before = self._tube.landing(turns_s)
        in_tube = settled[0] if before is None else before
        u = _two_sided([log(s) for s in settled], log(max(limits.shaft_low_rpm, in_tube)), e)
        return min(limits.shaft_high_rpm, max(limits.shaft_low_rpm, exp(u)))

    def _quiet(self, planned: Pair) -> Pair:
        """The pair with small moves left out, and in steps of the drives' resolution."""
        limits, last = self._machine.limits, self._last
        shaft = _stepped(planned.shaft_rpm, limits.shaft_resolution_rpm)
        opening = _stepped(planned.opening_mm, limits.opening_resolution_mm)
        if last is not None:
            band = max(SHAFT_BAND_SHARE * last.shaft_rpm, min(SHAFT_BAND_RPM, SHAFT_BAND_MOST * last.shaft_rpm))
            if abs(planned.shaft_rpm - last.shaft_rpm) < band:
                shaft = last.shaft_rpm
            share = OPENING_BAND_BOTH_SHARE if self._setting.by_both else OPENING_BAND_SHARE
            rests = self._setting.by_shaft and planned.opening_mm == self._machine.set_points.opening_mm
            if not rests and abs(planned.opening_mm - last.opening_mm) < max(OPENING_BAND_MM, share * last.opening_mm):
                opening = last.opening_mm
        return Pair(shaft, opening, planned.limited)


def _two_sided(settled: list[float], before: float, e: float) -> float:
    """u_0 of the least squares of `_shaft_alone`: a tridiagonal system, solved from its end."""
    a, w = 1.0 - e, STATIC_WEIGHT
    last = len(settled) - 1
    diagonal = [e * e + w + (a * a if j < last else 0.0) for j in range(last + 1)]
    right = [e * (settled[j] - (a * before if j == 0 else 0.0)) + w * settled[j] + (a * settled[j + 1] if j < last
             else 0.0) for j in range(last + 1)]
    off = a * e
    for j in range(last, 0, -1):
        share = off / diagonal[j]
        diagonal[j - 1] -= share * off
        right[j - 1] -= share * right[j]
    return right[0] / diagonal[0]


def _elasticity(fall: Fall, rpm: float) -> float:
    """Share by which the drop time falls for a share of more shaft speed, between 0 and 0.95."""
    here = drop_s(fall, rpm)
    if not here > 0.0:
        return 0.0
    return min(0.95, max(0.0, (drop_s(fall, 0.98 * rpm) - drop_s(fall, 1.02 * rpm)) / (0.04 * here)))


def _rpm_for_drop(fall: Fall, wanted_s: float, rpm: float, low: float, high: float) -> float:
    """The shaft speed from `low` to `high` whose drop time is `wanted_s`; where it hardly changes: `rpm`."""
    at = min(high, max(low, rpm))
    for _ in range(3):
        e, here = _elasticity(fall, at), drop_s(fall, at)
        if e < LEAST_ELASTICITY or not here > 0.0:
            return rpm
        at *= min(2.0, max(0.5, (here / max(1e-3, wanted_s)) ** (1.0 / e)))
        at = min(high, max(low, at))
    return at


def _stepped(value: float, step: float) -> float:
    return round(round(value / step) * step, 6)
