"""Which devices can be connected to a virtual machine besides receiver, heads and board? They are
programs and modules.
"""

from __future__ import annotations

import struct

from topdress.control.readings import DriveCommand, GnssFix
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.datagrams import Datagrams
from topdress.drivers.devices.agopengps import FRAME_HEADER, POSITION_ID, SPEED_ID
from topdress.drivers.devices.device import LineDevice
from topdress.drivers.devices.lines import IgnoredSentence, RejectedSentence
from topdress.drivers.devices.rate_module_frames import (
    MAX_PWM,
    MAX_RELAYS,
    BoardLabel,
    BoardStatus,
    FlowTarget,
    ModuleStatus,
    ModuleTrace,
    RelayStates,
    decode_command,
    encode_board,
    encode_label,
    encode_status,
    encode_trace,
)
from topdress.drivers.ports import Port

# Interval of the status datagrams of a real module, s.
STATUS_INTERVAL_S = 0.2
# Interval of the datagram with the module's name, s.
LABEL_INTERVAL_S = 2.0
FIRMWARE_VERSION = 1
# Time without the console after which a real module stops its motor, s.
CONSOLE_TIMEOUT_S = 4.0


class MachineExtra:
    """Defines an addition that is called before and after every step of the plant."""

    def alter_command(
        self, begin_s: float, command: DriveCommand, enabled: bool
    ) -> tuple[DriveCommand, bool]:
        """Returns the command that the drives follow: the given command, unchanged or altered."""
        return command, enabled

    def take_readings(self, sensed: SensorReadings, begin_s: float) -> None:
        """Takes the readings of the sensors after a step that began at `begin_s`."""


class VirtualLine(MachineExtra):
    """Sends the messages of a device with a line of its own."""

    def __init__(self, device: LineDevice, port: Port) -> None:
        self._device = device
        self._port = port
        self._due_s = 0.0

    def take_readings(self, sensed: SensorReadings, begin_s: float) -> None:
        """Sends one message when it is due."""
        if self._device.make_message is not None and begin_s >= self._due_s:
            self._due_s = begin_s + self._device.interval_s
            self._port.write(self._device.make_message(sensed))


class VirtualAgOpenGps(MachineExtra):
    """Simulates AgOpenGPS, which sends position and speed on loopback."""

    def __init__(self, port: Datagrams) -> None:
        self._port = port

    def take_readings(self, sensed: SensorReadings, begin_s: float) -> None:
        """Sends position and speed of a new fix."""
        if sensed.gnss is not None:
            for frame in make_agopengps_frames(sensed.gnss):
                self._port.write(frame)


def make_agopengps_frames(fix: GnssFix) -> tuple[bytes, bytes]:
    """Returns the frames of speed and position."""
    speed = round((fix.speed_mps or 0.0) * 36.0).to_bytes(2, "little")
    place = struct.pack("<ddd", fix.lon_deg, fix.lat_deg, fix.heading_deg or 0.0)
    return _make_agopengps_frame(SPEED_ID, speed + bytes(6)), _make_agopengps_frame(
        POSITION_ID, place
    )


def _make_agopengps_frame(name: int, body: bytes) -> bytes:
    frame = FRAME_HEADER + bytes([name, len(body)]) + body
    return frame + bytes([sum(frame[2:]) & 0xFF])


class VirtualRateModule(MachineExtra):
    """Simulates a rate module, which turns the shaft at the commanded units per minute and reports
    its counts.

    Parameters
    ----------
    pulses_per_turn : pulses of its real encoder; a console that sends a different number gets a
    different speed.
    label : the name that the module reports.

    `listens` False simulates a module in another communication mode: it reports but ignores UDP.
    """

    def __init__(
        self,
        port: Datagrams,
        pulses_per_turn: float,
        module: int = 0,
        sensor: int = 0,
        label: str = "topdress virtual",
    ) -> None:
        self.listens = True
        self.refused = 0
        self._port = port
        self._pulses_per_turn = pulses_per_turn
        self._module, self._sensor = module, sensor
        self._target: FlowTarget | None = None
        self._target_s = 0.0
        self._relays = 0
        self._valved = False
        self._quantity = 0.0
        self._last_s = 0.0
        self._next_status_s = self._next_label_s = 0.0
        self._label = BoardLabel(module, label)

    def alter_command(
        self, begin_s: float, command: DriveCommand, enabled: bool
    ) -> tuple[DriveCommand, bool]:
        """Returns the command with the shaft speed and valves of the module."""
        for data in self._port.read_each():
            self._take_datagram(data, begin_s)
        valves = self.find_valves(begin_s)
        return command._replace(
            shaft_rpm=self.find_shaft_rpm(begin_s), valves=valves or command.valves
        ), True

    def find_valves(self, now_s: float) -> tuple[bool, ...]:
        """Returns the relays from the second on; empty before any were set."""
        self._valved = self._valved or self._relays > 1
        if not self._valved:
            return ()
        relays = self._relays >> 1 if self._is_hearing(now_s) else 0
        return tuple([bool(relays >> k & 1) for k in range(MAX_RELAYS - 1)])

    def find_shaft_rpm(self, now_s: float) -> float:
        """Returns the speed at which the motor is driven, r/min."""
        target = self._target
        if (
            target is None
            or not self._is_hearing(now_s)
            or not self._relays
            or not target.master_on
        ):
            return 0.0
        return target.units_per_min * target.pulses_per_unit / self._pulses_per_turn

    def take_readings(self, sensed: SensorReadings, begin_s: float) -> None:
        """Sends the datagrams that are due after a step."""
        counts = bool(self._relays)
        command = self._target.pulses_per_unit if self._target else self._pulses_per_turn
        pulse_hz = max(0.0, sensed.shaft_rpm) / 60.0 * self._pulses_per_turn if counts else 0.0
        units_per_min = pulse_hz * 60.0 / command if command else 0.0
        self._quantity += units_per_min / 60.0 * max(0.0, sensed.time_s - self._last_s)
        self._last_s = sensed.time_s
        if self._target is not None and self._target.log_pid:
            self._port.write(encode_trace(self._make_trace(self._target, units_per_min, begin_s)))
        if begin_s < self._next_status_s:
            return
        self._next_status_s = begin_s + STATUS_INTERVAL_S - 1e-6
        # Only a plant whose drive reports its effort (in %) has this reading.
        effort = getattr(sensed, "shaft_effort", None)
        pwm = 2.5 * self.find_shaft_rpm(begin_s) if effort is None else MAX_PWM * effort / 100.0
        if begin_s >= self._next_label_s:
            self._next_label_s = begin_s + LABEL_INTERVAL_S - 1e-6
            self._port.write(encode_label(self._label))
        self._port.write(
            encode_status(
                ModuleStatus(
                    self._module,
                    self._sensor,
                    min(units_per_min, 16777.0),
                    self._quantity,
                    min(MAX_PWM, round(pwm)),
                    self._is_hearing(begin_s),
                    False,
                    min(pulse_hz, 6553.0),
                )
            )
        )
        self._port.write(
            encode_board(
                BoardStatus(
                    self._module,
                    0,
                    0.0,
                    sensed.wheel_pulses,
                    1,
                    FIRMWARE_VERSION,
                    bool(sensed.work_switch),
                    True,
                    True,
                    False,
                )
            )
        )

    def _make_trace(self, target: FlowTarget, units_per_min: float, now_s: float) -> ModuleTrace:
        wanted = target.units_per_min if target.master_on else 0.0
        applied = min(units_per_min, 16777.0)
        error = min(8388.0, max(-8388.0, wanted - applied))
        return ModuleTrace(
            self._module,
            self._sensor,
            round(1000.0 * now_s),
            wanted,
            applied,
            error,
            0.0,
            0,
            min(255, round(2.5 * self.find_shaft_rpm(now_s))),
            1,
            FIRMWARE_VERSION,
        )

    def _is_hearing(self, now_s: float) -> bool:
        return self._target is not None and now_s - self._target_s < CONSOLE_TIMEOUT_S

    def _take_datagram(self, data: bytes, now_s: float) -> None:
        try:
            command = decode_command(data)
        except (RejectedSentence, IgnoredSentence):
            self.refused += 1
            return
        if not self.listens or (command.module, command.sensor) != (self._module, self._sensor):
            return
        if isinstance(command, RelayStates):
            self._relays = command.relays
            return
        self._target, self._target_s = command, now_s
        if command.reset_quantity:
            self._quantity = 0.0
