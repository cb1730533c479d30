"""What do the main programs of both boards share on an RP2040 (Raspberry Pi Pico)? They share
serial line, clock and rounds.
"""

import select
import sys
import time

import machine  # type: ignore[import-not-found]
import micropython  # type: ignore[import-not-found]

from .board_sensors import UsbLine


def open_usb_line() -> UsbLine:
    """Opens the board's own USB plug; MicroPython's prompt is unavailable until the next
    power-on."""
    # A byte of 3 must not act as Ctrl-C, because frames may contain it.
    micropython.kbd_intr(-1)
    inward, outward = select.poll(), select.poll()
    inward.register(sys.stdin, select.POLLIN)
    outward.register(sys.stdout, select.POLLOUT)
    return UsbLine(
        sys.stdin.buffer, sys.stdout.buffer, lambda: inward.poll(0), lambda: outward.poll(0)
    )


class Board:
    """Provides the serial line, on UART 0 or USB, and a clock that never overflows; pin layers
    inherit from this class first."""

    def __init__(self, rxbuf: int, txbuf: int, link: str = "uart") -> None:
        self._line = (
            open_usb_line()
            if link == "usb"
            else machine.UART(
                0, 115200, tx=machine.Pin(0), rx=machine.Pin(1), rxbuf=rxbuf, txbuf=txbuf
            )
        )
        self._now_us = 0
        self._ticks = time.ticks_us()  # type: ignore[attr-defined]

    def now_us(self) -> int:
        """Returns the time, microseconds, from a clock that overflows; it must be called more often
        than the clock overflows."""
        ticks = time.ticks_us()  # type: ignore[attr-defined]
        self._now_us += int(time.ticks_diff(ticks, self._ticks))  # type: ignore[attr-defined]
        self._ticks = ticks
        return self._now_us

    def convert_ticks_us(self, ticks: int) -> int:
        """Returns an interrupt's time on this clock; to be called soon after the interrupt, before
        the interrupt's clock overflows."""
        now_us = self.now_us()
        return now_us - max(0, int(time.ticks_diff(self._ticks, ticks)))  # type: ignore[attr-defined]

    def read(self) -> bytes:
        """Returns the bytes that the host has sent."""
        return self._line.read() or b""

    def write(self, data: bytes) -> None:
        """Sends bytes to the host."""
        self._line.write(data)

    def wait_for_round(self, started_us: int, round_us: int) -> None:
        """Waits until `round_us` after the start of the round."""
        rest_us = round_us - (self.now_us() - started_us)
        if rest_us > 0:
            time.sleep_us(rest_us)  # type: ignore[attr-defined]
