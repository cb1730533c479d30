"""How are datagrams sent and received over UDP? A bound UDP socket never blocks the loop, so it
needs no thread. Datagrams stay whole.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from collections import deque
from typing import NamedTuple, Protocol
from urllib.parse import parse_qs, urlsplit

from topdress.drivers.ports import (
    RAW_TAIL_BYTES,
    UNPLUGGED,
    Clock,
    Port,
    PortState,
    open_port,
    parse_scheme,
)

# Buffer for one datagram, bytes; every known message is shorter.
MAX_DATAGRAM_BYTES = 2048
# Largest number of datagrams that one read returns; in a flood older ones are dropped.
MAX_DATAGRAMS_PER_READ = 64
# Largest number of datagrams taken from the system in one read, other senders included; the system
# may drop the rest.
MAX_TAKEN_DATAGRAMS = 512
LOOPBACK_NETWORK = ipaddress.ip_network("127.0.0.0/8")
Network = ipaddress.IPv4Network | ipaddress.IPv6Network
# Interval of attempts to bind a socket whose port another program uses, s.
BIND_RETRY_S = 1.0
# UDP has no plug, so "connected" means that a datagram arrived within this time, s.
CONNECTED_TIMEOUT_S = 2.0


class Datagrams(Port, Protocol):
    """Defines a port that keeps datagrams separate. `read` returns them joined."""

    def read_each(self) -> list[bytes]:
        """Returns the datagrams that arrived since the last call, oldest first."""
        ...


class UdpAddress(NamedTuple):
    """Holds both ends of `udp://HOST:PORT[?to=HOST:PORT][&from=NETWORK]`. `senders` is the network
    of the permitted senders; None permits every sender."""

    host: str
    number: int
    to: tuple[str, int] | None = None
    senders: Network | None = None


def parse_udp_address(url: str) -> UdpAddress:
    """Returns the address to listen on, the address to send to and the permitted senders.

    Without `from`, a port on loopback permits this computer only; any other port permits the
    address to which it sends.

    Raises
    ------
    ValueError : a part of the URL cannot be read; the message is one line.
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
                    else _find_default_senders(parts.hostname, there)
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
    """Returns whether an address belongs to this computer alone and cannot be reached from the
    network."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _find_default_senders(host: str, to: tuple[str, int] | None) -> Network | None:
    """Returns the default senders. Raises ValueError where the destination is a host name."""
    if is_loopback(host):
        return LOOPBACK_NETWORK
    return None if to is None else ipaddress.ip_network(to[0])


class _TrafficCounters:
    """Counts the bytes of both directions."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._tail = b""
        self._last_s: float | None = None
        self._in = self.out = self.dropped_out = 0
        self.dropped_in = 0

    def count_received(self, data: bytes) -> None:
        """Counts one received datagram and its bytes."""
        self._tail = (self._tail + data.hex(" ").encode() + b"\n")[-RAW_TAIL_BYTES:]
        self._last_s = self._clock()
        self._in += len(data)

    def state(self, connects: int, last_error: str) -> PortState:
        """Returns the state of a port with this traffic."""
        connected = self._last_s is not None and self._clock() - self._last_s < CONNECTED_TIMEOUT_S
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
    """Holds a bound socket. A socket that cannot be bound, because another program uses the port,
    is tried again every second.

    Datagrams of senders that the address does not permit are dropped and counted.
    """

    def __init__(self, url: str, clock: Clock) -> None:
        self._url = url
        self._address = parse_udp_address(url)
        self._clock = clock
        self._traffic = _TrafficCounters(clock)
        self._socket: socket.socket | None = None
        self._connects = 0
        self._last_error = ""
        self._next_try_s = clock()
        self._closed = False
        self._plugged = True
        # The newest sender, and whether that sender is permitted.
        self._asked, self._believed = "", False
        self._bind_socket()

    @property
    def name(self) -> str:
        """Address of the port."""
        return self._url

    @property
    def number(self) -> int:
        """Returns the port number, which the system chooses where 0 was requested; 0 while not
        bound."""
        return int(self._socket.getsockname()[1]) if self._socket else 0

    def read_each(self) -> list[bytes]:
        """Returns the received datagrams."""
        self._bind_socket()
        found: deque[bytes] = deque(maxlen=MAX_DATAGRAMS_PER_READ)
        for _ in range(MAX_TAKEN_DATAGRAMS):
            if self._socket is None:
                break
            try:
                data, sender = self._socket.recvfrom(MAX_DATAGRAM_BYTES)
            except BlockingIOError:
                break
            # Windows reports here that no program listened to an earlier datagram.
            except OSError as error:
                self._last_error = str(error)
                break
            if not self._is_permitted(sender[0]):
                self._traffic.dropped_in += len(data)
                self._last_error = f"a datagram from {sender[0]} was refused"
                continue
            if len(found) == MAX_DATAGRAMS_PER_READ:
                self._traffic.dropped_in += len(found[0])
            found.append(data)
        for data in found:
            self._traffic.count_received(data)
        return list(found)

    def _is_permitted(self, host: str) -> bool:
        """Returns whether a sender is permitted. The answer for the newest sender is cached,
        because every datagram needs it."""
        if host != self._asked:
            senders = self._address.senders
            self._asked, self._believed = (
                host,
                senders is None or ipaddress.ip_address(host) in senders,
            )
        return self._believed

    def read(self) -> bytes:
        """Returns the received datagrams, joined."""
        return b"".join(self.read_each())

    def write(self, data: bytes) -> None:
        """Sends one datagram."""
        self._bind_socket()
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
        """Returns whether the socket is open, and its traffic."""
        state = self._traffic.state(self._connects, self._last_error)
        return state if self._plugged else state._replace(connected=False, last_error=UNPLUGGED)

    def plug(self, plugged: bool) -> None:
        """Closes the socket (False), or binds it at the next use (True)."""
        self._plugged = plugged
        self._next_try_s = self._clock()
        if not plugged:
            self._close_socket()

    def close(self) -> None:
        """Closes the socket."""
        self._closed = True
        self._close_socket()

    def _close_socket(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _bind_socket(self) -> None:
        now_s = self._clock()
        if (
            self._socket is not None
            or self._closed
            or not self._plugged
            or now_s < self._next_try_s
        ):
            return
        self._next_try_s = now_s + BIND_RETRY_S
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
    """Holds one end of a datagram line in memory; see `make_datagram_pair`."""

    def __init__(self, name: str, clock: Clock) -> None:
        self._name = name
        self._traffic = _TrafficCounters(clock)
        self._waiting: deque[bytes] = deque()
        self._other: MemoryDatagrams | None = None
        self._plugged = True

    @property
    def name(self) -> str:
        """Name of the line."""
        return self._name

    def join_ends(self, other: MemoryDatagrams) -> None:
        """Joins this end with another end: each end reads what the other writes."""
        self._other, other._other = other, self

    def read_each(self) -> list[bytes]:
        """Returns the received datagrams."""
        found = list(self._waiting)
        self._waiting.clear()
        for data in found:
            self._traffic.count_received(data)
        return found

    def read(self) -> bytes:
        """Returns the received datagrams, joined."""
        return b"".join(self.read_each())

    def write(self, data: bytes) -> None:
        """Sends one datagram."""
        if self._other is None or not (self._plugged and self._other._plugged):
            self._traffic.dropped_out += 1
            return
        self._traffic.out += len(data)
        self._other._waiting.append(data)

    def state(self) -> PortState:
        """Returns whether the line is connected, and its traffic."""
        return self._traffic.state(1, "" if self._plugged else UNPLUGGED)

    def plug(self, plugged: bool) -> None:
        """Plugs the line in or unplugs it."""
        self._plugged = plugged

    def close(self) -> None:
        """Closes this end."""
        if self._other is not None:
            self._other._other = None
            self._other = None


def make_datagram_pair(name: str, clock: Clock) -> tuple[MemoryDatagrams, MemoryDatagrams]:
    """Returns two ends of one datagram line."""
    one, two = MemoryDatagrams(f"{name}:host", clock), MemoryDatagrams(f"{name}:device", clock)
    one.join_ends(two)
    return one, two


def open_line(url: str, baud: int, clock: Clock) -> Port:
    """Opens any port of a cab file: the kinds of `open_port`, or `udp://`. Raises ValueError for a
    wrong URL."""
    return UdpPort(url, clock) if url.startswith("udp://") else open_port(url, baud, clock)


def validate_line_url(url: str) -> str:
    """Returns the URL if `open_line` knows its kind; raises ValueError with one line otherwise."""
    if url.startswith("udp://"):
        parse_udp_address(url)
    else:
        parse_scheme(url)
    return url
