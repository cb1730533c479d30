"""Which devices does one machine have, and what do they read and obey in a tick? The cab owns all
ports and drivers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from topdress.control.readings import (
    SENSED_COLUMNS,
    DoseOrder,
    DriveCommand,
    Measurements,
    Reading,
)
from topdress.drivers.cab_config import (
    MODULE_TIMEOUT_S,
    BoardConfig,
    CabConfig,
    GnssConfig,
    HeadsConfig,
    RateModuleConfig,
)
from topdress.drivers.cab_line import DatagramLine, DeviceLine
from topdress.drivers.datagrams import Datagrams, UdpPort, open_line
from topdress.drivers.device_status import DeviceStatus
from topdress.drivers.devices.board_frames import TURNED_REQUEST, ShaftTurned
from topdress.drivers.devices.canopy_heads import HeadDecoder, HeadSample
from topdress.drivers.devices.device import LineConfig
from topdress.drivers.devices.lag_rig import RigReadings
from topdress.drivers.devices.point_dose import GivenDose
from topdress.drivers.devices.rate_module import ModuleAddress, RateModule
from topdress.drivers.devices.rate_module_frames import MAX_PWM
from topdress.drivers.devices.registry import list_line_devices, map_receivers
from topdress.drivers.devices.slave_board import BoardReadings, SetPointLimits, SlaveBoard
from topdress.drivers.devices.wheel import WheelGeometry
from topdress.drivers.ports import Clock, Port

if TYPE_CHECKING:
    from topdress.drivers.plugin_process import PluginReceiver

__all__ = [
    "BoardConfig",
    "Cab",
    "CabConfig",
    "DeviceStatus",
    "GnssConfig",
    "HeadsConfig",
    "RateModuleConfig",
]

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
        heads, board, module = config.heads, config.board, config.rate_module
        self._ndvi: list[Reading | None] = [None] * (heads.count if heads else 0)
        # The newest values of all devices, by the names of `Measurements`.
        self._values: dict[str, Any] = {"ndvi": tuple(self._ndvi)}
        self._switch_fitted = config.has_work_switch
        self._index = "ndvi" if heads is None else heads.index
        self._gnss = GnssReader(config.gnss, clock, opener) if config.gnss else None
        self._drives = BoardReader(board, module is not None, clock, opener) if board else None
        self._module = RateModuleReader(module, clock, datagram_opener) if module else None
        self._line_devices = {
            one.section: LineReader(
                _open_device_line(
                    one.section, one.protocol, section, one.make_decoder(section), clock, opener
                ),
                one.find_measurements,
            )
            for one in list_line_devices()
            if (section := getattr(config, one.section)) is not None
        }
        readers: list[LineReader | RateModuleReader | None] = [
            self._gnss,
            *(self._open_heads(heads, clock, opener) if heads else ()),
            self._drives,
            self._module,
            *self._line_devices.values(),
        ]
        self._devices = [reader for reader in readers if reader is not None]

    def read_measurements(self, now_s: float) -> Measurements:
        """Reads the bytes that have arrived and returns the newest accepted value of every
        quantity, however old.

        Bytes are stamped `now_s`, the tick at which they are read, so a time stamp is late by less
        than one tick. A device whose driver raises an exception is put aside until it is plugged in
        again.
        """
        for device in self._devices:
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

    def give_dose(self, now_s: float, angle_deg: float, shaft_rpm: float) -> GivenDose | None:
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
        return board.dose.newest

    @property
    def find_newest_dose(self) -> GivenDose | None:
        """Returns the newest dose with its state; None before the first dose."""
        return self._drives.decoder.dose.newest if self._drives else None

    def request_turned(self) -> ShaftTurned | None:
        """Requests how far the board's shaft has turned and returns the board's last answer. The
        request moves nothing."""
        if self._drives is None:
            return None
        if not self._record_only:
            self._drives.line.write_bytes(self._clock(), TURNED_REQUEST)
        return self._drives.decoder.turned

    def send_rig_order(self, run: int, arm: bool) -> None:
        """Arms the lag rig for run number `run`, or sets it to idle; a machine without a rig
        receives nothing."""
        rig = self._line_devices.get("lag_rig")
        if rig is not None:
            rig.line.write_bytes(self._clock(), rig.decoder.make_order(run, arm))

    @property
    def board(self) -> BoardReadings | None:
        """The newest status line of the slave board, flags included; None before the first."""
        return None if self._drives is None else self._drives.newest

    @property
    def rig_readings(self) -> RigReadings | None:
        """The newest line of the lag rig; None before the first."""
        rig = self._line_devices.get("lag_rig")
        return None if rig is None else rig.newest

    def list_device_status(self, now_s: float) -> tuple[DeviceStatus, ...]:
        """Returns the status of every device, in the order gnss, heads, board, rate module, then
        devices with a line of their own by their sections."""
        return tuple(line.make_status(now_s) for line in self._list_lines())

    def find_device_line(self, name: str) -> DeviceLine | None:
        """Returns the line of the device with this name, as `DeviceStatus.name` gives it; None for
        an unknown name."""
        return next((line for line in self._list_lines() if line.name == name), None)

    def close_devices(self) -> None:
        """Stops the drives and closes the ports."""
        self.send_command(self._clock(), None, False)
        for line in self._list_lines():
            line.port.close()
        if self._gnss is not None:
            self._gnss.close()

    def _send_to_drives(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None:
        """Encodes the bytes of both drives before any are sent, so that a refused number reaches
        neither drive."""
        datagrams: list[bytes] = []
        if self._module is not None:
            valves = command.valves if command is not None and self._module.has_valves else ()
            datagrams = self._module.driver.make_datagrams(
                None if command is None else command.shaft_rpm, enabled, now_s, valves
            )
            command = (
                None
                if command is None
                else command._replace(
                    shaft_rpm=0.0, valves=() if self._module.has_valves else command.valves
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
        return [device.line for device in self._devices]

    def _open_heads(
        self, config: HeadsConfig, clock: Clock, opener: PortOpener
    ) -> Iterator[LineReader]:
        """Yields the reader of each port with a canopy head, or of the port with all."""
        baud = config.baud or config.field_map.baud
        for place, port in enumerate(config.ports, start=1):
            name, head = ("heads", None) if config.multiplexed else (f"head_{place}", place)
            decoder = HeadDecoder(config.field_map, head=head, heads=config.count)
            section = LineConfig(port=port, baud=baud)
            line = _open_device_line(name, config.protocol, section, decoder, clock, opener)
            yield LineReader(line, self._take_sample)

    def _take_sample(self, sample: HeadSample) -> dict[str, Any]:
        # A head may send its second index instead of NDVI; both indices are limited to -1 ... 1.
        value = sample.ndvi if self._index == "ndvi" else sample.index_2
        if value is None or abs(value) > 1.0:
            return {}
        self._ndvi[sample.head - 1] = Reading(value, sample.time_s)
        return {"ndvi": tuple(self._ndvi)}

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


# Names of the readings that the slave board contributes to `Measurements`.
BOARD_READINGS = tuple(name for name in SENSED_COLUMNS if name in BoardReadings._fields)
# Time for which a state of the work switch is valid, s: ten status lines at 20 a second.
WORK_SWITCH_VALID_S = 0.5
# Time for which a dose waits for the board to finish the previous dose, s.
MAX_DOSE_WAIT_S = 0.1
# Time from the first enable 1 to a status line that confirms it, s.
ENABLE_ECHO_TIMEOUT_S = 0.3


class LineReader:
    """Reads a device on a line. `newest` is its newest message, and `find_measurements` gives the
    fields of `Measurements` that a message sets."""

    def __init__(
        self,
        opened: tuple[DeviceLine, Any],
        find_measurements: Callable[[Any], Mapping[str, Any]],
    ) -> None:
        self.line, self.decoder = opened
        self.newest: Any = None
        self._find_measurements = find_measurements

    def read_values(self, now_s: float) -> dict[str, Any]:
        """Returns the fields of `Measurements` that have new values."""
        data = self.line.read_bytes(now_s)
        return self._take_messages(self.decoder.feed(data, now_s) if data else ())

    def _take_messages(self, messages: Iterable[Any]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for self.newest in messages:
            found.update(self._find_measurements(self.newest))
            self.line.note_accepted((self.newest.time_s,))
        return found


class BoardReader(LineReader):
    """Reads the slave board. A rate module turns the shaft of a machine that has one, so its
    readings replace the board's."""

    decoder: SlaveBoard

    def __init__(
        self, config: BoardConfig, has_module: bool, clock: Clock, opener: PortOpener
    ) -> None:
        board = SlaveBoard(
            SetPointLimits(config.max_shaft_rpm, config.max_opening_mm),
            WheelGeometry(config.wheel_circumference_m, config.wheel_pulses_per_turn),
        )
        super().__init__(
            _open_device_line("board", "slave-board/1", config, board, clock, opener),
            self._find_readings,
        )
        of_module = ("shaft_rpm", "shaft_effort") if has_module else ()
        self._names = [name for name in BOARD_READINGS if name not in of_module]
        self._connects = 0

    def read_values(self, now_s: float) -> dict[str, Any]:
        """Returns the readings of new status lines."""
        # After a reconnection another board, or the same board restarted, may be at the end of the
        # line.
        connects = self.line.port.state().connects
        if connects != self._connects:
            self._connects = connects
            self.decoder.forget_board()
        found = super().read_values(now_s)
        self.decoder.dose.check_overdue(now_s)
        return found

    def _find_readings(self, readings: BoardReadings) -> dict[str, Any]:
        found = {
            name: value for name in self._names if (value := getattr(readings, name)) is not None
        }
        if readings.work_switch is not None:
            found["work_switch"] = readings.work_switch, readings.time_s
        return found | {
            "valves": readings.valves,
            "drive_fault": readings.driver_fault,
            "old_orders": readings.old_order,
        }


class GnssReader(LineReader):
    """Reads the source of fixes on its line; gpsd is requested to report at every connection."""

    def __init__(self, config: GnssConfig, clock: Clock, opener: PortOpener) -> None:
        receiver = map_receivers().get(config.protocol)
        self._plugin = _make_plugin_receiver(config.protocol) if receiver is None else None
        decoder = self._plugin if receiver is None else receiver.make_decoder(True)
        super().__init__(
            _open_device_line("gnss", config.protocol, config, decoder, clock, opener),
            lambda fix: {"gnss": fix},
        )
        self._hello = b"" if receiver is None else receiver.hello
        self._greeted = 0

    def read_values(self, now_s: float) -> dict[str, Any]:
        """Returns the newest fix that has arrived."""
        if self._hello:
            state = self.line.port.state()
            if state.connected and state.connects != self._greeted:
                self._greeted = state.connects
                self.line.write_bytes(now_s, self._hello)
        if self._plugin is None:
            return super().read_values(now_s)
        # A plug-in answers later, so it is called at every tick, even without new bytes.
        return self._take_messages(self.decoder.feed(self.line.read_bytes(now_s), now_s))

    def close(self) -> None:
        """Ends the process of a plug-in."""
        if self._plugin is not None:
            self._plugin.close()


def _make_plugin_receiver(protocol: str) -> PluginReceiver:
    from topdress.drivers.plugin_process import PluginReceiver

    return PluginReceiver(protocol)


class RateModuleReader:
    """Reads a rate module on its datagram line. A gate set by hand gets the time stamp of the
    module's own readings."""

    def __init__(self, config: RateModuleConfig, clock: Clock, opener: DatagramOpener) -> None:
        self.driver = RateModule(
            ModuleAddress(config.module, config.sensor),
            config.pulses_per_turn,
            config.max_shaft_rpm,
            config.drive,
        )
        self.line = DatagramLine(
            "rate_module",
            f"rate-module/udp (stops by itself after {MODULE_TIMEOUT_S:g} s)",
            opener(config.url, clock),
            self.driver.counts,
        )
        self._fixed_opening_mm = config.fixed_opening_mm
        self._has_switch = config.work_switch
        self.has_valves = config.valves

    def read_values(self, now_s: float) -> dict[str, Any]:
        """Returns the new readings by name, and the work switch with its time, s."""
        found: dict[str, Any] = {}
        accepted = self.driver.feed(self.line.read_datagrams(now_s), now_s)
        for readings in accepted:
            if readings.shaft_rpm is not None:
                found["shaft_rpm"] = readings.shaft_rpm
                found["shaft_effort"] = Reading(
                    100.0 * abs(readings.pwm) / MAX_PWM, readings.time_s
                )
                if self._fixed_opening_mm is not None:
                    found["opening_mm"] = Reading(self._fixed_opening_mm, readings.time_s)
        self.line.note_accepted(readings.time_s for readings in accepted)
        board, heard_s = self.driver.board, self.driver.board_s
        if self._has_switch and board is not None and heard_s is not None:
            found["work_switch"] = board.work_switch, heard_s
        return found


def _open_device_line(
    name: str,
    protocol: str,
    section: LineConfig,
    decoder: Any,
    clock: Clock,
    opener: PortOpener,
) -> tuple[DeviceLine, Any]:
    """Returns the line of one device, with its baud rate, and its decoder."""
    url, baud = section.port, section.baud
    port = opener(url, baud, clock)
    return DeviceLine(name, protocol, port, decoder.counts, find_serial_baud(url, baud)), decoder


def find_serial_baud(url: str, baud: int) -> int | None:
    """Returns the baud rate of a serial line; None for a socket, a datagram port or a line in
    memory."""
    return None if url.startswith(("socket://", "udp://", "memory:")) else baud
