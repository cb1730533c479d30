"""The virtual machine served to other programs: TCP ports, pseudo-terminals and UDP, with faults on a time line."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from drivers.datagrams import Datagrams, UdpPort
from drivers.devices.canopy_heads import PROTOCOLS
from drivers.ports import Clock, Port, PortState
from drivers.virtual.encoders import EncodedPlant
from drivers.virtual.extras import Extra, VirtualAgOpenGps, VirtualRateModule
from drivers.virtual.faults import PortFaults, Spoiler
from drivers.virtual.gpsd import GpsdServer, VirtualGpsd
from drivers.virtual.lag_rig import VirtualLagRig
from drivers.virtual.listen import ListeningPort
from drivers.virtual.machine import OPENING_MM, VirtualMachine
from drivers.virtual.pseudo_terminal import TerminalPort
from drivers.virtual.runaway import Runaway, VirtualRunaway
from drivers.virtual.served_line import ServedLine
from drivers.virtual.timeline import DRIVES, TimedFault, faults_at, runaway_at

FIRST_PORT = 4100
TRUE_PULSES_PER_TURN = 360.0        # of the virtual rate module's encoder


@dataclass(frozen=True, slots=True)
class Serve:
    """What is served and where. `first_port` 0: any free ports. Rate module and AgOpenGPS: (host, port), or None."""

    host: str = "127.0.0.1"
    first_port: int = FIRST_PORT
    heads: int = 6
    protocol: str = "greenseeker"
    opening_mm: float = OPENING_MM
    terminals: Path | None = None                       # folder for the pseudo-terminals' names
    rate_module: tuple[str, int] | None = None          # where the virtual module listens ...
    console: tuple[str, int] = ("127.0.0.1", 29999)     # ... and where it answers
    agopengps: tuple[str, int] | None = None            # where positions are sent to
    faults: Sequence[TimedFault] = field(default=())

    @property
    def devices(self) -> tuple[str, ...]:
        heads = tuple(f"head_{n}" for n in range(1, self.heads + 1))
        more = [name for name, there in (("rate_module", self.rate_module), ("agopengps", self.agopengps)) if there]
        return ("gnss", *heads, "board", "gpsd", "lag_rig", *more)

    def with_faults(self, faults: Sequence[TimedFault]) -> Serve:
        return replace(self, faults=faults)


class Address(NamedTuple):
    device: str
    protocol: str
    url: str


class ServedDatagrams:
    """A datagram line with faults in the direction away from the device; unplugged, in both."""

    def __init__(self, inner: Datagrams, clock: Clock, seed: int) -> None:
        self._inner = inner
        self._spoiler = Spoiler(clock, seed=seed, by_lines=False)

    @property
    def name(self) -> str:
        return self._inner.name

    def fault(self, faults: PortFaults) -> None:
        self._spoiler.faults = faults

    def read_each(self) -> list[bytes]:
        self.push()
        found = self._inner.read_each()
        return [] if self._spoiler.faults.unplugged else found

    def read(self) -> bytes:
        return b"".join(self.read_each())

    def write(self, data: bytes) -> None:
        self._spoiler.put(data)
        self.push()

    def push(self) -> None:
        """Send what is due."""
        for data in self._spoiler.due():
            self._inner.write(data)

    def state(self) -> PortState:
        return self._inner.state()

    def plug(self, plugged: bool) -> None:
        self._inner.plug(plugged)

    def close(self) -> None:
        self._inner.close()


class ServedMachine:
    """A plant behind all its protocols. Call `advance` often.

    Raises
    ------
    OSError : a port is taken, or there are no pseudo-terminals.
    """

    def __init__(self, plant: EncodedPlant, serve: Serve, clock: Clock) -> None:
        self._serve = serve
        self._clock = clock
        self._start_s = clock()
        self._lines: dict[str, ServedLine | ServedDatagrams | GpsdServer] = {}
        self._in_force: dict[str, PortFaults] = {}
        self._runs_away = Runaway()
        try:
            self._machine = self._built(plant, serve)
        except OSError:
            self._close_lines()
            raise

    @property
    def addresses(self) -> tuple[Address, ...]:
        """Where each device is to be found."""
        protocols = {"gnss": "nmea0183", "board": "slave-board/1", "gpsd": "gpsd", "lag_rig": "lag-rig/1",
                     "rate_module": "rate-module/udp", "agopengps": "agopengps"}
        return tuple(
            Address(device, protocols.get(device, self._serve.protocol), url)
            for device, line in self._lines.items()
            for url in ((line.name,) if isinstance(line, ServedDatagrams) else line.names))

    def advance(self) -> list[str]:
        """Bring the plant up to the clock; what changed on the time line of faults, in words."""
        now_s = self._clock()
        changes = []
        for device, line in self._lines.items():
            faults = faults_at(self._serve.faults, device, now_s - self._start_s)
            if faults != self._in_force.get(device, PortFaults()):
                line.fault(faults)
                self._in_force[device] = faults
                changes.append(f"{device}: {_words(faults)}")
            line.push()
        runs_away = runaway_at(self._serve.faults, now_s - self._start_s)
        if runs_away != self._runs_away:
            self._runs_away = runs_away
            changes.append(f"board: {_words_of_drives(runs_away)}")
        self._machine.advance(now_s)
        return changes

    def close(self) -> None:
        self._close_lines()

    def _built(self, plant: EncodedPlant, serve: Serve) -> VirtualMachine:
        heads = [f"head_{n}" for n in range(1, serve.heads + 1)]
        lines: dict[str, ServedLine] = {}
        for place, device in enumerate(("gnss", *heads, "board", "gpsd", "lag_rig")):
            if device == "gpsd":
                number = serve.first_port + place if serve.first_port else 0
                terminal = TerminalPort(serve.terminals / device, self._clock) if serve.terminals is not None else None
                gpsd = self._lines[device] = GpsdServer(serve.host, number, self._clock, place, terminal)
            else:
                lines[device] = self._lines[device] = self._line(device, serve, place)
        extras: list[Extra] = [VirtualGpsd(gpsd),
                               VirtualLagRig(lines["lag_rig"], lambda: getattr(plant, "truth", None))]
        if serve.rate_module is not None:
            host, number = serve.rate_module
            module = self._datagrams("rate_module", f"udp://{host}:{number}?to={serve.console[0]}:{serve.console[1]}")
            extras.append(VirtualRateModule(module, TRUE_PULSES_PER_TURN))
        if serve.agopengps is not None:
            host, number = serve.agopengps
            extras.append(VirtualAgOpenGps(self._datagrams("agopengps", f"udp://{host}:0?to={host}:{number}")))
        if any(fault.kind in DRIVES for fault in serve.faults):
            extras.append(VirtualRunaway(lambda at_s: runaway_at(serve.faults, at_s), self._start_s))
        return VirtualMachine(plant, lines["gnss"], [lines[name] for name in heads], lines["board"], self._start_s,
                              layout=PROTOCOLS[serve.protocol], opening_mm=serve.opening_mm, extras=extras)

    def _line(self, device: str, serve: Serve, place: int) -> ServedLine:
        number = serve.first_port + place if serve.first_port else 0
        ends: list[Port] = [ListeningPort(serve.host, number, self._clock)]
        if serve.terminals is not None:
            ends.append(TerminalPort(serve.terminals / device, self._clock))
        return ServedLine(ends, self._clock, seed=place)

    def _datagrams(self, device: str, url: str) -> ServedDatagrams:
        line = ServedDatagrams(UdpPort(url, self._clock), self._clock, seed=len(self._lines))
        self._lines[device] = line
        return line

    def _close_lines(self) -> None:
        for line in self._lines.values():
            line.close()


def _words_of_drives(runs_away: Runaway) -> str:
    wrong = [f"{name} {value:g} whatever the command" for name, value in runs_away._asdict().items()
             if value is not None]
    return ", ".join(wrong) or "its drives obey"


def _words(faults: PortFaults) -> str:
    wrong = [name for name, value in faults._asdict().items() if value]
    return ", ".join(wrong) or "as it should be"
