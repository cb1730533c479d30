"""How does the slave board run on an RP2040 (Raspberry Pi Pico)? This is its main.py. Pins:
docs/wiring.md.

The program has not been used on a real machine yet: it was compiled and its logic was run, but not
its pins.
"""

import os
import time

import machine

from drivers.board.board_sensors import Hx711LoadCell, Lis3dhInclinometer
from drivers.board.rp2 import Board
from drivers.board.slave import BoardSettings, Pins, SlaveProgram

# Length of a round, microseconds.
ROUND_US = 1000
# A connection to ground at power-on skips the program, so that `mpremote` can access the board.
SERVICE_PIN = 22
# Interval of inclination samples, microseconds.
TILT_INTERVAL_US = 50000
# Weight of a reading in the running mean of the effort: some 10 ms, which removes the switching of
# the driver.
EFFORT_SAMPLE_WEIGHT = 0.1
# A divider of 100 kOhm and 10 kOhm reduces the supply voltage to the converter's range of 3.3 V.
VOLTS_PER_COUNT = 3.3 / 65535.0 * 11.0


class Rp2Settings(BoardSettings):
    """Holds the settings of the board and of its pins. `False` for a part means that it is absent;
    the status then reports "not fitted"."""

    # Both edges of one channel are counted.
    counts_per_turn = 1200.0
    # False makes the gate find its reference by the home switch.
    displacement_fitted = True
    # The displacement sensor covers 0 to 65 mm over the converter's range.
    mm_per_count = 65.0 / 65535.0
    scale_fitted = tilt_fitted = supply_fitted = work_switch_fitted = True
    # Slope of the hopper's load cells; calibrate with two known masses.
    kg_per_count = 5.0e-5
    zero_kg = 0.0
    # Whether the shaft driver's current-sense output is wired, 0 to 3.3 V over the converter's
    # range.
    effort_fitted = False
    # Calibrate this slope with an ammeter.
    amps_per_count = 30.0 / 65535.0
    # Pins of the sections' drivers from left to right, such as (16, 17, 18); 1 opens a valve.
    valve_pins: "tuple[int, ...]" = ()


class Rp2Pins(Board, Pins):
    """Connects the program to the pins of the board."""

    def __init__(self, settings: Rp2Settings) -> None:
        Board.__init__(self, rxbuf=512, txbuf=1024, link=settings.link)
        self._settings = settings
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
        self._valve_pins = [
            machine.Pin(pin, machine.Pin.OUT, value=0) for pin in settings.valve_pins
        ]
        self._opening = machine.ADC(26)
        self._supply = machine.ADC(27)
        self._current = machine.ADC(28)
        self._amps = 0.0
        self._counts = self._pulses = self._pulse_us = 0
        self._newest = 0, 0
        self._shaft_a.irq(
            self._on_shaft, machine.Pin.IRQ_RISING | machine.Pin.IRQ_FALLING, hard=True
        )
        self._hall.irq(self._on_wheel, machine.Pin.IRQ_FALLING, hard=True)
        scale = (
            machine.Pin(12, machine.Pin.OUT, value=0),
            machine.Pin(13, machine.Pin.IN, machine.Pin.PULL_UP),
        )
        self._scale = (
            Hx711LoadCell(*scale, settings.kg_per_count, settings.zero_kg)
            if settings.scale_fitted
            else None
        )
        bus = machine.I2C(0, sda=machine.Pin(20), scl=machine.Pin(21), freq=400000, timeout=1000)
        self._tilt = Lis3dhInclinometer(bus) if settings.tilt_fitted else None
        self._tilt_us = 0

    def _on_shaft(self, pin: object) -> None:
        self._counts += 1 if self._shaft_a.value() != self._shaft_b.value() else -1

    def _on_wheel(self, pin: object) -> None:
        self._pulses += 1
        self._pulse_us = time.ticks_us()  # type: ignore[attr-defined]

    def enable(self, on: bool) -> None:
        """Enables or disables the drivers."""
        self._enable.value(on)

    def duty(self, value: float) -> None:
        """Sets the duty of the shaft motor, 0 to 1."""
        self._pwm.duty_u16(int(value * 65535))

    def shaft_counts(self) -> int:
        """Returns the encoder's counts since power-on."""
        return self._counts

    def gate_steps(self, steps: int) -> None:
        """Makes steps of the gate; positive steps open it."""
        self._gate_open.value(steps > 0)
        self._send_pulses(self._gate_step, abs(steps))

    def dose_steps(self, steps: int) -> None:
        """Makes steps of the metering shaft."""
        self._send_pulses(self._dose_step, steps)

    def opening_mm(self) -> "float | None":
        """Returns the opening by the displacement sensor, mm; None without a sensor."""
        settings = self._settings
        return (
            float(self._opening.read_u16() * settings.mm_per_count)
            if settings.displacement_fitted
            else None
        )

    def at_home(self) -> bool:
        """Returns whether the gate presses the home switch."""
        return not self._home.value()

    def driver_fault(self) -> bool:
        """Returns whether the motor driver reports a fault."""
        return not self._fault.value()

    def wheel(self) -> "tuple[int, int]":
        """Returns the wheel's pulses and the time of the newest one. A new pulse's time is
        converted at once, before its own clock overflows."""
        pulses = self._pulses
        if pulses != self._newest[0]:
            self._newest = pulses, self.convert_ticks_us(self._pulse_us)
        return self._newest

    def supply_v(self) -> "float | None":
        """Returns the supply voltage, V; None where it is not wired."""
        return (
            float(self._supply.read_u16() * VOLTS_PER_COUNT)
            if self._settings.supply_fitted
            else None
        )

    def shaft_effort(self) -> "float | None":
        """Returns the current of the shaft motor, A; None where it is not wired."""
        return self._amps if self._settings.effort_fitted else None

    def hopper_kg(self) -> "float | None":
        """Returns the mass in the hopper, kg; None without load cells."""
        return self._scale.kg if self._scale else None

    def pitch_deg(self) -> "float | None":
        """Returns the pitch, degrees, nose up positive; None without a sensor."""
        return self._tilt.pitch_deg if self._tilt else None

    def roll_deg(self) -> "float | None":
        """Returns the roll, degrees, right side down positive; None without a sensor."""
        return self._tilt.roll_deg if self._tilt else None

    def poll_sensors(self, now_us: int) -> None:
        """Polls scale, inclination and current sensor; called every round."""
        self._amps += EFFORT_SAMPLE_WEIGHT * (
            self._current.read_u16() * self._settings.amps_per_count - self._amps
        )
        if self._scale:
            self._scale.poll_conversion()
        if self._tilt and now_us - self._tilt_us >= TILT_INTERVAL_US:
            self._tilt.poll_sample((now_us - self._tilt_us) * 1e-6)
            self._tilt_us = now_us

    def work_switch(self) -> "bool | None":
        """Returns whether the implement is lowered; None without a switch."""
        return not self._switch.value() if self._settings.work_switch_fitted else None

    def valves(self, mask: int) -> None:
        """Sets the valves of the sections; bit 0 is the leftmost, 1 opens."""
        for k, pin in enumerate(self._valve_pins):
            pin.value(mask >> k & 1)

    def chance(self) -> "int | None":
        """Returns an unpredictable number below 2^32 from the chip's ring oscillator."""
        return int.from_bytes(os.urandom(4), "big")

    def _send_pulses(self, pin: "machine.Pin", count: int) -> None:
        for _ in range(count):
            pin.on()
            time.sleep_us(5)  # type: ignore[attr-defined]
            pin.off()
            time.sleep_us(20)  # type: ignore[attr-defined]


def read_own_settings() -> Rp2Settings:
    """Returns the settings with the values of `board_settings.py` on the board. Raises ValueError
    as `BoardSettings.take_settings` does."""
    settings = Rp2Settings()
    try:
        import board_settings
    except ImportError:
        return settings
    settings.take_settings(board_settings)
    return settings


def main() -> None:
    """Runs rounds until power-off."""
    if not machine.Pin(SERVICE_PIN, machine.Pin.IN, machine.Pin.PULL_UP).value():
        return
    settings = read_own_settings()
    settings.valves = len(settings.valve_pins)
    pins = Rp2Pins(settings)
    slave = SlaveProgram(pins, settings)
    # A hanging program is restarted by the watchdog; the enable line is off meanwhile.
    watchdog = machine.WDT(timeout=500)
    while True:
        started_us = pins.now_us()
        pins.poll_sensors(started_us)
        slave.run_round(started_us)
        watchdog.feed()
        pins.wait_for_round(started_us, ROUND_US)


if __name__ == "__main__":
    main()
