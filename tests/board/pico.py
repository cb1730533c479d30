"""A Raspberry Pi Pico with a small machine on its pins, as `machine` and `micropython` show it:
the board's main program runs on it as it stands, on this computer, its serial line or its USB
plug on the terminal of standard input.

    python -m tests.board.pico LEVELS SETTINGS.py    LEVELS: each level that is put on a pin, as
                                                     `seconds pin level`
    python -m tests.board.pico --pins PROGRAM        as JSON: the pins that it takes and what they
                                                     are; settings' names
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import json
import os
import select
import signal
import sys
import threading
import time
import types

from tests.board.board_scenarios import Machine

EDGES = 1200.0  # of the encoder's A, a turn
STEP, DIRECTION, ENABLE, PWM, A, B, HALL = 8, 9, 2, 4, 6, 7, 14
machine, seen = Machine(), {"edges": 0, "pulses": 0}
used: dict[int, str] = {}
levels = -1  # the file
pins: dict[int, Pin] = {}


def note(what):
    os.write(levels, f"{time.monotonic():.6f} {what}\n".encode())


class Pin:
    OUT, IN, PULL_UP, IRQ_RISING, IRQ_FALLING = "out", "in", "up", 1, 2

    def __init__(self, number, mode="in", pull="", value=None):
        self.number, self.level, self.heard = number, 1 if pull == "up" else 0, lambda _: None
        used[number], pins[number] = mode, self
        if value is not None:
            self.value(value)

    def value(self, level=None):
        if level is None:
            return self.level
        if level and self.number == STEP:
            machine.gate_steps(1 if pins[DIRECTION].level else -1)
        if level != self.level:
            note(f"{self.number} {int(level)}")
        self.level = level
        return None

    def on(self):
        self.value(1)

    def off(self):
        self.value(0)

    def irq(self, heard, *_, hard):
        self.heard = heard


class Pwm:
    def __init__(self, pin, freq, duty_u16):
        used[pin.number] = f"pwm {freq}"

    def duty_u16(self, duty):
        if bool(duty) != bool(machine.value):
            note(f"{PWM} {int(duty > 0)}")
        machine.duty(duty / 65535)


class Adc:
    def __init__(self, number):
        self.number = number
        used[number] = "adc"

    def read_u16(self):
        return round(
            {26: machine.true_mm / 65.0, 27: machine.supply_v() / 11.0 / 3.3, 28: 0.0}[self.number]
            * 65535
        )


class Terminal:
    """The far end of the serial line, and of the USB plug: unbuffered, as on the board."""

    def __init__(self, *_, **__):
        self.buffer = self

    def flush(self):
        """Nothing waits."""

    def fileno(self):
        return 0

    def read(self, count=4096):
        with contextlib.suppress(OSError):
            if select.select([0], [], [], 0.0)[0]:
                return os.read(0, count)
        return b""

    def write(self, data):
        with contextlib.suppress(OSError):
            os.write(0, data)


class Uart(Terminal):
    def __init__(self, number, baud, tx, rx, **_):
        super().__init__()
        used[tx.number], used[rx.number] = f"uart {number} tx {baud}", f"uart {number} rx {baud}"


class I2c:
    def __init__(self, number, sda, scl, freq, timeout):
        used[sda.number], used[scl.number] = f"i2c {number} sda {freq}", f"i2c {number} scl {freq}"

    def readfrom_mem(self, *_):
        raise OSError(5)


class Watchdog:
    """Fed once a round, which is when the machine moves on; not fed in time: a reset, which
    takes the program along."""

    def __init__(self, timeout):
        self.fed_s, self.timeout_s = time.monotonic(), timeout / 1000.0
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self):
        while time.monotonic() - self.fed_s < self.timeout_s:
            time.sleep(0.01)
        note("reset")
        os._exit(3)

    def feed(self):
        now_s = time.monotonic()
        machine.enable(pins[ENABLE].level)
        machine.pass_time(round((now_s - self.fed_s) * 1e6))
        self.fed_s = now_s
        while seen["edges"] < int(machine.turns * EDGES):
            seen["edges"] += 1
            pins[A].level = 1 - pins[A].level
            pins[B].level = 1 - pins[A].level
            pins[A].heard(pins[A])
        while seen["pulses"] < machine.wheel()[0]:
            seen["pulses"] += 1
            pins[HALL].heard(pins[HALL])


def hang(*_):
    """The program never comes back."""
    note("hangs")
    while True:
        pass


def main(words):
    global levels
    sys.modules["machine"] = types.SimpleNamespace(
        Pin=Pin, PWM=Pwm, ADC=Adc, UART=Uart, I2C=I2c, WDT=Watchdog
    )
    sys.modules["micropython"] = types.SimpleNamespace(kbd_intr=lambda _: None)
    time.ticks_us = lambda: int(time.monotonic() * 1e6) % (1 << 30)
    time.ticks_diff = lambda late, early: (late - early + (1 << 29)) % (1 << 30) - (1 << 29)
    time.sleep_us = lambda us: time.sleep(us * 1e-6)
    from drivers.board import rp2_slave

    if words[0] == "--pins":
        settings = rp2_slave.Rp2Settings()
        if words[1] == "rp2_slave":
            rp2_slave.Rp2Pins(settings)
            Pin(rp2_slave.SERVICE_PIN)
        else:
            importlib.import_module("drivers.board." + words[1]).Rp2RigPins()
        print(json.dumps([used, [name for name in dir(settings) if not name.startswith("_")]]))
        return
    levels = os.open(words[0], os.O_WRONLY | os.O_CREAT)
    spec = importlib.util.spec_from_file_location("board_settings", words[1])
    sys.modules["board_settings"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["board_settings"])
    sys.stdin = sys.stdout = Terminal()
    signal.signal(signal.SIGUSR1, hang)
    rp2_slave.main()


if __name__ == "__main__":
    main(sys.argv[1:])
