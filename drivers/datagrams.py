"""UDP: datagrams in and out, whole ones only. A bound UDP socket never makes the loop wait, so
it needs no thread."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from collections import deque
from typing import NamedTuple, Protocol
from urllib.parse import parse_qs, urlsplit

from topdress.drivers.ports import (
    TAIL_BYTES,
    UNPLUGGED,
    Clock,
    Port,
    PortState,
    open_port,
    scheme_of,
)

LONGEST_DATAGRAM = 2048
# datagrams given at one read; older ones are dropped: a flood
MOST_WAITING = 64
# taken from the system at one read, strangers' included; the rest is its to drop
MOST_TAKEN = 512
LOOPBACK = ipaddress.ip_network("127.0.0.0/8")
Network = ipaddress.IPv4Network | ipaddress.IPv6Network
TRY_AGAIN_S = 1.0
# UDP has no plug: "connected" means heard this lately
SILENT_S = 2.0


class Datagrams(Port, Protocol):
    """A port that keeps datagrams apart. `read` gives them joined."""

    def read_each(self) -> list[bytes]:
        """The datagrams that arrived since the last call, oldest first."""
        ...


class UdpAddress(NamedTuple):
    """Both ends of `udp://HOST:PORT[?to=HOST:PORT][&from=NETWORK]`. `senders`: who is listened
    to; None: everybody."""

    host: str
    number: int
    to: tuple[str, int] | None = None
    senders: Network | None = None


def udp_address(url: str) -> UdpAddress:
    """Where to listen, where to send, whom to believe; ValueError with one line where any of it
    cannot be read.

    Without `from`, a port on loopback hears this computer only, any other one the address that
    it sends to.
    """
    try:
        parts = urlsplit(url)
        asked = parse_qs(parts.query)
        to = asked.get("to")
        other = urlsplit(f"udp://{to[0]}") if to else None
        if parts.scheme == "udp" and parts.hostname and parts.port is not None:
            there = (
                (other.hostname, other.port)
                if other is not None and other.hostname and other.port
                else None
            )
            if other is None or there is not None:
                senders = (
                    ipaddress.ip_network(asked["from"][0])
                    if "from" in asked
                    else _usual_senders(parts.hostname, there)
                )
                return UdpAddress(parts.hostname, parts.port, there, senders)
    except ValueError:
        pass
    raise ValueError(
        f"port {url}: allowed is udp://HOST:PORT or udp://HOST:PORT?to=HOST:PORT, with "
        "from=ADDRESS or "
        "from=NETWORK where others than these are to be heard"
    )


def is_loopback(host: str) -> bool:
    """Whether an address is this computer's own, and nobody else can reach it."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _usual_senders(host: str, to: tuple[str, int] | None) -> Network | None:
    """Raises ValueError where the address sent to is a name."""
    if is_loopback(host):
        return LOOPBACK
    return None if to is None else ipaddress.ip_network(to[0])


class _Traffic:
    """The counters of both directions."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._tail = b""
        self._last_s: float | None = None
        self._in = self.out = self.dropped_out = 0
        self.dropped_in = 0

    def heard(self, data: bytes) -> None:
        self._tail = (self._tail + data.hex(" ").encode() + b"\n")[-TAIL_BYTES:]
        self._last_s = self._clock()
        self._in += len(data)

    def state(self, connects: int, last_error: str) -> PortState:
        connected = self._last_s is not None and self._clock() - self._last_s < SILENT_S
        return PortState(
            connected,
            connects,
            last_error,
            self._in,
            self.out,
            self.dropped_in,
            self.dropped_out,
            self._last_s,
            self._tail,
        )


class UdpPort:
    """A bound socket. Where it cannot be bound (another program has the port), it is tried
    again every second.

    Who is not among the senders of its address is not heard, and counted with what was dropped.
    """

    def __init__(self, url: str, clock: Clock) -> None:
        self._url = url
        self._address = udp_address(url)
        self._clock = clock
        self._traffic = _Traffic(clock)
        self._socket: socket.socket | None = None
        self._connects = 0
        self._last_error = ""
        self._next_try_s = clock()
        self._closed = False
        self._plugged = True
        self._asked, self._believed = "", False  # the newest sender, and whether it is one
        self._bind()

    @property
    def name(self) -> str:
        return self._url

    @property
    def number(self) -> int:
        """The port number listened on (of use where 0 was asked for); 0 while not bound."""
        return int(self._socket.getsockname()[1]) if self._socket else 0

    def read_each(self) -> list[bytes]:
        self._bind()
        found: deque[bytes] = deque(maxlen=MOST_WAITING)
        for _ in range(MOST_TAKEN):
            if self._socket is None:
                break
            try:
                data, sender = self._socket.recvfrom(LONGEST_DATAGRAM)
            except BlockingIOError:
                break
            # Windows tells here that nobody listened to an earlier datagram
            except OSError as error:
                self._last_error = str(error)
                break
            if not self._believes(sender[0]):
                self._traffic.dropped_in += len(data)
                self._last_error = f"a datagram from {sender[0]} was refused"
                continue
            if len(found) == MOST_WAITING:
                self._traffic.dropped_in += len(found[0])
            found.append(data)
        for data in found:
            self._traffic.heard(data)
        return list(found)

    def _believes(self, host: str) -> bool:
        """Asked for each datagram, so the answer for the newest sender is kept."""
        if host != self._asked:
            senders = self._address.senders
            self._asked, self._believed = (
                host,
                senders is None or ipaddress.ip_address(host) in senders,
            )
        return self._believed

    def read(self) -> bytes:
        return b"".join(self.read_each())

    def write(self, data: bytes) -> None:
        self._bind()
        to = self._address.to
        if self._socket is None or to is None:
            self._traffic.dropped_out += 1
            return
        try:
            self._socket.sendto(data, to)
            self._traffic.out += len(data)
        except OSError as error:
            self._last_error = str(error)
            self._traffic.dropped_out += 1

    def state(self) -> PortState:
        state = self._traffic.state(self._connects, self._last_error)
        return state if self._plugged else state._replace(connected=False, last_error=UNPLUGGED)

    def plug(self, plugged: bool) -> None:
        """False: nobody listens here; True: bound at the next use."""
        self._plugged = plugged
        self._next_try_s = self._clock()
        if not plugged:
            self._unbind()

    def close(self) -> None:
        self._closed = True
        self._unbind()

    def _unbind(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _bind(self) -> None:
        now_s = self._clock()
        if (
            self._socket is not None
            or self._closed
            or not self._plugged
            or now_s < self._next_try_s
        ):
            return
        self._next_try_s = now_s + TRY_AGAIN_S
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            made.setblocking(False)
            made.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            made.bind((self._address.host, self._address.number))
        except OSError as error:
            with contextlib.suppress(OSError):
                made.close()
            self._last_error = str(error)
            return
        self._socket, self._connects, self._last_error = made, self._connects + 1, ""


class MemoryDatagrams:
    """One end of a datagram line in memory; see `datagram_pair`."""

    def __init__(self, name: str, clock: Clock) -> None:
        self._name = name
        self._traffic = _Traffic(clock)
        self._waiting: deque[bytes] = deque()
        self._other: MemoryDatagrams | None = None
        self._plugged = True

    @property
    def name(self) -> str:
        return self._name

    def join(self, other: MemoryDatagrams) -> None:
        self._other, other._other = other, self

    def read_each(self) -> list[bytes]:
        found = list(self._waiting)
        self._waiting.clear()
        for data in found:
            self._traffic.heard(data)
        return found

    def read(self) -> bytes:
        return b"".join(self.read_each())

    def write(self, data: bytes) -> None:
        if self._other is None or not (self._plugged and self._other._plugged):
            self._traffic.dropped_out += 1
            return
        self._traffic.out += len(data)
        self._other._waiting.append(data)

    def state(self) -> PortState:
        return self._traffic.state(1, "" if self._plugged else UNPLUGGED)

    def plug(self, plugged: bool) -> None:
        self._plugged = plugged

    def close(self) -> None:
        if self._other is not None:
            self._other._other = None
            self._other = None


def datagram_pair(name: str, clock: Clock) -> tuple[MemoryDatagrams, MemoryDatagrams]:
    """Two ends of one datagram line."""
    one, two = MemoryDatagrams(f"{name}:host", clock), MemoryDatagrams(f"{name}:device", clock)
    one.join(two)
    return one, two


def open_line(url: str, baud: int, clock: Clock) -> Port:
    """Any port of a cab file: what `open_port` opens, or `udp://`. Raises ValueError as they do."""
    return UdpPort(url, clock) if url.startswith("udp://") else open_port(url, baud, clock)


def line_url(url: str) -> str:
    """The URL, where `open_line` knows its kind; ValueError with one line where it does not."""
    if url.startswith("udp://"):
        udp_address(url)
    else:
        scheme_of(url)
    return url
