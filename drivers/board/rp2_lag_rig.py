"""Main program of the lag rig on an RP2040; copy it to the board as main.py. Pins: docs/wiring.md.

Not in use on a rig yet: compiled and its logic run, its pins not.
"""
import time

import machine  # type: ignore[import-not-found]

from drivers.board.lag_rig import LagRig, RigPins, RigSettings

ROUND_US = 500


class Rp2RigPins(RigPins):
    def __init__(self) -> None:
        self._uart = machine.UART(0, 115200, tx=machine.Pin(0), rx=machine.Pin(1), rxbuf=256, txbuf=512)
        self._shaft = machine.Pin(6, machine.Pin.IN, machine.Pin.PULL_UP)
        self._plate = machine.ADC(26)
        self._counts = self._count_us = self._before_us = 0
        self._told = 0, 0, 0
        self._shaft.irq(self._on_shaft, machine.Pin.IRQ_RISING, hard=True)
        self._now_us = 0
        self._ticks = time.ticks_us()   # type: ignore[attr-defined]

    def now_us(self) -> int:
        ticks = time.ticks_us()         # type: ignore[attr-defined]
        self._now_us += time.ticks_diff(ticks, self._ticks)     # type: ignore[attr-defined]
        self._ticks = ticks
        return self._now_us

    def _on_shaft(self, pin: object) -> None:
        self._counts += 1
        self._before_us = self._count_us
        self._count_us = time.ticks_us()        # type: ignore[attr-defined]

    def read(self) -> bytes:
        return self._uart.read() or b""

    def write(self, data: bytes) -> None:
        self._uart.write(data)

    def encoder(self) -> "tuple[int, int, int]":
        """The newest count's time is turned into this clock's when it is new: later its own clock has run over."""
        now_us, counts = self.now_us(), self._counts
        if counts != self._told[0]:
            newest, before = self._count_us, self._before_us
            at_us = now_us - max(0, time.ticks_diff(self._ticks, newest))       # type: ignore[attr-defined]
            apart_us = time.ticks_diff(newest, before)                          # type: ignore[attr-defined]
            self._told = counts, at_us, at_us - apart_us
        return self._told

    def plate(self) -> int:
        return int(self._plate.read_u16()) >> 4


def main() -> None:
    pins = Rp2RigPins()
    rig = LagRig(pins, RigSettings())
    while True:
        begun_us = pins.now_us()
        rig.tick(begun_us)
        rest_us = ROUND_US - (pins.now_us() - begun_us)
        if rest_us > 0:
            time.sleep_us(rest_us)      # type: ignore[attr-defined]


if __name__ == "__main__":
    main()
