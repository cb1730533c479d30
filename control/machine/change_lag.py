"""How long does a change of set-points take from the command until half of the landed step? (lag
papers)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .fall import calc_drop_s
from .landing import calc_fall_times_s
from .machine import Machine
from .shaft import calc_acceleration_rpm_s, calc_dead_time_s, calc_time_constant_s, follow_command


class SettledPair(NamedTuple):
    """Holds true shaft speed and opening before or after a change."""

    shaft_rpm: float
    opening_mm: float


class LagParts(NamedTuple):
    """Holds the parts of a lag, s. `response_s`: dead time of the slowest moving actuator;
    `transition_s`: half of its travel time; `drop_s`: drop time."""

    response_s: float
    transition_s: float
    drop_s: float

    @property
    def total_s(self) -> float:
        return self.response_s + self.transition_s + self.drop_s


# Step of the small simulation of one change, s.
SIMULATION_STEP_S = 0.0125
# Tolerance of the middle rate, s: where two parcels fit equally, a rise takes the first parcel, a
# fall the last.
TIE_TOLERANCE = 1e-9
# Simulated time after the slowest drive began to move, s.
SETTLING_S = 1.0
# Lags are cached by pairs rounded to these steps, r/min and mm.
CACHE_STEP_RPM = 1.0
CACHE_STEP_MM = 0.5


class ChangeLags:
    """Caches the lags of changes under one machine model.

    A change is simulated with the model: shaft and gate move, parcels are carried along in the
    tube, and the lag is the time from the command to the half-way point of the landed step,
    defined as for rate and place errors (the best fitting step). Neither half a transition nor
    the drop time of a single shaft speed suffices: while the shaft speeds up, falling material
    is carried faster than when it was released."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._kept: dict[tuple[int, int, int, int], LagParts] = {}

    def find_lag(self, before: SettledPair, after: SettledPair) -> LagParts:
        key = (
            round(before.shaft_rpm / CACHE_STEP_RPM),
            round(before.opening_mm / CACHE_STEP_MM),
            round(after.shaft_rpm / CACHE_STEP_RPM),
            round(after.opening_mm / CACHE_STEP_MM),
        )
        found = self._kept.get(key)
        if found is None:
            found = self._kept[key] = calc_change_lag(
                self._machine,
                SettledPair(key[0] * CACHE_STEP_RPM, key[1] * CACHE_STEP_MM),
                SettledPair(key[2] * CACHE_STEP_RPM, key[3] * CACHE_STEP_MM),
            )
        return found


def calc_change_lag(machine: Machine, before: SettledPair, after: SettledPair) -> LagParts:
    """Returns the lag of a change from one settled pair to another, s (lag paper: system response
    plus drop time).

    If neither drive moves, or the change is from zero to zero, the lag is the gate's response plus
    the drop time.
    """
    fall, shaft, gate = machine.fall, machine.shaft, machine.gate
    dead_shaft = calc_dead_time_s(shaft)
    moves_shaft = abs(after.shaft_rpm - before.shaft_rpm) > 0.5 * CACHE_STEP_RPM
    moves_gate = abs(after.opening_mm - before.opening_mm) > 0.5 * CACHE_STEP_MM
    response = dead_shaft if moves_shaft and not moves_gate else gate.dead_time_s
    if moves_shaft and moves_gate:
        response = min(dead_shaft, gate.dead_time_s)
    rising = after.shaft_rpm * after.opening_mm > before.shaft_rpm * before.opening_mm
    extra = fall.latency_s + (-0.5 if rising else 0.5) * fall.asymmetry_s
    if before.shaft_rpm <= 0.0:
        extra += fall.first_fill_s
    drop = max(0.0, calc_drop_s(fall, max(before.shaft_rpm, after.shaft_rpm)) + extra)
    if not moves_shaft and not moves_gate:
        return LagParts(response, 0.0, drop)
    landed = _find_half_way_s(machine, before, after, rising)
    return LagParts(response, 0.0 if landed is None else landed + extra - response - drop, drop)


def _find_half_way_s(
    machine: Machine, before: SettledPair, after: SettledPair, rising: bool
) -> float | None:
    """Returns the time from the command to the half-way point of the landed step, s, without the
    effects of the direction."""
    shaft, gate = machine.shaft, machine.gate
    dead_shaft = calc_dead_time_s(shaft)
    tau = calc_time_constant_s(shaft) + shaft.second_order_s
    slew = max(0.5, gate.slew_mm_s - gate.slow_mm_s)
    rpm, rate, opening = before.shaft_rpm, 0.0, before.opening_mm
    lasts = (
        max(
            dead_shaft + 3.0 * tau + abs(after.shaft_rpm - rpm) / calc_acceleration_rpm_s(shaft),
            gate.dead_time_s + abs(after.opening_mm - opening) / slew,
        )
        + SETTLING_S
    )
    lead, drop = int(2.0 / SIMULATION_STEP_S), calc_drop_s(machine.fall, rpm)
    times = [k * SIMULATION_STEP_S for k in range(-lead, int(lasts / SIMULATION_STEP_S))]
    masses, drops = [rpm * opening] * lead, [drop] * lead
    for now in times[lead:]:
        if now >= dead_shaft and rpm != after.shaft_rpm:
            rpm, rate = follow_command(shaft, rpm, rate, after.shaft_rpm, SIMULATION_STEP_S)
            drop = calc_drop_s(machine.fall, rpm)
        if now >= gate.dead_time_s and opening != after.opening_mm:
            opening += min(
                slew * SIMULATION_STEP_S, max(-slew * SIMULATION_STEP_S, after.opening_mm - opening)
            )
        masses.append(rpm * opening)
        drops.append(drop)
    released = np.array(times)
    reached = released + calc_fall_times_s(released, np.array(drops), machine.fall.carried_share)
    # Where granules fall singly, later ones may land first.
    order = np.argsort(reached, kind="stable")
    lands_s = reached[order].tolist()
    weights = np.array(masses)[order].tolist()
    middle = 0.5 * (before.shaft_rpm * before.opening_mm + after.shaft_rpm * after.opening_mm)
    pull, tie = (middle, -TIE_TOLERANCE * middle) if rising else (-middle, TIE_TOLERANCE * middle)
    push_s = SIMULATION_STEP_S if rising else -SIMULATION_STEP_S
    fit, best, at = 0.0, 0.0, None
    last = lands_s[0]
    for lands, mass in zip(lands_s, weights, strict=True):
        fit -= pull * (lands - last)
        if rising and fit < best + tie and lands > 0.0:
            best, at = fit, lands
        fit += push_s * mass
        if not rising and fit < best + tie and lands > 0.0:
            best, at = fit, lands
        last = lands
    return at
