"""Main program of the slave board on an RP2040 (Raspberry Pi Pico): its main.py. Pins: docs/wiring.md.

Not in use on a machine yet: compiled and its logic run, its pins not.
"""
import os
import time

import machine  # type: ignore[import-not-found]

from drivers.board.parts import LoadCell, Tilt
from drivers.board.rp2 import Board
from drivers.board.slave import BoardSettings, Pins, Slave

ROUND_US = 1000
MM_PER_COUNT = 65.0 / 65535.0           # displacement sensor, 0 to 65 mm over the converter's range
KG_PER_COUNT, ZERO_KG = 5.0e-5, 0.0     # of the hopper's load cells: calibrate with two known masses
SCALE_FITTED = TILT_FITTED = True
VALVE_PINS: "tuple[int, ...]" = ()      # of the sections' drivers, left to right, e.g. (16, 17, 18); 1 opens
TILT_US = 50000
VOLTS_PER_COUNT = 3.3 / 65535.0 * 11.0  # supply over 100 kOhm and 10 kOhm
EFFORT_FITTED = False                   # the shaft driver's current-sense output, 0 to 3.3 V over the converter's range
AMPS_PER_COUNT = 30.0 / 65535.0         # calibrate with an ammeter
EFFORT_SHARE = 0.1                      # of each reading: some 10 ms, so that the driver's switching is no noise


class Rp2Pins(Board, Pins):
    def __init__(self) -> None:
        Board.__init__(self, rxbuf=512, txbuf=1024)
        self._enable = machine.Pin(2, machine.Pin.OUT, value=0)
        self._fault = machine.Pin(3, machine.Pin.IN, machine.Pin.PULL_UP)
        self._pwm = machine.PWM(machine.Pin(4), freq=20000, duty_u16=0)
        self._shaft_a = machine.Pin(6, machine.Pin.IN, machine.Pin.PULL_UP)
        self._shaft_b = machine.Pin(7, machine.Pin.IN, machine.Pin.PULL_UP)
        self._gate_step = machine.Pin(8, machine.Pin.OUT, value=0)
        self._gate_open = machine.Pin(9, machine.Pin.OUT, value=0)
        self._home = machine.Pin(10, machine.Pin.IN, machine.Pin.PULL_UP)
        self._dose_step = machine.Pin(11, machine.Pin.OUT, value=0)
        self._hall = machine.Pin(14, machine.Pin.IN, machine.Pin.PULL_UP)
        self._switch = machine.Pin(15, machine.Pin.IN, machine.Pin.PULL_UP)
        self._valve_pins = [machine.Pin(pin, machine.Pin.OUT, value=0) for pin in VALVE_PINS]
        self._opening = machine.ADC(26)
        self._supply = machine.ADC(27)
        self._current = machine.ADC(28)
        self._amps = 0.0
        self._counts = self._pulses = self._pulse_us = 0
        self._newest = 0, 0
        self._shaft_a.irq(self._on_shaft, machine.Pin.IRQ_RISING | machine.Pin.IRQ_FALLING, hard=True)
        self._hall.irq(self._on_wheel, machine.Pin.IRQ_FALLING, hard=True)
        scale = machine.Pin(12, machine.Pin.OUT, value=0), machine.Pin(13, machine.Pin.IN, machine.Pin.PULL_UP)
        self._scale = LoadCell(*scale, KG_PER_COUNT, ZERO_KG) if SCALE_FITTED else None
        bus = machine.I2C(0, sda=machine.Pin(20), scl=machine.Pin(21), freq=400000, timeout=1000)
        self._tilt = Tilt(bus) if TILT_FITTED else None
        self._tilt_us = 0

    def _on_shaft(self, pin: object) -> None:
        self._counts += 1 if self._shaft_a.value() != self._shaft_b.value() else -1

    def _on_wheel(self, pin: object) -> None:
        self._pulses += 1
        self._pulse_us = time.ticks_us()        # type: ignore[attr-defined]

    def enable(self, on: bool) -> None:
        self._enable.value(on)

    def duty(self, value: float) -> None:
        self._pwm.duty_u16(int(value * 65535))

    def shaft_counts(self) -> int:
        return self._counts

    def gate_steps(self, steps: int) -> None:
        self._gate_open.value(steps > 0)
        self._pulse(self._gate_step, abs(steps))

    def dose_steps(self, steps: int) -> None:
        self._pulse(self._dose_step, steps)

    def opening_mm(self) -> "float | None":
        return float(self._opening.read_u16() * MM_PER_COUNT)

    def at_home(self) -> bool:
        return not self._home.value()

    def driver_fault(self) -> bool:
        return not self._fault.value()

    def wheel(self) -> "tuple[int, int]":
        """The newest pulse's time is turned into this clock's when it is new: later its own clock has run over."""
        pulses = self._pulses
        if pulses != self._newest[0]:
            self._newest = pulses, self.at_us(self._pulse_us)
        return self._newest

    def supply_v(self) -> "float | None":
        return float(self._supply.read_u16() * VOLTS_PER_COUNT)

    def shaft_effort(self) -> "float | None":
        return self._amps if EFFORT_FITTED else None

    def hopper_kg(self) -> "float | None":
        return self._scale.kg if self._scale else None

    def pitch_deg(self) -> "float | None":
        return self._tilt.pitch_deg if self._tilt else None

    def roll_deg(self) -> "float | None":
        return self._tilt.roll_deg if self._tilt else None

    def look(self, now_us: int) -> None:
        """Fetch what scale, inclination and the current sensor have; every round."""
        self._amps += EFFORT_SHARE * (self._current.read_u16() * AMPS_PER_COUNT - self._amps)
        if self._scale:
            self._scale.look()
        if self._tilt and now_us - self._tilt_us >= TILT_US:
            self._tilt.look((now_us - self._tilt_us) * 1e-6)
            self._tilt_us = now_us

    def work_switch(self) -> "bool | None":
        return not self._switch.value()

    def valves(self, mask: int) -> None:
        for k, pin in enumerate(self._valve_pins):
            pin.value(mask >> k & 1)

    def chance(self) -> "int | None":
        return int.from_bytes(os.urandom(4), "big")

    def _pulse(self, pin: "machine.Pin", count: int) -> None:
        for _ in range(count):
            pin.on()
            time.sleep_us(5)            # type: ignore[attr-defined]
            pin.off()
            time.sleep_us(20)           # type: ignore[attr-defined]


def main() -> None:
    pins = Rp2Pins()
    settings = BoardSettings()
    settings.counts_per_turn = 1200.0   # both edges of one channel
    settings.valves = len(VALVE_PINS)
    slave = Slave(pins, settings)
    watchdog = machine.WDT(timeout=500)     # a program that hangs restarts; the enable line is off meanwhile
    while True:
        started_us = pins.now_us()
        pins.look(started_us)
        slave.tick(started_us)
        watchdog.feed()
        pins.rest(started_us, ROUND_US)


if __name__ == "__main__":
    main()
