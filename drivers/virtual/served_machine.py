"""How is the virtual machine served to other programs? It uses TCP ports, pseudo-terminals and UDP,
with faults on a time line.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from topdress.control.simulation.plant import Plant
from topdress.drivers.datagrams import Datagrams, UdpPort
from topdress.drivers.devices.canopy_heads import FIELDS_OF_PROTOCOL
from topdress.drivers.devices.device import LineDevice
from topdress.drivers.devices.registry import list_line_devices
from topdress.drivers.ports import (
    READ_TIMEOUT_S,
    Clock,
    Port,
    PortState,
    SocketStream,
    ThreadedPort,
)
from topdress.drivers.virtual.faults import (
    DRIVE_FAULTS,
    DriveRunaway,
    LineCorrupter,
    PortFaults,
    ServedLine,
    TimedFault,
    VirtualRunaway,
    find_faults,
    find_runaway,
)
from topdress.drivers.virtual.gpsd import GpsdServer, VirtualGpsd
from topdress.drivers.virtual.lag_rig import VirtualLagRig
from topdress.drivers.virtual.machine import INITIAL_OPENING_MM, VirtualMachine
from topdress.drivers.virtual.virtual_devices import (
    MachineExtra,
    VirtualAgOpenGps,
    VirtualLine,
    VirtualRateModule,
)


# This class needs a POSIX system. It is the virtual machine's end of a serial line, under a name
# that survives reconnections.
class TerminalPort(ThreadedPort):
    """Serves the device's end; a program opens the name `link` like a serial port. The port is
    connected while a program has it open.

    Raises
    ------
    OSError : the system has no pseudo-terminals, or the link cannot be made.
    """

    def __init__(self, link: Path, clock: Clock) -> None:
        self._link = link
        self._master = -1
        self._make_terminal()
        super().__init__(
            str(link),
            self._wait_for_program,
            clock,
            first_back_off_s=0.01,
            longest_back_off_s=0.01,
        )

    def disconnect(self) -> None:
        """Unplugs the line: the terminal and its name disappear, as when a USB plug is pulled."""
        if self._master >= 0:
            with contextlib.suppress(OSError):
                os.close(self._master)
            self._master = -1
            self._link.unlink(missing_ok=True)

    def close(self) -> None:
        """Closes the pseudo-terminal."""
        super().close()
        self.disconnect()

    def _wait_for_program(self) -> _MasterStream:
        if self._master < 0:
            self._make_terminal()
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        if any(event & select.POLLHUP for _, event in poll.poll(0)):
            raise TimeoutError("no program has it open")
        return _MasterStream(self._master)

    def _make_terminal(self) -> None:
        if sys.platform == "win32":
            raise OSError("this system has no pseudo-terminals")
        import tty

        self._master, slave = os.openpty()
        tty.setraw(slave)
        name = os.ttyname(slave)
        os.set_blocking(self._master, False)
        os.close(slave)
        self._link.parent.mkdir(parents=True, exist_ok=True)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(name)


class _MasterStream:
    """Reads until the program closes its end, which raises OSError. Bytes that the program does not
    read in time are lost."""

    def __init__(self, master: int) -> None:
        self._master = master

    def read(self) -> bytes:
        """Returns the bytes that the program has written."""
        if not select.select([self._master], [], [], READ_TIMEOUT_S)[0]:
            return b""
        return os.read(self._master, 4096)

    def write(self, data: bytes) -> None:
        """Sends bytes to the program."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)

    def close(self) -> None:
        """Keeps the terminal open, because it outlives the program that used it."""


# This port is the virtual machine's end of a `socket://` line and accepts one TCP client at a time.
class ListeningPort(ThreadedPort):
    """Listens at once and is connected while a client is connected. The next client is accepted
    after the present client has disconnected.

    Raises
    ------
    OSError : the port cannot listen on the address.
    """

    def __init__(self, host: str, number: int, clock: Clock) -> None:
        self._server: socket.socket | None = socket.create_server((host, number))
        self._server.settimeout(READ_TIMEOUT_S)
        self.number: int = self._server.getsockname()[1]
        self._address = host, self.number
        super().__init__(
            f"socket://{host}:{self.number}",
            self._accept_client,
            clock,
            first_back_off_s=0.01,
            longest_back_off_s=0.01,
        )

    def disconnect(self) -> None:
        """Unplugs the line, so that no client can connect."""
        if self._server is not None:
            with contextlib.suppress(OSError):
                self._server.close()
            self._server = None

    def close(self) -> None:
        """Stops listening."""
        super().close()
        self.disconnect()

    def _accept_client(self) -> SocketStream:
        """Accepts a client on the reader's thread, the only thread that uses the listening socket
        while the port is open."""
        if self._server is None:
            self._server = socket.create_server(self._address)
            self._server.settimeout(READ_TIMEOUT_S)
        try:
            connection, _ = self._server.accept()
        except TimeoutError:
            raise TimeoutError("no client yet") from None
        return SocketStream(connection)


# First of the TCP ports that `topdress serve-machine` opens by default.
DEFAULT_FIRST_PORT = 4100
# Pulses of the virtual rate module's encoder for one turn of the shaft.
TRUE_PULSES_PER_TURN = 360.0


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """Defines which devices are served and at which addresses. `first_port` 0 means any free ports.
    Rate module and AgOpenGPS are (host, port), or None if they are not served."""

    host: str = "127.0.0.1"
    first_port: int = DEFAULT_FIRST_PORT
    heads: int = 6
    protocol: str = "greenseeker"
    opening_mm: float = INITIAL_OPENING_MM
    # The folder for the names of the pseudo-terminals; None means TCP ports.
    terminals: Path | None = None
    # The address at which the virtual module listens.
    rate_module: tuple[str, int] | None = None
    # The address to which the virtual module answers.
    console: tuple[str, int] = ("127.0.0.1", 29999)
    # The address to which positions are sent.
    agopengps: tuple[str, int] | None = None
    faults: Sequence[TimedFault] = field(default=())

    @property
    def devices(self) -> tuple[str, ...]:
        """Names of the devices that are served."""
        heads = tuple(f"head_{n}" for n in range(1, self.heads + 1))
        more = [
            name
            for name, there in (("rate_module", self.rate_module), ("agopengps", self.agopengps))
            if there
        ]
        return ("gnss", *heads, "board", "gpsd", "lag_rig", *_find_virtual_lines(), *more)

    def replace_faults(self, faults: Sequence[TimedFault]) -> ServeOptions:
        """Returns the same options with other faults."""
        return replace(self, faults=faults)


class ServedAddress(NamedTuple):
    """Holds the address of one served device."""

    device: str
    protocol: str
    url: str


class ServedDatagrams:
    """Serves a datagram line. Its faults act on the direction away from the device; unplugged acts
    on both."""

    def __init__(self, inner: Datagrams, clock: Clock, seed: int) -> None:
        self._inner = inner
        self._spoiler = LineCorrupter(clock, seed=seed, by_lines=False)

    @property
    def name(self) -> str:
        """Address of the line."""
        return self._inner.name

    def set_faults(self, faults: PortFaults) -> None:
        """Sets the faults of the line from now on."""
        self._spoiler.faults = faults

    def read_each(self) -> list[bytes]:
        """Returns the datagrams that have arrived."""
        self.send_due()
        found = self._inner.read_each()
        return [] if self._spoiler.faults.unplugged else found

    def read(self) -> bytes:
        """Returns the bytes of all datagrams that have arrived."""
        return b"".join(self.read_each())

    def write(self, data: bytes) -> None:
        """Sends one datagram with the faults of the line."""
        self._spoiler.put_bytes(data)
        self.send_due()

    def send_due(self) -> None:
        """Sends the datagrams that are due."""
        for data in self._spoiler.take_due():
            self._inner.write(data)

    def state(self) -> PortState:
        """Returns whether the line is connected, and its traffic."""
        return self._inner.state()

    def plug(self, plugged: bool) -> None:
        """Plugs the line in or unplugs it."""
        self._inner.plug(plugged)

    def close(self) -> None:
        """Closes the machine's end."""
        self._inner.close()


class ServedMachine:
    """Serves a plant with all its protocols. `advance_plant` is called often.

    Raises
    ------
    OSError : a port is in use, or the system has no pseudo-terminals.
    """

    def __init__(self, plant: Plant, serve: ServeOptions, clock: Clock) -> None:
        self._serve = serve
        self._clock = clock
        self._start_s = clock()
        self._lines: dict[str, ServedLine | ServedDatagrams | GpsdServer] = {}
        self._in_force: dict[str, PortFaults] = {}
        self._runs_away = DriveRunaway()
        try:
            self._machine = self._build_machine(plant, serve)
        except OSError:
            self._close_lines()
            raise

    @property
    def addresses(self) -> tuple[ServedAddress, ...]:
        """Returns the address of each device."""
        protocols = {
            "gnss": "nmea0183",
            "board": "slave-board/1",
            "gpsd": "gpsd",
            "lag_rig": "lag-rig/1",
            "rate_module": "rate-module/udp",
            "agopengps": "agopengps",
            **{name: one.protocol for name, one in _find_virtual_lines().items()},
        }
        return tuple(
            ServedAddress(device, protocols.get(device, self._serve.protocol), url)
            for device, line in self._lines.items()
            for url in ((line.name,) if isinstance(line, ServedDatagrams) else line.names)
        )

    def advance_plant(self) -> list[str]:
        """Steps the plant to the present, and returns descriptions of the faults that began or
        ended."""
        now_s = self._clock()
        changes = []
        for device, line in self._lines.items():
            faults = find_faults(self._serve.faults, device, now_s - self._start_s)
            if faults != self._in_force.get(device, PortFaults()):
                line.set_faults(faults)
                self._in_force[device] = faults
                changes.append(f"{device}: {_describe_faults(faults)}")
            line.send_due()
        runs_away = find_runaway(self._serve.faults, now_s - self._start_s)
        if runs_away != self._runs_away:
            self._runs_away = runs_away
            changes.append(f"board: {_describe_runaway(runs_away)}")
        self._machine.advance_to(now_s)
        return changes

    def close(self) -> None:
        """Closes the machine's ends of all lines."""
        self._close_lines()

    def _build_machine(self, plant: Plant, serve: ServeOptions) -> VirtualMachine:
        heads = [f"head_{n}" for n in range(1, serve.heads + 1)]
        lines: dict[str, ServedLine] = {}
        own = _find_virtual_lines()
        for place, device in enumerate(("gnss", *heads, "board", "gpsd", "lag_rig", *own)):
            if device == "gpsd":
                number = serve.first_port + place if serve.first_port else 0
                terminal = (
                    TerminalPort(serve.terminals / device, self._clock)
                    if serve.terminals is not None
                    else None
                )
                gpsd = self._lines[device] = GpsdServer(
                    serve.host, number, self._clock, place, terminal
                )
            else:
                lines[device] = self._lines[device] = self._make_line(device, serve, place)
        extras: list[MachineExtra] = [
            VirtualGpsd(gpsd),
            VirtualLagRig(lines["lag_rig"], lambda: getattr(plant, "truth", None)),
            *(VirtualLine(one, lines[name]) for name, one in own.items()),
        ]
        if serve.rate_module is not None:
            host, number = serve.rate_module
            module = self._make_datagrams(
                "rate_module", f"udp://{host}:{number}?to={serve.console[0]}:{serve.console[1]}"
            )
            extras.append(VirtualRateModule(module, TRUE_PULSES_PER_TURN))
        if serve.agopengps is not None:
            host, number = serve.agopengps
            extras.append(
                VirtualAgOpenGps(
                    self._make_datagrams("agopengps", f"udp://{host}:0?to={host}:{number}")
                )
            )
        if any(fault.kind in DRIVE_FAULTS for fault in serve.faults):
            extras.append(
                VirtualRunaway(lambda at_s: find_runaway(serve.faults, at_s), self._start_s)
            )
        return VirtualMachine(
            plant,
            lines["gnss"],
            [lines[name] for name in heads],
            lines["board"],
            self._start_s,
            layout=FIELDS_OF_PROTOCOL[serve.protocol],
            opening_mm=serve.opening_mm,
            extras=extras,
        )

    def _make_line(self, device: str, serve: ServeOptions, place: int) -> ServedLine:
        number = serve.first_port + place if serve.first_port else 0
        ends: list[Port] = [ListeningPort(serve.host, number, self._clock)]
        if serve.terminals is not None:
            ends.append(TerminalPort(serve.terminals / device, self._clock))
        return ServedLine(ends, self._clock, seed=place)

    def _make_datagrams(self, device: str, url: str) -> ServedDatagrams:
        line = ServedDatagrams(UdpPort(url, self._clock), self._clock, seed=len(self._lines))
        self._lines[device] = line
        return line

    def _close_lines(self) -> None:
        for line in self._lines.values():
            line.close()


def _find_virtual_lines() -> dict[str, LineDevice]:
    """Returns the devices with a line of their own that the virtual machine has, by section."""
    return {one.section: one for one in list_line_devices() if one.make_message is not None}


def _describe_runaway(runs_away: DriveRunaway) -> str:
    wrong = [
        f"{name} {value:g} whatever the command"
        for name, value in runs_away._asdict().items()
        if value is not None
    ]
    return ", ".join(wrong) or "its drives obey"


def _describe_faults(faults: PortFaults) -> str:
    wrong = [name for name, value in faults._asdict().items() if value]
    return ", ".join(wrong) or "as it should be"
