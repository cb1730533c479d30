"""How does the virtual machine imitate gpsd? It greets each client, answers its questions, and
reports to those that watch."""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Sequence
from typing import Any, Protocol

from topdress.control.readings import DriveCommand, GnssFix
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.ports import UNPLUGGED, Clock, Port, PortState
from topdress.drivers.virtual.extras import Extra
from topdress.drivers.virtual.faults import PortFaults, ServedLine, Spoiler

RELEASE = {"class": "VERSION", "release": "3.25", "proto_major": 3, "proto_minor": 15}
DEVICE = "/dev/virtual"
MODE_OF = {2: 2, 4: 3, 5: 4}  # GGA's quality in gpsd's status
LONGEST_QUESTION = 4096
MOST_CLIENTS = 16
MOST_UNSENT = 262_144  # bytes; a client that reads no more is let go


class ClientLine(Protocol):
    """One client's connection, as the virtual gpsd needs it."""

    def read(self) -> bytes: ...

    def write(self, data: bytes) -> None: ...

    def state(self) -> PortState: ...


class Clients(Protocol):
    def clients(self) -> Sequence[ClientLine]:
        """Who is connected now."""
        ...


class VirtualGpsd(Extra):
    """Serves several clients, each with its own watch. Known are ?VERSION, ?DEVICES, ?WATCH,
    ?POLL; all else is an ERROR.

    line : the one client there can be, or all of those that there are."""

    def __init__(self, line: Port | Clients) -> None:
        self._line = line
        self._sessions: dict[int, _Session] = {}

    def before(
        self, begin_s: float, command: DriveCommand, enabled: bool
    ) -> tuple[DriveCommand, bool]:
        lines: Sequence[ClientLine] = (
            self._line.clients() if hasattr(self._line, "clients") else (self._line,)
        )
        sessions = {id(line): self._sessions.get(id(line)) or _Session(line) for line in lines}
        self._sessions = sessions
        for session in sessions.values():
            session.hear()
        return command, enabled

    def after(self, sensed: SensorReadings, begin_s: float) -> None:
        if sensed.gnss is not None:
            for session in self._sessions.values():
                session.tell(sensed.gnss)


class _Session:
    """Serves one client: its questions, and whether it watches."""

    def __init__(self, line: ClientLine) -> None:
        self._line = line
        self._connects = 0
        self._watched = False
        self._rest = b""
        self._sky: dict[str, object] | None = None
        self._fix: dict[str, object] | None = None

    def hear(self) -> None:
        state = self._line.state()
        if state.connected and state.connects != self._connects:
            self._connects, self._watched, self._rest = state.connects, False, b""
            self._say(RELEASE)
        *questions, self._rest = (self._rest + self._line.read()).replace(b"\n", b";").split(b";")
        self._rest = self._rest[-LONGEST_QUESTION:]
        for question in questions:
            if question.strip():
                self._answer(question.strip().decode("ascii", "replace"))

    def tell(self, fix: GnssFix) -> None:
        self._sky = {"class": "SKY", "device": DEVICE, "uSat": fix.satellites, "hdop": fix.hdop}
        self._fix = {
            "class": "TPV",
            "device": DEVICE,
            "mode": 3 if fix.fix_quality else 1,
            "status": MODE_OF.get(fix.fix_quality, 1),
            "time": fix.utc,
            "lat": fix.lat_deg,
            "lon": fix.lon_deg,
            "track": fix.heading_deg,
            "speed": fix.speed_mps,
        }
        if self._watched:
            self._say(self._sky)
            self._say(self._fix)

    def _answer(self, question: str) -> None:
        name, _, given = question.partition("=")
        devices: dict[str, object] = {
            "class": "DEVICES",
            "devices": [{"class": "DEVICE", "path": DEVICE, "driver": "virtual"}],
        }
        if name == "?VERSION":
            self._say(RELEASE)
        elif name == "?DEVICES":
            self._say(devices)
        elif name == "?WATCH":
            self._watch(given, devices)
        elif name == "?POLL":
            reports = {
                "tpv": [] if self._fix is None else [_known(self._fix)],
                "sky": [] if self._sky is None else [_known(self._sky)],
            }
            time = None if self._fix is None else self._fix["time"]
            self._say({"class": "POLL", "time": time, "active": len(reports["tpv"]), **reports})
        else:
            self._say({"class": "ERROR", "message": f"Unrecognized request '{name}'"})

    def _watch(self, given: str, devices: dict[str, object]) -> None:
        """Sets the watch; without a value it reports its state, as gpsd does."""
        if given:
            try:
                wanted = json.loads(given)
            except ValueError:
                wanted = None
            if not isinstance(wanted, dict):
                self._say({"class": "ERROR", "message": "Invalid WATCH: not a JSON object"})
                return
            self._watched = bool(wanted.get("enable", True))
            self._say(devices)
        self._say({"class": "WATCH", "enable": self._watched, "json": True})

    def _say(self, said: dict[str, Any]) -> None:
        self._line.write(json.dumps(_known(said)).encode() + b"\n")


def _known(said: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in said.items() if value is not None}


class GpsdServer:
    """Listens on a TCP port for several clients at once; each has its own line with the given
    faults.

    Called from one thread; nothing blocks. Raises OSError where the address cannot be listened
    on."""

    def __init__(
        self, host: str, number: int, clock: Clock, seed: int, terminal: Port | None = None
    ) -> None:
        self._clock, self._seed = clock, seed
        self._server: socket.socket | None = _listening(host, number)
        self.number: int = self._server.getsockname()[1]
        self._host = host
        self._faults = PortFaults()
        self._connects = 0
        self._clients: list[_GpsdClient] = []
        self._fixed = None if terminal is None else ServedLine((terminal,), clock, seed)

    @property
    def name(self) -> str:
        return f"socket://{self._host}:{self.number}"

    @property
    def names(self) -> tuple[str, ...]:
        return (self.name,) if self._fixed is None else (self.name, *self._fixed.names)

    def clients(self) -> Sequence[ClientLine]:
        self.push()
        return (*self._clients, *(() if self._fixed is None else (self._fixed,)))

    def fault(self, faults: PortFaults) -> None:
        """Sets the faults of every line from now on."""
        self._faults = faults
        if faults.unplugged:
            self._let_go()
        for client in self._clients:
            client.fault(faults)
        if self._fixed is not None:
            self._fixed.fault(faults)

    def push(self) -> None:
        """Accepts waiting clients, sends due bytes, and drops clients that have gone."""
        if self._server is None and not self._faults.unplugged:
            with contextlib.suppress(OSError):
                self._server = _listening(self._host, self.number)
        self._accept()
        for client in self._clients:
            client.push()
        self._clients = [client for client in self._clients if client.open]
        if self._fixed is not None:
            self._fixed.push()

    def state(self) -> PortState:
        said = UNPLUGGED if self._faults.unplugged else "" if self._clients else "no client yet"
        return PortState(bool(self._clients), self._connects, said, 0, 0, 0, 0, None, b"")

    def close(self) -> None:
        self._let_go()
        if self._fixed is not None:
            self._fixed.close()

    def _accept(self) -> None:
        while self._server is not None and len(self._clients) < MOST_CLIENTS:
            try:
                connection, _ = self._server.accept()
            except OSError:  # nobody waits
                return
            connection.setblocking(False)
            # a report waits for no other
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._connects += 1
            self._clients.append(_GpsdClient(connection, self._clock, self._seed, self._connects))
            self._clients[-1].fault(self._faults)

    def _let_go(self) -> None:
        for client in self._clients:
            client.close()
        self._clients = []
        if self._server is not None:
            self._server.close()
            self._server = None


class _GpsdClient:
    """Holds one connection that never blocks."""

    def __init__(self, connection: socket.socket, clock: Clock, seed: int, number: int) -> None:
        self.open = True
        self._connection, self._number = connection, number
        self._spoiler = Spoiler(clock, seed=seed + number)
        self._unsent = b""

    def fault(self, faults: PortFaults) -> None:
        self._spoiler.faults = faults

    def read(self) -> bytes:
        try:
            data = self._connection.recv(LONGEST_QUESTION) if self.open else b""
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.close()
        return data

    def write(self, data: bytes) -> None:
        self._spoiler.put(data)
        self.push()

    def push(self) -> None:
        """Sends due bytes as far as the client takes them."""
        self._unsent += b"".join(self._spoiler.due())
        if not self._unsent or not self.open:
            return
        try:
            self._unsent = self._unsent[self._connection.send(self._unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self.close()
        if len(self._unsent) > MOST_UNSENT:
            self.close()

    def state(self) -> PortState:
        return PortState(self.open, self._number, "", 0, 0, 0, 0, None, b"")

    def close(self) -> None:
        self.open = False
        self._connection.close()


def _listening(host: str, number: int) -> socket.socket:
    server = socket.create_server((host, number))
    server.setblocking(False)
    return server
