"""How fast does the wheel turn? The ground speed is computed from pulses and the board's own clock,
so that the jitter of the link has no effect.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from topdress.drivers.devices.board_frames import COUNTER_MODULUS

# Shortest time over which the speed is averaged, s; the delay is half of it, 0.25 s.
SPEED_WINDOW_S = 0.5
# Time without a pulse that counts as standstill, s.
STANDSTILL_TIMEOUT_S = 0.8
# Above this speed the counts cannot come from the wheel, m/s.
MAX_WHEEL_SPEED_MPS = 30.0


class WheelGeometry(NamedTuple):
    """Holds the effective circumference and the pulses per turn; a pulse is circumference / pulses
    of distance."""

    circumference_m: float = 2.50
    pulses_per_turn: float = 16.0

    @property
    def metres_per_pulse(self) -> float:
        """Distance driven for one pulse, m."""
        return self.circumference_m / self.pulses_per_turn


class WheelSpeed:
    """Measures the mean speed between two pulses at least `SPEED_WINDOW_S` apart, with a
    delay of 0.25 s.

    Between pulses the speed is at most the distance of one pulse divided by the time since the last
    pulse, so that braking shows before the next pulse. A counter that jumps back means a restarted
    board, and the measurement begins anew.
    """

    def __init__(self, geometry: WheelGeometry) -> None:
        self._way_m = geometry.metres_per_pulse
        # Pulse counts with the board's time of each count, microseconds; newest last.
        self._pulses: deque[tuple[int, int]] = deque()

    def update_speed(self, micros: int, pulses: int, pulse_micros: int) -> float | None:
        """Returns the speed, m/s: 0 at standstill, None where it is unknown (impossible counts).

        Parameters
        ----------
        micros, pulse_micros : the board's 32-bit clock now and at the last pulse, microseconds.
        pulses : the board's 32-bit count of pulses.
        """
        since_pulse_us = _subtract_wrapped(micros, pulse_micros)
        if since_pulse_us >= STANDSTILL_TIMEOUT_S * 1e6 or pulses == 0:
            self._pulses.clear()
            return 0.0
        if self._pulses and not self._is_continuing(pulses, pulse_micros):
            self._pulses.clear()
        if not self._pulses or pulses != self._pulses[-1][0]:
            self._pulses.append((pulses, pulse_micros))
            self._drop_old_pulses()
        return self._calc_speed_mps(since_pulse_us * 1e-6)

    def _is_continuing(self, pulses: int, pulse_micros: int) -> bool:
        last_pulses, last_micros = self._pulses[-1]
        more, later_us = (
            _subtract_wrapped(pulses, last_pulses),
            _subtract_wrapped(pulse_micros, last_micros),
        )
        return (
            more < COUNTER_MODULUS // 2
            and later_us < COUNTER_MODULUS // 2
            and (more == 0) == (later_us == 0)
        )

    def _drop_old_pulses(self) -> None:
        newest_us = self._pulses[-1][1]
        while (
            len(self._pulses) > 2
            and _subtract_wrapped(newest_us, self._pulses[1][1]) >= SPEED_WINDOW_S * 1e6
        ):
            self._pulses.popleft()

    def _calc_speed_mps(self, since_pulse_s: float) -> float | None:
        (first, first_us), (last, last_us) = self._pulses[0], self._pulses[-1]
        if len(self._pulses) < 2:
            return 0.0
        speed_mps = (
            _subtract_wrapped(last, first)
            * self._way_m
            / (_subtract_wrapped(last_us, first_us) * 1e-6)
        )
        if speed_mps > MAX_WHEEL_SPEED_MPS:
            return None
        return min(speed_mps, self._way_m / since_pulse_s) if since_pulse_s > 0.0 else speed_mps


def _subtract_wrapped(later: int, earlier: int) -> int:
    """Returns the difference of two 32-bit counters across their wrap."""
    return (later - earlier) % COUNTER_MODULUS
