"""Which devices does one machine have, and what do they read and obey in a tick? The cab owns all
ports and drivers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from topdress.control.readings import DoseOrder, DriveCommand, Measurements
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.cab_line import DatagramLine, DeviceLine
from topdress.drivers.datagrams import Datagrams, UdpPort, open_line
from topdress.drivers.device_status import DeviceStatus
from topdress.drivers.devices.board_frames import TURNED_REQUEST, ShaftTurned
from topdress.drivers.devices.device import OpenLine
from topdress.drivers.devices.lag_rig import RigReadings
from topdress.drivers.devices.point_dose import DoseProgress
from topdress.drivers.devices.registry import list_devices
from topdress.drivers.devices.slave_board import BoardReadings
from topdress.drivers.ports import Clock, Port

PortOpener = Callable[[str, int, Clock], Port]
DatagramOpener = Callable[[str, Clock], Datagrams]


class Cab:
    """Owns the ports and drivers of one machine.

    `read_measurements` and `send_command` are called once a tick by one thread and never wait for a
    device. `refused_commands` counts the set-points that were not finite; the drives receive a stop
    instead. `dropped_doses` counts the doses that arrived while the board was still delivering the
    previous dose.
    """

    def __init__(
        self,
        config: CabConfig,
        clock: Clock,
        opener: PortOpener = open_line,
        datagram_opener: DatagramOpener = UdpPort,
    ) -> None:
        self._record_only = config.record_only
        self.refused_commands = 0
        self.dropped_doses = 0
        self._dose_waits: tuple[float, DoseOrder] | None = None
        # Time from which the board has been sent enable 1, s; None while it is sent enable 0.
        self._enabled_since_s: float | None = None
        self._clock = clock
        # The newest values of all devices, by the names of `Measurements`.
        self._values: dict[str, Any] = {}
        self._switch_fitted = config.has_work_switch
        self._index = "ndvi" if config.heads is None else config.heads.index
        self._module_has_valves = config.rate_module is not None and config.rate_module.valves
        fitted = [one for one in list_devices() if getattr(config, one.section) is not None]
        self._devices = {
            line.name: LineReader(
                line,
                frozenset(name for other in fitted if other is not device for name in other.sole),
                _open_device_line(line, clock, opener, datagram_opener),
            )
            for device in fitted
            for line in device.open_lines(getattr(config, device.section))
        }
        self._drives, self._module = self._devices.get("board"), self._devices.get("rate_module")

    def read_measurements(self, now_s: float) -> Measurements:
        """Reads the bytes that have arrived and returns the newest accepted value of every
        quantity, however old.

        Bytes are stamped `now_s`, the tick at which they are read, so a time stamp is late by less
        than one tick. A device whose driver raises an exception is put aside until it is plugged in
        again.
        """
        for device in self._devices.values():
            if device.line.aside:
                continue
            try:
                self._values.update(device.read_values(now_s))
            # An undecodable device must not interrupt the tick of the other devices.
            except Exception as error:
                device.line.put_aside(error)
        own = {
            "work_switch": self._find_work_switch(now_s),
            "drive_stopped": self._has_drive_stopped(),
            "canopy_index": self._index,
            "put_aside": tuple(line.blamed for line in self._list_lines() if line.aside),
        }
        return Measurements(now_s, **self._values | own)

    def send_command(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None:
        """Sends the set-points of this tick, which are also the heartbeat; a machine without drives
        receives nothing.

        A stop is sent if `enabled` is False or `command` is None. Set-points are cut to the limits
        of the drives. On a machine with a rate module the board receives only the set-point of the
        gate. A record-only machine is sent nothing.
        """
        if self._record_only:
            return
        try:
            self._send_to_drives(now_s, command, enabled)
            self._give_ordered_dose(now_s, command if enabled else None)
        except ValueError:
            self.refused_commands += 1
            self._send_to_drives(now_s, None, False)

    def _give_ordered_dose(self, now_s: float, command: DriveCommand | None) -> None:
        """Sends the dose of this tick's command. The dose waits one or two ticks while the board
        delivers the previous dose; after that it is dropped and counted."""
        if command is None or self._drives is None:
            self._dose_waits = None
            return
        if command.dose is not None:
            self.dropped_doses += self._dose_waits is not None
            self._dose_waits = now_s, command.dose
        if self._dose_waits is None:
            return
        since_s, dose = self._dose_waits
        if self._drives.decoder.dose.is_ready:
            self._dose_waits = None
            self.give_dose(now_s, *dose)
        elif now_s - since_s > MAX_DOSE_WAIT_S:
            self._dose_waits = None
            self.dropped_doses += 1

    def give_dose(self, now_s: float, angle_deg: float, shaft_rpm: float) -> DoseProgress | None:
        """Sends one dose of a point applicator; returns None for a machine without a board.

        The result of the dose is in `dose` of every later measurement.

        Parameters
        ----------
        angle_deg : angle by which the metering shaft turns, degrees.
        shaft_rpm : speed of the shaft during the dose, r/min.

        Raises
        ------
        ValueError : the angle or the speed is not allowed, or the previous dose is not finished.
        """
        if self._drives is None or self._record_only:
            return None
        board = self._drives.decoder
        self._drives.line.write_bytes(now_s, board.give_dose(angle_deg, shaft_rpm, now_s))
        given: DoseProgress | None = board.dose.newest
        return given

    @property
    def find_newest_dose(self) -> DoseProgress | None:
        """Returns the newest dose with its state; None before the first dose."""
        return self._drives.decoder.dose.newest if self._drives else None

    def request_turned(self) -> ShaftTurned | None:
        """Requests how far the board's shaft has turned and returns the board's last answer. The
        request moves nothing."""
        if self._drives is None:
            return None
        if not self._record_only:
            self._drives.line.write_bytes(self._clock(), TURNED_REQUEST)
        turned: ShaftTurned | None = self._drives.decoder.turned
        return turned

    def send_rig_order(self, run: int, arm: bool) -> None:
        """Arms the lag rig for run number `run`, or sets it to idle; a machine without a rig
        receives nothing."""
        rig = self._devices.get("lag_rig")
        if rig is not None:
            rig.line.write_bytes(self._clock(), rig.decoder.make_order(run, arm))

    @property
    def board(self) -> BoardReadings | None:
        """The newest status line of the slave board, flags included; None before the first."""
        return None if self._drives is None else self._drives.newest

    @property
    def rig_readings(self) -> RigReadings | None:
        """The newest line of the lag rig; None before the first."""
        rig = self._devices.get("lag_rig")
        return None if rig is None else rig.newest

    def list_device_status(self, now_s: float) -> tuple[DeviceStatus, ...]:
        """Returns the status of every device, in the order gnss, heads, board, rate module, then
        devices with a line of their own by their sections."""
        return tuple(line.make_status(now_s) for line in self._list_lines())

    def find_device_line(self, name: str) -> DeviceLine | None:
        """Returns the line of the device with this name, as `DeviceStatus.name` gives it; None for
        an unknown name."""
        return self._devices[name].line if name in self._devices else None

    def close_devices(self) -> None:
        """Stops the drives and closes the ports."""
        self.send_command(self._clock(), None, False)
        for device in self._devices.values():
            device.line.port.close()
            device.close()

    def _send_to_drives(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None:
        """Encodes the bytes of both drives before any are sent, so that a refused number reaches
        neither drive."""
        datagrams: list[bytes] = []
        if self._module is not None:
            valves = command.valves if command is not None and self._module_has_valves else ()
            datagrams = self._module.decoder.make_datagrams(
                None if command is None else command.shaft_rpm, enabled, now_s, valves
            )
            command = (
                None
                if command is None
                else command._replace(
                    shaft_rpm=0.0, valves=() if self._module_has_valves else command.valves
                )
            )
        if self._drives is not None:
            line = self._drives.decoder.make_command_line(command, enabled)
            self._drives.line.write_bytes(now_s, line)
            if not enabled or command is None:
                self._enabled_since_s = None
            elif self._enabled_since_s is None:
                self._enabled_since_s = now_s
        for data in datagrams:
            assert self._module is not None
            self._module.line.write_bytes(now_s, data)

    def _list_lines(self) -> list[DeviceLine]:
        """Returns the line of every device in the order of reading."""
        return [device.line for device in self._devices.values()]

    def _has_drive_stopped(self) -> bool:
        """Returns whether the board has stopped following commands for longer than a command and
        its echo may take.

        Such a board lost the heartbeat or its power and waits for enable 0. A driver's fault is
        reported separately.
        """
        board, since_s = self.board, self._enabled_since_s
        return (
            board is not None
            and since_s is not None
            and not board.enabled
            and not board.driver_fault
            and board.time_s - since_s > ENABLE_ECHO_TIMEOUT_S
        )

    def _find_work_switch(self, now_s: float) -> bool | None:
        """Returns the newest state of the work switch; a fitted switch that falls silent is unknown
        (None)."""
        down, heard_s = self._values.get("work_switch", (None, 0.0))
        return None if self._switch_fitted and now_s - heard_s > WORK_SWITCH_VALID_S else down


# Time for which a state of the work switch is valid, s: ten status lines at 20 a second.
WORK_SWITCH_VALID_S = 0.5
# Time for which a dose waits for the board to finish the previous dose, s.
MAX_DOSE_WAIT_S = 0.1
# Time from the first enable 1 to a status line that confirms it, s.
ENABLE_ECHO_TIMEOUT_S = 0.3


class LineReader:
    """Reads one line of a device. `newest` is its newest message; what another device alone gives
    on this machine is `withheld`."""

    def __init__(self, opened: OpenLine, withheld: frozenset[str], line: DeviceLine) -> None:
        self.line, self.decoder, self.close = line, opened.decoder, opened.close
        self.newest: Any = None
        self._opened = opened
        self._withheld = withheld
        self._connects = 0

    def read_values(self, now_s: float) -> dict[str, Any]:
        """Returns the fields of `Measurements` that have new values."""
        state = self.line.port.state()
        if state.connected and state.connects != self._connects:
            self._connects = state.connects
            hello = self._opened.begin()
            if hello:
                self.line.write_bytes(now_s, hello)
        found: dict[str, Any] = {}
        for message in self.decoder.feed(self.line.read_input(now_s), now_s):
            self.newest = message
            found.update(self._opened.find_measurements(message))
            self.line.note_accepted((message.time_s,))
        found.update(self._opened.find_state(now_s))
        return {name: value for name, value in found.items() if name not in self._withheld}


def _open_device_line(
    line: OpenLine, clock: Clock, opener: PortOpener, datagram_opener: DatagramOpener
) -> DeviceLine:
    """Returns the opened line of a device, with its baud rate."""
    counts = line.decoder.counts
    if line.baud is None:
        return DatagramLine(line.name, line.protocol, datagram_opener(line.url, clock), counts)
    port = opener(line.url, line.baud, clock)
    return DeviceLine(line.name, line.protocol, port, counts, find_serial_baud(line.url, line.baud))


def find_serial_baud(url: str, baud: int) -> int | None:
    """Returns the baud rate of a serial line; None for a socket, a datagram port or a line in
    memory."""
    return None if url.startswith(("socket://", "udp://", "memory:")) else baud
