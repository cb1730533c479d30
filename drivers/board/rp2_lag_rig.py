"""How does the lag rig run on an RP2040? This is its main program; copy it to the board as main.py.
Pins: docs/wiring.md.

The program has not been used on a real rig yet: it was compiled and its logic was run, but not its
pins.
"""

import time

import machine

from drivers.board.lag_rig import RigPins, RigProgram, RigSettings
from drivers.board.rp2 import Board

# Length of a round, microseconds, which limits the resolution of a landing.
ROUND_US = 500


class Rp2RigPins(Board, RigPins):
    """Connects the program to the pins of the board."""

    def __init__(self) -> None:
        Board.__init__(self, rxbuf=256, txbuf=512)
        self._shaft = machine.Pin(6, machine.Pin.IN, machine.Pin.PULL_UP)
        self._plate = machine.ADC(26)
        self._counts = self._count_us = self._before_us = 0
        self._newest = 0, 0, 0
        self._shaft.irq(self._on_shaft, machine.Pin.IRQ_RISING, hard=True)

    def _on_shaft(self, pin: object) -> None:
        self._counts += 1
        self._before_us = self._count_us
        self._count_us = time.ticks_us()  # type: ignore[attr-defined]

    def encoder(self) -> "tuple[int, int, int]":
        """Returns the counts and the times of the newest two. A new count's time is converted at
        once, before its own clock overflows."""
        counts = self._counts
        if counts != self._newest[0]:
            newest, before = self._count_us, self._before_us
            at_us = self.convert_ticks_us(newest)
            apart_us = time.ticks_diff(newest, before)  # type: ignore[attr-defined]
            self._newest = counts, at_us, at_us - apart_us
        return self._newest

    def plate(self) -> int:
        """Returns the reading of the impact plate's converter."""
        return int(self._plate.read_u16()) >> 4


def main() -> None:
    """Runs rounds until power-off."""
    pins = Rp2RigPins()
    rig = RigProgram(pins, RigSettings())
    while True:
        started_us = pins.now_us()
        rig.run_round(started_us)
        pins.wait_for_round(started_us, ROUND_US)


if __name__ == "__main__":
    main()
