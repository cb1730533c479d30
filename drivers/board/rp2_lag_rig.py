"""Main program of the lag rig on an RP2040; copy it to the board as main.py. Pins: docs/wiring.md.

Not in use on a rig yet: compiled and its logic run, its pins not.
"""

import time

import machine

from drivers.board.lag_rig import RigPins, RigProgram, RigSettings
from drivers.board.rp2 import Board

ROUND_US = 500


class Rp2RigPins(Board, RigPins):
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
        """The newest count's time is turned into this clock's when it is new: later its own
        clock has run over."""
        counts = self._counts
        if counts != self._newest[0]:
            newest, before = self._count_us, self._before_us
            at_us = self.convert_ticks_us(newest)
            apart_us = time.ticks_diff(newest, before)  # type: ignore[attr-defined]
            self._newest = counts, at_us, at_us - apart_us
        return self._newest

    def plate(self) -> int:
        return int(self._plate.read_u16()) >> 4


def main() -> None:
    pins = Rp2RigPins()
    rig = RigProgram(pins, RigSettings())
    while True:
        started_us = pins.now_us()
        rig.run_round(started_us)
        pins.wait_for_round(started_us, ROUND_US)


if __name__ == "__main__":
    main()
