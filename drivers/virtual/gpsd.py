"""How does the virtual machine imitate gpsd? The server greets each client, answers its questions,
and reports to clients that watch.
"""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Sequence
from typing import Any, Protocol

from topdress.control.readings import DriveCommand, GnssFix
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.ports import UNPLUGGED, Clock, Port, PortState
from topdress.drivers.virtual.faults import LineCorrupter, PortFaults, ServedLine
from topdress.drivers.virtual.virtual_devices import MachineExtra

VERSION_REPORT = {"class": "VERSION", "release": "3.25", "proto_major": 3, "proto_minor": 15}
DEVICE_PATH = "/dev/virtual"
# Status of gpsd for each fix quality of GGA (gpsd_json(5), TPV).
STATUS_OF_QUALITY = {2: 2, 4: 3, 5: 4}
# Longest command of a client, bytes; a client that sends more without a line end is dropped.
MAX_COMMAND_BYTES = 4096
MAX_CLIENTS = 16
# Unsent bytes after which a client that no longer reads is disconnected.
MAX_UNSENT_BYTES = 262_144


class ClientLine(Protocol):
    """Defines one client's connection, as the virtual gpsd uses it."""

    def read(self) -> bytes: ...

    def write(self, data: bytes) -> None: ...

    def state(self) -> PortState: ...


class ClientList(Protocol):
    """Defines a server with several clients."""

    def list_clients(self) -> Sequence[ClientLine]:
        """Returns the clients that are connected now."""
        ...


class VirtualGpsd(MachineExtra):
    """Serves several clients, each with its own watch. The commands ?VERSION, ?DEVICES, ?WATCH and
    ?POLL are answered; all others get an ERROR.

    `line` is the connection of the only client, or a server with all clients.
    """

    def __init__(self, line: Port | ClientList) -> None:
        self._line = line
        self._sessions: dict[int, _ClientSession] = {}

    def alter_command(
        self, begin_s: float, command: DriveCommand, enabled: bool
    ) -> tuple[DriveCommand, bool]:
        """Answers the commands that have arrived; the drives' command is unchanged."""
        lines: Sequence[ClientLine] = (
            self._line.list_clients() if hasattr(self._line, "list_clients") else (self._line,)
        )
        sessions = {
            id(line): self._sessions.get(id(line)) or _ClientSession(line) for line in lines
        }
        self._sessions = sessions
        for session in sessions.values():
            session.answer_commands()
        return command, enabled

    def take_readings(self, sensed: SensorReadings, begin_s: float) -> None:
        """Reports a new fix to every client that watches."""
        if sensed.gnss is not None:
            for session in self._sessions.values():
                session.report_fix(sensed.gnss)


class _ClientSession:
    """Serves one client: its commands and its watch."""

    def __init__(self, line: ClientLine) -> None:
        self._line = line
        self._connects = 0
        self._watched = False
        self._rest = b""
        self._sky: dict[str, object] | None = None
        self._fix: dict[str, object] | None = None

    def answer_commands(self) -> None:
        """Answers the commands that the client has sent."""
        state = self._line.state()
        if state.connected and state.connects != self._connects:
            self._connects, self._watched, self._rest = state.connects, False, b""
            self._send_object(VERSION_REPORT)
        *questions, self._rest = (self._rest + self._line.read()).replace(b"\n", b";").split(b";")
        self._rest = self._rest[-MAX_COMMAND_BYTES:]
        for question in questions:
            if question.strip():
                self._answer_command(question.strip().decode("ascii", "replace"))

    def report_fix(self, fix: GnssFix) -> None:
        """Sends one fix to a client that watches."""
        self._sky = {
            "class": "SKY",
            "device": DEVICE_PATH,
            "uSat": fix.satellites,
            "hdop": fix.hdop,
        }
        self._fix = {
            "class": "TPV",
            "device": DEVICE_PATH,
            "mode": 3 if fix.fix_quality else 1,
            "status": STATUS_OF_QUALITY.get(fix.fix_quality, 1),
            "time": fix.utc,
            "lat": fix.lat_deg,
            "lon": fix.lon_deg,
            "track": fix.heading_deg,
            "speed": fix.speed_mps,
        }
        if self._watched:
            self._send_object(self._sky)
            self._send_object(self._fix)

    def _answer_command(self, question: str) -> None:
        name, _, given = question.partition("=")
        devices: dict[str, object] = {
            "class": "DEVICES",
            "devices": [{"class": "DEVICE", "path": DEVICE_PATH, "driver": "virtual"}],
        }
        if name == "?VERSION":
            self._send_object(VERSION_REPORT)
        elif name == "?DEVICES":
            self._send_object(devices)
        elif name == "?WATCH":
            self._set_watch(given, devices)
        elif name == "?POLL":
            reports = {
                "tpv": [] if self._fix is None else [_drop_unknown_values(self._fix)],
                "sky": [] if self._sky is None else [_drop_unknown_values(self._sky)],
            }
            time = None if self._fix is None else self._fix["time"]
            self._send_object(
                {"class": "POLL", "time": time, "active": len(reports["tpv"]), **reports}
            )
        else:
            self._send_object({"class": "ERROR", "message": f"Unrecognized request '{name}'"})

    def _set_watch(self, given: str, devices: dict[str, object]) -> None:
        """Sets the watch; a command without a value reports the state of the watch, as
        gpsd does."""
        if given:
            try:
                wanted = json.loads(given)
            except ValueError:
                wanted = None
            if not isinstance(wanted, dict):
                self._send_object({"class": "ERROR", "message": "Invalid WATCH: not a JSON object"})
                return
            self._watched = bool(wanted.get("enable", True))
            self._send_object(devices)
        self._send_object({"class": "WATCH", "enable": self._watched, "json": True})

    def _send_object(self, report: dict[str, Any]) -> None:
        self._line.write(json.dumps(_drop_unknown_values(report)).encode() + b"\n")


def _drop_unknown_values(report: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in report.items() if value is not None}


class GpsdServer:
    """Listens on a TCP port for several clients at once; each has its own line with the given
    faults.

    One thread calls the server and no call blocks. Raises OSError where the server cannot listen on
    the address.
    """

    def __init__(
        self, host: str, number: int, clock: Clock, seed: int, terminal: Port | None = None
    ) -> None:
        self._clock, self._seed = clock, seed
        self._server: socket.socket | None = _open_listener(host, number)
        self.number: int = self._server.getsockname()[1]
        self._host = host
        self._faults = PortFaults()
        self._connects = 0
        self._clients: list[_GpsdClient] = []
        self._fixed = None if terminal is None else ServedLine((terminal,), clock, seed)

    @property
    def name(self) -> str:
        """Address at which the server listens."""
        return f"socket://{self._host}:{self.number}"

    @property
    def names(self) -> tuple[str, ...]:
        """The address, as the only end of the line."""
        return (self.name,) if self._fixed is None else (self.name, *self._fixed.names)

    def list_clients(self) -> Sequence[ClientLine]:
        """Returns the clients that are connected now."""
        self.send_due()
        return (*self._clients, *(() if self._fixed is None else (self._fixed,)))

    def set_faults(self, faults: PortFaults) -> None:
        """Sets the faults of every line from now on."""
        self._faults = faults
        if faults.unplugged:
            self._close_connections()
        for client in self._clients:
            client.set_faults(faults)
        if self._fixed is not None:
            self._fixed.set_faults(faults)

    def send_due(self) -> None:
        """Accepts waiting clients, sends due bytes, and drops clients that have disconnected."""
        if self._server is None and not self._faults.unplugged:
            with contextlib.suppress(OSError):
                self._server = _open_listener(self._host, self.number)
        self._accept_clients()
        for client in self._clients:
            client.send_due()
        self._clients = [client for client in self._clients if client.open]
        if self._fixed is not None:
            self._fixed.send_due()

    def state(self) -> PortState:
        """Returns whether a client is connected, and the traffic of all clients."""
        last_error = (
            UNPLUGGED if self._faults.unplugged else "" if self._clients else "no client yet"
        )
        return PortState(bool(self._clients), self._connects, last_error, 0, 0, 0, 0, None, b"")

    def close(self) -> None:
        """Closes every connection."""
        self._close_connections()
        if self._fixed is not None:
            self._fixed.close()

    def _accept_clients(self) -> None:
        while self._server is not None and len(self._clients) < MAX_CLIENTS:
            try:
                connection, _ = self._server.accept()
            # No client waits for a connection.
            except OSError:
                return
            connection.setblocking(False)
            # A report must not wait for more bytes to fill a packet.
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._connects += 1
            self._clients.append(_GpsdClient(connection, self._clock, self._seed, self._connects))
            self._clients[-1].set_faults(self._faults)

    def _close_connections(self) -> None:
        for client in self._clients:
            client.close()
        self._clients = []
        if self._server is not None:
            self._server.close()
            self._server = None


class _GpsdClient:
    """Holds one connection, whose calls never block."""

    def __init__(self, connection: socket.socket, clock: Clock, seed: int, number: int) -> None:
        self.open = True
        self._connection, self._number = connection, number
        self._spoiler = LineCorrupter(clock, seed=seed + number)
        self._unsent = b""

    def set_faults(self, faults: PortFaults) -> None:
        self._spoiler.faults = faults

    def read(self) -> bytes:
        try:
            data = self._connection.recv(MAX_COMMAND_BYTES) if self.open else b""
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.close()
        return data

    def write(self, data: bytes) -> None:
        self._spoiler.put_bytes(data)
        self.send_due()

    def send_due(self) -> None:
        """Sends due bytes as far as the client accepts them."""
        self._unsent += b"".join(self._spoiler.take_due())
        if not self._unsent or not self.open:
            return
        try:
            self._unsent = self._unsent[self._connection.send(self._unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self.close()
        if len(self._unsent) > MAX_UNSENT_BYTES:
            self.close()

    def state(self) -> PortState:
        return PortState(self.open, self._number, "", 0, 0, 0, 0, None, b"")

    def close(self) -> None:
        self.open = False
        self._connection.close()


def _open_listener(host: str, number: int) -> socket.socket:
    server = socket.create_server((host, number))
    server.setblocking(False)
    return server
