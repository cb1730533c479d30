"""What else a virtual machine may be plugged into: programs and modules beside receiver, heads and board."""
from __future__ import annotations

import json
import struct
from typing import Protocol

from control.readings import DriveCommand, GnssFix
from drivers.datagrams import Datagrams
from drivers.devices.agopengps import DRIVE, HEAD, POSITION
from drivers.devices.rate_module_frames import (
    BadDatagram,
    Board,
    Relays,
    Status,
    Target,
    decode_told,
    encode_board,
    encode_status,
)
from drivers.ports import Port
from drivers.virtual.encoders import Sensed

STATUS_EVERY_S = 0.2
SILENT_CONSOLE_S = 4.0


class Extra(Protocol):
    """Asked before and told after every step of the plant."""

    def before(self, begin_s: float, command: DriveCommand, enabled: bool) -> tuple[DriveCommand, bool]:
        """What the drives shall follow: the command as it stands, or changed."""
        ...

    def after(self, sensed: Sensed, begin_s: float) -> None: ...


class VirtualGpsd:
    """gpsd on one connection: greets, and reports once it is asked to."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self._connects = 0
        self._watched = False

    def before(self, begin_s: float, command: DriveCommand, enabled: bool) -> tuple[DriveCommand, bool]:
        state = self._port.state()
        if state.connected and state.connects != self._connects:
            self._connects, self._watched = state.connects, False
            self._say({"class": "VERSION", "release": "3.25", "proto_major": 3, "proto_minor": 15})
        if b"?WATCH" in self._port.read():
            self._watched = True
            self._say({"class": "WATCH", "enable": True, "json": True})
        return command, enabled

    def after(self, sensed: Sensed, begin_s: float) -> None:
        fix = sensed.gnss
        if fix is None or not self._watched:
            return
        self._say({"class": "SKY", "device": "/dev/virtual", "uSat": fix.satellites, "hdop": fix.hdop})
        self._say({"class": "TPV", "device": "/dev/virtual", "mode": 3 if fix.fix_quality else 1,
                   "status": {2: 2, 4: 3, 5: 4}.get(fix.fix_quality, 1), "time": fix.utc, "lat": fix.lat_deg,
                   "lon": fix.lon_deg, "track": fix.heading_deg, "speed": fix.speed_mps})

    def _say(self, said: dict[str, object]) -> None:
        self._port.write(json.dumps({key: value for key, value in said.items() if value is not None}).encode() + b"\n")


class VirtualAgOpenGps:
    """AgOpenGPS telling position and speed on loopback."""

    def __init__(self, port: Datagrams) -> None:
        self._port = port

    def before(self, begin_s: float, command: DriveCommand, enabled: bool) -> tuple[DriveCommand, bool]:
        return command, enabled

    def after(self, sensed: Sensed, begin_s: float) -> None:
        if sensed.gnss is not None:
            for frame in agopengps_frames(sensed.gnss):
                self._port.write(frame)


def agopengps_frames(fix: GnssFix) -> tuple[bytes, bytes]:
    """Speed, then position."""
    speed = round((fix.speed_mps or 0.0) * 36.0).to_bytes(2, "little")
    place = struct.pack("<ddd", fix.lon_deg, fix.lat_deg, fix.heading_deg or 0.0)
    return _agopengps(DRIVE, speed + bytes(6)), _agopengps(POSITION, place)


def _agopengps(name: int, body: bytes) -> bytes:
    frame = HEAD + bytes([name, len(body)]) + body
    return frame + bytes([sum(frame[2:]) & 0xFF])


class VirtualRateModule:
    """A rate module: it turns the shaft at the units a minute it is told, and says what it counts.

    pulses_per_turn : of its true encoder; a console that tells another number gets another speed.
    listens : False is a module set to another comm mode: it reports, and ignores what UDP tells it.
    """

    def __init__(self, port: Datagrams, pulses_per_turn: float, module: int = 0, sensor: int = 0) -> None:
        self.listens = True
        self.told = 0                   # datagrams obeyed
        self.refused = 0
        self._port = port
        self._pulses_per_turn = pulses_per_turn
        self._module, self._sensor = module, sensor
        self._target: Target | None = None
        self._target_s = 0.0
        self._relays = 0
        self._quantity = 0.0
        self._last_s = 0.0
        self._next_status_s = 0.0

    def before(self, begin_s: float, command: DriveCommand, enabled: bool) -> tuple[DriveCommand, bool]:
        for data in self._port.read_each():
            self._hear(data, begin_s)
        return command._replace(shaft_rpm=self.shaft_rpm(begin_s)), True

    def shaft_rpm(self, now_s: float) -> float:
        """What the motor is driven at."""
        target = self._target
        if target is None or not self._hears(now_s) or not self._relays or not target.master_on:
            return 0.0
        return target.units_per_min * target.pulses_per_unit / self._pulses_per_turn

    def after(self, sensed: Sensed, begin_s: float) -> None:
        counts = bool(self._relays)
        told = self._target.pulses_per_unit if self._target else self._pulses_per_turn
        pulse_hz = max(0.0, sensed.shaft_rpm) / 60.0 * self._pulses_per_turn if counts else 0.0
        units_per_min = pulse_hz * 60.0 / told if told else 0.0
        self._quantity += units_per_min / 60.0 * max(0.0, sensed.time_s - self._last_s)
        self._last_s = sensed.time_s
        if begin_s < self._next_status_s:
            return
        self._next_status_s = begin_s + STATUS_EVERY_S - 1e-6
        self._port.write(encode_status(Status(
            self._module, self._sensor, min(units_per_min, 16777.0), self._quantity,
            min(255, round(2.5 * self.shaft_rpm(begin_s))), self._hears(begin_s), False, min(pulse_hz, 6553.0))))
        self._port.write(encode_board(Board(self._module, 0, 0.0, sensed.wheel_pulses, 1, 1,
                                            bool(sensed.work_switch), True, True, False)))

    def _hears(self, now_s: float) -> bool:
        return self._target is not None and now_s - self._target_s < SILENT_CONSOLE_S

    def _hear(self, data: bytes, now_s: float) -> None:
        try:
            told = decode_told(data)
        except BadDatagram:
            self.refused += 1
            return
        if not self.listens or (told.module, told.sensor) != (self._module, self._sensor):
            return
        self.told += 1
        if isinstance(told, Relays):
            self._relays = told.relays
            return
        self._target, self._target_s = told, now_s
        if told.reset_quantity:
            self._quantity = 0.0
