"""Do shaft, gate and valves stand while they are commanded to? The check runs in every state. Pure.

A stop is a command to a drive, not a fact. A decelerating shaft is no fault: the alarm requires a
shaft that turns although it stands by the machine model, and does not decelerate. A gate may first
travel to its set-point. A valve has its closing time.
"""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.readings import is_reading_fresh
from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.safety_interface import SafetySituation
from topdress.control.safety.sensor_validity import ValidReadings, find_since_s, has_lasted

# A shaft decelerates while it is below this share of its highest speed since the last deceleration.
SLOWING_SHARE = 0.9


class ShaftStand(NamedTuple):
    """Holds the state of the metering shaft while it is commanded to stop."""

    # Start of the uninterrupted stop command, s; None while the shaft is commanded to turn.
    commanded_since_s: float | None = None
    # Time since which the shaft stands by the machine model, s.
    settled_since_s: float | None = None
    # Highest reading since the last deceleration, r/min.
    slows_from_rpm: float | None = None
    # Time of the last deceleration, s.
    slowed_s: float = 0.0
    turning_since_s: float | None = None
    # Whether the shaft turns despite a stop command.
    turns: bool = False


class GateStand(NamedTuple):
    """Holds the state of the gate while flow is forbidden: its set-point is constant, so the
    gate must stand."""

    # Newest set-point that the gate should follow, mm; None before the first.
    commanded_mm: float | None = None
    # Lowest reading since flow was forbidden, mm: a closing gate may start higher.
    lowest_mm: float | None = None
    opening_since_s: float | None = None
    opens: bool = False
    # Highest reading of an opening gate, mm, and the time of its last rise, s.
    highest_mm: float | None = None
    rose_s: float | None = None


class ValveStand(NamedTuple):
    """Holds the state of the section valves that are commanded closed, on machines whose board
    reports their positions."""

    # Time since which each valve reads open, after its closing time, s.
    open_since_s: tuple[float | None, ...] = ()
    # Time since which each valve is commanded closed, s.
    closed_since_s: tuple[float | None, ...] = ()
    # Numbers of the sections that stay open, from 1.
    stuck: tuple[int, ...] = ()


SHAFT_TURNING, NO_VALVES = ShaftStand(), ValveStand()


class StandstillWatch(NamedTuple):
    """Holds the states of all drives that must stand."""

    shaft: ShaftStand = SHAFT_TURNING
    gate: GateStand = GateStand()
    valves: ValveStand = NO_VALVES


def update_standstill(
    before: StandstillWatch,
    now_s: float,
    s: SafetySituation,
    seen: ValidReadings,
    limits: SafetyLimits,
) -> StandstillWatch:
    """Returns the watch after this tick."""
    return StandstillWatch(
        _watch_shaft(before.shaft, now_s, s, seen, limits),
        _watch_gate(before.gate, now_s, s, seen, limits),
        _watch_valves(before.valves, now_s, s, limits),
    )


def _watch_shaft(
    before: ShaftStand, now_s: float, s: SafetySituation, seen: ValidReadings, limits: SafetyLimits
) -> ShaftStand:
    if s.commanded.turn:
        return SHAFT_TURNING
    rpm = seen.shaft_rpm
    turning = rpm is not None and rpm >= limits.shaft_stands_rpm
    slows_from, slowed_s = before.slows_from_rpm, before.slowed_s
    if rpm is not None and (slows_from is None or rpm < SLOWING_SHARE * slows_from):
        slows_from, slowed_s = rpm, now_s
    elif rpm is not None and slows_from is not None:
        # A shaft that is stopped within its dead time first accelerates.
        slows_from = max(slows_from, rpm)
    settled = find_since_s(
        before.settled_since_s, now_s, s.commanded.expected_rpm < limits.shaft_stands_rpm
    )
    turning_since = find_since_s(before.turning_since_s, now_s, turning)
    runs_down = not has_lasted(slowed_s, now_s, limits.stand_confirm_s) and not has_lasted(
        settled, now_s, limits.run_down_max_s
    )
    return ShaftStand(
        now_s if before.commanded_since_s is None else before.commanded_since_s,
        settled,
        slows_from,
        slowed_s,
        turning_since,
        has_lasted(turning_since, now_s, limits.stand_confirm_s)
        and has_lasted(settled, now_s, limits.stand_settle_s)
        and not runs_down,
    )


def _watch_gate(
    before: GateStand, now_s: float, s: SafetySituation, seen: ValidReadings, limits: SafetyLimits
) -> GateStand:
    """Monitors the gate, which may be neither above its set-point nor above its earlier position.

    A board without an enable line keeps the last set-point that it followed, and at power-on the
    gate's position.
    """
    commanded_mm = s.commanded.opening_mm if s.commanded.enabled else before.commanded_mm
    if s.commanded.flow:
        return GateStand(commanded_mm)
    read = seen.opening_mm
    if read is None:
        return GateStand(commanded_mm, before.lowest_mm)
    lowest = read if before.lowest_mm is None else min(before.lowest_mm, read)
    most_mm = lowest if commanded_mm is None else max(lowest, commanded_mm)
    opening = find_since_s(before.opening_since_s, now_s, read > most_mm + limits.gate_stands_mm)
    highest, rose_s = before.highest_mm, before.rose_s
    if opening is None or highest is None or read > highest + limits.gate_stands_mm / 6.0:
        highest, rose_s = read, now_s
    stands = opening is not None and has_lasted(rose_s, now_s, limits.run_down_max_s)
    if stands and not s.commanded.enabled:
        # A gate without power stays wherever it came to a stand. READY, which alone gives it a
        # set-point again, would otherwise be refused for ever.
        return GateStand(None, read)
    opens = has_lasted(opening, now_s, limits.stand_confirm_s)
    return GateStand(commanded_mm, lowest, opening, opens, highest, rose_s)


def _watch_valves(
    before: ValveStand, now_s: float, s: SafetySituation, limits: SafetyLimits
) -> ValveStand:
    commanded, seen = s.commanded.valves, s.measurements.valves
    if (
        not commanded
        or seen is None
        or not is_reading_fresh(seen.time_s, now_s, limits.drive_silent_s)
    ):
        return NO_VALVES
    count = min(len(commanded), len(seen.open))
    closed = _match_count(before.closed_since_s, count)
    opened = _match_count(before.open_since_s, count)
    closed_since = tuple([find_since_s(closed[k], now_s, not commanded[k]) for k in range(count)])
    open_since = tuple(
        [
            find_since_s(
                opened[k],
                now_s,
                seen.open[k] and has_lasted(closed_since[k], now_s, limits.valve_closes_s),
            )
            for k in range(count)
        ]
    )
    return ValveStand(
        open_since,
        closed_since,
        tuple(
            [
                k + 1
                for k in range(count)
                if has_lasted(open_since[k], now_s, limits.stand_confirm_s)
            ]
        ),
    )


def _match_count(before: tuple[float | None, ...], count: int) -> tuple[float | None, ...]:
    return before if len(before) == count else (None,) * count
