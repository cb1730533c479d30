"""How fast does the wheel turn? Ground speed from its pulses and the board's own clock, so that
the link's jitter has no effect."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from topdress.drivers.devices.board_frames import COUNTERS

# The speed is the mean over at least this time, s; its delay is half of it, 0.25 s.
WINDOW_S = 0.5
STANDSTILL_S = 0.8  # no pulse for this long is standstill
FASTEST_MPS = 30.0  # above this the counts cannot be the wheel's


class WheelGeometry(NamedTuple):
    """Holds effective circumference and pulses a turn; one pulse is circumference / pulses of
    way."""

    circumference_m: float = 2.50
    pulses_per_turn: float = 16.0

    @property
    def metres_per_pulse(self) -> float:
        return self.circumference_m / self.pulses_per_turn


class WheelSpeed:
    """Measures the mean speed between two pulses at least `WINDOW_S` apart (the filter
    `wheel_window`; delay 0.25 s).

    Between pulses the speed is at most one pulse's way over the time since the last pulse, so
    that braking shows before the next pulse. Counters that jump back mean a restarted board and
    begin anew."""

    def __init__(self, geometry: WheelGeometry) -> None:
        self._way_m = geometry.metres_per_pulse
        # count, micros of that count; newest last
        self._pulses: deque[tuple[int, int]] = deque()

    def update(self, micros: int, pulses: int, pulse_micros: int) -> float | None:
        """Returns the speed, m/s, 0 at standstill; None where it is unknown (impossible counts).
        `micros`, `pulse_micros`: the board's 32-bit clock now and at the last pulse; `pulses`:
        32-bit count."""
        since_pulse_us = _forward(micros, pulse_micros)
        if since_pulse_us >= STANDSTILL_S * 1e6 or pulses == 0:
            self._pulses.clear()
            return 0.0
        if self._pulses and not self._goes_on(pulses, pulse_micros):
            self._pulses.clear()
        if not self._pulses or pulses != self._pulses[-1][0]:
            self._pulses.append((pulses, pulse_micros))
            self._forget_what_the_window_does_not_need()
        return self._speed_mps(since_pulse_us * 1e-6)

    def _goes_on(self, pulses: int, pulse_micros: int) -> bool:
        last_pulses, last_micros = self._pulses[-1]
        more, later_us = _forward(pulses, last_pulses), _forward(pulse_micros, last_micros)
        return more < COUNTERS // 2 and later_us < COUNTERS // 2 and (more == 0) == (later_us == 0)

    def _forget_what_the_window_does_not_need(self) -> None:
        newest_us = self._pulses[-1][1]
        while len(self._pulses) > 2 and _forward(newest_us, self._pulses[1][1]) >= WINDOW_S * 1e6:
            self._pulses.popleft()

    def _speed_mps(self, since_pulse_s: float) -> float | None:
        (first, first_us), (last, last_us) = self._pulses[0], self._pulses[-1]
        if len(self._pulses) < 2:
            return 0.0
        speed_mps = _forward(last, first) * self._way_m / (_forward(last_us, first_us) * 1e-6)
        if speed_mps > FASTEST_MPS:
            return None
        return min(speed_mps, self._way_m / since_pulse_s) if since_pulse_s > 0.0 else speed_mps


def _forward(later: int, earlier: int) -> int:
    """Returns the difference of two 32-bit counters over their wrap."""
    return (later - earlier) % COUNTERS
