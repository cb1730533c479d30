"""Which devices does one machine have, and what do they read and obey in a tick? The cab owns all
ports and drivers.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from topdress.control.readings import (
    SENSED_COLUMNS,
    DoseOrder,
    DriveCommand,
    GnssFix,
    Measurements,
    Reading,
    SpeedPlan,
    ValvesSeen,
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
from topdress.drivers.devices.agopengps import AgOpenGpsDecoder
from topdress.drivers.devices.board_frames import TURNED_REQUEST, ShaftTurned
from topdress.drivers.devices.canopy_heads import HeadDecoder
from topdress.drivers.devices.gnss import GnssDecoder
from topdress.drivers.devices.gpsd import WATCH_COMMAND, GpsdDecoder
from topdress.drivers.devices.lag_rig import LagRig, RigReadings
from topdress.drivers.devices.lines import Counts
from topdress.drivers.devices.point_dose import GivenDose
from topdress.drivers.devices.rate_line import RateLineDecoder
from topdress.drivers.devices.rate_module import ModuleAddress, RateModule
from topdress.drivers.devices.rate_module_frames import MAX_PWM
from topdress.drivers.devices.slave_board import BoardReadings, SetPointLimits, SlaveBoard
from topdress.drivers.devices.tractor_speed import TractorSpeedDecoder
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


class FixDecoder(Protocol):
    """Defines what every source of fixes has."""

    counts: Counts

    def feed(self, data: bytes, time_s: float) -> list[GnssFix]: ...


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
        # The newest status line of the slave board, flags included.
        self.board: BoardReadings | None = None
        # The newest line of the lag rig.
        self.rig_readings: RigReadings | None = None
        self._board_connects = 0
        # Time from which the board has been sent enable 1, s; None while it is sent enable 0.
        self._enabled_since_s: float | None = None
        self._clock = clock
        self._fix: GnssFix | None = None
        self._ndvi: list[Reading | None] = [None] * (config.heads.count if config.heads else 0)
        # Every value is a Reading, or None before the device sent its first.
        self._readings: dict[str, Any] = dict.fromkeys(BOARD_READINGS)
        self._valves_seen: ValvesSeen | None = None
        self._work_switch: bool | None = None
        self._work_switch_s = 0.0
        self._switch_fitted = config.has_work_switch
        self._gnss = _GnssSource(config.gnss, clock, opener) if config.gnss else None
        self._heads: list[tuple[DeviceLine, HeadDecoder]] = []
        self._drives: tuple[DeviceLine, SlaveBoard] | None = None
        self._module = (
            _RateModuleLine(config.rate_module, clock, datagram_opener)
            if config.rate_module
            else None
        )
        self._index = "ndvi" if config.heads is None else config.heads.index
        if config.heads is not None:
            self._heads = [
                _open_heads(config.heads, place, clock, opener)
                for place in range(len(config.heads.ports))
            ]
        if config.board is not None:
            board = SlaveBoard(
                SetPointLimits(config.board.max_shaft_rpm, config.board.max_opening_mm),
                WheelGeometry(
                    config.board.wheel_circumference_m, config.board.wheel_pulses_per_turn
                ),
            )
            self._drives = (
                _make_device_line(
                    "board",
                    "slave-board/1",
                    config.board.port,
                    config.board.baud,
                    board,
                    clock,
                    opener,
                ),
                board,
            )
        self._rig: tuple[DeviceLine, LagRig] | None = None
        if config.lag_rig is not None:
            rig = LagRig()
            self._rig = (
                _make_device_line(
                    "lag_rig",
                    "lag-rig/1",
                    config.lag_rig.port,
                    config.lag_rig.baud,
                    rig,
                    clock,
                    opener,
                ),
                rig,
            )
        self._speed_told: SpeedPlan | None = None
        self._tractor: tuple[DeviceLine, TractorSpeedDecoder] | None = None
        if config.tractor is not None:
            decoder = TractorSpeedDecoder()
            self._tractor = (
                _make_device_line(
                    "tractor",
                    "tractor-speed/1",
                    config.tractor.port,
                    config.tractor.baud,
                    decoder,
                    clock,
                    opener,
                ),
                decoder,
            )
        self._rate_asked: Reading | None = None
        self._rate_applied: Reading | None = None
        self._rate_line: tuple[DeviceLine, RateLineDecoder] | None = None
        if config.rate_line is not None:
            rate_decoder = RateLineDecoder(config.rate_line.unit_kg_ha)
            self._rate_line = (
                _make_device_line(
                    "rate_line",
                    "rate-line/1",
                    config.rate_line.port,
                    config.rate_line.baud,
                    rate_decoder,
                    clock,
                    opener,
                ),
                rate_decoder,
            )
        self._listening = self._list_listeners()

    def read_measurements(self, now_s: float) -> Measurements:
        """Reads the bytes that have arrived and returns the newest accepted value of every
        quantity, however old.

        Bytes are stamped `now_s`, the tick at which they are read, so a time stamp is late by less
        than one tick. A device whose driver raises an exception is put aside until it is plugged in
        again.
        """
        for line, listen in self._listening:
            if line.aside:
                continue
            try:
                listen(now_s)
            # An undecodable device must not interrupt the tick of the other devices.
            except Exception as error:
                line.put_aside(error)
        return Measurements(
            now_s,
            gnss=self._fix,
            ndvi=tuple(self._ndvi),
            **self._readings,
            work_switch=self._find_work_switch(now_s),
            drive_fault=self._has_drive_fault(),
            drive_stopped=self._has_drive_stopped(),
            old_orders=self.board is not None and self.board.old_order,
            speed_told=self._speed_told,
            rate_asked=self._rate_asked,
            rate_applied=self._rate_applied,
            canopy_index=self._index,
            valves=self._valves_seen,
            put_aside=tuple(line.blamed for line, _ in self._listening if line.aside),
        )

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
        if self._drives[1].dose.is_ready:
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
        line, board = self._drives
        line.write_bytes(now_s, board.give_dose(angle_deg, shaft_rpm, now_s))
        return board.dose.newest

    @property
    def find_newest_dose(self) -> GivenDose | None:
        """Returns the newest dose with its state; None before the first dose."""
        return self._drives[1].dose.newest if self._drives else None

    def request_turned(self) -> ShaftTurned | None:
        """Requests how far the board's shaft has turned and returns the board's last answer. The
        request moves nothing."""
        if self._drives is None:
            return None
        line, board = self._drives
        if not self._record_only:
            line.write_bytes(self._clock(), TURNED_REQUEST)
        return board.turned

    def send_rig_order(self, run: int, arm: bool) -> None:
        """Arms the lag rig for run number `run`, or sets it to idle; a machine without a rig
        receives nothing."""
        if self._rig is not None:
            line, rig = self._rig
            line.write_bytes(self._clock(), rig.make_order(run, arm))

    def list_device_status(self, now_s: float) -> tuple[DeviceStatus, ...]:
        """Returns the status of every device, in the order gnss, heads, board, rate module, lag
        rig, tractor, rate line."""
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
            line, board = self._drives
            line.write_bytes(now_s, board.make_command_line(command, enabled))
            if not enabled or command is None:
                self._enabled_since_s = None
            elif self._enabled_since_s is None:
                self._enabled_since_s = now_s
        for data in datagrams:
            assert self._module is not None
            self._module.line.write_bytes(now_s, data)

    def _list_lines(self) -> list[DeviceLine]:
        """Returns the line of every device in the order of reading."""
        return [line for line, _ in self._listening]

    def _list_listeners(self) -> list[tuple[DeviceLine, Callable[[float], None]]]:
        """Returns every device with the function that reads it at a tick."""
        found: list[tuple[DeviceLine, Callable[[float], None]]] = []
        if self._gnss is not None:
            found.append((self._gnss.line, self._read_gnss))
        found += [(line, partial(self._read_head, line, decoder)) for line, decoder in self._heads]
        if self._drives is not None:
            found.append((self._drives[0], partial(self._read_board, *self._drives)))
        if self._module is not None:
            found.append((self._module.line, self._read_module))
        if self._rig is not None:
            found.append((self._rig[0], partial(self._read_rig, *self._rig)))
        if self._tractor is not None:
            found.append((self._tractor[0], partial(self._read_tractor, *self._tractor)))
        if self._rate_line is not None:
            found.append((self._rate_line[0], partial(self._read_rate_line, *self._rate_line)))
        return found

    def _read_rate_line(self, line: DeviceLine, decoder: RateLineDecoder, now_s: float) -> None:
        data = line.read_bytes(now_s)
        rates = decoder.feed(data, now_s) if data else []
        for one in rates:
            if one.is_target:
                self._rate_asked = Reading(one.rate_kg_ha, one.time_s)
            else:
                self._rate_applied = Reading(one.rate_kg_ha, one.time_s)
        line.note_accepted(one.time_s for one in rates)

    def _read_tractor(self, line: DeviceLine, decoder: TractorSpeedDecoder, now_s: float) -> None:
        data = line.read_bytes(now_s)
        announced = decoder.feed(data, now_s) if data else []
        self._speed_told = announced[-1] if announced else self._speed_told
        line.note_accepted(one.time_s for one in announced)

    def _read_gnss(self, now_s: float) -> None:
        assert self._gnss is not None
        self._fix = self._gnss.read_fix(now_s) or self._fix

    def _read_module(self, now_s: float) -> None:
        assert self._module is not None
        self._readings.update(self._module.read_module(now_s))
        if self._module.work_switch is not None:
            self._note_work_switch(*self._module.work_switch)

    def _has_drive_fault(self) -> bool:
        return self.board is not None and self.board.driver_fault

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
        if self._switch_fitted and now_s - self._work_switch_s > WORK_SWITCH_VALID_S:
            return None
        return self._work_switch

    def _note_work_switch(self, down: bool | None, time_s: float) -> None:
        self._work_switch, self._work_switch_s = down, time_s

    def _read_head(self, line: DeviceLine, decoder: HeadDecoder, now_s: float) -> None:
        data = line.read_bytes(now_s)
        samples = decoder.feed(data, now_s) if data else []
        # A head may send its second index instead of NDVI; both indices are limited to -1 ... 1.
        for sample in samples:
            value = sample.ndvi if self._index == "ndvi" else sample.index_2
            if value is not None and abs(value) <= 1.0:
                self._ndvi[sample.head - 1] = Reading(value, sample.time_s)
        line.note_accepted(sample.time_s for sample in samples)

    def _read_board(self, line: DeviceLine, board: SlaveBoard, now_s: float) -> None:
        # After a reconnection another board, or the same board restarted, may be at the end of the
        # line.
        connects = line.port.state().connects
        if connects != self._board_connects:
            self._board_connects = connects
            board.forget_board()
        data = line.read_bytes(now_s)
        accepted = board.feed(data, now_s) if data else []
        for readings in accepted:
            self.board = readings
            if readings.work_switch is not None:
                self._note_work_switch(readings.work_switch, readings.time_s)
            self._valves_seen = readings.valves
            for name in BOARD_READINGS:
                value = getattr(readings, name)
                # The rate module turns the shaft of such a machine, so its readings replace the
                # board's.
                if value is not None and not (
                    name in ("shaft_rpm", "shaft_effort") and self._module is not None
                ):
                    self._readings[name] = value
        board.dose.check_overdue(now_s)
        line.note_accepted(readings.time_s for readings in accepted)

    def _read_rig(self, line: DeviceLine, rig: LagRig, now_s: float) -> None:
        data = line.read_bytes(now_s)
        accepted = rig.feed(data, now_s) if data else []
        self.rig_readings = accepted[-1] if accepted else self.rig_readings
        line.note_accepted(readings.time_s for readings in accepted)


# Names of the readings that the slave board contributes to `Measurements`.
BOARD_READINGS = tuple(name for name in SENSED_COLUMNS if name in BoardReadings._fields)
# Time for which a state of the work switch is valid, s: ten status lines at 20 a second.
WORK_SWITCH_VALID_S = 0.5
# Time for which a dose waits for the board to finish the previous dose, s.
MAX_DOSE_WAIT_S = 0.1
# Time from the first enable 1 to a status line that confirms it, s.
ENABLE_ECHO_TIMEOUT_S = 0.3


class _GnssSource:
    """Reads the source of fixes on its line; gpsd is requested to report at every connection."""

    def __init__(self, config: GnssConfig, clock: Clock, opener: PortOpener) -> None:
        makers: dict[str, Callable[[], FixDecoder]] = {
            "nmea0183": GnssDecoder,
            "gpsd": GpsdDecoder,
            "agopengps": AgOpenGpsDecoder,
        }
        maker = makers.get(config.protocol)
        self._plugin: PluginReceiver | None = None
        self._decoder: FixDecoder
        if maker is None:
            self._decoder = self._plugin = _make_plugin_receiver(config.protocol)
        else:
            self._decoder = maker()
        self.line = _make_device_line(
            "gnss", config.protocol, config.port, config.baud, self._decoder, clock, opener
        )
        self._hello = WATCH_COMMAND if config.protocol == "gpsd" else b""
        self._greeted = 0

    def read_fix(self, now_s: float) -> GnssFix | None:
        """Returns the newest fix that has arrived."""
        port = self.line.port
        if self._hello:
            state = port.state()
            if state.connected and state.connects != self._greeted:
                self._greeted = state.connects
                self.line.write_bytes(now_s, self._hello)
        data = self.line.read_bytes(now_s)
        # A plug-in answers later, so it is called at every tick, even without new bytes.
        fixes = self._decoder.feed(data, now_s) if data or self._plugin is not None else []
        self.line.note_accepted(fix.time_s for fix in fixes)
        return fixes[-1] if fixes else None

    def close(self) -> None:
        """Ends the process of a plug-in."""
        if self._plugin is not None:
            self._plugin.close()


def _make_plugin_receiver(protocol: str) -> PluginReceiver:
    from topdress.drivers.plugin_process import PluginReceiver

    return PluginReceiver(protocol)


class _RateModuleLine:
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

    @property
    def work_switch(self) -> tuple[bool, float] | None:
        """Returns the newest state of the work switch and its time, s; None without a state."""
        board, heard_s = self.driver.board, self.driver.board_s
        return (
            (board.work_switch, heard_s)
            if self._has_switch and board is not None and heard_s is not None
            else None
        )

    def read_module(self, now_s: float) -> dict[str, Reading | None]:
        """Returns the new readings by name; empty if nothing arrived."""
        found: dict[str, Reading | None] = {}
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
        return found


def _open_heads(
    config: HeadsConfig, place: int, clock: Clock, opener: PortOpener
) -> tuple[DeviceLine, HeadDecoder]:
    head = None if config.multiplexed else place + 1
    decoder = HeadDecoder(config.field_map, head=head, heads=config.count)
    baud = config.baud or config.field_map.baud
    name = "heads" if config.multiplexed else f"head_{place + 1}"
    return _make_device_line(
        name, config.protocol, config.ports[place], baud, decoder, clock, opener
    ), decoder


class _CountingDriver(Protocol):
    """Defines a driver or decoder that counts its messages."""

    @property
    def counts(self) -> Counts: ...


def _make_device_line(
    name: str,
    protocol: str,
    url: str,
    baud: int,
    driver: _CountingDriver,
    clock: Clock,
    opener: PortOpener,
) -> DeviceLine:
    """Returns the line of one device, with its baud rate."""
    return DeviceLine(
        name, protocol, opener(url, baud, clock), driver.counts, find_serial_baud(url, baud)
    )


def find_serial_baud(url: str, baud: int) -> int | None:
    """Returns the baud rate of a serial line; None for a socket, a datagram port or a line in
    memory."""
    return None if url.startswith(("socket://", "udp://", "memory:")) else baud
